"""SciPy's solve_ivp around pin.aba, as a careful user writes it: quaternions are normalized before each call."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

from twolink.hard.case import Track
from twolink.hard.peers.problem import CannotError, Clock, Problem, SaidError, Way, value
from twolink.integrate.state import StateSpace

TIGHT = 1e-12
Rate = Callable[[float, np.ndarray], np.ndarray]


def ways(problem: Problem) -> Iterator[Way]:
    """solve_ivp with its defaults, and with an order-8 method at a tolerance near rounding."""
    if problem.loops:
        raise CannotError("solve_ivp has no constraints, and pin.aba no loops")
    yield Way("solve_ivp default: RK45, rtol 1e-3, atol 1e-6", lambda: _solve(problem, {}))
    tight = {"method": "DOP853", "rtol": TIGHT, "atol": TIGHT}
    yield Way(f"solve_ivp DOP853, rtol = atol = {TIGHT:.0e}", lambda: _solve(problem, tight))


def _solve(problem: Problem, options: dict[str, object]) -> Track:
    start = np.concatenate([problem.scene.q, problem.scene.v])
    times = problem.times
    got = solve_ivp(_rate(problem), (0.0, float(times[-1])), start, t_eval=times, **options)
    if not got.success:
        raise SaidError(got.message)
    nq = problem.model.nq
    q = got.y[:nq].T.copy()
    for row in q:
        row[:] = pin.normalize(problem.model, row)
    return Track(got.t, q, got.y[nq:].T)


def _rate(problem: Problem) -> Rate:
    model, clock = problem.model, Clock()
    data, nq, space = model.createData(), model.nq, StateSpace(problem.scene.robot)
    by_name = {joint.name: joint for joint in problem.joints}
    springs = [
        (by_name[n].q.start, by_name[n].v.start, k, problem.rest.get(n, 0.0)) for n, k in problem.stiffness.items()
    ]
    dampers = [(by_name[n].v, d) for n, d in problem.damping.items()]
    torques = [(by_name[n].v.start, given) for n, given in problem.torques.items()]

    def rate(t: float, x: np.ndarray) -> np.ndarray:
        clock(t)
        q, v = x[:nq], x[nq:]
        tau = np.zeros(model.nv)
        for iq, iv, k, rest in springs:
            tau[iv] -= k * (q[iq] - rest)
        for iv, d in dampers:
            tau[iv] -= d * v[iv]
        for iv, given in torques:
            tau[iv] += value(given, t)
        if model.nq == model.nv:
            return np.concatenate([v, pin.aba(model, data, q, v, tau)])
        a = pin.aba(model, data, pin.normalize(model, q), v, tau)
        return np.concatenate([np.asarray(space.rate(q, v), dtype=float), a])

    return rate
