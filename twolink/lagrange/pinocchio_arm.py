"""The same two-link arm in Pinocchio, with which `check` compares the equations.

Every set of parameters becomes a URDF of uniform rods, which Pinocchio reads; none of its answers comes from a formula
of this package.
"""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

ACCELERATIONS = ("acceleration, ABA", "acceleration, CRBA + solve")
TORQUE = "torque, RNEA"

# The arm moves in the x-z plane; turning about -y is positive upwards, as the paper measures both angles.
_URDF = """<robot name="two_link"><link name="base"/>
<link name="upper_arm">{upper}</link><link name="forearm">{lower}</link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper_arm"/>
<axis xyz="0 -1 0"/><limit lower="-1000" upper="1000" effort="1000" velocity="1000"/></joint>
<joint name="elbow" type="revolute"><parent link="upper_arm"/><child link="forearm"/>
<origin xyz="{elbow!r} 0 0"/><axis xyz="0 -1 0"/>
<limit lower="-1000" upper="1000" effort="1000" velocity="1000"/></joint></robot>"""
_ROD = """<inertial><origin xyz="{centre!r} 0 0"/><mass value="{mass!r}"/>
<inertia ixx="0" iyy="{inertia!r}" izz="{inertia!r}" ixy="0" ixz="0" iyz="0"/></inertial>"""


@dataclass(frozen=True)
class ArmSamples:
    """n arms with a state each: parameters (l1, l2, m1, m2, g), (n,) each; states (n, 2) in SI units."""

    parameters: tuple[np.ndarray, ...]
    theta: np.ndarray
    dtheta: np.ndarray
    ddtheta: np.ndarray
    torque: np.ndarray


def arm_urdf(l1: float, l2: float, m1: float, m2: float) -> str:
    """The arm of two uniform rods (inertia m l^2 / 12 at mid-rod) as the text of a URDF."""
    upper, lower = (
        _ROD.format(centre=float(length / 2), mass=float(mass), inertia=float(mass * length**2 / 12))
        for length, mass in ((l1, m1), (l2, m2))
    )
    return _URDF.format(upper=upper, lower=lower, elbow=float(l1))


def arm(l1: float, l2: float, m1: float, m2: float, g: float) -> pin.Model:
    """The arm as Pinocchio reads it from its URDF."""
    model = pin.buildModelFromXML(arm_urdf(l1, l2, m1, m2))
    model.gravity.linear = np.array([0.0, 0.0, -g])
    return model


def answers(samples: ArmSamples) -> dict[str, np.ndarray]:
    """Pinocchio's answers, one arm and state at a time.

    A (n, 2, 2) by crba; B (n, 2), the sums of B's rows, and C (n, 2, 2) from nonLinearEffects at unit speeds
    with gravity off, so that weight cannot drown them; D (n, 2) by computeGeneralizedGravity; h (n, 2), the
    bias; (n, 2) each the accelerations by aba and by crba and a solve, and the torque by rnea, under ACCELERATIONS and
    TORQUE.
    """
    n = len(samples.theta)
    out = {name: np.empty((n, 2)) for name in ("B", "D", "h", *ACCELERATIONS, TORQUE)}
    out |= {name: np.empty((n, 2, 2)) for name in ("A", "C")}
    aba, crba = ACCELERATIONS
    for i, parameters in enumerate(np.stack(samples.parameters, axis=1).tolist()):
        model = arm(*parameters)
        data = model.createData()
        q, v, tau = samples.theta[i], samples.dtheta[i], samples.torque[i]
        mass = out["A"][i] = pin.crba(model, data, q)
        out["D"][i] = pin.computeGeneralizedGravity(model, data, q)
        bias = out["h"][i] = pin.nonLinearEffects(model, data, q, v)
        out[crba][i] = np.linalg.solve(mass, tau - bias)
        out[aba][i] = pin.aba(model, data, q, v, tau)
        out[TORQUE][i] = pin.rnea(model, data, q, v, samples.ddtheta[i])
        model.gravity.linear = np.zeros(3)
        squares = out["C"][i] = np.stack([pin.nonLinearEffects(model, data, q, unit) for unit in np.eye(2)], axis=1)
        out["B"][i] = pin.nonLinearEffects(model, data, q, np.ones(2)) - squares.sum(axis=1)
    return out


def energy(model: pin.Model, theta: np.ndarray, dtheta: np.ndarray) -> np.ndarray:
    """The mechanical energy [J] of states (n, 2), zero at rest in the horizontal, by Pinocchio."""
    data, states = model.createData(), zip(theta, dtheta, strict=True)
    return np.array([pin.computeMechanicalEnergy(model, data, q, v) for q, v in states])
