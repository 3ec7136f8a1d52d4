"""Step control over plain arithmetic: one advance of (x, t, h) with its error norm, acceptance and next step.

It is part of the step map, so that every world of a batch has its own step size at no cost of its own.
The controller is PI: h_new = h safety e^(-0.7/p) e_before^(0.4/p), limited, with e the error over what is admitted
(Gustafsson 1991; Hairer, Wanner: Solving Ordinary Differential Equations II, IV.2).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from twolink.integrate.state import Array

SAFETY = 0.9
SLOWEST, FASTEST = 0.2, 6.0  # factors of the step size
BLIND = 0.9  # what the sizes to try next shrink by after a step that gave no number
ROUND = 6755399441055744.0  # 1.5 * 2^52: adding and subtracting it rounds to whole numbers
LARGEST_SEEN = 1e300
LAST = 1.0 + 1e-6  # a step that ends this near to the end goes to the end
ROUNDING = 16 * 2.3e-16  # relative: what no step can resolve
SMALLEST_ERROR, LARGEST_ERROR = 1e-8, 1e30  # of the square that decides about the next step
UNSOLVED = 1e-9  # what the last iteration of a fixed implicit step may have moved, relative

FIRST_ERROR = 1e-4  # what the controller remembers before the first step
# The control's own rows, after the state's size rows: the clock, and what every world is told.
TIME, STEP, BEFORE, GOOD, ACCEPTED, REJECTED, END, TOLERANCE, LONGEST = range(9)
ROWS = 9

Step = Callable[[Any, Array, Any], tuple[Array, list[Array], Array | None]]


@dataclass(frozen=True)
class Problem:
    """What is advanced: the method's step, and the states it works on.

    size: rows of x. absolute (size,): whether an entry's error counts as it is. normalize: back onto the manifold.
    order: p of the error estimate, which goes as h^p.
    """

    step: Step
    size: int
    absolute: np.ndarray
    normalize: Callable[[Array], Array]
    order: int


def fixed_advance(problem: Problem, state: Array, xp: Any) -> Array:
    """One step of a fixed size; the last one ends at the end."""
    x, own, parameters = _parts(problem, state)
    t, h, before, good, accepted, rejected, end, tolerance, longest = own
    left = end - t
    going = xp.less(0.0, left)
    arrived = xp.where(xp.less_equal(left, h * LAST), end, t + h)
    new, _, moved = problem.step(t, x, arrived - t)
    if moved is not None:  # an iteration that did not converge gives no answer, and NaN says so
        unsolved = _square(moved, x, new, problem.absolute, 1.0, xp)
        new = xp.where(xp.less_equal(unsolved, UNSOLVED**2), new, np.nan)
    new = problem.normalize(new)
    counted = xp.where(going, accepted + 1.0, accepted)
    now = [xp.where(going, arrived, t), h, before, good, counted, rejected, end, tolerance, longest]
    return _stacked(xp.where(going, new, x), now, parameters)


def adaptive_advance(problem: Problem, state: Array, xp: Any) -> Array:
    """One attempt: the new state where its error is admitted, the old one elsewhere; and the size of the next step."""
    x, own, parameters = _parts(problem, state)
    t, h, before, good, accepted, rejected, end, tolerance, longest = own
    left = end - t
    going = xp.less(0.0, left)
    last = xp.less_equal(left, h * LAST)
    # Two equal steps to the end instead of one and a crumb. What is added to t is what the step takes, rounding
    # included, so that time does not drift.
    arrived = xp.where(last, end, t + xp.where(xp.less(left, h * 2.0), left * 0.5, h))
    taken = arrived - t
    new, errors, moved = problem.step(t, x, taken)
    # Judged where it lands: where the way back onto the manifold is lost, no step ends. A sample (its tolerance is
    # infinite) may be there, and stays as it is.
    landed = problem.normalize(new)
    square = _error(errors, moved, x, new, problem.absolute, tolerance, xp)
    fine = xp.less_equal((landed * landed).sum(axis=0), LARGEST_SEEN)
    new = xp.where(fine, landed, new)
    square = xp.where(fine, square, xp.where(xp.less(tolerance, LARGEST_SEEN), np.nan, square))
    admitted = xp.less_equal(square, 1.0)
    # A NaN fails every comparison: it counts as the largest error.
    known = xp.where(xp.less_equal(square, LARGEST_ERROR), square, LARGEST_ERROR)
    known = xp.where(xp.less(known, SMALLEST_ERROR), SMALLEST_ERROR, known)
    alone = SAFETY * xp.power(known, -0.5 / problem.order)
    with_memory = SAFETY * xp.power(known, -0.35 / problem.order) * xp.power(before, 0.2 / problem.order)
    factor = xp.where(admitted, xp.where(xp.less(with_memory, FASTEST), with_memory, FASTEST), alone)
    factor = xp.where(xp.less(SLOWEST, factor), factor, SLOWEST)
    # What could not be computed tells nothing about the error. Near a singular instant, which no stage may meet, other
    # sizes about the last good one will do; where nothing will, they become smaller.
    seen = xp.less_equal(square, LARGEST_SEEN)
    golden = rejected * 0.6180339887498949
    slower, kept = good * BLIND, xp.where(admitted, taken, good)
    elsewhere = good * (0.35 + golden - ((golden - 0.5 + ROUND) - ROUND))
    proposed = xp.where(seen, taken * factor, elsewhere)
    moving_on = xp.both(going, admitted)
    now = [
        xp.where(moving_on, arrived, t),
        xp.where(going, xp.where(xp.less(longest, proposed), longest, proposed), h),
        xp.where(moving_on, known, before),
        xp.where(going, xp.where(seen, xp.where(xp.less(slower, kept), kept, slower), slower), good),
        xp.where(moving_on, accepted + 1.0, accepted),
        xp.where(going, xp.where(admitted, rejected, rejected + 1.0), rejected),
        end,
        tolerance,
        longest,
    ]
    return _stacked(xp.where(moving_on, new, x), now, parameters)


def _parts(problem: Problem, state: Array) -> tuple[Array, Array, Array]:
    """x, the control's own rows, and the run-time parameters."""
    own = problem.size + ROWS
    return state[: problem.size], state[problem.size : own], state[own:]


def _error(
    errors: list[Array], moved: Array | None, x: Array, new: Array, absolute: Array, tolerance: Any, xp: Any
) -> Any:
    """The square of the error's norm over what is admitted.

    Of two estimates of orders 5 and 3 it is Hairer's e5^2 / sqrt(e5^2 + e3^2 / 100) (DOP853; Solving Ordinary
    Differential Equations I, II.10), which goes as h^8.
    """
    squares = [_square(e, x, new, absolute, tolerance, xp) for e in errors]
    square = squares[0]
    if len(squares) == 2:
        high, low = squares
        square = high * high / (high + 0.01 * low + 1e-300)
    if moved is not None:
        square = square + _square(moved, x, new, absolute, tolerance, xp)
    return square


def _square(error: Array, x: Array, new: Array, absolute: Array, tolerance: Any, xp: Any) -> Any:
    """The mean of (e / admitted)^2: the tolerance for configurations, relative to 1 + |v| for velocities.

    Rounding is admitted besides: what a state of that size cannot resolve.
    """
    largest = xp.where(xp.less(x * x, new * new), new * new, x * x)
    relative = np.where(absolute, 0.0, 1.0).reshape(-1, *[1] * (x.ndim - 1))
    admitted = (largest * relative + 1.0) * (tolerance * tolerance) + largest * ROUNDING**2
    return (error * error / admitted).sum(axis=0) * (1.0 / max(1, len(x)))


def _stacked(x: Array, now: list[Any], parameters: Array) -> Array:
    return np.concatenate([x, np.stack([np.asarray(row, dtype=x.dtype) for row in now]), parameters])
