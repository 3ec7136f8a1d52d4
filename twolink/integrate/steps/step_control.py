"""Step control over plain arithmetic: one attempt to advance (x, t), its error norm, acceptance and the next step size.

It is part of the step map, so that every world of a batch has its own step size. With e the norm of the error estimate
over what is admitted, and p the order that e has in h, the controller is the PI controller

    h_new = h * SAFETY * e^(-0.7 / p) * e_previous^(0.4 / p)        after an accepted step
    h_new = h * SAFETY * e^(-1 / p)                                  after a rejected one

A step that a stop has cut does not make the next one shorter than was planned before it.

A step must also resolve the motion: of each joint its error is at most `resolution` times what the step changes. Else
a deviation below the tolerance, such as that of a pendulum that begins to topple, would grow as no tolerance tells.

A step that gives no finite number says nothing about the error. It met a singular instant, such as the one at which
the links of a parallelogram are in one line, where no stage of a step may lie. Steps have to cross it: the next size
is that of the last accepted step, shorter by NO_NUMBER_FACTOR each time, and not that of a step rejected near it.

References: Gustafsson: ACM Trans. Math. Softw. 17 (1991) 533-554; Hairer, Wanner: Solving Ordinary Differential
Equations II, IV.2.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from twolink.integrate.motion.state import Array

SAFETY = 0.9
MIN_FACTOR, MAX_FACTOR = 0.2, 6.0  # of the step size, from one step to the next
NO_NUMBER_FACTOR = 0.9  # of the last good step size, after a step that gave no finite number
LARGEST_NUMBER = 1e300  # squares above it count as not finite
CUT = 1.0 - 1e-6  # of its planned size, which rounding leaves: a shorter step has been cut
LAST_STEP = 1.0 + 1e-6  # a step that ends this near to the end goes to the end: rounding must not leave a tiny one
ROUNDING = 16 * 2.3e-16  # relative: no estimate resolves less of a state
MIN_SQUARE, MAX_SQUARE = 1e-8, 1e30  # limits of e^2 in the controller, whose powers must stay finite
RESOLUTION = 1e-3  # relative to what a step changes in a joint: the largest error, about that of one e-fold of rk45
TINY = 1e-300  # a step may be so short that its square is 0
UNSOLVED = 1e-9  # relative: the largest last change of the iteration in an implicit step of fixed size
FIRST_SQUARE = 1e-4  # e^2 that the controller remembers before the first step


class Control(NamedTuple):
    """The rows of the control in the state array, after those of x: their values, or their indices."""

    time: Any  # t, s
    step: Any  # the size of the next step, s
    good: Any  # the size of the last accepted step, less after each step without a number, s
    previous: Any  # e^2 of the last accepted step
    accepted: Any  # number of steps so far
    rejected: Any  # number of attempts in vain
    end: Any  # where to stop, s
    tolerance: Any  # of the error in a step; infinite: every step is accepted
    longest: Any  # the largest step size, s
    resolution: Any  # of an error relative to what a step changes in its joint, 1 / (the largest one)^2; 0: any


ROWS = len(Control._fields)
Step = Callable[[Any, Array, Any], tuple[Array, list[Array], Array | None]]


def control_rows(size: int) -> Control:
    """The indices of the control's rows in the state array of states x (size,)."""
    return Control(*range(size, size + ROWS))


@dataclass(frozen=True)
class StepProblem:
    """The problem to advance: its step, with the size of its state and the scales of its errors.

    step: (t, x, h) -> (x_new, error estimates, last change of an iteration or None). size: rows of x. absolute (size,):
    whether the error of an entry is compared with the tolerance alone, not with the entry's size. joints: of each
    joint, its rows of q and of v. project: puts a state back onto its manifold. order: p, the power of h that the
    error estimate has. embedded (n,): 1 of the worlds that go on by the embedded formula: less the estimate.
    """

    step: Step
    size: int
    absolute: np.ndarray
    joints: tuple[tuple[slice, slice], ...]
    project: Callable[[Array], Array]
    order: int
    embedded: Array | None = None


def fixed_advance(problem: StepProblem, state: Array) -> Array:
    """One step of a fixed size; the last one ends at the end."""
    x, control, parameters = _split(problem, state)
    left = control.end - control.time
    going = left > 0.0
    arrival = np.where(left <= control.step * LAST_STEP, control.end, control.time + control.step)
    new, _, change = problem.step(control.time, x, arrival - control.time)
    if change is not None:  # an iteration that did not converge gives no answer
        unsolved = _mean_square(change, _admitted(problem, x, new, 1.0))
        new = np.where(unsolved <= UNSOLVED**2, new, np.nan)
    control = control._replace(
        time=np.where(going, arrival, control.time), accepted=np.where(going, control.accepted + 1.0, control.accepted)
    )
    return _stack(np.where(going, problem.project(new), x), control, parameters)


def adaptive_advance(problem: StepProblem, state: Array) -> Array:
    """One attempt: the new state where its error is admitted, else the old one; and the size of the next step."""
    x, control, parameters = _split(problem, state)
    going = control.end - control.time > 0.0
    arrival = _arrival(control)
    h = arrival - control.time  # rounding included, so that the time does not drift
    new, square = _judged(problem, control, x, h)
    admitted = square <= 1.0  # NaN fails every comparison: not admitted
    finite = square <= LARGEST_NUMBER
    bounded = np.where(square <= MAX_SQUARE, square, MAX_SQUARE)
    bounded = np.where(bounded < MIN_SQUARE, MIN_SQUARE, bounded)
    factor = _factor(bounded, control.previous, admitted, problem.order)
    good = np.where(admitted, h, np.where(finite, control.good, control.good * NO_NUMBER_FACTOR))
    proposed = np.where(finite, h * factor, good)
    # A step that its end has cut says nothing against the size that was planned.
    kept = np.logical_and(admitted, h < control.step * CUT)
    proposed = np.where(np.logical_and(kept, proposed < control.step), control.step, proposed)
    proposed = np.where(control.longest < proposed, control.longest, proposed)
    advancing = np.logical_and(going, admitted)
    control = control._replace(
        time=np.where(advancing, arrival, control.time),
        step=np.where(going, proposed, control.step),
        good=np.where(going, good, control.good),
        previous=np.where(advancing, bounded, control.previous),
        accepted=np.where(advancing, control.accepted + 1.0, control.accepted),
        rejected=np.where(going, np.where(admitted, control.rejected, control.rejected + 1.0), control.rejected),
    )
    return _stack(np.where(advancing, new, x), control, parameters)


def _arrival(control: Control) -> Any:
    """The time at which the next step ends.

    Two equal steps to the end replace a step and a tiny one (Brankin, Gladwell, Shampine: RKSUITE, 1992).
    """
    left = control.end - control.time
    h = np.where(left < control.step * 2.0, left * 0.5, control.step)
    return np.where(left <= control.step * LAST_STEP, control.end, control.time + h)


def _judged(problem: StepProblem, control: Control, x: Array, h: Any) -> tuple[Array, Any]:
    """A step's new state on its manifold, and e^2, which is NaN where a number is not finite.

    A step whose projection fails is not admitted: no step may end there. A sample (infinite tolerance) may be there,
    and is not projected.
    """
    new, errors, change = problem.step(control.time, x, h)
    if problem.embedded is not None:
        new = np.where(problem.embedded > 0.0, new - errors[0], new)
    projected = problem.project(new)
    inverse = _admitted(problem, x, new, control.tolerance) + _resolved(problem, x, new, h, control.resolution)
    square = _error(errors, change, inverse)
    good = (projected * projected).sum(axis=0) <= LARGEST_NUMBER
    failed = np.where(control.tolerance < LARGEST_NUMBER, np.nan, square)
    return np.where(good, projected, new), np.where(good, square, failed)


def _factor(square: Any, previous: Any, admitted: Any, order: int) -> Any:
    """h_new / h by the PI controller, from e^2 of this step and of the last accepted one."""
    rejected = SAFETY * np.power(square, -0.5 / order)
    accepted = SAFETY * np.power(square, -0.35 / order) * np.power(previous, 0.2 / order)
    factor = np.where(admitted, np.where(accepted < MAX_FACTOR, accepted, MAX_FACTOR), rejected)
    return np.where(factor > MIN_FACTOR, factor, MIN_FACTOR)


def _error(errors: list[Array], change: Array | None, inverse: Array) -> Any:
    """e^2, the square of the error's norm over what is admitted.

    Of two estimates of orders 5 and 3 it is that of e5^2 / sqrt(e5^2 + e3^2 / 100), which has h^8 (DOP853; Hairer,
    Norsett, Wanner: Solving Ordinary Differential Equations I, II.10). The last change of an iteration is an error too.
    """
    squares = [_mean_square(e, inverse) for e in errors]
    square: Any = squares[0]
    if len(squares) == 2:
        high, low = squares
        square = high * high / (high + 0.01 * low + 1e-300)
    if change is not None:
        square = square + _mean_square(change, inverse)
    return square


def _mean_square(error: Array, inverse: Array) -> Any:
    """The mean of (error / admitted)^2, from 1 / admitted^2."""
    return (error * error * inverse).sum(axis=0) * (1.0 / max(1, len(error)))


def _admitted(problem: StepProblem, x: Array, new: Array, tolerance: Any) -> Array:
    """1 / admitted^2 by the tolerance: tolerance * (1 or, of velocities, 1 + |v|), and rounding."""
    largest = np.where(x * x < new * new, new * new, x * x)
    relative = np.where(problem.absolute, 0.0, 1.0).reshape(-1, *[1] * (x.ndim - 1))
    return np.asarray(1.0 / ((largest * relative + 1.0) * (tolerance * tolerance) + largest * ROUNDING**2))


def _resolved(problem: StepProblem, x: Array, new: Array, h: Any, resolution: Any) -> Array:
    """1 / admitted^2 by the resolution: a part of what the step changes in the joint, and rounding.

    What it changes is the sum of both of its changes, dq + h dv or dv + dq / h: one of the two may vanish for a moment.
    """
    change = (new - x) * (new - x)
    largest = np.where(x * x < new * new, new * new, x * x)
    inverse: Array = np.zeros_like(change)
    for q, v in problem.joints:
        size = change[q].sum(axis=0) + change[v].sum(axis=0) * (h * h)
        rounding = (1.0 + resolution) * ROUNDING**2
        inverse[q] = resolution / ((largest[q] + 1.0) * rounding + size)
        inverse[v] = resolution * (h * h) / ((largest[v] + 1.0) * rounding * (h * h) + size + TINY)
    return inverse


def _split(problem: StepProblem, state: Array) -> tuple[Array, Control, Array]:
    """x, the control's rows and the run-time parameters of a state array."""
    end = problem.size + ROWS
    return state[: problem.size], Control(*state[problem.size : end]), state[end:]


def _stack(x: Array, control: Control, parameters: Array) -> Array:
    """The state array of x, the control's rows and the run-time parameters."""
    return np.concatenate([x, np.stack([np.asarray(row, dtype=x.dtype) for row in control]), parameters])


def initial_state(
    x: Array,
    t: Any,
    h: Any,
    end: Any,
    tolerance: Any,
    longest: Any = np.inf,
    parameters: Array | None = None,
    resolution: Any = 0.0,
) -> Array:
    """The state array of worlds x (size, n) at time t with first steps h, to stop at `end`.

    t, h, end, tolerance, longest and resolution are numbers or one number a world (n,); parameters (p, n) or (p, 1).
    """
    rows, count = control_rows(len(x)), 0 if parameters is None else len(parameters)
    state = np.zeros((len(x) + ROWS + count, x.shape[1]))
    state[: len(x)] = x
    state[rows.time], state[rows.step], state[rows.good], state[rows.previous] = t, h, h, FIRST_SQUARE
    state[rows.end], state[rows.tolerance], state[rows.longest] = end, tolerance, longest
    state[rows.resolution] = resolution
    if parameters is not None:
        state[len(x) + ROWS :] = parameters
    return state
