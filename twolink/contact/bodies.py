"""The bodies of a scene as time stepping sees them: places, free acceleration, inverse mass matrix, contact Jacobians.

    w' = (M + h D / 2)^-1 (tau - bias + D dv),   U = J w

U: the relative velocity of two bodies at a point, along its normal last. w: the velocity v with the linear velocities
of free and planar joints along the axes of their parents, in which they do not change while a body only turns. D: the
viscosity of joints, which is taken at the mean velocity of the step, so that no step is too long for it; tau has it at
a velocity that is dv ahead of that at the begin.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pinocchio as pin
import scipy.sparse as sparse

from twolink.algorithms.mechanism import mechanism
from twolink.algorithms.namespaces import Numbers
from twolink.geometry.points import Places, Points
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.formulas import effect_loads, motion_of, unbalanced_forces
from twolink.integrate.motion.state import Array
from twolink.native.instructions import Assembled
from twolink.native.machine import Program, trace
from twolink.native.programs import program_named, require_agreement

LIN, ANG = np.arange(3), np.arange(3, 6)


class Multibody:
    """A robot of any joints, by Pinocchio, with full matrices. M and J are for w."""

    def __init__(self, equations: Equations) -> None:
        self.equations = equations
        self.model = model = equations.robot.model
        self.data = equations.robot.data  # of this thread; Pinocchio's takes nv^3 numbers
        self.program = _forces_program(self) if equations.effects else None
        self.moving_axes = [joint for joint in equations.robot.joints if joint.kind in ("free-flyer", "planar")]
        free = [joint.v.start for joint in equations.robot.joints if joint.kind == "free-flyer"]
        self.angular = np.array(free, dtype=int)[:, None] + ANG
        self.viscosity = viscosity_of(equations)
        self.carries = np.zeros((model.njoints, model.nv))  # whether a joint moves with a degree of freedom
        for joint in range(1, model.njoints):
            for j in model.supports[joint]:
                self.carries[joint, model.idx_vs[j] : model.idx_vs[j] + model.nvs[j]] = 1.0

    def to_local_velocity(self, q: Array, w: Array, sign: int = 1) -> Array:
        """v of w; w of v with the sign -1."""
        v = w.copy()
        for lin, rotation in self._axes(q):
            v[lin] = (rotation.T if sign > 0 else rotation) @ w[lin]
        return v

    def to_local_acceleration(self, q: Array, w: Array, change: Array) -> Array:
        """v' of w and its rate w': along axes that turn, R^T w' - omega x v."""
        v, a = self.to_local_velocity(q, w), self.to_local_velocity(q, change)
        for lin, _ in self._axes(q):
            a[lin] -= _turning(v, lin)
        return a

    def turning(self, w: Array, forces: Array) -> Array:
        """omega x tau (nv,) of free joints' torques: their rate along axes that turn with the body, if they do not."""
        out = np.zeros_like(forces)
        out[self.angular] = cross(w[self.angular], forces[self.angular])
        return out

    def moved(self, q: Array, change: Array) -> Array:
        """The configuration after a time in which w adds up to a change (nv,)."""
        turn = change.copy()
        for lin, _ in self._axes(q):
            turn[lin] = 0.0
        out = np.array(pin.integrate(self.model, q, turn))
        for joint in self.moving_axes:
            size = 3 if joint.kind == "free-flyer" else 2
            out[joint.q.start : joint.q.start + size] += change[joint.v.start : joint.v.start + size]
        return out

    def places(self, q: Array, v: Array) -> tuple[Places, Array]:
        """Poses of the joints, and of each its linear and angular speed (joints, 2), m/s and rad/s."""
        pin.forwardKinematics(self.model, self.data, q, v)
        at, moving = self.data.oMi, self.data.v
        speeds = np.linalg.norm(np.array([x.vector for x in moving]).reshape(-1, 2, 3), axis=2)
        return Places(np.array([x.rotation for x in at]), np.array([x.translation for x in at])), speeds

    def free_acceleration(
        self, t: float, q: Array, w: Array, numbers: Array, h: float = 0.0, ahead: Array | None = None
    ) -> Array:
        """w' (nv,) without contacts in a step of length h; what is asked for then is at this q.

        ahead: dv, by which w is ahead of the velocity at the begin of the step.
        """
        v, damped = self.to_local_velocity(q, w), h > 0.0 and self.viscosity.any()
        forces = self.forces(t, q, v, numbers)
        if damped:
            upper = np.array(pin.crba(self.model, self.data, q))
            mass = np.triu(upper) + np.triu(upper, 1).T + np.diag(0.5 * h * self.viscosity)
            inverse = np.linalg.inv(mass)
            forces = forces if ahead is None else forces + self.viscosity * ahead
        else:
            upper = np.array(pin.computeMinverse(self.model, self.data, self.equations.robot.with_bases_at_origin(q)))
            inverse = np.triu(upper) + np.triu(upper, 1).T
        a = inverse @ forces
        self._at, self._ways = q, list(self._axes(q))
        for lin, rotation in self._ways:
            a[lin] = rotation @ (a[lin] + _turning(v, lin))
            inverse[lin] = rotation @ inverse[lin]
            inverse[:, lin] = inverse[:, lin] @ rotation.T
        self.inverse: Any = inverse
        return np.asarray(a)

    def jacobian(self, points: Points, axes: Array) -> Any:
        """J (3n, nv) of points (n,) with axes (n, 3, 3), the normal last."""
        # Pinocchio gives a matrix with one column as a vector.
        every = pin.computeJointJacobians(self.model, self.data, self._at).reshape(6, self.model.nv)
        jacobian: Any = 0.0
        for x, joints, sign in points.ends:
            rows = np.concatenate([axes, cross(x[:, None, :], axes)], axis=2)
            jacobian = jacobian + (rows @ every) * (sign * self.carries[joints])[:, None, :]
        return self.turned(jacobian.reshape(-1, self.model.nv))

    def turned(self, rows: Array) -> Array:
        """Rows for v (m, nv), which change, as rows for w."""
        for lin, rotation in self._ways:
            rows[:, lin] = rows[:, lin] @ rotation.T
        return rows

    def _axes(self, q: Array) -> Iterator[tuple[slice, Array]]:
        """The entries of linear velocities that joints have along axes of their own, and these axes in the parent's."""
        for joint in self.moving_axes:
            first = joint.v.start
            if joint.kind == "free-flyer":
                yield slice(first, first + 3), pin.Quaternion(q[joint.q.start + 3 : joint.q.stop]).toRotationMatrix()
            else:
                c, s = q[joint.q.start + 2 : joint.q.stop]
                yield slice(first, first + 2), np.array([[c, -s], [s, c]])

    def forces(self, t: float, q: Array, v: Array, numbers: Array) -> Array:
        """tau - h (nv,), of all that acts but contacts."""
        if self.program is None:
            return -np.array(pin.nonLinearEffects(self.model, self.data, q, v))
        return self.program(np.concatenate([[t], q, v, numbers]))

    def by_pinocchio(self, t: float, q: Array, v: Array, numbers: Array) -> Array:
        """tau - h (nv,) with Pinocchio's h, for a comparison."""
        equations = self.equations
        tau, wrenches = loads_of(equations, t, q, v, numbers)
        forces = pin.StdVec_Force()
        forces.extend(pin.Force.Zero() for _ in range(self.model.njoints))
        for i, wrench in wrenches.items():
            forces[i] = pin.Force(wrench)
        bias = pin.rnea(self.model, self.data, q, v, np.zeros(self.model.nv), forces)
        return np.asarray(tau - bias)


def viscosity_of(equations: Equations) -> Array:
    """D (nv,) of the joints with one degree of freedom."""
    out = np.zeros(equations.robot.model.nv)
    dofs = {joint.name: joint.v.start for joint in equations.robot.joints if joint.v.stop == joint.v.start + 1}
    for effect in equations.effects:
        for name, d in effect.viscosity(equations.robot).items():
            if name in dofs and isinstance(d, int | float):  # no input of the run
                out[dofs[name]] += d
    return out


def loads_of(equations: Equations, t: float, q: Array, v: Array, numbers: Array) -> tuple[Array, dict[int, Array]]:
    """Joint torques (nv,) of the effects, and wrenches (6,) on bodies, along their own axes."""
    motion = motion_of(equations, equations.mechanism, t, np.concatenate([q, v]), Numbers)
    loads = effect_loads(equations, motion, list(numbers), equations.effects)
    wrenches = {i: np.array(wrench, dtype=float).ravel() for i, wrench in loads.wrenches.items()}
    return np.array(loads.tau, dtype=float), wrenches


def _forces_program(bodies: Multibody) -> Program:
    """The program of (t, x) for tau - h, compared with NumPy and Pinocchio at the start."""
    equations = bodies.equations
    space = equations.space

    def compare(program: Program) -> None:
        x = equations.start
        q, v, numbers = x[: space.nq], x[space.v_rows], x[equations.moving :]
        require_agreement("forces", program(np.concatenate([[0.0], x])), bodies.by_pinocchio(0.0, q, v, numbers))

    def forces() -> Assembled:
        mech = mechanism(equations.robot.model)
        return trace(lambda z, xp: unbalanced_forces(equations, mech, z[0], z[1:], xp), 1 + space.size)

    return program_named(equations.key("unbalanced"), forces, compare)


def _turning(v: Array, lin: slice) -> Array:
    """omega x v of the linear velocity of a free joint, or of a planar one."""
    after = v[lin.stop : lin.stop + 3]
    if lin.stop - lin.start == 3:
        return cross(after, v[lin])
    return np.array([-after[0] * v[lin][1], after[0] * v[lin][0]])


def cross(a: Array, b: Array) -> Array:
    """a x b of vectors (..., 3), in a third of the time of NumPy's for few of them."""
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    u, v, w = b[..., 0], b[..., 1], b[..., 2]
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    out[..., 0], out[..., 1], out[..., 2] = y * w - z * v, z * u - x * w, x * v - y * u
    return out


MANY = 20  # free bodies from which sparse matrices pay


class FreeBodies(Multibody):
    """Bodies that a free joint connects to the ground each. There is no pin.Data, which takes nv^3 numbers."""

    def __init__(self, equations: Equations) -> None:
        self.equations, self.model = equations, equations.robot.model
        self.viscosity = viscosity_of(equations)
        model, bodies = self.model, range(1, self.model.njoints)
        self.q = np.array([model.idx_qs[j] for j in bodies], dtype=int)[:, None]
        self.v = np.array([model.idx_vs[j] for j in bodies], dtype=int)[:, None]
        self.angular = self.v + ANG
        self.first = np.concatenate([[0], self.v[:, 0]])
        self.inertias = np.array([model.inertias[j].matrix() for j in bodies])
        self.inverses = np.linalg.inv(self.inertias)
        self.places_now = Places(np.eye(3)[None], np.zeros((1, 3)))
        self.program = _forces_program(self) if equations.effects else None

    def to_local_velocity(self, q: Array, w: Array, sign: int = 1) -> Array:
        """v of w; w of v with the sign -1."""
        v, rotations = w.copy(), rotations_of(q[self.q + np.arange(3, 7)])
        turned = rotations.swapaxes(1, 2) if sign > 0 else rotations
        v[self.v + LIN] = np.einsum("nij,nj->ni", turned, w[self.v + LIN])
        return v

    def to_local_acceleration(self, q: Array, w: Array, change: Array) -> Array:
        """v' of w and its rate w'."""
        v, a = self.to_local_velocity(q, w), self.to_local_velocity(q, change)
        a[self.v + LIN] -= cross(v[self.v + ANG], v[self.v + LIN])
        return a

    def moved(self, q: Array, change: Array) -> Array:
        """The configuration after a time in which w adds up to a change (nv,)."""
        turn = change.copy()
        turn[self.v + LIN] = 0.0
        out = np.array(pin.integrate(self.model, q, turn))
        out[self.q + LIN] += change[self.v + LIN]
        return out

    def places(self, q: Array, v: Array) -> tuple[Places, Array]:
        """Poses of the bodies, and their speeds."""
        rotations = np.concatenate([np.eye(3)[None], rotations_of(q[self.q + np.arange(3, 7)])])
        self.places_now = Places(rotations, np.concatenate([np.zeros((1, 3)), q[self.q + LIN]]))
        speeds = np.linalg.norm(v[self.v + np.arange(6)].reshape(-1, 2, 3), axis=2)
        return self.places_now, np.concatenate([np.zeros((1, 2)), speeds])

    def free_acceleration(
        self, t: float, q: Array, w: Array, numbers: Array, h: float = 0.0, ahead: Array | None = None
    ) -> Array:
        """w' (nv,) without contacts; what is asked for then is at this q. Free bodies have no viscosity of joints."""
        del h, ahead
        v = self.to_local_velocity(q, w)
        rotations, inverses, velocity = self.places_now.rotations[1:], self.inverses.copy(), v[self.v + np.arange(6)]
        lin, ang = velocity[:, :3], velocity[:, 3:]
        a = np.einsum("nij,nj->ni", inverses, self.forces(t, q, v, numbers) - self._bias(velocity))
        a[:, :3] += cross(ang, lin)
        a[:, :3] = np.einsum("nij,nj->ni", rotations, a[:, :3]) + self.model.gravity.linear
        inverses[:, :3] = rotations @ inverses[:, :3]
        inverses[:, :, :3] = inverses[:, :, :3] @ rotations.swapaxes(1, 2)
        count, order = len(inverses), np.argsort(self.v[:, 0])
        self.inverse = sparse.bsr_array((inverses[order], np.arange(count), np.arange(count + 1))).tocsr()
        out = np.empty(self.model.nv)
        out[self.v + np.arange(6)] = a
        return out

    def jacobian(self, points: Points, axes: Array) -> Any:
        """J (3n, nv), sparse."""
        count, parts = 3 * len(points.gap), []
        row = np.repeat(np.arange(count), 6)
        for x, joints, sign in points.ends:
            arm = x - self.places_now.origins[joints]
            turning = cross(arm[:, None, :], axes) @ self.places_now.rotations[joints]
            rows = np.concatenate([axes, turning], axis=2) * (sign * (joints > 0))[:, None, None]
            column = np.repeat(self.first[joints], 3)[:, None] + np.arange(6)
            parts.append(sparse.csr_array((rows.ravel(), (row, column.ravel())), shape=(count, self.model.nv)))
        return parts[0] + parts[1]

    def by_pinocchio(self, t: float, q: Array, v: Array, numbers: Array) -> Array:
        """tau - h (nv) without Pinocchio, for a comparison."""
        rotations, velocity = self.places(q, v)[0].rotations[1:], v[self.v + np.arange(6)]
        gravity = np.concatenate([self.model.gravity.linear @ rotations, np.zeros((len(rotations), 3))], axis=1)
        weight = np.einsum("nij,nj->ni", self.inertias, gravity)
        out = np.empty(self.model.nv)
        out[self.v + np.arange(6)] = self.forces(t, q, v, numbers) - self._bias(velocity) + weight
        return out

    def _bias(self, velocity: Array) -> Array:
        """v x* I v (n, 6)."""
        momentum = np.einsum("nij,nj->ni", self.inertias, velocity)
        turned = [cross(velocity[:, 3:], momentum[:, part]) for part in (slice(0, 3), slice(3, 6))]
        turned[1] += cross(velocity[:, :3], momentum[:, :3])
        return np.concatenate(turned, axis=1)

    def forces(self, t: float, q: Array, v: Array, numbers: Array) -> Array:
        """f (n, 6) of all effects but gravity."""
        if not self.equations.effects:
            return np.zeros((len(self.v), 6))
        tau, wrenches = loads_of(self.equations, t, q, v, numbers)
        out: Array = tau[self.v + np.arange(6)]
        for joint, wrench in wrenches.items():
            out[joint - 1] += wrench
        return out


def rotations_of(quaternions: Array) -> Array:
    """Rotation matrices (..., 3, 3) of quaternions (..., 4), x y z w."""
    x, y, z, w = quaternions.T
    rows = np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])  # fmt: skip
    return np.ascontiguousarray(rows.T.swapaxes(-2, -1))


def bodies_of(equations: Equations) -> Multibody:
    """The bodies of a scene, by what they are."""
    model = equations.robot.model
    free = all(model.joints[j].shortname() == "JointModelFreeFlyer" and model.parents[j] == 0
               and model.jointPlacements[j].isIdentity(0.0) for j in range(1, model.njoints))  # fmt: skip
    armature = bool(np.any(model.armature))
    return FreeBodies(equations) if free and not armature and model.njoints > MANY else Multibody(equations)
