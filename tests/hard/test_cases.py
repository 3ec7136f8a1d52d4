"""Every hard case through the public interface: it meets its bar, or an error says that it does not."""

import json
import re
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import twolink as tl
from tests.command import call
from twolink.errors import RobotError, SceneError
from twolink.hard import ErrorCheck, RefusalCase, SimulationCase, all_cases, attempts, run_case, select_cases
from twolink.hard.case import FOLDER, INTERRUPTED, MET, MISSED, SAID, WRONG, ErrorCurve, ErrorFunction
from twolink.hard.page import error_plot, lines, page, summary
from twolink.hard.truths import distance

PATIENCE = 300.0  # seconds: more is a hang on any machine
LONG = {"pendulum-1000s", "stiction-reversals", "stiff-spring"}  # slow too: they take more than a second


def parameters() -> list[object]:
    out = []
    for case in all_cases():
        marks = [pytest.mark.slow] if case.slow or case.name in LONG else []
        out.append(pytest.param(case.name, marks=marks))
    return out


@pytest.mark.parametrize("name", parameters())
def test_case_meets_its_bar_or_says_that_it_does_not(name: str) -> None:
    (case,) = select_cases([name])
    result = run_case(case, patience=PATIENCE)
    bad = [(a.setting, a.verdict, a.error, a.bar, a.message) for a in result.ours if a.verdict not in (MET, SAID)]
    assert not bad
    if isinstance(case, SimulationCase) and case.may_refuse < 1.0:
        assert result.ours[0].verdict == MET or case.may_refuse >= 1e-3, "the largest accuracy is met, not refused"


def test_names_are_unique_and_cases_say_why() -> None:
    cases = all_cases()
    assert len({case.name for case in cases}) == len(cases) >= 35
    assert all(len(case.why) > 40 for case in cases)
    with pytest.raises(SceneError, match="chaos"):
        select_cases(["chaoz"])


def swinging(**options: Any) -> SimulationCase:
    """The symmetric-rest case at one accuracy, with some of its data replaced."""
    (case,) = select_cases(["symmetric-rest"])
    assert isinstance(case, SimulationCase)
    return replace(case, duration=1.0, settings=({"accuracy": 1e-6},), **options)


def constant_error(size: float) -> ErrorFunction:
    return lambda _robot, track: np.full(len(track.t), size)


def test_an_error_above_the_error_bar_is_wrong_silently() -> None:
    (attempt,) = run_case(swinging(error=constant_error(1e-3))).ours
    assert attempt.verdict == WRONG
    (attempt,) = run_case(swinging(error=constant_error(1e-3), bounded=False)).ours
    assert attempt.verdict == WRONG
    (attempt,) = run_case(swinging(error=constant_error(1e-3), bounded=False, slack=2e3)).ours
    assert attempt.verdict == MET


def test_the_truths_own_uncertainty_is_named_where_the_verdict_rests_on_it() -> None:
    (attempt,) = run_case(swinging(error=constant_error(1e-4), uncertainty=1e-3)).ours
    assert (attempt.verdict, attempt.message[:20]) == (MET, "above its error bar ")
    assert attempt.message.endswith("less than the truth is uncertain, 1e-03")
    (attempt,) = run_case(swinging(error=constant_error(1e-4), uncertainty=1e-3, bounded=False)).ours
    assert (attempt.verdict, attempt.message[:16]) == (MET, "above its limit ")
    (attempt,) = run_case(swinging(uncertainty=1e-3)).ours
    assert (attempt.verdict, attempt.message) == (MET, "")


def test_an_error_above_the_bar_anywhere_is_named_not_only_at_its_largest() -> None:
    """The bar differs from sample to sample: an error above it may be below its largest value."""
    case = swinging(uncertainty=1e-8)
    run = tl.simulate(case.load(), 1.0, accuracy=1e-6, samples_per_second=case.samples)
    assert run.error is not None
    between, least = (run.error.min() + run.error.max()) / 2, int(run.error.argmin())
    error = np.where(np.arange(len(run.t)) == least, between, 0.0)
    (attempt,) = run_case(replace(case, error=lambda _robot, _track: error)).ours
    assert attempt.bar is not None
    assert attempt.error == between < attempt.bar
    assert (attempt.verdict, attempt.message[:20]) == (MET, "above its error bar ")


def test_a_refusal_counts_only_where_it_may_come() -> None:
    impossible = ({"accuracy": 1e-15, "precision": "double"},)
    case = replace(swinging(), duration=100.0, samples=1.0, settings=impossible)
    assert run_case(case).verdict in (MISSED, WRONG)
    assert run_case(replace(case, may_refuse=1e-15)).verdict == SAID


def test_an_attempt_that_takes_too_long_is_missed() -> None:
    (attempt,) = run_case(swinging(), patience=0.0).ours
    assert (attempt.verdict, attempt.message[:18]) == (MISSED, "given up after 0 s")


def test_waiting_for_other_work_on_the_machine_is_not_computing(monkeypatch: pytest.MonkeyPatch) -> None:
    def delayed(*arguments: Any, progress: Callable[[float], None], **options: Any) -> tl.Trajectory:
        progress(0.0)
        time.sleep(0.4)
        progress(0.5)
        return tl.simulate(*arguments, **options)

    monkeypatch.setattr(attempts, "simulate", delayed)
    (attempt,) = run_case(swinging(), patience=0.2).ours
    assert attempt.verdict == MET
    assert attempt.seconds > 0.4


def test_an_interrupted_run_is_not_judged(monkeypatch: pytest.MonkeyPatch) -> None:
    case = swinging()
    run = tl.simulate(case.load(), 0.1)
    monkeypatch.setattr(attempts, "simulate", lambda *_, **__: replace(run, interrupted=True))
    result = run_case(case)
    (attempt,) = result.ours
    assert (attempt.setting, attempt.verdict, attempt.error, attempt.bar) == ("1e-06", INTERRUPTED, None, None)
    assert result.interrupted
    assert not result.passed
    assert "interrupted" in "".join(lines(result))
    assert summary([result]).startswith("0 of 1 cases met")
    assert "interrupted: symmetric-rest" in summary([result])
    assert "interrupted" in page([result])


def test_attempts_before_the_interruption_are_judged(monkeypatch: pytest.MonkeyPatch) -> None:
    case = replace(swinging(), settings=({"accuracy": 1e-3}, {"accuracy": 1e-6}, {"accuracy": 1e-9}))

    def until_the_second(*arguments: Any, accuracy: float, **options: Any) -> tl.Trajectory:
        if accuracy < 1e-3:
            raise KeyboardInterrupt
        return tl.simulate(*arguments, accuracy=accuracy, **options)

    monkeypatch.setattr(attempts, "simulate", until_the_second)
    result = run_case(case)
    assert [(a.setting, a.verdict) for a in result.ours] == [("1e-03", MET), ("1e-06", INTERRUPTED)]
    assert result.verdict == INTERRUPTED


def test_an_interrupted_call_is_no_accepted_call() -> None:
    """A solver takes Ctrl-C as the end of its run, and returns."""
    run = replace(tl.simulate(swinging().load(), 0.1), interrupted=True)
    checks = {"refused": ErrorCheck(refused, SceneError), "ended": ErrorCheck(lambda: run, SceneError)}
    result = run_case(RefusalCase(name="x", title="x", group="x", why="x", checks=checks))
    assert [a.verdict for a in result.ours] == [SAID, INTERRUPTED]


def test_calls_that_are_not_refused_are_wrong() -> None:
    checks = {
        "accepted": ErrorCheck(lambda: None, SceneError), "another kind": ErrorCheck(refused, RobotError),
        "other words": ErrorCheck(refused, SceneError, "gravity"), "right": ErrorCheck(refused, SceneError, "chaos"),
        "not ours": ErrorCheck(lambda: 1 / 0, SceneError), "answer": ErrorCheck(lambda: None, None),
    }  # fmt: skip
    result = run_case(RefusalCase(name="x", title="x", group="x", why="x", checks=checks))
    assert [a.verdict for a in result.ours] == [WRONG, MISSED, MISSED, SAID, MISSED, MET]
    assert not result.passed


def refused() -> object:
    return select_cases(["chaoz"])


def test_distances_of_near_rotations_do_not_vanish() -> None:
    robot = tl.load_robot(FOLDER / "wheel.urdf")
    theta, step = np.random.default_rng(0).uniform(-np.pi, np.pi, 2000), 1e-11
    q, other = (np.stack([np.cos(x), np.sin(x)], axis=1) for x in (theta, theta + step))
    np.testing.assert_allclose(distance(robot, q, other), step, rtol=1e-4, atol=2e-16)
    body = tl.load_robot(FOLDER / "tumbler.urdf", root="free")
    turned = np.zeros((1, 7))
    turned[0, 6] = 1.0
    near = turned.copy()
    near[0, 4] = step
    np.testing.assert_allclose(distance(body, turned, near), 2 * step)


def test_the_page_has_every_case_and_loads_nothing_from_elsewhere() -> None:
    results = [run_case(case) for case in select_cases(["symmetric-rest", "massless-links"])]
    text = page(results)
    assert "Release from exactly symmetric rest" in text
    assert re.findall('<img src="data:image/png;base64,[^"]+" [^>]*alt="(.*?)">', text) == ["error over time"]
    assert not re.search(r"https?://|src=(?!\"data:)|@import", text)


@pytest.mark.parametrize("value", [0.0, np.nan, np.inf, 1e300])
def test_errors_and_bars_of_any_size_are_drawn(value: float) -> None:
    result = run_case(select_cases(["symmetric-rest"])[0])
    curve = ErrorCurve(np.array([0.0, 1.0]), np.full(2, value), np.full(2, value))
    assert error_plot(replace(result, ours=[replace(result.ours[0], curve=curve)])).startswith("<img ")


def test_the_command_prints_json_and_writes_the_page(tmp_path: Path) -> None:
    done = call("hard-cases", "picosecond", "massless-links", "--json", "--html", str(tmp_path / "hard.html"))
    assert done.returncode == 0, done.stderr
    record = json.loads(done.stdout)
    assert [case["verdict"] for case in record["cases"]] == [MET, SAID]
    assert (tmp_path / "hard.html").read_text().startswith("<!doctype html>")
