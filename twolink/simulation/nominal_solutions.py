"""Nominal solutions: those along which derivatives are taken, of the run and second ones, and the steps along them."""

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple, cast

import numpy as np

from twolink.algorithms.namespaces import Numbers
from twolink.errors import AccuracyError
from twolink.integrate.dense_output import DenseOutput
from twolink.integrate.derivatives.variational_legs import Leg, leg_at, leg_of, too_short, with_middles
from twolink.integrate.derivatives.variational_steps import VariationalSteps
from twolink.integrate.hybrid.modes import Mode
from twolink.integrate.hybrid.saltation import Jump, RecordingEngine, Saltation
from twolink.integrate.hybrid.state import RunState
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.formulas import loaded
from twolink.integrate.motion.scene_equations import with_parameters
from twolink.integrate.motion.state import Array
from twolink.integrate.solution import Solution
from twolink.integrate.solver import MethodChoice, has_columns, solve
from twolink.integrate.steps.methods import METHODS
from twolink.integrate.steps.perturbation import (
    NO_PERTURBATION,
    Companions,
    Perturbation,
    disturbed_solutions,
    finer_solution,
)
from twolink.simulation.error_bar import DISTURBED, SAFETY
from twolink.simulation.sensitivity_names import Wanted
from twolink.simulation.trajectory import Trajectory

# Of the steps of differences through events, in those of the run: of the finer solution, and of each disturbed one.
# What is moved by other steps is rounded otherwise, even from a state that is the same.
FINER, OTHERS = 0.5, (0.7, 1.3)


class Second(NamedTuple):
    """Settings of a second solution beside the run's; with a plain perturbation, of the run's own.

    The finer one shows truncation: it is not disturbed, and the steps of its derivatives are halved. The disturbed ones
    show rounding: they have the run's own setting. differences: the steps of differences through
    events, in those of the run's; their roundings are others.
    """

    perturbation: Perturbation
    differences: float = 1.0
    parts: int = 1  # of a step of the derivatives


class NominalSolution(NamedTuple):
    """A solution with the jumps at the ends of its segments, and where it began; without events neither."""

    dense: DenseOutput
    edges: list[tuple[float, float]]
    jumps: list[Jump]
    begun: RunState | None
    second: Second


class NominalSolutions:
    """The solutions of a run's equations along which derivatives are taken.

    Attributes: first, that of the run; saltation, for the jumps.
    """

    def __init__(self, run: Trajectory, equations: Equations, wanted: Wanted) -> None:
        self.run, self.equations, self.wanted, self.variation = run, equations, wanted, wanted.variation
        self._steps: dict[str, VariationalSteps] = {}
        self.saltation = Saltation(self.variation)
        dense = cast("DenseOutput", run.solution)
        self._choice = MethodChoice(METHODS[dense.method], dense.setting, "", dense.precision)
        plain = Second(NO_PERTURBATION)
        self._columns: tuple[Solution, Companions] | None = None
        self.first = self._nominal(dense, dense.t, dense.x, plain)
        if equations.has_events:
            self.first = self._solved(plain, dense.t)

    def times(self, nominal: NominalSolution) -> Array:
        """Times along a nominal solution, about as many as the run has steps."""
        return nominal.dense.t[:: max(1, len(nominal.dense.t) // max(1, self.run.cost.steps if self.run.cost else 1))]

    def legs(self, nominal: NominalSolution, times: Array, tolerance: float) -> Iterator[Leg]:
        """The legs of a solution, one a segment, between those of times (m,) that are in it."""
        for number, (begin, end) in enumerate(nominal.edges):
            inside = times[(times > begin) & (times < end)]
            breaks = np.array(nominal.dense.segments[number].equations.breaks(end))
            between = np.unique(np.concatenate([[begin], inside, breaks[breaks > begin], [end]]))
            yield leg_of(self._steps_of(nominal, number), nominal.dense, number, between, tolerance)

    def along(self, nominal: NominalSolution, legs: Iterable[Leg]) -> Iterator[tuple[Leg, Array]]:
        """The legs of a solution, each with S (m, tangent + p, k) at its times.

        Raises AccuracyError where that is no finite number, code "sensitivities-steps".
        """
        start = self.wanted.start
        start = start if nominal.begun is None else self.saltation.start(nominal.begun, start)
        for number, leg in enumerate(legs):
            s = leg.along(start)
            if not np.isfinite(s).all():
                raise too_short(float(leg.t[int(np.argmin(np.isfinite(s).all(axis=(1, 2))))]))
            yield leg, s
            jumps = nominal.jumps and number + 1 < len(nominal.edges)
            start = self.saltation(nominal.jumps[number], s[-1], nominal.second.differences) if jumps else s[-1]

    def beside(self, leg: Leg, nominal: NominalSolution, number: int) -> Leg:
        """The leg of a second solution beside one of the first, with the same steps or with every step halved.

        Of order 8, half the step has a 256th of the error.
        """
        begin, end = nominal.edges[number]
        own = leg.t
        if (begin, end) != (own[0], own[-1]) and own[-1] > own[0]:  # between events, which differ a little
            own = np.append(begin + (leg.t - leg.t[0])[:-1] * ((end - begin) / (leg.t[-1] - leg.t[0])), end)
        return leg_at(leg.steps, nominal.dense, number, own if nominal.second.parts == 1 else with_middles(own))

    def _on_one_side(self, nominal: NominalSolution, number: int) -> Equations:
        """The equations of a segment, on its sides of limits of effort: at its ends rounding would decide."""
        equations: Equations = nominal.dense.segments[number].equations
        if not equations.effort_limits:
            return equations
        middle = np.array([0.5 * sum(nominal.edges[number])])
        x = np.concatenate([nominal.dense.states_of(number, middle)[:, 0], equations.start[equations.moving :]])
        _, loads = loaded(equations, equations.mechanism, middle[0], x, Numbers)
        values = [float(np.squeeze(value)) for _, value in loads.limits]
        sides = (
            1.0 * (above < 0.0) - 1.0 * (below < 0.0) for below, above in zip(values[::2], values[1::2], strict=True)
        )
        return replace(equations, sides=tuple(sides))

    def _steps_of(self, nominal: NominalSolution, number: int) -> VariationalSteps:
        """The variational steps of a segment."""
        equations = with_parameters(self._on_one_side(nominal, number), self.variation.constants)
        mode = nominal.jumps[number].before.mode if nominal.jumps else Mode()
        gains = self.variation.gains(mode.idle, {k: slip for k, slip in mode.slip.items() if k not in mode.locked})
        if equations.content not in self._steps:
            self._steps[equations.content] = VariationalSteps(equations, gains)
        segment = nominal.dense.segments[number]
        return self._steps[equations.content].starting(
            equations, gains, None if segment.held is None else segment.numbers
        )

    def second_ones(self) -> list[Second]:
        """The finer solution and the disturbed ones."""
        finer = finer_solution(self._choice.method, self._choice.setting)
        disturbed = zip(disturbed_solutions(len(OTHERS)), OTHERS, strict=True)
        return [Second(finer, FINER, 2), *itertools.starmap(Second, disturbed)]

    def second(self, legs: Sequence[Leg], second: Second, others: Array | None = None) -> NominalSolution:
        """A second solution, at the times of the legs, between them, and at other ones (n,)."""
        times = np.unique(np.concatenate([leg.t for leg in legs]))
        every = np.union1d(times, 0.5 * (times[:-1] + times[1:]))
        every = every if others is None else np.union1d(every, others)
        return self._column(second, every) or self._solved(second, every)

    def _column(self, second: Second, times: Array) -> NominalSolution | None:
        """A second solution as a column of one batch with all others; None where it is solved by itself."""
        equations, choice, own = self.equations, self._choice, second.perturbation
        method, setting, precision = choice.method, choice.setting, choice.precision
        if equations.has_events or equations.sampling is not None or not has_columns(equations, method, precision):
            return None
        if self._columns is None:
            start = equations.start[: equations.moving]
            beside = Companions.of(tuple(one.perturbation for one in self.second_ones()), times, start, stride=1)
            self._columns = solve(equations, method, times, setting, None, precision, companions=beside), beside
        solution, beside = self._columns
        x = beside.x[:, beside.perturbations.index(own)].T
        if not (np.isfinite(x).all() and np.array_equal(beside.t, times)):
            return None  # alone it says why it cannot be solved
        return self._nominal(solution, times, x, second)

    def _solved(self, second: Second, times: Array) -> NominalSolution:
        """A solution, with its jumps."""
        jumps: list[Jump] = []
        begun, choice, perturbation = None, self._choice, second.perturbation
        if self.equations.has_events:
            engine = RecordingEngine(self.equations, choice.method, times, choice.setting, None, perturbation)
            engine.advance(engine.end)
            solution = engine.solution()
            jumps, begun = engine.jumps, engine.begun
        else:
            solution = solve(self.equations, choice.method, times, choice.setting, None, choice.precision, perturbation)
        return self._nominal(solution, solution.t, solution.x[: self.equations.moving], second, jumps, begun)

    def _nominal(
        self, solution: Solution | DenseOutput, t: Array, x: Array, second: Second, jumps: Sequence[Jump] = (),
        begun: RunState | None = None,
    ) -> NominalSolution:  # fmt: skip
        """A solution by states x (nq + nv, m) at times t (m,)."""
        choice, edges = self._choice, [*(segment.begin for segment in solution.segments), float(t[-1])]
        dense = DenseOutput(solution.segments, t, x, choice.method.name, choice.setting, choice.precision)
        return NominalSolution(dense, list(itertools.pairwise(edges)), list(jumps), begun, second)

    def require_alike(self, nominal: NominalSolution) -> None:
        """Require that a second solution has the segments of the first. Raises AccuracyError."""
        if not self.paired(nominal) == len(self.first.edges) == len(nominal.edges):
            end = nominal.edges[-1][0]
            raise AccuracyError("a more accurate motion follows more bounces", where=f"t = {end:.6g} s",
                                remedy="ask for more accuracy, or for a shorter duration",
                                code="sensitivity-undefined", t=end)  # fmt: skip

    def paired(self, nominal: NominalSolution) -> int:
        """Count the segments of a second solution that end as the run's do: all, but where one follows bounces farther.

        What ends the run does not count: it is at the last sample or a rounding beside it. Raises AccuracyError for
        other events.
        """
        jumps = self.first.jumps[:-1], nominal.jumps[:-1]
        both = [[(jump.guard and jump.guard.key, jump.before.t) for jump in each] for each in jumps]
        calm = [[jump.rest for jump in each if jump.rest > jump.before.t] for each in jumps]
        paired = _alike(*both)
        while (same := _alike(*both)) < max(map(len, both)):
            t = min(events[same][1] for events in both if len(events) > same)
            ends = [min((end for end in each if end >= t), default=np.inf) for each in calm]
            if np.isinf(ends).any():
                raise AccuracyError("a more accurate motion has other events: something is nearly touched, or several "
                                    "things happen in nearly the same instant", where=f"t = {t:.9g} s",
                                    remedy=f"ask for a duration below {t:.6g} s, or for more accuracy",
                                    code="sensitivity-undefined", t=t)  # fmt: skip
            both = [[*events[:same], *(event for event in events[same:] if event[1] > max(ends))] for events in both]
        return len(self.first.edges) if paired == len(jumps[0]) == len(jumps[1]) else paired


def bound(distances: Sequence[Array], share: float = 1.0) -> Array:
    """Error bounds from the distances to the second solutions: truncation by the finer one, rounding by the others.

    share: of the distance to the finer solution, where the result is nearer to the truth than the run is.
    """
    finer, *disturbed = distances
    return np.asarray(SAFETY * share * finer + DISTURBED[len(disturbed)] * np.max(disturbed, axis=0))


def _alike(ours: Sequence[tuple[object, float]], theirs: Sequence[tuple[object, float]]) -> int:
    """The number of events at the begin of two sequences that have the same guards."""
    alike = itertools.takewhile(lambda pair: pair[0][0] == pair[1][0], zip(ours, theirs, strict=False))
    return sum(1 for _ in alike)
