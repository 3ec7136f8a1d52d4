"""Programs of Taylor's method: equations of motion with the model's constants as inputs.

The step size follows from the last two coefficients. Where a motion starts from symmetric rest, both may vanish by
symmetry, and the step size becomes infinite (the paper's own release does so at orders 8, 12 and 20). A companion with
the motion's singularities, but not its symmetries, therefore co-decides it:

    u = log(c + x . x) / 2,   u' = x . x' / (c + x . x)

From rest, all even coefficients of u are nonzero, and one of two neighbouring orders is even. A logarithm grows slowly,
so that u never decides the scale of the error. c = 16 costs 2 % more steps on the paper's arm. c = 1 adds singularities
(20 % more steps); c = 1000 protects less.
"""

import math
from typing import Any, Literal

import numpy as np

from twolink.algorithms.mechanism import nominal_values
from twolink.algorithms.tape import Tape
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.formulas import traced_rate
from twolink.integrate.motion.state import Array
from twolink.integrate.steps.step_certificate import certify_rate
from twolink.native.instructions import Assembled
from twolink.native.machine import Program, assembled
from twolink.native.programs import program_named

RESTORING = 1.0  # 1/s: how fast a quaternion's length returns to 1, which the exact motion never leaves
COMPANION = 16.0  # c

Precision = Literal["double", "extended", "quad"]
PARTS: dict[Precision, int] = {"double": 1, "extended": 2, "quad": 3}  # doubles that make a number


def order_of(tolerance: float) -> int:
    """The order that makes a step's error the tolerance: ceil(1 - log(tolerance) / 2) (Jorba, Zou 2005)."""
    return max(3, math.ceil(1 - math.log(tolerance) / 2))


def exact_constants(equations: Equations) -> dict[str, float]:
    """The model's constants that are inputs, so that what is made of them is not rounded to doubles."""
    values = nominal_values(equations.robot.model)
    return {k: v for k, v in values.items() if v not in (0.0, 1.0) and not k.endswith(".damping")}


def taylor_rate(equations: Equations) -> tuple[Program, Array]:
    """(t, x, numbers of the state array, constants) -> (x', u'), and these constants."""
    name = equations.key("taylor")
    constants = exact_constants(equations)
    values = np.array(list(constants.values()))

    def compare(program: Program) -> None:
        certify_rate(equations, Program(program.arrays, values))

    return program_named(name, lambda: _traced(equations, list(constants)), compare), values


def _traced(equations: Equations, names: list[str]) -> Assembled:
    """The arrays of the program."""
    tape, size, moving = Tape(), equations.space.size, equations.moving
    z: Any = tape.variables(1 + size + len(names))
    x, constants = z[1 : 1 + size], dict(zip(names, z[1 + size :], strict=True))
    rate, x = traced_rate(equations, z[0], x, tape, constants)[:moving], x[:moving]
    companion = (x * rate).sum() / (COMPANION + (x * x).sum())
    for joint in equations.space.curved:
        if joint.normalized is not None:
            part = x[joint.normalized]
            rate[joint.normalized] = rate[joint.normalized] + part * ((1.0 - (part * part).sum()) * RESTORING)
    return assembled(tape, z, [*rate, companion])
