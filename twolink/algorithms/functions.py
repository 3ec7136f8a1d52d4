"""The functions that can be compiled: what they take, what they return, their formulas, and Pinocchio's reference."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import pinocchio as pin

from twolink.algorithms import recursions, references
from twolink.algorithms.derivatives import forward_dynamics_derivatives, inverse_dynamics_derivatives
from twolink.algorithms.mechanism import Mechanism
from twolink.algorithms.recursions import forward_dynamics_aba, forward_dynamics_crba, frame_jacobian
from twolink.algorithms.references import Reference
from twolink.algorithms.spatial import Pose, Scalar, force_to_parent, plus
from twolink.errors import QueryError, nearest, shown

Algorithm = Callable[..., Any]  # of a mechanism and arguments in their order, perhaps f_ext, and xp
Formula = Callable[[Mechanism, dict[str, Any], Any], list[Scalar]]
Shape = tuple[int | Literal["nv"], ...]
DEEP = 40.0  # ancestors squared, by degree of freedom: above, articulated bodies had fewer operations in all robots


@dataclass(frozen=True)
class Function:
    """A function of states: its name, its arguments with their sizes, its result's shape, and its formulas.

    A formula gives the result's entries, flat in C order, from (mechanism, arguments by name, namespace). `variants`
    are formulas of the same result, of which the one with the fewest operations is compiled. `reference` is
    Pinocchio's answer for one state, with the scale of its rounding errors.
    """

    name: str
    arguments: tuple[tuple[str, int], ...]
    shape: tuple[int, ...]
    variants: tuple[Formula, ...]
    reference: Reference

    def candidates(self, mech: Mechanism) -> range:
        """The places of the variants that may have the fewest operations: in deep trees the last one alone."""
        return range(len(self.variants) - 1 if _mean_square_depth(mech) > DEEP else 0, len(self.variants))


@dataclass(frozen=True)
class FrameForce:
    """A run-time wrench on a frame, along the frame's own axes: the argument's name, the joint, the frame's place."""

    argument: str
    joint: int
    placement: Pose


def function(model: pin.Model, name: str, forces: Sequence[FrameForce] = ()) -> Function:
    """The function of this name for a model; of a frame as in "frame_pose:tip".

    Raises QueryError for an unknown name or frame.
    """
    kind, _, frame = name.partition(":")
    if kind in _OF_FRAMES:
        shape, algorithm, reference = _OF_FRAMES[kind]
        joint, placement = frame_pose(model, frame)
        arguments: tuple[str, ...] = ("q",)
        algorithms: tuple[Algorithm, ...] = (partial(algorithm, body=joint, placement=placement),)
        reference = partial(reference, frame_index(model, frame))
    elif kind in _OF_STATES and not frame:
        arguments, shape, algorithms, reference = _OF_STATES[kind]
    else:
        names = [*_OF_STATES, *(f"{k}:FRAME" for k in _OF_FRAMES)]
        raise QueryError(f"{name!r} cannot be compiled", argument="function", remedy=nearest(name, names))
    if kind == "forward_dynamics" and any("Mimic" in j.shortname() for j in model.joints):
        algorithms = algorithms[:1]  # articulated bodies cannot follow mimic joints
    sizes = [(x, model.nq if x == "q" else model.nv) for x in arguments]
    sizes += [(force.argument, 6) for force in forces]
    variants = tuple(partial(_entries, algorithm, arguments, forces) for algorithm in algorithms)
    return Function(name, tuple(sizes), tuple(model.nv if n == "nv" else n for n in shape), variants, reference)


def frame_names(model: pin.Model) -> tuple[str, ...]:
    """The frames by name: one at the origin of each link."""
    return tuple(f.name for f in model.frames if f.type == pin.FrameType.BODY)


def frame_index(model: pin.Model, frame: str, argument: str = "frame") -> int:
    """Pinocchio's number of a link's frame. Raises QueryError for an unknown frame."""
    if not isinstance(frame, str) or not model.existFrame(frame, pin.FrameType.BODY):
        remedy = nearest(str(frame), frame_names(model))
        what = f"there is no frame {shown(frame)}"
        raise QueryError(what, argument=argument, remedy=remedy, code="unknown-frame")
    return int(model.getFrameId(frame, pin.FrameType.BODY))


def frame_pose(model: pin.Model, frame: str) -> tuple[int, Pose]:
    """The joint that carries a link's frame, and where the frame sits there. Raises QueryError for an unknown frame."""
    entry = model.frames[frame_index(model, frame)]
    x, y, z = (tuple(row) for row in entry.placement.rotation.tolist())
    return entry.parentJoint, Pose(((x, y, z),), tuple(entry.placement.translation.tolist()))


def _entries(
    algorithm: Algorithm, names: Sequence[str], forces: Sequence[FrameForce], m: Mechanism, x: dict[str, Any], xp: Any
) -> list[Scalar]:
    """The algorithm's result, flat. The wrenches among the arguments are moved from their frames to the joints."""
    at_joints: dict[int, Sequence[Scalar]] = dict(x.get("f_ext") or {})
    for force in forces:
        w = x[force.argument]
        moved = force_to_parent(force.placement, ((w[0], w[1], w[2]), (w[3], w[4], w[5])))
        before = at_joints.get(force.joint, [0.0] * 6)
        at_joints[force.joint] = [plus(a, b) for a, b in zip(before, [*moved[0], *moved[1]], strict=True)]
    options = {"f_ext": at_joints} if at_joints else {}
    return _flat(algorithm(m, *(x[name] for name in names), **options, xp=xp))


def _mean_square_depth(mech: Mechanism) -> float:
    """The number of degrees of freedom that carry each one, squared, on the average."""
    depth: list[int] = []
    for parent in mech.dof_parents():
        depth.append(depth[parent] + 1 if parent >= 0 else 0)
    return sum(d * d for d in depth) / max(1, len(depth))


def _flat(result: Any) -> list[Scalar]:
    """The scalars of nested lists and tuples, in C order."""
    return [x for part in result for x in _flat(part)] if isinstance(result, (list, tuple)) else [result]


_FORWARD, _INVERSE = ("q", "v", "tau"), ("q", "v", "a")
_MATRICES: Shape = (3, "nv", "nv")
# Arguments, shape of the result, algorithms, reference.
_OF_STATES: dict[str, tuple[tuple[str, ...], Shape, tuple[Algorithm, ...], Reference]] = {
    "forward_dynamics": (_FORWARD, ("nv",), (forward_dynamics_crba, forward_dynamics_aba), references.forward_dynamics),
    "inverse_dynamics": (_INVERSE, ("nv",), (recursions.rnea,), references.inverse_dynamics),
    "bias": (("q", "v"), ("nv",), (recursions.bias,), references.bias),
    "gravity_torque": (("q",), ("nv",), (recursions.gravity_torque,), references.gravity_torque),
    "mass_matrix": (("q",), ("nv", "nv"), (recursions.crba,), references.mass_matrix),
    "energy": (("q", "v"), (2,), (recursions.energy,), references.energy),
    "forward_dynamics_derivatives":
        (_FORWARD, _MATRICES, (forward_dynamics_derivatives,), references.forward_derivatives),
    "inverse_dynamics_derivatives":
        (_INVERSE, _MATRICES, (inverse_dynamics_derivatives,), references.inverse_derivatives),
}  # fmt: skip
# Shape, algorithm that takes body and placement by keyword, reference of (frame index, state).
_OF_FRAMES: dict[str, tuple[Shape, Algorithm, Callable[..., Any]]] = {
    "frame_pose": ((12,), recursions.frame_placement, references.frame_pose),
    "frame_jacobian_local": ((6, "nv"),
        partial(frame_jacobian, axes="local"), partial(references.frame_jacobian, pin.LOCAL)),
    "frame_jacobian_aligned": ((6, "nv"),
        partial(frame_jacobian, axes="aligned"), partial(references.frame_jacobian, pin.LOCAL_WORLD_ALIGNED)),
}  # fmt: skip
