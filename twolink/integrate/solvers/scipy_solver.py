"""SciPy's solvers around Pinocchio: the portable way, and the peer that faster ways are measured by."""

import importlib
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin

from twolink.effects.inputs import SAME_TIME
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.pinocchio_rate import fastest
from twolink.integrate.motion.pinocchio_rate import rate as rate_by_pinocchio
from twolink.integrate.motion.state import Array
from twolink.integrate.solution import Progress, Solution
from twolink.integrate.steps.failures import MAX_STEPS, cause, failure, is_hopeless
from twolink.integrate.steps.methods import Method
from twolink.integrate.steps.perturbation import NO_PERTURBATION, Perturbation, step_disturbances

LOOK = 8  # steps of an explicit method between two looks at how fast the motion changes
DISTURBANCES = 8  # of a solution, evenly
PACE_FROM = 5_000  # steps after which the pace so far is taken for the pace to the end
E_FOLDS = 1.0  # of what does not decay, in a step
# Methods whose steps are kept so short: from nearer to an unstable equilibrium than the tolerance, no tolerance
# shortens them. DOP853 resolves what its stability allows. The longest step of LSODA cannot be changed on the way:
# that of implicit methods is set at the start.
RESOLVING = ("RK45", "LSODA", "Radau")
EXPLICIT = ("RK45", "DOP853")
SMALLEST_TOLERANCE = 2.3e-14  # 100 times the rounding unit, below which SciPy does not go


def solve(
    equations: Equations,
    method: Method,
    times: Array,
    tolerance: float,
    progress: Progress | None = None,
    perturbation: Perturbation = NO_PERTURBATION,
) -> Solution:
    """Solve from the equations' start for the samples `times` (n,), by SciPy's solver of the method.

    tolerance: the error admitted in each step, relative and absolute. Samples come from the method's interpolation.
    Steps resolve what does not decay, those of implicit methods what does not at the start. Raises AccuracyError (codes
    "steps-collapsed", "not-finite", "too-many-steps").
    """
    if (perturbation.rounding or perturbation.restarts) and len(times) > 2:
        return _in_parts(equations, method, times, tolerance, progress, perturbation)
    tolerance = max(tolerance / perturbation.finer, SMALLEST_TOLERANCE)
    kind = getattr(importlib.import_module("scipy.integrate"), method.solver)
    rate, x0 = single_rate(equations, trials=method.solver in EXPLICIT), equations.start[: equations.moving]
    start, end = float(times[0]), float(times[-1])
    if end - start <= SAME_TIME * end:  # SciPy has no steps of a rounding
        return Solution(times, np.repeat(x0[:, None], len(times), axis=1), 0, 0)
    # In a segment of a table no step may depend on the segment alone: two tolerances would take the same steps.
    first = {"first_step": (end - start) * tolerance ** (1 / 8)} if equations.layout.tables else {}
    longest = max(1e-300, (end - start) / perturbation.min_steps(method))
    resolved = method.solver in RESOLVING
    at_first = _longest(equations, method, x0, longest, perturbation.finer) if resolved else longest
    solver = kind(rate, start, x0, end, rtol=tolerance, atol=tolerance, max_step=at_first, **first)
    out = np.empty((len(x0), len(times)))
    out[:, 0] = x0
    done, steps = 1, 0
    try:
        while solver.status == "running" and done < len(times):
            if resolved and method.solver in EXPLICIT and steps % LOOK == 0:
                solver.max_step = _longest(equations, method, solver.y, longest, perturbation.finer)
            solver.step()
            steps += 1
            _require_progress(equations, solver, steps, start)
            reached = int(np.searchsorted(times, solver.t, side="right"))
            if reached > done:
                out[:, done:reached] = solver.dense_output()(times[done:reached])
                if reached == len(times):
                    out[:, -1] = solver.y  # the last sample is a step's end: no interpolation
                done = reached
            if progress is not None:
                progress(float(solver.t))
    except KeyboardInterrupt:
        return Solution(times[:done], out[:, :done], steps, solver.nfev, interrupted=True)
    return Solution(times, out, steps, solver.nfev)


def _longest(equations: Equations, method: Method, x: Array, longest: float, finer: float) -> float:
    """The longest step that resolves what does not decay at a state, s: longer ones at higher order."""
    rates, decays = fastest(equations, np.append(x, equations.start[equations.moving :])[:, None])
    if decays[0] or not rates[0] > 0.0:
        return longest
    return min(longest, float(E_FOLDS / rates[0] * finer ** (-1 / method.order)))


def _in_parts(
    equations: Equations,
    method: Method,
    times: Array,
    tolerance: float,
    progress: Progress | None,
    perturbation: Perturbation,
) -> Solution:
    """A solution that begins anew now and then, perhaps disturbed as much as by the steps up to the next time."""
    plain = replace(perturbation, rounding=0.0, restarts=False)
    x, steps, evaluations, each = equations.start.copy(), 0, 0, 1.0
    moving, stride = equations.moving, -(-(len(times) - 1) // DISTURBANCES)
    out, disturbed = [x[:moving, None]], step_disturbances((perturbation,), x[:, None], equations)
    for i in range(0, len(times) - 1, stride):
        if disturbed is not None:
            x[:moving] += disturbed.added(np.array([i]), x[:moving, None], each)[:, 0]
        part = times[i : i + stride + 1]
        segment = solve(replace(equations, start=x), method, part, tolerance, progress, plain)
        if segment.interrupted:
            return replace(segment, t=times[:1], x=out[0])
        out.append(segment.x[:, 1:])
        x = np.concatenate([segment.x[:, -1], x[moving:]])
        each = max(1.0, float(segment.steps))
        steps, evaluations = steps + segment.steps, evaluations + segment.evaluations
    return Solution(times, np.concatenate(out, axis=1), steps, evaluations)


def single_rate(equations: Equations, *, trials: bool = False) -> Callable[[float, np.ndarray], np.ndarray]:
    """x' of one state (size,), straight from Pinocchio and without checks, since SciPy asks for it thousands of times.

    A rate that is not finite is an error: from NaN a solver would shorten its step without end. trials: but behind the
    start, where an explicit method tries a step that is too long and shortens it.
    """
    begin = equations.start[: equations.moving]
    space, model, robot = equations.space, equations.robot.model, equations.robot
    data, nq, tau, rows = model.createData(), space.nq, np.zeros(space.nv), equations.start[equations.moving :]
    bare = not equations.effects and equations.constraints is None

    def rate(t: float, x: np.ndarray) -> np.ndarray:
        if bare:
            q = robot.normalize(x[:nq]) if space.curved else x[:nq]
            out = np.concatenate([space.rate(x[:nq], x[nq:]), pin.aba(model, data, q, x[nq:], tau)])
        else:
            out = rate_by_pinocchio(equations, t, np.append(x, rows)[:, None])[: len(x), 0]
        if not math.isfinite(sum(out.tolist())) and not (trials and (x != begin).any()):
            raise failure("acceleration-not-finite", t, cause(equations, t, np.append(x, rows)))
        return out

    return rate


def _require_progress(equations: Equations, solver: Any, steps: int, start: float) -> None:
    t = float(solver.t)
    if solver.status == "failed":
        raise failure("steps-collapsed", t, cause(equations, t, np.append(solver.y, equations.start[len(solver.y) :])))
    if not np.isfinite(solver.y).all():
        raise failure("not-finite", t)
    slow = steps >= PACE_FROM and is_hopeless(steps, MAX_STEPS, t, start, solver.t_bound)
    if slow or steps >= MAX_STEPS:
        raise failure("too-many-steps", t, limit=MAX_STEPS)
