"""judge: how far a trajectory of any simulator is from the solution of a scene, since when, and why."""

import dataclasses
import math
import os
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

from twolink.dynamics import Robot
from twolink.dynamics.arguments import Positive, positive
from twolink.errors import AccuracyError, SceneError, TwolinkError, require_known
from twolink.io.progress import Report
from twolink.parts.referee.reasons import explained, violations
from twolink.parts.referee.trajectory_log import BOTH, Array, Given, TrajectoryLog, in_radians, in_si, read_log
from twolink.parts.referee.verdict import Answer, Verdict, Verdicts
from twolink.robots.joint_layout import unit_of
from twolink.scenes import Scene, bundled_scenes, load_scene
from twolink.scenes.urdf_scene import scene_of
from twolink.simulation.scene_run import simulate
from twolink.simulation.trajectory import Trajectory

DISTANCES = (1e-6, 1e-4, 1e-3, 1e-2, 0.1)  # rad or m
VELOCITY = 100.0  # 1/s: a velocity may be off by so many times the tolerance
ESTIMATED, SPREAD = 3.0, 3.0  # a bar that is an estimate, and one of velocities, count so many times
COARSER = 1e4  # times the accuracy: of the run beside the solution that shows how errors of v go with those of q
COARSE = 1e-2  # rad or m: where the digits of a log's start move the solution by more, it is not known
SECONDS = 10.0  # of computing, for causes
Pair = tuple[Array, Array]


def judge(
    scene: Scene | Robot | str | os.PathLike[str],
    trajectory: Given,
    *,
    start: Literal["scene", "log"] | None = None,
    tolerance: Positive = 1e-6,
    accuracy: Positive = 1e-9,
    seconds: Positive = SECONDS,
    progress: Report | None = None,
) -> Verdict:
    """Hold a trajectory of any simulator against the solution of a scene.

    Parameters
    ----------
    scene : Scene, Robot, str or path
        What was to be simulated: a scene, also by its name or .toml file; or a robot, its name or file: with all that
        the file says, as `scene_of` makes it.
    trajectory : Trajectory, mapping, sequence, str or path
        t (n,), q (n, nq), v (n, nv), by name or in this order; or a .csv, .csv.gz, .npz or .parquet file with columns
        t, and q.JOINT and v.JOINT or q0, q1, ..., v0, ...; or a bag of ROS 2 (.mcap, .db3 or a folder) with joint
        states. A continuous joint may have its angle in place of (cos, sin). Names of other programs, such as MuJoCo's
        qpos and qvel, are taken for these; the verdict has what was guessed. Without v, only q is judged.
    start : {"scene", "log"}, optional
        Whether the solution starts from the scene's state, or from the log's first sample; by default that of a scene,
        and of a robot the log's. Times count from there then.
    tolerance : float
        A distance that does not count, rad or m.
    accuracy : float
        Of the solution; where it cannot be kept, the best one is taken.
    seconds : float
        For how long causes of a wrong log are looked for, s of computing, which other work on the machine does not
        prolong; the verdict says what was not looked at.
    progress : callable, optional
        Called now and then with what is done, the total and a label, which says the verdict before its causes.

    Returns
    -------
    Verdict

    Raises
    ------
    SceneError
        The trajectory is none of this robot (code "not-a-trajectory").
    QueryError
        It has one joint's columns twice, by name and by number (code "column-twice").
    AccuracyError
        The scene cannot be solved.
    """
    asked, bare = scene_from(scene)
    start = start or ("log" if bare else "scene")
    require_known(start, ("scene", "log"), SceneError, argument="start")
    tolerance = positive(tolerance, "tolerance", SceneError, "such as 1e-6")
    given = read_log(trajectory, asked.robot)
    log, units = in_si(given, asked.robot, asked.q)
    spread: Pair = (np.zeros(len(log.t)), np.zeros(len(log.t)))
    if start == "log":
        asked, log = _from_log(asked, log)
        spread = _spread(asked, log)
    run = best_run(asked, log.t, accuracy)
    if not units:
        log, units = _in_radians(log, run)
    verdict = verdict_of(asked, log, run, tolerance, units=units, spread=spread, accuracy=accuracy,
                         seconds=positive(seconds, "seconds", SceneError, "such as 10"), progress=progress)  # fmt: skip
    return dataclasses.replace(verdict, guessed=given.guessed)


def judge_many(
    scene: Scene | Robot | str | os.PathLike[str], trajectories: Mapping[str, Given], **options: Any
) -> Verdicts:
    """Hold trajectories of several simulators against the solution of one scene: which one is nearer, what all miss.

    Parameters
    ----------
    scene : Scene, Robot, str or path
        As of `judge`.
    trajectories : mapping of str to trajectory
        Each as of `judge`, by a name.
    **options
        As of `judge`.

    Returns
    -------
    Verdicts

    Raises
    ------
    SceneError, QueryError, AccuracyError
        As of `judge`.
    """
    if not (isinstance(trajectories, Mapping) and trajectories):
        raise SceneError(f"expected trajectories by name, got {trajectories!r:.60}", argument="trajectories",
                         remedy='such as {"MuJoCo": "log.csv"}')  # fmt: skip
    asked, bare = scene_from(scene)
    options["start"] = options.get("start") or ("log" if bare else "scene")
    return Verdicts({name: judge(asked, given, **options) for name, given in trajectories.items()})


def _in_radians(log: TrajectoryLog, run: Trajectory) -> tuple[TrajectoryLog, str]:
    """The trajectory in radians, where it follows the solution in degrees from a start that is 0 in both."""
    if any(joint.normalized is not None for joint in run.robot.joints):
        return log, ""
    count, turned = len(run.t), in_radians(log, run.robot)
    apart, converted = (np.linalg.norm(one.q[:count] - run.q) for one in (log, turned))
    return (turned, BOTH) if converted < 1e-2 * apart and apart > 1e-3 * math.sqrt(count) else (log, "")


def scene_from(given: Scene | Robot | str | os.PathLike[str]) -> tuple[Scene, bool]:
    """The scene, and whether a robot was given."""
    if isinstance(given, Scene):
        return given, False
    if not isinstance(given, Robot | str | os.PathLike):
        raise SceneError(f"expected a scene, a robot, a name or a file, got {type(given).__name__}", argument="scene",
                         remedy="such as tl.load_scene(name or file)")  # fmt: skip
    name = "" if isinstance(given, Robot) else os.fspath(given)
    if name.endswith(".toml") or name in bundled_scenes():
        return load_scene(name), False
    return scene_of(given), True


def _from_log(scene: Scene, log: TrajectoryLog) -> tuple[Scene, TrajectoryLog]:
    """The scene from the log's first sample on, which is at 0 then. Raises SceneError without velocities."""
    if not log.has_velocities:
        raise SceneError("the log has no velocities to start from", argument="start", code="not-a-trajectory",
                         remedy='give v, or start="scene"')  # fmt: skip
    made = scene.with_start(log.q[0], log.v[0])
    return made, TrajectoryLog(log.t - log.t[0], log.q, log.v)


def _spread(scene: Scene, log: TrajectoryLog) -> Pair:
    """Displacements of q and v at every sample by the digits of the log's first one: the sum over its entries."""
    sizes, nv = [digits[0] for digits in log.digits()], scene.robot.nv
    total = np.zeros((2, len(log.t)))
    if not any(sizes):
        return total[0], total[1]

    def run(q: Array, v: Array) -> Trajectory:
        return simulate(
            scene.with_start(q, v), float(log.t[-1]), accuracy=1e-2 * max(sizes), verify=False, t_eval=log.t
        )

    plain = run(scene.q, scene.v)
    for k, size in enumerate(np.repeat(sizes, nv)):
        step = size * np.eye(nv)[k % nv]
        q = scene.robot.integrate(scene.q, step) if k < nv else scene.q
        other = run(q, scene.v + (step if k >= nv else 0.0))
        both = np.isin(log.t, plain.t) & np.isin(log.t, other.t)  # an event may end one of them
        rows, total[:, ~both] = np.flatnonzero(both), np.inf
        total[0, rows] += np.abs(scene.robot.difference(plain.q[rows], other.q[rows])).max(axis=1)
        total[1, rows] += np.abs(plain.v[rows] - other.v[rows]).max(axis=1)
    return SPREAD * total[0], SPREAD * total[1]


def best_run(scene: Scene, t: Array, accuracy: float) -> Trajectory:
    """The solution at the samples, as accurate as can be kept; of a motion that an event ends, at those before it."""
    try:
        run: Trajectory = simulate(scene, float(t[-1]), accuracy=accuracy, t_eval=t)
    except AccuracyError as error:
        if error.run is None:
            raise
        run = error.run
    reached = int(np.searchsorted(t, run.t[-1], side="right"))
    if reached == len(run.t):
        return run
    if not t[:reached].any():
        raise SceneError(f"the scene ends at {run.t[-1]:.4g} s, before the second sample", argument="trajectory",
                         remedy="give samples before that", code="not-a-trajectory")  # fmt: skip
    return best_run(scene, t[:reached], accuracy)


def verdict_of(scene: Scene, log: TrajectoryLog, run: Trajectory, tolerance: float, *, units: str = "",
               spread: Pair | None = None, accuracy: float = 1e-9, seconds: float = SECONDS,
               progress: Report | None = None) -> Verdict:  # fmt: skip
    """The verdict on a log beside a run at its samples.

    units: which ones it had, if not SI. spread: how far the digits of the start move q and v, (n,) each.
    """
    whole, log = len(log.t), log.part(np.arange(len(log.t)) < len(run.t))
    bar = np.full(len(run.t), np.inf) if run.error is None else run.error * (ESTIMATED if run.estimated else 1.0)
    moved = (0.0, 0.0) if spread is None else (spread[0][: len(bar)], spread[1][: len(bar)])
    digits = [own + more for own, more in zip(log.digits(), moved, strict=True)]
    offset = scene.robot.difference(run.q, log.q)
    distance = np.abs(offset).max(axis=1)
    excess, fine = distance - bar - digits[0], (distance + bar <= tolerance + digits[0]) & (moved[0] <= COARSE)
    beyond = {
        f"{limit:g}": float(run.t[np.argmax(excess > limit)])
        for limit in (*DISTANCES, tolerance)
        if excess.max() > limit
    }
    velocity = energy = None
    most = float(excess.max()) if excess.max() > tolerance else 0.0
    if log.has_velocities:
        velocity, most_v, fine_v = _of_velocities(scene, log, run, bar, digits[1], tolerance, accuracy)
        fine, most = fine & fine_v, most or most_v
        theirs = dataclasses.replace(run, q=log.q, v=log.v, recorded_energy=None).energy  # with what the run held then
        energy = float(np.abs(theirs - run.energy).max())
    wrong = bool(most or units)
    unknown = not wrong and (not fine.all() or len(run.t) < whole)
    since = float(run.t[-1] if fine.all() else run.t[np.argmin(fine)]) if unknown else None
    answer: Answer = "wrong" if wrong else "not known" if unknown else "right"
    verdict = Verdict(answer, since, most, run.t, distance, bar, float(digits[0].max()), beyond, velocity, None, energy,
                      violations(scene, log), (), None, (), scene.title or scene.robot.name,
                      unit=unit_of(scene.robot.joints), bound=run.bound)  # fmt: skip
    return explained(verdict, scene, log, run, offset, units, seconds, progress)


def _of_velocities(
    scene: Scene, log: TrajectoryLog, run: Trajectory, bar: Array, digits: Array, tolerance: float, accuracy: float
) -> tuple[float, float, Array]:
    """The largest distance of v, by how much it is wrong at least, and where it is fine (n,).

    Not counted where an event is as near as the bar of q reaches, for v may jump there. How large an error of v belongs
    to one of q is seen between the solution and a coarser one.
    """
    allowed = VELOCITY * tolerance
    apart = np.abs(log.v - run.v).max(axis=1) - digits
    near = np.zeros(len(run.t), dtype=bool)
    fastest = np.maximum(np.abs(run.v).max(axis=1), 1e-3)
    for event in run.events:
        near |= np.abs(run.t - event.t) <= 1e-9 + (bar + tolerance) / fastest
    fine = (apart <= allowed) | near
    largest = float(np.abs(log.v - run.v).max())
    if fine.all():
        return largest, 0.0, fine
    try:
        other = simulate(scene, float(run.t[-1]), accuracy=COARSER * accuracy, verify=False, t_eval=run.t)
    except TwolinkError:  # the solution was hard to get, and a coarser one is none
        return largest, 0.0, fine
    if len(other.t) < len(run.t):  # an event ends it before
        return largest, 0.0, fine
    q, v = (np.maximum.accumulate(np.abs(x).max(axis=1))
            for x in (scene.robot.difference(run.q, other.q), run.v - other.v))  # fmt: skip
    ratio = np.divide(v, q, out=np.zeros_like(v), where=q > 0)
    excess = np.where(near, 0.0, apart - SPREAD * np.maximum.accumulate(bar) * np.maximum(ratio, 1.0))
    return largest, float(excess.max()) if excess.max() > allowed else 0.0, fine
