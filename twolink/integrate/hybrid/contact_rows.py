"""What impacts and contact forces act through: rows of contacts, and the inverse of the mass matrix."""

import numpy as np
import pinocchio as pin

from twolink.algorithms.jets import Jet, JetNamespace, coefficient
from twolink.algorithms.motion import Motion
from twolink.algorithms.namespaces import Numbers
from twolink.integrate.hybrid.modes import Situation
from twolink.integrate.state import Array


def contact_rows(here: Situation, i: int) -> Array:
    """The rows J of contact i, (3, nv): its velocities are linear in v, so they are those of unit velocities."""
    nq, nv = here.system.nq, len(here.v)
    states = np.repeat(here.full_state()[:, None], nv, axis=1)
    states[nq : nq + nv] = np.eye(nv)
    return here.own.evaluate(np.full(nv, here.t), states).contacts[i, 1:4]


def contact_bias(here: Situation, i: int) -> Array:
    """J' v of contact i, (3,): the derivative of its velocities with v constant."""
    equations, nq = here.own.equations, here.system.nq
    q, v = here.x[:nq], here.v
    jets = [Jet(pair) for pair in zip(q, equations.space.rate(q, v), strict=True)]
    moving = Motion(equations.robot.model, equations.mechanism, jets, list(v), here.t, JetNamespace(Numbers))
    return np.array([float(coefficient(row, 1)) for row in here.system.contacts[i].velocity(moving)])


def mass_matrix(here: Situation) -> Array:
    """M(q), by Pinocchio, with what acts in the mode."""
    robot = here.own.equations.robot
    return np.array(pin.crba(robot.model, robot.data, here.x[: here.system.nq]))


def loop_rows(here: Situation) -> Array:
    """The rows of constraints that are no contacts, (m, nv)."""
    constraints = here.own.equations.constraints
    if constraints is None:
        return np.empty((0, len(here.v)))
    of_contacts = {row for rows in here.own.rows.values() for row in rows}
    kept = [number for row, number in enumerate(constraints.kept) if row not in of_contacts]
    return constraints.jacobian_at(here.x[: here.system.nq], kept)


def inverse_under(mass: Array, fixed: Array) -> Array:
    """The inverse of M for motions that rows (m, nv) allow: W = M^-1 - M^-1 G^T (G M^-1 G^T)^+ G M^-1."""
    inverse = np.linalg.inv(mass)
    if len(fixed):
        gain = fixed @ inverse @ fixed.T
        inverse = inverse - inverse @ fixed.T @ np.linalg.pinv(gain, rcond=1e-10) @ fixed @ inverse
    return np.asarray(inverse)
