"""Throws: the best time to release a ball, found by simulating a scene with many release times.

A bundled scene holds the ball by a weld loop until a time, and may hold the elbow by a torque until another. First the
release time of the ball is scanned. From the best one on, SciPy's bounded optimizer COBYQA (Ragonneau 2022) varies all
times. Every throw is a simulation of the arm, the flight and what follows.
"""

import dataclasses
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial

import msgspec
import numpy as np
from scipy.optimize import minimize

from twolink.dynamics import Robot
from twolink.effects.effect import Effect
from twolink.effects.release import Release
from twolink.effects.torque import Torque
from twolink.effects.watch import Watch
from twolink.errors import SceneError, require_known
from twolink.scenes import Scene, load_scene
from twolink.scenes.scene import accuracy_of
from twolink.simulation.error_bar import SAFETY
from twolink.simulation.scene_run import simulate
from twolink.simulation.trajectory import Trajectory

SCANNED = 9  # release times
RESOLUTION = 1e-5  # s, of the best times
FIRST_STEP = 5e-3  # s, of the optimizer
MAX_THROWS = 60  # of the optimizer
State = tuple[np.ndarray, np.ndarray]
Progress = Callable[[int, int, str], None]


@dataclass(frozen=True)
class Aim:
    """What a search maximizes: `what` of the ball at the scene's end, in `unit`.

    windows: the range of each release time [s], by what is released: the ball, and perhaps the elbow. expected: the
    usual number of throws of a search, for the progress bar.
    """

    what: str
    unit: str
    windows: Mapping[str, tuple[float, float]]
    expected: int


AIMS = {
    "pitch": Aim("distance", "m", {"ball": (0.06, 0.14), "elbow": (0.0, 0.09)}, 35),
    "bowl": Aim("speed at the pins", "m/s", {"ball": (0.22, 0.38)}, 20),
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
    """The best throw, verified; the scanned throws and all tried ones, each solved once for the accuracy.

    resolution: of the best times [s].
    """

    name: str
    aim: Aim
    accuracy: float
    best: Throw
    scanned: tuple[Throw, ...]
    tried: tuple[Throw, ...]
    seconds: float
    interrupted: bool
    resolution: float = RESOLUTION


def search(name: str, accuracy: float = 1e-6, progress: Progress | None = None) -> SearchResult:
    """Find the best throw of a bundled scene.

    Parameters
    ----------
    name : str
        "pitch" or "bowl".
    accuracy : float
        Accuracy of the simulations, rad or m. The best throw has an error bar.
    progress : callable, optional
        Called with the number of throws done, the expected number, and a label.

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
    tried: list[Throw] = []

    def report(total: int, label: str) -> None:
        if progress is not None:
            progress(len(tried), total, label)

    def loss(times: Mapping[str, float]) -> float:
        report(max(aim.expected, len(tried) + 1), f"release at {1e3 * times['ball']:.2f} ms")
        tried.append(throw(scene, aim, times, accuracy))
        return -tried[-1].end

    interrupted = False
    start = {what: float(effect.at or 0.0) for what, effect in _releases(scene).items()}
    try:
        for release in np.linspace(*aim.windows["ball"], SCANNED):
            loss({**start, "ball": float(release)})
        _refine(aim, max(tried, key=lambda t: t.end).times, loss)
    except KeyboardInterrupt:
        interrupted = True
        if not tried:
            raise
    report(len(tried) + 1, "the best, with its error bar")
    best = throw(scene, aim, max(tried, key=lambda t: t.end).times, accuracy, verify=True)
    seconds = time.perf_counter() - began
    return SearchResult(name, aim, accuracy, best, tuple(tried[:SCANNED]), tuple(tried), seconds, interrupted)


def _refine(aim: Aim, best: Mapping[str, float], loss: Callable[[Mapping[str, float]], float]) -> None:
    """Vary all times, from the best of the scan on."""

    def scaled_loss(x: np.ndarray) -> float:
        return loss({what: FIRST_STEP * float(t) for what, t in zip(best, x, strict=True)})

    start = [t / FIRST_STEP for t in best.values()]
    bounds = [tuple(t / FIRST_STEP for t in aim.windows[what]) for what in best]
    options = {"final_tr_radius": RESOLUTION / FIRST_STEP, "maxfev": MAX_THROWS}
    minimize(scaled_loss, start, method="COBYQA", bounds=bounds, options=options)


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
    return {next(iter(e.of.inputs)) if isinstance(e.of, Torque) else "ball": e for e in releases}


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
