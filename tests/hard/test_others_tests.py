"""Others' cases give what the page says of them, and each is within its bar of what is exact."""

import re
from pathlib import Path

import numpy as np
import pytest

from scripts.benchmarks.published import ANDREWS, Case, cases, write_results
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


@pytest.mark.slow
def test_results_are_written_as_the_library_takes_them(tmp_path: Path) -> None:
    write_results(tmp_path)
    found = {path.stem.split("_")[-1]: np.loadtxt(path) for path in tmp_path.glob("*.txt")}
    assert sorted(found) == ["A01", "A02", "A03", "A04"]
    assert {len(rows) for rows in found.values()} == {2001}
    assert np.hypot(*found["A01"].T[1:]) == pytest.approx(1.0, abs=1e-12)
    assert found["A02"][-1] == pytest.approx([10.0, 0.32845811154081538, 0.94451853817860096], abs=1e-7)
    assert found["A03"][-1, 1:] == pytest.approx(list(ANDREWS.values()), abs=1e-9)
    assert found["A04"][0] == pytest.approx([0.0, 1.0, -1.0, 1.0])
