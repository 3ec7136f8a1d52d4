"""Options of loading a robot: its gravity field, and joints that are locked."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from twolink.errors import RobotError, TwolinkError, require_known
from twolink.robots.joint_layout import joint_layouts

Lock = Mapping[str, float | Sequence[float]]
UNIT_TOLERANCE = 1e-8
_LINK = "link\0"  # no name in XML holds a NUL


def _numbers(value: Any) -> np.ndarray:
    """A value as an array of one axis or more; an empty one when it holds no numbers."""
    try:
        return np.atleast_1d(np.asarray(value, dtype=float))
    except (TypeError, ValueError, OverflowError):
        return np.empty(0)


def gravity_field(value: Any, error: type[TwolinkError]) -> np.ndarray:
    """A gravity field as an array (3,) [m/s^2]. Raises the error unless it has 3 finite numbers."""
    field = _numbers(value)
    if field.shape != (3,) or not np.isfinite(field).all():
        remedy = "give m/s^2 in the world's axes, such as (0, 0, -9.81)"
        raise error(f"expected 3 finite numbers, got {value!r}", argument="gravity", remedy=remedy)
    return field


def lock_configuration(model: pin.Model, lock: Lock) -> tuple[tuple[int, ...], np.ndarray]:
    """The indices of the joints to lock, and a configuration (nq,) that holds their values.

    Parameters
    ----------
    model : pin.Model
        The model with all joints.
    lock : mapping
        The configuration of each joint to lock, by name [rad, m]; of a continuous joint, an angle or (cos, sin).

    Raises
    ------
    RobotError
        A joint does not exist, or its value is no configuration of it.
    """
    if not isinstance(lock, Mapping):
        what = f"expected joints with their configurations, got {lock!r}"
        raise RobotError(what, argument="lock", remedy="such as {'elbow': 0.5}")
    reference = np.asarray(pin.neutral(model))
    layouts = {joint.name: joint for joint in joint_layouts(model)}
    for name, value in lock.items():
        what = "there is no moving joint {!r} to lock"
        require_known(name, layouts, RobotError, what, argument="lock", code="unknown-joint")
        joint = layouts[name]
        size = joint.q.stop - joint.q.start
        values = joint.configuration(_numbers(value))
        if values.shape != (size,) or not np.isfinite(values).all():
            what = f"expected {size} finite number{'s' if size > 1 else ''}, got {value!r}"
            raise RobotError(what, where=f"lock[{name!r}]", argument="lock", remedy="give its configuration")
        reference[joint.q] = values
        length = 1.0 if joint.unit is None else float(np.linalg.norm(reference[joint.unit]))
        if not abs(length - 1) <= UNIT_TOLERANCE:
            what = f"quaternion or (cos, sin), expected length 1, got {length:.12g}"
            raise RobotError(what, where=f"lock[{name!r}]", argument="lock", remedy="divide it by its length")
    return tuple(sorted(layouts[name].index for name in lock)), reference


def beyond_limits(model: pin.Model, locked: Sequence[int], reference: np.ndarray) -> list[str]:
    """The names of the locked joints whose configuration is not within their limits."""
    starts = {index: model.idx_qs[index] for index in locked if model.nqs[index] == 1}
    lower, upper = model.lowerPositionLimit, model.upperPositionLimit
    return [model.names[index] for index, k in starts.items() if not lower[k] <= reference[k] <= upper[k]]


def without_joints(model: pin.Model, locked: Sequence[int], reference: np.ndarray) -> pin.Model:
    """A copy of the model where the locked joints are fixed."""
    if not locked:
        return model.copy()
    try:
        reduced = pin.buildReducedModel(_with_marked_links(model), list(locked), reference)
    except Exception as error:
        what = f"Pinocchio cannot lock these joints: {' '.join(str(error).split())}"
        raise RobotError(what, argument="lock", remedy="load it without lock=", code="pinocchio") from None
    for frame in _links(reduced):
        frame.name = frame.name.removeprefix(_LINK)
    return reduced


def shapes_without_joints(
    model: pin.Model, shapes: pin.GeometryModel, locked: Sequence[int], reference: np.ndarray
) -> pin.GeometryModel:
    """The shapes of a model, for the model of `without_joints`."""
    if not locked:
        return shapes
    return pin.buildReducedModel(_with_marked_links(model), shapes, list(locked), reference)[1]


def _with_marked_links(model: pin.Model) -> pin.Model:
    """A copy in which no link has a joint's name: buildReducedModel finds the joints' frames by their names alone."""
    marked = model.copy()
    for frame in _links(marked):
        frame.name = _LINK + frame.name
    return marked


def _links(model: pin.Model) -> list[pin.Frame]:
    return [frame for frame in model.frames if frame.type == pin.FrameType.BODY]
