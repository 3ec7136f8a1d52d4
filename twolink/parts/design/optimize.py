"""optimize: the numbers of a scene for which a function of its run is least or greatest, and their errors."""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from twolink.dynamics.arguments import Positive, whole
from twolink.errors import SceneError, TwolinkError, require_known
from twolink.integrate.motion.scene_equations import equations_of
from twolink.io.progress import Report
from twolink.io.text import Table
from twolink.parts.design.evaluation import BY_SENSITIVITIES, Evaluation, ObjectiveEvaluator, variables_of
from twolink.parts.design.objectives import Objective, objective_of, require_function
from twolink.parts.design.search import MultiStart, starting_points
from twolink.scenes import Scene
from twolink.scenes.scene import accuracy_of
from twolink.show.figure import Plotted, plot_lines
from twolink.simulation.error_bar import SAFETY
from twolink.simulation.sampling import duration_for, sample_times, with_ends
from twolink.simulation.text import BaseResult, as_data
from twolink.simulation.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST = 1e6  # starts, and evaluations


@dataclass(frozen=True, eq=False, repr=False)
class Optimum(BaseResult, Plotted):
    """The best that a search found. It unpacks as scene, run, history.

    Attributes
    ----------
    scene : Scene
        The scene with the best values.
    run : Trajectory
        Its run, with an error bar.
    history : Table
        Every evaluation: start, values by name, objective, least constraint, slope (norm of the gradient with the
        variables scaled to [0, 1]), where the derivatives came from, seconds.
    values : mapping of str to float
        The best values by name, SI units.
    objective : float
        The objective there.
    error : float
        Its numerical error: twice its distance to the value of a run that is FINER times as accurate and has a
        sample between each two. NaN: there is no such run.
    gradient : ndarray (k,)
        The objective's derivatives there, per unit of each variable.
    gradient_error : ndarray (k,)
        Their numerical error, found in the same way; NaN where they are differences of runs.
    hessian : ndarray (k, k)
        Second derivatives, by differences of gradients. NaN: not computed.
    on_bound : mapping of str to str
        "low" or "high" for the variables whose best value is on a bound.
    constraints : mapping of str to float
        The constraints there; each is to be at least 0.
    simulations : int
        Runs that it took, those that a file held included.
    seconds : float
        Of wall clock, likewise.
    ends : tuple of str
        Why the search from each start ended.
    interrupted : bool
        Ctrl-C ended it; this is the best so far.
    """

    scene: Scene
    run: Trajectory
    history: Table
    values: Mapping[str, float]
    objective: float
    error: float
    gradient: np.ndarray
    gradient_error: np.ndarray
    hessian: np.ndarray
    on_bound: Mapping[str, str]
    constraints: Mapping[str, float]
    simulations: int
    seconds: float
    ends: tuple[str, ...]
    interrupted: bool = False

    def __iter__(self) -> Iterator[Any]:
        return iter((self.scene, self.run, self.history))

    @property
    def resolution(self) -> dict[str, float]:
        """The change of each variable alone that changes the objective by its error.

        The positive root d of |g_k| d + |H_kk| d^2 / 2 = error; NaN where error or Hessian are not known.
        """
        slope, curvature = np.abs(self.gradient), np.abs(np.diag(self.hessian))
        with np.errstate(divide="ignore", invalid="ignore"):
            off = 2.0 * self.error / (slope + np.sqrt(slope**2 + 2.0 * curvature * self.error))
        return dict(zip(self.values, off.tolist(), strict=True))

    def table(self) -> Table:
        """Value, bound, resolution, first and second derivative of each variable."""
        resolution, rows = self.resolution, []
        for k, (name, value) in enumerate(self.values.items()):
            rows.append((name, value, as_data(resolution[name]), self.on_bound.get(name), float(self.gradient[k]),
                         as_data(self.gradient_error[k]), as_data(self.hessian[k, k])))  # fmt: skip
        return Table(("variable", "value", "±", "bound", "slope", "± slope", "curvature"), tuple(rows))

    def to_dict(self) -> dict[str, Any]:
        """A record for JSON."""
        names = ("objective", "error", "hessian", "constraints", "simulations", "seconds", "ends", "interrupted",
                 "history")  # fmt: skip
        return {"variables": self.table().to_records()} | {name: as_data(getattr(self, name)) for name in names}

    def _figure(self) -> Figure:
        found = np.array([record["objective"] for record in self.history])
        title = f"{self.scene.title or self.scene.robot.name}: objective {self.objective:.6g}"
        return plot_lines(title, ("evaluation", "objective"), np.arange(1, len(found) + 1), {"objective": found})

    def __repr__(self) -> str:
        error = "error not known" if np.isnan(self.error) else f"± {self.error:.1e}"
        lines = [f"objective {self.objective:.9g} {error}, {len(self.history)} evaluations, "
                 f"{self.simulations} simulations, {self.seconds:.3g} s", str(self.table())]  # fmt: skip
        lines += [f"constraint {name}: {value:.6g}{' (violated)' if value < -(self.run.accuracy or 0.0) else ''}"
                  for name, value in self.constraints.items()]  # fmt: skip
        lines += [f"start {i}: {end}" for i, end in enumerate(self.ends, 1)]
        by_runs = dict.fromkeys(record["derivatives"] for record in self.history)
        lines += [f"derivatives: {by}" for by in by_runs if by.startswith("differences")]
        return "\n".join([*lines, "interrupted: this is the best so far"] if self.interrupted else lines)


FINER = 30.0  # times as accurate: the run that tells the error of the objective
STEP = 1e-3  # of the distance of the bounds: of differences of gradients


def optimize(
    scene: Scene, duration: Positive | None = None, *, objective: Objective | str, wrt: Mapping[str, Sequence[float]],
    accuracy: Positive = 1e-6, t_eval: ArrayLike | None = None, samples_per_second: Positive = 200.0,
    maximize: bool = False, constraints: Mapping[str, Objective] | None = None, starts: int = 3, seed: int = 0,
    evaluations: int = 200, curvature: bool = True, derivatives: str = "auto",
    out: str | os.PathLike[str] | None = None, progress: Report | None = None,
) -> Optimum:  # fmt: skip
    """Find the values of numbers of a scene, within bounds, for which a function of its run is least.

        min F(run(p)),   low <= p <= high,   c_i(run(p)) >= 0

    Parameters
    ----------
    scene : Scene
    duration : float, optional
        Simulated time, s; by default the scene's own.
    objective : callable or str
        F: of a `Trajectory`, a number; or a name as `twolink optimize` has them, such as "x:ball" or "effort".
    wrt : mapping of str to (low, high)
        Bounds of the variables p by name, SI units: "q.JOINT" and "v.JOINT" of the initial state; physical constants
        such as "forearm.mass"; numbers of effects by their place in the scene, such as "effects.1.damping.elbow" or
        "effects.3.inputs.elbow.values.2" (a table), "effects.4.at" (a release).
    accuracy : float
        Bound on the global error of q, as in `simulate`.
    t_eval, samples_per_second : optional
        The samples of a run, as in `simulate`; the start and the end are among them.
    maximize : bool
        Find the greatest value instead.
    constraints : mapping of str to callable, optional
        c_i: of a `Trajectory`, a number that is to be at least 0.
    starts : int
        Local searches: the first from the scene's own values, the others from a Latin hypercube.
    seed : int
        Of that.
    evaluations : int
        At most, of all starts together.
    derivatives : {"auto", "runs"}
        From sensitivities where there are some, or always as differences of runs, which are cheaper for few variables
        of a motion with many contacts.
    curvature : bool
        Compute second derivatives at the best point: as many more evaluations as there are variables.
    out : path-like, optional
        A file for the evaluations. A search that finds its own evaluations there goes on from them.
    progress : callable, optional
        Called now and then with what is done, the total and a label; here evaluations, and the most that are allowed.

    Returns
    -------
    Optimum
        It unpacks as scene, run, history. Ctrl-C ends the search with the best so far.

    Raises
    ------
    SceneError
        An argument does not fit: codes "unknown-parameter", "bounds", "objective", "unknown-objective",
        "another-search".
    AccuracyError
        No start can be simulated.

    Notes
    -----
    An evaluation is one run with its sensitivities. They give the derivatives of F along the run without another run,
    for any F of its samples, end, energy, torques and accelerations; at the first evaluation they are compared with
    differences of runs. Where sensitivities do not exist, differences of runs take their place, and the history says
    so. The search is local, SciPy's SLSQP, from each start.

    References
    ----------
    Kraft 1988, "A software package for sequential quadratic programming", DFVLR-FB 88-28.
    """
    if not isinstance(constraints or {}, Mapping):
        raise SceneError(f"expected functions by name, got {constraints!r:.60}", argument="constraints",
                         remedy='such as {"height": lambda run: run.q[-1, 0] - 0.5}')  # fmt: skip
    began, limits = time.perf_counter(), dict(constraints or {})
    variables = variables_of(scene, wrt)
    function = objective_of(objective, scene.robot)
    functions = {"objective": function} | {f"constraints[{name!r}]": one for name, one in limits.items()}
    for name, one in functions.items():
        require_function(one, name)
    for name, count in (("starts", starts), ("evaluations", evaluations)):
        whole(count, name, SceneError, "such as 3", 1, MOST)
    whole(seed, "seed", SceneError)
    require_known(derivatives, ("auto", "runs"), SceneError, argument="derivatives")
    end = duration_for(scene, duration)
    times = with_ends(sample_times(end, t_eval, samples_per_second), end)
    evaluator = ObjectiveEvaluator(variables, functions, times, accuracy_of(accuracy), derivatives)
    problem = {
        "objective": _name_of(function), "maximize": maximize,
        "wrt": {name: [float(bound) for bound in pair] for name, pair in wrt.items()},
        "constraints": {name: _name_of(one) for name, one in limits.items()},
        "accuracy": accuracy, "times": hashlib.sha256(times.tobytes()).hexdigest(), "scene": _digest(scene),
    }  # fmt: skip
    file = None if out is None else Path(out)
    search = MultiStart(evaluator, -1.0 if maximize else 1.0, int(evaluations), file, problem, progress)
    search(starting_points((variables.own - variables.low) / variables.width, int(starts), seed))
    best = search.best()
    if best is None:
        raise SceneError("nothing was evaluated", where="optimize", remedy="allow for more evaluations")
    return _optimum(search, best, limits, began, curvature=curvature)


def _optimum(
    search: MultiStart, best: Evaluation, limits: Mapping[str, Objective], began: float, *, curvature: bool
) -> Optimum:
    """The result, with errors and curvature at the best point."""
    evaluate, variables = search.evaluate, search.evaluate.variables
    scene, k = variables.scene_at(best.x), len(best.x)
    run = evaluate.run(scene, verify=True)
    error, gradient_error, hessian = float("nan"), np.full(k, np.nan), np.full((k, k), np.nan)
    try:
        if not search.interrupted:
            search.report("the best, more accurately")
            error, gradient_error = _errors(evaluate, best, scene)
            hessian = _hessian(evaluate, best) if curvature else hessian
    except KeyboardInterrupt:
        search.interrupted = True
    low, high = best.x == variables.low, best.x == variables.high
    sides = {name: "low" if low[i] else "high" for i, name in enumerate(variables.names) if low[i] or high[i]}
    return Optimum(
        scene, run, _history(search), variables.named(best.x), float(best.values[0]), error, best.gradients[0],
        gradient_error, hessian, sides, dict(zip(limits, best.values[1:].tolist(), strict=True)),
        evaluate.simulations, time.perf_counter() - began + search.earlier, tuple(search.ends), search.interrupted,
    )  # fmt: skip


def _errors(evaluate: ObjectiveEvaluator, best: Evaluation, scene: Scene) -> tuple[float, np.ndarray]:
    """The numerical errors of the objective and of its derivatives (k,), from a finer run; NaN where there is none."""
    names, unknown = evaluate.variables.names, np.full(len(best.x), np.nan)
    try:
        if best.by != BY_SENSITIVITIES:
            return _distance(best.values[0], evaluate.values_of(evaluate.run(scene, FINER))[0]), unknown
        run, columns = evaluate.along(scene, names, FINER)
        finer = np.array([columns[name][0] for name in names])
        return _distance(best.values[0], evaluate.values_of(run)[0]), SAFETY * np.abs(finer - best.gradients[0])
    except TwolinkError:
        return float("nan"), unknown


def _distance(value: float, finer: float) -> float:
    """Twice the distance, and the rounding of the value."""
    return float(SAFETY * abs(value - finer) + np.spacing(abs(value)))


def _hessian(evaluate: ObjectiveEvaluator, best: Evaluation) -> np.ndarray:
    """The second derivatives (k, k) of the objective, by differences of gradients away from the nearer bound."""
    variables, rows = evaluate.variables, []
    for i, width in enumerate(variables.width):
        step = STEP * width * (1.0 if best.x[i] - variables.low[i] < 0.5 * width else -1.0)
        moved = best.x.copy()
        moved[i] += step
        try:
            rows.append((evaluate(moved).gradients[0] - best.gradients[0]) / step)
        except TwolinkError:
            rows.append(np.full(len(best.x), np.nan))
    found = np.array(rows)
    return np.asarray(0.5 * (found + found.T))


def _history(search: MultiStart) -> Table:
    """Every evaluation of the search."""
    width, rows = search.evaluate.variables.width, []
    for start, one in search.history:
        least = float(one.values[1:].min()) if len(one.values) > 1 else None
        slope = float(np.linalg.norm(one.gradients[0] * width))
        rows.append((start + 1, *one.x.tolist(), float(one.values[0]), least, slope, one.by, one.seconds))
    names = search.evaluate.variables.names
    return Table(("start", *names, "objective", "least constraint", "slope", "derivatives", "seconds"), tuple(rows))


def _name_of(function: Objective) -> str:
    """A function by its name; a named objective with its fields."""
    name = getattr(function, "__qualname__", None)
    return f"{function.__module__}.{name}" if name else repr(function)


def _digest(scene: Scene) -> str:
    """A digest of what moves, how and from where."""
    parts = [scene.q.tobytes(), scene.v.tobytes(), repr(scene.effects).encode(), repr(scene.duration).encode()]
    return hashlib.sha256(b"".join([*parts, equations_of(scene).content.encode()])).hexdigest()[:32]
