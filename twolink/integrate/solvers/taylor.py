"""Taylor's method: the series of the motion to an order that the tolerance calls for (`native/taylor.h`).

Its programs are the equations of motion with the model's constants as inputs.

The step size follows from the last two coefficients. Where a motion starts from symmetric rest, both may vanish by
symmetry, and the step size becomes infinite (the paper's own release does so at orders 8, 12 and 20). A companion with
the motion's singularities, but not its symmetries, therefore co-decides it:

    u = log(c + x . x) / 2,   u' = x . x' / (c + x . x)

From rest, all even coefficients of u are nonzero, and one of two neighbouring orders is even. A logarithm grows slowly,
so that u never decides the scale of the error. c = 16 costs 2 % more steps on the paper's arm. c = 1 adds singularities
(20 % more steps); c = 1000 protects less.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from twolink.algorithms.mechanism import nominal_values
from twolink.algorithms.tape import Tape
from twolink.errors import AccuracyError, MissingExtraError
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.formulas import traced_rate
from twolink.integrate.motion.state import Array
from twolink.integrate.solution import Progress, Solution, in_segments, segment_times
from twolink.integrate.steps.failures import MAX_STEPS, failure
from twolink.integrate.steps.perturbation import MIN_STEPS, NO_PERTURBATION, Companions, Perturbation, step_disturbances
from twolink.integrate.steps.programs import certify_rate
from twolink.native.instructions import Assembled
from twolink.native.library import library
from twolink.native.machine import Program, assembled
from twolink.native.programs import program_named
from twolink.native.stepper import Disturbances
from twolink.native.taylor import Series

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
    rate = traced_rate(equations, z[0], x, tape, constants)[:moving]
    return assembled(tape, z, with_companion(equations, x[:moving], rate))


def with_companion(equations: Equations, x: Any, rate: Any) -> list[Any]:
    """Rates of states, those of what has length 1 restored to it, and the companion's."""
    companion = (x * rate).sum() / (COMPANION + (x * x).sum())
    for joint in equations.space.curved:
        if joint.normalized is not None:
            part = x[joint.normalized]
            rate[joint.normalized] = rate[joint.normalized] + part * ((1.0 - (part * part).sum()) * RESTORING)
    return [*rate, companion]


ROUNDING_UNIT: dict[Precision, float] = {"double": 2.2e-16, "extended": 2.5e-32, "quad": 2.7e-48}
UNITS = tuple(ROUNDING_UNIT.values())  # of numbers of 1, 2 and 3 parts
SHORTEST = 1e-300  # s: of the longest step, which is above 0
LOOK, SAMPLES = 64, 4096  # steps and samples between looks at Ctrl-C


def solve(
    equations: Equations,
    times: Array,
    tolerance: float,
    progress: Progress | None = None,
    *,
    precision: Precision = "double",
    perturbation: Perturbation = NO_PERTURBATION,
    companions: Companions | None = None,
) -> Solution:
    """Solve from the equations' start for samples, by Taylor's method.

    Parameters
    ----------
    equations : Equations
    times : ndarray (n,)
        Sample times, increasing, s.
    tolerance : float
        Of the error in each step.
    progress : callable, optional
        Called with the simulated time now and then.
    precision : {"double", "extended", "quad"}
        16 digits, 31 or 47. Of the last two the states are in Solution.precise as well, and products of the model's
        constants keep their digits.
    perturbation : Perturbation
        Of this solution; its tolerance is divided by `finer`, which adds orders.
    companions : Companions, optional
        Solutions in double precision, each of an order of its own.

    Returns
    -------
    Solution

    Raises
    ------
    AccuracyError
        A step or the state is not finite, or too many steps are needed.
    MissingExtraError
        There is no native library.
    """
    if library() is None:
        raise MissingExtraError("Taylor's method needs the native library", remedy='method="scipy-dop853"')
    order, end = order_of(tolerance / perturbation.finer), None
    now = None if companions is None else companions.x[0].T.copy()  # where the solutions beside the run are

    def segment(equations: Equations, times: Array) -> Solution:
        nonlocal end
        rate, constants = taylor_rate(equations)
        numbers = np.concatenate([equations.start[equations.moving :], constants])
        start = np.zeros((equations.moving, PARTS[precision]))
        start[:, 0] = equations.start[: equations.moving]
        states = np.empty((len(times), *start.shape))
        states[0] = start if end is None else end  # with the digits that the equations' start lacks
        done, steps, interrupted = 1, 0, False
        try:
            for reached in _advanced(equations, rate, numbers, order, times, states, perturbation):
                done, steps = reached
                if progress is not None:
                    progress(float(times[done - 1]))
            if companions is not None and now is not None:
                _advance_companions(equations, rate, numbers, tolerance, times, companions, now, progress)
        except KeyboardInterrupt:
            interrupted = True
        end = states[done - 1]
        precise = None if precision == "double" else states[:done]
        x = np.ascontiguousarray(states[:done, :, 0].T)
        return Solution(times[:done], x, steps, steps * order, compiled="steps", interrupted=interrupted,
                        precise=precise)  # fmt: skip

    return in_segments(equations, times, segment)


def _advanced(
    equations: Equations,
    rate: Program,
    numbers: Array,
    order: int,
    times: Array,
    states: Array,
    perturbation: Perturbation,
) -> Iterator[tuple[int, int]]:
    """Fill states (n, moving, parts), of which the first is given: how many are there, and the steps, now and then."""
    longest = max(SHORTEST, float(times[-1] - times[0]) / MIN_STEPS)
    series, done = Series(rate, order, float(times[0]), states[0], numbers, longest), 1
    disturbed = _disturbances(equations, perturbation, states.shape[2])
    while done < len(times):
        part = slice(done, done + SAMPLES)
        try:
            done += series.advance(times[part], states[part], LOOK, disturbed)
        except FloatingPointError:
            raise failure("not-finite", series.t) from None
        if series.steps > MAX_STEPS:
            raise failure("too-many-steps", series.t, limit=MAX_STEPS)
        yield done, series.steps


def _disturbances(equations: Equations, perturbation: Perturbation, parts: int) -> Disturbances | None:
    """The disturbances of a solution in numbers of so many parts, of the size of their rounding."""
    found = step_disturbances((perturbation,), equations.start[:, None], equations)
    unit = UNITS[parts - 1] / UNITS[0]
    return found and replace(found, rounding=unit * found.rounding, bias=unit * found.bias)


def _advance_companions(
    equations: Equations,
    rate: Program,
    numbers: Array,
    tolerance: float,
    times: Array,
    companions: Companions,
    now: Array,
    progress: Progress | None,
) -> None:
    """Solve from where the solutions beside a run are, `now` (moving, n), to the end of a segment.

    What is not finite stays NaN.
    """
    grid, _ = segment_times(companions.t, times[0], times[-1])
    first, after = np.searchsorted(companions.t, times[[0, -1]], side="right")
    for i, one in enumerate(companions.perturbations):
        states = np.full((len(grid), equations.moving, 1), np.nan)
        states[0, :, 0] = now[:, i]
        try:
            for done, _ in _advanced(equations, rate, numbers, order_of(tolerance / one.finer), grid, states, one):
                if progress is not None:
                    progress(float(grid[done - 1]))
        except AccuracyError as error:
            if error.code not in ("not-finite", "too-many-steps"):
                raise
        companions.x[first:after, i] = states[1 : 1 + after - first, :, 0]
        now[:, i] = states[-1, :, 0]
