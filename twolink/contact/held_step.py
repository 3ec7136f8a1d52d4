"""Formulas of a step in which points of bodies on planes stick, or stick or slide, for compiling (`held`).

    v+ = v_free + M^-1 J^T P,   sticking: J v+ + c = 0,   G P = -(J v_free + c)

Sliding, P is the zero of F of `impulses` by steps of Newton's method, of points that are known to press. A few suffice
from the impulses of the step before; whether they did is seen from g F. Overlap is removed as in `stepping`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from twolink.algorithms.factors import factored, ldlt, ldlt_apply, ldlt_inward, ldlt_outward, solved
from twolink.algorithms.mechanism import Mechanism
from twolink.algorithms.motion import KinematicState, placed
from twolink.algorithms.recursions import composite_bodies, frame_jacobian, poses
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
from twolink.contact.bodies import viscosity_of
from twolink.contact.steps import STILL
from twolink.contact.velocities import moved, to_local_velocity, with_turning
from twolink.geometry.gaps import PlaneGap, axes_of
from twolink.geometry.points import CLOSED, TOUCHING
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.formulas import unbalanced_forces
from twolink.integrate.motion.state import Array


def held_step(
    equations: Equations, mech: Mechanism, gaps: Sequence[PlaneGap], chosen: Array, faces: list[bool], mu: list[float],
    x: list[Any], xp: Any,
) -> list[Scalar]:  # fmt: skip
    """The entries of a row of `HeldRun`.

    faces: as of `HeldContacts`. mu: the friction of points that may slide; empty for points that stick. x: w, w' of the
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
    middle = KinematicState(equations.robot.model, mech, q, [], t, xp)
    own, heights, places = _rows_of(middle, [gaps[i] for i in held])
    inward = [ldlt_inward(lower, parents, row) for row in own]
    g = _delassus(inward, inverse)
    before, after = ([plus(*(times(a, b) for a, b in zip(row, x, strict=True))) for row in own] for x in (start, free))
    opens = [0.0 if face else _open(gap, u, h, xp)
             for gap, face, u in zip(heights, faces, slipped[2::3], strict=True)]  # fmt: skip
    after[2::3] = [plus(a, c) for a, c in zip(after[2::3], opens, strict=True)]
    every, factors = list(range(-1, k - 1)), ldlt(g, list(range(-1, k - 1)))
    p = newton(g, after, mu, guess, xp) if mu else ldlt_apply(*factors, every, [-b for b in after])
    u = velocities(g, after, p)
    pushed = [plus(*(times(z[i], y) for z, y in zip(inward, p, strict=True))) for i in range(nv)]
    end = [plus(a, b) for a, b in zip(free, ldlt_outward(lower, inverse, parents, pushed), strict=True)]
    off = [times(half, plus(a, b)) for a, b in zip(before, u, strict=True)]
    along = [minus(b, c) for b, c in zip(u[2::3], opens, strict=True)]
    off[2::3] = [plus(gap, times(half, b)) for gap, b in zip(heights, along, strict=True)]
    if mu:
        reduced, off = _without_slips(g, off, (slipped, u), xp)
        factors = ldlt(reduced, every)
    nu = ldlt_apply(*factors, every, [-x for x in off])
    shifted = [plus(*(times(z[i], y) for z, y in zip(inward, nu, strict=True))) for i in range(nv)]
    push = to_local_velocity(mech, q, ldlt_outward(lower, inverse, parents, shifted), xp, -1)
    away = plus(*(xp.where(xp.less(CLOSED**2, x * x), 1.0, 0.0) for x in off))
    ends = to_local_velocity(mech, q, end, xp, -1)
    move = [half * a + xp.where(xp.less(0.0, away), b, 0.0) for a, b in zip(ends, push, strict=True)]
    q_end = moved(mech, q, move, xp)
    mean, known = [(a - b) / h for a, b in zip(ends, w, strict=True)], xp.less(0.0, plus(*(a * a for a in last)))
    passed = [xp.where(known, a, b) for a, b in zip(last, mean, strict=True)]
    others, at_end = (
        [i for i in range(len(gaps)) if i not in held],
        KinematicState(equations.robot.model, mech, q_end, [], t, xp),
    )
    at_ends = list(u)
    at_ends[2::3] = along
    return [*ends, *mean, *passed, *q_end, *p, *at_ends,
            *(entry for place in places for entry in place),
            *(missed(g, u, p, mu, xp) if mu else u),
            *(gaps[i].value(at_end) for i in [*held, *others])]  # fmt: skip


def _open(gap: Scalar, speed: Scalar, h: Any, xp: Any) -> Scalar:
    """The velocity that a gap still leaves open: none where it is small and had none in the step before."""
    small = xp.where(xp.less(speed * speed, STILL**2), TOUCHING, CLOSED)
    return xp.where(xp.less(gap, small), 0.0, 2.0 * gap / h)


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
    v = to_local_velocity(mech, q, [a + 0.5 * h * b for a, b in zip(w, change, strict=True)], xp)
    parents = mech.dof_parents()
    mass, viscosity = composite_bodies(mech, poses(mech, q, xp)), viscosity_of(equations).tolist()
    forces = list(unbalanced_forces(equations, mech, t, np.array([*q, *v, *numbers], dtype=object), xp))
    for k, d in enumerate(viscosity):
        if d:
            mass[k][k] = plus(mass[k][k], times(0.5 * d, h))
            forces[k] = plus(forces[k], times(0.5 * d, times(h, change[k])))
    lower, inverse = ldlt(mass, parents, xp)
    a = ldlt_apply(lower, inverse, parents, forces)
    start = to_local_velocity(mech, q, w, xp)
    free = [plus(s, times(h, b)) for s, b in zip(start, with_turning(mech, a, v), strict=True)]
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


def _rows_of(motion: KinematicState, gaps: Sequence[PlaneGap]) -> tuple[Matrix, list[Any], list[Vec]]:
    """Of points the rows of their velocities (3k, nv), their gaps, and their places."""
    rows, open_, places, xp = [], [], [], motion.xp
    for gap in gaps:
        near, ball, n = gap.nearest(motion), gap.ball, gap.normal
        body, place = motion.frame(ball.frame)
        centre = Pose((IDENTITY,), placed(place, ball.point))
        jacobian = frame_jacobian(motion.mech, motion.q, body, centre, motion.xp)
        one = xp.less(near.gap * near.gap, TOUCHING**2)  # where bodies touch at one point, as `Points.ends` says
        arm = xp.where(one, -ball.radius - 0.5 * near.gap, -ball.radius)
        columns = [add(_vector(c[:3]), scale(arm, cross(_vector(c[3:]), n))) for c in zip(*jacobian, strict=True)]
        axes = axes_of(np.array([n]))[0].tolist()
        rows += [[dot(_vector(axis), column) for column in columns] for axis in axes]
        open_.append(near.gap)
        places.append(add(near.first.position(motion), scale(-0.5 * near.gap, n)))
    return rows, open_, places


def _vector(values: Sequence[Any]) -> Vec:
    x, y, z = values
    return x, y, z


STEPS = 5


def newton(g: Matrix, b: Sequence[Scalar], mu: Sequence[float], guess: Sequence[Scalar], xp: Any) -> list[Scalar]:
    """P (3k) of G (3k, 3k) and b (3k), the normal last of each point."""
    size, p = _sizes(g, xp), list(guess)
    for _ in range(STEPS):
        f, slopes = _misses(p, velocities(g, b, p), mu, size, xp)
        jacobian: Matrix = []
        for i, c in enumerate(slopes):
            rows = g[3 * i : 3 * i + 3]
            for j, own in enumerate(c):
                row = [times(plus(*(times(a, r[k]) for a, r in zip(own, rows, strict=True))), 1.0 / size[i])
                       for k in range(len(p))]  # fmt: skip
                for k, entry in enumerate(own):
                    row[3 * i + k] = plus(row[3 * i + k], minus(float(j == k), entry))
                jacobian.append(row)
        p = [minus(a, step) for a, step in zip(p, solved(*factored(jacobian), f), strict=True)]
    return p


def velocities(g: Matrix, b: Sequence[Scalar], p: Sequence[Scalar]) -> list[Scalar]:
    """U (3k)."""
    return [plus(x, *(times(c, y) for c, y in zip(row, p, strict=True))) for x, row in zip(b, g, strict=True)]


def missed(g: Matrix, u: Sequence[Scalar], p: Sequence[Scalar], mu: Sequence[float], xp: Any) -> list[Scalar]:
    """g F (3k), m/s."""
    size = _sizes(g, xp)
    f, _ = _misses(p, u, mu, size, xp)
    return [times(size[i // 3], x) for i, x in enumerate(f)]


def _sizes(g: Matrix, xp: Any) -> list[Scalar]:
    """g of each point: the largest of its diagonal."""
    out = []
    for i in range(0, len(g), 3):
        a, b, c = (g[k][k] for k in range(i, i + 3))
        most = xp.where(xp.less(a, b), b, a)
        out.append(xp.where(xp.less(most, c), c, most))
    return out


def _misses(
    p: Sequence[Scalar], u: Sequence[Scalar], mu: Sequence[float], size: Sequence[Scalar], xp: Any
) -> tuple[list[Scalar], list[Matrix]]:
    """F (3k), and of each point the derivative of proj (3, 3)."""
    f: list[Scalar] = []
    slopes: list[Matrix] = []
    for i, (share, g) in enumerate(zip(mu, size, strict=True)):
        own, speed = p[3 * i : 3 * i + 3], u[3 * i : 3 * i + 3]
        x, y, normal = (a - b / g for a, b in zip(own, speed, strict=True))
        length, limit = xp.sqrt(x * x + y * y), share * normal
        slips = xp.less(limit, length)
        inverse = 1.0 / xp.where(slips, length, 1.0)
        dx, dy, scale = x * inverse, y * inverse, xp.where(slips, limit * inverse, 1.0)
        across = xp.where(slips, -scale * dx * dy, 0.0)
        f += [own[0] - scale * x, own[1] - scale * y, own[2] - normal]
        slopes.append([
            [xp.where(slips, scale * (1.0 - dx * dx), 1.0), across, xp.where(slips, share * dx, 0.0)],
            [across, xp.where(slips, scale * (1.0 - dy * dy), 1.0), xp.where(slips, share * dy, 0.0)],
            [0.0, 0.0, 1.0],
        ])  # fmt: skip
    return f, slopes
