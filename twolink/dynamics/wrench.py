"""External wrenches on named frames, and what they are to Pinocchio: one force per joint."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from twolink.algorithms.functions import frame_index
from twolink.dynamics.arguments import array, one_of
from twolink.errors import QueryError

Axes = Literal["frame", "world"]
AXES = ("frame", "world")


@dataclass(frozen=True)
class Wrench:
    """A wrench on the robot at a frame's origin: (fx, fy, fz, tx, ty, tz), N and N m, (..., 6).

    axes="frame": the components are along the frame's own axes, which turn with it (Pinocchio's LOCAL; what a bare
    array means). axes="world": along the world's axes (Pinocchio's LOCAL_WORLD_ALIGNED). The point of application
    is the frame's origin in both.
    """

    value: ArrayLike
    axes: Axes = "frame"


FExt = Mapping[str, Wrench | ArrayLike]


@dataclass(frozen=True)
class Applied:
    """A checked wrench: its frame, the joint it acts on, where its frame sits there, and its values (..., 6)."""

    frame: str
    joint: int
    placement: pin.SE3
    value: np.ndarray
    axes: Axes


def read_wrenches(model: pin.Model, f_ext: FExt) -> list[Applied]:
    """Check f_ext against the model. Raises QueryError that names the frame."""
    if not isinstance(f_ext, Mapping):
        what = f"expected a mapping of frame name to wrench, got {type(f_ext).__name__}"
        raise QueryError(what, argument="f_ext", remedy='such as {"tip": [fx, fy, fz, tx, ty, tz]}')
    applied = []
    for name, value in f_ext.items():
        frame = model.frames[frame_index(model, name, "f_ext")]
        wrench = value if isinstance(value, Wrench) else Wrench(value)
        one_of(AXES, wrench.axes, f"f_ext[{name!r}].axes")
        entries = array(f"f_ext[{name!r}]", wrench.value, 6)
        applied.append(Applied(name, frame.parentJoint, frame.placement, entries, wrench.axes))
    return applied


def joint_forces(model: pin.Model, data: pin.Data, q: np.ndarray, applied: list[Applied]) -> pin.StdVec_Force:
    """Pinocchio's f_ext for one state: per joint, in the joint's own frame, at its origin.

    A wrench w in a frame at placement X of joint j is X.act(w) at the joint; in world axes it is first turned
    into the frame's by R^T.
    """
    forces = pin.StdVec_Force()
    forces.extend([pin.Force.Zero() for _ in range(model.njoints)])
    if any(w.axes == "world" for w in applied):
        pin.forwardKinematics(model, data, q)
    for wrench in applied:
        linear, angular = wrench.value[:3], wrench.value[3:]
        if wrench.axes == "world":
            turn = (data.oMi[wrench.joint] * wrench.placement).rotation.T
            linear, angular = turn @ linear, turn @ angular
        forces[wrench.joint] += wrench.placement.act(pin.Force(linear, angular))
    return forces
