"""Scene files are read strictly; errors name the file, the key, what was expected, and the nearest right name."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import twolink as tl
from twolink.errors import SceneError
from twolink.robots.catalogue import our_urdfs

GOOD = """
robot = "two_link"
duration = 2.0
[q]
shoulder = 0.1
[v]
elbow = -1.5
[[effects]]
type = "gravity"
field = [0.0, 0.0, -1.62]
"""


def scene_of(text: str, folder: Path) -> tl.Scene:
    path = folder / "my.toml"
    path.write_text(text)
    return tl.load_scene(path)


def test_a_file_gives_state_effects_and_duration(tmp_path: Path) -> None:
    scene = scene_of(GOOD, tmp_path)
    assert np.array_equal(scene.q, [0.1, 0])
    assert np.array_equal(scene.v, [0, -1.5])
    assert scene.duration == 2
    assert np.array_equal(scene.robot.gravity, [0, 0, -1.62])
    assert scene.effects == (tl.effects.Gravity((0.0, 0.0, -1.62)),)


def test_a_file_without_effects_is_free_motion(tmp_path: Path) -> None:
    assert np.array_equal(scene_of('robot = "arm"', tmp_path).robot.gravity, [0, 0, 0])


def test_robots_beside_the_file_and_roots_and_locks(tmp_path: Path) -> None:
    (tmp_path / "mine.urdf").write_text((our_urdfs() / "arm.urdf").read_text())
    assert scene_of('robot = "mine.urdf"', tmp_path).robot.nv == 2
    table = '[robot]\nsource = "ur5"\nroot = "free"\nlock = {elbow_joint = 0.5}'
    assert scene_of(table, tmp_path).robot.nv == 11


def test_samples_are_read_beside_the_file_and_saved_with_the_scene(tmp_path: Path) -> None:
    (tmp_path / "push.csv").write_text("t,force\n0,1\n1,-2\n")
    text = """robot = "two_link"
    [[effects]]
    type = "frame-wrench"
    frame = "tip"
    force = [0.0, { kind = "sampled", file = "push.csv" }, 0.0]"""
    scene = scene_of(text, tmp_path)
    assert scene.effects == (tl.effects.FrameWrench("tip", (0.0, tl.effects.Sampled((0.0, 1.0), (1.0, -2.0)), 0.0)),)
    assert tl.load_scene(scene.save(tmp_path / "elsewhere" / "saved.toml")).effects == scene.effects
    assert scene_of(text.replace("push.csv", str(tmp_path / "push.csv")), tmp_path).effects == scene.effects
    with pytest.raises(SceneError, match=r"my\.toml: effects\[0\].*none\.csv: cannot be read"):
        scene_of(text.replace("push", "none"), tmp_path)


def test_continuous_joints_take_an_angle(tmp_path: Path) -> None:
    scene = scene_of('robot = "kinova"\n[q]\nj2s6s200_joint_1 = 1.0', tmp_path)
    np.testing.assert_allclose(scene.q[:2], [np.cos(1), np.sin(1)])


BAD = {
    "key": ("durration = 3.0\n" + GOOD, ["my.toml", "`durration`", "did you mean 'duration'"]),
    "not TOML": (GOOD + "[[[", ["my.toml", "not TOML", "line"]),
    "no robot": ("duration = 1.0", ["missing required field `robot`"]),
    "robot name": (GOOD.replace("two_link", "two_lnk"), ["my.toml", "did you mean 'two_link'"]),
    "robot key": ('[robot]\nsource = "arm"\nrot = "free"', ["robot", "`rot`", "did you mean 'root'"]),
    "joint": (GOOD.replace("shoulder", "sholder"), ["my.toml: q", "'sholder'", "did you mean 'shoulder'"]),
    "joint's size": (
        GOOD.replace("shoulder = 0.1", "shoulder = [0.1, 0.2]"),
        ["q.shoulder", "expected 1 number, got 2"],
    ),
    "value": (GOOD.replace("0.1", '"much"'), ["my.toml: q.shoulder", "expected numbers, got 'much'", "in rad"]),
    "duration": (GOOD.replace("2.0", "-2.0"), ["my.toml: duration", "> 0"]),
    "effect": (GOOD.replace('"gravity"', '"gravty"'), ["effects[0]", "gravty"]),
    "effect without type": (GOOD.replace('type = "gravity"', ""), ["effects[0]", "it has no type"]),
    "long name": (GOOD.replace("two_link", "a" * 5_000), ["no robot of this name"]),
    "effect's key": (GOOD.replace("field", "feild"), ["effects[0]", "`feild`", "did you mean 'field'"]),
    "effect's shape": (GOOD.replace("[0.0, 0.0, -1.62]", "[0.0, -1.62]"), ["effects[0].field", "length 3"]),
    "not finite": (GOOD.replace("0.1", "nan"), ["my.toml: q", "nan"]),
}


@pytest.mark.parametrize("case", BAD)
def test_errors_name_the_place_and_the_remedy(case: str, tmp_path: Path) -> None:
    text, parts = BAD[case]
    with pytest.raises(SceneError) as caught:
        scene_of(text, tmp_path)
    for part in parts:
        assert part in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("source", "part"), [
    ("arm_swing", "did you mean 'arm-swing'"), (Path("none.toml"), "No such file"), (None, "a NoneType is not a scene"),
    (b"arm-swing", "a bytes is not a scene"), (Path("/dev/zero"), "more than"),
    ("arm.urdf", r"a URDF is a robot, not a scene; tl\.scene_of\('arm\.urdf'\)"),
])  # fmt: skip
def test_what_is_no_scene_is_refused(source: Any, part: str) -> None:
    with pytest.raises(SceneError, match=part):
        tl.load_scene(source)
