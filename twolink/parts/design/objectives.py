"""Objectives and constraints by name: functions of a run as texts, and their derivatives along the run's sensitivities.

dF/dp = lim (F(run + h S) - F(run - h S)) / 2 h,   S = d(q, v, z)/dp

run + h S is the run to first order beside it: q moved along the tangent direction h dq/dp, v by h dv/dp, states of
effects by h dz/dp; energy, torques and accelerations are those of the moved states. A run that an event ends has
another end: with the guard g that passes 0 there, it comes dt = -(g_x S + g_p) / g' later, and the state at the end
moves by S + x' dt.

Integrals are by Simpson's rule over the samples; the error that an `Optimum` states includes that of the rule.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from twolink.algorithms.dual_numbers import derivative
from twolink.algorithms.mechanism import mechanism, nominal, with_nominal
from twolink.algorithms.motion import KinematicState
from twolink.algorithms.namespaces import Numbers
from twolink.dynamics import Robot
from twolink.effects.checks import single_joints
from twolink.effects.triggers import Watch
from twolink.errors import SceneError, nearest, require_known, shown
from twolink.integrate.dense_output import DenseOutput
from twolink.integrate.derivatives.parameter_variation import shifted
from twolink.integrate.joint_forces import accelerations_and_joint_torques
from twolink.integrate.motion.effect_numbers import nominal_value, physical
from twolink.scenes import Scene
from twolink.scenes.parameters import Parameter, scene_with
from twolink.simulation.sensitivities import Sensitivities
from twolink.simulation.trajectory import Trajectory

STEP = 1e-3  # rad, m, per second: the largest change of a run; the error of differences is its fourth power


class NotFollowedError(SceneError):
    """A function of a run asks for what is not known beside it; differences of runs tell its derivatives."""


class Unknown:
    """In place of what is not known beside a run: any use of it fails."""

    def __init__(self, what: str) -> None:
        self._what = what

    def _fail(self, *_: Any) -> Any:
        raise NotFollowedError(f"{self._what} beside a run is not known", argument="objective",
                               remedy="use its samples, energy, torques or accelerations")  # fmt: skip

    __len__ = __iter__ = __getitem__ = __bool__ = __contains__ = __getattr__ = _fail


class _Beside(Unknown):
    """The dense output of a run beside another: torques and accelerations at its samples."""

    def __init__(self, run: Trajectory, base: Trajectory, changes: dict[str, float]) -> None:
        super().__init__("the state between samples")
        self.t, self._run, self._base, self._changes = run.t, run, base, changes

    def accelerations_and_torques(self) -> tuple[np.ndarray, np.ndarray]:
        """As `DenseOutput.accelerations_and_torques`."""
        x = np.concatenate([self._run.q.T, self._run.v.T, *(z[None] for z in self._run.states.values())])
        a, tau = np.empty_like(self._run.v), np.empty_like(self._run.v)
        solution = self._base.solution
        pieces = solution.by_segment(self._base.t) if isinstance(solution, DenseOutput) else ()
        for equations, places, numbers in pieces:
            own = {name: nominal_value(equations, name) + change for name, change in self._changes.items()}
            states = np.append(x[:, places], numbers, axis=0)
            found = accelerations_and_joint_torques(shifted(equations, own), self.t[places], states)
            a[places], tau[places] = found[0].T, found[1].T
        return a, tau


@dataclass(frozen=True, eq=False)
class RunVariation:
    """The runs beside a run along a parameter, to first order.

    dq, dv (n, nv): derivatives of the samples. constants: those of constants that functions of the run use besides, by
    name. later: that of the end, s. dz (n, states): of the states of effects; None: not known.
    """

    run: Trajectory
    dq: np.ndarray
    dv: np.ndarray
    constants: Mapping[str, float]
    later: float = 0.0
    dz: np.ndarray | None = None

    def derivative(self, functions: Sequence[Objective], largest: float = np.inf, change: float = STEP) -> np.ndarray:
        """The derivatives (m,) of functions of the run. Raises NotFollowedError.

        largest: change of the parameter; change: of a sample, rad, m, per second.
        """
        largest_z = [max(1.0, float(np.abs(z).max())) for z in self.run.states.values()]  # A, J or a share
        dz = np.zeros(0) if self.dz is None else self.dz / largest_z
        size = max(float(np.abs(rows).max(initial=0.0)) for rows in (self.dq, self.dv, dz))
        step = min(largest, change / size if size else np.inf)
        return np.asarray(derivative(lambda k: np.array([f(self.at(k * step)) for f in functions], dtype=float), step))

    def at(self, h: float) -> Trajectory:
        """The run where the parameter is h more."""
        changes = {name: h * rate for name, rate in self.constants.items()}
        dz = None if self.dz is None else h * self.dz
        return beside(self.run, h * self.dq, h * self.dv, changes, h * self.later, dz)


def variation_by(s: Sensitivities, scene: Scene, parameter: Parameter) -> RunVariation:
    """The variation of the run of a scene by one of its parameters, also of an end at an event."""
    name, run = parameter.name, s.run
    dq, dv = s.q[name][:, :, 0], s.v[name][:, :, 0]
    place, later = watch_at_end(scene, run), 0.0
    if place is not None:
        v, a = run.v[-1], run.acceleration[-1]
        later = _end_shift(scene, run, parameter, place, (v, a), (dq[-1], dv[-1]))
        dq, dv = dq.copy(), dv.copy()
        dq[-1] += later * v
        dv[-1] += later * a
    return RunVariation(run, dq, dv, {name: 1.0} if parameter.acts else {}, later)


def _end_shift(
    scene: Scene, run: Trajectory, parameter: Parameter, place: int, rates: tuple[np.ndarray, np.ndarray],
    along: tuple[np.ndarray, np.ndarray],
) -> float:  # fmt: skip
    """The shift of a run's end in time, per unit of a parameter. place: of the effect that ends it."""
    robot, q, v, t = run.robot, run.q[-1], run.v[-1], float(run.t[-1])
    in_time, across = (STEP / max(1.0, float(np.abs(np.concatenate(pair)).max())) for pair in (rates, along))

    def guard(direction: tuple[np.ndarray, np.ndarray], h: float, later: float, by: float) -> float:
        other = scene if parameter.kind in ("q", "v") or not by else (
            scene_with(scene, {parameter.name: parameter.nominal + by}))  # fmt: skip
        watch, model = cast(Watch, other.effects[place]), other.robot.model
        value, x = watch.function if watch.when is None else watch.when.distance, robot.integrate(q, h * direction[0])
        speeds = (v + h * direction[1]).tolist()
        return float(np.squeeze(value(KinematicState(model, mechanism(model), x.tolist(), speeds, t + later, Numbers))))

    by_time = derivative(lambda k: guard(rates, k * in_time, k * in_time, 0.0), in_time)
    by_parameter = derivative(lambda k: guard(along, k * across, 0.0, k * across), across)
    return float(-by_parameter / by_time)


def beside(
    run: Trajectory, dq: np.ndarray, dv: np.ndarray, changes: dict[str, float], later: float = 0.0,
    dz: np.ndarray | None = None,
) -> Trajectory:  # fmt: skip
    """The run moved by (dq, dv) (n, nv), with other constants by name, which ends so much later [s].

    dz (n, states): the change of the states of effects; None: not known.
    """

    def moved(robot: Robot) -> Robot:
        def change(model: Any) -> None:
            for name, by in physical(changes).items():
                with_nominal(model, name, nominal(model, name) + by)

        return robot.changed(change) if physical(changes) else robot

    states: Any = Unknown("a state of an effect") if run.states and dz is None else run.states
    if dz is not None:
        states = {name: z + by for (name, z), by in zip(states.items(), dz.T, strict=True)}
    q, rows = run.q.copy(), dq.any(axis=1)
    q[rows] = run.robot.integrate(run.q[rows], dq[rows])
    other = replace(run, t=np.append(run.t[:-1], run.t[-1] + later), q=q, v=run.v + dv, states=states,
                    robot=moved(run.robot), error=None, cost=None, precise=None, recorded_energy=None,
                    robots=[(moved(robot), count) for robot, count in run.robots],
                    events=Unknown("what happens"))  # type: ignore[arg-type]  # fmt: skip
    return replace(other, solution=_Beside(other, run, changes))  # type: ignore[arg-type]


def watch_at_end(scene: Scene, run: Trajectory) -> int | None:
    """The place of the effect whose condition ends the run; None where none does."""
    last = {event.effect for event in run.events if event.t == run.t[-1]}
    return next((place for place, effect in enumerate(scene.effects) if place in last and isinstance(effect, Watch)
                 and effect.stop and effect.at is None), None)  # fmt: skip


Objective = Callable[[Trajectory], float]
_NUMBERS = (float, int, np.number, np.ndarray)
_AXES = {"x": 0, "y": 1, "z": 2}


def value_of(function: Objective, run: Trajectory, name: str = "objective") -> float:
    """The value of a function of a run. Raises SceneError where it is no finite number, code "objective"."""
    value = function(run)
    if not (np.ndim(value) == 0 and isinstance(value, _NUMBERS) and math.isfinite(value)):
        raise SceneError(f"expected a finite number, got {value!r:.60}", argument=name.partition("[")[0], where=name,
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
            end[joints[name].q] = joints[name].entries("q", value)
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
        from scipy.integrate import simpson  # half a second, which other objectives do not need
        from scipy.interpolate import CubicSpline

        if self.what == "jerk":
            rows = CubicSpline(run.t, run.acceleration).derivative()(run.t)
        else:
            rows = getattr(run, {"effort": "tau", "smoothness": "acceleration", "motion": "v"}[self.what])
        return float(simpson((rows**2).sum(axis=1), x=run.t))


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
        rows = getattr(run, {"a": "acceleration"}.get(self.what, self.what))
        rows = rows[:, joint.q if self.what == "q" else joint.v]
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


def require_function(function: Any, name: str) -> None:
    """Refuse what is no function of a run. Raises SceneError, code "objective"."""
    if not callable(function):
        raise SceneError(f"expected a function of a run, got {function!r:.60}", argument=name.partition("[")[0],
                         where=name, remedy="such as lambda run: run.q[-1, 0]", code="objective")  # fmt: skip


def objective_of(objective: Objective | str, robot: Robot) -> Objective:
    """The objective, by its text or itself. Raises SceneError."""
    if isinstance(objective, str):
        return named_objective(objective, robot)
    require_function(objective, "objective")
    return objective


def named_objective(text: str, robot: Robot, argument: str = "objective") -> Objective:
    """The objective that a text names, see `KINDS`. Raises SceneError."""
    kind, _, rest = text.partition(":")
    head, _, axis = kind.partition("-")
    one = "there is no joint {!r} with one coordinate"
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
            require_known(name.strip(), single_joints(robot), SceneError, one, argument=argument)
        values = _numbers([value for _, _, value in pairs], text, argument)
        return StateDistance(tuple((name.strip(), value) for (name, _, _), value in zip(pairs, values, strict=True)))
    if head in ("max", "min") and axis in ("q", "v", "a", "tau"):
        known = [joint.name for joint in robot.joints if joint.unit and joint.kind == "vector"]
        require_known(rest, known, SceneError, one, argument=argument)
        return Extreme(head, axis, rest)
    plain: dict[str, Objective] = {"energy": final_energy, "time": end_time}
    plain |= {what: Integral(what) for what in ("effort", "smoothness", "motion", "jerk")}
    if text in plain:
        return plain[text]
    kinds = [name.partition(":")[0] for name in KINDS]
    raise SceneError(f"there is no objective {shown(text)}", argument=argument, code="unknown-objective",
                     remedy=nearest(kind, [*kinds, "y", "z"]))  # fmt: skip


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
        """The distance of the objective from the value, above 0 on the side that is allowed."""
        return self.sign * (self.objective(run) - self.value)


def named_limit(text: str, robot: Robot, sign: float, argument: str) -> Limit:
    """The constraint that a text such as "z:hand=0.3" names. Raises SceneError."""
    kind, _, value = text.rpartition("=")
    return Limit(named_objective(kind, robot, argument), _numbers([value], text, argument)[0], sign)
