"""Throws: the best time to release a ball, by the derivatives of the throw with respect to the times, and its figure.

A bundled scene holds the ball by a weld loop until a time, and may hold the elbow by a torque until another. From the
middle of their windows on, `optimize` varies all times at once: each run of the arm, the flight and what follows gives
the slopes by all of them. They say what a millisecond costs, too.
"""

import dataclasses
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from twolink.dynamics import Robot
from twolink.effects.effect import Effect
from twolink.effects.forces import Torque
from twolink.effects.triggers import Release, Watch
from twolink.errors import SceneError, require_known
from twolink.io.progress import Report
from twolink.parts.design.objectives import FramePosition, FrameSpeed, Objective
from twolink.parts.design.optimize import Optimum, optimize
from twolink.scenes import Scene, load_scene
from twolink.scenes.parameters import scene_with
from twolink.scenes.scene import accuracy_of
from twolink.show.figure import COLOURS, label_ends, new_figure, save_figure
from twolink.simulation.error_bar import SAFETY
from twolink.simulation.scene_run import simulate
from twolink.simulation.trajectory import Trajectory

SHOWN = 9  # release times in a figure
MOST = 60  # evaluations
State = tuple[np.ndarray, np.ndarray]
BEST, OTHERS, ARM, GROUND = COLOURS[5], COLOURS[4], "0.25", "0.4"
BEST_LINE: dict[str, Any] = {"color": BEST, "linewidth": 2.4, "zorder": 3}
OTHER_LINE: dict[str, Any] = {"color": OTHERS, "linewidth": 1.2, "zorder": 2}
SAME_RELEASE = 1e-3  # s: a throw released so near to the best one is not drawn beside it
MARGIN = 0.06  # of the height
LANE = (-0.6, 4.5)  # m: the part of the lane that is drawn, because the ball is low


@dataclass(frozen=True)
class Aim:
    """The aim of a search, which maximizes `what` of the ball at the scene's end, in `unit`.

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
        """The change of each time that changes the aim by its error, s."""
        return dict(zip(self.best.times, self.found.resolution.values(), strict=True))

    def others(self) -> list[Throw]:
        """Throws at release times of the ball across its window, the elbow's as in the best one."""
        scene, window = load_scene(self.name), self.aim.windows["ball"]
        return [throw(scene, self.aim, {**self.best.times, "ball": float(t)}, self.accuracy)
                for t in np.linspace(*window, SHOWN)]  # fmt: skip


def search(name: str, accuracy: float = 1e-6, progress: Report | None = None) -> SearchResult:
    """Find the best throw of a bundled scene.

    Parameters
    ----------
    name : str
        "pitch" or "bowl".
    accuracy : float
        Accuracy of the simulations, rad or m. The best throw has an error bar.
    progress : callable, optional
        Called now and then with what is done, the total and a label; here evaluations.

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
    places = {what: f"effects.{i}.at" for i, what in _releases(scene).items()}
    wrt = {places[what]: window for what, window in aim.windows.items()}
    middle = scene_with(scene, {place: 0.5 * (low + high) for place, (low, high) in wrt.items()})
    found = optimize(middle, objective=aim.objective, wrt=wrt, accuracy=accuracy, maximize=True, starts=1,
                     evaluations=MOST, derivatives=aim.derivatives, progress=progress)  # fmt: skip
    times = {what: found.values[places[what]] for what in aim.windows}
    best = throw(scene, aim, times, accuracy, verify=True)
    return SearchResult(name, aim, accuracy, best, found, time.perf_counter() - began)


def throw(scene: Scene, aim: Aim, times: Mapping[str, float], accuracy: float, *, verify: bool = False) -> Throw:
    """Simulate one throw with these release times [s]; with error bars if `verify`."""
    released: list[State] = []
    ended: list[State] = []
    effects: list[Effect] = [Watch("released", at=times["ball"], then=partial(_record, released))]
    names = _releases(scene)
    for i, effect in enumerate(scene.effects):
        if i in names:
            effect = msgspec.structs.replace(effect, at=times[names[i]])
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


def _releases(scene: Scene) -> dict[int, str]:
    """Names of what each release of a scene lets go, by its place: a torque by its joint, the ball's loop as "ball"."""
    return {i: next(iter(effect.of.inputs)) if isinstance(effect.of, Torque) else "ball"
            for i, effect in enumerate(scene.effects) if isinstance(effect, Release)}  # fmt: skip


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


def plot_search(result: SearchResult, path: Path) -> Path:
    """Draw the paths above; below, the speed along them, and the aim over the elevation at the release."""
    figure, axes = new_figure(2, 2, size=(11, 6.8), height_ratios=[1.15, 1])
    axes[0, 1].remove()
    axes[0, 0].set_subplotspec(axes[0, 0].get_gridspec()[0, :])  # the paths take the whole row
    release = result.best.times["ball"]
    others = [one for one in result.others() if abs(one.times["ball"] - release) > SAME_RELEASE]
    _draw_paths(figure, axes[0, 0], result, others)
    _draw_speeds(axes[1, 0], result, others)
    _draw_aim(axes[1, 1], result, others)
    best, aim = result.best, result.aim
    reached = f"{aim.what} {best.end:.4g} {aim.unit}, released after {1e3 * best.times['ball']:.2f} ms"
    ended = ", interrupted" if result.found.interrupted else ""
    figure.suptitle(f"{result.name}: {reached} at {best.speed:.4g} m/s and {np.degrees(best.elevation):.1f}°{ended}")
    return save_figure(figure, path)


def _draw_paths(figure: Any, axis: Any, result: SearchResult, others: Sequence[Throw]) -> None:
    """The paths, labelled by their release times, and the arm at the best release."""
    lines: dict[str, tuple[Any, Any]] = {}
    styles: dict[str, dict[str, Any]] = {}
    far = result.aim.unit == "m"
    top = 0.0
    for throw in (*others, result.best):
        is_best, milliseconds = throw is result.best, 1e3 * throw.times["ball"]
        x, _, z = throw.flight[1].T
        top = max(top, float(z.max()))
        axis.plot(x, z, **(BEST_LINE if is_best else OTHER_LINE))
        name = f"best: {milliseconds:.1f} ms" if is_best else f" {milliseconds:.0f} "
        label = int(np.argmax(z))  # the label is at the top of the path, or at the end of one that only falls
        if far and label < len(z) / 10:
            label = len(z) - 1
        lines[name] = np.append(x, x[:label:-1]), np.append(z, z[:label:-1])
        styles[name] = {"color": BEST, "fontweight": "bold"} if is_best else {"color": "0.35"}
    lines["arm"], styles["arm"] = tuple(result.best.joints[::-1, [0, 2]].T), {"color": ARM}
    axis.plot(*lines["arm"], color=ARM, linewidth=3, marker="o", markersize=4, zorder=4)
    axis.set(xlabel="x (m)", ylabel="height of the ball (m)")
    if far:
        axis.set_aspect("equal")
    else:
        axis.set_xlim(LANE)
    axis.set_ylim(-MARGIN * top, (1 + 3 * MARGIN) * top)
    ground, ends = "ground" if far else "lane", axis.get_xlim()
    lines[ground], styles[ground] = (ends[::-1], np.zeros(2)), {"color": GROUND}
    axis.plot(*lines[ground], color=GROUND, linewidth=1)
    axis.set_xlim(ends)
    axis.set_title("paths of the ball, by release time in ms; the arm at the best release", loc="left", fontsize=10)
    label_ends(figure, axis, lines, styles, size=8)


def _draw_speeds(axis: Any, result: SearchResult, others: Sequence[Throw]) -> None:
    for throw in (*others, result.best):
        _, positions, velocities = throw.flight
        axis.plot(positions[:, 0], velocities[:, 0], **(BEST_LINE if throw is result.best else OTHER_LINE))
    axis.set(xlabel="x (m)", ylabel="forward speed of the ball (m/s)")
    axis.set_ylim(bottom=0.0)


def _draw_aim(axis: Any, result: SearchResult, others: Sequence[Throw]) -> None:
    """The quantity aimed at over the elevation."""

    def points(throws: Sequence[Throw], **style: Any) -> None:
        elevations = [float(np.degrees(throw.elevation)) for throw in throws]
        axis.plot(elevations, [throw.end for throw in throws], linestyle="none", **style)

    points(others, marker="o", markersize=5, color=OTHERS)
    points([result.best], marker="*", markersize=15, color=BEST, zorder=4)
    above: dict[str, Any] = {"xytext": (0, 6), "textcoords": "offset points", "ha": "center"}
    for throw in others:
        at = np.degrees(throw.elevation), throw.end
        axis.annotate(f"{1e3 * throw.times['ball']:.0f}", at, fontsize=8, color="0.35", **above)
    axis.set_xlabel("elevation of the ball's velocity at the release (degrees)")
    axis.set_ylabel(f"{result.aim.what} ({result.aim.unit})")
    axis.set_ylim(bottom=0.0, top=result.best.end * 1.15)
    axis.set_title("by release time in ms", loc="left", fontsize=10)
