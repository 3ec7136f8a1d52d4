"""Derivatives along a run, and their distance to those along second solutions."""

import itertools
from collections.abc import Sequence
from typing import NamedTuple, cast

import numpy as np

from twolink.errors import AccuracyError
from twolink.integrate.dense_output import DenseOutput
from twolink.integrate.equations import Equations
from twolink.integrate.hybrid.modes import Mode
from twolink.integrate.hybrid.saltation import Jump, RecordingEngine, Saltation
from twolink.integrate.hybrid.state import RunState
from twolink.integrate.method_choice import MethodChoice, steps_ratio
from twolink.integrate.methods import METHODS
from twolink.integrate.perturbation import NO_PERTURBATION, Perturbation, second_solution
from twolink.integrate.scene_equations import with_parameters
from twolink.integrate.solver import from_shifted_start, solve
from twolink.integrate.variational_legs import Leg, halved, leg_of
from twolink.integrate.variational_steps import VariationalSteps
from twolink.simulation.error_bar import SAFETY, SAFETY_OF_SEVERAL
from twolink.simulation.refinement import finer, rounding_tolerance
from twolink.simulation.sensitivity_names import Wanted
from twolink.simulation.trajectory import Trajectory

INTERPOLATED = 1 / 64  # of an interpolation's error, what is left of it with twice the nodes: 1 / 65536 by its order
# Of the distance, where the derivatives are those along the second solution: their steps are halved, of order 8, and
# its motion is 10 times or more as accurate, so that a tenth of the distance would do.
OF_FINER = 0.25
SMALLER = 100.0  # tolerance of the steps along a second solution of other pieces


class Course(NamedTuple):
    """A solution with the jumps at the ends of its pieces, and where it began; without events neither."""

    dense: DenseOutput
    edges: list[tuple[float, float]]
    jumps: list[Jump]
    begun: RunState | None


class SensitivityRun:
    """The derivatives along a run, with steps to a tolerance.

    Attributes: t (m,), the times between steps; distance (m, k), of each column to second solutions, times a factor of
    safety; s (n, 2 nv, k), at the samples of the run.
    """

    def __init__(
        self, run: Trajectory, equations: Equations, wanted: Wanted, accuracy: float, tolerance: float
    ) -> None:
        self.run, self.equations, self.wanted = run, equations, wanted
        self.accuracy, self.tolerance = accuracy, tolerance
        self._steps: dict[str, VariationalSteps] = {}
        self._saltation = Saltation(wanted.neighbours)
        dense = cast("DenseOutput", run.solution)
        self._choice = MethodChoice(METHODS[dense.method], dense.setting, "", dense.precision)
        course = _course_of(dense, float(run.t[-1]))
        if equations.has_events:
            course = self._solved(self._choice, dense.t, NO_PERTURBATION)
        self._course = course
        self.s, legs, states = self._along(course, run.t if course.jumps else run.t[:0], tolerance)
        self.t = np.concatenate([leg.t for leg in legs])
        self._fine: list[tuple[Leg, np.ndarray]] = []
        self.distance = self._distance(legs, states)
        if not course.jumps:
            self.s = self._interpolated(run.t)

    def _solved(self, choice: MethodChoice, times: np.ndarray, perturbation: Perturbation) -> Course:
        """A solution, with its jumps."""
        jumps: list[Jump] = []
        begun = None
        if self.equations.has_events:
            equations = from_shifted_start(self.equations, perturbation)
            engine = RecordingEngine(equations, choice.method, times, choice.setting, None, perturbation)
            solution = engine.solution()
            jumps, begun = engine.jumps, engine.begun
        else:
            solution = solve(self.equations, choice.method, times, choice.setting, None, choice.precision, perturbation)
        dense = DenseOutput(solution.pieces, solution.t, solution.x[: self.equations.moving], choice.method.name,
                            choice.setting, choice.precision)  # fmt: skip
        return _course_of(dense, float(solution.t[-1]), jumps, begun)

    def _start(self, course: Course) -> np.ndarray:
        """S at the start."""
        return self.wanted.start if course.begun is None else self._saltation.start(course.begun, self.wanted.start)

    def _after(self, course: Course, number: int, s: np.ndarray) -> np.ndarray:
        """S after the end of a piece."""
        if not course.jumps or number + 1 == len(course.edges):
            return s
        return self._saltation(course.jumps[number], s)

    def _along(
        self, course: Course, samples: np.ndarray, tolerance: float
    ) -> tuple[np.ndarray, list[Leg], list[np.ndarray]]:
        """S at sample times (n,), the legs, and S (., 2 nv + p, k) at their times."""
        run, rows, start = self.run, 2 * self.equations.space.nv, self._start(course)
        every = max(1, len(course.dense.t) // max(1, run.cost.steps if run.cost else 1))
        times = course.dense.t[::every]
        legs, states, out = list[Leg](), list[np.ndarray](), np.empty((len(samples), rows, start.shape[1]))
        piece = np.maximum(np.searchsorted([begin for begin, _ in course.edges], samples, side="right") - 1, 0)
        for number, (begin, end) in enumerate(course.edges):
            inside = times[(times > begin) & (times < end)]
            leg = leg_of(self._steps_of(course, number), course.dense, number, np.concatenate([[begin], inside, [end]]),
                         tolerance)  # fmt: skip
            s = leg.along(start)
            here = piece == number
            out[here] = leg.at(samples[here], s)
            legs.append(leg)
            states.append(s)
            start = self._after(course, number, s[-1])
        return out, legs, states

    def _steps_of(self, course: Course, number: int) -> VariationalSteps:
        """The variational steps of a piece."""
        neighbours = self.wanted.neighbours
        equations = with_parameters(course.dense.pieces[number].equations, neighbours.constants)
        mode = course.jumps[number].before.mode if course.jumps else Mode()
        gains = neighbours.gains(mode.idle, {k: slip for k, slip in mode.slip.items() if k not in mode.locked})
        if equations.content not in self._steps:
            self._steps[equations.content] = VariationalSteps(equations, gains)
        return self._steps[equations.content].starting(equations, gains)

    def _distance(self, legs: Sequence[Leg], states: Sequence[np.ndarray]) -> np.ndarray:
        """The largest distance to second solutions of each column at the times of all legs, (m, k), times a factor."""
        choice = self._choice
        fine = finer(choice, self.equations, self.accuracy, self.run.cost.steps if self.run.cost else 0)
        first = second_solution(steps_ratio(fine.method), choice.setting if choice.method.adaptive else 0.0)
        perturbations = [first]
        if fine.precision == "double" and self.tolerance < rounding_tolerance(fine.method):
            perturbations.append(first.opposite)
        distances = [self._distance_to(legs, states, fine, one) for one in perturbations]
        safety = SAFETY_OF_SEVERAL
        if len(distances) == 1:
            safety = SAFETY if self._course.jumps else OF_FINER * SAFETY
        return np.asarray(safety * np.max(distances, axis=0))

    def _distance_to(
        self, legs: Sequence[Leg], states: Sequence[np.ndarray], choice: MethodChoice, perturbation: Perturbation
    ) -> np.ndarray:
        """The distance to one second solution."""
        times = np.unique(np.concatenate([leg.t for leg in legs]))
        course = self._solved(choice, np.union1d(times, 0.5 * (times[:-1] + times[1:])), perturbation)
        out, start, rows = [], self._start(course), 2 * self.equations.space.nv
        paired = self._paired(course)
        for number, (leg, coarse) in enumerate(zip(legs[:paired], states[:paired], strict=True)):
            begin, end = course.edges[number]
            own = leg.t
            if (begin, end) != (own[0], own[-1]) and own[-1] > own[0]:  # between events, which differ a little
                own = np.append(begin + (leg.t - leg.t[0])[:-1] * ((end - begin) / (leg.t[-1] - leg.t[0])), end)
            fine = halved(leg, course.dense, number, own)
            s = fine.along(start)
            out.append(np.abs(s[::2, :rows] - coarse[:, :rows]).max(axis=1))
            if not course.jumps:
                between = np.abs(s[1::2, :rows] - leg.at(fine.t[1::2], coarse, interpolating=True)).max(axis=1)
                out[-1][1:] = np.maximum(out[-1][1:], INTERPOLATED * between)
                self._fine.append((fine, s))
            start = self._after(course, number, s[-1])
        if paired < len(legs):
            out.append(self._distance_in_time(legs[paired:], states[paired:], course))
        return np.concatenate(out)

    def _interpolated(self, samples: np.ndarray) -> np.ndarray:
        """S (n, 2 nv, k) at sample times, from that along the first of the second solutions, at twice as many times."""
        fine = self._fine[: len(self._course.edges)]
        piece = np.maximum(np.searchsorted([leg.t[0] for leg, _ in fine], samples, side="right") - 1, 0)
        return np.concatenate([leg.at(samples[piece == number], s, interpolating=True)
                               for number, (leg, s) in enumerate(fine)])  # fmt: skip

    def _distance_in_time(self, legs: Sequence[Leg], states: Sequence[np.ndarray], course: Course) -> np.ndarray:
        """The distance to a second solution that follows bounces farther, at the times of the legs.

        Not at events, nor while only one of the two follows bounces: there velocities differ by what an impact changes.
        """
        times = np.concatenate([leg.t for leg in legs])
        other, _, _ = self._along(course, times, self.tolerance / SMALLER)
        distance = np.abs(other - np.concatenate(states)[:, : other.shape[1]]).max(axis=1)
        for jump in (*self._course.jumps[:-1], *course.jumps[:-1]):
            distance[(times == jump.before.t) | ((times > jump.before.t) & (times < jump.rest))] = 0.0
        return np.asarray(distance)

    def _paired(self, course: Course) -> int:
        """How many pieces of a second solution end as those of the run do: all, but where one follows bounces farther.

        What ends the run does not count: it is at the last sample or a rounding beside it. Raises AccuracyError for
        other events.
        """
        jumps = self._course.jumps[:-1], course.jumps[:-1]
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
        return len(self._course.edges) if paired == len(jumps[0]) == len(jumps[1]) else paired


def _alike(ours: Sequence[tuple[object, float]], theirs: Sequence[tuple[object, float]]) -> int:
    """How many events at the begin of two sequences have the same guards."""
    alike = itertools.takewhile(lambda pair: pair[0][0] == pair[1][0], zip(ours, theirs, strict=False))
    return sum(1 for _ in alike)


def _course_of(dense: DenseOutput, end: float, jumps: Sequence[Jump] = (), begun: RunState | None = None) -> Course:
    edges = [*(piece.begin for piece in dense.pieces), end]
    return Course(dense, list(itertools.pairwise(edges)), list(jumps), begun)
