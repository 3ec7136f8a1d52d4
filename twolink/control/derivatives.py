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

WEIGHTS = (4 / 5, -1 / 5, 4 / 105, -1 / 280)  # of central differences, whose error is the eighth power of the step
STEPS = (0.1, 0.03, 0.01, 3e-3, 1e-3, 1e-4, 1e-5)  # rad, m, per second, N m; the two that agree best are taken
AGREEMENT = 1e-6  # relative
CHECKED = 5  # states of a motion
Formula = Callable[[Equations, Mechanism, Any, Any, Any], Sequence[Any]]


def derivatives_of(formula: Formula, equations: Equations, t: Array, x: Array) -> tuple[Array, Array]:
    """Accelerations, or other rows of a formula, and their derivatives, by dual numbers.

    Parameters
    ----------
    formula : callable
        Such as `integrate.formulas.accelerations`: (equations, mechanism, t, x, xp) -> nv rows.
    equations : Equations
        Their p parameters are numbers of effects.
    t : ndarray (n,)
        Times, s.
    x : ndarray (size, n)
        States with the numbers of their pieces.

    Returns
    -------
    rows : ndarray (n, nv)
    derivatives : ndarray (n, nv, 2 nv + p)
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
    out, derivatives = np.zeros((n, nv)), np.zeros((n, nv, count))
    for k, row in enumerate(rows):
        if isinstance(row, Dual):
            out[:, k] = np.broadcast_to(row.value, (n, 1))[:, 0]
            derivatives[:, k] = row.tangents[0]
        else:
            out[:, k] = row
    return out, derivatives


def derivatives_by_differences(equations: Equations, t: float, x: Array) -> tuple[Array, float]:
    """The derivatives (nv, 2 nv + p) at one state x (size,) by differences, and a bound on their error.

    Each column is taken with the two steps next to each other that agree best; their distance is its error.
    """
    nv, names = equations.space.nv, equations.parameters
    values = {name: nominal_value(equations, name) for name in names}
    shifts = np.array([sign * m * h for h in STEPS for m in (1, 2, 3, 4) for sign in (1, -1)])
    columns: list[Array] = []
    worst = 0.0
    for k in range(2 * nv + len(names)):
        if k < 2 * nv:
            a = rate(equations, t, _moved(equations, x, k, shifts))[equations.space.nq : equations.space.moving]
        else:
            name = names[k - 2 * nv]
            a = np.concatenate([_rate_with(equations, t, x, name, values[name] + shift) for shift in shifts], axis=1)
        pairs = (a[:, ::2] - a[:, 1::2]).reshape(nv, len(STEPS), 4)
        found = pairs @ np.array(WEIGHTS) / np.array(STEPS)
        distance = np.abs(np.diff(found, axis=1)).max(axis=0)
        best = int(np.argmin(np.where(np.isnan(distance), np.inf, distance)))
        columns.append(found[:, best + 1])
        worst = max(worst, float(distance[best]))
    return np.array(columns).T, worst


def certified(equations: Equations, t: Array, x: Array, derivatives: Array) -> float:
    """A bound on the error of derivatives (n, nv, .), from differences at up to five of the states.

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


def _moved(equations: Equations, x: Array, k: int, shifts: Array) -> Array:
    """The state moved along direction k of the tangent space by each shift, (size, len(shifts))."""
    space, out = equations.space, np.repeat(x[:, None], len(shifts), axis=1)
    if k >= space.nv:
        out[space.nq + k - space.nv] += shifts
    else:
        steps = np.zeros((len(shifts), space.nv))
        steps[:, k] = shifts
        out[: space.nq] = equations.robot.integrate(np.tile(x[: space.nq], (len(shifts), 1)), steps).T
    return out


def _rate_with(equations: Equations, t: float, x: Array, name: str, value: float) -> Array:
    """The accelerations (nv, 1) with another value of a parameter."""
    other = replace(with_effect_numbers(equations, {name: value}), parameters=())
    return rate(other, t, x[:, None])[other.space.nq : other.space.moving]
