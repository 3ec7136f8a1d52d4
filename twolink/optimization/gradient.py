"""gradient: the derivatives of one number of a run by many numbers of its scene, by an adjoint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twolink.errors import AccuracyError, SceneError
from twolink.integrate.equations import Equations
from twolink.integrate.scene_equations import equations_of
from twolink.integrate.solution import Progress
from twolink.io.listing import Table
from twolink.optimization.objectives import Objective, named_objective, value_of
from twolink.optimization.sample_derivatives import Slopes, by_constants, by_samples
from twolink.scenes import Scene
from twolink.scenes.scene import accuracy_of
from twolink.simulation.adjoint_runs import AdjointRun, with_states
from twolink.simulation.error_bar import ROUNDING, SLACK
from twolink.simulation.nominal_solutions import bound
from twolink.simulation.sampling import duration_for, sample_times
from twolink.simulation.scene_run import MAX_SAMPLES
from twolink.simulation.sensitivities import refined
from twolink.simulation.sensitivity_names import Wanted, wanted_of
from twolink.simulation.text import ShownAsText
from twolink.simulation.trajectory import Trajectory

STEPS = (1e-3, 5e-4)  # rad, m, per second: of differences of the objective, along the run and along second solutions


@dataclass(frozen=True, eq=False, repr=False)
class Gradient(ShownAsText):
    """The derivatives of one number of a run.

    Parameters
    ----------
    run : Trajectory
        The motion.
    objective : float
        The number.
    objective_error : float
        Its numerical error: twice its distance to that of a more accurate motion.
    by : mapping of names to ndarray (k,)
        Its derivatives by each of the k numbers that have the name.
    error : mapping of names to ndarray (k,)
        Bounds on their errors.
    accuracy : float
        The accuracy asked for, relative to the largest derivative of a name, or 1.
    """

    run: Trajectory
    objective: float
    objective_error: float
    by: dict[str, np.ndarray]
    error: dict[str, np.ndarray]
    accuracy: float

    def table(self) -> Table:
        """Each derivative with its error bar."""
        rows = []
        for name, values in self.by.items():
            for k, value in enumerate(values):
                rows.append((name if len(values) == 1 else f"{name}[{k}]", float(value), float(self.error[name][k])))
        return Table(("by", "derivative", "error bar"), tuple(rows))

    def __repr__(self) -> str:
        return f"objective {self.objective:.9g} ± {self.objective_error:.1e}\n{self.table()}"


def gradient(
    scene: Scene,
    objective: Objective | str,
    wrt: Sequence[str] = ("q", "v"),
    duration: float | None = None,
    accuracy: float = 1e-6,
    *,
    samples: float = 200.0,
    slopes: Slopes | None = None,
    progress: Progress | None = None,
) -> Gradient:
    """Derivatives of one number of a run by many numbers of the scene.

        dF/dp = sum_n (dF/dx_n) dx_n/dp + F_p,   computed backwards: w- = Phi^T w+ + dF/dx_n

    Parameters
    ----------
    scene : Scene
    objective : callable, or str
        F: of a `Trajectory`, a number; or a name as `twolink optimize` has them, such as "x:ball".
    wrt : sequence of str
        By what, as in `sensitivities`.
    duration : float, optional
        Simulated time, s; by default the scene's own.
    accuracy : float
        Bound on the global error of q as in `simulate`, and on the error of each derivative, relative to the largest
        of its name, or to 1 (in SI units) where that is larger.
    samples : float
        Samples a second, which the objective sees.
    slopes : callable, optional
        (dF/dq (n, nv) in the tangent space, dF/dv (n, nv)) of a run. Without it they are differences of F: of the last
        sample if F depends on no other one, else of all of them, which takes 8 nv calls of F a sample.
    progress : callable, optional
        Called with the simulated time now and then.

    Returns
    -------
    Gradient

    Raises
    ------
    SceneError
        As `sensitivities`; the objective asks for more of a run than samples, energy, torques and accelerations, or
        they change with a parameter in a way that is not followed (code "gradient-objective").
    AccuracyError
        As `sensitivities`.
    MissingExtraError
        heyoka is not installed.

    Notes
    -----
    What the motion costs grows with the number of its degrees of freedom, not with that of the parameters; each event
    adds differences by every parameter. `sensitivities` costs less for few (scripts/benchmarks/sensitivities.py).

    The error bar comes from second solutions, as that of `sensitivities`. The derivatives are those along the finer
    one.

    References
    ----------
    Hager 2000, "Runge-Kutta methods in optimal control and the transformed adjoint system", Numerische Mathematik 87.
    """
    accuracy, wanted, equations = accuracy_of(accuracy), wanted_of(scene, wrt), equations_of(scene)
    function = named_objective(objective, scene.robot) if isinstance(objective, str) else objective
    times = sample_times(duration_for(scene, duration), samples, MAX_SAMPLES)

    def attempt(own: Equations, run: Trajectory, sought: float, tolerance: float) -> tuple[Gradient, float]:
        if run.interrupted:
            raise KeyboardInterrupt
        if run.events and run.t[-1] < times[-1]:
            raise SceneError("an event ends the run: its end moves with the parameters", argument="scene",
                             remedy="tl.optimize follows such ends; or leave the effect that ends it out",
                             code="gradient-end")  # fmt: skip
        found = _along(run, own, wanted, function, slopes, sought, tolerance, accuracy)
        sizes = {name: accuracy * max(1.0, float(np.abs(values).max())) for name, values in found.by.items()}
        return found, max(float(bar.max()) / sizes[name] for name, bar in found.error.items())

    return refined(scene, equations, times, accuracy, attempt, progress)


def _along(
    run: Trajectory, equations: Equations, wanted: Wanted, function: Objective, slopes: Slopes | None, sought: float,
    tolerance: float, accuracy: float,
) -> Gradient:  # fmt: skip
    """The gradient along a run, with its error bars."""
    here, covectors = by_samples(run, function, slopes, STEPS[0])
    adjoint = AdjointRun(run, equations, wanted, sought, tolerance, here)
    results, values = [adjoint.pulled_back(0, covectors)], [value_of(function, run)]
    constants = by_constants(run, wanted, function)
    for number, nominal in enumerate(adjoint.nominals[1:], 1):
        beside = with_states(run, nominal)
        results.append(adjoint.pulled_back(number, by_samples(beside, function, slopes, STEPS[1], here)[1]))
        values.append(value_of(function, beside))
    total = results[1] + constants
    bar = bound([np.abs(result - results[0]) for result in results[1:]])
    bar += ROUNDING * np.abs(total) + SLACK * accuracy * np.maximum(1.0, np.abs(total))
    if not np.isfinite(total).all():
        raise AccuracyError("the gradient is no finite number", where="objective", code="gradient-undefined",
                            remedy="ask for another number of the run")  # fmt: skip
    by = {name: total[columns] for name, columns in wanted.columns.items()}
    error = {name: bar[columns] for name, columns in wanted.columns.items()}
    off = float(bound([np.abs(np.asarray(value) - values[0]) for value in values[1:]]))
    return Gradient(run, values[0], off + float(np.spacing(abs(values[0]))), by, error, accuracy)
