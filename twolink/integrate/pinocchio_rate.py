"""The reference of accelerations: Pinocchio's algorithms, state by state. What is compiled is compared with it."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from twolink.algorithms.namespaces import Numbers
from twolink.effects.loop import Loop
from twolink.errors import QueryError
from twolink.integrate.constraints import Loops, locked_matrix
from twolink.integrate.state import Array

if TYPE_CHECKING:
    from twolink.integrate.equations import Equations


def accelerations(equations: Equations, t: Any, q: Array, v: Array, rows: Sequence[Array]) -> Array:
    """v' (n, nv) of states q (n, nq), v (n, nv) at a time, or a time each; rows: what rides along, (n,) each."""
    if equations.loops is not None or equations.lockable:
        return _bound(equations, t, q, v, rows)
    if not equations.effects:
        with contextlib.suppress(QueryError):  # one state that overflows: the others are answered one by one
            return np.asarray(equations.robot.forward_dynamics(q, v, np.zeros(equations.space.nv), engine="pinocchio"))
    with np.errstate(all="ignore"):  # what is not finite is said below
        effects = equations.now(equations.effects, rows)
        loads = equations.loads(equations.numbers, list(q.T), list(v.T), t, Numbers, effects)
    tau = np.zeros(v.shape)
    for k, value in enumerate(loads.tau):
        tau[:, k] = value
    model, data, out = equations.robot.model, equations.robot.data, np.empty_like(v)
    wrenches = {i: np.stack(np.broadcast_arrays(*w, q[:, 0])[:6], axis=1) for i, w in loads.wrenches.items()}
    forces = pin.StdVec_Force()
    forces.extend(pin.Force.Zero() for _ in range(model.njoints))
    for row in range(len(q)):
        for i, wrench in wrenches.items():
            forces[i] = pin.Force(wrench[row])
        out[row] = pin.aba(model, data, q[row], v[row], tau[row], forces)
    return out


def _bound(equations: Equations, t: Any, q: Array, v: Array, rows: Sequence[Array]) -> Array:
    """Accelerations under loops and locks, state by state."""
    model, data, out = equations.robot.model, equations.robot.data, np.empty_like(v)
    times = np.broadcast_to(t, len(q))
    for row in range(len(q)):
        numbers = [values[row] for values in rows]
        loads = equations.loads(equations.numbers, list(q[row]), list(v[row]), float(times[row]), Numbers,
                           equations.now(equations.effects, numbers))  # fmt: skip
        equations.rub(loads.tau, numbers)
        forces = pin.StdVec_Force()
        forces.extend(pin.Force.Zero() for _ in range(model.njoints))
        for i, wrench in loads.wrenches.items():
            forces[i] = pin.Force(np.array(wrench, dtype=float))
        free = np.array(equations.free(numbers), dtype=float)
        bias = pin.rnea(model, data, q[row], v[row], np.zeros(equations.space.nv), forces)
        right = free * (np.array(loads.tau, dtype=float) - bias)
        mass: Array = np.array(locked_matrix(pin.crba(model, data, q[row]).tolist(), free.tolist()))
        if equations.loops is None:
            out[row] = np.linalg.solve(mass, right)
        else:
            now = equations.now(equations.loops.loops, numbers)
            out[row] = loop_acceleration(equations.loops, q[row], v[row], right, mass, free, now)
    return out


def loop_acceleration(
    loops: Loops,
    q: np.ndarray,
    v: np.ndarray,
    right: np.ndarray,
    mass: np.ndarray,
    free: np.ndarray,
    now: Sequence[Loop],
) -> np.ndarray:
    """a of one state by Pinocchio's mass matrix and least squares of the rows that are kept.

    Of those alone: beside g = 0, where a step's stages are, a redundant row contradicts the others. right: tau - h;
    both it and the mass matrix are of what is not locked. now: the loops with the numbers of the moment.
    """
    jacobian = loops.numbers(q, loops.kept) * free
    second = np.array([float(row) for row in loops.velocity_terms(loops.mech, q, v, Numbers)[1]])
    pushes = loops.pushes(loops.mech, q, v, Numbers, jacobian.tolist(), now)
    unbound = np.linalg.solve(mass, right)
    root = np.linalg.cholesky(mass)
    scaled, pushed = (np.linalg.solve(root, np.array(rows, dtype=float).reshape(jacobian.shape).T * free[:, None])
                      for rows in (jacobian, pushes))  # fmt: skip
    wanted = -second - jacobian @ unbound
    if np.array_equal(scaled, pushed):
        correction = np.linalg.lstsq(scaled.T, wanted, rcond=1e-10)[0]
    else:
        correction = pushed @ np.linalg.solve(scaled.T @ pushed, wanted)
    return np.asarray(unbound + np.linalg.solve(root.T, correction))
