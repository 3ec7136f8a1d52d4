"""Every hard case through the public face: it meets its bar, or says by name that it does not."""

import json
import re
from pathlib import Path

import pytest

from tests.command import call
from twolink.errors import SceneError
from twolink.hard import Motion, all_cases, chosen, run_case
from twolink.hard.case_result import MET, SAID
from twolink.hard.page import page

PATIENCE = 300.0  # a hang, on any machine


def parameters() -> list[object]:
    out = []
    for case in all_cases():
        marks = [pytest.mark.slow] if case.slow else []
        out.append(pytest.param(case.name, marks=marks))
    return out


@pytest.mark.parametrize("name", parameters())
def test_case_meets_its_bar_or_says_that_it_does_not(name: str) -> None:
    (case,) = chosen([name])
    result = run_case(case, patience=PATIENCE)
    bad = [(a.setting, a.verdict, a.error, a.bar, a.message) for a in result.ours if a.verdict not in (MET, SAID)]
    assert not bad
    if isinstance(case, Motion) and case.may_refuse < 1.0:
        assert result.ours[0].verdict == MET or case.may_refuse >= 1e-3, "the roughest accuracy is met, not refused"


def test_names_are_unique_and_cases_say_why() -> None:
    cases = all_cases()
    assert len({case.name for case in cases}) == len(cases) >= 35
    assert all(len(case.why) > 40 for case in cases)
    with pytest.raises(SceneError, match="chaos"):
        chosen(["chaoz"])


def test_the_page_holds_all_and_needs_nothing_else() -> None:
    results = [run_case(case) for case in chosen(["symmetric-rest", "massless-links"])]
    text = page(results)
    assert "Let go from exact symmetric rest" in text
    assert "<svg" in text
    assert not re.search(r"https?://|src=|@import", text)


def test_the_command_prints_json_and_writes_the_page(tmp_path: Path) -> None:
    done = call("hard-cases", "picosecond", "massless-links", "--json", "--html", str(tmp_path / "hard.html"))
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert [case["verdict"] for case in found["cases"]] == [MET, SAID]
    assert (tmp_path / "hard.html").read_text().startswith("<!doctype html>")
