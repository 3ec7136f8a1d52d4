"""Ctrl-C: every command exits with 130 and one line on stderr; what was computed so far is printed and written."""

import json
import sys

import pytest

from twolink import hard
from twolink.cli.app import main
from twolink.hard import Case, CaseResult


def interrupt(*_: object, **__: object) -> None:
    raise KeyboardInterrupt


def exit_code(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr(sys, "argv", ["twolink", *arguments])
    with pytest.raises(SystemExit) as stop:
        main()
    return int(stop.value.code or 0)


@pytest.mark.parametrize(
    ("arguments", "interrupted"),
    [
        (["robots"], "twolink.cli.robots.robot_table"),
        (["inspect", "arm"], "twolink.cli.common.robot_from"),
        (["query", "arm", "bias", "--q", "0 0"], "twolink.cli.queries.answer_query"),
        (["check"], "twolink.lagrange.check.check"),
        (["scenes"], "twolink.cli.scenes.scene_table"),
        (["explain", "arm-swing"], "twolink.simulation.explanation.explain"),
        (["run", "arm-swing"], "twolink.cli.scenes.scene_from"),
        (["accuracy", "arm-swing"], "twolink.cli.scenes.scene_from"),
        (["methods"], "twolink.cli.scenes.method_table"),
        (["play", "run.npz"], "twolink.simulation.trajectory.Trajectory.load"),
        (["throw", "bowl"], "twolink.parts.design.throw.load_scene"),
        (["hard-cases"], "twolink.hard.run_case"),
        (["paper"], "twolink.paper.figures.study"),
    ],
)
def test_a_command_without_results_exits_with_130(
    arguments: list[str], interrupted: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(interrupted, interrupt)
    assert exit_code(monkeypatch, *arguments) == 130
    assert capsys.readouterr().err == "twolink: interrupted\n"


def test_hard_cases_print_the_cases_that_are_done(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run_case = hard.run_case

    def interrupted_at_the_second(case: Case, **options: bool) -> CaseResult:
        return run_case(case, **options) if case.name == "massless-links" else interrupt()

    monkeypatch.setattr(hard, "run_case", interrupted_at_the_second)
    assert exit_code(monkeypatch, "hard-cases", "massless-links", "picosecond", "--json") == 130
    out, err = capsys.readouterr()
    assert err == "twolink: interrupted; what was done is kept\n"
    assert [case["name"] for case in json.loads(out)["cases"]] == ["massless-links"]


def test_an_interrupted_hard_case_is_the_last_row_and_is_not_judged(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("twolink.hard.attempts.simulate", interrupt)
    assert exit_code(monkeypatch, "hard-cases", "massless-links", "picosecond", "symmetric-rest") == 130
    out, err = capsys.readouterr()
    assert err == "twolink: interrupted; what was done is kept\n"
    rows = [line.split() for line in out.splitlines()]
    assert [row[0] for row in rows[:3]] == ["case", "massless-links", "picosecond"]
    assert rows[2][-1] == "interrupted"
    assert "1 of 2 cases met" in out
    assert "symmetric-rest" not in out


def test_quick_hard_cases_name_what_they_leave_out(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert exit_code(monkeypatch, "hard-cases", "massless-links", "odd-durations", "--quick") == 0
    assert "left out as slow: odd-durations" in capsys.readouterr().out
