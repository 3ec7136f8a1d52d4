"""Angles, lengths, speeds and efforts by joint in effects as texts with a unit."""

import math
from pathlib import Path

import pytest

import twolink as tl
from tests.effects.cases import E
from twolink.effects.effect import Effect
from twolink.errors import SceneError

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
