"""The rate x' by Pinocchio's algorithms, state by state: the reference that compiled steps are compared with.

The fastest rate of change of equations, and whether that mode decays, are found by differences of it.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from twolink.algorithms.namespaces import Numbers
from twolink.effects.loops import Loop
from twolink.integrate.motion.constraints import Constraints, locked_matrix
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.formulas import loaded, state_rates
from twolink.integrate.motion.state import Array


def rate(equations: Equations, t: Any, x: Array) -> Array:
    """x' (size, n) of states x (size, n), at one time or a time each. NaN where a state is not finite."""
    space = equations.space
    q, v = space.rows(x)
    behind = slice(space.nq, space.moving)  # v and z
    with np.errstate(all="ignore"):
        finite = np.isfinite(x).all(axis=0)
    rates = np.full_like(x[behind], np.nan)
    if finite.any():
        at = t if np.ndim(t) == 0 else t[finite]
        rates[:, finite] = _accelerations(equations, at, q[finite], v[finite], x[space.z_rows.start :, finite])
    constant = np.zeros((len(x) - space.moving, x.shape[1]))
    return np.concatenate([space.rate(x[: space.nq], x[space.v_rows]), rates, constant])


def _accelerations(equations: Equations, t: Any, q: Array, v: Array, behind: Array) -> Array:
    """(a, z') (., n): by the articulated-body algorithm, or under constraints and locks by the mass matrix.

    behind: z and the numbers of the piece, (., n).
    """
    layout, constraints = equations.layout, equations.constraints
    bound = constraints is not None or bool(layout.lockable)
    with np.errstate(all="ignore"):  # what is not finite is NaN or infinite in the result
        x = np.concatenate([q.T, v.T, behind])
        numbers, (_, loads) = x[equations.moving :], loaded(equations, equations.mechanism, t, x, Numbers)
        for k, torque in layout.friction(list(numbers)):
            loads.torque(k, torque)
    tau, free = np.zeros(v.shape), np.ones(v.shape)
    for k, (torque, unlocked) in enumerate(zip(loads.tau, layout.free(list(numbers)), strict=True)):
        tau[:, k], free[:, k] = torque, unlocked
    model, data, out = equations.robot.model, equations.robot.data, np.empty_like(v)
    wrenches = {i: np.stack(np.broadcast_arrays(*w, q[:, 0])[:6], axis=1) for i, w in loads.wrenches.items()}
    forces = pin.StdVec_Force()
    forces.extend(pin.Force.Zero() for _ in range(model.njoints))
    for row in range(len(q)):
        for i, wrench in wrenches.items():
            forces[i] = pin.Force(wrench[row])
        if not bound:
            out[row] = pin.aba(model, data, q[row], v[row], tau[row], forces)
            continue
        right = free[row] * (tau[row] - pin.rnea(model, data, q[row], v[row], np.zeros(model.nv), forces))
        mass: Array = np.array(locked_matrix(pin.crba(model, data, q[row]).tolist(), free[row].tolist()))
        if constraints is None:
            out[row] = np.linalg.solve(mass, right)
        else:
            loops = layout.with_numbers(constraints.loops, list(numbers[:, row]))
            out[row] = constrained_acceleration(constraints, q[row], v[row], right, mass, free[row], loops)
    rates = [np.broadcast_to(rate, len(q)) for rate in state_rates(equations, loads)]
    return np.concatenate([out.T, *(rate[None] for rate in rates)])


def constrained_acceleration(
    constraints: Constraints,
    q: np.ndarray,
    v: np.ndarray,
    right: np.ndarray,
    mass: np.ndarray,
    free: np.ndarray,
    loops: Sequence[Loop],
) -> np.ndarray:
    """a of one state by Pinocchio's mass matrix and least squares of the rows that are kept.

    Of those alone: beside g = 0, where a step's stages are, a redundant row contradicts the others. right: tau - h;
    both it and the mass matrix are without locked degrees of freedom. loops: with the numbers of the piece.
    """
    mech = constraints.mech
    jacobian = constraints.jacobian_at(q, constraints.kept) * free
    second = np.array([float(row) for row in constraints.velocity_terms(mech, q, v, Numbers)])
    forces = constraints.force_rows(mech, q, v, Numbers, jacobian.tolist(), loops)
    a_free = np.linalg.solve(mass, right)
    root = np.linalg.cholesky(mass)
    scaled, forced = (np.linalg.solve(root, np.array(rows, dtype=float).reshape(jacobian.shape).T * free[:, None])
                      for rows in (jacobian, forces))  # fmt: skip
    wanted = -second - jacobian @ a_free
    if np.array_equal(scaled, forced):
        correction = np.linalg.lstsq(scaled.T, wanted, rcond=1e-10)[0]
    else:
        correction = forced @ np.linalg.solve(scaled.T @ forced, wanted)
    return np.asarray(a_free + np.linalg.solve(root.T, correction))


ITERATIONS = 4
STEP = 1e-7  # relative, of differences
DECAYING = -0.99  # the cosine between a direction and what the Jacobian makes of it: below, the mode only decays
NEIGHBOURS, SPREAD = 4, 0.5  # states near the start, and their distance in q, rad or m


def fastest_decay(equations: Equations) -> float:
    """The rate of the fastest mode [1/s] where it decays, else 0: at the start, or near it by the median.

    The median: beside a singular position a rate may be large that the motion never meets. Under constraints the start
    alone counts, as states near it do not fulfil them.
    """
    space, start = equations.space, equations.start
    if space.size == 0:
        return 0.0
    states, random = [start], np.random.default_rng(0)
    for _ in range(NEIGHBOURS if equations.constraints is None else 0):
        q = equations.robot.integrate(start[: space.nq], random.uniform(-SPREAD, SPREAD, space.nv))
        states.append(np.concatenate([q, start[space.nq :]]))
    rates, decays = fastest(equations, np.stack(states, axis=1))
    rates = np.where(decays, rates, 0.0)
    return float(max(rates[0], np.median(rates)))


def fastest(equations: Equations, x: Array) -> tuple[Array, Array]:
    """(rates [1/s] (n,), whether that mode decays (n,)) at states x (size, n), by the power method on differences."""
    start = rate(equations, 0.0, x)
    largest, cosine = np.zeros(x.shape[1]), np.zeros(x.shape[1])
    direction = np.where(np.isfinite(start), start, 0.0) + 1e-3
    with np.errstate(all="ignore"):
        for _ in range(ITERATIONS):
            size = np.sqrt((direction**2).sum(axis=0))
            direction = direction / np.where(size > 0.0, size, 1.0)
            step = STEP * (1.0 + np.abs(x).max(axis=0, initial=0.0))
            image = (rate(equations, 0.0, x + step * direction) - start) / step
            image = np.where(np.isfinite(image), image, 0.0)
            length = np.sqrt((image**2).sum(axis=0))
            cosine = (image * direction).sum(axis=0) / np.where(length > 0.0, length, 1.0)
            largest = np.fmax(largest, length)
            direction = image
    return largest, cosine < DECAYING
