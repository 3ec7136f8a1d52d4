"""sensitivities: derivatives of a simulated motion by its initial state and by physical constants."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar, overload

import numpy as np
from numpy.typing import ArrayLike

from twolink.dynamics.arguments import Positive, positive
from twolink.errors import AccuracyError, SceneError, require_known
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.scene_equations import equations_of
from twolink.integrate.solution import Progress
from twolink.integrate.solver import choose
from twolink.io.files import path_to_write
from twolink.io.progress import Report, in_time
from twolink.scenes import Scene
from twolink.scenes.scene import accuracy_of
from twolink.show.figure import save_figure
from twolink.simulation.error_bar import ROUNDING, SLACK, error_bar
from twolink.simulation.sampling import duration_for, only_at, sample_times, with_ends
from twolink.simulation.scene_run import run_of
from twolink.simulation.sensitivity_names import wanted_of
from twolink.simulation.sensitivity_runs import SensitivityRun
from twolink.simulation.text import BaseResult
from twolink.simulation.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MARGIN, SMOOTH_MARGIN = 10.0, 2.0  # times smaller than the accuracy the first tolerance is, with events and without
TRIALS = 5  # of smaller tolerances
Found = TypeVar("Found")


@dataclass(frozen=True, eq=False, repr=False)
class Sensitivities(BaseResult):
    """Derivatives of a motion.

    Parameters
    ----------
    run : Trajectory
        The motion.
    q, v : mapping of names to ndarray (n, nv, k)
        Derivatives of q, in the tangent space, and of v at the samples of the run, by each of the k numbers that have
        the name.
    error : mapping of names to ndarray (n,)
        Bound on the error of every entry of q and v of that name.
    values : mapping of names to float
        The values of the parameters among the names, SI units; "q" and "v" have none.
    accuracy : float
        The accuracy asked for, relative to the largest entry so far, or 1.
    """

    run: Trajectory
    q: dict[str, np.ndarray]
    v: dict[str, np.ndarray]
    error: dict[str, np.ndarray]
    values: dict[str, float]
    accuracy: float

    @overload
    def plot(self, *, name: str | None = ..., change: float = ...) -> Figure: ...

    @overload
    def plot(self, path: str | os.PathLike[str], *, name: str | None = ..., change: float = ...) -> Path: ...

    def plot(
        self, path: str | os.PathLike[str] | None = None, *, name: str | None = None, change: float = 0.01
    ) -> Path | Figure:
        """Draw the motion in a tube that a change of a parameter makes, and how far each parameter moves the motion.

            tube: q(t) +- |dq/dp| change |p|

        Parameters
        ----------
        path : str or path, optional
            A .png, .svg or .pdf file.
        name : str, optional
            The parameter of the tube; by default the one that moves q the most. Of a name with several numbers the
            tube is the sum of theirs.
        change : float
            Of a parameter, relative to its value; of the initial state, and of what is 0, the change itself in rad, m,
            or per second.

        Returns
        -------
        Path or matplotlib.figure.Figure
            The path; without one the figure, which notebooks show.

        Raises
        ------
        SceneError
            The name is not among those of the sensitivities (code "unknown-sensitivity"), or `change` is no number
            above 0.
        ShowError
            The file cannot be written.

        Notes
        -----
        The tube is linear in the change: where it is wide, the motion leaves it.
        """
        from twolink.show.motion_plots import plot_sensitivities

        positive(change, "change", SceneError, "such as 0.01")
        if name is not None:
            require_known(name, self.q, SceneError, "there are no sensitivities to {!r}", argument="name",
                          code="unknown-sensitivity")  # fmt: skip
        steps = {one: change * (abs(self.values.get(one, 1.0)) or 1.0) for one in self.q}
        moves = {one: step * np.abs(self.q[one]).sum(axis=2).max(axis=1, initial=0.0) for one, step in steps.items()}
        shown = max(moves, key=lambda one: float(moves[one].max())) if name is None else name
        run, along = self.run, (steps[shown] * self.q[shown], steps[shown] * self.v[shown])
        words = f"{shown} ± {100 * change:g} %" if self.values.get(shown) else f"{shown} ± {change:g}"
        title = f"{run.title or run.robot.name}\n{words}"
        figure = plot_sensitivities(run.robot, title, (run.t, run.q, run.v), along, moves)
        return figure if path is None else save_figure(figure, path_to_write(path))

    def __repr__(self) -> str:
        worst = max((float(bar[-1]) for bar in self.error.values()), default=0.0)
        return f"<Sensitivities to {', '.join(self.q)}: {len(self.run.t)} samples, error bar {worst:.1e}>"


def sensitivities(
    scene: Scene,
    duration: Positive | None = None,
    *,
    wrt: Sequence[str] = ("q", "v"),
    accuracy: Positive = 1e-6,
    t_eval: ArrayLike | None = None,
    samples_per_second: Positive = 200.0,
    progress: Report | None = None,
) -> Sensitivities:
    """Derivatives of a simulated motion by its initial state and by physical constants.

        S = d(q, v)/dp,   S' = (df/dx) S + df/dp

    Parameters
    ----------
    scene : Scene
    duration : float, optional
        Simulated time, s; by default the scene's own.
    wrt : sequence of str
        By what: "q" and "v", the initial configuration (along tangent directions) and velocity; "q.JOINT" and
        "v.JOINT", those of a joint; a physical constant (`algorithms.mechanism.parameter_names`: "forearm.mass",
        "gravity.z", ...); a number of an effect, by its place in the scene ("effects.1.damping.elbow"), also one that
        decides events ("effects.2.restitution", "effects.3.static.elbow", "effects.4.at").
    accuracy : float
        Bound on the global error of q as in `simulate`, and on the error of each derivative relative to its largest
        entry so far, or to 1 (in SI units) where that is larger.
    t_eval, samples_per_second : optional
        The samples, as in `simulate`.
    progress : callable, optional
        Called now and then with what is done, the total and a label; here simulated seconds.

    Returns
    -------
    Sensitivities

    Raises
    ------
    SceneError
        An argument does not fit, or a name is unknown (code "unknown-parameter").
    AccuracyError
        The motion cannot be simulated, or the accuracy cannot be kept.

    Notes
    -----
    Their error bar comes from second solutions. A finer one, with half the steps of the variational equations, shows
    truncation; two that start roundings away show rounding, also that of the differences through events. Without events
    the derivatives are those along the finer one, interpolated between its steps; with events, those along the motion.
    """
    end = duration_for(scene, duration)
    times = sample_times(end, t_eval, samples_per_second)
    found = sensitivities_at(scene, wrt, with_ends(times, end), accuracy, in_time(progress, end))
    run = only_at(found.run, times, end)
    kept = np.isin(found.run.t, run.t)
    q, v, error = ({name: rows[kept] for name, rows in by.items()} for by in (found.q, found.v, found.error))
    return replace(found, run=run, q=q, v=v, error=error)


def sensitivities_at(
    scene: Scene,
    wrt: Sequence[str],
    times: np.ndarray,
    accuracy: float,
    progress: Progress | None = None,
    *,
    numbers_as_inputs: bool = False,
) -> Sensitivities:
    """As `sensitivities`, at times (n,), increasing; the scene's state is that at the first of them.

    numbers_as_inputs: by code that serves scenes with other numbers too, for those who ask for many of them.
    """
    accuracy = accuracy_of(accuracy)
    wanted, equations = wanted_of(scene, wrt), equations_of(scene)

    def attempt(own: Equations, run: Trajectory, tolerance: float) -> tuple[Sensitivities, float]:
        return _with_bars(SensitivityRun(run, own, wanted, tolerance, accuracy), accuracy)

    return refined(scene, equations, times, accuracy, attempt, progress, numbers_as_inputs=numbers_as_inputs)


def refined(
    scene: Scene,
    equations: Equations,
    times: np.ndarray,
    accuracy: float,
    attempt: Callable[[Equations, Trajectory, float], tuple[Found, float]],
    progress: Progress | None = None,
    *,
    numbers_as_inputs: bool = False,
) -> Found:
    """Derive a result from a run at times (n,), by ever more accurate runs until its bars are below the accuracy.

    attempt: of equations, their run and a tolerance of steps: the result, and how many times too large
    its bars are. Raises AccuracyError, code "accuracy-limit", where that has no end.
    """
    begin, end = float(times[0]), float(times[-1])
    if begin:
        equations = equations.starting_at(equations.start, begin)
    if numbers_as_inputs:
        equations = replace(equations, numbers_as_inputs=True)
    sought, excess, run = accuracy, 0.0, None
    margin = MARGIN if equations.has_events else SMOOTH_MARGIN
    for _ in range(TRIALS):
        choice = choose(equations, sought, end - begin, "auto")
        try:
            run = run_of(scene, equations, choice, times, sought, progress)
        except AccuracyError:
            if not excess:
                raise
            break
        _require_no_jump(equations, run)
        result, excess = attempt(equations, run, sought / margin)
        if excess <= 1.0:
            return result
        sought *= 0.5 / excess
    raise AccuracyError(f"{accuracy:g} cannot be kept: the error bar is {excess:.1e} times as large",
                        argument="accuracy", remedy="ask for less accuracy, or a shorter duration",
                        code="accuracy-limit", run=run, trusted_until=0.0, precision="")  # fmt: skip


def _require_no_jump(equations: Equations, run: Trajectory) -> None:
    """Require that nothing changes the state at the start and at the end: derivatives there are those of one side."""
    changing = {place for place, one in equations.switching.triggers if one.state} if equations.switching else set()
    for event in run.events:
        if event.effect in changing and event.t in (0.0, run.end):
            what, remedy = ("end", "another duration") if event.t else ("start", "the state after it as the start")
            raise AccuracyError(f"`then` of {event.what!r} changes the state at the {what} of the run",
                                where=f"t = {event.t:.6g} s", remedy=f"give {remedy}",
                                code="sensitivity-undefined", t=event.t)  # fmt: skip


def _with_bars(found: SensitivityRun, accuracy: float) -> tuple[Sensitivities, float]:
    """The derivatives by name, with their error bars, and how many times too large the largest of these is."""
    run, s, nv = found.run, found.s, found.run.robot.nv
    after = np.minimum(np.searchsorted(found.t, run.t), len(found.t) - 1)
    q, v, error, excess = {}, {}, {}, 0.0
    for name, columns in found.wanted.columns.items():
        own = s[:, :, columns]
        q[name], v[name] = own[:, :nv], own[:, nv : 2 * nv]
        size = np.maximum.accumulate(np.abs(own).max(axis=(1, 2), initial=0.0))
        admitted = accuracy * np.maximum(1.0, size)
        distance = found.distance[:, columns].max(axis=1, initial=0.0)
        bar = error_bar(distance, np.zeros(len(distance)), 1.0)[after]
        error[name] = bar + ROUNDING * size + SLACK * admitted
        excess = max(excess, float((error[name] / admitted).max()))
    return Sensitivities(run, q, v, error, found.wanted.values, accuracy), excess
