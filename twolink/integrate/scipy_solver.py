"""SciPy's solvers around any right-hand side: the portable way, and the peer that faster ways are measured by."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from twolink.errors import AccuracyError
from twolink.integrate.methods import Method

Rate = Callable[[float, np.ndarray], np.ndarray]
Progress = Callable[[float], None]

MAX_STEPS = 10_000_000
SMALLEST_TOLERANCE = 2.3e-14  # 100 times the rounding unit, below which SciPy does not go


@dataclass(frozen=True)
class Solution:
    """States x (n, size) at times t (n,); fewer than asked when `interrupted` by Ctrl-C."""

    t: np.ndarray
    x: np.ndarray
    steps: int
    evaluations: int
    interrupted: bool = False


def solver_class(method: Method) -> Any:
    """SciPy's class for a method. Its import takes a third of a second, which queries need not wait for."""
    return getattr(importlib.import_module("scipy.integrate"), method.solver)


def solve(
    rate: Rate,
    x0: np.ndarray,
    times: np.ndarray,
    method: Method,
    tolerance: float,
    progress: Progress | None = None,
) -> Solution:
    """Solve x' = rate(t, x), x(times[0]) = x0, for the samples `times` (n,), increasing.

    tolerance: the error admitted in each step, relative and absolute. Samples come from the method's own
    interpolation. Raises AccuracyError when the step size collapses or the state stops being finite.
    """
    tolerance = max(tolerance, SMALLEST_TOLERANCE)
    solver = solver_class(method)(rate, float(times[0]), x0, float(times[-1]), rtol=tolerance, atol=tolerance)
    out = np.empty((len(times), len(x0)))
    out[0] = x0
    done, steps = 1, 0
    try:
        while solver.status == "running" and done < len(times):
            message = solver.step()
            steps += 1
            _require_going_on(solver, message, steps)
            reached = int(np.searchsorted(times, solver.t, side="right"))
            if reached > done:
                out[done:reached] = solver.dense_output()(times[done:reached]).T
                if reached == len(times):
                    out[-1] = solver.y  # the last sample is a step's end: no interpolation
                done = reached
            if progress is not None:
                progress(float(solver.t))
    except KeyboardInterrupt:
        return Solution(times[:done], out[:done], steps, solver.nfev, interrupted=True)
    return Solution(times, out, steps, solver.nfev)


def _require_going_on(solver: Any, message: str | None, steps: int) -> None:
    where = f"t = {solver.t:.6g} s"
    if solver.status == "failed":
        raise AccuracyError(
            f"the step size has collapsed ({message})",
            where=where,
            remedy='the scene is stiff or singular there: try method="radau", or less accuracy',
        )
    if not np.isfinite(solver.y).all():
        raise AccuracyError("the state is not finite any more", where=where, remedy="check forces and initial state")
    if steps >= MAX_STEPS:
        raise AccuracyError(
            f"{MAX_STEPS} steps and not at the end",
            where=where,
            remedy="ask for a shorter duration or less accuracy",
        )
