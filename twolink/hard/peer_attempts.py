"""Peers on a hard case: every peer that can do it, at its default setting and at a tight one."""

import time
from collections.abc import Iterator
from types import ModuleType

import numpy as np

from twolink.hard.case import SimulationCase
from twolink.hard.case_result import MET, SAID, UNABLE, WRONG, Attempt, Curve
from twolink.hard.peers import NAMES, peer_module
from twolink.hard.peers.task import PeerError, PeerTask, Setting, UnsupportedError, task_of
from twolink.hard.peers.time_limit import run_limited
from twolink.scenes import Scene

MAX_INTERVALS = 400  # between the times at which peers answer
WRONG_FROM = 0.1  # of the motion's size: the error from which a peer is called wrong, whatever its tolerance promises


def run_peers(case: SimulationCase, scene: Scene) -> Iterator[tuple[str, Attempt]]:
    """The name and the attempts of every peer of the case; a peer that is not installed is left out."""
    if not case.peers:
        return
    end = scene.duration if case.duration is None else case.duration
    intervals = min(MAX_INTERVALS, max(1, int(np.ceil(end * case.samples - 1e-9))))
    try:
        task = task_of(scene, np.linspace(0, end, intervals + 1))
    except UnsupportedError as error:
        yield "peers", Attempt("", UNABLE, message=str(error))
        return
    for name in case.peers:
        try:
            module = peer_module(name)
            settings = module.usual_settings(task)
        except ImportError:
            continue
        except UnsupportedError as error:
            yield NAMES[name], Attempt("", UNABLE, message=str(error))
            continue
        for setting in settings:
            yield NAMES[name], _attempt(case, task, module, setting)


def _attempt(case: SimulationCase, task: PeerTask, module: ModuleType, setting: Setting) -> Attempt:
    start = time.perf_counter()
    try:
        run = module.prepare(task, setting)
        start = time.perf_counter()
        answer, warning = run_limited(run)
    except (PeerError, UnsupportedError) as failure:
        verdict = SAID if isinstance(failure, PeerError) else UNABLE
        return Attempt(str(setting), verdict, seconds=time.perf_counter() - start, message=str(failure),
                       default=setting.default)  # fmt: skip
    seconds = time.perf_counter() - start
    error = case.error(task.robot, answer.track)
    error[~np.isfinite(answer.track.q).all(axis=1)] = np.inf
    largest = float(np.nanmax(error))
    limit = WRONG_FROM * case.size if case.bounded else max(0.01, 100 * case.limit(1e-3))
    verdict = MET if largest <= limit else SAID if warning else WRONG
    return Attempt(str(setting), verdict, largest, None, seconds, message=warning, default=setting.default,
                   curve=Curve(task.times, error))  # fmt: skip
