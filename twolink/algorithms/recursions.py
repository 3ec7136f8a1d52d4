"""The recursions of rigid-body dynamics, M(q) a + h(q, v) = tau + J^T f_ext, over plain arithmetic.

Featherstone 2008, chapters 5 to 7. q, v, a, tau are sequences of
scalars: floats, NumPy arrays of a batch, or expressions; xp is the namespace of sin, cos (numpy or a tape).
Answers are lists of scalars. Everything is written in the bodies' own frames. f_ext gives, for a body's number, the
wrench (force, moment) on it at its joint's origin, in its joint's frame; bodies that are not named cost no operation.

Accelerations are classical, of the frames' origins, with the world accelerating by -g: the equation of motion
f = I a + (w x (w x h), w x I w) then needs no linear velocities, except through joints that slide.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple

from twolink.algorithms import spatial as sp
from twolink.algorithms.factors import ldlt_solve
from twolink.algorithms.joint_models import velocity_product
from twolink.algorithms.mechanism import Mechanism
from twolink.algorithms.spatial import ZERO, Inertia, Mat, Matrix, Pose, Scalar, Scalars, Spatial, Sym, Vec
from twolink.errors import QueryError

Axes = Literal["aligned", "local"]
Wrenches = Mapping[int, Scalars]
STILL: Spatial = (ZERO, ZERO)


def poses(mech: Mechanism, q: Scalars, xp: Any) -> list[Pose]:
    """Each body's pose in its parent's frame: X_T then X_J, as in Featherstone table 5.1."""
    steps = (sp.compose(mech.placements[i], mech.joints[i].pose(q, xp)) for i in mech.bodies)
    return [sp.AT_PARENT, *steps]


def rnea(
    mech: Mechanism, q: Scalars, v: Scalars, a: Scalars, f_ext: Wrenches | None = None, xp: Any = None
) -> list[Scalar]:
    """tau = M a + h - J^T f_ext, by the recursive Newton-Euler algorithm, Featherstone table 5.1."""
    return newton_euler(mech, poses(mech, q, xp), v, a, f_ext)


def bias(mech: Mechanism, q: Scalars, v: Scalars, f_ext: Wrenches | None = None, xp: Any = None) -> list[Scalar]:
    """h(q, v) = C v + g - J^T f_ext: inverse dynamics without acceleration, Featherstone chapter 6."""
    return rnea(mech, q, v, [0.0] * mech.nv, f_ext, xp)


def gravity_torque(mech: Mechanism, q: Scalars, xp: Any = None) -> list[Scalar]:
    """g(q): inverse dynamics at rest."""
    return rnea(mech, q, [0.0] * mech.nv, [0.0] * mech.nv, None, xp)


def newton_euler(mech: Mechanism, at: Sequence[Pose], v: Scalars, a: Scalars, f_ext: Wrenches | None) -> list[Scalar]:
    """Table 5.1 of Featherstone from the bodies' poses: accelerations outwards, forces inwards."""
    force = body_forces(mech, at, v, a, f_ext)
    tau = [sp.plus(sp.times(mech.armature[k], a[k]), sp.times(mech.damping[k], v[k])) for k in range(mech.nv)]
    for i in reversed(mech.bodies):
        joint, p = mech.joints[i], mech.parents[i]
        for k, s in zip(joint.dofs, joint.subspace, strict=True):
            tau[k] = sp.plus(tau[k], sp.spatial_dot(s, force[i]))
        if p:
            force[p] = sp.spatial_add(force[p], sp.force_to_parent(at[i], force[i]))
    return tau


def body_forces(mech: Mechanism, at: Sequence[Pose], v: Scalars, a: Scalars, f_ext: Wrenches | None) -> list[Spatial]:
    """The force that moves each body alone, less the wrench on it: the outward pass of Featherstone table 5.1."""
    w: list[Vec] = [ZERO]
    moved: list[Spatial] = [(sp.scale(-1.0, mech.gravity), ZERO)]
    gradient: list[Mat] = [sp.acceleration_gradient(ZERO, ZERO)]
    force: list[Spatial] = [STILL]
    for i in mech.bodies:
        joint, p, relative = mech.joints[i], mech.parents[i], mech.joints[i].motion(v)
        turned = sp.inward(at[i], w[p])
        linear = sp.inward(at[i], sp.add(moved[p][0], sp.rotate(gradient[p], at[i].origin)))
        angular = sp.inward(at[i], moved[p][1])
        moved.append(sp.spatial_add((linear, angular), velocity_product(joint, turned, relative), joint.motion(a)))
        w.append(sp.add(turned, relative[1]))
        gradient.append(sp.acceleration_gradient(w[i], moved[i][1]))
        force.append(sp.inertial_force(mech.inertias[i], moved[i][0], gradient[i]))
    for i, wrench in (f_ext or {}).items():
        x, y, z, *moment = (sp.negative(component) for component in wrench)
        force[i] = sp.spatial_add(force[i], ((x, y, z), (moment[0], moment[1], moment[2])))
    return force


def crba(mech: Mechanism, q: Scalars, xp: Any = None) -> Matrix:
    """M(q), nv rows of nv, by the composite-rigid-body algorithm, Featherstone table 6.2."""
    return composite_bodies(mech, poses(mech, q, xp))


def composite_bodies(mech: Mechanism, at: Sequence[Pose]) -> Matrix:
    """Table 6.2 of Featherstone from the bodies' poses. Entries between branches are the constant 0."""
    matrix: Matrix = [[0.0] * mech.nv for _ in range(mech.nv)]
    composite = list(mech.inertias)
    for i in reversed(mech.bodies):
        joint, p = mech.joints[i], mech.parents[i]
        if p:
            composite[p] = sp.inertia_add(composite[p], sp.inertia_to_parent(at[i], composite[i]))
        for n, k in enumerate(joint.dofs):
            force = sp.inertia_times(composite[i], joint.subspace[n])
            for m, other in enumerate(joint.dofs[: n + 1]):
                _enter(matrix, k, other, sp.spatial_dot(joint.subspace[m], force), same=m == n)
            for body in mech.support(i)[:-1]:
                force = sp.force_to_parent(at[body], force)
                above = mech.joints[mech.parents[body]]
                for other, s in zip(above.dofs, above.subspace, strict=True):
                    _enter(matrix, k, other, sp.spatial_dot(s, force), same=False)
    for k in range(mech.nv):
        matrix[k][k] = sp.plus(matrix[k][k], mech.armature[k])
    return matrix


def _enter(matrix: Matrix, i: int, j: int, value: Scalar, *, same: bool) -> None:
    """Add the coupling of two joint motions: to (i, j) and (j, i), once only where both are the same motion."""
    matrix[i][j] = sp.plus(matrix[i][j], value)
    if not same:  # a mimic joint's motion couples to its own dof twice, in either order
        matrix[j][i] = sp.plus(matrix[j][i], value)


def forward_dynamics_crba(
    mech: Mechanism, q: Scalars, v: Scalars, tau: Scalars, f_ext: Wrenches | None = None, xp: Any = None
) -> list[Scalar]:
    """a = M^-1 (tau - h), by the mass matrix, Featherstone chapter 6."""
    at = poses(mech, q, xp)
    h = newton_euler(mech, at, v, [0.0] * mech.nv, f_ext)
    effort = [sp.minus(t, x) for t, x in zip(tau, h, strict=True)]
    return ldlt_solve(composite_bodies(mech, at), mech.dof_parents(), effort, xp)


def energy(mech: Mechanism, q: Scalars, v: Scalars, xp: Any = None) -> tuple[Scalar, Scalar]:
    """(kinetic v . M v / 2, potential -sum g . (m r + R h)), J; potential is 0 at the world's origin."""
    at = poses(mech, q, xp)
    world: list[Pose] = [at[0]]
    motion: list[Spatial] = [STILL]
    twice = sp.plus(*(sp.times(mech.armature[k], sp.times(v[k], v[k])) for k in range(mech.nv)))
    moment = mech.inertias[0].first
    for i in mech.bodies:
        p, body = mech.parents[i], mech.inertias[i]
        motion.append(sp.spatial_add(sp.motion_to_child(at[i], motion[p]), mech.joints[i].motion(v)))
        world.append(sp.single_turn(sp.compose(world[p], at[i])))
        twice = sp.plus(twice, sp.spatial_dot(motion[i], sp.inertia_times(body, motion[i])))
        moment = sp.add(moment, sp.scale(body.mass, world[i].origin), sp.outward(world[i], body.first))
    return sp.times(0.5, twice), sp.negative(sp.dot(mech.gravity, moment))


def frame_placement(
    mech: Mechanism, q: Scalars, body: int, placement: Pose = sp.AT_PARENT, xp: Any = None
) -> tuple[Mat, Vec]:
    """(R, r) in the world of a frame that sits at `placement` in the body's joint frame."""
    pose = placement
    for i in mech.support(body):
        pose = sp.single_turn(sp.compose(sp.compose(mech.placements[i], mech.joints[i].pose(q, xp)), pose))
    return pose.turns[0], pose.origin


def frame_jacobian(
    mech: Mechanism, q: Scalars, body: int, placement: Pose = sp.AT_PARENT, xp: Any = None, axes: Axes = "aligned"
) -> Matrix:
    """J (6 rows of nv): J v = (velocity of the frame's origin, angular velocity).

    axes: "local", along the frame's own (Pinocchio's LOCAL), or "aligned" with the world's (LOCAL_WORLD_ALIGNED).
    """
    columns: list[Spatial] = [STILL] * mech.nv
    pose = placement  # of the frame, seen from the body that is being visited
    for i in mech.support(body):
        joint = mech.joints[i]
        for k, s in zip(joint.dofs, joint.subspace, strict=True):
            columns[k] = sp.spatial_add(columns[k], sp.motion_to_child(pose, s))
        pose = sp.single_turn(sp.compose(sp.compose(mech.placements[i], joint.pose(q, xp)), pose))
    if axes == "aligned":
        columns = [(sp.outward(pose, c[0]), sp.outward(pose, c[1])) for c in columns]
    return [[(*c[0], *c[1])[row] for c in columns] for row in range(6)]


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
        what, remedy = '"aba" cannot follow mimic joints', 'leave it out, or use method="crba"'
        raise QueryError(what, argument="method", remedy=remedy)
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
            share, a[k] = sp.spatial_scale(inverse, u), sp.times(inverse, effort)
            inertia[i] = articulated_without(inertia[i], u, share, s if sp.is_zero(mech.armature[k]) else None)
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
