"""Certification: a compiled function is compared with Pinocchio on hard states before its first use."""

from __future__ import annotations

import platform
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.metadata import version

import numpy as np
import pinocchio as pin

from twolink.algorithms.functions import Function
from twolink.algorithms.mechanism import nominal
from twolink.dynamics.kernels import Kernel
from twolink.errors import CertificationError

BOUND = 1e-11  # of the scale given with each reference, which takes in the mass matrix's condition
STATES = 96


@dataclass(frozen=True)
class Certificate:
    """What was compared, and how it came out: `worst` is the largest error over its scale, below `bound`."""

    function: str
    states: int
    worst: float
    bound: float
    operations: int
    versions: str
    machine: str

    def __str__(self) -> str:
        return (
            f"{self.function}: {self.states} states against Pinocchio, worst error {self.worst:.1e} of its scale "
            f"(bound {self.bound:.0e}), {self.operations} operations; {self.versions}; {self.machine}"
        )


def certify(
    model: pin.Model, function: Function, kernel: Kernel, parameters: tuple[str, ...] = (), count: int = STATES
) -> Certificate:
    """Compare the kernel with Pinocchio; raises CertificationError with the worst state when they disagree.

    The states: generic ones; straight ones, where mass matrices are worst conditioned; very fast ones; and angles of
    many turns. Parameters are drawn between half and twice their nominal values, a new model for each state.
    """
    rng = np.random.default_rng(2008)
    arguments = _arguments(model, function, rng, count)
    values = {name: nominal(model, name) * rng.uniform(0.5, 2, count) for name in parameters}
    columns = [*arguments.values(), *(v[:, None] for v in values.values())]
    found = kernel(columns)
    if found is None:
        raise CertificationError(
            "the compiled function gives a number that is not finite",
            where=function.name,
            remedy="it is not used; Pinocchio answers instead",
        )
    worst = 0.0
    for i in range(count):
        at = with_values(model, {name: v[i] for name, v in values.items()}) if values else model
        state = {name: v[i] for name, v in arguments.items()}
        expected, scale = reference(at, function.name, state, values)
        error = float(np.abs(found[i] - expected).max(initial=0.0) / scale)
        if not error <= BOUND:
            shown = ", ".join(f"{name} = {np.array2string(x, precision=17)}" for name, x in state.items())
            raise CertificationError(
                f"the compiled function differs from Pinocchio by {error:.1e} of its scale, the bound is {BOUND:.0e}",
                where=f"{function.name} at {shown}",
                remedy="it is not used; Pinocchio answers instead",
            )
        worst = max(worst, error)
    versions = ", ".join(f"{name} {version(name)}" for name in ("heyoka", "pin", "numpy"))
    operations = sum(kernel.operations.values())
    return Certificate(function.name, count, worst, BOUND, operations, versions, platform.machine())


def _arguments(model: pin.Model, function: Function, rng: np.random.Generator, count: int) -> dict[str, np.ndarray]:
    neutral = pin.neutral(model)
    reach = np.repeat([np.pi, 1e-9, np.pi, 300.0], -(-count // 4))[:count]
    speed = np.repeat([3.0, 1.0, 1e3, 3.0], -(-count // 4))[:count]
    steps = rng.uniform(-1, 1, (count, model.nv)) * reach[:, None]
    q = np.array([pin.normalize(model, pin.integrate(model, neutral, step)) for step in steps])
    out = {}
    for name, size in function.arguments:
        out[name] = q if name == "q" else rng.uniform(-1, 1, (count, size)) * (speed[:, None] if name == "v" else 20.0)
    return out


def with_values(model: pin.Model, values: Mapping[str, float]) -> pin.Model:
    """A copy of the model with physical constants replaced (names: `mechanism.parameter_names`)."""
    out = model.copy()
    links = {f.name: f.parentJoint for f in reversed(list(model.frames)) if f.type == pin.FrameType.BODY}
    gravity = np.array(out.gravity.linear)
    for name, value in values.items():
        owner, part = _split(name)
        axis = "xyz".find(part[-1])
        if owner == "gravity":
            gravity[axis] = value
        elif part in ("armature", "damping"):
            getattr(out, part)[out.idx_vs[out.getJointId(owner)]] = value
        elif part.startswith("origin"):
            joint = out.getJointId(owner)
            origin = np.array(out.jointPlacements[joint].translation)
            origin[axis] = value
            out.jointPlacements[joint] = pin.SE3(out.jointPlacements[joint].rotation, origin)
        else:
            joint = links[owner]
            out.inertias[joint] = _changed(out.inertias[joint], part, value)
    out.gravity.linear = gravity
    return out


def _split(name: str) -> tuple[str, str]:
    """ "forearm.com.x" -> ("forearm", "com.x"); "gravity.x" -> ("gravity", "x"); "a.b.mass" -> ("a.b", "mass")."""
    head, _, last = name.rpartition(".")
    if last in ("mass", "armature", "damping") or head == "gravity":
        return head, last
    owner, _, middle = head.rpartition(".")
    return owner, f"{middle}.{last}"


def _changed(body: pin.Inertia, part: str, value: float) -> pin.Inertia:
    mass, com, rotational = body.mass, np.array(body.lever), np.array(body.inertia)
    if part == "mass":
        mass = value
    elif part.startswith("com"):
        com["xyz".find(part[-1])] = value
    else:
        i, j = ("xyz".find(c) for c in part[-2:])
        rotational[i, j] = rotational[j, i] = value
    return pin.Inertia(float(mass), com, rotational)


def reference(
    model: pin.Model, name: str, state: Mapping[str, np.ndarray], values: Mapping[str, np.ndarray]
) -> tuple[np.ndarray, float]:
    """Pinocchio's answer for one state, and the scale its rounding errors are measured by.

    The scale is the size of the terms that are added, not of their sum, which may cancel; where the mass matrix is
    solved with, it is carried through the inverse: this is where the condition enters.
    """
    q = state["q"]
    inertia = pin.crba(model, model.createData(), q)
    kind, _, frame = name.partition(":")
    if kind in _OF_FRAMES:
        return _OF_FRAMES[kind](model, q, frame)
    if kind == "mass_matrix":
        return inertia, float(np.abs(inertia).max())
    v = state.get("v", np.zeros(model.nv))
    damping = _damping(model, values) * v
    weight = pin.computeGeneralizedGravity(model, model.createData(), q)
    bias = pin.nonLinearEffects(model, model.createData(), q, v) + damping
    terms = np.abs(bias) + np.abs(bias - weight) + _weight(model, q)
    if kind == "bias":
        return bias, float(terms.max())
    if kind == "gravity_torque":
        return weight, float(terms.max())
    if kind == "energy":
        both = _energies(model, q, v, inertia)
        return both, float(np.abs(both).max()) + _weight(model, q)
    force = _forces(model, q, state)
    terms += np.abs(force)
    if kind.startswith("inverse"):
        a = state["a"]
        terms += np.abs(inertia) @ np.abs(a)
        if kind == "inverse_dynamics":
            return pin.rnea(model, model.createData(), q, v, a) - force + damping, float(terms.max())
        expected = _rnea_derivatives(model, q, v, a, _damping(model, values))
        return expected, float(np.abs(expected).max() + terms.max())
    inverse = np.linalg.inv(inertia)
    a = inverse @ (state["tau"] + force - bias)
    terms += np.abs(state["tau"]) + np.abs(inertia) @ np.abs(a)
    scale = float((np.abs(inverse) @ terms).max())
    if kind == "forward_dynamics":
        mimic = any("Mimic" in j.shortname() for j in model.joints)
        tau = state["tau"] + force - damping
        return (a if mimic else pin.aba(model, model.createData(), q, v, tau)), scale
    tangent = _rnea_derivatives(model, q, v, a, _damping(model, values))
    expected = np.stack([-inverse @ tangent[0], -inverse @ tangent[1], inverse])
    carried = np.abs(inverse) @ (
        np.abs(tangent[0]) + np.abs(tangent[1]) + np.abs(inertia) @ np.abs(expected).max(axis=0)
    )
    return expected, float(carried.max() + np.abs(expected).max()) + scale


def _weight(model: pin.Model, q: np.ndarray) -> float:
    """The largest torque that weight can have on a joint, or energy: gravity's terms may cancel to much less."""
    mass = float(sum(b.mass for b in model.inertias))
    return mass * float(np.linalg.norm(model.gravity.linear)) * _reach(model, q)


def _damping(model: pin.Model, values: Mapping[str, np.ndarray]) -> np.ndarray:
    """Damping of the joints whose damping is a parameter; the others have none."""
    out = np.zeros(model.nv)
    for name in values:
        if name.endswith(".damping"):
            k = model.idx_vs[model.getJointId(name.removesuffix(".damping"))]
            out[k] = model.damping[k]
    return out


def _forces(model: pin.Model, q: np.ndarray, state: Mapping[str, np.ndarray]) -> np.ndarray:
    """J^T w of the wrenches among the arguments ("f_ext:FRAME"), by frame Jacobians."""
    out = np.zeros(model.nv)
    for name, wrench in state.items():
        if name.startswith("f_ext:"):
            frame = model.getFrameId(name.removeprefix("f_ext:"), pin.FrameType.BODY)
            out += pin.computeFrameJacobian(model, model.createData(), q, frame, pin.LOCAL).T @ wrench
    return out


def _rnea_derivatives(model: pin.Model, q: np.ndarray, v: np.ndarray, a: np.ndarray, damping: np.ndarray) -> np.ndarray:
    data = model.createData()  # the matrices are views into it
    by_q, by_v, by_a = pin.computeRNEADerivatives(model, data, q, v, a)
    upper = np.triu(by_a)
    return np.stack([by_q, by_v + np.diag(damping), upper + np.triu(upper, 1).T])


def _energies(model: pin.Model, q: np.ndarray, v: np.ndarray, inertia: np.ndarray) -> np.ndarray:
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    moment = np.zeros(3)
    for joint in range(1, model.njoints):
        moment += model.inertias[joint].mass * data.oMi[joint].act(model.inertias[joint].lever)
    return np.array([v @ inertia @ v / 2, -(model.gravity.linear @ moment)])


def _reach(model: pin.Model, q: np.ndarray) -> float:
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    lever = max((float(np.abs(b.lever).max()) for b in model.inertias), default=0.0)
    return max(float(np.abs(data.oMi[j].translation).max()) for j in range(model.njoints)) + lever


def _frame(model: pin.Model, q: np.ndarray, frame: str) -> tuple[pin.Data, int, float]:
    data = model.createData()
    index = model.getFrameId(frame, pin.FrameType.BODY)
    pin.framesForwardKinematics(model, data, q)
    return data, index, _reach(model, q) + float(np.abs(data.oMf[index].translation).max()) + 1e-3


def _frame_position(model: pin.Model, q: np.ndarray, frame: str) -> tuple[np.ndarray, float]:
    data, index, reach = _frame(model, q, frame)
    return np.array(data.oMf[index].translation), reach


def _frame_rotation(model: pin.Model, q: np.ndarray, frame: str) -> tuple[np.ndarray, float]:
    data, index, _ = _frame(model, q, frame)
    return np.array(data.oMf[index].rotation), 1.0


def _frame_jacobian(model: pin.Model, q: np.ndarray, frame: str) -> tuple[np.ndarray, float]:
    _, index, reach = _frame(model, q, frame)
    return pin.computeFrameJacobian(model, model.createData(), q, index, pin.LOCAL), 1.0 + reach


def _frame_jacobian_world(model: pin.Model, q: np.ndarray, frame: str) -> tuple[np.ndarray, float]:
    _, index, reach = _frame(model, q, frame)
    return pin.computeFrameJacobian(model, model.createData(), q, index, pin.LOCAL_WORLD_ALIGNED), 1.0 + reach


_OF_FRAMES: dict[str, Callable[[pin.Model, np.ndarray, str], tuple[np.ndarray, float]]] = {
    "frame_position": _frame_position,
    "frame_rotation": _frame_rotation,
    "frame_jacobian": _frame_jacobian,
    "frame_jacobian_world": _frame_jacobian_world,
}
