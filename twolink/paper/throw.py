"""Throws: the best time to release a ball, by the derivatives of the throw with respect to the times.

A bundled scene holds the ball by a weld loop until a time, and may hold the elbow by a torque until another. From the
middle of their windows on, `optimize` varies all times at once: each run of the arm, the flight and what follows gives
the slopes by all of them. They say what a millisecond costs, too.
"""

import dataclasses
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial

import msgspec
import numpy as np

from twolink.dynamics import Robot
from twolink.effects.effect import Effect
from twolink.effects.forces import Torque
from twolink.effects.triggers import Release, Watch
from twolink.errors import SceneError, require_known
from twolink.optimization.objectives import FramePosition, FrameSpeed, Objective
from twolink.optimization.optimize import Optimum, optimize
from twolink.optimization.search import Progress
from twolink.scenes import Scene, load_scene
from twolink.scenes.parameters import scene_with
from twolink.scenes.scene import accuracy_of
from twolink.simulation.error_bar import SAFETY
from twolink.simulation.scene_run import simulate
from twolink.simulation.trajectory import Trajectory

SHOWN = 9  # release times in a figure
MOST = 60  # evaluations
State = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Aim:
    """What a search maximizes: `what` of the ball at the scene's end, in `unit`.

    windows: the range of each release time [s], by what is released: the ball, and perhaps the elbow. derivatives: as
    in `optimize`.
    """

    what: str
    unit: str
    objective: Objective
    windows: Mapping[str, tuple[float, float]]
    derivatives: str = "auto"


AIMS = {
    "pitch": Aim("distance", "m", FramePosition("ball", "x"), {"ball": (0.06, 0.14), "elbow": (0.0, 0.09)}),
    "bowl": Aim("speed at the pins", "m/s", FrameSpeed("ball", "x"), {"ball": (0.22, 0.38)}, "runs"),
}


QUANTITIES = ("shoulder", "elbow", "elevation", "speed", "end")


@dataclass(frozen=True)
class Throw:
    """One throw.

    times: the release times [s]. shoulder, elbow: their angles at the ball's release [rad]. elevation: the angle of the
    ball's velocity above the horizontal [rad], speed: of the ball [m/s], velocity: of the ball (3,) [m/s], all at its
    release. end: the quantity aimed at; 0 where the ball does not arrive within the scene's duration. joints: positions
    of shoulder, elbow and ball at the release (3, 3) [m]. run: the simulation. errors: of each of QUANTITIES; empty
    where the throw is not verified.
    """

    times: Mapping[str, float]
    shoulder: float
    elbow: float
    elevation: float
    speed: float
    end: float
    velocity: np.ndarray
    joints: np.ndarray
    run: Trajectory
    errors: Mapping[str, float] = field(default_factory=dict)

    @property
    def flight(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Times (n,), positions (n, 3) and velocities (n, 3) of the ball at the run's samples after the release."""
        late = self.run.t >= self.times["ball"]
        return self.run.t[late], *ball_state(self.run.robot, self.run.q[late], self.run.v[late])


@dataclass(frozen=True)
class SearchResult:
    """The best throw, verified, and how it was found, with the slopes and second derivatives by the release times."""

    name: str
    aim: Aim
    accuracy: float
    best: Throw
    found: Optimum
    seconds: float

    @property
    def by_time(self) -> dict[str, tuple[float, float, float]]:
        """Of each release time: the aim's slope [unit/s], its numerical error, and second derivative [unit/s^2]."""
        rows = zip(self.found.gradient, self.found.gradient_error, np.diag(self.found.hessian), strict=True)
        return {what: (float(a), float(b), float(c)) for what, (a, b, c) in zip(self.best.times, rows, strict=True)}

    @property
    def resolution(self) -> dict[str, float]:
        """How far each time may be off without a change of the aim beyond its error, s."""
        return dict(zip(self.best.times, self.found.resolution.values(), strict=True))

    def others(self) -> list[Throw]:
        """Throws at release times of the ball across its window, the elbow's as in the best one."""
        scene, window = load_scene(self.name), self.aim.windows["ball"]
        return [throw(scene, self.aim, {**self.best.times, "ball": float(t)}, self.accuracy)
                for t in np.linspace(*window, SHOWN)]  # fmt: skip


def search(name: str, accuracy: float = 1e-6, progress: Progress | None = None) -> SearchResult:
    """Find the best throw of a bundled scene.

    Parameters
    ----------
    name : str
        "pitch" or "bowl".
    accuracy : float
        Accuracy of the simulations, rad or m. The best throw has an error bar.
    progress : callable, optional
        Called with the number of evaluations done, the most that are allowed, and a label.

    Returns
    -------
    SearchResult
        Ctrl-C ends the search with the best throw so far.

    Raises
    ------
    SceneError, AccuracyError
    """
    require_known(name, AIMS, SceneError, "there is no throw {!r}", argument="what")
    accuracy, began, aim, scene = accuracy_of(accuracy), time.perf_counter(), AIMS[name], load_scene(name)
    places = {_released(effect): f"effects.{i}.at" for i, effect in enumerate(scene.effects)
              if isinstance(effect, Release)}  # fmt: skip
    wrt = {places[what]: window for what, window in aim.windows.items()}
    middle = scene_with(scene, {place: 0.5 * (low + high) for place, (low, high) in wrt.items()})
    found = optimize(middle, wrt, aim.objective, maximize=True, starts=1, accuracy=accuracy, evaluations=MOST,
                     derivatives=aim.derivatives, progress=progress)  # fmt: skip
    times = {what: found.values[places[what]] for what in aim.windows}
    best = throw(scene, aim, times, accuracy, verify=True)
    return SearchResult(name, aim, accuracy, best, found, time.perf_counter() - began)


def throw(scene: Scene, aim: Aim, times: Mapping[str, float], accuracy: float, *, verify: bool = False) -> Throw:
    """Simulate one throw with these release times [s]; with error bars if `verify`."""
    released: list[State] = []
    ended: list[State] = []
    effects: list[Effect] = [Watch("released", at=times["ball"], then=partial(_record, released))]
    names = {id(effect): what for what, effect in _releases(scene).items()}
    for effect in scene.effects:
        if id(effect) in names:
            effect = msgspec.structs.replace(effect, at=times[names[id(effect)]])
        elif isinstance(effect, Watch):
            effect = msgspec.structs.replace(effect, then=partial(_record, ended))
        effects.append(effect)
    run = simulate(scene.with_effects(effects), accuracy=accuracy, verify=verify)
    if run.interrupted:
        raise KeyboardInterrupt
    if not verify:
        return _throw_from(aim, times, run, released[-1], ended[-1] if ended else None)
    # A verified run is solved twice; the last solution is the more accurate one.
    result, finer = (_throw_from(aim, times, run, released[i], ended[i] if ended else None) for i in (-2, -1))
    distances = {name: abs(getattr(result, name) - getattr(finer, name)) for name in QUANTITIES}
    errors = {name: SAFETY * distance + accuracy / 1000 for name, distance in distances.items()}
    return dataclasses.replace(result, errors=errors)


def _releases(scene: Scene) -> dict[str, Release]:
    """The releases of a scene, by what they release: a torque by its joint, the loop that holds the ball as "ball"."""
    releases = [effect for effect in scene.effects if isinstance(effect, Release)]
    return {_released(effect): effect for effect in releases}


def _released(effect: Release) -> str:
    return next(iter(effect.of.inputs)) if isinstance(effect.of, Torque) else "ball"


def _record(states: list[State], q: np.ndarray, v: np.ndarray) -> State:
    """The response to an event: append the state to `states`, and leave it as it is."""
    states.append((q, v))
    return q, v


def _throw_from(aim: Aim, times: Mapping[str, float], run: Trajectory, released: State, ended: State | None) -> Throw:
    """A throw from its states at the release and at the end."""
    robot, q = run.robot, run.robot.normalize(released[0])
    joints = np.array([robot.frame_pose(q, link)[1] for link in ("upper_arm", "forearm", "ball")])
    shoulder, elbow = (float(q[joint.q][0]) for joint in robot.joints if joint.name in ("shoulder", "elbow"))
    velocity = ball_state(robot, *released)[1]
    elevation, speed = float(np.arctan2(velocity[2], velocity[0])), float(np.linalg.norm(velocity))
    end = 0.0
    if ended is not None:
        end = float(ball_state(robot, *ended)[0 if aim.unit == "m" else 1][0])
    return Throw(dict(times), shoulder, elbow, elevation, speed, end, velocity, joints, run)


def ball_state(robot: Robot, q: np.ndarray, v: np.ndarray) -> State:
    """The ball's position [m] and velocity [m/s] in the world's axes, (..., 3) each."""
    q = robot.normalize(q)
    return robot.frame_pose(q, "ball")[1], robot.frame_velocity(q, v, "ball")[..., :3]
