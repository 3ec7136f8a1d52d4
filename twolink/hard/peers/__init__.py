"""Peers on the same cases: SciPy around pin.aba, MuJoCo, Drake; as they come, and set as tightly as they go."""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable, Iterator

import numpy as np

from twolink.hard.case import NAMES, Motion, Track
from twolink.hard.case_result import MET, SAID, UNABLE, WRONG, Attempt, Curve
from twolink.hard.peers.limited import limited
from twolink.hard.peers.problem import CannotError, Problem, SaidError, Way
from twolink.scenes import Scene

MODULES = {"scipy": "scipy_peer", "mujoco": "mujoco_peer", "drake": "drake_peer"}
FAIR = 0.1  # of the motion's size: a peer is called wrong only above it, whatever its tolerance promises


def run_peers(case: Motion, scene: Scene) -> Iterator[tuple[str, Attempt]]:
    """Every peer that can do the case, at its own settings; what is not installed is left out."""
    if not case.peers:
        return
    try:
        problem = Problem.of(case, scene)
    except CannotError as error:
        yield "peers", Attempt("", UNABLE, message=str(error))
        return
    for name in case.peers:
        try:
            module = importlib.import_module(f"twolink.hard.peers.{MODULES[name]}")
        except ImportError:
            continue
        try:
            ways: list[Way] = list(module.ways(problem))
        except CannotError as error:
            yield NAMES[name], Attempt("", UNABLE, message=str(error))
            continue
        except SaidError as error:
            yield NAMES[name], Attempt("building the model", SAID, message=str(error))
            continue
        for way in ways:
            yield NAMES[name], _attempt(case, problem, way.setting, way.run)


def _attempt(case: Motion, problem: Problem, setting: str, run: Callable[[], Track]) -> Attempt:
    start = time.perf_counter()
    try:
        track, said = limited(run)
    except SaidError as error:
        return Attempt(setting, SAID, seconds=time.perf_counter() - start, message=str(error)[:300])
    except CannotError as error:
        return Attempt(setting, UNABLE, seconds=time.perf_counter() - start, message=str(error)[:300])
    seconds = time.perf_counter() - start
    errors = np.asarray(case.truth.error(problem.scene.robot, track))
    errors[~np.isfinite(track.q).all(axis=1)] = np.inf
    known = ~np.isnan(errors)
    largest = float(errors[known].max())
    limit = FAIR * case.size if case.truth.exact else max(0.01, 100 * case.truth.bar(1e-3))
    verdict = SAID if said and largest > limit else WRONG if largest > limit else MET
    return Attempt(setting, verdict, largest, None, seconds, message=said, curve=Curve(track.t, errors))
