"""Forward dynamics by articulated bodies, over plain arithmetic. Featherstone 2008, chapter 7."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from twolink.algorithms import spatial as sp
from twolink.algorithms.joint_models import velocity_product
from twolink.algorithms.mechanism import Mechanism
from twolink.algorithms.recursions import STILL, Wrenches, poses, subtract_wrenches
from twolink.algorithms.spatial import ZERO, Inertia, Mat, Pose, Scalar, Scalars, Spatial, Sym, Vec
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


def articulated_without(body: Articulated, u: Spatial, inverse: Scalar, s: Spatial | None) -> Articulated:
    """I - u u^T / D: the inertia felt across a free joint axis s, where u = I s, D = s . u.

    The result has no inertia along s. Where s is a coordinate axis, its row and column are set to the constant 0, so
    that no operation is spent on them. s is None when D has an armature in it.
    """
    axis = (*s[0], *s[1]) if s else ()
    zero_row = axis.index(1.0) if s and sorted(axis) == [0.0] * 5 + [1.0] else None
    entries, scaled = (*u[0], *u[1]), tuple(sp.times(inverse, x) for x in (*u[0], *u[1]))

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
        linear, angular = sp.congruence(turn, linear), sp.congruence(turn, angular)
        turned = sp.product(sp.product(turn, turned), sp.transpose(turn))
    coupling = sp.mat_add(turned, _negated(sp.product(sp.full(linear), r)))
    shifted = sp.mat_add(sp.product(r, coupling), _negated(sp.product(sp.transpose(turned), r)))
    return Articulated(linear, coupling, sp.sym_add(angular, _upper(shifted)))


def _negated(m: Mat) -> Mat:
    return sp.scale(-1.0, m[0]), sp.scale(-1.0, m[1]), sp.scale(-1.0, m[2])


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
            inverse = sp.reciprocal(sp.plus(sp.spatial_dot(s, u), mech.armature[k]), xp)
            effort = sp.minus(sp.minus(tau[k], sp.times(mech.damping[k], v[k])), sp.spatial_dot(s, force[i]))
            alone = sp.constant(mech.armature[k]) and mech.armature[k] == 0.0
            inertia[i] = articulated_without(inertia[i], u, inverse, s if alone else None)
            force[i] = sp.spatial_add(force[i], sp.spatial_scale(sp.times(effort, inverse), u))
            axes[i].append((k, s, u, inverse, effort))
        if p:
            passed = sp.spatial_add(force[i], articulated_times(inertia[i], drift[i]))
            inertia[p] = articulated_add(inertia[p], articulated_to_parent(at[i], inertia[i]))
            force[p] = sp.spatial_add(force[p], sp.force_to_parent(at[i], passed))
    return _outward(mech, at, drift, axes)


_Axis = tuple[int, Spatial, Spatial, Scalar, Scalar]  # dof, S, U = I S, 1 / D, tau - S . p


def _velocity_terms(
    mech: Mechanism, at: Sequence[Pose], v: Scalars, f_ext: Wrenches | None
) -> tuple[list[Spatial], list[Spatial]]:
    """c and p of Featherstone table 7.1, for classical accelerations: what velocities and wrenches alone give."""
    w: list[Vec] = [ZERO]
    drift, force = [STILL], [STILL]
    for i in mech.bodies:
        joint, p, relative = mech.joints[i], mech.parents[i], mech.joints[i].motion(v)
        turned = sp.inward(at[i], w[p])
        centripetal = sp.inward(at[i], sp.rotate(sp.acceleration_gradient(w[p], ZERO), at[i].origin))
        drift.append(sp.spatial_add((centripetal, ZERO), velocity_product(joint, turned, relative)))
        w.append(sp.add(turned, relative[1]))
        force.append(sp.inertial_force(mech.inertias[i], ZERO, sp.acceleration_gradient(w[i], ZERO)))
    subtract_wrenches(force, f_ext)
    return drift, force


def _outward(
    mech: Mechanism, at: Sequence[Pose], drift: Sequence[Spatial], axes: Sequence[Sequence[_Axis]]
) -> list[Scalar]:
    """The last pass of Featherstone table 7.1: accelerations, from the root outwards."""
    a: list[Scalar] = [0.0] * mech.nv
    moved: list[Spatial] = [(sp.scale(-1.0, mech.gravity), ZERO)]
    for i in mech.bodies:
        here = sp.spatial_add(sp.motion_to_child(at[i], moved[mech.parents[i]]), drift[i])
        for k, s, u, inverse, effort in reversed(axes[i]):
            a[k] = sp.times(inverse, sp.minus(effort, sp.spatial_dot(u, here)))
            here = sp.spatial_add(here, sp.spatial_scale(a[k], s))
        moved.append(here)
    return a
