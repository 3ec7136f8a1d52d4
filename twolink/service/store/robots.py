"""Loaded robots: kept within a limit of bytes, and as bytes between processes.

Reading them runs no code but that of a robot's own parts. A worker process may have been taken over by what it read;
plain `pickle.loads` of its answer would run whatever the answer names, outside the sandbox. (That bytes which are none
of Pinocchio's harm its reader is not excluded.)
"""

import io
import pickle
from collections import OrderedDict
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from twolink.dynamics import Robot
from twolink.robots.load_report import Finding, LoadReport
from twolink.robots.meshes import MeshFile
from twolink.robots.model import Visuals, restore_model

_PARTS = (Robot, pin.Model, LoadReport, Finding, Visuals, MeshFile, type(Path()), np.ndarray, np.dtype)
_NAMES = {
    **{(part.__module__, part.__qualname__): part for part in _PARTS},
    (restore_model.__module__, restore_model.__name__): restore_model,
    ("numpy._core.multiarray", "_reconstruct"): np.zeros(0).__reduce__()[0],
}


def write_robot(robot: Robot) -> bytes:
    """The robot, for `read_robot`."""
    return pickle.dumps(robot)


def read_robot(content: bytes) -> Robot:
    """The robot that `write_robot` has written.

    Raises
    ------
    pickle.UnpicklingError
        The content names something that is no part of a robot.
    """
    robot = _Unpickler(io.BytesIO(content)).load()
    if not isinstance(robot, Robot):
        raise pickle.UnpicklingError(f"expected a robot, got a {type(robot).__name__}")
    return robot


class _Unpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        if (module, name) not in _NAMES:
            raise pickle.UnpicklingError(f"{module}.{name} is no part of a robot")
        return _NAMES[module, name]


class RobotCache:
    """Robots by key. One that is dropped lives on for those who use it."""

    def __init__(self, megabytes: float) -> None:
        self._limit, self._bytes = megabytes * 2**20, 0
        self._robots: OrderedDict[str, Robot] = OrderedDict()

    def get(self, key: str) -> Robot | None:
        """The robot of this key if it is there."""
        robot = self._robots.get(key)
        if robot is not None:
            self._robots.move_to_end(key)
        return robot

    def put(self, key: str, robot: Robot) -> Robot:
        """Keep a robot, the newest even where it alone is above the limit."""
        self.drop(key)
        self._robots[key] = robot
        self._bytes += memory_of(robot)
        while self._bytes > self._limit and len(self._robots) > 1:
            self.drop(next(iter(self._robots)))
        return robot

    def drop(self, key: str) -> None:
        """Forget a robot, if it is there."""
        robot = self._robots.pop(key, None)
        if robot is not None:
            self._bytes -= memory_of(robot)


def memory_of(robot: Robot) -> int:
    """Bytes of a robot that answers queries, about: nearly all is Pinocchio's data, four tensors of nv^3 numbers.

    Measured: chains of 5, 20, 40 and 100 joints have data of 0.07, 0.5, 2.2 and 22 to 33 MB.
    """
    return 2 * len(robot.visuals.text) + 2**17 + 32 * robot.nv**3
