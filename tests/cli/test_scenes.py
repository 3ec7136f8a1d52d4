"""Scenes on the command line: printing one, beginning one for a robot, simulating a URDF, completing names."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.command import TOP, TWOLINK
from twolink.cli.app import main

URDF = TOP / "urdf" / "two_link.urdf"
Twolink = Callable[..., tuple[object, str, str]]


@pytest.fixture
def twolink(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Twolink:
    """Calls the command line in this process: its exit code, output and errors."""

    def called(*arguments: object) -> tuple[object, str, str]:
        monkeypatch.setattr(sys, "argv", ["twolink", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            main()
        return stop.value.code, *capsys.readouterr()

    return called


def test_a_printed_scene_is_that_scene(twolink: Twolink, tmp_path: Path) -> None:
    code, text, _ = twolink("scenes", "pendulum-friction")
    file = tmp_path / "mine.toml"
    file.write_text(text)
    assert code == 0
    assert tl.load_scene(file).effects == tl.load_scene("pendulum-friction").effects
    assert json.loads(twolink("scenes", "pendulum-friction", "--json")[1])["robot"] == "friction_pendulum"
    code, _, problem = twolink("scenes", "pendulum-frction")
    assert code == 1
    assert problem.startswith(
        "twolink: there is no bundled scene 'pendulum-frction'; did you mean 'pendulum-friction'?"
    )


@pytest.mark.parametrize(("robot", "root"), [(URDF, "fixed"), ("panda", "fixed"), ("z1", "fixed"), ("solo12", "free")])
def test_a_new_scene_and_each_effect_in_its_comments_can_be_read(
    robot: str | Path, root: str, twolink: Twolink, tmp_path: Path
) -> None:
    file = tmp_path / "new" / "mine.toml"
    assert twolink("new", robot, file, "--root", root)[0] == 0
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


def test_a_new_scene_replaces_no_file(twolink: Twolink, tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text("mine")
    code, _, problem = twolink("new", "two_link", file)
    assert (code, file.read_text()) == (2, "mine")
    assert "it exists already" in problem


def test_a_urdf_runs_with_all_that_it_says(twolink: Twolink) -> None:
    code, out, _ = twolink("run", URDF, "--duration", "0.5", "--json")
    scene = tl.scene_of(URDF)
    assert code == 0
    np.testing.assert_allclose(json.loads(out)["q"], tl.simulate(scene, 0.5).q[-1], atol=2e-6)


def test_a_robot_that_moves_about_stands_on_the_ground_unless_it_is_asked_not_to(twolink: Twolink) -> None:
    options = ("--duration", "0.02", "--step", "0.002", "--no-verify", "--json")
    for ground in ([], ["--ground"]):
        code, out, _ = twolink("run", "solo12", *ground, *options)
        assert code == 0
        assert len(json.loads(out)["q"]) == 19
        assert json.loads(out)["cost"]["method"] == "stepped"
    for other, size in ((["--no-ground"], 12), (["--root", "free"], 19)):
        code, out, _ = twolink("run", "solo12", *other, "--duration", "0.02", "--json")
        assert code == 0
        assert len(json.loads(out)["q"]) == size
        assert json.loads(out)["cost"]["method"] != "stepped"
    code, _, problem = twolink("run", "arm-swing", "--ground")
    assert (code, problem[:19]) == (2, "twolink: --ground: ")


def test_messages_name_options(twolink: Twolink) -> None:
    code, _, problem = twolink("run", "arm-swing", "--duration", "-1")
    assert code == 2
    assert problem.startswith("twolink: --duration: ")
    code, _, problem = twolink("run", "arm-swing", "--method", "rk4", "--tolerance", "1e-3")
    assert code == 2
    assert problem == "twolink: --method: rk4 takes steps of one size; give --step\n"


@pytest.mark.some(1)
@pytest.mark.parametrize(("words", "found"), [("run pend", "pendulum-friction"), ("inspect pand", "panda")])
def test_the_shell_completes_names(words: str, found: str) -> None:
    position = {"COMP_WORDS": f"twolink {words}", "COMP_CWORD": "2", "_TWOLINK_COMPLETE": "complete_bash"}
    done = subprocess.run(TWOLINK, env={**os.environ, **position}, capture_output=True, text=True, cwd=TOP, timeout=60)
    assert found in done.stdout.split()
