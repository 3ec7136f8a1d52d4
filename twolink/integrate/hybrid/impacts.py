"""Impacts: velocities after stops and planes are met, by Newton's restitution and Coulomb's friction.

    M (v+ - v-) = J^T p + G^T r,   G v+ = 0
    normal:   p_n >= 0,  v_n+ >= -e v_n-,  one of them equal
    tangent:  |p_t| <= mu p_n,  against the sliding that is left, which is none below that

J is of all that touches, at rest or met, G of loops. Solved by sweeps over what touches until nothing changes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from twolink.algorithms.jets import Jet, JetNamespace, coefficient
from twolink.algorithms.namespaces import Numbers
from twolink.effects.conditions import unit
from twolink.effects.motion import Motion
from twolink.errors import AccuracyError
from twolink.integrate.hybrid.mode_selection import NEAR, TINY, Key, rates
from twolink.integrate.hybrid.modes import Hybrid, Modes, Stop
from twolink.integrate.hybrid.snapshot import Moment
from twolink.integrate.state import Array

SWEEPS = 10_000  # over all that touches
SETTLED = 1e-15  # relative: what a sweep may still change


@dataclass(frozen=True)
class Met:
    """What touches: the rows (normal, then two tangents or none) of its velocity, its restitution and its friction."""

    key: Key
    rows: Array
    restitution: float
    friction: float
    name: str


@dataclass(frozen=True)
class Collision:
    """What an impact did: velocities v after it; of each thing met its name, speed of approach, energy lost [J], rest.

    rest: None, or the seconds until bounces end that are too small to follow: v is then without any.
    """

    v: Array
    met: tuple[tuple[str, float, float, float | None], ...]


def collide(hybrid: Hybrid, modes: Modes, x: Array, t: float, hit: Key, small: float) -> Collision | None:
    """What hitting a stop or a plane does to the velocities; None where it would only graze.

    hit: ("stop", number) or ("contact", place). small: the height of bounces that are over.
    """
    nq, v = hybrid.robot.nq, x[hybrid.robot.nq :]
    still = TINY * (1.0 + float(np.abs(v).max(initial=0.0)))
    touching = [_met(hybrid, modes, x, t, key) for key in _touching(hybrid, modes, x, t, hit)]
    approach = np.array([-float(met.rows[0] @ v) for met in touching])
    if not approach[0] > 0.0:
        return None
    mass = _mass(hybrid, modes, x)
    fixed = _loop_rows(hybrid, modes, x)
    touching = [met if speed > still else replace(met, restitution=0.0)
                for met, speed in zip(touching, approach, strict=True)]  # fmt: skip
    new = after(mass, v, touching, fixed)
    rests = [_last_bounce(hybrid, modes, np.concatenate([x[:nq], new]), t, met, small) for met in touching]
    if any(rest is not None for rest in rests):
        calm = [met if rest is None else replace(met, restitution=0.0)
                for met, rest in zip(touching, rests, strict=True)]  # fmt: skip
        new = after(mass, v, calm, fixed)
    lost, met_now = _energy(mass, v) - _energy(mass, new), approach > still
    met_now[0] = True
    share = lost / met_now.sum()  # what belongs to which is not determined
    return Collision(new, tuple((met.name, speed, share, rest)
                                for met, speed, rest, now in zip(touching, approach, rests, met_now, strict=True)
                                if now))  # fmt: skip


def _touching(hybrid: Hybrid, modes: Modes, x: Array, t: float, hit: Key) -> list[Key]:
    """What is hit, and all else that stands at its stop or on its plane."""
    found = [hit]
    for n, stop in enumerate(hybrid.stops):
        if stop in hybrid.standing(stop.dof, x):
            found.append(("stop", n))
    moment = Moment(hybrid.beginning(modes, x, t), np.array([t]), x[:, None])
    for i, contact in hybrid.contacts.items():
        if modes.contact[i] != "free" or float(np.squeeze(contact.gap(moment.motion))) <= NEAR:
            found.append(("contact", i))
    return list(dict.fromkeys(found))


def _mass(hybrid: Hybrid, modes: Modes, x: Array) -> Array:
    model = hybrid.equations(modes, x).robot.model
    return np.asarray(pin.crba(model, model.createData(), x[: model.nq]))


def _met(hybrid: Hybrid, modes: Modes, x: Array, t: float, key: Key) -> Met:
    if key[0] == "contact":
        contact = hybrid.contacts[key[1]]
        rows = _contact_rows(hybrid, modes, x, t, key[1])
        return Met(key, rows, contact.restitution, contact.friction, contact.frame)
    stop = hybrid.stops[key[1]]
    return Met(key, _stop_row(hybrid, stop)[None], stop.restitution, 0.0, stop.joint)


def snapped(hybrid: Hybrid, modes: Modes, x: Array, t: float, i: int) -> Array:
    """q moved by the rounding that a contact is off its plane, the way that moves the robot least."""
    moment = Moment(hybrid.beginning(modes, x, t), np.array([t]), x[:, None])
    gap = float(np.squeeze(hybrid.contacts[i].gap(moment.motion)))
    row = _contact_rows(hybrid, modes, x, t, i)[0]
    way = np.linalg.solve(_mass(hybrid, modes, x), row)
    model = hybrid.robot.model
    return np.asarray(pin.integrate(model, x[: model.nq], -gap / float(row @ way) * way))


def _stop_row(hybrid: Hybrid, stop: Stop) -> Array:
    row = np.zeros(hybrid.robot.nv)
    row[stop.dof] = stop.side
    return row


def _contact_rows(hybrid: Hybrid, modes: Modes, x: Array, t: float, i: int) -> Array:
    """The rows of contact i's velocity: along the normal, then along the tangents if there is friction."""
    contact, robot = hybrid.contacts[i], hybrid.robot
    equations = hybrid.beginning(modes, x, t)
    columns = []
    for direction in np.eye(robot.nv):
        moved = np.concatenate([x[: robot.nq], direction, equations.start[equations.moving :]])
        rate, slip = rates(hybrid, i, Moment(equations, np.array([t]), moved[:, None]))
        columns.append([rate, *slip] if contact.friction else [rate])
    return np.array(columns).T


def _loop_rows(hybrid: Hybrid, modes: Modes, x: Array) -> Array:
    """The rows of loops that are no contacts, (m, nv)."""
    equations = hybrid.equations(modes, x)
    if equations.constraints is None:
        return np.empty((0, hybrid.robot.nv))
    touching = {hybrid.touching(equations, i) for i, mode in modes.contact.items() if mode != "free"}
    constraints = equations.constraints
    own = [n for n, i in enumerate(constraints.loop_of_row) if id(constraints.loops[i]) not in touching]
    return np.asarray(constraints.jacobian_at(x[: equations.space.nq], constraints.kept)[own])


def _last_bounce(hybrid: Hybrid, modes: Modes, x: Array, t: float, met: Met, small: float) -> float | None:
    """Where what follows is too small to matter, how long it would take: 2 w / (|a| (1 - e)); else None."""
    rate = float(met.rows[0] @ x[hybrid.robot.nq :])
    if rate <= 0.0 or not 0.0 < met.restitution < 1.0:
        return None
    equations = hybrid.beginning(modes, x, t)
    moment = Moment(equations, np.array([t]), equations.start[:, None])
    a = _acceleration(hybrid, met, moment)
    if a >= 0.0 or rate * rate / (-2.0 * a) > small:
        return None
    return 2.0 * rate / (-a * (1.0 - met.restitution))


def _acceleration(hybrid: Hybrid, met: Met, moment: Moment) -> float:
    """The second derivative of the distance from what is hit."""
    a = moment.forces.a[:, 0]
    if met.key[0] == "stop":
        return float(met.rows[0] @ a)
    space = moment.equations.space
    q, v = (np.array([float(np.squeeze(value)) for value in values]) for values in (moment.q, moment.v))
    moved = [Jet(pair) for pair in zip(q, space.rate(q, v), strict=True)]
    sped = [Jet(pair) for pair in zip(v, a, strict=True)]
    model, t = moment.equations.robot.model, float(moment.t[0])
    motion = Motion(model, moment.equations.mechanism, moved, sped, t, JetNamespace(Numbers))
    contact = hybrid.contacts[met.key[1]]
    normal = unit(contact.normal, "normal")
    return sum(n * float(coefficient(c, 1)) for n, c in zip(normal, contact.slip(motion), strict=True))


def after(mass: Array, v: Array, touching: Sequence[Met], fixed: Array) -> Array:
    """v+ after the impulses of all that touches. fixed (m, nv): rows of loops.

    Raises AccuracyError where the laws would create energy, or are not fulfilled by any impulses.
    """
    inverse = np.linalg.inv(mass)
    if len(fixed):
        gain = fixed @ inverse @ fixed.T
        inverse = inverse - inverse @ fixed.T @ np.linalg.pinv(gain, rcond=1e-10) @ fixed @ inverse
    wanted = [max(0.0, -met.restitution * float(met.rows[0] @ v)) for met in touching]
    impulses = [np.zeros(len(met.rows)) for met in touching]
    new = np.array(v)
    for _ in range(SWEEPS):
        moved = 0.0
        for i, met in enumerate(touching):
            better = _impulse(met, inverse, new, impulses[i], wanted[i])
            change = inverse @ met.rows.T @ (better - impulses[i])
            impulses[i] = better
            new = new + change
            moved = max(moved, float(np.abs(change).max()))
        if moved <= SETTLED * (1.0 + float(np.abs(v).max())):
            break
    else:
        raise AccuracyError(f"no impulses fulfil the laws of impact and friction of {touching[0].name}",
                            where="effects", remedy="less friction")  # fmt: skip
    if _energy(mass, new) > _energy(mass, v) * (1.0 + 1e-9) + 1e-300:
        raise AccuracyError(f"the impact of {touching[0].name} would create energy under its laws of restitution and "
                            "friction", where="effects", remedy="less restitution or friction")  # fmt: skip
    return new


def _energy(mass: Array, v: Array) -> float:
    return float(0.5 * v @ mass @ v)


def _impulse(met: Met, inverse: Array, v: Array, before: Array, wanted: float) -> Array:
    """One thing's impulse, those of the others as they are: its velocity as wanted, within its cone."""
    out = np.array(before)
    gain = met.rows @ inverse @ met.rows.T
    rates = met.rows @ v
    if gain[0, 0] > 0.0:
        out[0] = max(0.0, before[0] + (wanted - rates[0]) / gain[0, 0])
    if len(out) == 1:
        return out
    rates = rates + gain[:, 0] * (out[0] - before[0])
    out[1:] = before[1:] - np.linalg.pinv(gain[1:, 1:], rcond=1e-10) @ rates[1:]
    most, size = met.friction * out[0], math.hypot(*out[1:])
    if size > most:
        out[1:] *= most / size
    return out
