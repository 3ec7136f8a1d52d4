"""Forward dynamics by articulated bodies, over plain arithmetic. Featherstone 2008, chapter 7."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from twolink.algorithms.joint_models import velocity_product
from twolink.algorithms.mechanism import Mechanism
from twolink.algorithms.recursions import STILL, Wrenches, poses, subtract_wrenches
from twolink.algorithms.spatial import (
    ENTRIES,
    ZERO,
    Inertia,
    Mat,
    Pose,
    Scalar,
    Scalars,
    Spatial,
    Sym,
    Vec,
    acceleration_gradient,
    add,
    congruence,
    constant,
    force_to_parent,
    full,
    inertial_force,
    inward,
    mat_add,
    minus,
    motion_to_child,
    plus,
    product,
    reciprocal,
    rotate,
    rotational_inertia,
    scale,
    skew,
    spatial_add,
    spatial_dot,
    spatial_scale,
    sym_add,
    times,
    transpose,
)
from twolink.errors import QueryError


class Articulated(NamedTuple):
    """An articulated-body inertia in 3x3 blocks: force = linear a + coupling w, moment = coupling^T a + angular w."""

    linear: Sym
    coupling: Mat
    angular: Sym


def articulated(body: Inertia) -> Articulated:
    """A rigid body's inertia as 6x6 blocks: (m 1, -[h x]; [h x], I)."""
    m = body.mass
    return Articulated((m, 0.0, 0.0, m, 0.0, m), transpose(skew(body.first)), rotational_inertia(body.second))


def articulated_add(a: Articulated, b: Articulated) -> Articulated:
    """a + b."""
    return Articulated(sym_add(a.linear, b.linear), mat_add(a.coupling, b.coupling), sym_add(a.angular, b.angular))


def articulated_times(body: Articulated, m: Spatial) -> Spatial:
    """I m."""
    return (
        add(rotate(full(body.linear), m[0]), rotate(body.coupling, m[1])),
        add(rotate(transpose(body.coupling), m[0]), rotate(full(body.angular), m[1])),
    )


def articulated_without(body: Articulated, u: Spatial, inverse: Scalar, s: Spatial | None) -> Articulated:
    """I - u u^T / D: the inertia felt across a free joint axis s, where u = I s, D = s . u.

    The result has nothing along s: where s is a coordinate axis its row and column are the constant 0, told here
    so that no operation is spent on them. s is None when D has an armature in it.
    """
    axis = (*s[0], *s[1]) if s else ()
    gone = axis.index(1.0) if s and sorted(axis) == [0.0] * 5 + [1.0] else None
    entries, scaled = (*u[0], *u[1]), tuple(times(inverse, x) for x in (*u[0], *u[1]))

    def entry(old: Scalar, i: int, j: int) -> Scalar:
        return 0.0 if gone in (i, j) else minus(old, times(entries[i], scaled[j]))

    linear = tuple(entry(body.linear[n], i, j) for n, (i, j) in enumerate(ENTRIES))
    angular = tuple(entry(body.angular[n], i + 3, j + 3) for n, (i, j) in enumerate(ENTRIES))
    coupling = tuple(tuple(entry(body.coupling[i][j], i, j + 3) for j in range(3)) for i in range(3))
    return Articulated(linear, coupling, angular)  # type: ignore[arg-type]


def articulated_to_parent(pose: Pose, body: Articulated) -> Articulated:
    """A child's articulated inertia in the parent's frame: X* I X, by blocks."""
    (linear, turned, angular), r = body, skew(pose.origin)
    for turn in reversed(pose.turns):
        linear, angular = congruence(turn, linear), congruence(turn, angular)
        turned = product(product(turn, turned), transpose(turn))
    coupling = mat_add(turned, _negated(product(full(linear), r)))
    shifted = mat_add(product(r, coupling), _negated(product(transpose(turned), r)))
    return Articulated(linear, coupling, sym_add(angular, _upper(shifted)))


def _negated(m: Mat) -> Mat:
    return scale(-1.0, m[0]), scale(-1.0, m[1]), scale(-1.0, m[2])


def _upper(m: Mat) -> Sym:
    return m[0][0], m[0][1], m[0][2], m[1][1], m[1][2], m[2][2]


def forward_dynamics_aba(
    mech: Mechanism, q: Scalars, v: Scalars, tau: Scalars, f_ext: Wrenches | None = None, xp: Any = None
) -> list[Scalar]:
    """a by the articulated-body algorithm, Featherstone table 7.1; a joint's degrees of freedom one by one."""
    if mech.has_mimic:
        raise QueryError('"aba" cannot follow mimic joints', argument="method", remedy='use method="crba"')
    at = poses(mech, q, xp)
    drift, force = _velocity_terms(mech, at, v, f_ext)
    inertia = [articulated(body) for body in mech.inertias]
    axes: list[list[_Axis]] = [[] for _ in mech.parents]
    for i in reversed(mech.bodies):
        p, joint = mech.parents[i], mech.joints[i]
        for k, s in zip(joint.dofs, joint.subspace, strict=True):
            u = articulated_times(inertia[i], s)
            inverse = reciprocal(plus(spatial_dot(s, u), mech.armature[k]), xp)
            effort = minus(minus(tau[k], times(mech.damping[k], v[k])), spatial_dot(s, force[i]))
            alone = constant(mech.armature[k]) and mech.armature[k] == 0.0
            inertia[i] = articulated_without(inertia[i], u, inverse, s if alone else None)
            force[i] = spatial_add(force[i], spatial_scale(times(effort, inverse), u))
            axes[i].append((k, s, u, inverse, effort))
        if p:
            passed = spatial_add(force[i], articulated_times(inertia[i], drift[i]))
            inertia[p] = articulated_add(inertia[p], articulated_to_parent(at[i], inertia[i]))
            force[p] = spatial_add(force[p], force_to_parent(at[i], passed))
    return _outward(mech, at, drift, axes)


_Axis = tuple[int, Spatial, Spatial, Scalar, Scalar]  # dof, S, U = I S, 1 / D, tau - S . p


def _velocity_terms(
    mech: Mechanism, at: Sequence[Pose], v: Scalars, f_ext: Wrenches | None
) -> tuple[list[Spatial], list[Spatial]]:
    """c and p of Featherstone table 7.1, for classical accelerations: what velocities and wrenches alone give."""
    w: list[Vec] = [ZERO]
    drift, force = [STILL], [STILL]
    for i in mech.bodies:
        joint, p, own = mech.joints[i], mech.parents[i], mech.joints[i].motion(v)
        turned = inward(at[i], w[p])
        centripetal = inward(at[i], rotate(acceleration_gradient(w[p], ZERO), at[i].origin))
        drift.append(spatial_add((centripetal, ZERO), velocity_product(joint, turned, own)))
        w.append(add(turned, own[1]))
        force.append(inertial_force(mech.inertias[i], ZERO, acceleration_gradient(w[i], ZERO)))
    subtract_wrenches(force, f_ext)
    return drift, force


def _outward(
    mech: Mechanism, at: Sequence[Pose], drift: Sequence[Spatial], axes: Sequence[Sequence[_Axis]]
) -> list[Scalar]:
    """The last pass of Featherstone table 7.1: accelerations, from the root outwards."""
    a: list[Scalar] = [0.0] * mech.nv
    moved: list[Spatial] = [(scale(-1.0, mech.gravity), ZERO)]
    for i in mech.bodies:
        here = spatial_add(motion_to_child(at[i], moved[mech.parents[i]]), drift[i])
        for k, s, u, inverse, effort in reversed(axes[i]):
            a[k] = times(inverse, minus(effort, spatial_dot(u, here)))
            here = spatial_add(here, spatial_scale(a[k], s))
        moved.append(here)
    return a
