"""The joint torques as a linear function of the inertial parameters, armature and friction: tau = Y(q, v, a) pi."""

import numpy as np
import pinocchio as pin

from twolink.algorithms.mechanism import BODY_PARAMETERS, body_names
from twolink.dynamics.queries import Algorithm, Array
from twolink.robots.model import RobotModel

JOINT_PARAMETERS = ("armature", "damping", "friction")


def regressor_names(model: pin.Model) -> tuple[str, ...]:
    """The names of the entries of pi; see `Robot.parameter_names`."""
    links, joints = body_names(model)[1:], [model.names[j] for j in _single(model)]
    bodies = [f"{link}.{entry}" for link in links for entry in BODY_PARAMETERS]
    return (*bodies, *(f"{joint}.{kind}" for kind in JOINT_PARAMETERS for joint in joints))


def regressor_values(model: pin.Model) -> Array:
    """pi (p,) of the model; see `Robot.parameter_values`."""
    dofs = [model.idx_vs[j] for j in _single(model)]
    bodies = [body.toDynamicParameters() for body in list(model.inertias)[1:]]
    return np.concatenate([*bodies, np.array(model.armature)[dofs], np.zeros(2 * len(dofs))])


def regressor_query(robot: RobotModel) -> Algorithm:
    """Y (nv, p) as a query of the robot."""
    return Algorithm(("q", "v", "a"), (robot.nv, len(regressor_names(robot.model))), _regressor)


def _single(model: pin.Model) -> list[int]:
    """The joints with one degree of freedom of their own."""
    return [j for j in range(1, model.njoints) if model.nvs[j] == 1]


def _regressor(model: pin.Model, data: pin.Data, q: Array, v: Array, a: Array) -> Array:
    """Y (nv, p): J_i^T times the body's regressor for each body i, as Pinocchio's own, which refuses mimic joints."""
    pin.forwardKinematics(model, data, q, v, a)
    pin.computeJointJacobians(model, data, q)
    weight = pin.Motion(model.gravity.linear, np.zeros(3))
    dofs = [model.idx_vs[j] for j in _single(model)]
    own = np.zeros((len(JOINT_PARAMETERS), model.nv, len(dofs)))
    for kind, values in zip(own, (a, v, np.sign(v)), strict=True):
        kind[dofs, range(len(dofs))] = np.asarray(values)[dofs]
    columns = []
    for j in range(1, model.njoints):
        jacobian = np.asarray(pin.getJointJacobian(model, data, j, pin.LOCAL)).reshape(6, model.nv)
        felt = data.a[j] - data.oMi[j].actInv(weight)  # the acceleration that an accelerometer on the body measures
        with np.errstate(over="ignore", invalid="ignore"):  # the caller refuses what is not finite
            columns.append(jacobian.T @ pin.bodyRegressor(data.v[j], felt))
    return np.concatenate([*columns, *own], axis=1)
