"""The functions that can be compiled: what they take, what they return, and how the recursions give it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import pinocchio as pin

from twolink.algorithms import recursions
from twolink.algorithms.articulated_body import forward_dynamics_aba
from twolink.algorithms.mechanism import Mechanism
from twolink.algorithms.spatial import Pose, Scalar, force_to_parent, plus
from twolink.errors import QueryError, nearest

Trace = Callable[[Mechanism, dict[str, Any], Any], list[Scalar]]


@dataclass(frozen=True)
class Function:
    """A function of states: its name, its arguments with their sizes, its result's shape, and its formula.

    `formula(mechanism, arguments, xp)` gives the result's entries, flat in C order. `variants` are formulas of the
    same result, of which the one with the fewest operations is compiled.
    """

    name: str
    arguments: tuple[tuple[str, int], ...]
    shape: tuple[int, ...]
    variants: tuple[Trace, ...]


@dataclass(frozen=True)
class FrameForce:
    """A run-time wrench on a frame, along the frame's own axes: the argument's name, the joint, the frame's place."""

    argument: str
    joint: int
    placement: Pose


def function(model: pin.Model, name: str, forces: Sequence[FrameForce] = ()) -> Function:
    """The function of this name for a model; of a frame as in "frame_position:tip".

    Raises QueryError for an unknown name or frame.
    """
    kind, _, frame = name.partition(":")
    if kind in _OF_FRAMES:
        return _OF_FRAMES[kind](model, name, frame)
    makers = {**_OF_STATES, **_DERIVATIVES}
    if kind not in makers or frame:
        known = [*makers, *(f"{k}:FRAME" for k in _OF_FRAMES)]
        raise QueryError(f"{name!r} cannot be compiled", where="function", remedy=nearest(name, known))
    made = makers[kind](model)
    if not forces:
        return made
    arguments = (*made.arguments, *((force.argument, 6) for force in forces))
    return replace(made, arguments=arguments, variants=tuple(_pushed(v, forces) for v in made.variants))


def _pushed(trace: Trace, forces: Sequence[FrameForce]) -> Trace:
    """The formula with f_ext taken from the arguments: wrenches moved from their frames to the joints."""

    def with_forces(mech: Mechanism, arguments: dict[str, Any], xp: Any) -> list[Scalar]:
        at_joints: dict[int, list[Scalar]] = {}
        for force in forces:
            x = arguments[force.argument]
            moved = force_to_parent(force.placement, ((x[0], x[1], x[2]), (x[3], x[4], x[5])))
            entries = [*moved[0], *moved[1]]
            before = at_joints.get(force.joint, [0.0] * 6)
            at_joints[force.joint] = [plus(a, b) for a, b in zip(before, entries, strict=True)]
        return trace(mech, {**arguments, "f_ext": at_joints}, xp)

    return with_forces


def _forward(model: pin.Model) -> Function:
    def by_matrix(m: Mechanism, x: dict[str, Any], xp: Any) -> list[Scalar]:
        return recursions.forward_dynamics_crba(m, x["q"], x["v"], x["tau"], x.get("f_ext"), xp)

    def by_bodies(m: Mechanism, x: dict[str, Any], xp: Any) -> list[Scalar]:
        return forward_dynamics_aba(m, x["q"], x["v"], x["tau"], x.get("f_ext"), xp)

    mimic = any("Mimic" in j.shortname() for j in model.joints)
    arguments = (("q", model.nq), ("v", model.nv), ("tau", model.nv))
    return Function("forward_dynamics", arguments, (model.nv,), (by_matrix,) if mimic else (by_matrix, by_bodies))


def _inverse(model: pin.Model) -> Function:
    def trace(m: Mechanism, x: dict[str, Any], xp: Any) -> list[Scalar]:
        return recursions.rnea(m, x["q"], x["v"], x["a"], x.get("f_ext"), xp)

    arguments = (("q", model.nq), ("v", model.nv), ("a", model.nv))
    return Function("inverse_dynamics", arguments, (model.nv,), (trace,))


def _bias(model: pin.Model) -> Function:
    def trace(m: Mechanism, x: dict[str, Any], xp: Any) -> list[Scalar]:
        return recursions.bias(m, x["q"], x["v"], None, xp)

    return Function("bias", (("q", model.nq), ("v", model.nv)), (model.nv,), (trace,))


def _gravity(model: pin.Model) -> Function:
    def trace(m: Mechanism, x: dict[str, Any], xp: Any) -> list[Scalar]:
        return recursions.gravity_torque(m, x["q"], xp)

    return Function("gravity_torque", (("q", model.nq),), (model.nv,), (trace,))


def _mass_matrix(model: pin.Model) -> Function:
    def trace(m: Mechanism, x: dict[str, Any], xp: Any) -> list[Scalar]:
        return [entry for row in recursions.crba(m, x["q"], xp) for entry in row]

    return Function("mass_matrix", (("q", model.nq),), (model.nv, model.nv), (trace,))


def _energy(model: pin.Model) -> Function:
    def trace(m: Mechanism, x: dict[str, Any], xp: Any) -> list[Scalar]:
        return list(recursions.energy(m, x["q"], x["v"], xp))

    return Function("energy", (("q", model.nq), ("v", model.nv)), (2,), (trace,))


def _inverse_derivatives(model: pin.Model) -> Function:
    from twolink.algorithms import derivatives

    def trace(m: Mechanism, x: dict[str, Any], xp: Any) -> list[Scalar]:
        return _flat(derivatives.inverse_dynamics_derivatives(m, x["q"], x["v"], x["a"], xp))

    arguments = (("q", model.nq), ("v", model.nv), ("a", model.nv))
    return Function("inverse_dynamics_derivatives", arguments, (3, model.nv, model.nv), (trace,))


def _forward_derivatives(model: pin.Model) -> Function:
    from twolink.algorithms import derivatives

    def trace(m: Mechanism, x: dict[str, Any], xp: Any) -> list[Scalar]:
        return _flat(derivatives.forward_dynamics_derivatives(m, x["q"], x["v"], x["tau"], xp))

    arguments = (("q", model.nq), ("v", model.nv), ("tau", model.nv))
    return Function("forward_dynamics_derivatives", arguments, (3, model.nv, model.nv), (trace,))


def _flat(matrices: Any) -> list[Scalar]:
    return [entry for matrix in matrices for row in matrix for entry in row]


def frame_pose(model: pin.Model, frame: str) -> tuple[int, Pose]:
    """The joint that carries a link's frame, and where the frame sits there. Raises QueryError for an unknown frame."""
    names = [f.name for f in model.frames if f.type == pin.FrameType.BODY]
    if frame not in names:
        raise QueryError(f"there is no frame {frame!r}", where="frame", remedy=nearest(frame, names))
    found = model.frames[model.getFrameId(frame, pin.FrameType.BODY)]
    x, y, z = (tuple(row) for row in found.placement.rotation.tolist())
    return found.parentJoint, Pose(((x, y, z),), tuple(found.placement.translation.tolist()))


def _position(model: pin.Model, name: str, frame: str) -> Function:
    joint, placement = frame_pose(model, frame)

    def trace(m: Mechanism, x: dict[str, Any], xp: Any) -> list[Scalar]:
        return list(recursions.frame_placement(m, x["q"], joint, placement, xp)[1])

    return Function(name, (("q", model.nq),), (3,), (trace,))


def _rotation(model: pin.Model, name: str, frame: str) -> Function:
    joint, placement = frame_pose(model, frame)

    def trace(m: Mechanism, x: dict[str, Any], xp: Any) -> list[Scalar]:
        return [e for row in recursions.frame_placement(m, x["q"], joint, placement, xp)[0] for e in row]

    return Function(name, (("q", model.nq),), (3, 3), (trace,))


def _jacobian(axes: str) -> Callable[[pin.Model, str, str], Function]:
    def make(model: pin.Model, name: str, frame: str) -> Function:
        joint, placement = frame_pose(model, frame)

        def trace(m: Mechanism, x: dict[str, Any], xp: Any) -> list[Scalar]:
            rows = recursions.frame_jacobian(m, x["q"], joint, placement, axes=axes, xp=xp)  # type: ignore[arg-type]
            return [entry for row in rows for entry in row]

        return Function(name, (("q", model.nq),), (6, model.nv), (trace,))

    return make


_OF_STATES: dict[str, Callable[[pin.Model], Function]] = {
    "forward_dynamics": _forward,
    "inverse_dynamics": _inverse,
    "bias": _bias,
    "gravity_torque": _gravity,
    "mass_matrix": _mass_matrix,
    "energy": _energy,
}
_DERIVATIVES: dict[str, Callable[[pin.Model], Function]] = {
    "forward_dynamics_derivatives": _forward_derivatives,
    "inverse_dynamics_derivatives": _inverse_derivatives,
}
_OF_FRAMES: dict[str, Callable[[pin.Model, str, str], Function]] = {
    "frame_position": _position,
    "frame_rotation": _rotation,
    "frame_jacobian": _jacobian("local"),
    "frame_jacobian_world": _jacobian("aligned"),
}
