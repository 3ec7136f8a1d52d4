"""The error of a motion that goes on without end: how far apart its solutions are."""

from __future__ import annotations

from typing import Any

import numpy as np

from twolink.integrate.core.motion import Motion
from twolink.integrate.motion.state import Array, StateSpace
from twolink.integrate.steps.methods import METHODS
from twolink.integrate.steps.perturbation import NO_PERTURBATION, disturbed_solutions, finer_solution
from twolink.simulation.error_bar import DISTURBED, STEPPED, distances, rounding_after, truncation_factor, widened

METHOD, NEARER = METHODS["dop853"], METHODS["rk45"]  # the latter for steps that a caller keeps short
ROUNDED = 2  # solutions that are disturbed by rounding, with verify
NOTES = 64  # states at which solutions are compared at once


def solutions_of(tolerance: float, *, verify: bool) -> tuple[Any, ...]:
    """The perturbations of a motion, and of those that show its error."""
    others = (finer_solution(METHOD, tolerance), *disturbed_solutions(ROUNDED)) if verify else ()
    return NO_PERTURBATION, *others


def errors_of(space: StateSpace, x: Array, steps: Array) -> Array:
    """Bounds (m,) on the errors of the first of solutions x (m, moving, n), rad or m, after so many steps (m,)."""
    off = distances(space, x[:, :, :1], x[:, :, 1:])
    bar = truncation_factor(METHOD, steps) * off[:, 0] + DISTURBED[ROUNDED] * off[:, 1:].max(axis=1)
    return np.asarray(widened(bar) + rounding_after(space, x[:, :, 0], steps))


def estimates_of(space: StateSpace, x: Array, unfollowed: Array) -> Array:
    """Estimates (m,) of the errors of stepped solutions x (m, moving, 2), of which the second has half the steps.

    Of first order, half the step has half the error. unfollowed (m,): of bounces too low for the steps, rad or m.
    """
    return widened(STEPPED * 2.0 * (distances(space, x[:, :, :1], x[:, :, 1:])[:, 0] + unfollowed))


class MotionError:
    """The largest error of a motion so far, of the times at which it was noted: some are compared at once."""

    def __init__(self, motion: Motion) -> None:
        self._motion, self._largest, self._noted = motion, 0.0, 0
        self._places = np.empty((NOTES, *motion.x.shape))
        self._counts = np.empty(NOTES)

    def note(self) -> None:
        """Keep where the solutions are, and what led there."""
        motion = self._motion
        counted = motion.steps if motion.unfollowed is None else motion.unfollowed
        self._places[self._noted], self._counts[self._noted] = motion.x, counted
        self._noted += 1
        if self._noted == NOTES:
            self._compare()

    @property
    def largest(self) -> float:
        """The largest bound on the error, or estimate of it, with that now, rad or m."""
        self.note()
        self._compare()
        return self._largest

    def _compare(self) -> None:
        space, noted = self._motion.equations.space, slice(self._noted)
        bounds = errors_of if self._motion.unfollowed is None else estimates_of
        if self._noted:
            found = bounds(space, self._places[noted], self._counts[noted])
            self._largest, self._noted = max(self._largest, float(found.max())), 0

    def saved(self) -> tuple[float, Array, Array]:
        """The largest so far, and what was noted."""
        noted = slice(self._noted)
        return self._largest, self._places[noted].copy(), self._counts[noted].copy()

    def restore(self, saved: tuple[float, Array, Array]) -> None:
        """Go on from there."""
        self._largest, places, counts = saved
        self._noted = len(places)
        self._places[: self._noted], self._counts[: self._noted] = places, counts
