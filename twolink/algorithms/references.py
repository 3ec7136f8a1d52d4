"""Reference values of the answers to queries at one state, each with the scale of its rounding errors.

M, h, g and the energies are sums over the bodies, from where Pinocchio's forward kinematics puts them (Kane's form of
the Newton-Euler equations). None of Pinocchio's algorithms that answer these queries has a part in them, so that both
engines are compared with something else than themselves. Derivatives and frames are Pinocchio's.

The scale is the size of the terms that are added, not of their sum, which may cancel. Where the mass matrix is solved
with, the scale is carried through the inverse: this is where the condition number enters.
"""

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

Array = np.ndarray[Any, np.dtype[np.float64]]


class ModelState:
    """One state of a model: the arguments by name, and what several references need, computed when first used.

    damped: the joints whose damping is a parameter; the others have no damping.
    """

    def __init__(self, model: pin.Model, arguments: Mapping[str, Array], damped: tuple[str, ...] = ()) -> None:
        self.model, self.arguments = model, arguments
        self.q, self.v = arguments["q"], arguments.get("v", np.zeros(model.nv))
        self.bodies = range(1, model.njoints)
        self.damping = np.zeros(model.nv)
        for joint in damped:
            k = model.idx_vs[model.getJointId(joint)]
            self.damping[k] = model.damping[k]

    @cached_property
    def data(self) -> pin.Data:
        """Poses, velocities, accelerations without those of the joints, and Jacobians of the bodies."""
        data = self.model.createData()
        pin.forwardKinematics(self.model, data, self.q, self.v, np.zeros(self.model.nv))
        pin.computeJointJacobians(self.model, data, self.q)
        return data

    @cached_property
    def jacobians(self) -> Array:
        """J (bodies, 6, nv): J_i v is the velocity of body i along its own axes, linear then angular."""
        every = [pin.getJointJacobian(self.model, self.data, i, pin.LOCAL) for i in self.bodies]
        return np.reshape(every, (len(self.bodies), 6, self.model.nv))

    @cached_property
    def mass_matrix(self) -> Array:
        """M(q) = sum J_i^T I_i J_i + armature."""
        inertias = np.reshape([self.model.inertias[i].matrix() for i in self.bodies], (-1, 6, 6))
        moved = (inertias @ self.jacobians).reshape(-1, self.model.nv)
        return np.asarray(self.jacobians.reshape(moved.shape).T @ moved + np.diag(self.model.armature))

    def _along_joints(self, forces: list[pin.Force]) -> Array:
        """sum J_i^T f_i (nv,) of forces on the bodies, along their own axes."""
        return np.asarray(np.ravel([force.vector for force in forces]) @ self.jacobians.reshape(-1, self.model.nv))

    @cached_property
    def gravity_torque(self) -> Array:
        """g(q) = -sum J_i^T (weight of body i)."""
        data, up = self.data, pin.Motion(-self.model.gravity.linear, np.zeros(3))
        return self._along_joints([self.model.inertias[i] * data.oMi[i].actInv(up) for i in self.bodies])

    @cached_property
    def bias(self) -> Array:
        """h = sum J_i^T (I_i a_i + v_i x I_i v_i) + g, with damping where that is a parameter."""
        data, inertias = self.data, self.model.inertias
        forces = [inertias[i] * data.a[i] + data.v[i].cross(inertias[i] * data.v[i]) for i in self.bodies]
        return np.asarray(self._along_joints(forces) + self.gravity_torque + self.damping * self.v)

    @cached_property
    def potential(self) -> float:
        """-sum m_i g . c_i, J."""
        bodies = [(self.model.inertias[i], self.data.oMi[i]) for i in self.bodies]
        return -float(sum(body.mass * self.model.gravity.linear @ at.act(body.lever) for body, at in bodies))

    @cached_property
    def reach(self) -> float:
        """The largest coordinate of any joint, and a lever."""
        lever = max((float(np.abs(b.lever).max()) for b in self.model.inertias), default=0.0)
        return max(float(np.abs(place.translation).max()) for place in self.data.oMi) + lever

    @cached_property
    def weight(self) -> float:
        """The largest torque on a joint, or energy, that weight can give: gravity's terms may cancel to much less."""
        mass = float(sum(b.mass for b in self.model.inertias))
        return mass * float(np.linalg.norm(self.model.gravity.linear)) * self.reach

    @cached_property
    def bias_terms(self) -> Array:
        return np.abs(self.bias) + np.abs(self.bias - self.gravity_torque) + self.weight

    @cached_property
    def wrenches(self) -> Array:
        """J^T w of the wrenches among the arguments ("f_ext:FRAME"), by frame Jacobians."""
        out, model = np.zeros(self.model.nv), self.model
        for name, wrench in self.arguments.items():
            if name.startswith("f_ext:"):
                frame = model.getFrameId(name.removeprefix("f_ext:"), pin.FrameType.BODY)
                out += pin.computeFrameJacobian(model, model.createData(), self.q, frame, pin.LOCAL).T @ wrench
        return out

    def torque_derivatives(self, a: Array) -> Array:
        """(dtau/dq, dtau/dv, dtau/da) (3, nv, nv) at an acceleration."""
        data = self.model.createData()  # the matrices are views into it
        by_q, by_v, by_a = pin.computeRNEADerivatives(self.model, data, self.q, self.v, a)
        return np.stack([by_q, by_v + np.diag(self.damping), symmetric(by_a)])


def symmetric(upper: Array) -> Array:
    """The whole of a symmetric matrix of which Pinocchio fills the upper triangle."""
    return np.asarray(np.triu(upper) + np.triu(upper, 1).T)


Scale = float | Array  # for all entries, or one for each
Reference = Callable[[ModelState], tuple[Array, Scale]]


def mass_matrix(x: ModelState) -> tuple[Array, float]:
    return x.mass_matrix, float(np.abs(x.mass_matrix).max())


def gravity_torque(x: ModelState) -> tuple[Array, float]:
    return x.gravity_torque, float(x.bias_terms.max())


def bias(x: ModelState) -> tuple[Array, float]:
    return x.bias, float(x.bias_terms.max())


def energy(x: ModelState) -> tuple[Array, float]:
    both = np.array([x.v @ x.mass_matrix @ x.v / 2, x.potential])
    return both, float(np.abs(both).max()) + x.weight


def inverse_dynamics(x: ModelState) -> tuple[Array, float]:
    tau = x.mass_matrix @ x.arguments["a"] + x.bias - x.wrenches
    return np.asarray(tau), float(_inverse_terms(x).max())


def _inverse_terms(x: ModelState) -> Array:
    return np.asarray(x.bias_terms + np.abs(x.wrenches) + np.abs(x.mass_matrix) @ np.abs(x.arguments["a"]))


def inverse_derivatives(x: ModelState) -> tuple[Array, float]:
    expected = x.torque_derivatives(x.arguments["a"])
    return expected, float(np.abs(expected).max() + _inverse_terms(x).max())


def forward_dynamics(x: ModelState) -> tuple[Array, float]:
    _, a, scale = _solved(x)
    return a, scale


def _solved(x: ModelState) -> tuple[Array, Array, float]:
    """M^-1, the acceleration by it, and the scale of that."""
    inverse = np.asarray(np.linalg.inv(x.mass_matrix), dtype=np.float64)
    tau = x.arguments["tau"]
    a = inverse @ (tau + x.wrenches - x.bias)
    terms = x.bias_terms + np.abs(x.wrenches) + np.abs(tau) + np.abs(x.mass_matrix) @ np.abs(a)
    return inverse, a, float((np.abs(inverse) @ terms).max())


def forward_derivatives(x: ModelState) -> tuple[Array, float]:
    inverse, a, scale = _solved(x)
    by_q, by_v, _ = x.torque_derivatives(a)
    expected = np.stack([-inverse @ by_q, -inverse @ by_v, inverse])
    terms = np.abs(by_q) + np.abs(by_v) + np.abs(x.mass_matrix) @ np.abs(expected).max(axis=0)
    return expected, float((np.abs(inverse) @ terms).max() + np.abs(expected).max()) + scale


def frame_pose(frame: int, x: ModelState) -> tuple[Array, Scale]:
    pose = _placed(x, frame)
    scale = np.repeat([1.0, _distance(x, pose)], [9, 3])
    return np.concatenate([pose.rotation.ravel(), pose.translation]), scale


def frame_jacobian(axes: pin.ReferenceFrame, frame: int, x: ModelState) -> tuple[Array, float]:
    jacobian = pin.computeFrameJacobian(x.model, x.model.createData(), x.q, frame, axes)
    return np.asarray(jacobian), 1.0 + _distance(x, _placed(x, frame))


def _placed(x: ModelState, frame: int) -> pin.SE3:
    data = x.model.createData()
    pin.framesForwardKinematics(x.model, data, x.q)
    return pin.SE3(data.oMf[frame])


def _distance(x: ModelState, pose: pin.SE3) -> float:
    return x.reach + float(np.abs(pose.translation).max()) + 1e-3
