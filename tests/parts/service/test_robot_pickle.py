"""Robots go between processes whole; an answer that names anything else is refused before it runs."""

import os
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import twolink as tl
from tests.parts.service.urdfs import mesh, pendulum, stl
from twolink.dynamics import Robot
from twolink.parts.service.store.archives import read_robot, write_robot


@pytest.mark.parametrize(("name", "options"), [
    ("two_link", {}), ("anymal", {"root": "free"}), ("panda", {"mimic": True}),
])  # fmt: skip
def test_a_robot_comes_back_as_it_was(name: str, options: dict[str, Any]) -> None:
    robot = tl.load_robot(name, **options)
    again = read_robot(write_robot(robot))
    assert (again.name, again.joint_names, again.report) == (robot.name, robot.joint_names, robot.report)
    q, v = robot.random_state(3, seed=1)
    np.testing.assert_array_equal(again.bias(q, v), robot.bias(q, v))


def test_a_robot_with_meshes_comes_back(tmp_path: Path) -> None:
    (tmp_path / "a.stl").write_bytes(stl())
    robot = tl.load_robot(pendulum(mesh("package://a.stl")), package_dirs=[tmp_path])
    assert read_robot(write_robot(robot)).visual_model().ngeoms == 1


class Hostile:
    """Runs a call where it is unpickled."""

    def __init__(self, *call: Any) -> None:
        self.call = call

    def __reduce__(self) -> tuple[Any, tuple[Any, ...]]:
        return self.call[0], self.call[1:]


def test_nothing_else_is_read(tmp_path: Path) -> None:
    made = tmp_path / "made"
    robot = tl.load_robot("two_link")
    for content in (
        Hostile(os.mkdir, str(made)),
        Hostile(eval, f"__import__('os').mkdir({str(made)!r})"),
        Hostile(Robot, Hostile(os.mkdir, str(made)), robot.model, robot.report, robot.visuals),
        Hostile(np.load, str(made)),
        {"a": 1},
        Robot,
    ):
        with pytest.raises(pickle.UnpicklingError):
            read_robot(pickle.dumps(content))
    assert not made.exists()
    pickle.loads(pickle.dumps(Hostile(os.mkdir, str(made))))
    assert made.exists()  # so the check above can fail
