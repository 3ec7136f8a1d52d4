"""Certification: a compiled function is compared with Pinocchio on hard states before its first use.

Each Function brings its reference, with the scale that its rounding errors are measured by (`algorithms.references`).
"""

import functools
import platform
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version

import numpy as np
import pinocchio as pin

from twolink.algorithms.functions import Function
from twolink.algorithms.mechanism import nominal
from twolink.algorithms.references import State
from twolink.dynamics.kernels import Kernel, heyoka
from twolink.errors import CertificationError

BOUND = 1e-11  # of the reference's scale, which takes in the mass matrix's condition number
STATES = 96
NOT_USED = "it is not used; Pinocchio answers instead"


@dataclass(frozen=True)
class KernelCertificate:
    """The comparison of a compiled function with Pinocchio: `worst` is the largest error over its scale."""

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
) -> KernelCertificate:
    """Compare the kernel with Pinocchio; raises CertificationError with the worst state when they disagree.

    The states: generic ones; straight ones, where mass matrices are worst conditioned; very fast ones; and angles of
    many turns. Parameters are drawn between half and twice their nominal values, a new model for each state.
    """
    rng = np.random.default_rng(2008)
    arguments = _arguments(model, function, rng, count)
    values = {name: nominal(model, name) * rng.uniform(0.5, 2, count) for name in parameters}
    columns = [*arguments.values(), *(v[:, None] for v in values.values())]
    damped = tuple(name.removesuffix(".damping") for name in parameters if name.endswith(".damping"))
    results = kernel(columns)
    if results is None:
        what = "the compiled function gives a number that is not finite"
        raise CertificationError(what, where=function.name, remedy=NOT_USED)
    worst = 0.0
    for i in range(count):
        at = with_values(model, {name: v[i] for name, v in values.items()}) if values else model
        state = {name: v[i] for name, v in arguments.items()}
        expected, scale = function.reference(State(at, state, damped))
        error = float((np.abs(results[i] - expected) / scale).max(initial=0.0))
        if not error <= BOUND:
            shown = ", ".join(f"{name} = {np.array2string(x, precision=17)}" for name, x in state.items())
            what = f"the compiled function differs from Pinocchio by {error:.1e} of its scale, the bound is {BOUND:.0e}"
            raise CertificationError(what, where=f"{function.name} at {shown}", remedy=NOT_USED)
        worst = max(worst, error)
    operations = sum(kernel.operations.values())
    return KernelCertificate(function.name, count, worst, BOUND, operations, _versions(), platform.machine())


@functools.cache
def _versions() -> str:
    libraries = ("heyoka", "pin", "numpy") if heyoka() else ("pin", "numpy")
    return ", ".join(f"{name} {version(name)}" for name in libraries)


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
    # Pinocchio gives vectors as views of the model: writing to an entry changes it.
    out = model.copy()
    links = {f.name: f.parentJoint for f in reversed(list(model.frames)) if f.type == pin.FrameType.BODY}
    for name, value in values.items():
        head, _, last = name.rpartition(".")
        axis = "xyz".find(last[-1])
        if head == "gravity" and axis >= 0:
            out.gravity.linear[axis] = value
        elif last in ("armature", "damping"):
            getattr(out, last)[out.idx_vs[out.getJointId(head)]] = value
        elif head.endswith(".origin"):
            out.jointPlacements[out.getJointId(head.removesuffix(".origin"))].translation[axis] = value
        else:
            joint = links[head.removesuffix(".com").removesuffix(".inertia") if last != "mass" else head]
            body = out.inertias[joint].copy()
            if last == "mass":
                body.mass = float(value)
            elif head.endswith(".com"):
                body.lever[axis] = value
            else:
                i, j = map("xyz".find, last)
                rotational = np.array(body.inertia)
                rotational[i, j] = rotational[j, i] = value
                body.inertia = rotational  # the constructor refuses what no body has, a key may have it
            out.inertias[joint] = body
    return out
