"""Formulas of a step in which points of bodies on planes stick, or stick or slide, for compiling (`held`).

    v+ = v_free + M^-1 J^T P,   sticking: J v+ + c = 0,   G P = -(J v_free + c);   sliding: `cone_newton`

Overlap is removed as in `stepping`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from twolink.algorithms.mechanism import Mechanism
from twolink.algorithms.motion import Motion, placed
from twolink.algorithms.recursions import composite_bodies, frame_jacobian, poses
from twolink.algorithms.sparse_factors import ldlt, ldlt_apply, ldlt_inward, ldlt_outward
from twolink.algorithms.spatial import (
    IDENTITY,
    Matrix,
    Pose,
    Scalar,
    Vec,
    add,
    constant,
    cross,
    dot,
    minus,
    plus,
    scale,
    times,
)
from twolink.contact.cone_newton import missed, newton, velocities
from twolink.contact.step import STILL
from twolink.geometry.gaps import PlaneGap, axes_of
from twolink.geometry.points import CLOSED
from twolink.integrate.equations import Equations
from twolink.integrate.formulas import unbalanced_forces
from twolink.integrate.state import Array

SMALL = 1e-7  # rad^2: the square of half a turn whose sine is x - x^3 / 6


def held_step(
    equations: Equations,
    mech: Mechanism,
    gaps: Sequence[PlaneGap],
    chosen: Array,
    faces: list[bool],
    mu: list[float],
    x: list[Any],
    xp: Any,
) -> list[Scalar]:
    """The entries of a row of `HeldRun`.

    faces: as of `Held`. mu: the friction of points that may slide; empty for points that stick. x: w, w' of the
    two steps before, q, P and U of the step before, the middle in time, the length, numbers.
    """
    nq, nv, k = mech.nq, mech.nv, 3 * len(chosen)
    w, last, older, rest = x[:nv], x[nv : 2 * nv], x[2 * nv : 3 * nv], x[3 * nv :]
    change = [0.5 * (a + b) for a, b in zip(last, older, strict=True)]
    guess, slipped, (t, h, *numbers) = rest[nq : nq + k], rest[nq + k : nq + 2 * k], rest[nq + 2 * k :]
    half = 0.5 * h
    q = moved(mech, rest[:nq], [half * a for a in w], xp)
    start, free, lower, inverse, parents = _free(equations, mech, (t, h, numbers), q, w, change, xp)
    held = chosen.tolist()
    middle = Motion(equations.robot.model, mech, q, [], t, xp)
    own, heights, places = _rows_of(middle, [gaps[i] for i in held])
    inward = [ldlt_inward(lower, parents, row) for row in own]
    g = _delassus(inward, inverse)
    before, after = ([plus(*(times(a, b) for a, b in zip(row, x, strict=True))) for row in own] for x in (start, free))
    opens = [0.0 if face else xp.where(xp.less(gap, 0.0), 0.0, 2.0 * gap / h)
             for gap, face in zip(heights, faces, strict=True)]  # fmt: skip
    after[2::3] = [plus(a, c) for a, c in zip(after[2::3], opens, strict=True)]
    every, factors = list(range(-1, k - 1)), ldlt(g, list(range(-1, k - 1)))
    p = newton(g, after, mu, guess, xp) if mu else ldlt_apply(*factors, every, [-b for b in after])
    u = velocities(g, after, p)
    pushed = [plus(*(times(z[i], y) for z, y in zip(inward, p, strict=True))) for i in range(nv)]
    end = [plus(a, b) for a, b in zip(free, ldlt_outward(lower, inverse, parents, pushed), strict=True)]
    off = [times(half, plus(a, b)) for a, b in zip(before, u, strict=True)]
    off[2::3] = [plus(gap, times(half, minus(b, c))) for gap, b, c in zip(heights, u[2::3], opens, strict=True)]
    if mu:
        reduced, off = _without_slips(g, off, (slipped, u), xp)
        factors = ldlt(reduced, every)
    nu = ldlt_apply(*factors, every, [-x for x in off])
    shifted = [plus(*(times(z[i], y) for z, y in zip(inward, nu, strict=True))) for i in range(nv)]
    push = _own(mech, q, ldlt_outward(lower, inverse, parents, shifted), xp, -1)
    away = plus(*(xp.where(xp.less(CLOSED**2, x * x), 1.0, 0.0) for x in off))
    ends = _own(mech, q, end, xp, -1)
    move = [half * a + xp.where(xp.less(0.0, away), b, 0.0) for a, b in zip(ends, push, strict=True)]
    q_end = moved(mech, q, move, xp)
    mean, known = [(a - b) / h for a, b in zip(ends, w, strict=True)], xp.less(0.0, plus(*(a * a for a in last)))
    passed = [xp.where(known, a, b) for a, b in zip(last, mean, strict=True)]
    others, at_end = (
        [i for i in range(len(gaps)) if i not in held],
        Motion(equations.robot.model, mech, q_end, [], t, xp),
    )
    return [*ends, *mean, *passed, *q_end, *p, *u,
            *(entry for place in places for entry in place),
            *(missed(g, u, p, mu, xp) if mu else u),
            *(gaps[i].value(at_end) for i in [*held, *others])]  # fmt: skip


def _delassus(inward: Matrix, inverse: Sequence[Scalar]) -> Matrix:
    """G of the rows L^-T J^T and of 1 / D."""
    g: Matrix = [[plus(*(times(times(a, b), d) for a, b, d in zip(left, right, inverse, strict=True)))
                  for right in inward] for left in inward]  # fmt: skip
    for i, own_row in enumerate(g):
        if constant(own_row[i]) and not own_row[i]:  # a direction in which the point cannot move: no impulse
            own_row[i] = 1.0
    return g


def _free(
    equations: Equations,
    mech: Mechanism,
    when: tuple[Any, Any, list[Any]],
    q: list[Any],
    w: list[Any],
    change: list[Any],
    xp: Any,
) -> tuple[list[Scalar], list[Scalar], Matrix, list[Scalar], list[int]]:
    """v and v+ without contacts at the middle q of a step, and the factors of M. when: t, h and the numbers."""
    t, h, numbers = when
    v = _own(mech, q, [a + 0.5 * h * b for a, b in zip(w, change, strict=True)], xp)
    parents = mech.dof_parents()
    lower, inverse = ldlt(composite_bodies(mech, poses(mech, q, xp)), parents, xp)
    state = np.array([*q, *v, *numbers], dtype=object)
    a = ldlt_apply(lower, inverse, parents, unbalanced_forces(equations, mech, t, state, xp))
    start = _own(mech, q, w, xp)
    free = [plus(s, times(h, b)) for s, b in zip(start, _with_turning(mech, a, v), strict=True)]
    return start, free, lower, inverse, parents


def _without_slips(
    g: Matrix, off: list[Scalar], velocities: tuple[Sequence[Scalar], Sequence[Scalar]], xp: Any
) -> tuple[Matrix, list[Scalar]]:
    """G and the slips and gaps without the tangents of points that slip. velocities: U before and now."""
    sticks: list[Scalar] = [1.0] * len(g)
    for i in range(0, len(g), 3):
        square = plus(*(u[j] * u[j] for u in velocities for j in (i, i + 1)))
        sticks[i] = sticks[i + 1] = xp.where(xp.less(square, STILL**2), 1.0, 0.0)
    rows = [[times(times(x, y), b) for y, b in zip(sticks, row, strict=True)] for x, row in zip(sticks, g, strict=True)]
    for i, x in enumerate(sticks):
        rows[i][i] = plus(rows[i][i], minus(1.0, x))
    return rows, [times(x, y) for x, y in zip(sticks, off, strict=True)]


def _rows_of(motion: Motion, gaps: Sequence[PlaneGap]) -> tuple[Matrix, list[Any], list[Vec]]:
    """Of points the rows of their velocities (3k, nv), their gaps, and their places."""
    rows, open_, places = [], [], []
    for gap in gaps:
        near, ball, n = gap.nearest(motion), gap.ball, gap.normal
        body, place = motion.frame(ball.frame)
        centre = Pose((IDENTITY,), placed(place, ball.point))
        jacobian = frame_jacobian(motion.mech, motion.q, body, centre, motion.xp)
        columns = [add(_vector(c[:3]), scale(-ball.radius, cross(_vector(c[3:]), n)))
                   for c in zip(*jacobian, strict=True)]  # fmt: skip
        axes = axes_of(np.array([n]))[0].tolist()
        rows += [[dot(_vector(axis), column) for column in columns] for axis in axes]
        open_.append(near.gap)
        places.append(add(near.first.position(motion), scale(-0.5 * near.gap, n)))
    return rows, open_, places


def _vector(values: Sequence[Any]) -> Vec:
    x, y, z = values
    return x, y, z


def _own(mech: Mechanism, q: list[Any], w: Sequence[Any], xp: Any, sign: int = 1) -> list[Any]:
    """v of w; w of v with the sign -1 (`Multibody.own`)."""
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


def _with_turning(mech: Mechanism, a: Sequence[Any], v: Sequence[Any]) -> list[Any]:
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
    """The configuration after a time in which w adds up to a change (`Multibody.moved`)."""
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
