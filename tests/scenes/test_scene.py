"""A scene does not change, survives pickling, and prints what a person wants to know."""

import pickle

import numpy as np
import pytest

import twolink as tl
from twolink.errors import SceneError
from twolink.scenes import bundled_scenes, scenes


def test_a_scene_cannot_be_changed() -> None:
    scene = tl.load_scene("arm-swing")
    for name in ("q", "duration", "anything"):
        with pytest.raises(SceneError, match="cannot be changed"):
            setattr(scene, name, 1.0)
    with pytest.raises(ValueError, match="read-only"):
        scene.q[0] = 1.0


def test_pickling_keeps_every_part_of_a_scene() -> None:
    robot = tl.load_robot("two_link", gravity=(0, 0, -1))
    scene = tl.Scene(robot, [0.1, 0.2], [0.3, 0.4], [tl.effects.Gravity((0.0, 0.0, -2.0))], 3.0, "title")
    again = pickle.loads(pickle.dumps(scene))
    assert (again.effects, again.duration, again.title) == (scene.effects, scene.duration, scene.title)
    assert np.array_equal(again.q, scene.q)
    assert np.array_equal(again.v, scene.v)
    assert again.base.gravity.tolist() == [0, 0, -1]
    assert again.robot.gravity.tolist() == [0, 0, -2]


def test_a_scene_prints_its_robot_state_and_effects() -> None:
    scene = tl.Scene(tl.load_robot("two_link"), [0.25, 0], effects=[tl.effects.Torque({"elbow": 1.0})], title="<a & b>")
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
        assert row["title"] == scene.title
        assert row["effects"] == tuple(dict.fromkeys(type(e).__struct_config__.tag for e in scene.effects))
