"""Impacts: velocities after a stop or a plane is met, by Newton's restitution and Coulomb's friction.

    M (v+ - v-) = J^T p + G^T r,   J v+ = -e J v-,   G v+ = 0

J is of what is met, G of loops and of what rests and is pressed on. One after the other where several are met.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from twolink.dynamics.jets import Jet, JetNamespace, coefficient
from twolink.effects.conditions import unit
from twolink.effects.motion import Motion
from twolink.errors import AccuracyError
from twolink.integrate.events.deciding import Key, rates
from twolink.integrate.events.modes import Hybrid, Modes, Stop
from twolink.integrate.events.moment import Moment
from twolink.integrate.namespaces import Numbers
from twolink.integrate.state import Array

SLIDES = 1e-9  # relative: a tangential impulse above the cone by more makes it slide


@dataclass(frozen=True)
class Met:
    """What meets: the rows (normal, then two tangents or none) of its velocity, its restitution and its friction."""

    rows: Array
    restitution: float
    friction: float
    name: str


@dataclass(frozen=True)
class Collision:
    """What an impact did: velocities v after it, the speed of approach, the energy lost [J].

    rest: None, or the seconds until bounces end that are too small to follow: v is then without any.
    """

    name: str
    v: Array
    speed: float
    lost: float
    rest: float | None


def collide(hybrid: Hybrid, modes: Modes, x: Array, t: float, key: Key, small: float) -> Collision | None:
    """What hitting a stop or a plane does to the velocities; None where it would only graze.

    key: ("stop", number) or ("contact", place). small: the height of bounces that are over.
    """
    nq, v = hybrid.scene.robot.nq, x[hybrid.scene.robot.nq :]
    met = _met(hybrid, modes, x, t, key)
    approach = float(met.rows[0] @ v)
    if approach >= 0.0:
        return None
    model = hybrid.equations(modes, x).robot.model
    upper = np.triu(pin.crba(model, model.createData(), x[:nq]))
    mass = upper + np.triu(upper, 1).T
    kept, resting = _held(hybrid, modes, x, t, key)
    new, _ = after(mass, v, met, kept, resting)
    until = _last_bounce(hybrid, modes, np.concatenate([x[:nq], new]), t, key, met, small)
    if until is not None:
        new, _ = after(mass, v, replace(met, restitution=0.0), kept, resting)
    return Collision(met.name, new, -approach, _energy(mass, v) - _energy(mass, new), until)


def _met(hybrid: Hybrid, modes: Modes, x: Array, t: float, key: Key) -> Met:
    if key[0] == "contact":
        contact = hybrid.contacts[key[1]]
        return Met(_contact_rows(hybrid, modes, x, t, key[1]), contact.restitution, contact.friction, contact.frame)
    stop = hybrid.stops[key[1]]
    return Met(_stop_row(hybrid, stop)[None], stop.restitution, 0.0, stop.joint)


def _stop_row(hybrid: Hybrid, stop: Stop) -> Array:
    row = np.zeros(hybrid.scene.robot.nv)
    row[stop.dof] = stop.side
    return row


def _contact_rows(hybrid: Hybrid, modes: Modes, x: Array, t: float, i: int) -> Array:
    """The rows of contact i's velocity: along the normal, then along the tangents if there is friction."""
    contact, robot = hybrid.contacts[i], hybrid.scene.robot
    equations = hybrid.beginning(modes, x, t)
    columns = []
    for direction in np.eye(robot.nv):
        moved = np.concatenate([x[: robot.nq], direction, equations.start[equations.moving :]])
        rate, slip = rates(hybrid, i, Moment(equations, np.array([t]), moved[:, None]))
        columns.append([rate, *slip] if contact.friction else [rate])
    return np.array(columns).T


def _held(hybrid: Hybrid, modes: Modes, x: Array, t: float, key: Key) -> tuple[Array, Array]:
    """The rows of loops, and of what rests and is pressed on, but for what is hit. Friction is too weak to hold."""
    equations = hybrid.equations(modes, x)
    kept, resting = np.empty((0, hybrid.scene.robot.nv)), []
    if equations.loops is not None:
        touching = {hybrid.touching(equations, i): i for i, mode in modes.contact.items() if mode != "free"}
        own = [n for n, loop in enumerate(equations.loops.owners()) if id(loop) not in touching]
        kept = equations.loops.numbers(x[: equations.space.nq], equations.loops.kept)[own]
        resting += [_contact_rows(hybrid, modes, x, t, i)[0] for i in touching.values() if ("contact", i) != key]
    for n, stop in enumerate(hybrid.stops):
        if stop.dof in modes.locked and stop in hybrid.standing(stop.dof, x) and ("stop", n) != key:
            resting.append(_stop_row(hybrid, stop))
    return kept, np.array(resting).reshape(-1, kept.shape[1])


def _last_bounce(hybrid: Hybrid, modes: Modes, x: Array, t: float, key: Key, met: Met, small: float) -> float | None:
    """Where what follows is too small to matter, how long it would take: 2 w / (|a| (1 - e)); else None."""
    rate = float(met.rows[0] @ x[hybrid.scene.robot.nq :])
    if rate <= 0.0 or met.restitution >= 1.0:
        return None
    equations = hybrid.beginning(modes, x, t)
    moment = Moment(equations, np.array([t]), equations.start[:, None])
    a = _acceleration(hybrid, key, met, moment)
    if a >= 0.0 or rate * rate / (-2.0 * a) > small:
        return None
    return 2.0 * rate / (-a * (1.0 - met.restitution))


def _acceleration(hybrid: Hybrid, key: Key, met: Met, moment: Moment) -> float:
    """The second derivative of the distance from what is hit."""
    a = moment.forces.a[:, 0]
    if key[0] == "stop":
        return float(met.rows[0] @ a)
    space = moment.equations.space
    q, v = (np.array([float(np.squeeze(value)) for value in values]) for values in (moment.q, moment.v))
    moved = [Jet(pair) for pair in zip(q, space.rate(q, v), strict=True)]
    sped = [Jet(pair) for pair in zip(v, a, strict=True)]
    model, t = moment.equations.robot.model, float(moment.t[0])
    motion = Motion(model, moment.equations.numbers, moved, sped, t, JetNamespace(Numbers))
    contact = hybrid.contacts[key[1]]
    normal = unit(contact.normal, "normal")
    return sum(n * float(coefficient(c, 1)) for n, c in zip(normal, contact.slip(motion), strict=True))


def after(mass: Array, v: Array, met: Met, kept: Array, resting: Array) -> tuple[Array, Array]:
    """(v+, p): velocities after one impact, and its impulse along the rows.

    kept (m, nv): rows of loops. resting (k, nv): rows of what rests, pushed on but never pulled.
    """
    held = list(range(len(resting)))
    while True:
        fixed = np.concatenate([kept, resting[held]]) if len(held) or len(kept) else np.empty((0, len(v)))
        # What the fixed rows leave: velocities change by N p.
        inverse = np.linalg.inv(mass)
        if len(fixed):
            gain = fixed @ inverse @ fixed.T
            inverse = inverse - inverse @ fixed.T @ np.linalg.pinv(gain, rcond=1e-10) @ fixed @ inverse
        impulse = _impulse(met.rows @ inverse @ met.rows.T, met.rows @ v, met)
        change = inverse @ met.rows.T @ impulse
        if not held:
            break
        reaction = np.linalg.lstsq(fixed.T, mass @ change - met.rows.T @ impulse, rcond=None)[0][len(kept) :]
        worst = int(np.argmin(reaction))
        if reaction[worst] >= -1e-12 * max(1.0, float(np.abs(impulse).max())):
            break
        del held[worst]
    new = v + change
    if _energy(mass, new) > _energy(mass, v) * (1.0 + 1e-9) + 1e-300:
        raise AccuracyError(f"the impact of {met.name} would create energy under its laws of restitution and friction",
                            where="effects", remedy="less restitution or friction")  # fmt: skip
    return new, impulse


def _energy(mass: Array, v: Array) -> float:
    return float(0.5 * v @ mass @ v)


def _impulse(gain: Array, before: Array, met: Met) -> Array:
    """p of J v+ = (-e v_n, 0), or sliding: p_t = -mu p_n along the tangential velocity."""
    wanted = -(1.0 + met.restitution) * before[0]
    alone = np.zeros(len(before))
    alone[0] = wanted / gain[0, 0]
    if len(before) == 1 or not met.friction:
        return alone
    target = np.concatenate([[wanted], -before[1:]])
    sticking = np.asarray(np.linalg.pinv(gain, rcond=1e-10) @ target)
    if math.hypot(*sticking[1:]) <= met.friction * sticking[0] * (1.0 + SLIDES):
        return sticking
    speed = math.hypot(*before[1:])
    way = before[1:] / speed if speed > 0.0 else -sticking[1:] / math.hypot(*sticking[1:])
    push = np.concatenate([[1.0], -met.friction * way])
    return np.asarray(push * wanted / float(gain[0] @ push))
