"""Derivatives of M(q) a + h(q, v) = tau in closed form, over plain arithmetic.

After Singh, Russell and Wensing 2022, "Efficient Analytical Derivatives of Rigid-Body Dynamics using Spatial Vector
Algebra" (IEEE Robotics and Automation Letters), with composite bodies, here for classical accelerations and in the
bodies' own frames. Derivatives to q are along tangent directions: dq[k] moves a joint along its own motion axis, as v
does, which is Pinocchio's convention.

What a small motion along one joint's axis changes, as seen from that joint's body: every point x of the bodies it
carries, moving with the velocity x', is accelerated in addition by

    gamma + beta x x + 2 delta x x'

where delta is the change of the body's angular velocity. The force this takes needs only three sums over the bodies
carried: their inertia I, their momentum P = integral of x' dm, and their flow Z = integral of x x'^T dm,

    (force, moment) = I (gamma, beta) + (2 delta x P, N delta),  N = 2 (tr(Z) 1 - Z^T).
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

from twolink.algorithms import spatial as sp
from twolink.algorithms.factors import ldlt, ldlt_apply, ldlt_inverse
from twolink.algorithms.joint_models import velocity_product
from twolink.algorithms.mechanism import Mechanism
from twolink.algorithms.recursions import composite_bodies, newton_euler, poses
from twolink.algorithms.spatial import ZERO, Inertia, Mat, Matrix, Pose, Scalar, Scalars, Spatial, Vec
from twolink.errors import QueryError

Derivatives = tuple[Matrix, Matrix, Matrix]


def inverse_dynamics_derivatives(mech: Mechanism, q: Scalars, v: Scalars, a: Scalars, xp: Any = None) -> Derivatives:
    """(d tau/dq, d tau/dv, d tau/da = M), each nv rows of nv: entry [i][k] is d tau_i along direction k.

    Entries between branches are the constant 0. Raises QueryError for mimic joints.
    """
    _refuse_mimic(mech)
    at = poses(mech, q, xp)
    return *_torque_derivatives(mech, at, v, a), composite_bodies(mech, at)


def forward_dynamics_derivatives(mech: Mechanism, q: Scalars, v: Scalars, tau: Scalars, xp: Any = None) -> Derivatives:
    """(da/dq, da/dv, da/dtau = M^-1), each nv rows of nv: entry [i][k] is da_i along direction k.

    da = -M^-1 (d tau/dq, d tau/dv) at the acceleration that tau gives: Carpentier and Mansard 2018, "Analytical
    Derivatives of Rigid Body Dynamics Algorithms". Raises QueryError for mimic joints.
    """
    _refuse_mimic(mech)
    at, parents = poses(mech, q, xp), mech.dof_parents()
    lower, inverse = ldlt(composite_bodies(mech, at), parents, xp)
    h = newton_euler(mech, at, v, [0.0] * mech.nv, None)
    a = ldlt_apply(lower, inverse, parents, [sp.minus(t, x) for t, x in zip(tau, h, strict=True)])

    def solved(torques: Matrix) -> Matrix:
        columns = ([sp.negative(x) for x in column] for column in zip(*torques, strict=True))
        return [list(row) for row in zip(*(ldlt_apply(lower, inverse, parents, c) for c in columns), strict=True)]

    by_q, by_v = _torque_derivatives(mech, at, v, a)
    return solved(by_q), solved(by_v), ldlt_inverse(lower, inverse, parents)


def _refuse_mimic(mech: Mechanism) -> None:
    if mech.has_mimic:
        remedy = "remove the <mimic> elements, or take finite differences of the dynamics"
        raise QueryError("derivatives are not available for mimic joints", where="robot", remedy=remedy)


class _Flow(NamedTuple):
    """I, P, Z of a set of bodies (module docstring), and the force (force, moment) that accelerates them."""

    inertia: Inertia
    momentum: Vec
    flow: Mat
    force: Spatial


class _Change(NamedTuple):
    """The change of a body by a unit step along one direction: delta and (gamma, beta)."""

    delta: Vec
    motion: Spatial


class _MovingBody(NamedTuple):
    """A body's motion in its own frame, and what steps along its joint's directions change.

    spin: its angular velocity; velocity, of its origin; moved: its acceleration (classical linear, angular);
    gradient: U of `acceleration_gradient`. by_q, by_v: one change a degree of freedom of its joint.
    """

    spin: Vec
    velocity: Vec
    moved: Spatial
    gradient: Mat
    by_q: Sequence[_Change] = ()
    by_v: Sequence[_Change] = ()


def _torque_derivatives(mech: Mechanism, at: Sequence[Pose], v: Scalars, a: Scalars) -> tuple[Matrix, Matrix]:
    """d tau/dq and d tau/dv from the bodies' poses."""
    moving = _moving(mech, at, v, a)
    carried = _carried(mech, at, moving)
    by_q: Matrix = [[0.0] * mech.nv for _ in range(mech.nv)]
    by_v: Matrix = [[0.0] * mech.nv for _ in range(mech.nv)]
    for i in mech.bodies:
        _rows(mech, at, moving, carried[i], i, (by_q, by_v))
        _columns(mech, at, moving[i], carried[i], i, (by_q, by_v))
    for k in range(mech.nv):
        by_v[k][k] = sp.plus(by_v[k][k], mech.damping[k])
    return by_q, by_v


def _moving(mech: Mechanism, at: Sequence[Pose], v: Scalars, a: Scalars) -> list[_MovingBody]:
    """Velocities and accelerations from the root outwards, as in Featherstone table 5.1."""
    still = sp.acceleration_gradient(ZERO, ZERO)
    moving = [_MovingBody(ZERO, ZERO, (sp.scale(-1.0, mech.gravity), ZERO), still)]
    for i in mech.bodies:
        joint, parent, relative = mech.joints[i], moving[mech.parents[i]], mech.joints[i].motion(v)
        turned = sp.inward(at[i], parent.spin)
        here = sp.add(parent.moved[0], sp.rotate(parent.gradient, at[i].origin))
        passed = sp.inward(at[i], here), sp.inward(at[i], parent.moved[1])
        moved = sp.spatial_add(passed, velocity_product(joint, turned, relative), joint.motion(a))
        spin = sp.add(turned, relative[1])
        velocity = sp.add(sp.inward(at[i], sp.add(parent.velocity, sp.cross(parent.spin, at[i].origin))), relative[0])
        by_q = [_step_of_q(at[i], parent.gradient, turned, passed, relative, s) for s in joint.subspace]
        by_v = [_step_of_v(turned, relative, s) for s in joint.subspace]
        changes = ([_as_seen(spin, velocity, *step) for step in steps] for steps in (by_q, by_v))
        moving.append(_MovingBody(spin, velocity, moved, sp.acceleration_gradient(spin, moved[1]), *changes))
    return moving


def _step_of_q(
    pose: Pose, gradient: Mat, turned: Vec, passed: Spatial, relative: Spatial, s: Spatial
) -> tuple[Vec, Spatial]:
    """The change of a body's angular velocity and acceleration when its joint moves by a step along s.

    What comes from the parent (turned, passed) is seen along other axes, and at another point of the parent.
    """
    delta = sp.cross(turned, s[1])
    shifted = sp.inward(pose, sp.rotate(gradient, sp.outward(pose, s[0])))
    linear = sp.add(sp.cross(passed[0], s[1]), shifted, sp.cross(sp.scale(2.0, delta), relative[0]))
    return delta, (linear, sp.add(sp.cross(passed[1], s[1]), sp.cross(delta, relative[1])))


def _step_of_v(turned: Vec, relative: Spatial, s: Spatial) -> tuple[Vec, Spatial]:
    """The change of a body's angular velocity and acceleration when its joint's velocity grows by s."""
    linear = sp.add(sp.cross(s[1], relative[0]), sp.cross(sp.add(sp.scale(2.0, turned), relative[1]), s[0]))
    return s[1], (linear, sp.cross(turned, s[1]))


def _as_seen(spin: Vec, velocity: Vec, delta: Vec, motion: Spatial) -> _Change:
    """delta and (gamma, beta): the part of the changed acceleration that is not 2 delta x x'."""
    gamma = sp.add(motion[0], sp.scale(-2.0, sp.cross(delta, velocity)))
    return _Change(delta, (gamma, sp.add(motion[1], sp.cross(spin, delta))))


def _carried(mech: Mechanism, at: Sequence[Pose], moving: Sequence[_MovingBody]) -> list[_Flow]:
    """Each body joined with all it carries: sums from the leaves inwards, in the body's frame."""
    sums = [_flow_of(mech.inertias[i], moving[i]) for i in range(len(mech.parents))]
    for i in reversed(mech.bodies):
        if p := mech.parents[i]:
            child, parent = sums[i], sums[p]
            sums[p] = _Flow(
                sp.inertia_add(parent.inertia, sp.inertia_to_parent(at[i], child.inertia)),
                sp.add(parent.momentum, sp.outward(at[i], child.momentum)),
                sp.mat_add(parent.flow, _flow_to_parent(at[i], child)),
                sp.spatial_add(parent.force, sp.force_to_parent(at[i], child.force)),
            )
    return sums


def _flow_of(inertia: Inertia, body: _MovingBody) -> _Flow:
    """One body's sums: P = m v + w x h, Z = h v^T + Sigma [w x]^T."""
    momentum = sp.add(sp.scale(inertia.mass, body.velocity), sp.cross(body.spin, inertia.first))
    spun = sp.product(sp.full(inertia.second), sp.transpose(sp.skew(body.spin)))
    x, y, z = (sp.add(spun[r], sp.scale(inertia.first[r], body.velocity)) for r in range(3))
    return _Flow(inertia, momentum, (x, y, z), sp.inertial_force(inertia, body.moved[0], body.gradient))


def _flow_to_parent(pose: Pose, body: _Flow) -> Mat:
    """Z in the parent's frame: R Z R^T + r (R P)^T."""
    flow, momentum = body.flow, sp.outward(pose, body.momentum)
    for turn in reversed(pose.turns):
        flow = sp.congruence(turn, flow)
    x, y, z = (sp.add(flow[r], sp.scale(pose.origin[r], momentum)) for r in range(3))
    return x, y, z


def _turning(flow: Mat) -> Mat:
    """N = 2 (tr(Z) 1 - Z^T)."""
    trace = sp.plus(flow[0][0], flow[1][1], flow[2][2])

    def entry(r: int, c: int) -> Scalar:
        return sp.times(2.0, sp.minus(trace, flow[r][c])) if r == c else sp.times(-2.0, flow[c][r])

    return tuple(tuple(entry(r, c) for c in range(3)) for r in range(3))  # type: ignore[return-value]


def _rows(
    mech: Mechanism, at: Sequence[Pose], moving: Sequence[_MovingBody], body: _Flow, i: int, out: tuple[Matrix, Matrix]
) -> None:
    """Joint i's torques under steps of its own directions and of those of the joints that carry it.

    s . (I (gamma, beta) + (2 delta x P, N delta)) = (gamma, beta) . I s + delta . (2 P x s_linear + N^T s_angular).
    """
    joint, turning = mech.joints[i], sp.transpose(_turning(body.flow))
    for k, s in zip(joint.dofs, joint.subspace, strict=True):
        force = sp.inertia_times(body.inertia, s)
        twist = sp.add(sp.cross(sp.scale(2.0, body.momentum), s[0]), sp.rotate(turning, s[1]))
        for below, above in ((i, i), *pairwise(mech.support(i))):
            if below != above:
                force, twist = sp.force_to_parent(at[below], force), sp.outward(at[below], twist)
            for matrix, changes in zip(out, (moving[above].by_q, moving[above].by_v), strict=True):
                for other, change in zip(mech.joints[above].dofs, changes, strict=True):
                    matrix[k][other] = sp.plus(sp.spatial_dot(change.motion, force), sp.dot(twist, change.delta))


def _columns(
    mech: Mechanism, at: Sequence[Pose], motion_of: _MovingBody, body: _Flow, i: int, out: tuple[Matrix, Matrix]
) -> None:
    """The columns of the derivatives by joint i, in the rows of the joints that carry it.

    A step of q also turns and shifts the force itself, which rides on the body: s x* f.
    """
    joint, turning = mech.joints[i], _turning(body.flow)
    linear, moment = body.force
    for matrix, changes, moves in zip(out, (motion_of.by_q, motion_of.by_v), (True, False), strict=True):
        for k, s, (delta, motion) in zip(joint.dofs, joint.subspace, changes, strict=True):
            force = sp.inertia_times(body.inertia, motion)
            force = sp.spatial_add(force, (sp.cross(sp.scale(2.0, delta), body.momentum), sp.rotate(turning, delta)))
            if moves:
                force = sp.spatial_add(
                    force, (sp.cross(s[1], linear), sp.add(sp.cross(s[1], moment), sp.cross(s[0], linear)))
                )
            for below, above in pairwise(mech.support(i)):
                force = sp.force_to_parent(at[below], force)
                for other, axis in zip(mech.joints[above].dofs, mech.joints[above].subspace, strict=True):
                    matrix[other][k] = sp.spatial_dot(axis, force)
