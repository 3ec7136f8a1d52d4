"""One case an effect: on the arm, on the UR5 and on a floating UR5, with its torques written a second time.

The second way shares nothing with the effects: Pinocchio's Jacobians and plain NumPy, one state at a time.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import pytest

import twolink as tl
from twolink.effects.effect import Effect

E = tl.effects
Torque = Callable[[pin.Model, np.ndarray, np.ndarray, float], np.ndarray]


@dataclass(frozen=True)
class Case:
    """An effect, the robot it is on, and the generalised torques it should give."""

    robot: str
    effect: Effect
    torque: Torque


@functools.cache
def robot(name: str) -> tl.Robot:
    """arm, ur5 or floating."""
    if name == "floating":
        return tl.load_robot("ur5", root="free", lock=dict.fromkeys(("wrist_1_joint", "wrist_2_joint"), 0.3))
    return tl.load_robot({"arm": "two_link"}.get(name, name))


def assert_refused(on: tl.Robot, effect: object, where: str, part: str) -> None:
    """A scene with the effect is refused with the index and field of the effect, a reason and a remedy."""
    with pytest.raises(tl.errors.SceneError) as caught:
        tl.Scene(on, effects=[E.Gravity(), effect])
    assert caught.value.where == f"effects[1].{where}"
    assert caught.value.data["effect"] == 1
    assert part in str(caught.value)
    assert caught.value.remedy


def state(of: tl.Robot, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """A random state."""
    random = np.random.default_rng(seed)
    q = pin.integrate(of.model, of.neutral, random.uniform(-1, 1, of.nv))
    return of.normalize(q), random.uniform(-1, 1, of.nv)


def jacobian(model: pin.Model, q: np.ndarray, frame: str, point: tuple[float, ...] = (0, 0, 0)) -> tuple:
    """(rotation, position of the point, its Jacobian (3, nv), the angular one), along the world's axes."""
    if frame == "universe":
        return np.eye(3), np.array(point), np.zeros((3, model.nv)), np.zeros((3, model.nv))
    data = model.createData()
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    i = model.getFrameId(frame, pin.FrameType.BODY)
    j = pin.getFrameJacobian(model, data, i, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
    arm = data.oMf[i].rotation @ np.array(point)
    return data.oMf[i].rotation, data.oMf[i].translation + arm, j[:3] - pin.skew(arm) @ j[3:], j[3:]


def entry(model: pin.Model, joint: str) -> tuple[int, int]:
    i = model.getJointId(joint)
    return model.idx_qs[i], model.idx_vs[i]


def spring(model, q, _v, _t):
    tau = np.zeros(model.nv)
    for joint, k, q0 in (("elbow_joint", 40.0, 0.5), ("wrist_3_joint", 3.0, 0.0)):
        i, j = entry(model, joint)
        tau[j] = -k * (q[i] - q0)
    return tau


def friction(model, _q, v, _t):
    tau = np.zeros(model.nv)
    k = entry(model, "elbow_joint")[1]
    tau[k] = -7 * np.tanh(v[k] / 0.2)
    return tau


def drag(model, q, v, t):
    _, _, j, _ = jacobian(model, q, "tool0", (0.1, 0.2, 0.3))
    u = j @ v - [1.0, np.sin(2 * t), -0.5 + t]
    return j.T @ (-0.5 * 1.2 * 0.8 * 0.3 * np.linalg.norm(u) * u)


def push(axes: str) -> Torque:
    def torque(model, q, _v, t):
        turn, _, j, angular = jacobian(model, q, "wrist_3_link", (0.1, 0.0, -0.2))
        force, moment = np.array([3 * np.sin(4 * t), 2.0, 0]), np.array([0, 1 + 2 * t + 3 * t * t, 0.7])
        if axes == "frame":
            force, moment = turn @ force, turn @ moment
        return j.T @ force + angular.T @ moment

    return torque


def between(first, second, a, b, k, rest, c, force) -> Torque:
    def torque(model, q, v, t):
        _, p, jp, _ = jacobian(model, q, first, a)
        _, r, jr, _ = jacobian(model, q, second, b)
        line = r - p
        n = line / np.linalg.norm(line) if rest or c else np.zeros(3)
        pull = (k * line - k * rest * n) + (c * (n @ (jr @ v - jp @ v)) + force(t)) * n
        return jp.T @ pull - jr.T @ pull

    return torque


def damping(d: dict[str, float]) -> Torque:
    def torque(model, _q, v, _t):
        tau = np.zeros(model.nv)
        for joint, value in d.items():
            i = model.getJointId(joint)
            part = slice(model.idx_vs[i], model.idx_vs[i] + model.nvs[i])
            tau[part] = -value * v[part]
        return tau

    return torque


def driven(model, _q, _v, t):
    tau = np.zeros(model.nv)
    tau[entry(model, "elbow_joint")[1]] = np.interp(t, [0, 0.2, 0.5, 2], [1, -2, 4, 0])
    return tau


def pd(model, q, v, t):
    tau = np.zeros(model.nv)
    i, j = entry(model, "elbow_joint")
    tau[j] = np.clip(90 * (0.5 * np.sin(t + 0.1) + 0.2 - q[i]) - 8 * v[j] + 2 + t, -20, 20)
    return tau


def weight(model, q, _v, _t):
    g = pin.computeGeneralizedGravity(model, model.createData(), q)
    return np.clip(g, -20, 20)


def computed(model, q, v, t):
    e = np.array([0.3 * np.sin(2 * t), 0.1 + t + t**2]) - q
    de = np.array([0.6 * np.cos(2 * t), 1 + 2 * t]) - v
    a = np.array([-1.2 * np.sin(2 * t), 2.0]) + 6 * de + 9 * e
    return pin.rnea(model, model.createData(), q, v, a)


def feedback(model, q, v, _t):
    """The rotation's error as (R0^T R - R^T R0) / 2."""
    target = np.array(HELD.target)
    start, end = (pin.Quaternion(x[3:7]).matrix() for x in (target, q))
    turned = start.T @ end
    error = np.concatenate([start.T @ (q[:3] - target[:3]), pin.unSkew((turned - turned.T) / 2), (q - target)[7:]])
    tau = np.zeros(model.nv)
    for joint, row in HELD.gain.items():
        k = entry(model, joint)[1]
        tau[k] = np.clip(HELD.torque.get(joint, 0.0) - np.array(row) @ np.concatenate([error, v]), -90, 90)
    return tau


def held() -> E.StateFeedback:
    """Gains of all entries of the state of a floating UR5."""
    gains = np.random.default_rng(2).uniform(-20, 20, (2, 20))
    rows = dict(zip(("elbow_joint", "wrist_3_joint"), map(tuple, gains.tolist()), strict=True))
    q = tuple(state(robot("floating"), 9)[0].tolist())
    return E.StateFeedback(rows, q, {"elbow_joint": 4.0}, dict.fromkeys(rows, 90.0))


HELD = held()
WRENCH = {"force": (E.Sine(3.0, 4.0), 2.0, 0.0), "moment": (0.0, E.Polynomial((1.0, 2.0, 3.0)), 0.7)}
PIECES = E.Sampled((0.0, 0.2, 0.5, 2.0), (1.0, -2.0, 4.0, 0.0))
GROUND = {"first": "universe", "second": "tool0", "first_point": (1.0, 0.2, 0.1), "second_point": (0.0, 0.1, 0.0)}
CASES = {
    "spring": Case("ur5", E.JointSpring({"elbow_joint": 40.0, "wrist_3_joint": 3.0}, {"elbow_joint": 0.5}), spring),
    "damping": Case("floating", E.JointDamping({"root_joint": 2.0, "elbow_joint": 0.3}),
                    damping({"root_joint": 2.0, "elbow_joint": 0.3})),
    "friction": Case("ur5", E.SmoothFriction({"elbow_joint": 7.0}, 0.2), friction),
    "drag": Case("ur5", E.AirDrag("tool0", 0.3, 0.8, 1.2, (0.1, 0.2, 0.3),
                                  (1.0, E.Sine(1.0, 2.0), E.Polynomial((-0.5, 1.0)))), drag),
    "drag afloat": Case("floating", E.AirDrag("tool0", 0.3, 0.8, 1.2, (0.1, 0.2, 0.3),
                                              (1.0, E.Sine(1.0, 2.0), E.Polynomial((-0.5, 1.0)))), drag),
    "wrench, world": Case("ur5", E.FrameWrench("wrist_3_link", **WRENCH, point=(0.1, 0.0, -0.2)), push("world")),
    "wrench, frame": Case("floating", E.FrameWrench("wrist_3_link", **WRENCH, axes="frame", point=(0.1, 0.0, -0.2)),
                          push("frame")),
    "between": Case("ur5", E.SpringBetween("upper_arm_link", "wrist_2_link", 50.0, 0.3, 4.0, E.Sine(2.0, 3.0),
                                           (0.1, 0.0, 0.0), (0.0, 0.1, 0.0)),
                    between("upper_arm_link", "wrist_2_link", (0.1, 0, 0), (0, 0.1, 0), 50.0, 0.3, 4.0,
                            lambda t: 2 * np.sin(3 * t))),
    "to the ground": Case("floating", E.SpringBetween(**GROUND, stiffness=50.0, rest_length=0.3, damping=2.0),
                          between("universe", "tool0", (1.0, 0.2, 0.1), (0, 0.1, 0), 50.0, 0.3, 2.0, lambda _: 0.0)),
    "zero length": Case("ur5", E.SpringBetween(**GROUND, stiffness=50.0),
                        between("universe", "tool0", (1.0, 0.2, 0.1), (0, 0.1, 0), 50.0, 0.0, 0.0, lambda _: 0.0)),
    "table": Case("ur5", E.Torque({"elbow_joint": PIECES}), driven),
    "pd": Case("ur5", E.JointPD({"elbow_joint": E.Sine(0.5, 1.0, 0.1, 0.2)}, {"elbow_joint": 90.0},
                                {"elbow_joint": 8.0}, {"elbow_joint": E.Polynomial((2.0, 1.0))},
                                {"elbow_joint": 20.0}), pd),
    "weight": Case("ur5", E.GravityCompensation(effort=dict.fromkeys(tl.load_robot("ur5").joint_names, 20.0)), weight),
    "feedback": Case("floating", HELD, feedback),
    "computed": Case("arm", E.ComputedTorque({"shoulder": E.Sine(0.3, 2.0), "elbow": E.Polynomial((0.1, 1.0, 1.0))},
                                             9.0, 6.0), computed),
}  # fmt: skip
