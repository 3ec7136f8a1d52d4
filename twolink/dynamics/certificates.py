"""Certification: before a compiled function is first used, both engines are compared with a reference on hard states.

Each Function brings its reference, with the scale that its rounding errors are measured by (`algorithms.references`).
The compiled function and Pinocchio's answer, as queries get it, are both held against it.
"""

import functools
import platform
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version

import numpy as np
import pinocchio as pin

from twolink.algorithms.functions import Function
from twolink.algorithms.mechanism import nominal, with_nominal
from twolink.algorithms.references import ModelState
from twolink.dynamics.kernels import Kernel
from twolink.dynamics.pinocchio_queries import by_name
from twolink.errors import CertificationError
from twolink.native.library import library
from twolink.robots.model import RobotModel

BOUND = 1e-11  # of the reference's scale, which takes in the mass matrix's condition number
STATES = 96
NOT_USED = "it is not used; Pinocchio answers instead"
COMPILED, PINOCCHIO = "the compiled function", "Pinocchio's answer"
_REMEDY = {COMPILED: NOT_USED, PINOCCHIO: "neither engine is certified for this query; compare it with a third"}


@dataclass(frozen=True)
class KernelCertificate:
    """The comparison of a compiled function and of Pinocchio's answer with the reference: the largest errors over its
    scale. pinocchio: 0 where parameters are kept, which Pinocchio has not."""

    function: str
    states: int
    worst: float
    pinocchio: float
    bound: float
    operations: int
    versions: str
    machine: str

    def __str__(self) -> str:
        return (
            f"{self.function}: {self.states} states against the reference, worst error of its scale {self.worst:.1e} "
            f"compiled, {self.pinocchio:.1e} by Pinocchio (bound {self.bound:.0e}), {self.operations} operations; "
            f"{self.versions}; {self.machine}"
        )


def certify(
    robot: RobotModel, function: Function, kernel: Kernel, parameters: tuple[str, ...] = (), count: int = STATES
) -> KernelCertificate:
    """Compare the kernel, and without parameters also Pinocchio's answers, with the reference.

    Raises CertificationError that names the engine and the state where they disagree.

    The states: generic ones; straight ones, where mass matrices are worst conditioned; very fast ones; and angles of
    many turns, with sliders at some metres: at hundreds the mass matrix has few digits. Parameters are drawn between
    half and twice their nominal values, a new model for each state.
    """
    model, rng = robot.model, np.random.default_rng(2008)
    arguments = _arguments(robot, function, rng, count)
    values = {name: nominal(model, name) * rng.uniform(0.5, 2, count) for name in parameters}
    columns = [*arguments.values(), *(v[:, None] for v in values.values())]
    damped = tuple(name.removesuffix(".damping") for name in parameters if name.endswith(".damping"))
    results = kernel(columns)
    if results is None:
        what = "the compiled function gives a number that is not finite"
        raise CertificationError(what, where=function.name, remedy=NOT_USED)
    served = [(COMPILED, results)]
    if not parameters:  # in a batch, and in two that are too small for Pinocchio's parallel loops
        parts = ({name: x[half] for name, x in arguments.items()} for half in (slice(0, 48), slice(48, None)))
        few = np.concatenate([by_name(robot, function.name, part) for part in parts])
        served += [(PINOCCHIO, by_name(robot, function.name, arguments)), (PINOCCHIO, few)]
    worst = dict.fromkeys((COMPILED, PINOCCHIO), 0.0)
    for i in range(count):
        at = with_values(model, {name: v[i] for name, v in values.items()}) if values else model
        state = {name: v[i] for name, v in arguments.items()}
        expected, scale = function.reference(ModelState(at, state, damped))
        expected = np.reshape(expected, function.shape)
        for engine, answers in served:
            error = float((np.abs(answers[i] - expected) / scale).max(initial=0.0))
            if not error <= BOUND:
                shown = ", ".join(f"{name} = {np.array2string(x, precision=17)}" for name, x in state.items())
                what = f"{engine} differs from the reference by {error:.1e} of its scale, the bound is {BOUND:.0e}"
                raise CertificationError(what, where=f"{function.name} at {shown}", remedy=_REMEDY[engine])
            worst[engine] = max(worst[engine], error)
    operations = sum(kernel.operations.values())
    found = worst[COMPILED], worst[PINOCCHIO]
    return KernelCertificate(function.name, count, *found, BOUND, operations, _versions(), platform.machine())


@functools.cache
def _versions() -> str:
    machine = "native library" if library() else "NumPy"
    return f"{machine}, " + ", ".join(f"{name} {version(name)}" for name in ("pin", "numpy"))


def _arguments(robot: RobotModel, function: Function, rng: np.random.Generator, count: int) -> dict[str, np.ndarray]:
    model, neutral = robot.model, robot.neutral
    reach = np.repeat([np.pi, 1e-9, np.pi, 300.0], -(-count // 4))[:count]
    speed = np.repeat([3.0, 1.0, 1e3, 3.0], -(-count // 4))[:count]
    steps = rng.uniform(-1, 1, (count, model.nv)) * reach[:, None]
    sliders = [joint.v.start for joint in robot.joints if joint.unit == "m"]
    steps[:, sliders] *= np.minimum(1.0, np.pi / reach)[:, None]
    q = np.array([pin.normalize(model, pin.integrate(model, neutral, step)) for step in steps])
    out = {}
    for name, size in function.arguments:
        out[name] = q if name == "q" else rng.uniform(-1, 1, (count, size)) * (speed[:, None] if name == "v" else 20.0)
    return out


def with_values(model: pin.Model, values: Mapping[str, float]) -> pin.Model:
    """A copy of the model with physical constants replaced (names: `mechanism.parameter_names`)."""
    out = model.copy()
    for name, value in values.items():
        with_nominal(out, name, value)
    return out
