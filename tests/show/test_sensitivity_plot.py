"""The figure of sensitivities: its tube, and how far each parameter moves the motion."""

from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from twolink.errors import SceneError
from twolink.show.motion_plots import tube


@pytest.fixture(scope="module")
def found() -> tl.Sensitivities:
    return tl.sensitivities(tl.load_scene("arm-swing"), wrt=["forearm.mass", "q"], duration=1.0)


def test_the_tube_is_where_other_parameters_bring_the_motion(found: tl.Sensitivities) -> None:
    """One percent of the forearm's mass, against the motions of arms that have it."""
    figure = found.plot(name="forearm.mass")
    angle, *_, moves = figure.axes
    sides = [band.get_paths()[0].vertices for band in angle.collections]
    mass = found.values["forearm.mass"]
    worlds = tl.simulate_many(tl.load_scene("arm-swing"), parameters={"forearm.mass": [0.99 * mass, 1.01 * mass]},
                              duration=1.0, accuracy=1e-9, verify=False)  # fmt: skip
    assert len(sides) == 2
    for joint, side in enumerate(sides):
        ends = side[side[:, 0] == 1.0, 1]
        wide = ends.max() - ends.min()
        assert wide == pytest.approx(abs(np.ptp(worlds.q[:, joint])), rel=0.02)
        assert wide > 1e-4
    assert "forearm.mass ± 1 %" in figure.get_suptitle()
    lines = {line.get_label(): line for line in moves.get_lines() if not line.get_label().startswith("_")}
    assert set(lines) == {"forearm.mass", "q"}
    largest = 0.01 * mass * np.abs(found.q["forearm.mass"][-1]).max()
    assert lines["forearm.mass"].get_ydata()[-1] == pytest.approx(largest)


@pytest.mark.slow
def test_by_default_it_is_of_what_moves_the_motion_most(found: tl.Sensitivities, tmp_path: Path) -> None:
    moves = {name: np.abs(found.q[name]).sum(axis=2).max() for name in found.q}
    moves["forearm.mass"] *= found.values["forearm.mass"]
    most = max(moves, key=lambda name: moves[name])
    assert f"{most} ± " in found.plot(change=0.05).get_suptitle()
    assert b"<svg" in found.plot(tmp_path / "tube.svg", name="q", change=0.02).read_bytes()
    with pytest.raises(SceneError, match="forearm") as caught:
        found.plot(name="forearm.mas")
    assert caught.value.code == "unknown-sensitivity"


def test_free_bodies_have_tubes_in_each_panel() -> None:
    """A small turn about an axis moves one entry of the quaternion by half of it, and nothing else."""
    robot = tl.load_robot("spinning_box", root="free")
    turn = np.zeros((2, 6, 1))
    turn[1, 5, 0] = -0.02  # rad about z
    widths = tube(robot, np.tile(robot.neutral, (2, 1)), np.zeros((2, 6)), turn, turn)
    entries = ["x", "y", "z", "qx", "qy", "qz", "qw", "vx", "vy", "vz", "wx", "wy", "wz"]
    moved = {name: width[1] for name, width in zip(entries, widths, strict=True) if width.any()}
    assert moved == pytest.approx({"qz": 0.01, "wz": 0.02}, rel=1e-6)
    assert not np.any([width[0] for width in widths])
