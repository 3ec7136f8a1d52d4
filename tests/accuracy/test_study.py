"""accuracy_study: errors that are right, times that are there, nothing lost, and auto that chooses by it."""

import itertools
import json
import math
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import twolink as tl
from tests.loop.loops import slider
from tests.near import assert_near
from twolink.accuracy import measuring
from twolink.accuracy import study as accuracy_study
from twolink.accuracy.study_data import Reference, Row, with_front
from twolink.errors import AccuracyError, SceneError, ShowError, TwolinkError
from twolink.integrate.motion.scene_equations import equations_of
from twolink.integrate.steps.methods import METHODS
from twolink.io.tables import read_table
from twolink.simulation import time_limit

END = (-0.2229716591521448578, 0.74849218369550184904)  # arm-swing at 10 s, by an independent program
TOLERANCES = (1e-3, 1e-6, 1e-9)


@pytest.fixture(scope="module")
def arm() -> tl.Scene:
    return tl.load_scene("arm-swing")


@pytest.fixture(scope="module")
def study(arm: tl.Scene) -> tl.Study:
    names = ["rk4", "dop853", "taylor", "scipy-dop853"]
    return tl.accuracy_study(arm, methods=names, tolerances=TOLERANCES, repeats=2, budget=60.0)


def made(method: str, error: float, seconds: float) -> Row:
    return Row(method, 1e-3, None, error, seconds, 1, 1)


def test_rows_are_by_method_and_errors_fall_with_the_setting(study: tl.Study) -> None:
    assert list(dict.fromkeys(row.method for row in study.rows)) == ["rk4", "dop853", "taylor", "scipy-dop853"]
    for name in dict.fromkeys(row.method for row in study.rows):
        rows = [row for row in study.rows if row.method == name]
        assert len(rows) == 3
        errors = [row.error for row in rows]
        assert errors == sorted(errors, reverse=True)
        assert errors[-1] < 1e-6
        for row in rows:
            assert row.seconds > 0 < row.evaluations
            assert row.steps > 0
            assert (row.step is None) == METHODS[name].adaptive
            assert (row.tolerance is None) != (row.step is None)


def test_errors_have_the_unit_of_the_joints(study: tl.Study) -> None:
    assert study.unit == "rad"
    assert "at any sample, rad, against" in str(study)


def test_work_beside_it_does_not_count(arm: tl.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """Four of five runs wait 50 s for other programs, and a median would say so."""
    plain, waits = measuring.StudyRun._run, itertools.cycle((50.0, 50.0, 50.0, 0.0, 50.0))

    def run(self: measuring.StudyRun, *asked: object) -> object:
        solution, seconds = plain(self, *asked)
        return solution, seconds + next(waits)

    monkeypatch.setattr(measuring.StudyRun, "_run", run)
    study = tl.accuracy_study(arm, 1.0, methods=["rk4", "dop853"], tolerances=TOLERANCES[:2], repeats=20, budget=1e5)
    assert max(row.seconds for row in study.rows) < 50


@pytest.mark.slow
def test_the_reference_is_far_better_and_right(study: tl.Study, arm: tl.Scene) -> None:
    assert study.reference.error * 100 <= min(row.error for row in study.rows)
    assert all(row.resolved for row in study.rows)
    # The model's constants are doubles, which alone moves the end by 5.06e-16: 33 digits give the same.
    assert_near(study.reference.q_end, END, 6e-16)
    equations, times = equations_of(arm), np.linspace(0, 10, 101)
    first = measuring.first_reference(equations, times)
    better = measuring.by_taylor(equations, times, "quad")
    off = np.abs((first.q - better.q) + (first.rest - better.rest)).max()
    assert off <= first.digits_error < 1e-19
    assert better.digits_error < 1e-26


def test_a_rows_error_is_the_distance_from_a_better_solution(study: tl.Study, arm: tl.Scene) -> None:
    row = next(row for row in study.rows if row.method == "dop853" and row.tolerance == 1e-6)
    run = tl.simulate(arm, method="dop853", tolerance=1e-6, samples_per_second=50)
    fine = tl.simulate(arm, accuracy=1e-12, samples_per_second=50)
    assert np.abs(run.q - fine.q).max() == pytest.approx(row.error, rel=1e-3)


def test_the_front_the_cheapest_and_the_price_of_digits() -> None:
    rows = [made("rk45", 1e-2, 1.0), made("rk45", 1e-5, 3.0), made("dop853", 1e-4, 2.0), made("rk23", 1e-3, 2.5)]
    about = Reference("", 1e-12, 0.0, ())
    done = tl.Study("r", 1.0, 2, with_front(rows, about), (), about, 0.0)
    assert [row.method for row in done.front] == ["rk45", "dop853", "rk45"]
    assert done.cheapest(1e-3).method == "dop853"
    assert done.cheapest(0.5).seconds == 1.0
    prices = done.price_of_digits()
    assert [(p.accuracy, p.seconds, p.ratio) for p in prices] == [
        (0.1, 1.0, None), (1e-2, 2.0, 2.0), (1e-3, 2.0, 1.0), (1e-4, 3.0, 1.5)]  # fmt: skip
    with pytest.raises(AccuracyError, match=r"the best was 1\.0e-05 by rk45"):
        done.cheapest(1e-6)
    assert not with_front([made("rk45", 5e-11, 1.0)], about)[0].resolved


def test_saving_and_reading(study: tl.Study, tmp_path: Path) -> None:
    path = study.save(tmp_path / "x.json")
    assert json.loads(path.read_text()) == study.to_dict()
    again = tl.Study.load(path)
    assert again == study
    lines = study.save(tmp_path / "x.csv").read_text().splitlines()
    assert lines[0].startswith("method,tolerance,step,error,seconds")
    cells = lines[1].split(",")
    assert (cells[0], cells[1]) == ("rk4", "")
    assert float(cells[3]) == study.rows[0].error
    for name in ("x.parquet", "x.npz"):
        columns, notes = read_table(study.save(tmp_path / name))
        assert columns["error"].tolist() == [row.error for row in study.rows]
        assert float(notes["reference_error"]) == study.reference.error
    with pytest.raises(TwolinkError, match="not a format"):
        study.save(tmp_path / "x.doc")
    (tmp_path / "y.json").write_text("{}")
    with pytest.raises(TwolinkError, match="not a saved study"):
        tl.Study.load(tmp_path / "y.json")


def test_figure_and_text(study: tl.Study, tmp_path: Path) -> None:
    for name in ("x.png", "x.svg"):
        assert study.plot(tmp_path / name).stat().st_size > 10_000
    with pytest.raises(ShowError):
        study.plot(tmp_path / "x.doc")
    text = study.text()
    for part in ("two_link: 10 s", "31 digits", "dop853", "tolerance 1e-06", "what accuracy costs", " *"):
        assert part in text


def test_failures_are_kept_with_their_reason(arm: tl.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    ticks = itertools.count()  # a clock of its own: a second for each look at it, on every machine
    monkeypatch.setattr(time_limit, "time", SimpleNamespace(perf_counter=lambda: next(ticks)))
    done = tl.accuracy_study(arm, 1.0, methods=["implicit-midpoint", "rk4"], repeats=1, budget=30.0)
    reasons = {(f.method, f.reason.split(": ")[1].split(" ")[0]) for f in done.failures}
    assert ("rk4", "stopped") in reasons
    assert all((f.step is None) != (f.tolerance is None) for f in done.failures)
    assert {row.method for row in done.rows} == {"implicit-midpoint", "rk4"}
    for failure in done.failures:
        assert failure.reason in done.text()


def test_fixed_steps_cover_rough_to_fine_in_decades(arm: tl.Scene) -> None:
    rows = tl.accuracy_study(arm, 2.0, methods=["rk4"], repeats=1).rows
    assert max(row.error for row in rows) > 1e-3
    assert min(row.error for row in rows) < 1e-11
    known = [row for row in rows if 1e-9 < row.error < 1e-3]
    slopes = [math.log(a.error / b.error) / math.log(a.step / b.step)
              for a, b in pairwise(known)]  # fmt: skip
    assert all(3.2 < slope < 5.2 for slope in slopes)


def test_without_the_native_library(arm: tl.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measuring, "library", lambda: None)
    done = tl.accuracy_study(arm, 0.5, methods=["rk45", "taylor", "scipy-dop853"], tolerances=[1e-3, 1e-14], repeats=1,
                             budget=60.0)  # fmt: skip
    assert "scipy-dop853" in done.reference.how
    assert {row.method for row in done.rows} == {"rk45", "scipy-dop853"}
    assert done.failures[0].method == "taylor"
    assert any(not row.resolved for row in done.rows)
    assert "within the reference's own error" in done.text()
    assert done.cheapest(1e-3).error < 1e-3


def test_a_motion_with_events_is_compared_with_one_that_locates_them() -> None:
    """A mass on a rail that bounces once, by its closed form; Taylor's method says that it locates none."""
    fx, fall = tl.effects, np.sqrt(2.0 / 9.81)
    scene = tl.Scene(slider(), [1.0], effects=[fx.Torque({"rail": -9.81}), fx.JointStops({"rail": (0.0, 9.0)}, 0.5)])
    done = tl.accuracy_study(scene, 0.7, methods=["dop853", "taylor"], tolerances=[1e-6], repeats=1)
    later = 0.7 - fall
    assert_near(done.reference.q_end[0], 0.5 * 9.81 * fall * later - 9.81 * later**2 / 2, 1e-12)
    assert done.reference.error < 1e-10
    assert [row.method for row in done.rows] == ["dop853"]
    assert "does not locate events" in done.failures[0].reason
    ended = scene.with_effects([*scene.effects, fx.Watch("low", when=fx.JointReaches("rail", 0.5), stop=True)])
    with pytest.raises(AccuracyError, match="an event ends the motion at"):
        tl.accuracy_study(ended, 0.7)


def test_a_limit_of_effort_is_located_in_the_reference(arm: tl.Scene) -> None:
    limited = tl.effects.JointPD({"elbow": 1.0}, {"elbow": 20.0}, effort={"elbow": 1.0})
    scene = arm.with_effects([*arm.effects, limited])
    done = tl.accuracy_study(scene, 0.5, methods=["rk4"], tolerances=[1e-6], repeats=1)
    assert done.reference.error < 1e-10
    assert_near(done.reference.q_end, tl.simulate(scene, 0.5, accuracy=1e-10).q[-1], 2e-10)


def test_ctrl_c_keeps_what_is_done(arm: tl.Scene) -> None:
    def press(done: int, _total: int, _label: str) -> None:
        if done == 3:
            raise KeyboardInterrupt

    done = tl.accuracy_study(arm, 0.5, methods=["rk45", "dop853"], tolerances=TOLERANCES, repeats=1, progress=press)
    assert done.interrupted
    assert [row.method for row in done.rows] == ["rk45"] * 3
    assert "INTERRUPTED" in done.text()


def test_a_free_body_is_compared_on_its_manifold() -> None:
    scene = tl.Scene(tl.load_robot("spinning_box", root="free"), v=[1, 0, 0, 0.1, 5, 0.1])
    done = tl.accuracy_study(scene, 2.0, methods=["dop853", "rk45"], tolerances=TOLERANCES, repeats=1)
    assert 1e-16 < done.reference.error < 1e-14
    errors = [row.error for row in done.rows if row.method == "dop853"]
    assert errors[0] > errors[1] > errors[2] < 1e-7


REFUSED = {
    "unknown": ({"methods": ["dop583"]}, "did you mean 'dop853'"),
    "no names": ({"methods": 5}, "methods: expected texts, got 5"),
    "empty": ({"methods": []}, "no method is named"),
    "auto": ({"methods": ["auto"]}, "'auto' chooses a method"),
    "tolerance": ({"tolerances": [-1]}, "expected a number above 0, got -1"),
    "no tolerance": ({"tolerances": []}, "no tolerance"),
    "duration": ({"duration": 0}, "above 0 s"),
    "samples": ({"samples_per_second": 1e9}, "samples, the limit"),
    "repeats": ({"repeats": 0}, "whole number from 1"),
    "budget": ({"budget": math.nan}, "budget"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refusals(case: str, arm: tl.Scene) -> None:
    arguments, part = REFUSED[case]
    with pytest.raises(TwolinkError, match=part):
        tl.accuracy_study(arm, **arguments)


def test_what_is_no_scene_and_what_cannot_move() -> None:
    with pytest.raises(SceneError, match="expected a Scene"):
        tl.accuracy_study("arm-swing")
    still = tl.Scene(tl.load_robot("two_link", lock={"shoulder": 0.0, "elbow": 0.0}))
    with pytest.raises(SceneError, match="nothing moves"):
        tl.accuracy_study(still)
    with pytest.raises(TwolinkError, match="expected the path of a file, got 3"):
        tl.Study.load(3)
    assert accuracy_study.MAX_SAMPLES > 0
