"""Logs whose angles have units: continuous joints, and matrices of other programs."""

from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.urdf_text import joint, link, robot_of
from twolink.errors import QueryError
from twolink.identification import identify, read_log

RANDOM = np.random.default_rng(0)
CONTINUOUS = robot_of(link("upper"), joint("first", "continuous", "ground", "upper"),
                      link("lower"), joint("second", "revolute", "upper", "lower", axis="0 1 0"),
                      link("tool"), joint("third", "continuous", "lower", "tool", axis="1 0 0"))  # fmt: skip


@pytest.mark.parametrize("letter_names", [("qpos", "qvel"), ("joint_pos", "joint_vel")])
@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_angles_of_continuous_joints_have_the_unit_of_the_log(
    letter_names: tuple[str, str], unit: str, tmp_path: Path
) -> None:
    """The cosine was taken of degrees; three columns of joint_pos were taken as the five of q."""
    robot, size = tl.load_robot(CONTINUOUS), {"rad": 1.0, "deg": 180 / np.pi}[unit]
    angles = RANDOM.uniform(-3.0, 3.0, (9, 3))
    given = dict(zip(letter_names, (size * angles, size * angles[::-1]), strict=True))
    np.savez(tmp_path / "log.npz", t=np.arange(9) * 0.1, joint_torque=angles, **given)
    read = read_log(robot, tmp_path / "log.npz", units=[unit]).table
    first, second, third = angles.T
    wanted = np.column_stack([np.cos(first), np.sin(first), second, np.cos(third), np.sin(third)])
    np.testing.assert_allclose(read["q"], wanted, rtol=0, atol=1e-13)
    np.testing.assert_allclose(read["v"], angles[::-1], rtol=0, atol=1e-13)
    np.testing.assert_array_equal(read["tau"], angles)


def test_a_matrix_of_another_width_is_refused_in_words(tmp_path: Path) -> None:
    np.savez(tmp_path / "log.npz", t=np.arange(9) * 0.1, tau=np.ones((9, 2)), joint_pos=np.ones((9, 4)))
    robot = tl.load_robot("two_link")
    with pytest.raises(QueryError, match="2"):
        identify(robot, [read_log(robot, tmp_path / "log.npz", units=["deg"]).table])
