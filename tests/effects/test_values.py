"""Values of effects: from the URDF they act as those given by joint, and texts with a unit are read as numbers."""

import math
from pathlib import Path

import pytest

import twolink as tl
from tests.effects.bodies import solved
from tests.effects.cases import E
from twolink import effects as fx
from twolink.effects.effect import Effect
from twolink.errors import SceneError
from twolink.lagrange.check import arm_urdf

ANGLE = math.radians(30.0)
READ: dict[str, tuple[Effect, Effect]] = {
    "stops": (E.JointStops({"elbow": ("-30 deg", math.inf)}), E.JointStops({"elbow": (-ANGLE, math.inf)})),
    "controller": (E.JointPD({"elbow": "30deg"}, {"elbow": 9.0}, {}, {"elbow": "1 N m"}, {"elbow": "5Nm"}),
                   E.JointPD({"elbow": ANGLE}, {"elbow": 9.0}, {}, {"elbow": 1.0}, {"elbow": 5.0})),
    "spring": (E.JointSpring({"elbow": 9.0}, {"elbow": "30 deg"}), E.JointSpring({"elbow": 9.0}, {"elbow": ANGLE})),
    "friction": (E.DryFriction({"elbow": "2 N m"}), E.DryFriction({"elbow": 2.0})),
    "speed": (E.LuGreFriction({"elbow": 9.0}, {"elbow": 1.0}, {"elbow": 2.0}, {"elbow": "30 deg/s"}),
              E.LuGreFriction({"elbow": 9.0}, {"elbow": 1.0}, {"elbow": 2.0}, {"elbow": ANGLE})),
    "inside a drive": (E.ActuatorLag(E.Torque({"elbow": "2 N m"}), {"elbow": 0.1}),
                       E.ActuatorLag(E.Torque({"elbow": 2.0}), {"elbow": 0.1})),
}  # fmt: skip
REFUSED: dict[str, tuple[Effect, str, str]] = {
    "another unit": (E.JointStops({"elbow": ("-30 mm", 1.0)}), "limits.elbow", "'-30 mm'; .*rad, or as \"30 deg\""),
    "no joint": (E.JointSpring({"elbow": 9.0}, {"elbo": "1 deg"}), "rest", "did you mean 'elbow'"),
    "below 0": (E.DryFriction({"elbow": "-2 N m"}), "kinetic.elbow", "at least 0, got -2.0"),
    "inside": (E.ActuatorLag(E.Torque({"elbow": "2 m"}), {"elbow": 0.1}), "of.inputs.elbow", 'N m, or as "30 Nm"'),
    "a gain": (E.JointPD({"elbow": 1.0}, {"elbow": "3"}), "kp.elbow", "expected a finite number"),
}


@pytest.mark.parametrize("case", READ)
def test_texts_are_read_as_numbers(case: str) -> None:
    given, plain = READ[case]
    (read,) = tl.Scene(tl.load_robot("two_link"), effects=[given]).effects
    assert read == plain


@pytest.mark.parametrize("case", REFUSED)
def test_other_texts_are_refused_at_their_place(case: str) -> None:
    given, where, what = REFUSED[case]
    with pytest.raises(SceneError, match=what) as caught:
        tl.Scene(tl.load_robot("two_link"), effects=[given])
    assert caught.value.where == f"effects[0].{where}"


def test_scene_files_take_them_and_saved_ones_have_numbers(tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_text('robot = "two_link"\n[[effects]]\ntype = "joint-stops"\nlimits = {elbow = ["-30 deg", "60 deg"]}')
    scene = tl.load_scene(path)
    assert scene.effects == (E.JointStops({"elbow": (-ANGLE, 2 * ANGLE)}),)
    assert "deg" not in scene.save(tmp_path / "saved.toml").read_text()


def test_efforts_of_queries_take_them() -> None:
    assert tl.load_robot("two_link").by_joint("tau", {"elbow": "3 N m"}).tolist() == [0.0, 3.0]
    with pytest.raises(tl.errors.QueryError, match="expected values by joint"):
        tl.load_robot("two_link").by_joint("tau", [1.0, 2.0])


def arm(friction: float, effort: float) -> tl.Robot:
    """Two rods; friction [N m] and effort limits [N m] of both joints in the URDF."""
    joint = f'<dynamics friction="{friction}"/></joint>'
    return tl.load_robot(arm_urdf(1, 1, 1, 1).replace('effort="1000"', f'effort="{effort}"').replace("</joint>", joint))


def pd(effort: object) -> fx.JointPD:
    return fx.JointPD({"elbow": 1.0}, {"elbow": 50.0}, {"elbow": 1.0}, effort=effort)


CASES = {
    "smooth friction": (fx.SmoothFriction(scale=0.1),
                        lambda f, _: fx.SmoothFriction({"shoulder": f, "elbow": f}, 0.1)),
    "dry friction": (fx.DryFriction(), lambda f, _: fx.DryFriction({"shoulder": f, "elbow": f})),
    "dry friction, stuck": (fx.DryFriction(static={"elbow": 9.0}),
                            lambda f, _: fx.DryFriction({"shoulder": f, "elbow": f}, {"elbow": 9.0})),
    "effort": (pd("urdf"), lambda _, effort: pd({"elbow": effort})),
}  # fmt: skip


@pytest.mark.some(2)
@pytest.mark.parametrize("case", CASES)
def test_values_of_the_urdf_act_as_those_given_by_joint(case: str) -> None:
    from_urdf, by_joint = CASES[case]
    for friction, effort in ((0.5, 5.0), (3.0, 2.0)):
        robot = arm(friction, effort)
        runs = [
            solved(robot, [fx.Gravity(), effect], 0.5, [0.5, 0.2], accuracy=1e-8, method="dop853")
            for effect in (from_urdf, by_joint(friction, effort))
        ]
        assert abs(runs[0].q - runs[1].q).max() <= runs[0].error.max() + runs[1].error.max()
