"""What every peer is given: the model's numbers, the start, the effects it knows, and the times to answer at."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from twolink.dynamics import Robot
from twolink.hard.case import Motion, Track
from twolink.scenes import Scene

BUDGET = 10.0  # s that a peer may take
TIMES = 400  # at most, at which peers answer


class CannotError(Exception):
    """The peer has no such thing, or not enough time."""


class SaidError(Exception):
    """The peer itself says that something is wrong."""


@dataclass(frozen=True)
class Way:
    """A setting in words, and what answers at it."""

    setting: str
    run: Callable[[], Track]


@dataclass(frozen=True)
class JointSpec:
    """A joint of the model: "revolute", "prismatic", "continuous" or "free", with its axis in its own frame."""

    name: str
    kind: str
    parent: int
    place: pin.SE3
    axis: np.ndarray
    inertia: pin.Inertia
    q: slice
    v: slice


@dataclass(frozen=True)
class Problem:
    """A case for peers. loops: (body, point, body, point), 0 the ground, for every pair of points held together."""

    scene: Scene
    times: np.ndarray
    joints: tuple[JointSpec, ...]
    stiffness: dict[str, float]
    rest: dict[str, float]
    damping: dict[str, float]
    torques: dict[str, Any]
    loops: tuple[tuple[int, np.ndarray, int, np.ndarray], ...]

    @classmethod
    def of(cls, case: Motion, scene: Scene) -> Problem:
        """The problem of a case. Raises CannotError for effects that no peer is given."""
        from twolink import effects as fx

        end = case.duration or scene.duration
        count = min(TIMES, max(1, int(np.ceil(end * case.samples - 1e-9))))
        stiffness: dict[str, float] = {}
        rest: dict[str, float] = {}
        damping: dict[str, float] = {}
        torques: dict[str, Any] = {}
        loops: list[tuple[int, np.ndarray, int, np.ndarray]] = []
        for effect in scene.effects:
            if isinstance(effect, fx.JointSpring):
                stiffness |= effect.stiffness
                rest |= effect.rest
            elif isinstance(effect, fx.JointDamping) and effect.damping is not None:
                damping |= effect.damping
            elif isinstance(effect, fx.Torque):
                torques |= effect.inputs
            elif isinstance(effect, fx.PointLoop | fx.HingeLoop):
                loops += _pairs(scene.robot, effect)
            elif not isinstance(effect, fx.Gravity):
                raise CannotError(f"{type(effect).__name__} is not built for peers")
        joints = tuple(_joints(scene.robot))
        return cls(scene, np.linspace(0, end, count + 1), joints, stiffness, rest, damping, torques, tuple(loops))

    @property
    def model(self) -> pin.Model:
        """Pinocchio's model, gravity included."""
        return self.scene.robot.model


class Clock:
    """Raises CannotError when the budget is spent."""

    def __init__(self) -> None:
        self.end = time.perf_counter() + BUDGET

    def __call__(self, t: float) -> None:
        if time.perf_counter() > self.end:
            raise CannotError(f"not at the end after {BUDGET:g} s: at t = {t:.4g} s")


def value(given: Any, t: float) -> float:
    """An input at a time."""
    if isinstance(given, int | float):
        return float(given)
    if hasattr(given, "piece_at"):
        piece = given.piece_at(t)
        return float(sum(c * (t - piece.start) ** k for k, c in enumerate(piece.coefficients)))
    raise CannotError(f"input {type(given).__name__} is not built for peers")


def _pairs(robot: Robot, effect: Any) -> list[tuple[int, np.ndarray, int, np.ndarray]]:
    """A ball joint is a pair of points; a hinge is two, half a metre apart on its axis."""
    ends = [
        (_carrier(robot, effect.a), np.array(effect.point_a)),
        (_carrier(robot, effect.b), np.array(effect.point_b)),
    ]
    places = [(body, at.act(point), at) for (body, at), point in ends]
    (body_a, a, at_a), (body_b, b, at_b) = places
    pairs = [(body_a, a, body_b, b)]
    if hasattr(effect, "axis_a"):
        along_a = at_a.rotation @ np.array(effect.axis_a) / np.linalg.norm(effect.axis_a) / 2
        along_b = at_b.rotation @ np.array(effect.axis_b) / np.linalg.norm(effect.axis_b) / 2
        pairs.append((body_a, a + along_a, body_b, b + along_b))
    return pairs


def _carrier(robot: Robot, link: str) -> tuple[int, pin.SE3]:
    """The joint that carries a link, and where the link is in it."""
    if link == "universe":
        return 0, pin.SE3.Identity()
    frame = robot.model.frames[robot.model.getFrameId(link)]
    return int(frame.parentJoint), frame.placement


def _joints(robot: Robot) -> list[JointSpec]:
    model = robot.model
    if model.armature.any():
        raise CannotError("armature is not built for peers")
    data = model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    out = []
    for i in range(1, model.njoints):
        joint, layout = model.joints[i], robot.joints[i - 1]
        axis = np.zeros(3)
        if joint.nv == 6:
            kind = "free"
        elif joint.nv == 1:
            subspace = np.asarray(data.joints[i].S).reshape(-1)
            axis = subspace[3:] if subspace[3:].any() else subspace[:3]
            kind = "continuous" if joint.nq == 2 else "revolute" if subspace[3:].any() else "prismatic"
        else:
            raise CannotError(f"{joint.shortname()} is not built for peers")
        out.append(JointSpec(model.names[i], kind, int(model.parents[i]), model.jointPlacements[i], axis,
                             model.inertias[i], layout.q, layout.v))  # fmt: skip
    return out
