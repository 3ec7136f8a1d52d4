"""Running a case: our attempts and their verdicts."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from twolink.errors import AccuracyError, TwolinkError
from twolink.hard.case import Case, Motion, Probe, Refusals, Track
from twolink.hard.case_result import MET, MISSED, SAID, WRONG, Attempt, Curve, Result
from twolink.scenes import Scene
from twolink.simulation.scene_run import simulate
from twolink.simulation.trajectory import Trajectory

PATIENCE = 120.0  # seconds of an attempt; longer is a hang


class TooSlowError(Exception):
    """An attempt took longer than anybody wants to wait."""


def run_case(case: Case, *, peers: bool = False, patience: float = PATIENCE) -> Result:
    """Run a case at all its settings, and the peers that can do it."""
    if isinstance(case, Refusals):
        return Result(case, tuple(_probe(name, probe, patience) for name, probe in case.probes.items()))
    if not isinstance(case, Motion):
        raise TypeError(f"a {type(case).__name__} is no case")
    scene = case.load()
    ours = tuple(_attempt(case, scene, setting, patience) for setting in case.settings)
    if not peers:
        return Result(case, ours)
    from twolink.hard.run_peers import run_peers

    return Result(case, ours, tuple(run_peers(case, scene)))


def _attempt(case: Motion, scene: Scene, setting: Mapping[str, Any], patience: float) -> Attempt:
    start = time.perf_counter()

    def progress(_: float) -> None:
        if time.perf_counter() - start > patience:
            raise TooSlowError

    label, run, message = _label(setting), None, ""
    try:
        run = simulate(scene, case.duration, samples=case.samples, progress=progress, **setting)
        if run.interrupted:  # by Ctrl-C; the part of a run is no result
            raise KeyboardInterrupt
    except AccuracyError as error:
        run, message = error.run, str(error)
    except TwolinkError as error:
        message = str(error)
    except TooSlowError:
        return Attempt(label, MISSED, seconds=time.perf_counter() - start, message=f"given up after {patience:g} s")
    except Exception as error:  # an error without our name on it is what is looked for
        return Attempt(label, MISSED, seconds=time.perf_counter() - start, message=f"{type(error).__name__}: {error}")
    seconds = time.perf_counter() - start
    accuracy = float(setting["accuracy"])
    if run is None:
        return Attempt(label, SAID if accuracy <= case.may_refuse else MISSED, seconds=seconds, message=message)
    return _judged(case, scene, run, label, accuracy, seconds, message)


def _judged(
    case: Motion, scene: Scene, run: Trajectory, label: str, accuracy: float, seconds: float, message: str
) -> Attempt:
    truth, cost = case.truth, run.cost
    error = truth.error(scene.robot, Track(run.t, run.q, run.v))
    known = np.isfinite(error)
    largest = float(error[known].max())
    bar = None if run.error is None else float(run.error.max())
    honest = run.error is None or not truth.exact or bool((error[known] <= run.error[known] + truth.doubt).all())
    if not honest:
        verdict = WRONG
    elif message:  # refused; it is honest about how wrong the best of it is
        verdict = SAID if accuracy <= case.may_refuse else MISSED
    elif largest <= truth.bar(accuracy) + truth.doubt:
        verdict = MET
    else:
        verdict = SAID if bar is not None and bar > accuracy else WRONG
    return Attempt(
        label, verdict, largest, bar, seconds, cost.method if cost else "", cost.steps if cost else 0, message,
        run.trusted_until, curve=Curve(run.t, error, run.error),
    )  # fmt: skip


def _probe(name: str, probe: Probe, patience: float) -> Attempt:
    start = time.perf_counter()
    try:
        probe.call()
    except TwolinkError as error:
        right = probe.kind is not None and isinstance(error, probe.kind) and probe.says in str(error)
        verdict, message = SAID if right else MISSED, f"{type(error).__name__}: {error}"
    except Exception as error:
        verdict, message = MISSED, f"not one of ours: {type(error).__name__}: {error}"
    else:
        verdict, message = (MET, "") if probe.kind is None else (WRONG, "taken without a word")
    seconds = time.perf_counter() - start
    if seconds > patience:
        verdict, message = MISSED, f"took {seconds:.0f} s; {message}"
    return Attempt(name, verdict, seconds=seconds, message=message)


def _label(setting: Mapping[str, Any]) -> str:
    """Such as "1e-06" or "1e-12, quad"."""
    more = [f"{name} {value}" if name != "precision" else str(value) for name, value in setting.items()
            if name not in ("accuracy", "verify")]  # fmt: skip
    return ", ".join([f"{setting['accuracy']:.0e}", *more])
