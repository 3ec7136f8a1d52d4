"""explain: what a scene computes, and what each effect costs; an effect that is absent costs nothing."""

import pytest

import twolink as tl
from twolink.errors import AccuracyError, SceneError
from twolink.integrate.motion.scene_equations import equations_of

ARM = "two_link"


def test_shares_are_counted_and_absent_effects_cost_nothing() -> None:
    fx, robot = tl.effects, tl.load_robot(ARM)
    free = tl.Scene(robot)
    heavy = tl.Scene(robot, effects=[fx.Gravity()])
    damped = tl.Scene(robot, effects=[fx.Gravity(), fx.JointDamping({"shoulder": 0.5})])
    alone, with_gravity, with_both = (equations_of(s).operations for s in (free, heavy, damped))
    assert alone < with_gravity < with_both <= with_gravity + 4
    found = tl.explain(damped, accuracy=1e-6)
    assert [share.effect for share in found.shares] == ["gravity", "joint-damping"]
    assert found.shares[1].operations == with_both - with_gravity
    assert (
        equations_of(tl.Scene(robot, effects=[fx.Gravity(), fx.JointDamping({"shoulder": 0.0})])).operations
        == with_gravity
    )


def test_it_names_the_method_that_a_run_takes() -> None:
    scene = tl.load_scene("arm-swing")
    found, run = tl.explain(scene, accuracy=1e-7), tl.simulate(scene, accuracy=1e-7)
    assert run.cost is not None
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
