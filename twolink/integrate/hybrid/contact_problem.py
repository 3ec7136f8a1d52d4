"""The contact problem: accelerations and forces of all that touches or rests, at once.

    a = a_0 + W J^T p,   c' = J a + J' v
    normal:   p_n >= 0,  c'_n >= 0,  p_n c'_n = 0
    tangent, without slip:   |p_t| <= mu p_n,   c'_t = 0, or |p_t| = mu p_n against c'_t
    tangent, with slip:      p_t = -mu p_n c_t / |c_t|
    joint at rest:           least <= p <= greatest,   c' = 0, or p at its limit against c'

a_0: without these forces. W: the inverse of M for what loops allow. J: rows of the gaps' rates and slips c, and units
of joints that stops and dry friction hold. Solved by sweeps over them (projected Gauss-Seidel) until the laws hold, or
by Newton's method from there. Which press, slide or stick is read from the accelerations: they are determined where
the forces are not.
Source: Jourdan, Alart, Jean, Comput. Methods Appl. Mech. Engrg. 155 (1998) 31-47.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from twolink.integrate.state import Array

FIRST, SWEEPS = 32, 10_000
NEWTON = 50  # steps
RANK = 1e-10  # relative: a gain below it is 0
UNCHANGED = 1e-13  # relative: what a last sweep may still change
MOVES = 1e-9  # relative to the largest acceleration: what begins to move


@dataclass(frozen=True)
class Rows:
    """A contact that touches. rows: J, the normal one and with friction two tangential ones (1 or 3, nv).

    bias: J' v of each row. friction, static: mu while it slides and while it does not. slip: the
    direction of sliding (2,); None where it does not slide.
    """

    rows: Array
    bias: Array
    friction: float
    static: float
    slip: Array | None

    def settled(self, force: Array, small: float, rates: Array) -> bool:
        """Whether the friction is not that of rest where it slides."""
        del force
        moves = len(rates) > 1 and self.slip is None and rates[0] <= small and math.hypot(*rates[1:]) > small
        return not moves or self.static == self.friction


@dataclass(frozen=True)
class Held:
    """A joint at rest. rows: J (1, nv). least, greatest: of torques that hold it; kinetic: of friction in motion."""

    rows: Array
    least: float
    greatest: float
    kinetic: float
    bias: Array = field(default_factory=lambda: np.zeros(1))

    def settled(self, force: Array, small: float, rates: Array) -> bool:
        """Whether the friction is not that of rest where it moves."""
        return abs(float(rates[0])) <= small or abs(float(force[0])) == self.kinetic


class Outcome(NamedTuple):
    """The accelerations a (nv,), the force on each, and the accelerations of its rows, 0 where they are small."""

    a: Array
    forces: list[Array]
    rates: list[Array]


def solve_contacts(free: Array, inverse: Array, contacts: Sequence[Rows | Held]) -> Outcome | None:
    """The motion of a_0 (nv,) and W (nv, nv) under the forces of contacts and joints at rest; None without any."""
    forces, a = [np.zeros(len(contact.rows)) for contact in contacts], np.array(free)
    scale, sweeps = 1.0 + float(np.abs(free).max(initial=0.0)), FIRST
    gains = [contact.rows @ inverse @ contact.rows.T for contact in contacts]
    while True:
        moved = _sweeps(contacts, inverse, gains, forces, a, sweeps)
        if moved is None or sweeps > SWEEPS:
            return None
        if moved <= UNCHANGED * scale:
            break
        exact = by_newton(free, inverse, contacts, forces, scale)
        if exact is not None:
            forces, a = exact
            break
        sweeps *= 2
    rates = [contact.rows @ a + contact.bias for contact in contacts]
    return Outcome(a, forces, [np.where(np.abs(rate) > MOVES * scale, rate, 0.0) for rate in rates])


def _sweeps(
    contacts: Sequence[Rows | Held], inverse: Array, gains: list[Array], forces: list[Array], a: Array, count: int
) -> float | None:
    """Better forces and accelerations, in place, and how much the last sweep changed these; None: see `_force`."""
    moved = 0.0
    for _ in range(count):
        moved = 0.0
        for contact, gain, force in zip(contacts, gains, forces, strict=True):
            rates = contact.rows @ a + contact.bias
            better = _torque(contact, gain, rates, force) if isinstance(contact, Held) else _force(
                contact, gain, rates, force)  # fmt: skip
            if better is None:
                return None
            change = inverse @ contact.rows.T @ (better - force)
            force[:] = better
            a += change
            moved = max(moved, float(np.abs(change).max(initial=0.0)))
        if moved == 0.0:
            break
    return moved


def by_newton(
    free: Array, inverse: Array, contacts: Sequence[Rows | Held], forces: Sequence[Array], scale: float
) -> tuple[list[Array], Array] | None:
    """Forces and accelerations from forces near them; None where Newton's method does not find them.

    p = proj(p - r c'), with the projection on the cone of friction of radius mu p_n, or between the limits of a joint.
    Where sweeps creep, for forces that undo each other or are at the edge of their cone, a few steps suffice.
    Source: Alart, Curnier, Comput. Methods Appl. Mech. Engrg. 92 (1991) 353-375.
    """
    ends = np.cumsum([len(contact.rows) for contact in contacts])
    places = [slice(end - len(contact.rows), end) for end, contact in zip(ends, contacts, strict=True)]
    rows, bias = np.concatenate([c.rows for c in contacts]), np.concatenate([c.bias for c in contacts])
    gain, at_rest = rows @ inverse @ rows.T, rows @ free + bias
    r, p = 1.0 / np.maximum(np.diag(gain), 1e-300), np.concatenate(forces)

    def residual(p: Array) -> tuple[Array, Array]:
        """p - proj(p - r c') and its derivative by p."""
        rates, out, slopes = gain @ p + at_rest, np.empty_like(p), np.zeros_like(gain)
        for contact, place in zip(contacts, places, strict=True):
            target, by_p, by_rates = _projection(contact, p[place], rates[place], float(r[place.start]))
            out[place] = p[place] - target
            slopes[place, place] += np.eye(len(target)) - by_p
            slopes[place] -= by_rates @ gain[place]
        return out, slopes

    left, slopes = residual(p)
    for _ in range(NEWTON):
        size = np.abs(left / r).max()
        if size <= UNCHANGED * scale:
            settled = all(contact.settled(p[place], MOVES * scale, gain[place] @ p + at_rest[place])
                          for contact, place in zip(contacts, places, strict=True))  # fmt: skip
            return ([p[place] for place in places], free + inverse @ rows.T @ p) if settled else None
        step, share = np.linalg.lstsq(slopes, -left, rcond=RANK)[0], 1.0
        while share > 1e-3:
            trial, their = residual(p + share * step)
            if np.abs(trial / r).max() < (1.0 - 0.1 * share) * size:
                break
            share *= 0.5
        else:
            return None
        p, left, slopes = p + share * step, trial, their
    return None


def _projection(contact: Rows | Held, p: Array, rates: Array, r: float) -> tuple[Array, Array, Array]:
    """proj(p - r c'), and its derivatives by p and by c'."""
    z, size = p - r * rates, len(p)
    by_z, by_p = np.zeros((size, size)), np.zeros((size, size))
    least, greatest = (contact.least, contact.greatest) if isinstance(contact, Held) else (0.0, math.inf)
    target = np.zeros(size)
    target[0], by_z[0, 0] = min(max(z[0], least), greatest), float(least < z[0] < greatest)
    if size > 1 and isinstance(contact, Rows):
        if contact.slip is not None:
            target[1:], by_p[1:, 0] = -contact.friction * p[0] * contact.slip, -contact.friction * contact.slip
        else:
            radius, across = contact.static * max(0.0, p[0]), math.hypot(*z[1:])
            if across <= radius:
                target[1:], by_z[1:, 1:] = z[1:], np.eye(2)
            else:
                way = z[1:] / across
                target[1:], by_z[1:, 1:] = radius * way, radius / across * (np.eye(2) - np.outer(way, way))
                by_p[1:, 0] = contact.static * way * (p[0] > 0.0)
    return target, by_z + by_p, -r * by_z


def _torque(held: Held, gain: Array, rates: Array, before: Array) -> Array:
    """The torque on a joint at rest, the others as they are; that of kinetic friction where it begins to move."""
    wanted = before - rates / gain[0] if gain[0, 0] > 0.0 else before
    if wanted[0] < held.least:
        return np.array([-held.kinetic])
    return np.array([held.kinetic]) if wanted[0] > held.greatest else np.asarray(wanted)


def _force(contact: Rows, gain: Array, rates: Array, before: Array) -> Array | None:
    """One contact's force, those of the others as they are; None where its friction drives what it should stop."""
    out = np.array(before)
    sliding = contact.slip is not None and len(out) > 1
    along = np.eye(len(out))[0]
    if contact.slip is not None and sliding:
        along[1:] = -contact.friction * contact.slip
    own = float(gain[0] @ along)
    if not own > 0.0:
        return out if gain[0, 0] <= 0.0 else None
    normal = max(0.0, before[0] - rates[0] / own)
    if sliding:
        return np.asarray(normal * along)
    rates = rates + gain[:, 0] * (normal - before[0])
    out[0] = normal
    if len(out) > 1:
        wanted = gain[1:, 1:] @ before[1:] - rates[1:]
        out[1:] = friction_force(gain[1:, 1:], wanted, contact.static * normal)
        if contact.static > contact.friction and math.hypot(*out[1:]) >= contact.static * normal:
            out[1:] = friction_force(gain[1:, 1:], wanted, contact.friction * normal)
    return out


def friction_force(gain: Array, wanted: Array, greatest: float) -> Array:
    """The force p (2,) that stops the slip c = G p - wanted, or of the greatest size against the slip that is left.

    The latter is (G + s) p = wanted with s > 0, found by Newton's method for 1 / |p| (More, Sorensen 1983).
    """
    e, axes = np.linalg.eigh(gain)
    w, limit = axes.T @ wanted, RANK * max(1e-300, float(e[-1]))
    p = np.where(e > limit, w / np.where(e > limit, e, 1.0), 0.0)
    size, s = math.hypot(*p), 0.0
    if size <= greatest:
        return np.asarray(axes @ p)
    e = np.maximum(e, 0.0)
    s = math.hypot(*w) / max(greatest, 1e-300) - float(e[-1])  # not beyond the solution
    s = max(s, limit)
    for _ in range(NEWTON):
        p = w / (e + s)
        size = math.hypot(*p)
        change = (size / max(greatest, 1e-300) - 1.0) * size * size / float((p * p / (e + s)).sum() or 1.0)
        s += change
        if abs(change) <= 1e-15 * s:
            break
    p = w / (e + s)
    return np.asarray(axes @ p * (greatest / math.hypot(*p)))


def sliding_of(friction: float, slip: Array | None, rates: Array) -> tuple[float, float] | None:
    """The direction in which a contact that presses slides or begins to, from its accelerations; None: it sticks."""
    if not friction:
        return 0.0, 0.0
    direction = rates[1:] if slip is None else slip
    size = math.hypot(*direction)
    return (float(direction[0] / size), float(direction[1] / size)) if size > 0.0 else None
