"""A saved trajectory loads its robot again: the same one, or none."""

import re
from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from twolink.dynamics.robot_record import robot_notes
from twolink.errors import SceneError
from twolink.io.fingerprints import model_digest
from twolink.io.tables import read_table, write_table
from twolink.robots.catalogue import our_urdfs

LOADS = {
    "plain": ("two_link", {}),
    "locked": ("two_link", {"lock": {"elbow": 0.3}}),
    "locked turn": ("kinova", {"lock": {"j2s6s200_joint_1": 0.7}}),
    "free": ("hector", {"root": "free"}),
    "gravity": ("two_link", {"gravity": (1, 2, 3)}),
}


def still(robot: tl.Robot) -> tl.Trajectory:
    t = np.array([0.0, 1.0])
    zeros = np.zeros((2, robot.nv))
    return tl.Trajectory(robot, t, np.array([robot.neutral] * 2), zeros, t, None, None)


@pytest.mark.parametrize("suffix", [".npz", ".parquet"])
@pytest.mark.parametrize("case", LOADS)
def test_the_same_robot_is_found_again(case: str, suffix: str, tmp_path: Path) -> None:
    name, options = LOADS[case]
    robot = tl.load_robot(name, **options)
    again = tl.Trajectory.load(still(robot).save(tmp_path / f"x{suffix}")).robot
    assert robot_notes(again) == robot_notes(robot)
    assert np.array_equal(again.gravity, robot.gravity)
    v = np.ones(robot.nv)
    assert np.array_equal(again.bias(again.neutral, v), robot.bias(robot.neutral, v))


def test_a_file_of_another_robot_needs_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither a path in the file nor a file that happens to lie here is opened."""
    text = tl.load_robot("two_link").visuals.text.replace('mass value="', 'mass value="1')
    (tmp_path / "mine.urdf").write_text(text)
    robot = tl.load_robot(tmp_path / "mine.urdf")
    assert robot.name == "two_link"
    path = still(robot).save(tmp_path / "x.npz")
    with pytest.raises(
        SceneError,
        match=r"'two_link' is not known by name \(it came from 'mine.urdf'\); pass the robot: robot=load_robot",
    ):
        tl.Trajectory.load(path)
    assert tl.Trajectory.load(path, robot).robot.mass == robot.mass
    with pytest.raises(SceneError, match="is not this 'two_link': joints, masses or placements differ"):
        tl.Trajectory.load(path, tl.load_robot("two_link"))
    columns, notes = read_table(path)
    monkeypatch.chdir(tmp_path)
    for name in (str(tmp_path / "mine.urdf"), "mine.urdf", "../mine", "<robot/>"):
        forged = {**notes, "robot": name, "catalogue": "true"}
        with pytest.raises(SceneError, match=r"its robot .*; pass the robot of its scene: robot="):
            tl.Trajectory.load(write_table(tmp_path / "forged.npz", columns, forged))


@pytest.mark.parametrize(("changed", "part"), [
    ({"digest": "0" * 32}, "joints, masses or placements differ"),
    ({"lock": "{"}, "are damaged"),
    ({"lock": "[" * 100_000}, "are damaged"),
    ({"lock": "[1]"}, "pass the robot"),
    ({"lock": '{"elbow": 0.2}'}, "nq = 2, 'two_link' has 1"),
    ({"gravity": "[1]"}, "are damaged"),
    ({"gravity": '{"a": 1}'}, "are damaged"),
    ({"robot": "two_lnk"}, "two_lnk"),
    ({"catalogue": "false"}, "is not known by name"),
])  # fmt: skip
def test_notes_that_do_not_fit(changed: dict[str, str], part: str, tmp_path: Path) -> None:
    run = still(tl.load_robot("two_link"))
    path = write_table(tmp_path / "x.npz", run.columns(), {**robot_notes(run.robot), **changed})
    with pytest.raises(SceneError, match=part):
        tl.Trajectory.load(path)


def test_a_given_robot_must_fit(tmp_path: Path) -> None:
    robot = tl.load_robot("two_link")
    path = still(robot).save(tmp_path / "x.npz")
    with pytest.raises(SceneError, match="nq = 2, 'two_link' has 1"):
        tl.Trajectory.load(path, tl.load_robot("two_link", lock={"elbow": 0}))
    with pytest.raises(SceneError, match="is not this 'arm'"):
        tl.Trajectory.load(path, tl.load_robot("arm"))
    heavier = still(tl.load_robot("two_link", lock={"elbow": 0.3})).save(tmp_path / "y.npz")
    with pytest.raises(SceneError, match="differ"):
        tl.Trajectory.load(heavier, tl.load_robot("two_link", lock={"elbow": 0.4}))


def test_digests_see_what_moves() -> None:
    text = (our_urdfs() / "two_link.urdf").read_text()
    base = model_digest(tl.load_robot(text).model)
    assert base == model_digest(tl.load_robot(text, gravity=(0, 0, 0)).model)
    assert base == model_digest(tl.load_robot(text.replace('<mass value="', '<mass value="0')).model)
    for old, new in (
        ('<mass value="', '<mass value="1'),
        ('xyz="1 0 0"', 'xyz="1 0 1e-6"'),
        (r'<axis xyz="[^"]*"', '<axis xyz="0.1 -1 0"'),
        ('"elbow"', '"knee"'),
    ):
        changed = re.sub(old, new, text)
        assert changed != text, old
        assert model_digest(tl.load_robot(changed).model) != base, old
