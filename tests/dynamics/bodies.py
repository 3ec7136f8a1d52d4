"""The equations of motion as sums over the bodies, from the poses of the joints alone: what queries have to answer.

Kane's form of the Newton-Euler equations in matrices of NumPy. Of twolink it uses how joints are described
(`read_joint`), of Pinocchio the constants of the model and the step along a tangent; no algorithm of either.
"""

from collections.abc import Callable

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

import twolink as tl
from twolink.algorithms.joint_models import JointKinematics, read_joint

Array = np.ndarray


def skew(x: Array) -> Array:
    """[x] with [x] y = x cross y."""
    return np.array([[0, -x[2], x[1]], [x[2], 0, -x[0]], [-x[1], x[0], 0]])


def motion_to_child(rotation: Array, origin: Array) -> Array:
    """X (6, 6): velocities (linear, angular) of a child's frame that stands still in its parent's."""
    zero = np.zeros((3, 3))
    return np.block([[rotation.T, -rotation.T @ skew(origin)], [zero, rotation.T]])


def cross_motion(m: Array) -> Array:
    """m cross, of motions (6, 6); of forces it is the negative transpose."""
    return np.block([[skew(m[3:]), skew(m[:3])], [np.zeros((3, 3)), skew(m[3:])]])


def _subspace(joint: JointKinematics) -> Array:
    """S (6, k) of a joint, in its child's frame."""
    zero, axis = np.zeros(3), joint.ratio * np.array(joint.axis)
    if joint.kind in ("revolute", "continuous"):
        return np.r_[zero, axis][:, None]
    if joint.kind == "prismatic":
        return np.r_[axis, zero][:, None]
    return np.eye(6)[:, {"planar": [0, 1, 5], "spherical": [3, 4, 5], "free-flyer": list(range(6))}[joint.kind]]


def _pose(joint: JointKinematics, q: Array) -> tuple[Array, Array]:
    """The rotation and the origin of a joint's child."""
    x, zero = q[list(joint.entries)], np.zeros(3)
    if joint.kind == "planar":
        return Rotation.from_euler("z", np.arctan2(x[3], x[2])).as_matrix(), np.r_[x[:2], 0.0]
    if joint.kind in ("spherical", "free-flyer"):
        return Rotation.from_quat(x[-4:]).as_matrix(), x[:3] if joint.kind == "free-flyer" else zero
    place = joint.ratio * (x[0] if len(x) == 1 else np.arctan2(x[1], x[0])) + joint.offset
    if joint.kind == "prismatic":
        return np.eye(3), place * np.array(joint.axis)
    return Rotation.from_rotvec(place * np.array(joint.axis)).as_matrix(), zero


class Bodies:
    """A robot at one state (q, v): where its bodies are and how they move."""

    def __init__(self, robot: tl.Robot, q: Array, v: Array) -> None:
        model = self.model = robot.model
        self.v, self.gravity = v, np.r_[model.gravity.linear, np.zeros(3)]
        self.turns, self.origins, self.jacobians = [np.eye(3)], [np.zeros(3)], [np.zeros((6, model.nv))]
        self.drifts = [np.zeros(6)]  # accelerations that come from velocities alone
        self.inertias = [body.matrix() for body in model.inertias]
        for i in range(1, model.njoints):
            joint, parent, place = read_joint(model, i), model.parents[i], model.jointPlacements[i]
            turn, origin = _pose(joint, q)
            turn, origin = place.rotation @ turn, place.rotation @ origin + place.translation
            step = motion_to_child(turn, origin)
            own = np.zeros((6, model.nv))
            own[:, list(joint.dofs)] = _subspace(joint)
            self.turns.append(self.turns[parent] @ turn)
            self.origins.append(self.turns[parent] @ origin + self.origins[parent])
            self.jacobians.append(step @ self.jacobians[parent] + own)
            self.drifts.append(step @ self.drifts[parent] + cross_motion(self.jacobians[i] @ v) @ own @ v)

    def _sum(self, of: Callable[[int], Array]) -> Array:
        return sum((of(i) for i in range(1, self.model.njoints)), start=np.zeros(()))

    def mass_matrix(self) -> Array:
        """M = sum J^T I J + armature."""
        armature = np.diag(np.array(self.model.armature))
        return armature + self._sum(lambda i: self.jacobians[i].T @ self.inertias[i] @ self.jacobians[i])

    def gravity_torque(self) -> Array:
        """g = -sum J^T I (gravity along the body's axes)."""
        turned = [np.kron(np.eye(2), turn.T) @ self.gravity for turn in self.turns]
        return -self._sum(lambda i: self.jacobians[i].T @ self.inertias[i] @ turned[i])

    def bias(self) -> Array:
        """h = sum J^T (I J' v + v x I v) + g."""

        def force(i: int) -> Array:
            moving = self.jacobians[i] @ self.v
            return self.inertias[i] @ self.drifts[i] - cross_motion(moving).T @ self.inertias[i] @ moving

        return self._sum(lambda i: self.jacobians[i].T @ force(i)) + self.gravity_torque()

    def centres(self) -> list[tuple[float, Array]]:
        """The mass and the centre of mass of each body that moves, in the world."""
        bodies = zip(self.model.inertias, self.turns, self.origins, strict=True)
        return [(b.mass, turn @ b.lever + origin) for b, turn, origin in bodies][1:]

    def centre_of_mass(self) -> Array:
        return sum(m * c for m, c in self.centres()) / sum(m for m, _ in self.centres())

    def energy(self) -> Array:
        """(kinetic, potential): half the sum of v^T I v over bodies and rotors; -sum m g . c."""
        moving = [j @ self.v for j in self.jacobians]
        kinetic = self._sum(lambda i: moving[i] @ self.inertias[i] @ moving[i]) + self.model.armature @ self.v**2
        return np.array([kinetic / 2, -sum(m * self.gravity[:3] @ c for m, c in self.centres())])

    def momentum(self) -> Array:
        """(p, L about the centre of mass), along the world's axes."""

        def in_world(i: int) -> Array:
            own = np.kron(np.eye(2), self.turns[i]) @ self.inertias[i] @ self.jacobians[i] @ self.v
            return np.r_[own[:3], own[3:] + np.cross(self.origins[i] - self.centre_of_mass(), own[:3])]

        return self._sum(in_world)

    def frame(self, name: str) -> tuple[Array, Array, Array]:
        """A link's frame: R, p, and J along its own axes."""
        entry = self.model.frames[self.model.getFrameId(name, pin.FrameType.BODY)]
        i, turn, origin = entry.parentJoint, entry.placement.rotation, entry.placement.translation
        place = self.turns[i] @ origin + self.origins[i]
        return self.turns[i] @ turn, place, motion_to_child(turn, origin) @ self.jacobians[i]


def derivative(of: Callable[[float], Array], step: float = 0.02) -> Array:
    """f'(0) by central differences of order 8."""
    weights = (4 / 5, -1 / 5, 4 / 105, -1 / 280)
    return sum(w * (of(n * step) - of(-n * step)) for n, w in enumerate(weights, 1)) / step
