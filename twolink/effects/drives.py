"""Drives: what is between a command and a joint, with states of their own. Each acts on what is inside it, `of`.

ActuatorLag(of=JointPD(...)) delays the torques of the controller. Gear(of=DCMotor(of=PID(...))) is a geared motor whose
voltage a controller gives: inside a gear or an elastic joint, angles and speeds are those of the motor, and torques act
on the motor; inside a motor, torques are its voltages.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import pinocchio as pin

from twolink.algorithms.motion import Motion
from twolink.algorithms.spatial import Scalar, minus, times
from twolink.dynamics import Robot
from twolink.effects.checks import check_effect, check_joints, check_subset
from twolink.effects.effect import Effect, Loads, NotNegative, number
from twolink.effects.loops import Loop
from twolink.effects.switching import SwitchingEffect
from twolink.errors import SceneError


class Drive(Effect, frozen=True):
    """What acts on the torques of another effect, `of`."""

    of: Any = None  # an Effect: scene files read it by its type

    @property
    def analytic(self) -> bool:
        """Whether what is inside is."""
        return self.of is None or self.of.analytic

    @property
    def changes(self) -> bool:
        """Whether what is inside changes the robot."""
        return self.of is not None and self.of.changes

    def check_inside(self, robot: Robot, joints: Any, field: str, *, needed: bool = True) -> None:
        """Require joints of one coordinate, and inside an effect that gives torques. Raises SceneError."""
        check_joints(joints, robot, field, coordinates=True)
        if self.of is None and not needed:
            return
        if not isinstance(self.of, Effect) or isinstance(self.of, (SwitchingEffect, Loop)):
            raise SceneError(f"{type(self.of).__name__} gives no torque of a drive", where="of",
                             remedy="give a controller, a motor or tl.effects.Torque")  # fmt: skip
        try:
            check_effect(self.of, robot)
        except SceneError as error:
            raise error.at(f"of.{error.where}") from None

    def change(self, model: pin.Model) -> None:
        """What is inside may change the robot."""
        if self.of is not None:
            self.of.change(model)

    def states(self, motion: Motion) -> Mapping[str, Scalar]:
        """Those of what is inside."""
        return {} if self.of is None else self.of.states(motion)

    def breaks(self, duration: float) -> Sequence[float]:
        """Those of what is inside."""
        return () if self.of is None else self.of.breaks(duration)

    def inside(self, motion: Motion, loads: Loads) -> list[Scalar]:
        """The torques (nv) of what is inside, which sees a motion."""
        own = loads.of_motor(motion)
        if self.of is not None:
            self.of.act(motion, own)
        return own.tau


class ActuatorLag(Drive, frozen=True):
    """An actuator that follows its command with a lag of first order: T z' = u - z, tau = z.

    Parameters
    ----------
    of : Effect
        What gives the command u, such as a controller. Joints that `time` does not name get it without a lag.
    time : mapping of joint to float
        T, s, above 0.
    start : mapping of joint to float
        z at the start, N m or N; 0 by default.

    Notes
    -----
    States: "JOINT.lag", N m or N. Limits of effort of what is inside act on the command.

    References
    ----------
    Franklin, Powell, Emami-Naeini, Feedback Control of Dynamic Systems, 2019, section 3.3.
    """

    time: Mapping[str, NotNegative] = {}
    start: Mapping[str, float] = {}

    def check(self, robot: Robot) -> None:
        """Require times above 0, and something inside."""
        self.check_inside(robot, self.time, "time")
        above_zero(self.time, "time")
        check_subset(self.start, self.time, "start", "joint with a lag")

    def states(self, motion: Motion) -> Mapping[str, Scalar]:
        """z of each joint."""
        return {**super().states(motion), **{f"{j}.lag": number(self.start.get(j, 0.0)) for j in self.time}}

    def act(self, motion: Motion, loads: Loads) -> None:
        """Add z."""
        for dof, (joint, command) in enumerate_joints(motion, self.inside(motion, loads)):
            if joint in self.time:
                z = motion.states[f"{joint}.lag"]
                loads.rates[f"{joint}.lag"] = times(minus(command, z), 1.0 / number(self.time[joint]))
                command = z
            loads.torque(dof, command)


def enumerate_joints(motion: Motion, torques: list[Scalar]) -> list[tuple[int, tuple[str, Scalar]]]:
    """Of each degree of freedom its joint and torque."""
    names = [name for i, name in enumerate(motion.model.names) for _ in range(motion.model.nvs[i])]
    return list(enumerate(zip(names, torques, strict=True)))


def above_zero(values: Mapping[str, float], field: str) -> None:
    """Require numbers above 0. Raises SceneError."""
    for joint, value in values.items():
        if not value > 0.0:
            raise SceneError(f"expected a number above 0, got {value!r}", where=f"{field}.{joint}",
                             remedy="leave the joint out, or give a larger one")  # fmt: skip
