"""The contact problem: accelerations and forces of all contacts that touch at rest against each other, at once.

    a = a_0 + W J^T p,   c' = J a + J' v
    normal:   p_n >= 0,  c'_n >= 0,  p_n c'_n = 0
    tangent, without slip:   |p_t| <= mu p_n,   c'_t = 0, or |p_t| = mu p_n against c'_t
    tangent, with slip:      p_t = -mu p_n c_t / |c_t|

a_0: without these contacts. W: the inverse of M for what is not held by locks and loops. J: rows of the gaps' rates
and slips c. Solved by sweeps over the contacts (projected Gauss-Seidel), which end when the laws hold. Which contacts
press, slide or stick is read from the accelerations: they are determined where the forces of several contacts are not.
Source: Jourdan, Alart, Jean, Comput. Methods Appl. Mech. Engrg. 155 (1998) 31-47.
"""

import math
from dataclasses import dataclass

import numpy as np

from twolink.integrate.state import Array

SWEEPS = 20_000
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


@dataclass(frozen=True)
class Solved:
    """What a contact does: whether it opens, and the direction in which it slides or begins to; None: it sticks."""

    opens: bool
    slides: tuple[float, float] | None


def solve_contacts(free: Array, inverse: Array, contacts: list[Rows]) -> tuple[Array, list[Solved]] | None:
    """(a, what each contact does) from a_0 (nv,) and W (nv, nv); None where no forces fulfil the laws."""
    forces = [np.zeros(len(contact.rows)) for contact in contacts]
    a, scale = np.array(free), 1.0 + float(np.abs(free).max(initial=0.0))
    gains = [contact.rows @ inverse @ contact.rows.T for contact in contacts]
    for _ in range(SWEEPS):
        moved = 0.0
        for contact, gain, force in zip(contacts, gains, forces, strict=True):
            better = _force(contact, gain, contact.rows @ a + contact.bias, force)
            if better is None:
                return None
            change = inverse @ contact.rows.T @ (better - force)
            force[:] = better
            a += change
            moved = max(moved, float(np.abs(change).max(initial=0.0)))
        if moved <= UNCHANGED * scale:
            break
    else:
        return None
    return a, [_read(contact, contact.rows @ a + contact.bias, MOVES * scale) for contact in contacts]


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


def _read(contact: Rows, rates: Array, small: float) -> Solved:
    """What a contact does, from its acceleration."""
    if rates[0] > small:
        return Solved(True, None)
    if not contact.friction:
        return Solved(False, (0.0, 0.0))
    direction = contact.slip if contact.slip is not None else rates[1:]
    size = math.hypot(*direction)
    still = contact.slip is None and size <= small
    return Solved(False, None if still else (float(direction[0] / size), float(direction[1] / size)))
