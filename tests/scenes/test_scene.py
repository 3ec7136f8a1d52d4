"""A scene does not change, survives pickling, and prints what a person wants to know."""

import copy
import pickle
import re
from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.scenes.test_saving import same
from tests.urdf_text import joint, link, robot_of
from twolink import effects as fx
from twolink.errors import SceneError, TwolinkError
from twolink.scenes import bundled_scenes, scenes

CONTINUOUS = robot_of(link("wheel"), joint("turn", "continuous", "ground", "wheel"))


def test_a_scene_cannot_be_changed() -> None:
    scene = tl.load_scene("arm-swing")
    for name in ("q", "duration", "anything"):
        with pytest.raises(SceneError, match="cannot be changed"):
            setattr(scene, name, 1.0)
    with pytest.raises(ValueError, match="read-only"):
        scene.q[0] = 1.0


def test_an_effect_is_left_out_by_place_class_or_name() -> None:
    scene = tl.load_scene("pitch")
    names = [type(effect).__name__ for effect in scene.effects]
    for effect in (names.index("AirDrag"), names.index("AirDrag") - len(names), fx.AirDrag, "AirDrag"):
        left = [type(one).__name__ for one in scene.without(effect).effects]
        assert left == [name for name in names if name != "AirDrag"]
    for missing in (99, "gravty", fx.Muscle):
        with pytest.raises(SceneError, match="the scene has Gravity") as refused:
            scene.without(missing)
        assert refused.value.code == "no-effect"


def test_a_start_is_given_by_joint() -> None:
    """As in scene files: others are neutral, and at rest."""
    panda, hand = tl.load_robot("panda"), {"panda_finger_joint1": 0.02}
    scene = tl.Scene(panda, {"panda_joint2": -0.5, **hand}, {"panda_joint1": 1})
    assert scene.q.tolist() == [0, -0.5, 0, 0, 0, 0, 0, 0.02, 0]
    assert scene.v.tolist() == [1, *[0] * 8]
    arm = tl.Scene(tl.load_robot("friction_pendulum"), {}, {"axle": np.float64(2.0)})
    assert np.array_equal(arm.q, arm.robot.neutral)
    floating = tl.Scene(tl.load_robot("ur5", root="free"), {"root_joint": [1, 2, 3, 0, 0, 0, 1], "elbow_joint": 0.3})
    assert floating.q[:3].tolist() == [1, 2, 3]


def test_a_start_may_have_units(tmp_path: Path) -> None:
    """Of the joint's coordinate: degrees of angles, millimetres of ways; also in files, and of locked joints."""
    arm = tl.Scene(tl.load_robot("two_link"), {"shoulder": "90 deg", "elbow": "-1.5rad"}, {"elbow": "180 deg/s"})
    assert arm.q.tolist() == [np.pi / 2, -1.5]
    assert arm.v.tolist() == [0.0, np.pi]
    assert tl.Scene(tl.load_robot("panda"), {"panda_finger_joint1": "20 mm"}).q[7] == 0.02
    np.testing.assert_allclose(tl.Scene(tl.load_robot(CONTINUOUS), {"turn": "60deg"}).q, [0.5, np.sqrt(0.75)])
    file = tmp_path / "scene.toml"
    file.write_text('robot = {source = "panda", lock = {panda_joint4 = "-90 deg"}}\nq = {panda_joint2 = "45 deg"}\n')
    scene = tl.load_scene(file)
    assert scene.q[1] == np.pi / 4
    tip, _ = scene.robot.frame_pose(scene.q, "panda_link7")
    panda = tl.load_robot("panda")
    bent = panda.by_joint("q", {"panda_joint2": np.pi / 4, "panda_joint4": -np.pi / 2})
    np.testing.assert_allclose(tip, panda.frame_pose(bent, "panda_link7")[0], atol=1e-15)


REFUSED = {
    "name": ({"elbw": 0.1}, "q: robot 'two_link' has no joint 'elbw'; did you mean 'elbow'"),
    "size": ({"elbow": [0.1, 0.2]}, "q.elbow: expected 1 number, got 2"),
    "text": ({"elbow": "far"}, "q.elbow: expected numbers, got 'far'"),
    "unit of a length": (
        {"elbow": "9 mm"},
        """q.elbow: expected numbers, got '9 mm'; give the joint's configuration in rad""",
    ),
    "unit of a rate": ({"elbow": "9 deg/s"}, "q.elbow: expected numbers, got '9 deg/s'"),
    "a long text": ({"elbow": "1" + " " * 100_000 + "!"}, "q.elbow: expected numbers"),  # took its cube
    "a long number": ({"elbow": "1" + "0" * 200}, "q.elbow: expected numbers"),
    "unit alone": ({"elbow": "deg"}, "q.elbow: expected numbers, got 'deg'"),
    "nan": ({"elbow": np.nan}, "expected finite numbers"),
    "nan deg": ({"elbow": "nan deg"}, "expected finite numbers"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_starts_by_joint_that_are_refused(case: str) -> None:
    values, part = REFUSED[case]
    with pytest.raises(TwolinkError, match=re.escape(part)):
        tl.Scene(tl.load_robot("two_link"), values)


def test_starts_that_may_be_mistakes_are_remarked() -> None:
    """In degrees, or beyond the URDF's limits: said by `explain`, not refused."""
    limited = tl.load_robot(robot_of(link("wheel"), joint("turn", "revolute", "ground", "wheel", upper=1.0)))
    assert tl.Scene(limited, [0.9]).notes() == []
    assert tl.Scene(limited, [1.2]).notes() == ["turn starts at 1.2 rad, beyond the limits -99 to 1 rad of the URDF"]
    assert "90 degrees are 1.571 rad" in str(tl.explain(tl.Scene(limited, {"turn": 90.0}), duration=0.1))
    assert all(tl.load_scene(name).notes() == [] for name in ("arm-swing", "bouncing-ball"))


def test_an_effect_that_is_listed_twice_is_refused_and_two_equal_ones_act_both() -> None:
    robot, torque = tl.load_robot("two_link"), {"elbow": 1.0}
    once = fx.Torque(torque)
    with pytest.raises(SceneError, match=r"effects\[2\]: this Torque is effects\[0\] already") as caught:
        tl.Scene(robot, effects=[once, fx.Gravity(), once])
    assert caught.value.data == {"effect": 2}
    both = tl.simulate(tl.Scene(robot, effects=[once, fx.Torque(torque)]), 0.3)
    double = tl.simulate(tl.Scene(robot, effects=[fx.Torque({"elbow": 2.0})]), 0.3)
    np.testing.assert_allclose(both.q[-1], double.q[-1], atol=2e-6)


def test_pickling_keeps_every_part_of_a_scene() -> None:
    robot = tl.load_robot("two_link", gravity=(0, 0, -1))
    scene = tl.Scene(robot, [0.1, 0.2], [0.3, 0.4], [fx.Gravity((0.0, 0.0, -2.0))], 3.0, "title")
    again = pickle.loads(pickle.dumps(scene))
    same(scene, again)
    assert again.base.gravity.tolist() == [0, 0, -1]
    assert again.robot.gravity.tolist() == [0, 0, -2]


def test_a_scene_with_a_constructor_of_its_own_goes_to_other_processes() -> None:
    class Pendulum(tl.Scene):
        def __init__(self, angle: float) -> None:
            super().__init__(tl.load_robot("friction_pendulum"), [angle])

    made = Pendulum(0.3)
    for again in (pickle.loads(pickle.dumps(made)), copy.deepcopy(made)):
        assert type(again) is tl.Scene
        assert again.q == made.q == [0.3]


def test_a_scene_prints_its_robot_state_and_effects() -> None:
    scene = tl.Scene(tl.load_robot("two_link"), [0.25, 0], effects=[fx.Torque({"elbow": 1.0})], title="<a & b>")
    for part in ("two_link", "0.25, 0", "Torque", "10 s", "<a & b>"):
        assert part in repr(scene)
    assert "&lt;a &amp; b&gt;" in scene._repr_html_()
    assert "<a & b>" not in scene._repr_html_()
    assert "none: free motion" in repr(tl.Scene(tl.load_robot("two_link")))


def test_the_table_of_bundled_scenes_says_what_they_show() -> None:
    table = scenes()
    assert tuple(row["name"] for row in table) == bundled_scenes()
    for row in table:
        scene = tl.load_scene(row["name"])
        assert row["title"] == scene.title != ""
        assert scene.robot.nv > 0
        assert row["effects"] == tuple(dict.fromkeys(type(e).__struct_config__.tag for e in scene.effects))


@pytest.mark.parametrize("effect", [
    fx.Payload("forearm", 1.0),
    fx.Rotor({"elbow": 1e-4}, ratio={"elbow": 50.0}),
    fx.Gear(fx.Torque({"elbow": 1.0}), {"elbow": 50.0}, inertia={"elbow": 1e-4}),
])  # fmt: skip
def test_no_effect_changes_a_robot_twice(effect: fx.Effect) -> None:
    """scene.robot has the payload and the rotors already: with the effects of the scene they would count twice."""
    scene = tl.Scene(tl.load_robot("two_link"), effects=[fx.Gravity(), effect])
    for robot in (scene.robot, pickle.loads(pickle.dumps(scene.robot))):
        with pytest.raises(SceneError, match=r"effects\[1\].*already.*scene\.base") as caught:
            tl.Scene(robot, effects=scene.effects)
        assert caught.value.code == "changed-twice"
    again = tl.Scene(scene.base, effects=scene.effects)
    assert np.array_equal(again.robot.mass_matrix(scene.q), scene.robot.mass_matrix(scene.q))
    other = tl.Scene(scene.robot, effects=[fx.Gravity((0.0, 0.0, -1.6))])  # with what it carries, elsewhere
    assert np.array_equal(other.robot.mass_matrix(scene.q), scene.robot.mass_matrix(scene.q))


def test_effects_that_set_constants_may_meet_them_again() -> None:
    scene = tl.load_scene("arm-swing")
    assert tl.Scene(scene.robot, scene.q, scene.v, scene.effects).robot.model == scene.robot.model
