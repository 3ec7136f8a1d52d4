"""SciPy around pin.aba: solve_ivp's methods, and the older compiled solvers, whose loops are not in Python.

Quaternions are normalized before each evaluation, as a careful user does it.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
import scipy
from scipy.integrate import ode, odeint, solve_ivp

from twolink.effects.inputs import value_at
from twolink.hard.case import StateHistory
from twolink.hard.peers.task import PeerError, PeerRun, PeerTask, Setting, tolerances
from twolink.integrate.motion.state import StateSpace

VERSION = scipy.__version__
SIMULATES, SOFTENS = frozenset({"springs", "damping", "torques", "armature"}), frozenset[str]()
TIGHT = 1e-12
SMALLEST = 2.3e-14  # solve_ivp raises a smaller rtol to 100 rounding units
MAX_STEPS = 1_000_000
ODEINT, ODE = "odeint (LSODA)", "ode (dop853)"
METHODS = ("RK45", "DOP853", "LSODA", "Radau", ODEINT, ODE)
Rate = Callable[[float, np.ndarray], np.ndarray]


def usual_settings(task: PeerTask) -> list[Setting]:
    """solve_ivp with its defaults, and with a method of order 8 at a tolerance near rounding."""
    del task
    return [Setting("RK45", "default: rtol 1e-3, atol 1e-6", default=True),
            Setting("DOP853", f"rtol = atol = {TIGHT:.0e}", TIGHT)]  # fmt: skip


def all_settings(task: PeerTask, coarse: bool) -> list[Setting]:
    """All methods with rtol = atol."""
    del task
    return [Setting(m, f"tol {tol:.0e}", tol) for m in METHODS for tol in tolerances(coarse) if tol >= SMALLEST]


def prepare(task: PeerTask, setting: Setting) -> Callable[[], PeerRun]:
    """The function that solves the task at the setting. Raises UnsupportedError."""
    task.require(SIMULATES)
    solve = {ODEINT: _by_odeint, ODE: _by_ode}.get(setting.method, _by_solve_ivp)
    rate, start, model = _rate(task), np.concatenate([task.q, task.v]), task.model

    def run() -> PeerRun:
        x, evaluations = solve(rate, start, task.times, setting)
        q, v = x[:, : model.nq], x[:, model.nq :]
        if model.nq != model.nv:
            q = np.array([pin.normalize(model, row) for row in q])
        return PeerRun(StateHistory(task.times, q, v), evaluations)

    return run


def accelerations(task: PeerTask) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """a (nv,) of q and v by pin.aba, without torques."""
    model, data, zero = task.model, task.model.createData(), np.zeros(task.model.nv)
    return lambda q, v: pin.aba(model, data, q, v, zero)


def _by_solve_ivp(rate: Rate, start: np.ndarray, times: np.ndarray, setting: Setting) -> tuple[np.ndarray, int]:
    tolerance = {} if setting.tolerance is None else {"rtol": setting.tolerance, "atol": setting.tolerance}
    got = solve_ivp(rate, (0.0, float(times[-1])), start, method=setting.method, t_eval=times, **tolerance)
    if not got.success:
        raise PeerError(got.message)
    return got.y.T, got.nfev


def _by_odeint(rate: Rate, start: np.ndarray, times: np.ndarray, setting: Setting) -> tuple[np.ndarray, int]:
    tol = setting.tolerance
    x, notes = odeint(rate, start, times, tfirst=True, rtol=tol, atol=tol, mxstep=MAX_STEPS, full_output=True)
    if notes["message"] != "Integration successful.":
        raise PeerError(notes["message"])
    return x, int(notes["nfe"][-1])


def _by_ode(rate: Rate, start: np.ndarray, times: np.ndarray, setting: Setting) -> tuple[np.ndarray, None]:
    solver = ode(rate).set_integrator("dop853", rtol=setting.tolerance, atol=setting.tolerance, nsteps=MAX_STEPS)
    solver.set_initial_value(start, 0.0)
    x = [start]
    for t in times[1:]:
        x.append(solver.integrate(t))
        if not solver.successful():
            raise PeerError(f"stopped at t = {solver.t:.4g} s")
    return np.array(x), None


def _rate(task: PeerTask) -> Rate:
    """(q', v') of the state; the shortest code that does it, since it is what SciPy is timed with."""
    model, data, nq, join = task.model, task.model.createData(), task.model.nq, np.concatenate
    zero, torque, aba = np.zeros(model.nv), _torque(task), pin.aba

    def flat(t: float, x: np.ndarray) -> np.ndarray:
        v = x[nq:]
        return join((v, aba(model, data, x[:nq], v, torque(t, x) if torque else zero)))

    if model.nq == model.nv:
        return flat
    space = StateSpace(task.robot)

    def curved(t: float, x: np.ndarray) -> np.ndarray:
        q, v = x[:nq], x[nq:]
        a = aba(model, data, pin.normalize(model, q), v, torque(t, x) if torque else zero)
        return join((np.asarray(space.rate(q, v), dtype=float), a))

    return curved


def _torque(task: PeerTask) -> Rate | None:
    """The joint torques of springs, dampers and inputs, or None where there are none."""
    if not (task.springs or task.damping or task.torques):
        return None
    nq, joints = task.model.nq, {joint.name: joint for joint in task.joints}
    springs = [(joints[n].q.start, joints[n].v.start, *spring) for n, spring in task.springs.items()]
    dampers = [(k, d) for n, d in task.damping.items() for k in range(joints[n].v.start, joints[n].v.stop)]
    inputs: list[tuple[int, Any]] = [(joints[n].v.start, one) for n, every in task.torques.items() for one in every]

    def torque(t: float, x: np.ndarray) -> np.ndarray:
        tau = np.zeros(task.model.nv)
        for iq, iv, stiffness, rest in springs:
            tau[iv] -= stiffness * (x[iq] - rest)
        for iv, damping in dampers:
            tau[iv] -= damping * x[nq + iv]
        for iv, value in inputs:
            tau[iv] += value_at(value, t, np)
        return tau

    return torque
