"""accuracy_study: every method at every setting, against a reference; and its result, with text, figure and files."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from twolink.accuracy.measuring import StudyRun, count, first_reference, measure_method
from twolink.accuracy.study_data import Row, StudyData, plot_study, study_text, with_front
from twolink.dynamics.arguments import Positive, positive, texts, whole
from twolink.errors import AccuracyError, SceneError, ShowError, TwolinkError
from twolink.integrate.motion.scene_equations import equations_of
from twolink.integrate.steps.methods import METHODS, Method, method_named
from twolink.io.files import path_to_write
from twolink.io.progress import Report
from twolink.io.tables import SUFFIXES, require_format, write_table
from twolink.robots.joint_layout import unit_of
from twolink.scenes import Scene
from twolink.show.figure import Plotted
from twolink.simulation.sampling import duration_for, sample_times, with_ends
from twolink.simulation.text import BaseResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SAVED = (".json", *SUFFIXES)
MAX_SAMPLES = 200_000  # each row keeps its own until the reference is final


@dataclass(frozen=True, repr=False)
class Study(StudyData, BaseResult, Plotted):
    """The cost of each method's accuracy on a scene: rows, the Pareto front, and the price of each further digit."""

    def to_dict(self) -> dict[str, Any]:
        """The study as plain data, which `save` writes as JSON."""
        prices = [
            {"accuracy": p.accuracy, "seconds": p.seconds, "ratio": p.ratio, "method": p.row.method,
             "tolerance": p.row.tolerance, "step": p.row.step} for p in self.price_of_digits()
        ]  # fmt: skip
        return {**msgspec.json.decode(msgspec.json.encode(self)), "price_of_digits": prices}

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Study:
        """Read a study saved as .json. Raises TwolinkError for what is not one."""
        try:
            return msgspec.json.decode(path_to_write(path).read_bytes(), type=cls)
        except OSError as error:
            raise TwolinkError(f"cannot be read: {error.strerror or error}", where=str(path), remedy="check the path",
                               code="not-readable") from None  # fmt: skip
        except msgspec.MsgspecError:
            raise TwolinkError("it is not a saved study", where=str(path), remedy="save the study again, as .json",
                               code="not-a-study") from None  # fmt: skip

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write all of it to .json, or its rows to .csv, .parquet or .npz; numbers keep every digit."""
        target = path_to_write(path)
        suffix = require_format(target, SAVED)
        if suffix == ".json":
            return super().save(target)
        notes = {"robot": self.robot, "duration": repr(self.duration), "reference": self.reference.how,
                 "reference_error": repr(self.reference.error)}  # fmt: skip
        return write_table(target, self._columns(as_text=suffix == ".csv"), notes)

    def _columns(self, *, as_text: bool) -> dict[str, np.ndarray]:
        """The rows by column. As text, what a row does not have is empty; as numbers it is NaN."""
        table: dict[str, np.ndarray] = {}
        for name in Row.__dataclass_fields__:
            values = [getattr(row, name) for row in self.rows]
            if as_text:
                table[name] = np.array(["" if v is None else str(v) for v in values], dtype=str)
            elif name in ("tolerance", "step"):
                table[name] = np.array([math.nan if v is None else v for v in values], dtype=float)
            else:
                table[name] = np.array(values)
        return table

    def _figure(self) -> Figure:
        return plot_study(self)

    def __str__(self) -> str:
        return study_text(self)

    def __repr__(self) -> str:
        ended = ", interrupted" if self.interrupted else ""
        best = min((row.error for row in self.rows), default=math.nan)
        return (
            f"<Study of {self.robot!r}: {self.duration:g} s, {len(self.rows)} rows, {len(self.front)} on the front, "
            f"best error {best:.1e}{ended}>"
        )

    def _repr_html_(self) -> str:
        from twolink.show.figure import figure_html

        try:
            picture = figure_html(self.plot())
        except ShowError:  # no row has an error that can be drawn
            picture = ""
        return super()._repr_html_() + picture


def accuracy_study(
    scene: Scene,
    duration: Positive | None = None,
    *,
    t_eval: ArrayLike | None = None,
    samples_per_second: Positive = 50.0,
    methods: Sequence[str] | None = None,
    tolerances: Sequence[float] | None = None,
    repeats: int = 7,
    budget: Positive = 1.0,
    progress: Report | None = None,
) -> Study:
    """Measure what accuracy costs on a scene: the error and the seconds of each method at several settings.

    Parameters
    ----------
    scene : Scene
    duration : float, optional
        Simulated time, s; by default the scene's own.
    t_eval, samples_per_second : optional
        The samples that the runs deliver, as in `simulate`; at them, at 0 and at the end errors are taken.
    methods : sequence of str, optional
        Names of `twolink methods`; by default all that run here.
    tolerances : sequence of float, optional
        Of adaptive methods; the steps of the others aim at them. By default from rough to rounding.
    repeats : int
        Timed runs after the first, fewer of slow ones; a row has the least of their times.
    budget : float
        Seconds that a run may take; a method's settings end there.
    progress : callable, optional
        Called now and then with what is done, the total and a label; here rows.

    Returns
    -------
    Study
        Errors are max |difference(q, q_reference)| over samples, rad or m; study.reference says what the reference is,
        and its own error. What gave no row is in study.failures. After Ctrl-C it has what is done.

    Raises
    ------
    SceneError, AccuracyError
        An argument does not fit, or the motion cannot be solved.
    """
    began, end = time.perf_counter(), duration_for(scene, duration)
    chosen, aims = _methods(methods), _tolerances(tolerances)
    times = with_ends(sample_times(end, t_eval, samples_per_second, MAX_SAMPLES), end)
    equations = equations_of(scene)
    equations.require_motion()
    report = progress or (lambda *_: None)
    limit = positive(budget, "budget", AccuracyError, "such as 1 second")
    repeats = whole(repeats, "repeats", SceneError, "such as 7", 1)
    total = sum(count(method, aims) for method in chosen) + repeats
    report(0, total, "the reference")
    measurements = StudyRun(equations, times, first_reference(equations, times), repeats, limit)
    interrupted = False
    try:
        _measure_all(measurements, chosen, aims, report, total)
        for number in range(2, repeats + 1):
            report(total - repeats + number - 1, total, f"all once more, {number} of {repeats}")
            measurements.time_again(number)
        report(total, total, "done")
    except KeyboardInterrupt:
        interrupted = True
    reference = measurements.reference.about
    rows = with_front(_sorted(measurements), reference)
    return Study(scene.robot.name, float(times[-1]), len(times), rows, tuple(measurements.failures), reference,
                 time.perf_counter() - began, interrupted, unit_of(scene.robot.joints))  # fmt: skip


def _measure_all(
    measurements: StudyRun, methods: Iterable[Method], tolerances: tuple[float, ...] | None, report: Report, total: int
) -> None:
    done = 0
    for method in methods:

        def announce(number: int, setting: float, method: Method = method, done: int = done) -> None:
            what = "tolerance" if method.adaptive else "step"
            report(done + number, total, f"{method.name}, {what} {setting:.2g}")

        measure_method(measurements, method, tolerances, announce)
        done += count(method, tolerances)


def _sorted(measurements: StudyRun) -> list[Row]:
    """By method in the order of METHODS, from rough to accurate."""
    order = list(METHODS)
    return sorted((entry.row for entry in measurements.done),
                  key=lambda row: (order.index(row.method), -(row.tolerance or row.step or 0.0)))  # fmt: skip


def _methods(names: Sequence[str] | None) -> list[Method]:
    if names is None:
        return list(METHODS.values())
    names = texts(names, "methods", SceneError, "such as ['dop853']")
    if not names:
        raise SceneError("no method is named", argument="methods", remedy=f"such as {', '.join(list(METHODS)[2:6])}")
    if "auto" in names:
        remedy = "leave methods out to measure all"
        raise SceneError("'auto' chooses a method, it is none itself", argument="methods", remedy=remedy)
    return list({name: method_named(name, "methods") for name in names}.values())


def _tolerances(values: Sequence[float] | None) -> tuple[float, ...] | None:
    if values is None:
        return None
    tolerances, remedy = [values] if isinstance(values, (int, float)) else list(values), "such as [1e-3, 1e-6, 1e-9]"
    if not tolerances:
        raise AccuracyError("no tolerance is given", argument="tolerances", remedy=remedy)
    return tuple(positive(value, "tolerances", AccuracyError, remedy) for value in tolerances)
