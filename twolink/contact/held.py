"""A step in which the points that pressed and stuck in the step before do so again: one compiled function.

    v+ = v_free + M^-1 J^T P,   J v+ + c = 0,   G P = -(J v_free + c)

Where P is within the cones of friction and no other point closes, this obeys the laws; else the contact problem is
solved (`impulses`). Overlap is removed as in `stepping`. For few points of bodies on planes, such as feet.
"""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from twolink.algorithms.mechanism import Mechanism, mechanism
from twolink.algorithms.namespaces import Expressions
from twolink.algorithms.recursions import composite_bodies, frame_jacobian, frame_placement, poses
from twolink.algorithms.sparse_factors import ldlt, ldlt_apply, ldlt_inward, ldlt_outward, ldlt_solve
from twolink.algorithms.spatial import IDENTITY, Matrix, Pose, Scalar, Vec, add, cross, dot, minus, plus, scale, times
from twolink.contact.formulas import OnPlanes
from twolink.contact.impulses import EXACT, Impulses
from twolink.contact.multibody import Multibody, axes_of
from twolink.dynamics.kernels import heyoka
from twolink.integrate.compile_time import UNOPTIMIZED, compiling_seconds, is_reproducible
from twolink.integrate.compiled_functions import compiled_function, is_at_hand
from twolink.integrate.equations import Equations
from twolink.integrate.first_steps import count, spent
from twolink.integrate.formulas import unbalanced_forces
from twolink.integrate.state import Array

FEW = 12  # points on planes, up to which they are compiled
STEP = 1.5e-3  # s of a step that is not compiled, roughly
SIZE = 1.5  # of the compiled step, in evaluations of the equations of motion that compile as slowly


class Held(NamedTuple):
    """Points that stick: the function of their steps, their pairs, and their axes (k, 3, 3), the normal last."""

    function: Any
    pair: Array
    axes: Array


class HeldStep(NamedTuple):
    """What the function says: w+ (nv,), P and U (k, 3), gaps (k,), places (k, 3); M^-1 J^T nu (nv,) and nu (k,), which
    remove overlap; and the gaps of the other points at the end (m,)."""

    ends: Array
    p: Array
    u: Array
    gaps: Array
    places: Array
    push: Array
    nu: Array
    others: Array

    def obeys(self, static: Array, closed: float) -> bool:
        """Whether the laws hold: points press within friction's cone, and no other closes. closed: no overlap, m."""
        x, y, normal = self.p.T
        inside = (normal > 0.0) & (x * x + y * y <= (static * normal) ** 2)
        apart = not self.overlaps(closed) or self.nu.min() >= 0.0
        return bool(apart and inside.all() and (self.others > 0.0).all() and np.abs(self.u).max() <= EXACT)

    def overlaps(self, closed: float) -> bool:
        """Whether points overlap by more than this [m]."""
        return bool(self.gaps.min() < -closed)

    @property
    def worth(self) -> Impulses:
        """How far the impulses miss the laws."""
        largest = float(np.abs(self.u).max())
        return Impulses(self.p, self.u, largest, float(np.abs(self.p * self.u).max()), largest, "held")


class HeldSteps:
    """Compiled steps of a scene by the points that stick. groups: of all its points that may touch."""

    def __init__(self, bodies: Multibody, groups: Sequence[Any]) -> None:
        self.equations = bodies.equations
        few = len(groups) == 1 and type(groups[0]) is OnPlanes and len(groups[0].key) <= FEW
        self.group: OnPlanes | None = groups[0] if few and type(bodies) is Multibody and heyoka() else None
        self._known: dict[bytes, Held] = {}

    def of(self, keys: Array) -> Held | None:
        """The steps in which the points with these keys stick; None where they are not compiled."""
        group = self.group
        if group is None or not len(keys) or 3 * len(keys) > self.equations.robot.nv or is_reproducible():
            return None
        content = keys.tobytes()
        if content not in self._known:
            order = np.argsort(group.key)
            chosen = order[np.searchsorted(group.key, keys, sorter=order)]
            points = (group.joint, group.local, group.radius, group.normal, group.height, chosen)
            digest = hashlib.sha256(repr([x.tolist() for x in points]).encode()).hexdigest()
            name = self.equations.key("held", digest[:32])  # of a file
            if not is_at_hand(name) and spent(name) < compiling_seconds(SIZE * self.equations.operations):
                count(name, STEP)
                return None
            function = compiled_function(name, lambda: _compiled(self.equations, group, chosen))[0]
            self._known[content] = Held(function, group.pair[chosen], axes_of(group.normal[chosen]))
        return self._known[content]

    def step(self, held: Held, t: float, h: float, q: Array, w: Array, change: Array, numbers: Array) -> HeldStep:
        """The step of length h whose middle is at t and q."""
        out = held.function(np.concatenate([[t, h], q, w, change, numbers]))
        nv, k = len(w), len(held.pair)
        cuts = list(itertools.accumulate((nv, 3 * k, 3 * k, k, 3 * k, nv, k)))
        ends, p, u, gaps, places, push, nu, others = (
            out[a:b] for a, b in zip([0, *cuts], [*cuts, len(out)], strict=True)
        )
        return HeldStep(ends, p.reshape(k, 3), u.reshape(k, 3), gaps, places.reshape(k, 3), push, nu, others)


def _compiled(equations: Equations, group: OnPlanes, chosen: Array) -> Any:
    """heyoka's function of (t, h, q, w, w', numbers)."""
    module = heyoka()
    xp, space = Expressions(module), equations.space
    count_ = 2 + space.nq + 2 * space.nv + space.size - space.moving
    x = [module.expression(f"x{i}") for i in range(count_)]
    values = _held_step(equations, mechanism(equations.robot.model), group, chosen, x, xp)
    return module.cfunc([xp.lift(value) for value in values], vars=x, **UNOPTIMIZED)


def _held_step(
    equations: Equations, mech: Mechanism, group: OnPlanes, chosen: Array, x: list[Any], xp: Any
) -> list[Scalar]:
    """The entries of HeldStep, one after the other."""
    nq, nv = mech.nq, mech.nv
    t, h, q, rest = x[0], x[1], x[2 : 2 + nq], x[2 + nq :]
    w, change, numbers = rest[:nv], rest[nv : 2 * nv], rest[2 * nv :]
    half = 0.5 * h
    v = _own(mech, q, [a + half * b for a, b in zip(w, change, strict=True)], xp)
    at = poses(mech, q, xp)
    parents = mech.dof_parents()
    lower, inverse = ldlt(composite_bodies(mech, at), parents, xp)
    state = np.array([*q, *v, *numbers], dtype=object)
    a = ldlt_apply(lower, inverse, parents, unbalanced_forces(equations, mech, t, state, xp))
    start = _own(mech, q, w, xp)
    free = [plus(s, times(h, b)) for s, b in zip(start, _with_turning(mech, a, v), strict=True)]
    rows, gaps, places = _rows_of(mech, group, q, xp)
    own = [row for i in chosen.tolist() for row in rows[i]]
    inward = [ldlt_inward(lower, parents, row) for row in own]
    g: Matrix = [[plus(*(times(times(a, b), d) for a, b, d in zip(left, right, inverse, strict=True)))
                  for right in inward] for left in inward]  # fmt: skip
    after = [plus(*(times(a, b) for a, b in zip(row, free, strict=True))) for row in own]
    for i, k in enumerate(chosen.tolist()):
        after[3 * i + 2] = plus(after[3 * i + 2], xp.where(xp.less(gaps[k], 0.0), 0.0, 2.0 * gaps[k] / h))
    p = ldlt_solve(g, [k - 1 for k in range(len(g))], [-b for b in after], xp)
    u = [plus(b, *(times(c, y) for c, y in zip(row, p, strict=True))) for b, row in zip(after, g, strict=True)]
    pushed = [plus(*(times(z[k], y) for z, y in zip(inward, p, strict=True))) for k in range(nv)]
    end = [plus(a, b) for a, b in zip(free, ldlt_outward(lower, inverse, parents, pushed), strict=True)]
    held = chosen.tolist()
    overlaps = [xp.where(xp.less(gaps[i], 0.0), gaps[i], 0.0) for i in held]
    nu = ldlt_solve([row[2::3] for row in g[2::3]], [k - 1 for k in range(len(held))], [-x for x in overlaps], xp)
    lifted = [plus(*(times(z[k], y) for z, y in zip(inward[2::3], nu, strict=True))) for k in range(nv)]
    push = ldlt_outward(lower, inverse, parents, lifted)
    move = [plus(times(half, a), b) for a, b in zip(end, push, strict=True)]
    others = [plus(gap, *(times(a, b) for a, b in zip(row[2], move, strict=True)))
              for i, (gap, row) in enumerate(zip(gaps, rows, strict=True)) if i not in held]  # fmt: skip
    of_held = [*(gaps[i] for i in held), *(entry for i in held for entry in places[i])]
    return [*_own(mech, q, end, xp, -1), *p, *u, *of_held, *_own(mech, q, push, xp, -1), *nu, *others]


def _rows_of(mech: Mechanism, group: OnPlanes, q: list[Any], xp: Any) -> tuple[list[Matrix], list[Any], list[Any]]:
    """Of each point the rows of its velocity (3, nv), its gap, and its place."""
    rows, gaps, places = [], [], []
    for point, (joint, local) in enumerate(zip(group.joint.tolist(), group.local.tolist(), strict=True)):
        x, y, z = local
        placed, radius = Pose((IDENTITY,), (x, y, z)), float(group.radius[point])
        n = _vector(group.normal[point].tolist())
        centre = frame_placement(mech, q, joint, placed, xp)[1]
        gap = minus(dot(n, centre), float(group.height[point]) + radius)
        columns = [add(_vector(c[:3]), scale(-radius, cross(_vector(c[3:]), n)))
                   for c in zip(*frame_jacobian(mech, q, joint, placed, xp), strict=True)]  # fmt: skip
        axes = axes_of(group.normal[point][None])[0].tolist()
        rows.append([[dot(_vector(axis), column) for column in columns] for axis in axes])
        gaps.append(gap)
        places.append(add(centre, scale(-(radius + 0.5 * gap), n)))
    return rows, gaps, places


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
