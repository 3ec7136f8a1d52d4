"""A robot as bytes between processes. Reading them runs no code but that of a robot's own parts.

A worker process may have been taken over by what it read; plain `pickle.loads` of its answer would run whatever the
answer names, outside the sandbox. (That bytes which are none of Pinocchio's harm its reader is not excluded.)
"""

import io
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from twolink.dynamics import Robot
from twolink.robots.load_report import Finding, LoadReport
from twolink.robots.meshes import MeshFile
from twolink.robots.model import Visuals
from twolink.robots.model_pickle import restore_model

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
