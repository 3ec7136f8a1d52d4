"""The layout of q and v: which entries belong to which joint, and which have length 1; the limits of joints."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

JointKind = Literal["vector", "cos-sin", "planar", "quaternion", "free-flyer", "mimic"]

NO_LIMIT = 1e30  # Pinocchio writes no limit as a number beyond this
_UNIT_PART = {"cos-sin": slice(0, 2), "planar": slice(2, 4), "quaternion": slice(0, 4), "free-flyer": slice(3, 7)}


@dataclass(frozen=True)
class JointLayout:
    """Joint number `index` of the model: entries q[q] and v[v], and the entries `unit` of q that have length 1.

    kind: vector (an angle or a length), cos-sin (continuous), planar (x, y, cos, sin), quaternion (x y z w),
    free-flyer (position, quaternion), mimic (no entries of its own).
    """

    name: str
    index: int
    kind: JointKind
    q: slice
    v: slice
    unit: slice | None

    def configuration(self, values: ArrayLike) -> np.ndarray:
        """Values as the entries of q, where one value of a continuous joint is its angle [rad]."""
        entries = np.atleast_1d(np.asarray(values, dtype=float))
        return np.append(np.cos(entries), np.sin(entries)) if self.kind == "cos-sin" and entries.size == 1 else entries


def _kind(joint: pin.JointModel) -> JointKind:
    if "Mimic" in joint.shortname():
        return "mimic"
    if joint.shortname() == "JointModelPlanar":
        return "planar"
    sizes: dict[tuple[int, int], JointKind] = {(2, 1): "cos-sin", (4, 3): "quaternion", (7, 6): "free-flyer"}
    return sizes.get((joint.nq, joint.nv), "vector")


def turns(model: pin.Model, joint: JointLayout) -> bool:
    """Whether the coordinate of a joint with one coordinate is an angle [rad], not a length [m]."""
    return str(model.joints[joint.index].shortname()).startswith("JointModelR")


def urdf_limits(model: pin.Model, entry: int) -> tuple[float, float]:
    """The limits (lower, upper) of q[entry] in the URDF; infinite where there is none."""
    ends = (float(limits[entry]) for limits in (model.lowerPositionLimit, model.upperPositionLimit))
    lower, upper = (end if abs(end) < NO_LIMIT else math.copysign(math.inf, end) for end in ends)
    return (lower, upper) if lower < upper else (-math.inf, math.inf)


def joint_layouts(model: pin.Model) -> tuple[JointLayout, ...]:
    """The layout of every joint of a model but the universe."""
    layouts = []
    for index in range(1, model.njoints):
        kind = _kind(model.joints[index])
        start, part = model.idx_qs[index], _UNIT_PART.get(kind)
        unit = None if part is None else slice(start + part.start, start + part.stop)
        velocity = slice(model.idx_vs[index], model.idx_vs[index] + model.nvs[index])
        configuration = slice(start, start + model.nqs[index])
        layouts.append(JointLayout(model.names[index], index, kind, configuration, velocity, unit))
    return tuple(layouts)
