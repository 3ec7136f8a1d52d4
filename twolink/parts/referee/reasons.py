"""Why a log is wrong: what is looked at, in which order, and what its local errors and constraints are."""

import dataclasses
import functools
import time
from collections.abc import Iterator

import numpy as np

from twolink.algorithms.mechanism import mechanism
from twolink.algorithms.motion import KinematicState
from twolink.algorithms.namespaces import Numbers
from twolink.effects.joint_switches import JointStops
from twolink.effects.loops import Loop
from twolink.errors import TwolinkError
from twolink.io.progress import Report
from twolink.parts.referee.causes import Cause, Look, is_clear, look_for, looks_at, named
from twolink.parts.referee.local_errors import intervals_of
from twolink.parts.referee.peer_replay import replays
from twolink.parts.referee.trajectory_log import Array, TrajectoryLog
from twolink.parts.referee.verdict import Verdict
from twolink.robots.log_columns import joint_order
from twolink.scenes import Scene
from twolink.simulation.scene_run import simulate
from twolink.simulation.time_limit import OutOfTime, TimeLimit
from twolink.simulation.trajectory import Trajectory

GLANCE = 1.0  # s of computing: for the local defects of a log that is not wrong


def explained(verdict: Verdict, scene: Scene, log: TrajectoryLog, run: Trajectory, offset: Array, units: str,
              seconds: float, progress: Report | None) -> Verdict:  # fmt: skip
    """The verdict with its local defects, and of a wrong log its causes, as far as the time goes."""
    if progress is not None:
        progress(0.0, 1.0, verdict.summary)
    few, wrong = None, verdict.answer == "wrong"
    off = verdict.excess > 0.0  # in SI units
    limit = TimeLimit(seconds if wrong else min(seconds, GLANCE), time.process_time, from_now=True)
    found = [Cause(units, 0.0)] if units and not off else []
    missed: tuple[str, ...] = ()
    if off:
        looks: list[Look] = [("a shift in time", lambda: _shifted(log, run, offset))]
        if verdict.beyond:  # not only its velocities are wrong
            looks += [("another start", lambda: _started(scene, log, offset, limit)),
                      ("the order of its joints", lambda: _reordered(scene, log, offset, limit)),
                      *replays(scene, log, run)]  # fmt: skip
        found, missed = look_for(looks, progress)
    try:
        intervals = intervals_of(scene, log, limit)
        few = None if intervals is None else intervals.known()
    except (OutOfTime, KeyboardInterrupt):
        missed = (*missed, "local defects, and causes that they show") if wrong else ()
    defect = None if few is None or not len(few.h) else float(np.abs(few.exact[:, scene.robot.nv :]).max())
    if off and few is not None and len(few.h) > 2 and not missed and not is_clear(found):
        more, missed = look_for(looks_at(few), progress)
        found += more
    if units and off:
        found = [dataclasses.replace(cause, what=f"{units}, and {cause.what}") for cause in found]
    causes, nearest = named(found)
    if units and not causes and nearest is None:
        nearest = Cause(units, 1.0)
    return dataclasses.replace(verdict, defect=defect, causes=causes, nearest=nearest, not_looked_at=missed)


def _started(scene: Scene, log: TrajectoryLog, offset: Array, limit: TimeLimit) -> Iterator[Cause]:
    """Another start: the solution from the log's own."""
    v = log.v[0] if log.has_velocities else scene.v
    if log.t[0] != 0 or np.abs([*offset[0], *(v - scene.v)]).max() <= 1e-9:
        return
    left = _left_from(scene, log.q, v, log.t, offset, limit)
    apart = f"q by {np.abs(offset[0]).max():.3g}, v by {np.abs(v - scene.v).max():.3g}"
    yield Cause(f"it starts elsewhere, {apart}", left, 1)


def _reordered(scene: Scene, log: TrajectoryLog, offset: Array, limit: TimeLimit) -> Iterator[Cause]:
    """The joints of the log in an order of other programs: the solution from its start, in that order."""
    robot = scene.robot
    ours = list(robot.joint_names)
    if not robot.nq == robot.nv == len(ours) or log.t[0] != 0:
        return
    orders = {"depth first in its file, as MuJoCo has them": joint_order(robot),
              "breadth first in its file, as PhysX has them": joint_order(robot, breadth=True),
              "by the alphabet": sorted(ours), "the other way round": ours[::-1]}  # fmt: skip
    tried = [ours]
    for words, order in orders.items():
        if order in tried:
            continue
        tried.append(order)
        places = [order.index(name) for name in ours]
        v = log.v[0, places] if log.has_velocities else scene.v
        left = _left_from(scene, log.q[:, places], v, log.t, offset, limit)
        yield Cause(f"its joints are in another order: {words}", left)


def _left_from(scene: Scene, q: Array, v: Array, t: Array, offset: Array, limit: TimeLimit) -> float:
    """The share of the offset that the solution from q[0] and v leaves of q (n, nq) at times t (n,).

    Infinite where there is no solution from there.
    """
    try:
        run = simulate(scene.with_start(q[0], v), float(t[-1]), t_eval=t, patience=limit.seconds)
    except OutOfTime:
        raise
    except TwolinkError:  # that start does not fit the scene
        return np.inf
    if len(run.t) < len(t):  # an event ends it
        return np.inf
    return float(np.linalg.norm(scene.robot.difference(run.q, q)) / np.linalg.norm(offset))


def _shifted(log: TrajectoryLog, run: Trajectory, offset: Array) -> Iterator[Cause]:
    """A delay in time, by Gauss and Newton's method on the solution; and velocities of another sample."""
    robot = run.robot
    plain = float(np.linalg.norm(log.v[1:-1] - run.v[1:-1]))
    for name, other in (("before", run.v[:-2]), ("after", run.v[2:])):
        if log.has_velocities and plain > 0:
            yield Cause(f"v is that of the sample {name}", float(np.linalg.norm(log.v[1:-1] - other)) / plain)
    delay, before = 0.0, float(np.linalg.norm(offset))
    apart, inside = offset, np.ones(len(log.t), dtype=bool)
    for _ in range(8):
        inside = (log.t - delay >= run.t[0]) & (log.t - delay <= run.end)
        if inside.sum() < 3 or run.solution is None or before == 0:
            return
        q, v = run.at(log.t[inside] - delay)
        apart = robot.difference(q, log.q[inside])
        delay -= float(np.vdot(apart, v) / max(np.vdot(v, v), 1e-300))
    if abs(delay) > 1e-9:
        words = f"it is {'late' if delay > 0 else 'early'} by {abs(delay):.4g} s"
        yield Cause(words, float(np.linalg.norm(apart) / np.linalg.norm(offset[inside])), 1)


def violations(scene: Scene, log: TrajectoryLog) -> dict[str, float]:
    """Largest openings of loops, and distances of joints beyond their stops, where there are any."""
    found = {}
    motion = functools.partial(KinematicState, scene.robot.model, mechanism(scene.robot.model))
    for i, effect in enumerate(scene.effects):
        if isinstance(effect, Loop):
            rows = effect.rows(motion(list(log.q.T), list(log.v.T), log.t, Numbers))
            found[f"effects[{i}] {type(effect).__name__}"] = max(float(np.abs(row).max()) for row in rows)
        if isinstance(effect, JointStops):
            for stop in effect.modes(scene.base):
                beyond = float((-stop.side * (log.q[:, stop.entry] - stop.position)).max())
                if beyond > 0:
                    found[f"stop of {stop.name}"] = max(beyond, found.get(f"stop of {stop.name}", 0.0))
    return found
