"""gradient: the derivatives of one number of a run by many numbers of its scene."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from twolink.dynamics.arguments import Positive
from twolink.errors import AccuracyError, SceneError
from twolink.integrate.motion.effect_numbers import nominal_value
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.scene_equations import equations_of
from twolink.io.progress import Report, in_time
from twolink.io.text import Table
from twolink.parts.design.linearization import state_names
from twolink.parts.design.objectives import (
    STEP,
    NotFollowedError,
    Objective,
    RunVariation,
    Unknown,
    beside,
    objective_of,
    value_of,
)
from twolink.scenes import Scene
from twolink.scenes.scene import accuracy_of
from twolink.show.figure import Plotted, plot_bars
from twolink.simulation.error_bar import ROUNDING, SLACK
from twolink.simulation.nominal_solutions import bound
from twolink.simulation.sampling import duration_for, sample_times, with_ends
from twolink.simulation.sensitivities import refined
from twolink.simulation.sensitivity_names import Wanted, wanted_of
from twolink.simulation.sensitivity_runs import along_solutions, with_states
from twolink.simulation.text import BaseResult
from twolink.simulation.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Slopes = Callable[[Trajectory], tuple[np.ndarray, np.ndarray]]
SHARE = 1e-3  # of a constant: the step of differences by it
SMALL = 1e-3  # SI units: constants below it are moved as if they were so large


@dataclass(frozen=True, eq=False, repr=False)
class Gradient(BaseResult, Plotted):
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
            of_state = [one for one in state_names(self.run.robot) if f"{one}.".startswith(f"{name}.")]
            for by, value, error in zip(of_state or [name] * len(values), values, self.error[name], strict=True):
                rows.append((by, float(value), float(error)))
        return Table(("by", "derivative", "error bar"), tuple(rows))

    def _figure(self) -> Figure:
        names, values, errors = zip(*self.table().rows, strict=True)
        return plot_bars(f"{self.run.title}: objective {self.objective:.6g}", "derivative", names, values, errors)

    def __repr__(self) -> str:
        return f"objective {self.objective:.9g} ± {self.objective_error:.1e}\n{self.table()}"


def gradient(
    scene: Scene,
    duration: Positive | None = None,
    *,
    objective: Objective | str,
    wrt: Sequence[str] = ("q", "v"),
    accuracy: Positive = 1e-6,
    t_eval: ArrayLike | None = None,
    samples_per_second: Positive = 200.0,
    slopes: Slopes | None = None,
    progress: Report | None = None,
) -> Gradient:
    """Derivatives of one number of a run by many numbers of the scene.

        dF/dp = sum_n (dF/dx_n) dx_n/dp + F_p

    Parameters
    ----------
    scene : Scene
    duration : float, optional
        Simulated time, s; by default the scene's own.
    objective : callable, or str
        F: of a `Trajectory`, a number; or a name as `twolink optimize` has them, such as "x:ball".
    wrt : sequence of str
        By what, as in `sensitivities`.
    accuracy : float
        Bound on the global error of q as in `simulate`, and on the error of each derivative, relative to the largest
        of its name, or to 1 (in SI units) where that is larger.
    t_eval, samples_per_second : optional
        The samples, as in `simulate`, which the objective sees; the start and the end are among them.
    slopes : callable, optional
        (dF/dq (n, nv) in the tangent space, dF/dv (n, nv)) of a run, its states of effects being held. Without it, and
        along those states, derivatives are differences of F along the sensitivities: 4 calls of F a number.
    progress : callable, optional
        Called now and then with what is done, the total and a label; here simulated seconds.

    Returns
    -------
    Gradient

    Raises
    ------
    SceneError
        As `sensitivities`; the objective asks for more of a run than samples, energy, torques, accelerations and
        states of effects, or they change with a parameter in a way that is not followed (code "gradient-objective").
    AccuracyError
        As `sensitivities`.

    Notes
    -----
    The error bar comes from second solutions, as that of `sensitivities`. The derivatives are those along the
    finer one.
    """
    end, accuracy = duration_for(scene, duration), accuracy_of(accuracy)
    wanted, equations = wanted_of(scene, wrt), equations_of(scene)
    function = objective_of(objective, scene.robot)
    times = with_ends(sample_times(end, t_eval, samples_per_second), end)

    def attempt(own: Equations, run: Trajectory, tolerance: float) -> tuple[Gradient, float]:
        if run.interrupted:
            raise KeyboardInterrupt
        if run.events and run.t[-1] < times[-1]:
            raise SceneError("an event ends the run: its end moves with the parameters", argument="scene",
                             remedy="tl.optimize follows such ends; or leave the effect that ends it out",
                             code="gradient-end")  # fmt: skip
        found = _along(run, own, wanted, function, slopes, tolerance, accuracy)
        sizes = {name: accuracy * max(1.0, float(np.abs(values).max())) for name, values in found.by.items()}
        return found, max(float(bar.max()) / sizes[name] for name, bar in found.error.items())

    return refined(scene, equations, times, accuracy, attempt, in_time(progress, end))


def _along(
    run: Trajectory, equations: Equations, wanted: Wanted, function: Objective, slopes: Slopes | None, tolerance: float,
    accuracy: float,
) -> Gradient:  # fmt: skip
    """The gradient along a run, with its error bars."""
    constants = _constants(run, wanted, function)
    every = slopes is not None or _depends_on_earlier(run, function)
    samples = np.arange(len(run.t))[None if every else -1 :]
    results, values = list[np.ndarray](), list[float]()
    for nominal, s in along_solutions(run, equations, wanted, tolerance, samples):
        own = with_states(run, nominal) if results else run
        results.append(_by_columns(own, s, wanted, function, slopes, constants, STEP / 2 if results else STEP))
        values.append(value_of(function, own))
    total = results[1]
    bar = bound([np.abs(result - results[0]) for result in results[1:]])
    bar += ROUNDING * np.abs(total) + SLACK * accuracy * np.maximum(1.0, np.abs(total))
    if not np.isfinite(total).all():
        raise AccuracyError("the gradient is no finite number", where="objective", code="gradient-undefined",
                            remedy="ask for another number of the run")  # fmt: skip
    by = {name: total[columns] for name, columns in wanted.columns.items()}
    error = {name: bar[columns] for name, columns in wanted.columns.items()}
    off = float(bound([np.abs(np.asarray(value) - values[0]) for value in values[1:]]))
    return Gradient(run, values[0], off + float(np.spacing(abs(values[0]))), by, error, accuracy)


def _by_columns(
    run: Trajectory, s: np.ndarray, wanted: Wanted, function: Objective, slopes: Slopes | None,
    constants: dict[str, float], change: float,
) -> np.ndarray:  # fmt: skip
    """The derivatives (k,) of a function along S (n, tangent, k). constants: those that it uses besides, with steps."""
    nv, total, names = run.v.shape[1], np.zeros(s.shape[2]), wanted.variation.names
    if slopes is not None:
        given = [np.asarray(rows, dtype=float) for rows in slopes(run)]
        if any(rows.shape != run.v.shape for rows in given):
            raise SceneError(f"expected two arrays of shape {run.v.shape}, got {[rows.shape for rows in given]}",
                             argument="slopes", remedy="return dF/dq and dF/dv by the samples")  # fmt: skip
        total, s = np.einsum("nx,nxk->k", np.concatenate(given, axis=1), s[:, : 2 * nv]), s.copy()
        s[:, : 2 * nv] = 0.0  # what is left are the states of effects
    for k, column in enumerate(s.transpose(2, 0, 1)):
        weights = dict(zip(names, wanted.start[len(wanted.start) - len(names) :, k], strict=True))
        own = {name: weights[name] for name in constants if weights[name]}
        if own or column.any():
            largest = min((constants[name] for name in own), default=np.inf)
            variation = RunVariation(run, column[:, :nv], column[:, nv : 2 * nv], own, dz=column[:, 2 * nv :])
            total[k] += variation.derivative([function], largest, change)[0]
    return total


def _depends_on_earlier(run: Trajectory, function: Objective) -> bool:
    """True if a function depends on other samples than the last."""
    dq, dv = STEP * np.random.default_rng(0).uniform(-1.0, 1.0, (2, *run.v.shape))
    dz = STEP * np.random.default_rng(1).uniform(-1.0, 1.0, (len(run.t), len(run.states)))
    dq[-1] = dv[-1] = dz[-1] = 0.0
    return value_of(function, beside(run, dq, dv, {}, dz=dz)) != value_of(function, run)


def _constants(run: Trajectory, wanted: Wanted, function: Objective) -> dict[str, float]:
    """The constants among the parameters that a function uses besides the samples, with steps for them.

    Raises SceneError, code "gradient-objective", where constants that it uses change with a parameter indirectly.
    """
    variation, own = wanted.variation, value_of(function, run)
    segments = run.solution.segments if run.solution else ()
    steps = {name: SHARE * max(abs(nominal_value(segments[0].equations, name)), SMALL) for name in variation.constants}
    direct = {name: step for name, step in steps.items() if name in variation.names}

    def used(changes: dict[str, float]) -> bool:
        return bool(changes) and value_of(function, _with_constants(run, changes)) != own

    indirect = {name: step for name, step in steps.items() if name not in direct}
    if used(indirect) or (variation.has_friction and _uses_torques(run, function)):
        raise SceneError("energy or torques, which it uses, change with a parameter indirectly", argument="objective",
                         remedy="use samples only, or ask for physical constants and numbers of what acts",
                         code="gradient-objective")  # fmt: skip
    return direct if used(direct) else {}


def _uses_torques(run: Trajectory, function: Objective) -> bool:
    """True if a function asks for torques or accelerations."""
    try:
        function(replace(_with_constants(run, {}), solution=Unknown("a torque")))  # type: ignore[arg-type]
    except NotFollowedError:
        return True
    return False


def _with_constants(run: Trajectory, changes: dict[str, float]) -> Trajectory:
    """The samples of a run, with other constants by name."""
    still = np.zeros_like(run.v)
    return beside(run, still, still, changes, dz=np.zeros((len(run.t), len(run.states))))
