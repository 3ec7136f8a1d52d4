"""explain: what a scene computes, and what each effect costs. It prices what it counts, and runs nothing."""

import re
import time

import numpy as np
import pytest

import twolink as tl
from twolink.errors import AccuracyError, SceneError
from twolink.integrate.motion.scene_equations import equations_of
from twolink.native import programs
from twolink.native.speed import nanoseconds_of_operation

fx, ARM = tl.effects, tl.load_robot("two_link")


def test_shares_are_what_an_effect_costs() -> None:
    scene = tl.Scene(ARM, effects=[fx.Gravity(), fx.JointDamping({"shoulder": 0.5})])
    found = tl.explain(scene, accuracy=1e-6)
    assert [share.effect for share in found.shares] == ["gravity", "joint-damping"]
    without = [equations_of(scene.without(i)).operations for i in range(2)]
    assert [share.operations for share in found.shares] == [equations_of(scene).operations - n for n in without]
    assert found.shares[0].operations > 0


def test_effects_with_events_are_named() -> None:
    effects = [fx.DryFriction({"elbow": 1.0}), fx.JointStops({"elbow": (-1.5, 1.5)}),
               fx.PlaneContact("tip", height=-3.0), fx.Release(fx.Payload("tip", 2.0), at=0.5),
               fx.Watch("late", at=0.1)]  # fmt: skip
    told = str(tl.explain(tl.Scene(ARM, effects=effects, duration=0.2)))
    assert all(type(effect).__name__ in told for effect in effects)


def test_it_names_the_method_that_a_run_takes() -> None:
    scene = tl.load_scene("arm-swing")
    found, run = tl.explain(scene, accuracy=1e-7), tl.simulate(scene, accuracy=1e-7)
    assert (found.method, found.setting) == (run.cost.method, run.cost.tolerance)
    assert found.expected_seconds > 0
    assert found.states == 4
    assert "gravity" in str(found)


@pytest.mark.parametrize("name", ["ball", "box", "can", "heavy_top"])
def test_a_robot_without_joints_computes_nothing(name: str) -> None:
    scene = tl.Scene(tl.load_robot(name), effects=[tl.effects.Gravity()], duration=1.0)
    for method in ("auto", "rk4", "dop853", "esdirk43"):
        found = tl.explain(scene, method=method)
        assert (found.states, found.operations, found.nanoseconds) == (0, 0, None)


def test_refusals() -> None:
    with pytest.raises(SceneError, match="expected a Scene"):
        tl.explain("arm-swing")
    with pytest.raises(AccuracyError, match="accuracy: expected a number above 0, got nan"):
        tl.explain(tl.load_scene("arm-swing"), accuracy=float("nan"))


def test_an_evaluation_is_priced_by_its_operations() -> None:
    scene = tl.load_scene("squeezer")
    explained = tl.explain(scene)
    batch, alone = explained.nanoseconds
    assert 0 < batch < alone  # a batch uses whole vectors
    work = equations_of(scene).operations + 8 * scene.robot.nv + 30
    assert np.allclose(explained.nanoseconds, [work * one for one in nanoseconds_of_operation()])


def test_no_program_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(programs, "arrays_named", None)
    robot = tl.load_robot("panda")
    damped = tl.effects.JointDamping({robot.joints[0].name: 0.1})
    begin = time.process_time()
    explained = tl.explain(tl.Scene(robot, effects=[tl.effects.Gravity(), damped]), 2.0)
    assert time.process_time() - begin < 2.0  # 0.1 s of a machine at rest
    assert 0 < explained.expected_seconds < 1.0


def test_the_most_steps_that_it_says_are_those_of_a_run_without_an_accuracy(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = tl.load_scene("dominoes")
    assert "at most 83,333 of them" in tl.explain(scene).why  # 3,000,000 by its 36 degrees of freedom
    monkeypatch.setattr("twolink.simulation.stepped_run.WORK", 36 * 300)
    assert "at most 300 of them" in tl.explain(scene).why
    run = tl.simulate(scene, 0.4, t_eval=[0.4])
    steps = [0.4 / float(h) for h in re.findall(r"([\d.e-]+) s: estimate", run.cost.why)]
    assert 150 < max(steps) < 310  # the text has two digits of their lengths
