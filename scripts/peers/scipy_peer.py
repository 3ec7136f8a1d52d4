"""SciPy around pin.aba: solve_ivp's methods, and the older compiled solvers, whose loops are not in Python."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.integrate import ode, odeint, solve_ivp

from .problem import Answer, Contestant, Problem, RefusedError, Rung

Rate = Callable[[float, np.ndarray], np.ndarray]
METHODS = ("RK45", "DOP853", "LSODA", "Radau")
LEAST = 2.3e-14  # solve_ivp raises smaller rtol to 100 rounding units
STEPS = 1_000_000


def contestants(problem: Problem, tolerances: list[float]) -> Iterator[Contestant]:
    """All of SciPy's ways, with rtol = atol from `tolerances`."""
    rate = _rate(problem)
    allowed = [tol for tol in tolerances if tol >= LEAST]
    for method in METHODS:
        yield Contestant(f"SciPy {method}", [Rung(f"tol {t:.0e}", _by_solve_ivp(problem, rate, method, t))
                                             for t in allowed])  # fmt: skip
    for name, way in (("SciPy odeint (LSODA)", _by_odeint), ("SciPy ode (dop853)", _by_ode)):
        yield Contestant(name, [Rung(f"tol {t:.0e}", way(problem, rate, t)) for t in allowed])


def _rate(problem: Problem) -> Rate:
    model, data, aba = problem.model, problem.model.createData(), pin.aba
    n, still, join = model.nv, np.zeros(model.nv), np.concatenate

    def rate(t: float, x: np.ndarray) -> np.ndarray:  # noqa: ARG001
        v = x[n:]
        return join((v, aba(model, data, x[:n], v, still)))

    return rate


def _start(problem: Problem) -> np.ndarray:
    return np.concatenate([problem.scene.q, problem.scene.v])


def _by_solve_ivp(problem: Problem, rate: Rate, method: Any, tol: float) -> Callable[[], Answer]:
    start, times, n = _start(problem), problem.times, problem.model.nv

    def run() -> Answer:
        got = solve_ivp(rate, (0.0, problem.duration), start, method=method, t_eval=times, rtol=tol, atol=tol)
        if not got.success:
            raise RefusedError(got.message)
        return Answer(got.y[:n].T, got.nfev)

    return run


def _by_odeint(problem: Problem, rate: Rate, tol: float) -> Callable[[], Answer]:
    start, times, n = _start(problem), problem.times, problem.model.nv

    def run() -> Answer:
        x, notes = odeint(rate, start, times, tfirst=True, rtol=tol, atol=tol, mxstep=STEPS, full_output=True)
        if notes["message"] != "Integration successful.":
            raise RefusedError(notes["message"])
        return Answer(x[:, :n], int(notes["nfe"][-1]))

    return run


def _by_ode(problem: Problem, rate: Rate, tol: float) -> Callable[[], Answer]:
    start, times, n = _start(problem), problem.times, problem.model.nv

    def run() -> Answer:
        solver = ode(rate).set_integrator("dop853", rtol=tol, atol=tol, nsteps=STEPS)
        solver.set_initial_value(start, 0.0)
        q = [start[:n]]
        for t in times[1:]:
            q.append(solver.integrate(t)[:n])
            if not solver.successful():
                raise RefusedError(f"stopped at t = {solver.t:.4g} s")
        return Answer(np.array(q))

    return run
