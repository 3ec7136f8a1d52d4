"""sensitivities: derivatives of a simulated motion by its initial state and by physical constants."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np

from twolink.errors import AccuracyError, SceneError
from twolink.integrate.dense_output import DenseOutput
from twolink.integrate.equations import Equations
from twolink.integrate.method_choice import MethodChoice, steps_ratio
from twolink.integrate.methods import METHODS
from twolink.integrate.perturbation import Perturbation, second_solution
from twolink.integrate.scene_equations import equations_of, with_parameters
from twolink.integrate.solution import Progress
from twolink.integrate.solver import solve
from twolink.integrate.variational_legs import Leg, halved, leg_of
from twolink.integrate.variational_steps import VariationalSteps
from twolink.scenes import Scene
from twolink.scenes.scene import accuracy_of
from twolink.simulation.error_bar import ROUNDING, SAFETY, SAFETY_OF_SEVERAL, SLACK, error_bar
from twolink.simulation.refinement import finer, rounding_tolerance
from twolink.simulation.scene_run import simulate
from twolink.simulation.sensitivity_names import Wanted, wanted_of
from twolink.simulation.text import ShownAsText
from twolink.simulation.trajectory import Trajectory

MARGIN = 30.0  # times smaller than the accuracy the first tolerance is
STEPS = 1.3  # times as many as those of the run, at first
TRIALS = 5  # of smaller tolerances


@dataclass(frozen=True, eq=False, repr=False)
class Sensitivities(ShownAsText):
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
    accuracy : float
        The accuracy asked for, relative to the largest entry so far, or 1.
    """

    run: Trajectory
    q: dict[str, np.ndarray]
    v: dict[str, np.ndarray]
    error: dict[str, np.ndarray]
    accuracy: float

    def __repr__(self) -> str:
        worst = max((float(bar[-1]) for bar in self.error.values()), default=0.0)
        return f"<Sensitivities to {', '.join(self.q)}: {len(self.run.t)} samples, error bar {worst:.1e}>"


def sensitivities(
    scene: Scene,
    wrt: Sequence[str] = ("q", "v"),
    duration: float | None = None,
    accuracy: float = 1e-6,
    *,
    samples: float = 200.0,
    progress: Progress | None = None,
) -> Sensitivities:
    """Derivatives of a simulated motion by its initial state and by physical constants.

        S = d(q, v)/dp,   S' = (df/dx) S + df/dp

    Parameters
    ----------
    scene : Scene
    wrt : sequence of str
        By what: "q" and "v", the initial configuration (along tangent directions) and velocity; "q.JOINT" and
        "v.JOINT", those of a joint; a physical constant (`algorithms.mechanism.parameter_names`: "forearm.mass",
        "gravity.z", ...).
    duration : float, optional
        Simulated time, s; by default the scene's own.
    accuracy : float
        Bound on the global error of q as in `simulate`, and on the error of each derivative relative to its largest
        entry so far, or to 1 (in SI units) where that is larger.
    samples : float
        Samples a second.
    progress : callable, optional
        Called with the simulated time now and then.

    Returns
    -------
    Sensitivities

    Raises
    ------
    SceneError
        An argument does not fit, or a name is unknown (code "unknown-sensitivity").
    AccuracyError
        The motion cannot be simulated, or the accuracy cannot be kept.
    MissingExtraError
        heyoka is not installed.

    Notes
    -----
    Their error bar comes from a second solution, as that of the motion does: a more accurate motion, perturbed, with
    half the steps of the variational equations.
    """
    accuracy = accuracy_of(accuracy)
    wanted = wanted_of(scene, wrt)
    equations = equations_of(scene)
    if equations.has_events:
        raise SceneError("sensitivities through events are not known yet", where="effects",
                         remedy="leave out the effects that switch", code="sensitivities-events")  # fmt: skip
    sought = accuracy
    for _ in range(TRIALS):
        run = simulate(scene, duration, sought, samples=samples, progress=progress)
        found = _Found(run, equations, wanted, sought / MARGIN)
        result = found.result(accuracy)
        excess = max(found.excess(result, accuracy), 1e-300)
        if excess <= 1.0:
            return result
        sought *= 0.5 / excess
    raise AccuracyError(f"{accuracy:g} cannot be kept: the error bar is {excess:.1e} times as large",
                        argument="accuracy", remedy="ask for less accuracy, or a shorter duration",
                        code="accuracy-limit", run=run, trusted_until=0.0, precision="")  # fmt: skip


class _Found:
    """The sensitivities along a run, at a tolerance."""

    def __init__(self, run: Trajectory, equations: Equations, wanted: Wanted, tolerance: float) -> None:
        self.run, self.equations, self.wanted, self.tolerance = run, equations, wanted, tolerance
        self.steps: dict[str, VariationalSteps] = {}
        self.solution = cast("DenseOutput", run.solution)
        edges = [*(piece.begin for piece in self.solution.pieces), float(run.t[-1])]
        self.edges = list(itertools.pairwise(edges))

    def result(self, accuracy: float) -> Sensitivities:
        """The derivatives at the samples, with their error bars."""
        run, nv = self.run, self.equations.space.nv
        every = len(self.solution.t) / max(1.0, STEPS * (run.cost.steps if run.cost else 1))
        legs, states, start = [], [], self.wanted.start
        out = np.empty((len(run.t), 2 * nv, start.shape[1]))
        piece = np.searchsorted([begin for begin, _ in self.edges], run.t, side="right") - 1
        for number, (begin, end) in enumerate(self.edges):
            times = self.solution.t[:: max(1, int(every))]
            inside = times[(times > begin) & (times < end)]
            leg = leg_of(self._steps(number), self.solution, number, np.concatenate([[begin], inside, [end]]),
                         self.tolerance)  # fmt: skip
            s = leg.along(start)
            here = piece == number
            out[here] = leg.at(run.t[here], s)
            legs.append(leg)
            states.append(s[:, : 2 * nv])
            start = s[-1]
        distance = self._distance(legs, states)
        return self._with_bars(out, np.concatenate([leg.t for leg in legs]), distance, accuracy)

    def excess(self, result: Sensitivities, accuracy: float) -> float:
        """The largest error bar over what is asked for."""
        return max(float((bar / (accuracy * _scale(result, name))).max()) for name, bar in result.error.items())

    def _steps(self, number: int) -> VariationalSteps:
        """The variational steps of a piece."""
        own = self.solution.pieces[number].equations
        equations = with_parameters(own, self.wanted.parameters)
        if equations.content not in self.steps:
            self.steps[equations.content] = VariationalSteps(equations)
        steps = self.steps[equations.content]
        return steps if steps.equations.start is own.start else steps.starting(equations)

    def _distance(self, legs: Sequence[Leg], states: Sequence[np.ndarray]) -> np.ndarray:
        """The largest distance to second solutions of each column at the times of all legs, (m, k)."""
        solution = self.solution
        choice = MethodChoice(METHODS[solution.method], solution.setting, "", solution.precision)
        steps = self.run.cost.steps if self.run.cost else 0
        fine = finer(choice, self.equations, self.tolerance * MARGIN, steps)
        margin = choice.setting if choice.method.adaptive else 0.0
        perturbation = second_solution(steps_ratio(fine.method), margin)
        perturbations = [perturbation]
        if fine.precision == "double" and self.tolerance < rounding_tolerance(fine.method):
            perturbations.append(perturbation.opposite)
        distances = [self._distance_to(legs, states, fine, one) for one in perturbations]
        return np.asarray((SAFETY if len(distances) == 1 else SAFETY_OF_SEVERAL) * np.max(distances, axis=0))

    def _distance_to(
        self, legs: Sequence[Leg], states: Sequence[np.ndarray], choice: MethodChoice, perturbation: Perturbation
    ) -> np.ndarray:
        """The distance to one second solution."""
        times = np.unique(np.concatenate([leg.t for leg in legs]))
        every = np.unique(np.concatenate([times, 0.5 * (times[:-1] + times[1:])]))
        solution = solve(self.equations, choice.method, every, choice.setting, None, choice.precision, perturbation)
        dense = DenseOutput(solution.pieces, solution.t, solution.x[: self.equations.moving], choice.method.name,
                            choice.setting, choice.precision)  # fmt: skip
        out, start, rows = [], self.wanted.start, legs[0].steps.states
        for number, (leg, coarse) in enumerate(zip(legs, states, strict=True)):
            s = halved(leg, dense, number, leg.t).along(start)
            out.append(np.abs(s[:, :rows] - coarse).max(axis=1))
            start = s[-1]
        return np.concatenate(out)

    def _with_bars(self, s: np.ndarray, t: np.ndarray, distance: np.ndarray, accuracy: float) -> Sensitivities:
        """The result, with bars from distances (m, k) at times t (m,)."""
        run, nv = self.run, self.equations.space.nv
        after = np.minimum(np.searchsorted(t, run.t), len(t) - 1)
        q, v, error = {}, {}, {}
        for name, columns in self.wanted.columns.items():
            own = s[:, :, columns]
            q[name], v[name] = own[:, :nv], own[:, nv:]
            size = np.maximum.accumulate(np.abs(own).max(axis=(1, 2), initial=0.0))
            bar = error_bar(distance[:, columns].max(axis=1, initial=0.0), np.zeros(len(t)), 1.0)[after]
            bar = bar + ROUNDING * size + SLACK * accuracy * np.maximum(1.0, size)
            error[name] = bar
        return Sensitivities(run, q, v, error, accuracy)


def _scale(result: Sensitivities, name: str) -> np.ndarray:
    """The largest entry so far, or 1, (n,)."""
    both = np.concatenate([result.q[name], result.v[name]], axis=1)
    return np.asarray(np.maximum(1.0, np.maximum.accumulate(np.abs(both).max(axis=(1, 2), initial=0.0))))
