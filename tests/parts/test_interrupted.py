"""Ctrl-C: every command exits with 130 and one line on stderr; what was computed so far is printed and written."""

import json

import pytest

from tests.command import call
from twolink import hard
from twolink.hard import Case, CaseResult


def interrupt(*_: object, **__: object) -> None:
    raise KeyboardInterrupt


@pytest.mark.parametrize(("arguments", "interrupted"), [
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
])  # fmt: skip
def test_a_command_without_results_exits_with_130(
    arguments: list[str], interrupted: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(interrupted, interrupt)
    done = call(*arguments)
    assert (done.returncode, done.stderr) == (130, "twolink: interrupted\n")


KEPT = (130, "twolink: interrupted; what was done is kept\n")


def test_hard_cases_print_the_cases_that_are_done(monkeypatch: pytest.MonkeyPatch) -> None:
    run_case = hard.run_case

    def interrupted_at_the_second(case: Case, **options: bool) -> CaseResult:
        return run_case(case, **options) if case.name == "massless-links" else interrupt()

    monkeypatch.setattr(hard, "run_case", interrupted_at_the_second)
    done = call("hard-cases", "massless-links", "picosecond", "--json")
    assert (done.returncode, done.stderr) == KEPT
    assert [case["name"] for case in json.loads(done.stdout)["cases"]] == ["massless-links"]


def test_an_interrupted_hard_case_is_the_last_row_and_is_not_judged(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("twolink.hard.attempts.simulate", interrupt)
    done = call("hard-cases", "massless-links", "picosecond", "symmetric-rest")
    assert (done.returncode, done.stderr) == KEPT
    rows = [line.split() for line in done.stdout.splitlines()]
    assert [row[0] for row in rows[:3]] == ["case", "massless-links", "picosecond"]
    assert rows[2][-1] == "interrupted"
    assert "1 of 2 cases met" in done.stdout
    assert "symmetric-rest" not in done.stdout


def test_quick_hard_cases_name_what_they_leave_out() -> None:
    done = call("hard-cases", "massless-links", "odd-durations", "--quick")
    assert done.returncode == 0
    assert "left out as slow: odd-durations" in done.stdout
