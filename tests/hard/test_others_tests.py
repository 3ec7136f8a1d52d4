"""Others' cases give what the page says of them, and each is within its bar of what is exact."""

import re

import pytest

from scripts.benchmarks.published import Case, cases
from tests.command import TOP

PAGE = (TOP / "docs/how/others_tests.md").read_text("utf-8")
TOLD = {row[0]: row for line in PAGE.splitlines() if len(row := re.split(r" *\| *", line.strip("| "))) == 6}
OTHERS_DIGITS = 3e-10  # deg/s: two of NASA's tools agree with each other and with us to this


@pytest.mark.parametrize("case", cases(), ids=lambda case: case.name)
def test_a_case_of_others_is_within_its_bar(case: Case) -> None:
    source, what, published, error, bar, _ = TOLD[case.name]
    assert (source, what, published) == (case.name, case.what, case.published)
    run = case.run()
    assert run.error is not None
    found, limit = case.error(run), float(run.error.max())
    assert found <= (OTHERS_DIGITS if case.name.startswith("NASA") else 3.0 * limit + 1e-12)
    assert found <= 3.0 * float(error) + 1e-13
    assert limit <= 3.0 * float(bar)
