"""accuracy_study: every method at every setting, against a reference, kept for method="auto"."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from twolink.accuracy.result import Row, Study, with_front
from twolink.accuracy.settings import Measuring, climb, count
from twolink.accuracy.truth import BETTER, Truth, better_truth, first_truth
from twolink.dynamics.arguments import positive
from twolink.errors import AccuracyError, SceneError
from twolink.integrate import calibration
from twolink.integrate.methods import METHODS, Method, method_named
from twolink.integrate.scene_equations import equations_of
from twolink.integrate.state import Array
from twolink.scenes import Scene
from twolink.scenes.scene import duration_of

MAX_SAMPLES = 200_000  # each row keeps its own until the reference is settled
StudyProgress = Callable[[int, int, str], None]


def accuracy_study(
    scene: Scene,
    duration: float | None = None,
    *,
    methods: Sequence[str] | None = None,
    tolerances: Sequence[float] | None = None,
    repeats: int = 7,
    samples: float = 50.0,
    budget: float = 1.0,
    progress: StudyProgress | None = None,
) -> Study:
    """Measure what accuracy costs on a scene: the error and the seconds of each method at several settings.

    methods: names of `twolink methods`; all that run here when left out. tolerances: of adaptive methods, and what the
    steps of the others aim at; a ladder from rough to rounding when left out. repeats: timed runs after the first,
    fewer of slow ones; the row has their median. samples: samples a second, at which errors are taken, and which the
    runs must deliver. budget: seconds a run may take; a method's ladder ends there. progress: called with entries
    done, entries in all, and the one that comes.

    Errors are max |difference(q, q_reference)| over samples, rad or m; study.reference says what the reference is, and
    its own error. What gave no row is in study.failures. Ctrl-C keeps what is done, and study.interrupted tells.
    A complete study of all methods is remembered, so that simulate's method="auto" chooses by it.

    Raises SceneError and AccuracyError for arguments and for scenes whose motion cannot be solved.
    """
    if not isinstance(scene, Scene):
        raise SceneError(f"expected a Scene, got {type(scene).__name__}", where="scene", remedy="tl.load_scene(...)")
    began = time.perf_counter()
    chosen, wanted = _methods(methods), _tolerances(tolerances)
    times = _times(scene.duration if duration is None else duration_of(duration), samples)
    equations = equations_of(scene)
    if equations.space.nv == 0:
        raise SceneError("nothing moves", where="robot", remedy="a robot with joints that are not locked")
    tell = progress or _silent
    limit = positive(budget, "budget", AccuracyError, "such as 1 second")
    repeats = _repeats(repeats)
    total = sum(count(method, wanted) for method in chosen) + repeats
    tell(0, total, "the reference")
    measuring = Measuring(equations, times, first_truth(equations, times), repeats, limit)
    interrupted = False
    try:
        _climb_all(measuring, chosen, wanted, tell, total)
        tell(total - repeats, total, "a reference of more digits")
        _improve_reference(measuring)
        for number in range(2, repeats + 1):
            tell(total - repeats + number - 1, total, f"all once more, {number} of {repeats}")
            measuring.time_again(number)
        tell(total, total, "done")
    except KeyboardInterrupt:
        interrupted = True
    rows = with_front(_sorted(measuring), measuring.truth.about)
    if methods is None and not interrupted:
        calibration.record(equations, float(times[-1]), _measured(rows, measuring.truth))
    return Study(scene.robot.name, float(times[-1]), len(times), rows, tuple(measuring.failures),
                 measuring.truth.about, time.perf_counter() - began, interrupted)  # fmt: skip


def _climb_all(
    measuring: Measuring,
    methods: Iterable[Method],
    tolerances: tuple[float, ...] | None,
    tell: StudyProgress,
    total: int,
) -> None:
    done = 0
    for method in methods:

        def before(number: int, setting: float, method: Method = method, done: int = done) -> None:
            what = "tolerance" if method.adaptive else "step"
            tell(done + number, total, f"{method.name}, {what} {setting:.2g}")

        climb(measuring, method, tolerances, before)
        done += count(method, tolerances)


def _improve_reference(measuring: Measuring) -> None:
    """Take a reference of more digits where the best entry comes too near to this one's error."""
    best = min((row.error for row in (entry.row for entry in measuring.found)), default=math.inf)
    if best >= BETTER * measuring.truth.own or measuring.truth.precision != "extended":
        return
    better = better_truth(measuring.equations, measuring.times)
    if better is None or better.own > measuring.truth.own:
        return
    space = measuring.equations.space
    measuring.truth = better
    for entry in measuring.found:
        entry.row = replace(entry.row, error=better.error_of(space, entry.q))


def _sorted(measuring: Measuring) -> list[Row]:
    """By method in the order of METHODS, from rough to accurate."""
    order = list(METHODS)
    return sorted((row for row in (entry.row for entry in measuring.found)),
                  key=lambda row: (order.index(row.method), -(row.tolerance or row.step or 0.0)))  # fmt: skip


def _measured(rows: Iterable[Row], truth: Truth) -> list[calibration.Measured]:
    """What method="auto" may choose from: rows that set a tolerance, as a step is no setting that refines by itself."""
    return [
        calibration.Measured(row.method, row.tolerance, row.error + truth.about.error, row.seconds)
        for row in rows
        if row.tolerance is not None
    ]


def _methods(names: Sequence[str] | None) -> list[Method]:
    if names is None:
        return list(METHODS.values())
    names = [names] if isinstance(names, str) else list(names)
    if not names:
        raise SceneError("no method is named", argument="methods", remedy=f"such as {', '.join(list(METHODS)[2:6])}")
    if "auto" in names:
        remedy = "leave methods out to measure all"
        raise SceneError("'auto' chooses a method, it is none itself", argument="methods", remedy=remedy)
    return list({name: method_named(name, "methods") for name in names}.values())


def _tolerances(values: Sequence[float] | None) -> tuple[float, ...] | None:
    if values is None:
        return None
    given = [values] if isinstance(values, (int, float)) else list(values)
    if not given:
        raise AccuracyError("no tolerance is given", argument="tolerances", remedy="such as [1e-3, 1e-6, 1e-9]")
    return tuple(positive(value, "tolerances", AccuracyError, "such as [1e-3, 1e-6, 1e-9]") for value in given)


def _repeats(value: int) -> int:
    if not isinstance(value, int) or value < 1:
        raise SceneError(f"expected a whole number above 0, got {value!r}", argument="repeats", remedy="such as 7")
    return value


def _times(duration: float, samples: float) -> Array:
    """Samples from 0 to the duration, about that many a second and at least one of them at the end."""
    rate = positive(samples, "samples", AccuracyError, "such as 50 a second")
    if duration * rate > MAX_SAMPLES:
        what = f"{duration * rate:.3g} samples, the limit is {MAX_SAMPLES:.0e}"
        raise SceneError(what, argument="samples", remedy="ask for fewer a second, or a shorter duration")
    return np.linspace(0.0, duration, max(1, round(duration * rate)) + 1)


def _silent(_done: int, _total: int, _label: str) -> None:
    return
