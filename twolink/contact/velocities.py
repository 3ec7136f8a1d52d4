"""Velocities whose linear parts are along the axes of the parents, w, in which they do not change while bodies turn.

w is the velocity v but for free and planar joints, whose linear velocities v has along axes that turn with the body.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from twolink.algorithms.mechanism import Mechanism
from twolink.algorithms.spatial import cross, plus, times

SMALL = 1e-7  # rad^2: the square of half a turn whose sine is x - x^3 / 6


def to_local_velocity(mech: Mechanism, q: list[Any], w: Sequence[Any], xp: Any, sign: int = 1) -> list[Any]:
    """v of w; w of v with the sign -1."""
    v = list(w)
    for i in mech.bodies:
        joint = mech.joints[i]
        size = {"free-flyer": 3, "planar": 2}.get(joint.kind, 0)
        if size:
            (rotation,), dofs = joint.pose(q, xp).turns, joint.dofs[:size]
            for a, k in enumerate(dofs):
                entries = [rotation[b][a] if sign > 0 else rotation[a][b] for b in range(size)]
                v[k] = plus(*(times(entry, w[j]) for entry, j in zip(entries, dofs, strict=True)))
    return v


def with_turning(mech: Mechanism, a: Sequence[Any], v: Sequence[Any]) -> list[Any]:
    """a with omega x v of the linear velocities of free and planar joints."""
    out = list(a)
    for i in mech.bodies:
        joint = mech.joints[i]
        own = [v[k] for k in joint.dofs]
        if joint.kind == "free-flyer":
            turning: Sequence[Any] = cross((own[3], own[4], own[5]), (own[0], own[1], own[2]))
        elif joint.kind == "planar":
            turning = (times(-1.0, times(own[2], own[1])), times(own[2], own[0]))
        else:
            continue
        for k, change in zip(joint.dofs, turning, strict=False):
            out[k] = plus(out[k], change)
    return out


def moved(mech: Mechanism, q: list[Any], change: Sequence[Any], xp: Any) -> list[Any]:
    """The configuration after a time in which w adds up to a change."""
    out = list(q)
    for joint in (mech.joints[i] for i in mech.bodies):
        if joint.mimic:
            continue
        own, by = [q[k] for k in joint.entries], [change[k] for k in joint.dofs]
        if joint.kind in ("revolute", "prismatic"):
            new = [own[0] + by[0]]
        elif joint.kind == "continuous":
            new = _turned(own, by[0], xp)
        elif joint.kind == "planar":
            new = [own[0] + by[0], own[1] + by[1], *_turned(own[2:], by[2], xp)]
        else:
            new = [*(a + b for a, b in zip(own[:-4], by[:-3], strict=True)), *_rotated(own[-4:], by[-3:], xp)]
        for k, value in zip(joint.entries, new, strict=True):
            out[k] = value
    return out


def _turned(at: Sequence[Any], angle: Any, xp: Any) -> list[Any]:
    """(cos, sin) after a turn."""
    c, s = xp.cos(angle), xp.sin(angle)
    return _of_length_one([at[0] * c - at[1] * s, at[1] * c + at[0] * s])


def _rotated(p: Sequence[Any], turn: Sequence[Any], xp: Any) -> list[Any]:
    """p * exp(turn / 2), a quaternion (x, y, z, w) after a turn about axes that move with it."""
    square = 0.25 * sum(a * a for a in turn)
    half = xp.sqrt(square)
    tiny = xp.less(square, SMALL)
    sinc = xp.where(tiny, 1.0 - square / 6.0, xp.sin(half) / xp.where(tiny, 1.0, half))
    (x, y, z, w), (a, b, c), s = p, (0.5 * sinc * a for a in turn), xp.cos(half)
    return _of_length_one([s * x + w * a + y * c - z * b, s * y + w * b + z * a - x * c, s * z + w * c + x * b - y * a,
                           s * w - (x * a + y * b + z * c)])  # fmt: skip


def _of_length_one(x: Sequence[Any]) -> list[Any]:
    """x / |x| where |x| is 1 but for rounding."""
    shorter = 1.5 - 0.5 * sum(a * a for a in x)
    return [a * shorter for a in x]
