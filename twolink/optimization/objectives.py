"""Objectives and constraints by name: functions of a run, written KIND, KIND:FRAME or KIND:JOINT=VALUE,... as text.

Integrals are by Simpson's rule over the samples; the error that an `Optimum` states includes that of the rule.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import simpson
from scipy.interpolate import CubicSpline

from twolink.dynamics import Robot
from twolink.errors import SceneError, nearest, require_known
from twolink.simulation.trajectory import Trajectory

Objective = Callable[[Trajectory], float]
_NUMBERS = (float, int, np.number, np.ndarray)
_AXES = {"x": 0, "y": 1, "z": 2}


def value_of(function: Objective, run: Trajectory, name: str = "objective") -> float:
    """The value of a function of a run. Raises SceneError where it is no finite number, code "objective"."""
    value = function(run)
    if not (np.ndim(value) == 0 and isinstance(value, _NUMBERS) and math.isfinite(value)):
        raise SceneError(f"expected a finite number, got {value!r}", argument=name.partition("[")[0], where=name,
                         remedy="return one number of the run, such as run.q[-1, 0]", code="objective")  # fmt: skip
    return float(value)


@dataclass(frozen=True)
class FramePosition:
    """The position of a link's frame along an axis of the world at the end of the run, m."""

    frame: str
    axis: str = "z"

    def __call__(self, run: Trajectory) -> float:
        """The position, m."""
        return float(run.robot.frame_pose(run.robot.normalize(run.q[-1]), self.frame)[1][_AXES[self.axis]])


@dataclass(frozen=True)
class FrameSpeed:
    """The speed of a link's frame at the end of the run, m/s; along an axis of the world where one is given."""

    frame: str
    axis: str = ""

    def __call__(self, run: Trajectory) -> float:
        """The speed, m/s."""
        velocity = run.robot.frame_velocity(run.robot.normalize(run.q[-1]), run.v[-1], self.frame)[:3]
        return float(velocity[_AXES[self.axis]] if self.axis else np.linalg.norm(velocity))


@dataclass(frozen=True)
class FrameDistance:
    """The distance of a link's frame from a point of the world at the end of the run, m."""

    frame: str
    point: tuple[float, float, float]

    def __call__(self, run: Trajectory) -> float:
        """The distance, m."""
        place = run.robot.frame_pose(run.robot.normalize(run.q[-1]), self.frame)[1]
        return float(np.linalg.norm(place - np.array(self.point)))


@dataclass(frozen=True)
class StateDistance:
    """The squared distance from a state of rest at the end of the run, in rad and m.

        |q - q*|^2 + T^2 |v|^2,   over the joints of q*; T = time

    q : tuple of (joint, value)
        q*, rad or m; angles count modulo a turn for continuous joints only.
    time : float
        T, s.
    """

    q: tuple[tuple[str, float], ...]
    time: float = 1.0

    def __call__(self, run: Trajectory) -> float:
        """The squared distance."""
        robot, end = run.robot, run.q[-1].copy()
        joints = {joint.name: joint for joint in robot.joints}
        for name, value in self.q:
            end[joints[name].q] = joints[name].configuration(value)
        off, chosen = robot.difference(robot.normalize(end), run.q[-1]), [joints[name].v for name, _ in self.q]
        return float(sum((off[part] ** 2).sum() + self.time**2 * (run.v[-1, part] ** 2).sum() for part in chosen))


@dataclass(frozen=True)
class Integral:
    """The integral of a square over the run, summed over joints.

    what : {"effort", "smoothness", "motion", "jerk"}
        Of the applied joint torques [N^2 m^2 s], of the accelerations [rad^2/s^3], of the velocities [rad^2/s], or of
        the rates of the accelerations [rad^2/s^5], by a cubic spline: for motions without events.
    """

    what: str

    def __call__(self, run: Trajectory) -> float:
        """The integral."""
        if self.what == "jerk":
            rows = CubicSpline(run.t, run.acceleration).derivative()(run.t)
        else:
            rows = _rows(run, {"effort": "tau", "smoothness": "a", "motion": "v"}[self.what])
        return float(simpson((rows**2).sum(axis=1), x=run.t))


def _rows(run: Trajectory, what: str) -> np.ndarray:
    """q, v, a or tau at the samples."""
    return np.asarray(getattr(run, {"a": "acceleration"}.get(what, what)))


@dataclass(frozen=True)
class Extreme:
    """The greatest or the least value that a joint's q, v, a or tau has at a sample, SI units.

    side : {"max", "min"}
    what : {"q", "v", "a", "tau"}
        Position, velocity, acceleration, or applied torque.
    joint : str
        With one coordinate, an angle or a length.
    """

    side: str
    what: str
    joint: str

    def __call__(self, run: Trajectory) -> float:
        """The value."""
        joint = next(joint for joint in run.robot.joints if joint.name == self.joint)
        rows = _rows(run, self.what)[:, joint.q if self.what == "q" else joint.v]
        return float(rows.max() if self.side == "max" else rows.min())


def final_energy(run: Trajectory) -> float:
    """Kinetic and potential energy at the end of the run, J."""
    return float(run.energy[-1])


def end_time(run: Trajectory) -> float:
    """The time at which the run ends, s."""
    return float(run.t[-1])


KINDS = {
    "x:FRAME": "position of a link at the end, m; also y and z",
    "speed:FRAME": "speed of a link at the end, m/s; also speed-x, speed-y, speed-z",
    "reach:FRAME=X Y Z": "distance of a link from a point at the end, m",
    "rest:JOINT=VALUE,...": "squared distance from a state of rest at the end, rad^2",
    "energy": "at the end, J",
    "time": "at which the run ends, s",
    "effort": "integral of the squared joint torques, N^2 m^2 s",
    "smoothness": "integral of the squared accelerations, rad^2/s^3",
    "motion": "integral of the squared velocities, rad^2/s",
    "jerk": "integral of the squared rates of accelerations, rad^2/s^5",
    "max-v:JOINT": "the greatest velocity at a sample; also min-, and q, a, tau in place of v",
}


def named_objective(text: str, robot: Robot, argument: str = "objective") -> Objective:
    """The objective that a text names, see `KINDS`. Raises SceneError."""
    kind, _, rest = text.partition(":")
    head, _, axis = kind.partition("-")
    if kind in _AXES or (head == "speed" and (axis in _AXES or not axis)):
        require_known(rest, robot.frame_names, SceneError, "there is no frame {!r}", argument=argument)
        return FramePosition(rest, kind) if kind in _AXES else FrameSpeed(rest, axis)
    if kind == "reach":
        frame, _, point = rest.partition("=")
        require_known(frame, robot.frame_names, SceneError, "there is no frame {!r}", argument=argument)
        numbers = _numbers(point.replace(",", " ").split(), text, argument)
        if len(numbers) != 3:
            raise SceneError(f"expected a point of three numbers in {text!r}", argument=argument,
                             remedy="such as reach:hand=0.5 0 0.3")  # fmt: skip
        return FrameDistance(frame, (numbers[0], numbers[1], numbers[2]))
    if kind == "rest" and rest:
        pairs = [pair.partition("=") for pair in rest.split(",")]
        for name, _, _ in pairs:
            require_known(name.strip(), robot.joint_names, SceneError, "there is no joint {!r}", argument=argument)
        values = _numbers([value for _, _, value in pairs], text, argument)
        return StateDistance(tuple((name.strip(), value) for (name, _, _), value in zip(pairs, values, strict=True)))
    if head in ("max", "min") and axis in ("q", "v", "a", "tau"):
        known = [joint.name for joint in robot.joints if joint.kind == "vector" and joint.v.stop - joint.v.start == 1]
        require_known(rest, known, SceneError, "there is no joint {!r} with one coordinate", argument=argument)
        return Extreme(head, axis, rest)
    plain: dict[str, Objective] = {"energy": final_energy, "time": end_time}
    plain |= {what: Integral(what) for what in ("effort", "smoothness", "motion", "jerk")}
    if text in plain:
        return plain[text]
    kinds = [name.partition(":")[0] for name in KINDS]
    raise SceneError(f"there is no objective {text!r}", argument=argument, remedy=nearest(kind, [*kinds, "y", "z"]),
                     code="unknown-objective")  # fmt: skip


def _numbers(texts: list[str], whole: str, argument: str) -> list[float]:
    try:
        return [float(text) for text in texts]
    except ValueError:
        raise SceneError(f"expected numbers in {whole!r}", argument=argument, remedy="such as rest:elbow=0") from None


@dataclass(frozen=True)
class Limit:
    """A constraint: sign (objective - value) >= 0; sign +1 is "at least", -1 "at most"."""

    objective: Objective
    value: float
    sign: float

    def __call__(self, run: Trajectory) -> float:
        """How far the objective is from the value, on the side that is allowed."""
        return self.sign * (self.objective(run) - self.value)


def named_limit(text: str, robot: Robot, sign: float, argument: str) -> Limit:
    """The constraint that a text such as "z:hand=0.3" names. Raises SceneError."""
    kind, _, value = text.rpartition("=")
    return Limit(named_objective(kind, robot, argument), _numbers([value], text, argument)[0], sign)
