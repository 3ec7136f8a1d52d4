"""Forward dynamics by articulated bodies, over plain arithmetic. Featherstone 2008, chapter 7."""

from typing import Any, NamedTuple

from twolink.algorithms import spatial as sp
from twolink.algorithms.mechanism import Mechanism
from twolink.algorithms.recursions import STILL, Wrenches, body_forces, poses
from twolink.algorithms.spatial import Inertia, Mat, Pose, Scalar, Scalars, Spatial, Sym
from twolink.errors import QueryError


class Articulated(NamedTuple):
    """An articulated-body inertia in 3x3 blocks: force = linear a + coupling w, moment = coupling^T a + angular w."""

    linear: Sym
    coupling: Mat
    angular: Sym


def articulated(body: Inertia) -> Articulated:
    """A rigid body's inertia as 6x6 blocks: (m 1, -[h x]; [h x], I)."""
    m = body.mass
    return Articulated((m, 0.0, 0.0, m, 0.0, m), sp.transpose(sp.skew(body.first)), sp.rotational_inertia(body.second))


def articulated_add(a: Articulated, b: Articulated) -> Articulated:
    """a + b."""
    return Articulated(
        sp.sym_add(a.linear, b.linear), sp.mat_add(a.coupling, b.coupling), sp.sym_add(a.angular, b.angular)
    )


def articulated_times(body: Articulated, m: Spatial) -> Spatial:
    """I m."""
    return (
        sp.add(sp.rotate(sp.full(body.linear), m[0]), sp.rotate(body.coupling, m[1])),
        sp.add(sp.rotate(sp.transpose(body.coupling), m[0]), sp.rotate(sp.full(body.angular), m[1])),
    )


def articulated_without(body: Articulated, u: Spatial, share: Spatial, s: Spatial | None) -> Articulated:
    """I - u u^T / D: the inertia felt across a free joint axis s, where u = I s, D = s . u, share = u / D.

    The result has no inertia along s. Where s is a coordinate axis, its row and column are set to the constant 0, so
    that no operation is spent on them. s is None when D has an armature in it.
    """
    axis = (*s[0], *s[1]) if s else ()
    zero_row = axis.index(1.0) if s and sorted(axis) == [0.0] * 5 + [1.0] else None
    entries, scaled = (*u[0], *u[1]), (*share[0], *share[1])

    def entry(old: Scalar, i: int, j: int) -> Scalar:
        return 0.0 if zero_row in (i, j) else sp.minus(old, sp.times(entries[i], scaled[j]))

    linear = tuple(entry(body.linear[n], i, j) for n, (i, j) in enumerate(sp.ENTRIES))
    angular = tuple(entry(body.angular[n], i + 3, j + 3) for n, (i, j) in enumerate(sp.ENTRIES))
    coupling = tuple(tuple(entry(body.coupling[i][j], i, j + 3) for j in range(3)) for i in range(3))
    return Articulated(linear, coupling, angular)  # type: ignore[arg-type]


def articulated_to_parent(pose: Pose, body: Articulated) -> Articulated:
    """A child's articulated inertia in the parent's frame: X* I X, by blocks."""
    (linear, turned, angular), r = body, sp.skew(pose.origin)
    for turn in reversed(pose.turns):
        linear, angular = (sp.upper(sp.congruence(turn, sp.full(m))) for m in (linear, angular))
        turned = sp.congruence(turn, turned)
    coupling = sp.mat_add(turned, _negated(sp.product(sp.full(linear), r)))
    shifted = sp.mat_add(sp.product(r, coupling), _negated(sp.product(sp.transpose(turned), r)))
    return Articulated(linear, coupling, sp.sym_add(angular, sp.upper(shifted)))


def _negated(m: Mat) -> Mat:
    return sp.scale(-1.0, m[0]), sp.scale(-1.0, m[1]), sp.scale(-1.0, m[2])


def forward_dynamics_aba(
    mech: Mechanism, q: Scalars, v: Scalars, tau: Scalars, f_ext: Wrenches | None = None, xp: Any = None
) -> list[Scalar]:
    """a by the articulated-body algorithm, Featherstone table 7.1; a joint's degrees of freedom one by one.

    The motion with a = 0 is computed first, and the articulated bodies tell how much the motion differs from it. This
    saves the products of articulated inertias with accelerations that come from velocities.
    """
    if mech.has_mimic:
        raise QueryError('"aba" cannot follow mimic joints', argument="method", remedy='use method="crba"')
    at = poses(mech, q, xp)
    force = body_forces(mech, at, v, [0.0] * mech.nv, f_ext)
    inertia = [articulated(body) for body in mech.inertias]
    axes: list[list[tuple[int, Spatial, Spatial]]] = [[] for _ in mech.parents]  # dof, S, I S / D
    a: list[Scalar] = [0.0] * mech.nv
    for i in reversed(mech.bodies):
        p, joint = mech.parents[i], mech.joints[i]
        for k, s in zip(joint.dofs, joint.subspace, strict=True):
            u = articulated_times(inertia[i], s)
            inverse = sp.reciprocal(sp.plus(sp.spatial_dot(s, u), mech.armature[k]), xp)
            effort = sp.minus(sp.minus(tau[k], sp.times(mech.damping[k], v[k])), sp.spatial_dot(s, force[i]))
            alone = sp.constant(mech.armature[k]) and mech.armature[k] == 0.0
            share, a[k] = sp.spatial_scale(inverse, u), sp.times(inverse, effort)
            inertia[i] = articulated_without(inertia[i], u, share, s if alone else None)
            force[i] = sp.spatial_add(force[i], sp.spatial_scale(a[k], u))
            axes[i].append((k, s, share))
        if p:
            inertia[p] = articulated_add(inertia[p], articulated_to_parent(at[i], inertia[i]))
            force[p] = sp.spatial_add(force[p], sp.force_to_parent(at[i], force[i]))
    moved = [STILL]  # beyond the motion with a = 0
    for i in mech.bodies:
        here = sp.motion_to_child(at[i], moved[mech.parents[i]])
        for k, s, share in reversed(axes[i]):
            a[k] = sp.minus(a[k], sp.spatial_dot(share, here))
            here = sp.spatial_add(here, sp.spatial_scale(a[k], s))
        moved.append(here)
    return a
