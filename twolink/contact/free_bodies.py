"""Many bodies that a free joint connects to the ground each, for time stepping: all at once, with sparse matrices.

    I a = f + I g - v x* I v

I: the inertia of a body (6, 6) about its joint, v: its velocity, f: the wrench on it, along its own axes.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import scipy.sparse as sparse

from twolink.contact.multibody import Multibody, cross, loads_of
from twolink.geometry.points import Places, Points
from twolink.integrate.equations import Equations
from twolink.integrate.state import Array

MANY = 20  # free bodies from which sparse matrices pay
LIN, ANG = np.arange(3), np.arange(3, 6)


class FreeBodies(Multibody):
    """Bodies that a free joint connects to the ground each. There is no pin.Data, which takes nv^3 numbers."""

    def __init__(self, equations: Equations) -> None:
        self.equations, self.model = equations, equations.robot.model
        model, bodies = self.model, range(1, self.model.njoints)
        self.q = np.array([model.idx_qs[j] for j in bodies], dtype=int)[:, None]
        self.v = np.array([model.idx_vs[j] for j in bodies], dtype=int)[:, None]
        self.first = np.concatenate([[0], self.v[:, 0]])
        self.inertias = np.array([model.inertias[j].matrix() for j in bodies])
        self.inverses = np.linalg.inv(self.inertias)
        self.places_now = Places(np.eye(3)[None], np.zeros((1, 3)))

    def own(self, q: Array, w: Array, sign: float = 1.0) -> Array:
        """v of w; w of v with the sign -1."""
        v, rotations = w.copy(), rotations_of(q[self.q + np.arange(3, 7)])
        turned = rotations.swapaxes(1, 2) if sign > 0 else rotations
        v[self.v + LIN] = np.einsum("nij,nj->ni", turned, w[self.v + LIN])
        return v

    def moved(self, q: Array, change: Array) -> Array:
        """The configuration after a time in which w adds up to a change (nv,)."""
        turn = change.copy()
        turn[self.v + LIN] = 0.0
        out = np.array(pin.integrate(self.model, q, turn))
        out[self.q + LIN] += change[self.v + LIN]
        return out

    def places(self, q: Array, v: Array) -> tuple[Places, Array]:
        """Where the bodies are, and their speeds."""
        rotations = np.concatenate([np.eye(3)[None], rotations_of(q[self.q + np.arange(3, 7)])])
        self.places_now = Places(rotations, np.concatenate([np.zeros((1, 3)), q[self.q + LIN]]))
        speeds = np.linalg.norm(v[self.v + np.arange(6)].reshape(-1, 2, 3), axis=2)
        return self.places_now, np.concatenate([np.zeros((1, 2)), speeds])

    def free_acceleration(self, t: float, q: Array, w: Array, numbers: Array) -> Array:
        """w' (nv,) without contacts; what is asked for then is at this q."""
        v = self.own(q, w)
        rotations, inverses, velocity = self.places_now.rotations[1:], self.inverses.copy(), v[self.v + np.arange(6)]
        lin, ang = velocity[:, :3], velocity[:, 3:]
        a = np.einsum("nij,nj->ni", inverses, self._wrenches(t, q, v, numbers) - self._bias(velocity))
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

    def _bias(self, velocity: Array) -> Array:
        """v x* I v (n, 6)."""
        momentum = np.einsum("nij,nj->ni", self.inertias, velocity)
        turned = [cross(velocity[:, 3:], momentum[:, part]) for part in (slice(0, 3), slice(3, 6))]
        turned[1] += cross(velocity[:, :3], momentum[:, :3])
        return np.concatenate(turned, axis=1)

    def _wrenches(self, t: float, q: Array, v: Array, numbers: Array) -> Array:
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
