"""Solutions that are solved anew from each tick to the next, by methods that are not steps of a step map."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.state import Array
from twolink.integrate.solution import Code, Progress, Solution
from twolink.integrate.steps.methods import Method
from twolink.integrate.steps.perturbation import Perturbation, disturbances

Solve = Callable[[Equations, Array, Perturbation], Solution]  # from the start of equations for samples


class Restarted:
    """Solutions of one scene side by side, as `Lanes` are; each piece between two ticks is a solution of its own.

    Parameters
    ----------
    equations : Equations
        Without sampling.
    method : Method
    t : float
        Time of the start, s.
    perturbations : tuple of Perturbation
        Of each.
    solve : callable
        (equations, times, perturbation) -> Solution.
    progress : callable, optional
        Called with the time.

    Attributes
    ----------
    x : ndarray (size, n)
        The states with the numbers that they hold.
    time : float
        Where they are, s.
    step : float
        0: they are never beyond the time that is asked for.
    counts : tuple of int
        Accepted and rejected steps of the first.
    """

    def __init__(
        self,
        equations: Equations,
        method: Method,
        t: float,
        perturbations: tuple[Perturbation, ...],
        solve: Solve,
        progress: Progress | None = None,
    ) -> None:
        self.method, self.time, self.counts = method, t, (0, 0)
        self.x = np.repeat(equations.start[:, None].astype(float), len(perturbations), axis=1)
        self.compile_seconds = self.step = 0.0
        self.beside = 0  # each is solved by itself
        self.compiled: Code = ""
        self._equations, self._perturbations, self._solve, self._progress = equations, perturbations, solve, progress
        self._ticks, self._steps = 0, 1.0

    def advance(self, end: float, *_: object) -> Array:
        """Advance all to a time, s, with no states on the way."""
        moving, times = self._equations.moving, np.array([self.time, end])
        count = np.full((1, 1), self._ticks)
        for i, one in enumerate(self._perturbations):
            x = self.x[:, i].copy()
            if one.rounding:
                x[:moving] += disturbances((one,), count, x[:moving, None], self._equations, self._steps)[0, :, 0]
            solution = self._solve(replace(self._equations, start=x), times, replace(one, rounding=0.0))
            if solution.interrupted:
                raise KeyboardInterrupt
            self.x[:moving, i] = solution.x[:moving, -1]
            self.compile_seconds, self.compiled = self.compile_seconds + solution.compile_seconds, solution.compiled
            if i == 0:
                self.counts = self.counts[0] + solution.steps, self.counts[1] + solution.rejected
                self._steps = float(max(1, solution.steps))
        self.time, self._ticks = end, self._ticks + 1
        if self._progress is not None:
            self._progress(end)
        return np.empty(0)

    def partial(self, x: Array, start: Array, end: Array) -> Array:
        """States (size, n) of the first solution at times `end` (n,), each from x (size, n) at `start` (n,)."""
        out, one = x.copy(), self._perturbations[0]
        for k, times in enumerate(np.stack([start, end], axis=1)):
            solution = self._solve(replace(self._equations, start=x[:, k].copy()), times, one)
            out[: self._equations.moving, k] = solution.x[: self._equations.moving, -1]
        return out
