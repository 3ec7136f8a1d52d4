"""Scenes on the command line: printing one, beginning one for a robot, simulating a URDF, completing names."""

import os
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.command import TOP, TWOLINK, answer, call, one_line

URDF = str(TOP / "urdf" / "two_link.urdf")


def test_a_printed_scene_is_that_scene(tmp_path: Path) -> None:
    printed = call("scenes", "pendulum-friction")
    file = tmp_path / "mine.toml"
    file.write_text(printed.stdout)
    assert printed.returncode == 0
    assert tl.load_scene(file).effects == tl.load_scene("pendulum-friction").effects
    assert answer("scenes", "pendulum-friction")["robot"] == "friction_pendulum"
    words = "twolink: there is no bundled scene 'pendulum-frction'; did you mean 'pendulum-friction'?"
    one_line(call("scenes", "pendulum-frction"), 1, words)


@pytest.mark.parametrize(("robot", "root"), [(URDF, "fixed"), ("panda", "fixed"), ("z1", "fixed"), ("solo12", "free")])
def test_a_new_scene_and_each_effect_in_its_comments_can_be_read(robot: str, root: str, tmp_path: Path) -> None:
    file = tmp_path / "new" / "mine.toml"
    assert call("new", robot, str(file), "--root", root).returncode == 0
    scene = tl.load_scene(file)
    assert "between" not in file.read_text().partition("[v]")[2].partition("[[effects]]")[0]
    whole = tl.scene_of(tl.load_robot(robot, root=root), contact=root == "free")
    assert [type(effect) for effect in scene.effects] == [type(effect) for effect in whole.effects]
    assert (scene.duration, scene.q) == (2.0, pytest.approx(whole.q, abs=1e-3))
    motions = [tl.simulate(one, 0.1, accuracy=1e-3).q[-1] for one in (scene, whole.with_start(scene.q, scene.v))]
    assert motions[0] == pytest.approx(motions[1], abs=2e-3)
    assert root == "free" or abs(scene.robot.forward_dynamics(scene.q, scene.v, 0 * scene.v)).max() > 0.1  # it moves
    assert ("panda_finger_joint1 = 0.024  # m," in file.read_text()) == (robot == "panda")
    lower, upper = scene.robot.model.lowerPositionLimit, scene.robot.model.upperPositionLimit
    assert np.all((scene.q >= lower - 1e-3) & (scene.q <= upper + 1e-3))
    file.write_text(re.sub(r"^# (?=\[\[|\w+ = )", "", file.read_text(), flags=re.MULTILINE))
    scene = tl.load_scene(file)
    by_name = {type(effect).__name__: effect for effect in scene.effects}
    assert by_name.keys() >= {"Gravity", "JointDamping", "DryFriction", "Torque", "JointPD", "JointStops"}
    assert len(by_name) == len(scene.effects)
    for given, urdf in ((by_name["JointDamping"].damping, scene.base.model.damping),
                        (by_name["DryFriction"].kinetic, scene.base.model.friction)):  # fmt: skip
        dofs = {joint.name: joint.v.start for joint in scene.base.joints}
        assert [given.get(name, 0.0) for name in dofs] == [urdf[k] for k in dofs.values()]


def test_a_new_scene_replaces_no_file(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text("mine")
    one_line(call("new", "two_link", str(file)), 2, "it exists already")
    assert file.read_text() == "mine"


def test_a_urdf_runs_with_all_that_it_says() -> None:
    ends = answer("run", URDF, "--duration", "0.5")["q"]
    np.testing.assert_allclose(ends, tl.simulate(tl.scene_of(URDF), 0.5).q[-1], atol=2e-6)


@pytest.mark.parametrize(("ground", "size", "stepped"), [
    ([], 19, True), (["--ground"], 19, True), (["--no-ground"], 12, False), (["--root", "free"], 19, False),
])  # fmt: skip
def test_a_robot_that_moves_about_stands_on_the_ground_unless_it_is_asked_not_to(
    ground: list[str], size: int, stepped: bool
) -> None:
    options = ("--step", "0.002", "--no-verify") if stepped else ()
    record = answer("run", "solo12", *ground, "--duration", "0.02", *options)
    assert (len(record["q"]), record["cost"]["method"] == "stepped") == (size, stepped)


def test_explain_says_what_run_will_do_with_a_robot_that_moves_about() -> None:
    explained, panda = answer("explain", "solo12"), answer("explain", "panda")
    assert (explained["method"], explained["states"]) == ("stepped", 37)
    assert (panda["method"], panda["states"]) == ("dop853", 18)


@pytest.mark.some(1)
@pytest.mark.parametrize(("words", "found"), [("run pend", "pendulum-friction"), ("inspect pand", "panda")])
def test_the_shell_completes_names(words: str, found: str) -> None:
    position = {"COMP_WORDS": f"twolink {words}", "COMP_CWORD": "2", "_TWOLINK_COMPLETE": "complete_bash"}
    done = subprocess.run(TWOLINK, env={**os.environ, **position}, capture_output=True, text=True, cwd=TOP, timeout=60)
    assert found in done.stdout.split()
