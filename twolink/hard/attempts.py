"""Running a case: our attempts and their verdicts, and those of every peer that can do it, at its default setting and
at a tight one.
"""

import contextlib
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import cache, partial
from types import ModuleType
from typing import Any

import numpy as np

from twolink.errors import AccuracyError, TwolinkError
from twolink.hard.case import (
    INTERRUPTED,
    MET,
    MISSED,
    SAID,
    UNABLE,
    WRONG,
    Attempt,
    Case,
    CaseResult,
    ErrorCheck,
    ErrorCurve,
    RefusalCase,
    SimulationCase,
    StateHistory,
)
from twolink.hard.peers import NAMES, peer_module
from twolink.hard.peers.task import PeerError, PeerTask, Setting, UnsupportedError, run_limited, task_of
from twolink.scenes import Scene
from twolink.simulation.scene_run import simulate
from twolink.simulation.time_limit import OutOfTime, TimeLimit
from twolink.simulation.trajectory import Trajectory

MAX_INTERVALS = 400  # between the times at which peers answer
WRONG_FROM = 0.1  # of the motion's size: the error from which a peer is called wrong, whatever its tolerance promises
PATIENCE = 120.0  # seconds of computing for an attempt; more counts as a hang


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
            task.require(module.SIMULATES - module.SOFTENS)
            settings = module.usual_settings(task)
        except ImportError:
            continue
        except UnsupportedError as error:
            yield NAMES[name], Attempt("", UNABLE, message=str(error))
            continue
        for setting in settings:
            yield NAMES[name], _peer_attempt(case, task, module, setting)


def _peer_attempt(case: SimulationCase, task: PeerTask, module: ModuleType, setting: Setting) -> Attempt:
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
                   curve=ErrorCurve(task.times, error))  # fmt: skip


def run_case(case: Case, *, peers: bool = False, patience: float = PATIENCE) -> CaseResult:
    """Run a case at all its settings, and on request the peers that can do it.

    Parameters
    ----------
    case : Case
        The case.
    peers : bool
        Whether SciPy, MuJoCo and Drake run it too, where they are installed.
    patience : float
        Seconds of computing (of all threads) after which an attempt is given up.

    Returns
    -------
    CaseResult
        All attempts with their verdicts. After Ctrl-C those so far; the last one is interrupted and not judged.
    """
    ours: list[Attempt] = []
    others: list[tuple[str, Attempt]] = []
    with contextlib.suppress(KeyboardInterrupt):
        for label, call in _calls(case, patience):
            ours.append(Attempt(label, INTERRUPTED))  # until it is done
            ours[-1] = call()
        if peers and isinstance(case, SimulationCase):
            others.append(("peers", Attempt("", INTERRUPTED)))
            for attempt in run_peers(case, case.load()):
                others.insert(-1, attempt)
            others.pop()
    return CaseResult(case, tuple(ours), tuple(others))


def _calls(case: Case, patience: float) -> list[tuple[str, Callable[[], Attempt]]]:
    """The attempts of a case: the setting in words, and the call that makes one."""
    if isinstance(case, RefusalCase):
        return [(name, partial(_checked, name, check, patience)) for name, check in case.checks.items()]
    if not isinstance(case, SimulationCase):
        raise TypeError(f"a {type(case).__name__} is not a case")
    scene = cache(case.load)
    return [(_label(setting), partial(_attempt, case, scene, setting, patience)) for setting in case.settings]


def _attempt(case: SimulationCase, load: Callable[[], Scene], setting: Mapping[str, Any], patience: float) -> Attempt:
    """One run of ours. An exception that is not a TwolinkError is a defect, and counts as missed."""
    scene = load()
    start = time.perf_counter()
    label, accuracy = _label(setting), float(setting["accuracy"])
    run, message, verdict = None, "", MISSED
    try:
        limit = TimeLimit(patience, time.process_time)
        run = simulate(scene, case.duration, samples_per_second=case.samples, progress=limit, **setting)
    except OutOfTime as late:
        message = f"given up after {late.data['seconds']:g} s of computing, at {late.where}"
    except TwolinkError as error:
        run, message = error.run if isinstance(error, AccuracyError) else None, str(error)
        verdict = SAID if accuracy <= case.may_refuse else MISSED
    except Exception as error:
        message = f"{type(error).__name__}: {error}"
    seconds = time.perf_counter() - start
    if run is None:
        return Attempt(label, verdict, seconds=seconds, message=message)
    if run.interrupted:
        raise KeyboardInterrupt
    return _judged(case, scene, run, accuracy, Attempt(label, verdict, seconds=seconds, message=message))


def _judged(case: SimulationCase, scene: Scene, run: Trajectory, accuracy: float, attempt: Attempt) -> Attempt:
    """The attempt with the true error of its run. Without a message it has no verdict yet; else it was refused."""
    error = case.error(scene.robot, StateHistory(run.t, run.q, run.v))
    available = np.isfinite(error)
    largest = float(error[available].max())
    bar = None if run.error is None else float(run.error.max())
    beyond_bar = (error - run.error)[available].max() if case.bounded and run.error is not None else -np.inf
    verdict, message, limit = attempt.verdict, attempt.message, case.limit(accuracy)
    if beyond_bar > case.uncertainty:
        verdict = WRONG
    elif not message and largest <= limit + case.uncertainty:
        above = "its error bar" if beyond_bar > 0 else "its limit" if largest > limit else ""
        verdict = MET
        message = f"above {above} by less than the truth is uncertain, {case.uncertainty:.0e}" if above else ""
    elif not message:
        verdict = SAID if bar is not None and bar > accuracy else WRONG
    return replace(attempt, verdict=verdict, error=largest, bar=bar, method=run.cost.method if run.cost else "",
                   steps=run.cost.steps if run.cost else 0, message=message, trusted_until=run.trusted_until,
                   curve=ErrorCurve(run.t, error, run.error))  # fmt: skip


def _checked(name: str, check: ErrorCheck, patience: float) -> Attempt:
    """One call that must be refused, or must return."""
    start, computed = time.perf_counter(), time.process_time()
    try:
        outcome = check.call()
    except TwolinkError as error:
        right = check.kind is not None and isinstance(error, check.kind) and check.part in str(error)
        verdict, message = SAID if right else MISSED, f"{type(error).__name__}: {error}"
    except Exception as error:
        verdict, message = MISSED, f"not a TwolinkError: {type(error).__name__}: {error}"
    else:
        if getattr(outcome, "interrupted", False):  # a solver takes Ctrl-C as the end of its run
            raise KeyboardInterrupt
        verdict, message = (MET, "") if check.kind is None else (WRONG, "accepted without an error")
    seconds, computed = time.perf_counter() - start, time.process_time() - computed
    if computed > patience:
        verdict, message = MISSED, f"took {computed:.0f} s of computing; {message}"
    return Attempt(name, verdict, seconds=seconds, message=message)


def _label(setting: Mapping[str, Any]) -> str:
    """Such as "1e-06" or "1e-12, quad"."""
    more = [f"{name} {value}" if name != "precision" else str(value) for name, value in setting.items()
            if name not in ("accuracy", "verify")]  # fmt: skip
    return ", ".join([f"{setting['accuracy']:.0e}", *more])
