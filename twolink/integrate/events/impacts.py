"""Impacts: velocities after a stop or a plane is met, by Newton's restitution and Coulomb's friction.

    M (v+ - v-) = J^T p + G^T r,   J v+ = -e J v-,   G v+ = 0

J is of what is met, G of loops and of what rests and is pressed on. One after the other where several are met.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from twolink.errors import AccuracyError
from twolink.integrate.state import Array

SLIDES = 1e-9  # relative: a tangential impulse above the cone by more makes it slide


@dataclass(frozen=True)
class Met:
    """What meets: the rows (normal, then two tangents or none) of its velocity, its restitution and its friction."""

    rows: Array
    restitution: float
    friction: float
    name: str


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
