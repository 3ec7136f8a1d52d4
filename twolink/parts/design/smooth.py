"""The smooth equations that hold around a state, derivatives of their accelerations, and the independent coordinates
of robots with closed loops.

    a = f(t, q, v, u),   da = f_q dq + f_v dv + f_u du       (dq in the tangent space)

The formulas of the equations of motion, run on dual numbers, give the derivatives to rounding. Central differences of
Pinocchio's accelerations, which share no formula of dynamics with them, are the second way.

Loops leave some degrees of freedom independent; those of their other joints follow:

    J dq = 0,   J dv + (d(J v)/dq) dq = 0        (rows of the loops, differentiated along allowed motions)
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from twolink.algorithms.dual_numbers import Dual, DualNamespace
from twolink.algorithms.mechanism import Mechanism, mechanism
from twolink.algorithms.namespaces import Numbers
from twolink.algorithms.tape import Tape
from twolink.errors import CertificationError, SceneError
from twolink.integrate.derivatives.variational_steps import tangent_basis
from twolink.integrate.hybrid.state import RunState
from twolink.integrate.hybrid.transitions import fire_timed, guards_of
from twolink.integrate.motion.assembly import RANK, assembled
from twolink.integrate.motion.constraints import Constraints
from twolink.integrate.motion.effect_numbers import nominal_value, physical, with_effect_numbers
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.formulas import accelerations
from twolink.integrate.motion.pinocchio_rate import rate
from twolink.integrate.motion.scene_equations import with_parameters, with_starting_states
from twolink.integrate.motion.state import Array

WEIGHTS = np.array([4 / 5, -1 / 5, 4 / 105, -1 / 280])  # of central differences: their error is h^8
SHIFTS = np.array([1.0, -1.0, 2.0, -2.0, 3.0, -3.0, 4.0, -4.0])  # steps
STEPS = (0.03, 0.02, 0.01, 3e-3, 1e-3, 1e-4, 1e-5)  # rad, m, per second, N m
ENOUGH = 1e-11  # relative: two differences that agree so well are not followed by shorter steps
AGREEMENT = 1e-6  # relative
CHECKED = 3  # states of a motion
PHASES = np.array([0.0, 0.137, 0.421, 0.788])  # parts of a period at which forces are compared
REPEATS = 1e-9  # relative: forces that differ by less repeat
Formula = Callable[[Equations, Mechanism, Any, Any, Any], Sequence[Any]]


def equations_at(equations: Equations, t: float, q: Array, v: Array) -> Equations:
    """The equations of the mode that holds at a state, which is their start, loops closed; with the same parameters.

    Raises SceneError, code "not-differentiable", where a joint is locked, bodies touch, or an event is due; or where a
    table or a curve does not reach to t.
    """
    equations.require(t, t)
    x = np.concatenate([q, v])
    held = RunState(equations, t).own.equations if equations.has_events else equations  # loops at that time
    if held.constraints is not None:
        x = assembled(held.constraints, x)
    x = with_starting_states(equations, x)
    if not equations.has_events:
        return replace(equations, start=np.concatenate([x, equations.layout.numbers_at(t)]))
    run = RunState(replace(equations, start=np.concatenate([x, equations.start[equations.moving :]])), t)
    run.require_room("the state")
    run.resolve_mode()
    fire_timed(run)
    run.resolve_mode()
    if run.ended or not np.array_equal(run.x, x):
        raise _not_smooth("an event changes the state there")
    _require_no_contact(run)
    for guard in guards_of(run, run.evaluate()):
        if guard.at_zero:
            kind, number = guard.key
            raise _not_smooth(f"{_name(run, kind, number)} is where its force changes abruptly")
    return replace(with_parameters(run.own.equations, equations.parameters), start=run.full_state())


def depends_on_time(equations: Equations) -> bool:
    """True if accelerations depend on time for a given state.

    They do by tables or formulas of time, and by effects that begin or cease to act at a time.
    """
    timed = [] if equations.switching is None else equations.switching.timed
    if equations.layout.tables or any(trigger.drops or trigger.begins for trigger in timed):
        return True
    tape = Tape()
    t = tape.variable()
    x = [tape.variable() for _ in range(equations.space.size)]
    rows = accelerations(replace(equations, parameters=()), equations.mechanism, t, x, tape)
    return any(t.key in tape.inputs(row) for row in rows)


def require_constant_forces(equations: Equations, else_what: str) -> None:
    """Refuse forces that depend on time. Raises SceneError, code "depends-on-time"; else_what: why they may not."""
    if depends_on_time(equations):
        raise SceneError(
            f"its forces depend on time{else_what}", where="scene", code="depends-on-time",
            remedy="leave out effects with functions of time, or that begin or cease at a time",
        )  # fmt: skip


def require_repeating(equations: Equations, period: float, states: Array) -> None:
    """Require forces that are the same a period later, at states (n, moving) of its PHASES. Raises SceneError."""
    for t, x in zip(period * PHASES, states, strict=True):
        now, later = (rate(equations, s, np.concatenate([x, equations.layout.numbers_at(s)])[:, None])
                      for s in (float(t), float(t + period)))  # fmt: skip
        moving = slice(equations.space.nq, equations.moving)
        if np.abs(now[moving] - later[moving]).max() > REPEATS * (1.0 + np.abs(now[moving]).max()):
            raise SceneError(f"forces depend on time and do not repeat after {period:g} s", argument="period",
                             remedy="give a multiple of their period", code="depends-on-time")  # fmt: skip


def _require_no_contact(run: RunState) -> None:
    """Require that nothing holds a joint and no bodies touch."""
    fixed = [run.system.names[k] for k in sorted(run.mode.locked)]
    fixed += [contact.name for contact, mode in zip(run.system.contacts, run.mode.contacts, strict=True)
             if mode != "free"]  # fmt: skip
    if fixed:
        raise _not_smooth(f"{', '.join(fixed)} is locked by friction, a stop or a contact")


def _not_smooth(why: str) -> SceneError:
    return SceneError(f"the forces have no derivatives at this state: {why}", where="q, v",
                      remedy="ask for a state inside one mode, or leave that effect out: scene.without(index)",
                      code="not-differentiable")  # fmt: skip


def _name(run: RunState, kind: str, number: int) -> str:
    """The joint, contact or trigger that a guard watches, by its name."""
    if kind == "stop":
        return f"joint {run.system.stops[number].name!r} at its stop"
    if kind in ("impact", "leave", "slide", "roll"):
        return f"contact {run.system.contacts[number].name!r}"
    if kind == "trigger":
        return f"{run.system.triggers[number][1].name!r}"
    return f"joint {run.system.names[number]!r}"


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
    derivatives : ndarray (n, m, tangent + p)
        By q in the tangent space, v, the states of effects, and the parameters. NaN where the equations have none.
    """
    space, names, n = equations.space, equations.parameters, len(t)
    nq, nv, moving, count = space.nq, space.nv, space.moving, space.tangent + len(names)
    seeds = np.zeros((moving, n, count))
    seeds[:nq, :, :nv] = tangent_basis(space, x[:nq]).transpose(0, 2, 1)
    seeds[nq:moving, :, nv : space.tangent] = np.eye(moving - nq)[:, None]
    state = np.empty(len(x), dtype=object)
    state[:moving] = [Dual(row[:, None], [seed]) for row, seed in zip(x[:moving], seeds, strict=True)]
    state[moving:] = [Dual(row[:, None], [0.0]) for row in x[moving:]]
    units = np.eye(count)[space.tangent :]
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
    """The derivatives (nv + states, tangent + p) at one state x (size,) by differences, and a bound on their error.

    Each column is taken with shorter and shorter steps; the error is the distance of the two next to each other that
    agree best.
    """
    space, columns, worst = equations.space, list[Array](), 0.0
    for k in range(space.tangent + len(equations.parameters)):
        before = column = np.full(space.moving - space.nq, np.nan)
        least = np.inf
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
    """A bound on the error of derivatives (n, ., .), from differences at some of the states.

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
    """(a, z') (., m) by Pinocchio at the state moved along direction k of (dq, dv, dz, parameters) by shifts (m,)."""
    space, out = equations.space, np.repeat(x[:, None], len(shifts), axis=1)
    if k >= space.tangent:
        name = equations.parameters[k - space.tangent]
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


def freedom(equations: Equations, t: Array, x: Array) -> tuple[tuple[int, ...], Array]:
    """The independent degrees of freedom (d) at states x (size, n), the same ones at all, and a lift.

    The lift (n, 2 nv + s, 2 d + s) has (dq, dv, dz) by the changes of these and dz.

    Raises SceneError where the loops are in a singular position, code "singular-position".
    """
    nv, size, constraints = equations.space.nv, equations.space.tangent, equations.constraints
    if constraints is None:
        return tuple(range(nv)), np.broadcast_to(np.eye(size), (len(t), size, size))
    rows = np.array([_jacobian(constraints, q) for q in x[: equations.space.nq].T])
    dependent = _dependent(rows)
    independent = tuple(k for k in range(nv) if k not in dependent)
    d, own = len(independent), list(independent)
    turning = derivatives_of(_velocities, equations, t, x)[1][:, :, :nv]
    inverse = np.linalg.inv(rows[:, :, dependent])
    lift = np.zeros((len(t), size, 2 * d + size - 2 * nv))
    lift[:, 2 * nv :, 2 * d :] = np.eye(size - 2 * nv)
    lift[:, own, range(d)] = lift[:, [nv + k for k in own], range(d, 2 * d)] = 1.0
    along = -inverse @ rows[:, :, own]
    lift[:, dependent, :d] = lift[:, [nv + k for k in dependent], d : 2 * d] = along
    lift[:, [nv + k for k in dependent], :d] = -inverse @ turning @ lift[:, :nv, :d]
    return independent, lift


def allowed(constraints: Constraints, q: Array) -> Array:
    """The projection (nv, nv) onto the velocities that the loops allow at q."""
    rows = _jacobian(constraints, q)
    return np.eye(rows.shape[1]) - np.linalg.pinv(rows, rcond=RANK) @ rows


def _jacobian(constraints: Constraints, q: Array) -> Array:
    return constraints.jacobian_at(q, constraints.kept)


def _velocities(equations: Equations, mech: Mechanism, _t: Any, x: Any, xp: Any) -> list[Any]:
    """J v of the kept rows."""
    nq, constraints = equations.space.nq, equations.constraints
    return [] if constraints is None else constraints.velocities(mech, x[:nq], x[equations.space.v_rows], xp)


def _dependent(rows: Array) -> list[int]:
    """The degrees of freedom by which J (n, r, nv) is inverted best, at the worst of the states."""
    from scipy.linalg import qr

    r = rows.shape[1]
    choices = {tuple(sorted(qr(j, mode="r", pivoting=True)[1][:r].tolist())) for j in rows}
    sizes = {c: float(np.linalg.svd(rows[:, :, list(c)], compute_uv=False)[:, -1].min()) for c in choices}
    best = max(sizes, key=lambda choice: sizes[choice])
    if not sizes[best] > RANK**0.5 * float(np.linalg.norm(rows, axis=(1, 2)).max()):
        raise SceneError("the loops are in a singular position, where no joints are independent of the others",
                         where="q", remedy="ask for a state beside it", code="singular-position")  # fmt: skip
    return list(best)
