"""Whether the service answers as its description says: schemathesis makes up requests for every operation.

    python -m scripts.studies.api [--cases 5000]

Exit code 1 where an answer is not described (its status, media type or schema), or is a 500.
"""

import tempfile
import warnings
from collections import Counter
from pathlib import Path
from typing import Any

import schemathesis
from hypothesis import HealthCheck, Phase, given, settings
from schemathesis.checks import content_type_conformance, response_schema_conformance, status_code_conformance

from scripts.runner import options, print_bars
from tests.parts.service.serving import Served, serving
from twolink.parts.service.work.requests import JOB_KINDS

JOBS = tuple(f"/v1/{kind.path}" for kind in JOB_KINDS.values())
LONGEST = 60.0  # s: a request
QUOTAS = ("--quota", "job_seconds=2", "--quota", "query_seconds=10", "--quota", "disk_mb=600")


def _is_no_fault(_: Any, answer: Any, __: Any) -> None:
    if answer.status_code == 500:
        raise AssertionError("the service has failed: 500")


CHECKS = [_is_no_fault, status_code_conformance, content_type_conformance, response_schema_conformance]


def explore(served: Served, cases: int, failures: Counter[str]) -> int:
    """Ask so many times for each operation, and count what is wrong by operation. Returns the number of requests."""
    schema = schemathesis.openapi.from_url(f"{served.url}/openapi.json")
    operations = [each.ok() for each in schema.get_all_operations()]
    return sum(
        _ask(operation, cases, failures)
        for operation in operations
        if not operation.path.endswith("/events")  # streams, read elsewhere
    )


def _ask(operation: Any, cases: int, failures: Counter[str]) -> int:
    asked = 0

    @settings(max_examples=cases, deadline=None, database=None, derandomize=True, phases=[Phase.generate],
              suppress_health_check=list(HealthCheck))  # fmt: skip
    @given(case=operation.as_strategy())
    def ask(case: Any) -> None:
        nonlocal asked
        asked += 1
        if operation.path in JOBS and isinstance(case.body, dict):
            case.body["wait"] = 0
        try:
            case.call_and_validate(checks=CHECKS, timeout=LONGEST)
        except Exception as error:  # groups of what the checks have found, and timeouts
            failures[f"{operation.label}: {_short(error)}"] += 1

    ask()
    return asked


def _short(error: BaseException) -> str:
    inner = getattr(error, "exceptions", (error,))
    return "; ".join(" ".join(str(each).split())[:300] for each in inner)


def main() -> int:
    given_ = options(__doc__, cases=5000)
    warnings.simplefilter("ignore")
    failures: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder, serving(Path(folder) / "data", *QUOTAS) as served:
        operations = len(list(schemathesis.openapi.from_url(f"{served.url}/openapi.json").get_all_operations()))
        asked = explore(served, max(1, round(given_.cases / operations)), failures)
        is_up = served.process.poll() is None
    for what, count in failures.most_common():
        print(f"{count:6d}  {what}")
    bars = [(not failures, f"{asked} requests: each answer is as described, none a 500"), (is_up, "the service is up")]
    return 0 if print_bars(bars) else 1


if __name__ == "__main__":
    raise SystemExit(main())
