"""Derivatives of accelerations by the state and by effects' numbers: exact by dual numbers, and by differences.

    a = f(t, q, v, u),   da = f_q dq + f_v dv + f_u du       (dq in the tangent space)

The formulas of the equations of motion, run on dual numbers, give the derivatives to rounding. Central differences of
Pinocchio's accelerations, which share no formula of dynamics with them, are the second way.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from twolink.algorithms.duals import Dual, DualNamespace
from twolink.algorithms.mechanism import Mechanism, mechanism
from twolink.algorithms.namespaces import Numbers
from twolink.errors import CertificationError
from twolink.integrate.effect_numbers import nominal_value, physical, with_effect_numbers
from twolink.integrate.equations import Equations
from twolink.integrate.pinocchio_rate import rate
from twolink.integrate.state import Array
from twolink.integrate.variational_steps import tangent_basis

WEIGHTS = np.array([4 / 5, -1 / 5, 4 / 105, -1 / 280])  # of central differences: their error is h^8
SHIFTS = np.array([1.0, -1.0, 2.0, -2.0, 3.0, -3.0, 4.0, -4.0])  # steps
STEPS = (0.03, 0.02, 0.01, 3e-3, 1e-3, 1e-4, 1e-5)  # rad, m, per second, N m
ENOUGH = 1e-11  # relative: two differences that agree so well are not followed by shorter steps
AGREEMENT = 1e-6  # relative
CHECKED = 3  # states of a motion
Formula = Callable[[Equations, Mechanism, Any, Any, Any], Sequence[Any]]


def derivatives_of(formula: Formula, equations: Equations, t: Array, x: Array) -> tuple[Array, Array]:
    """Accelerations, or other rows of a formula, and their derivatives, by dual numbers.

    Parameters
    ----------
    formula : callable
        Such as `integrate.formulas.accelerations`: (equations, mechanism, t, x, xp) -> m rows.
    equations : Equations
        Their p parameters are numbers of effects.
    t : ndarray (n,)
        Times, s.
    x : ndarray (size, n)
        States with the numbers of their pieces.

    Returns
    -------
    rows : ndarray (n, m)
    derivatives : ndarray (n, m, 2 nv + p)
        By q in the tangent space, v, and the parameters. NaN where the equations have none.
    """
    space, names, n = equations.space, equations.parameters, len(t)
    nq, nv, moving, count = space.nq, space.nv, space.moving, 2 * space.nv + len(names)
    seeds = np.zeros((moving, n, count))
    seeds[:nq, :, :nv] = tangent_basis(space, x[:nq]).transpose(0, 2, 1)
    seeds[nq:moving, :, nv : 2 * nv] = np.eye(nv)[:, None]
    state = np.empty(len(x), dtype=object)
    state[:] = [Dual(row[:, None], [seed]) for row, seed in zip(x[:moving], seeds, strict=True)] + [
        Dual(row[:, None], [0.0]) for row in x[moving:]
    ]
    units = np.eye(count)[2 * nv :]
    values = {name: Dual(np.full((n, 1), nominal_value(equations, name)), [np.broadcast_to(unit, (n, count))])
              for name, unit in zip(names, units, strict=True)}  # fmt: skip
    xp = DualNamespace(Numbers)
    own = with_effect_numbers(equations, values)
    with np.errstate(all="ignore"):
        mech = mechanism(equations.robot.model, physical(values))
        rows = formula(own, mech, Dual(t[:, None], [0.0]), space.normalized(state, xp), xp)
    out, derivatives = np.zeros((n, len(rows))), np.zeros((n, len(rows), count))
    for k, row in enumerate(rows):
        if isinstance(row, Dual):
            out[:, k] = np.broadcast_to(row.value, (n, 1))[:, 0]
            derivatives[:, k] = row.tangents[0]
        else:
            out[:, k] = row
    return out, derivatives


def derivatives_by_differences(equations: Equations, t: float, x: Array) -> tuple[Array, float]:
    """The derivatives (nv, 2 nv + p) at one state x (size,) by differences, and a bound on their error.

    Each column is taken with shorter and shorter steps; the error is the distance of the two next to each other that
    agree best.
    """
    nv, names, columns, worst = equations.space.nv, equations.parameters, list[Array](), 0.0
    for k in range(2 * nv + len(names)):
        before, column, least = np.full(nv, np.nan), np.full(nv, np.nan), np.inf
        for step in STEPS:
            a = _accelerations_beside(equations, t, x, k, step * SHIFTS)
            found = (a[:, ::2] - a[:, 1::2]) @ WEIGHTS / step
            distance = float(np.abs(found - before).max(initial=0.0))
            if distance < least:
                column, least = found, distance
            if least <= ENOUGH * (1.0 + float(np.abs(found).max(initial=0.0))):
                break
            before = found
        columns.append(column)
        worst = max(worst, least)
    return np.array(columns).T, worst


def certified(equations: Equations, t: Array, x: Array, derivatives: Array) -> float:
    """A bound on the error of derivatives (n, nv, .), from differences at some of the states.

    Raises CertificationError where they disagree.
    """
    bad = np.flatnonzero(~np.isfinite(derivatives).all(axis=(1, 2)))
    chosen = bad[:1] if len(bad) else np.unique(np.linspace(0, len(t) - 1, CHECKED).round().astype(int))
    error = 0.0
    for i in chosen:
        theirs, own = derivatives_by_differences(equations, float(t[i]), x[:, i])
        distance = float(np.abs(derivatives[i] - theirs).max(initial=0.0))
        if not distance <= AGREEMENT * (1.0 + float(np.abs(theirs).max(initial=0.0))):
            raise CertificationError(
                f"derivatives differ from differences of Pinocchio's accelerations by {distance:.1e}",
                where=f"t = {t[i]:g} s, x = {x[: equations.moving, i].tolist()}",
                remedy="ask for a state where forces are smooth; else report it with the URDF",
            )
        error = max(error, distance + own)
    return error + 8.0 * float(np.finfo(float).eps * np.abs(derivatives).max(initial=0.0))


def _accelerations_beside(equations: Equations, t: float, x: Array, k: int, shifts: Array) -> Array:
    """Pinocchio's accelerations (nv, m) at the state moved along direction k of (dq, dv, parameters) by shifts (m,)."""
    space, out = equations.space, np.repeat(x[:, None], len(shifts), axis=1)
    if k >= 2 * space.nv:
        name = equations.parameters[k - 2 * space.nv]
        values = nominal_value(equations, name) + shifts
        others = (replace(with_effect_numbers(equations, {name: value}), parameters=()) for value in values)
        out = np.concatenate([rate(other, t, x[:, None]) for other in others], axis=1)
        return out[space.nq : space.moving]
    if k >= space.nv:
        out[space.nq + k - space.nv] += shifts
    else:
        steps = np.outer(shifts, np.eye(space.nv)[k])
        out[: space.nq] = equations.robot.integrate(np.tile(x[: space.nq], (len(shifts), 1)), steps).T
    return rate(equations, t, out)[space.nq : space.moving]
