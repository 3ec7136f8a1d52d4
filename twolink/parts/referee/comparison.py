"""Another simulator's log of a scene, made at its default settings, judged, and its cost beside ours."""

from __future__ import annotations

import contextlib
import importlib.util
import time
from collections.abc import Iterator
from dataclasses import dataclass
from types import ModuleType
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from twolink.errors import SceneError, require_extra, require_known
from twolink.hard.peers import NAMES, peer_module
from twolink.hard.peers.task import PeerError, UnsupportedError, task_of
from twolink.io.progress import Report
from twolink.parts.referee.referee import SECONDS, best_run, verdict_of
from twolink.parts.referee.trajectory_log import TrajectoryLog
from twolink.parts.referee.verdict import Verdict
from twolink.scenes import Scene
from twolink.show.figure import Plotted
from twolink.simulation.sampling import duration_for
from twolink.simulation.text import BaseResult
from twolink.simulation.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

INTERVAL = 0.002  # s, about, between the samples of a log: MuJoCo's default step
LIMIT = 1e-3  # rad or m: how near is told first
TOLERANCE, ACCURACY = 1e-6, 1e-7  # rad or m: a distance that does not count; of the run beside the log
_EXTRAS = {"mujoco": "mjcf", "drake": "peers", "scipy": ""}


@dataclass(frozen=True, repr=False)
class Comparison(Plotted, BaseResult):
    """The motion of a scene by another simulator, with the verdict on it.

    Attributes
    ----------
    peer, setting : str
        The simulator with its version, and how it was run.
    log : Trajectory
        Its motion, without an error bar.
    verdict : Verdict
        What that is worth, see `judge`.
    seconds : float
        What its run took, without building its model.
    ours : Trajectory
        The scene's run, with its cost.
    """

    peer: str
    setting: str
    log: Trajectory
    verdict: Verdict
    seconds: float
    ours: Trajectory

    def _figure(self) -> Figure:
        figure = self.verdict.plot()
        figure.suptitle(f"{self.peer}, {self.setting}", fontsize="medium")
        return figure

    def __str__(self) -> str:
        since, cost = self.verdict.beyond.get(f"{LIMIT:g}"), self.ours.cost
        whole = f"{self.peer} ({self.setting}) is within {LIMIT:g} {self.verdict.unit} "
        lines = [whole + ("throughout" if since is None else f"until {since:.4g} s"), str(self.verdict)]
        lines.append(f"  cost: {self.peer.partition(' ')[0]} {self.seconds:.3g} s, off by at most "
                     f"{self.verdict.distance.max():.2g} {self.verdict.unit}")  # fmt: skip
        if cost is not None:
            prepared = f", and {cost.compile_seconds:.3g} s of preparing" if cost.compile_seconds else ""
            seconds = cost.seconds + cost.verify_seconds
            lines.append(f"  cost: twolink {seconds:.3g} s, {self.ours.error_text}{prepared}")
        return "\n".join(lines)

    __repr__ = __str__


def compare(scene: Scene, peer: str = "mujoco", duration: float | None = None, *, seconds: float = SECONDS,
            progress: Report | None = None) -> Comparison:  # fmt: skip
    """Let another simulator run a scene at its default setting, and judge what it logs.

    Parameters
    ----------
    scene : Scene
        Dry friction, stops, loops and contacts are MuJoCo's own, as soft as it makes them by default. Of a robot from
        an MJCF, MuJoCo takes the file's own <option>: its time step, integrator, solver and flags.
    peer : {"mujoco", "drake", "scipy"}
    duration : float, optional
        s; the scene's own by default.
    seconds : float
        For how long causes are looked for, s of computing, as in `judge`.
    progress : callable, optional
        As in `judge`.

    Returns
    -------
    Comparison

    Raises
    ------
    SceneError
        The peer does not simulate an effect or a joint of the scene, which is named, or it fails (code "no-peer").
    MissingExtraError
        It is not installed.
    """
    end = duration_for(scene, duration)
    step = scene.base.visuals.laws.options.get("timestep", INTERVAL)
    interval = step * max(1, round(INTERVAL / step))
    times = interval * np.arange(max(3, round(end / interval)) + 1)
    found = peer_log(scene, peer, times)
    ours = best_run(scene, times, ACCURACY)
    log = TrajectoryLog(found.log.t, found.log.q, found.log.v)
    verdict = verdict_of(scene, log, ours, TOLERANCE, accuracy=ACCURACY, seconds=seconds, progress=progress)
    return Comparison(found.peer, found.setting, found.log, verdict, found.seconds, ours)


class PeerLog(NamedTuple):
    """The first fields of a `Comparison`."""

    peer: str
    setting: str
    log: Trajectory
    seconds: float


def installed_peer(peer: str) -> ModuleType:
    """The module of a peer by its name. Raises SceneError, or MissingExtraError where it is not installed."""
    require_known(peer, NAMES, SceneError, argument="peer")
    library = {"drake": "pydrake"}.get(peer, peer)
    if importlib.util.find_spec(library) is None:
        require_extra(library, _EXTRAS[peer])
    return peer_module(peer)


@contextlib.contextmanager
def refusing(scene: Scene, peer: str) -> Iterator[None]:
    """Raise SceneError (code "no-peer") where the peer does not simulate the scene, or fails."""
    try:
        yield
    except (UnsupportedError, PeerError) as error:
        raise SceneError(f"{NAMES[peer]}: {error}", where=scene.title or scene.robot.name, code="no-peer",
                         remedy="leave that out, or judge a log that you have made: tl.judge") from None  # fmt: skip


def peer_log(scene: Scene, peer: str, times: np.ndarray) -> PeerLog:
    """Let another simulator run a scene at its default setting. times (n,): at equal distances from 0, s.

    Raises as `compare`.
    """
    module = installed_peer(peer)
    with refusing(scene, peer):
        task = task_of(scene, times)
        setting = next(setting for setting in module.usual_settings(task) if setting.default)
        run = module.prepare(task, setting)
        begun = time.perf_counter()
        track = run().track
    seconds = time.perf_counter() - begun
    log = Trajectory(scene.robot, track.t, track.q, track.v, None, None, title=scene.title)
    return PeerLog(f"{NAMES[peer]} {module.VERSION}", str(setting), log, seconds)
