"""schemathesis reads the description and sends what it makes up: no answer is a 5xx, none breaks the service."""

from __future__ import annotations

from typing import Any

import pytest
import schemathesis
from hypothesis import HealthCheck, Phase, given, settings
from schemathesis.checks import not_a_server_error

from tests.service.serving import Served

RUNS = pytest.mark.parametrize("count", [3, pytest.param(60, marks=pytest.mark.slow)])


@pytest.mark.slow
@RUNS
@pytest.mark.filterwarnings("ignore")
def test_no_server_errors(served: Served, count: int) -> None:
    schema = schemathesis.openapi.from_url(f"{served.url}/openapi.json")
    operations = [operation.ok() for operation in schema.get_all_operations()]
    assert len(operations) > 30
    for operation in operations:
        if not operation.path.endswith("/events"):  # streams, read elsewhere
            _explore(operation, count)
    assert served.process.poll() is None


def _explore(operation: Any, count: int) -> None:
    @settings(max_examples=count, deadline=None, database=None, derandomize=True, phases=[Phase.generate],
              suppress_health_check=list(HealthCheck))  # fmt: skip
    def check(case: Any) -> None:
        if operation.path in ("/v1/simulations", "/v1/studies", "/v1/sweeps") and isinstance(case.body, dict):
            case.body["wait"] = 0
        case.call_and_validate(checks=[not_a_server_error], timeout=60)

    given(case=operation.as_strategy())(check)()
