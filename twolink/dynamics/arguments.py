"""Arguments: vectors by joint name, shapes, finiteness, unit quaternions and (cos, sin) pairs; broadcasting of batches;
numbers above 0; and external wrenches on named frames.
"""

import functools
import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, TypeVar

import msgspec
import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from twolink.algorithms.functions import frame_index
from twolink.errors import QueryError, TwolinkError, nearest, require_known
from twolink.robots.joint_layout import UNIT_TOLERANCE, JointLayout
from twolink.robots.model import RobotModel

Axes = Literal["frame", "world"]
AXES = ("frame", "world")
Positive = Annotated[float, msgspec.Meta(gt=0)]
Names = str | Sequence[str]


Kind = TypeVar("Kind")
_MADE_BY = {"Robot": "tl.load_robot(name or file) makes one", "Trajectory": "tl.simulate(scene) makes one",
            "Scene": "tl.load_scene(name or file), or tl.scene_of(robot or its file)"}  # fmt: skip


def instance(value: Any, kind: type[Kind], name: str, error: type[TwolinkError] = QueryError) -> Kind:
    """`value`, which is to be a Robot, a Scene or a Trajectory. Raises the error, which names the argument."""
    if not isinstance(value, kind):
        raise error(f"expected a {kind.__name__}, got {type(value).__name__}", argument=name,
                    remedy=_MADE_BY[kind.__name__])  # fmt: skip
    return value


def texts(value: Names, name: str, error: type[TwolinkError], remedy: str) -> list[str]:
    """`value`, one text or several, as a list. Raises the error, which names the argument."""
    given = [value] if isinstance(value, str) else list(value) if isinstance(value, Iterable) else [value]
    if not all(isinstance(text, str) for text in given):
        raise error(f"expected texts, got {value!r:.60}", argument=name, remedy=remedy)
    return given


def positive(
    value: Any, name: str, error: type[TwolinkError], remedy: str, *, expected: str = "a number above 0"
) -> float:
    """`value` as a finite float above 0. Raises the error, which names the argument."""
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not 0.0 < number < math.inf:
        raise error(f"expected {expected}, got {value!r:.60}", argument=name, remedy=remedy)
    return number


def whole(
    value: Any, name: str, error: type[TwolinkError], remedy: str = "such as 0", least: int = 0, most: float = math.inf
) -> int:
    """`value` as a whole number from `least` to `most`. Raises the error, which names the argument."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not least <= value <= most:
        upwards = "" if most == math.inf else f" to {most:.0e}"
        raise error(f"expected a whole number from {least}{upwards}, got {value!r:.60}", argument=name, remedy=remedy)
    return int(value)


def array(
    name: str, value: ArrayLike, size: int | None, joints: Sequence[JointLayout] = (), *, finite: bool = True
) -> np.ndarray:
    """`value` as float64 of shape (..., size), or (...) for None. Raises QueryError that names the argument.

    joints: of a configuration, for the error to name those that have several entries.
    """
    if value is None:
        raise QueryError("expected numbers, got None", argument=name, remedy="give the array")
    if "numpy.ma" in sys.modules and isinstance(value, np.ma.MaskedArray):  # np.ma imports it: 8 ms
        raise QueryError("expected an array, got one with a mask", argument=name, remedy="fill it: value.filled(...)")
    try:
        out = np.asarray(value)
    except ValueError:
        remedy = "give one number for each state" if size is None else f"give shape (..., {size})"
        what = "expected an array, got rows of different lengths"
        raise QueryError(what, argument=name, remedy=remedy) from None
    if out.dtype != np.float64:
        if out.dtype.kind not in "fiu":
            by_name = f'give robot.by_joint("{name}", {{...}})' if isinstance(value, Mapping) else "convert it to float"
            raise QueryError(f"expected real numbers, got {out.dtype}", argument=name, remedy=by_name)
        out = out.astype(np.float64)
    if size is not None and (out.ndim == 0 or out.shape[-1] != size):
        what = f"expected shape (..., {size}), got {out.shape}"
        raise QueryError(what, argument=name, remedy=_shape_remedy(out, size, joints))
    if finite and not np.isfinite(out).all():
        index = tuple(int(i) for i in np.argwhere(~np.isfinite(out))[0])
        what = f"expected finite numbers, got {out[index]}" + (f" at {list(index)}" if index else "")
        raise QueryError(what, argument=name, remedy="check where it comes from")
    return out


def by_joint(
    robot: RobotModel, letter: str, values: Mapping[str, ArrayLike], error: type[TwolinkError] = QueryError, *,
    argument: str = "", others: ArrayLike | None = None,
) -> np.ndarray:  # fmt: skip
    """A configuration (nq,) "q", or another vector (nv,), from values by joint name.

    A joint's values are those that `JointLayout.entries` takes. Joints that are not named have their entries of
    `others`; without that they are neutral, objects at their poses, and 0.

    Raises
    ------
    error
        There is no such joint (code "unknown-joint"), or the values are not the joint's.
    """
    argument = argument or letter
    if not isinstance(values, Mapping):
        raise error(f"expected values by joint, got {values!r:.60}", argument=argument, code="schema",
                    remedy='such as {"elbow": 0.5}')  # fmt: skip
    if others is None:
        state = np.array(robot.neutral if letter == "q" else np.zeros(robot.nv))
        values = dict(robot.visuals.placed if letter == "q" else {}) | dict(values)
    else:
        state = np.array(others, dtype=float)
    joints = {joint.name: joint for joint in robot.joints}
    for name, value in values.items():
        if name not in joints:
            what, remedy = f"robot {robot.name!r} has no joint {name!r}", nearest(name, joints)
            raise error(what, where=argument, remedy=remedy, code="unknown-joint", argument=argument)
        joint = joints[name]
        part = joint.q if letter == "q" else joint.v
        wrong = functools.partial(error, where=f"{argument}.{name}", remedy=joint.remedy(letter), code="schema",
                                  argument=argument)  # fmt: skip
        try:
            numbers = joint.entries(letter, value)
        except (TypeError, ValueError):
            raise wrong(f"expected numbers, got {value!r:.60}") from None
        size = part.stop - part.start
        if numbers.shape != (size,):
            raise wrong(f"expected {size} number{'s' * (size != 1)}, got {numbers.size}")
        state[part] = numbers
    return state


def one_of(choices: Sequence[str], value: str, name: str) -> str:
    """`value`, if it is one of the choices. Raises QueryError that names the argument."""
    require_known(value, choices, QueryError, argument=name)
    return value


ENTRIES = {"cos-sin": "(cos, sin)", "planar": "(x, y, cos, sin)", "quaternion": "(x, y, z, w)",
           "free-flyer": "(position, quaternion x y z w)"}  # fmt: skip


def _shape_remedy(out: np.ndarray, size: int, joints: Sequence[JointLayout]) -> str:
    if out.ndim > 1 and size in out.shape:
        return "batches are on leading axes: transpose it"
    several = [f"{ENTRIES[joint.kind]} of {joint.name!r}" for joint in joints if joint.kind in ENTRIES]
    of_them = f", with {', '.join(several[:3])}{', ...' * (len(several) > 3)}" if several else ""
    return f"the last axis holds the robot's {size} values{of_them}"


def configuration(name: str, value: ArrayLike, nq: int, joints: Sequence[JointLayout]) -> np.ndarray:
    """A configuration (..., nq) whose quaternions and (cos, sin) pairs have length 1."""
    q = array(name, value, nq, joints)
    for joint in joints:
        if joint.normalized is None:
            continue
        length = np.linalg.norm(q[..., joint.normalized], axis=-1)
        wrong = np.abs(length - 1) > UNIT_TOLERANCE
        if wrong.any():
            index = [int(i) for i in np.argwhere(wrong)[0]]
            part = "(cos, sin)" if joint.kind in ("cos-sin", "planar") else "quaternion (x, y, z, w)"
            entries, at = f"{joint.normalized.start}:{joint.normalized.stop}", f" at {index}" if index else ""
            what = f"{part} of joint {joint.name!r}, entries {entries}, expected length 1, got "
            what += f"{float(length[tuple(index)]):.12g}{at}"
            raise QueryError(what, argument=name, remedy=f"{name} = robot.normalize({name})")
    return q


def batch_shape(**arrays: np.ndarray) -> tuple[int, ...]:
    """The broadcast shape of the leading axes. Raises QueryError that names the shapes."""
    shapes_given = {a.shape[:-1] for a in arrays.values()}
    if len(shapes_given) == 1:
        return shapes_given.pop()
    try:
        return np.broadcast_shapes(*(a.shape[:-1] for a in arrays.values()))
    except ValueError:
        shapes = ", ".join(f"{name} {a.shape}" for name, a in arrays.items())
        what, remedy = f"leading axes do not broadcast: {shapes}", "give each the same leading axes, or none"
        raise QueryError(what, where="batch", remedy=remedy) from None


def rows(array: np.ndarray, batch: tuple[int, ...]) -> np.ndarray:
    """The array broadcast to the batch and flattened to C-ordered rows (n, size); no copy where it already is."""
    if array.shape[:-1] == batch and array.flags.c_contiguous:
        return array.reshape(math.prod(batch), array.shape[-1])
    wide = np.broadcast_to(array, (*batch, array.shape[-1]))
    return np.ascontiguousarray(wide).reshape(math.prod(batch), array.shape[-1])


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


def states_of(x: Any) -> int:
    """The number of states of an argument with leading axes; 0 of one without."""
    if not isinstance(x, np.ndarray):
        if not (isinstance(x, list | tuple) and x and isinstance(x[0], list | tuple | np.ndarray)):
            return 0
        try:
            x = np.asarray(x, dtype=float)
        except (TypeError, ValueError):  # no array: the check of the argument says what is wrong
            return 0
    return x.size // x.shape[-1] if x.ndim > 1 and x.size else 0


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
