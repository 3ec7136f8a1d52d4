"""MuJoCo's own laws as causes: its run of the same scene beside a log.

Contacts, dry friction, stops, couplings and loops are soft in MuJoCo (its documentation, Computation, "Soft
constraints"). A log of such a run is explained by no law of ours; it is by the run itself.
"""

import functools
import importlib.util
from collections.abc import Iterator

import numpy as np

from twolink.hard.peers import peer_module
from twolink.hard.peers.task import PeerError, PeerTask, Setting, UnsupportedError, task_of
from twolink.parts.referee.causes import CLEAR, SUBSTEPS, Cause, Look
from twolink.parts.referee.trajectory_log import TrajectoryLog
from twolink.scenes import Scene
from twolink.simulation.trajectory import Trajectory

SOFT = ("contacts", "friction", "stops", "couplings", "loops")
METHODS = ("Euler", "implicitfast", "RK4")
FINER = 20  # times smaller steps, which show whether the length of the step is what matters
OURS = 0.1  # of the distance: where the finer steps are as near to the solution, the step was too long


def replays(scene: Scene, log: TrajectoryLog, run: Trajectory) -> list[Look]:
    """Searches for MuJoCo's motion where a log may be it: from the scene's start, equally spaced, with soft laws."""
    gaps = np.diff(log.t)
    if log.t[0] != 0 or np.ptp(gaps) > 1e-6 * gaps[0] or importlib.util.find_spec("mujoco") is None:
        return []
    try:
        task = task_of(scene, np.linspace(0.0, log.t[-1], len(log.t)))
    except UnsupportedError:
        return []
    soft = [name for name in SOFT if name in task.needs]
    words = f"MuJoCo's soft {' and '.join(soft)}"
    return [(words, functools.partial(_replayed, task, log, run, words))] if soft else []


def _replayed(task: PeerTask, log: TrajectoryLog, run: Trajectory, words: str) -> Iterator[Cause]:
    """MuJoCo's run by its own options, and by steps of which the samples are multiples; the best of each way."""
    module = peer_module("mujoco")
    usual = module.usual_settings(task)[0]
    others = [Setting(method, "", step=task.interval / n) for n in SUBSTEPS for method in METHODS]
    size = np.linalg.norm(task.robot.difference(run.q, log.q))

    def left(setting: Setting, q: np.ndarray) -> float:
        try:
            track = module.prepare(task, setting)().track
        except (PeerError, UnsupportedError):
            return np.inf
        return float(np.linalg.norm(task.robot.difference(track.q[: len(q)], q)) / size)

    best, setting = np.inf, usual
    for one in (usual, *others):
        share = left(one, log.q)
        if share < best:
            best, setting = share, one
        if best < CLEAR:
            break
    how = f"{setting.method} with steps of {1e3 * setting.step:.4g} ms"
    finer = left(Setting(setting.method, "", step=setting.step / FINER), run.q)
    yield Cause(f"MuJoCo's {how}" if finer < OURS else f"{words} ({how})", best)
