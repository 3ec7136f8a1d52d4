"""A run, and what the solutions beside it show of its errors."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from twolink.errors import AccuracyError
from twolink.integrate.digits import difference
from twolink.integrate.motion.state import Array, StateSpace
from twolink.integrate.solution import Solution
from twolink.integrate.solver import MethodChoice
from twolink.simulation.error_bar import DISTURBED, common_rounding, distances, error_bar, truncation_factor

ALONE = 2  # disturbed solutions that are no columns of a batch, at most


@dataclass(frozen=True, eq=False)
class Verified:
    """A run and how far the solutions beside it are from it.

    checks (k,): numbers of its samples at which they are compared. truncation, rounding (k,): parts of the error bar
    there, rad or m; None: not verified, or interrupted. seconds: of solving; of a batch, those of the run's steps.
    verify_seconds: of the others. lost: why the finer solution does not get to the end.
    """

    choice: MethodChoice
    solution: Solution
    seconds: float
    checks: Array
    truncation: Array | None = None
    rounding: Array | None = None
    verify_seconds: float = 0.0
    lost: AccuracyError | None = None

    def common_rounding(self, space: StateSpace) -> Array:
        """The rounding that all solutions have alike, where they are compared (k,), rad or m."""
        solution, checks = self.solution, self.checks
        if solution.precise is not None:
            return np.zeros(len(checks))
        return common_rounding(space, solution.t[checks], solution.x[:, checks].T, solution.steps)

    def bar(self, space: StateSpace, slack: float) -> Array | None:
        """The error bar at each sample (n,), rad or m."""
        if self.truncation is None or self.rounding is None:
            return None
        bar = error_bar(self.truncation + self.rounding, self.common_rounding(space))
        bar = bar.repeat(np.diff(self.checks, prepend=-1))
        bar[1:] += slack
        return np.asarray(bar)  # between two checks, that of the later one

    def with_parts(self, each: Array) -> Verified:
        """The run with the parts of its bar, from its distances (k, n) to the finer and the disturbed solutions."""
        truncation = truncation_factor(self.choice.method, self.solution.steps) * self._ahead(each[:, 0])
        disturbed = each[:, 1:]
        # Steps may collapse beside a singular position of loops by chance: half of the others tell enough.
        arrived = disturbed[:, np.isfinite(disturbed[-1])]
        used = arrived if 2 * arrived.shape[1] >= disturbed.shape[1] > ALONE else disturbed
        return replace(self, truncation=truncation, rounding=DISTURBED[disturbed.shape[1]] * used.max(axis=1))

    def _ahead(self, far: Array) -> Array:
        """The distances (k,) to a finer solution; of steps of one size, the largest up to two steps later.

        A sample within a step is a part of it. Where steps begin anew, at the start and behind what breaks the motion,
        the first half step of the run is also one of the finer solution.
        """
        if self.choice.method.adaptive:
            return far
        t = self.solution.t[self.checks]
        ends = np.minimum(np.searchsorted(t, t + 2.0 * self.choice.setting) + 1, len(t)).tolist()
        return np.array([far[0], *(far[k:end].max() for k, end in enumerate(ends[1:], 1))])

    def distance(self, space: StateSpace, other: Solution) -> Array:
        """The distance of q from another solution at the samples that are compared (k,), rad or m."""
        solution, checks = self.solution, self.checks
        t, x = solution.t[checks], solution.x[:, checks]
        same = np.minimum(np.arange(len(checks)), len(other.t) - 1)
        if other.precise is not None and solution.precise is not None:
            own = solution.precise[checks]
            off = np.abs(difference(own, other.precise[same]))
            turned = 2.0 if space.curved else 1.0  # a rotation turns by twice what its quaternion differs by
            inner = (off / (1.0 + np.abs(own[:, :, 0])))[:, space.z_rows].max(axis=1, initial=0.0)
            return np.asarray(np.fmax(turned * off[:, : space.nq].max(axis=1, initial=0.0), inner))
        distance = distances(space, x.T[:, :, None], other.x[:, same].T[:, :, None])[:, 0]
        # An event that ends both solutions ends each at a time of its own.
        late = np.abs(t - other.t[same]) * np.abs(space.rows(x)[1]).max(axis=1, initial=0.0)
        return np.asarray(distance + late)
