"""Throws: when to let a ball go. A scene at many release times, and the best of them.

A bundled scene holds the ball by a weld loop until a time, and may hold the elbow by its flexors until another. First
the ball's time is scanned; from the best, all times are varied by a bounded optimizer of SciPy (Brent's for one, for
two COBYQA: Ragonneau 2022). Every throw is a simulation of the arm, the flight and what follows.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import msgspec
import numpy as np
import pinocchio as pin
from scipy.optimize import minimize, minimize_scalar

from twolink.effects.effect import Effect
from twolink.effects.release import Release
from twolink.effects.torque import Torque
from twolink.effects.watch import Watch
from twolink.errors import SceneError, nearest
from twolink.integrate.method_choice import SAFETY
from twolink.scenes import Scene, load_scene
from twolink.scenes.scene import accuracy_of
from twolink.simulation.scene_run import simulate
from twolink.simulation.trajectory import Trajectory

SCANNED = 9  # release times
SHARP = 1e-5  # s: the best times are found to about this
FIRST = 5e-3  # s: the first step of an optimizer of several times
MOST = 60  # throws of an optimizer
State = tuple[np.ndarray, np.ndarray]
Progress = Callable[[int, int, str], None]


@dataclass(frozen=True)
class Aim:
    """What a throw is for: `what` of the ball when the scene ends is to be large, in `unit`.

    windows: between which times [s] what is held is let go, by what it is: the ball, and perhaps the elbow. expected:
    how many throws a search takes, about.
    """

    what: str
    unit: str
    windows: Mapping[str, tuple[float, float]]
    expected: int


AIMS = {
    "pitch": Aim("distance", "m", {"ball": (0.06, 0.14), "elbow": (0.0, 0.09)}, 35),
    "bowl": Aim("speed at the pins", "m/s", {"ball": (0.22, 0.38)}, 20),
}


@dataclass(frozen=True)
class Throw:
    """One throw. times: of letting go, s. angles: of shoulder and elbow then, rad. velocity: of the ball then, m/s.

    end: what was aimed at; 0 where the ball does not arrive within the scene's duration. joints: where shoulder, elbow
    and ball are at the release (3, 3), m. run: the simulation. errors: of shoulder, elbow, elevation, speed and end;
    None where it was not verified.
    """

    times: Mapping[str, float]
    angles: tuple[float, float]
    velocity: np.ndarray
    end: float
    joints: np.ndarray
    run: Trajectory
    errors: Mapping[str, float] | None = None

    @property
    def speed(self) -> float:
        """Of the ball at its release, m/s."""
        return float(np.linalg.norm(self.velocity))

    @property
    def elevation(self) -> float:
        """The angle of the ball's velocity above the horizontal at its release, rad."""
        return float(np.arctan2(self.velocity[2], self.velocity[0]))

    @property
    def quantities(self) -> dict[str, float]:
        """What there is an error of."""
        shoulder, elbow = self.angles
        return {"shoulder": shoulder, "elbow": elbow, "elevation": self.elevation, "speed": self.speed, "end": self.end}

    @property
    def flight(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The ball's times (n,), places (n, 3) and velocities (n, 3) from the release on, at the run's samples."""
        late = self.run.t >= self.times["ball"]
        states = [ball(self.run, q, v) for q, v in zip(self.run.q[late], self.run.v[late], strict=True)]
        places, velocities = (np.array(part).reshape(-1, 3) for part in zip(*states, strict=True))
        return self.run.t[late], places, velocities


@dataclass(frozen=True)
class Throws:
    """A search: the best throw, verified; the scanned ones and all that were tried, solved once for the accuracy.

    sharp: s, to what the best times were found.
    """

    name: str
    aim: Aim
    accuracy: float
    best: Throw
    scanned: tuple[Throw, ...]
    tried: tuple[Throw, ...]
    seconds: float
    interrupted: bool
    sharp: float = SHARP


def search(name: str, accuracy: float = 1e-6, progress: Progress | None = None) -> Throws:
    """Find the best throw of a bundled scene: "pitch" or "bowl".

    accuracy: of the simulations, rad or m; the best has an error bar. progress: called with throws done, how many there
    will be, about, and words. Ctrl-C keeps the best so far. Raises SceneError and AccuracyError.
    """
    if name not in AIMS:
        raise SceneError(f"there is no throw {name!r}", argument="what", remedy=nearest(name, AIMS))
    accuracy, began, aim, scene = accuracy_of(accuracy), time.perf_counter(), AIMS[name], load_scene(name)
    tried: list[Throw] = []

    def loss(times: Mapping[str, float]) -> float:
        if progress is not None:
            progress(len(tried), max(aim.expected, len(tried) + 1), f"release at {1e3 * times['ball']:.2f} ms")
        tried.append(throw(scene, aim, times, accuracy))
        return -tried[-1].end

    interrupted = False
    start = {what: float(effect.at or 0.0) for what, effect in _held(scene).items()}
    try:
        for release in np.linspace(*aim.windows["ball"], SCANNED):
            loss({**start, "ball": float(release)})
        _refine(aim, max(tried, key=lambda t: t.end).times, loss)
    except KeyboardInterrupt:
        interrupted = True
        if not tried:
            raise
    if progress is not None:
        progress(len(tried), len(tried) + 1, "the best, with its error bar")
    best = throw(scene, aim, max(tried, key=lambda t: t.end).times, accuracy, verify=True)
    seconds = time.perf_counter() - began
    return Throws(name, aim, accuracy, best, tuple(tried[:SCANNED]), tuple(tried), seconds, interrupted)


def _refine(aim: Aim, best: Mapping[str, float], loss: Callable[[Mapping[str, float]], float]) -> None:
    """Vary all times from the best of the scan on."""
    if len(best) == 1:
        low, high = aim.windows["ball"]
        near, apart = best["ball"], (high - low) / (SCANNED - 1)
        between = max(low, near - apart), min(high, near + apart)
        minimize_scalar(lambda t: loss({"ball": float(t)}), bounds=between, method="bounded",
                        options={"xatol": SHARP, "maxiter": MOST})  # fmt: skip
        return
    names = list(best)
    minimize(lambda x: loss({what: FIRST * float(t) for what, t in zip(names, x, strict=True)}),
             [best[what] / FIRST for what in names], method="COBYQA",
             bounds=[tuple(t / FIRST for t in aim.windows[what]) for what in names],
             options={"final_tr_radius": SHARP / FIRST, "maxfev": MOST})  # fmt: skip


def throw(scene: Scene, aim: Aim, times: Mapping[str, float], accuracy: float, *, verify: bool = False) -> Throw:
    """Simulate one throw: what is held is let go at these times. verify: with an error bar."""
    released: list[State] = []
    ended: list[State] = []
    effects: list[Effect] = [Watch("released", at=times["ball"], then=_noting(released))]
    places = {id(effect): what for what, effect in _held(scene).items()}
    for effect in scene.effects:
        if id(effect) in places:
            effects.append(msgspec.structs.replace(effect, at=times[places[id(effect)]]))
        elif isinstance(effect, Watch):
            effects.append(msgspec.structs.replace(effect, then=_noting(ended)))
        else:
            effects.append(effect)
    run = simulate(scene.with_effects(effects), accuracy=accuracy, verify=verify)
    if run.interrupted:
        raise KeyboardInterrupt
    ours, finer = (-2, -1) if verify else (-1, -1)  # a verified run is solved twice, the second time more finely
    found = [_seen(aim, times, run, released[i], ended[i] if ended else None) for i in (ours, finer)]
    if not verify:
        return found[0]
    errors = {what: SAFETY * abs(value - found[1].quantities[what]) + accuracy / 1000
              for what, value in found[0].quantities.items()}  # fmt: skip
    return dataclasses.replace(found[0], errors=errors)


def _held(scene: Scene) -> dict[str, Release]:
    """What a scene lets go, by what it is: a torque by its joint, a loop by the ball in it."""
    held = [effect for effect in scene.effects if isinstance(effect, Release)]
    return {next(iter(e.of.inputs)) if isinstance(e.of, Torque) else "ball": e for e in held}


def _noting(states: list[State]) -> Callable[[np.ndarray, np.ndarray], State]:
    """What keeps the state of an event, and changes nothing."""

    def note(q: np.ndarray, v: np.ndarray) -> State:
        states.append((q, v))
        return q, v

    return note


def _seen(aim: Aim, times: Mapping[str, float], run: Trajectory, released: State, ended: State | None) -> Throw:
    """A throw from its states at the release and at the end."""
    model, data = run.robot.model, run.robot.model.createData()
    pin.framesForwardKinematics(model, data, released[0])
    joints = np.array([data.oMi[model.getJointId(joint)].translation for joint in ("shoulder", "elbow", "flight")])
    entries = {joint.name: joint.q.start for joint in run.robot.joints}
    shoulder, elbow = (float(released[0][entries[joint]]) for joint in ("shoulder", "elbow"))
    end = 0.0
    if ended is not None:
        place, velocity = ball(run, *ended)
        end = float(place[0] if aim.unit == "m" else velocity[0])
    return Throw(dict(times), (shoulder, elbow), ball(run, *released)[1], end, joints, run)


def ball(run: Trajectory, q: np.ndarray, v: np.ndarray) -> State:
    """The ball's place [m] and velocity [m/s] along the world's axes: its floating joint's own are the ball's."""
    joint = next(joint for joint in run.robot.joints if joint.name == "flight")
    x, y, z, *quaternion = q[joint.q]
    turned = pin.Quaternion(np.array(quaternion)).toRotationMatrix()
    return np.array([x, y, z]), turned @ v[joint.v][:3]
