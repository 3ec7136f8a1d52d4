"""simulate, where contacts are stepped: runs of smaller steps, until their distance is below the accuracy."""

import functools
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from twolink.contact.choice import can_be_located
from twolink.contact.solver import solve_stepped, stepper_of
from twolink.contact.stepped_solution import SteppedSolution
from twolink.contact.stepping import ContactStepper
from twolink.errors import AccuracyError, ControllerError
from twolink.integrate.solution import Event, Progress, ambiguous_events
from twolink.integrate.steps.failures import failure
from twolink.scenes import Scene
from twolink.simulation.cost import Cost
from twolink.simulation.error_bar import CHANCE, STEPPED, error_bar
from twolink.simulation.trajectory import Trajectory

METHOD = "stepped"
FIRST = 1e-2  # s: the first step
STEPS = 200_000  # of a run
WORK = 3_000_000  # steps times degrees of freedom of a run, where no accuracy is asked for: as many on every machine
# Of the distance to a coarser run. Where in a step an impact falls is chance, and so are the errors of both: uniform,
# to D and to 2 D. Of one impact 1 / (4 STEPPED FINER) = 4 % of the estimates are too small, of several fewer.
FINER = 1.5
PARTING = 2.0  # of the distance to a run of much smaller steps: STEPPED covers it where errors follow the step
STRIDE = 32.0  # by which the step is made smaller at most before the error is looked at again
SMALLER = 4.0  # by which it is where a run has failed
ENOUGH = 1e-6  # rad, m: an estimate that is good enough where no accuracy is asked for
SURE = 1e-10  # rad, m: a first estimate above it may be small by chance, and is held against a next one
HELPS = 0.9  # of the last estimate: smaller steps help below it
TRIES = 2  # of smaller steps that do not help: chaotic motions have no smaller estimates
BLOWN_UP = 1e3  # rad, m: distances above tell of steps that are too long for stiff forces
WORTH = 0.1  # rad, m: accuracies above say nothing
TOO_LONG = ("step-too-large", "contact-not-solved")  # codes of runs that smaller steps may save
Solved = tuple[SteppedSolution, float]  # and the seconds it took


def most_steps(scene: Scene, stepper: ContactStepper) -> float:
    """The most steps of a run without an accuracy, as many on every machine."""
    return min(STEPS, WORK / (stepper.price * max(1, scene.robot.nv)))


def simulate_stepped(
    scene: Scene,
    times: np.ndarray,
    accuracy: float | None,
    step: float | None,
    progress: Progress | None,
    *,
    verify: bool,
    patience: float | None = None,
    stepper: ContactStepper | None = None,
) -> Trajectory:
    """The run of a scene whose contacts are stepped, with samples at the times (n,).

    step: the caller's own [s], whose error is estimated and reported; None: smaller ones until the estimate is below
    the accuracy. Without an accuracy steps become smaller while that helps, down to a count that is the same on every
    machine, and the best run is returned. Raises AccuracyError, with the best run, where an accuracy takes too many
    steps. patience: of wall clock [s], for either. stepper: of the scene, where there is one.
    """
    stepper = stepper or stepper_of(scene)
    solve = functools.partial(_solved, scene, stepper, times, progress)
    if step is None:
        span, limit = float(times[-1] - times[0]), patience or math.inf
        shortest = span / (most_steps(scene, stepper) if accuracy is None else STEPS)
        return _StepRefinement(scene, solve, span, accuracy, shortest, limit).run(verify=verify)
    coarse, seconds = solve(step, 0)
    if not verify or coarse.interrupted:
        return _trajectory(scene, coarse, seconds)
    fine, more = solve(step, 1)
    if fine.interrupted:
        return _trajectory(scene, coarse, seconds, more)
    off, events = _apart(coarse, fine)  # of first order: half the step has half of it
    return _trajectory(scene, coarse, seconds, more, 2.0 * off, events=events)


def _solved(
    scene: Scene, stepper: ContactStepper, times: np.ndarray, progress: Progress | None, step: float, halvings: int
) -> Solved:
    start = time.perf_counter()
    try:
        solution = solve_stepped(stepper, times, step, progress, halvings)
    except ControllerError as error:
        error.run = _trajectory(scene, error.run, time.perf_counter() - start)
        raise
    return solution, time.perf_counter() - start


def _apart(coarse: SteppedSolution, fine: SteppedSolution) -> tuple[np.ndarray, list[Event]]:
    """The distance of two solutions at each sample (n,), rad or m, larger behind an ambiguous tick; and those ticks.

    With it the bounces that the better of them has not followed: where both have come to rest, they have no distance.
    """
    off = np.asarray(coarse.segments[0].equations.space.distance(coarse.q, fine.q)) + fine.unfollowed
    found = [] if coarse.loop is None or fine.loop is None else coarse.loop.ambiguous_beside(fine.loop)
    if found:  # which branch the motion takes is chance
        off[coarse.t > found[0][0]] *= CHANCE
    return off, ambiguous_events(found)


@dataclass
class _StepRefinement:
    """Runs of smaller and smaller steps over a time `span`, s.

    shortest: the smallest step [s], if the patience [s of wall clock] admits it. best: the run of the least estimate
    so far. least, last: the estimates of that one and of the last one. tries: of smaller steps that did not help.
    tried: what was, in words.
    """

    scene: Scene
    solve: Callable[[float, int], Solved]
    span: float
    accuracy: float | None
    shortest: float
    patience: float
    best: Trajectory | None = None
    least: float = math.inf
    last: float = math.inf
    tries: int = 0
    tried: list[str] = field(default_factory=list)
    began: float = field(default_factory=time.perf_counter)

    def run(self, *, verify: bool) -> Trajectory:
        """The run whose estimate is below the accuracy, or the best. Its cost says what was tried."""
        run = self._found(verify=verify)
        return with_reason(run, f"tried {', '.join(self.tried)}") if self.tried else run

    def _found(self, *, verify: bool) -> Trajectory:
        step, halvings = min(FIRST, self.span / 4), 0
        coarse: Solved | None = None
        while True:
            now = step / 2**halvings
            try:
                coarse = coarse or self.solve(step, halvings)
                if not verify or coarse[0].interrupted:
                    return _trajectory(self.scene, *coarse)
                fine = self.solve(step, halvings + 1)
                if fine[0].interrupted:
                    return _trajectory(self.scene, *coarse)
                first, run = self.best is None, self._estimated(coarse[0], *fine)
            except AccuracyError as error:
                self.tried.append(f"{now:.2g} s: {error.code}")
                if error.code not in TOO_LONG or now / SMALLER < self._smallest(now, 0.0):
                    return self._ended(now, error)
                step, halvings, coarse = now / SMALLER, 0, None
                continue
            if self.last <= (self.accuracy or ENOUGH) and (not first or self.last < SURE):
                return run
            wanted = self._wanted(fine[0].step, fine[1])
            if wanted is None:
                return self._ended(now / 2)
            coarse, halvings = fine, halvings + 1
            if wanted < now / 8:
                step, halvings, coarse = max(wanted, now / 2 / STRIDE), 0, None

    def _estimated(self, coarse: SteppedSolution, fine: SteppedSolution, seconds: float) -> Trajectory:
        """The run of the smaller steps, with its estimate."""
        others, (off, events) = time.perf_counter() - self.began - seconds, _apart(coarse, fine)
        if off.max() > BLOWN_UP:
            raise failure("step-too-large", float(fine.t[-1]), step=fine.step)
        run = _trajectory(self.scene, fine, seconds, others, FINER * off, self.accuracy, events)
        self._refute(fine)
        error = float(run.error[-1]) if run.error is not None else 0.0
        self.tries += error > HELPS * self.last
        self.tried.append(f"{fine.step:.2g} s: estimate {error:.1g}")
        if error < self.least:
            self.best, self.least = run, error
        self.last = error
        return run

    def _refute(self, finer: SteppedSolution) -> None:
        """Let the best run's estimate cover its distance to a finer one, which may have parted from both its halves."""
        if self.best is not None and self.best.error is not None:
            gap = finer.segments[0].equations.space.distance(self.best.q, finer.q)
            error = np.maximum(self.best.error, error_bar(gap, np.zeros_like(gap), PARTING))
            self.best, self.least = replace(self.best, error=error), float(error[-1])

    def _smallest(self, now: float, seconds: float) -> float:
        """The smallest step that there are steps and time for. seconds: of a run with steps now."""
        left = self.patience - (time.perf_counter() - self.began)
        return max(self.shortest, seconds * now / left) if left > 0.0 else math.inf

    def _wanted(self, now: float, seconds: float) -> float | None:
        """The step that the accuracy calls for; None where it is too small, or smaller ones do not help."""
        wanted, smallest = 0.7 * now * (self.accuracy or ENOUGH) / self.last, self._smallest(now, seconds)
        if self.accuracy is not None:
            return None if wanted < smallest else wanted
        return None if self.tries >= TRIES or now / 2 < smallest else max(wanted, 3.0 * smallest)

    def _ended(self, now: float, error: AccuracyError | None = None) -> Trajectory:
        """The best run; raises AccuracyError where there is none, or not of the accuracy. now: the smallest step, s."""
        if self.best is not None and self.least <= (self.accuracy or math.inf):
            return self.best
        if error is None:
            raise self._too_many_steps(now, self.accuracy or ENOUGH)
        if error.code not in TOO_LONG:
            raise error
        raise AccuracyError(f"{error.what}, with steps of {now:.1g} s too", where=error.where, code=error.code,
                            remedy='give softer springs and controllers, or contact="located"',
                            **{**error.data, "run": self.best}) from None  # fmt: skip

    def _too_many_steps(self, now: float, accuracy: float) -> AccuracyError:
        steps = self.span * self.last / (now * accuracy)
        smaller = f"accuracy={2.0 * self.least:.0e}, or " if 2.0 * self.least <= WORTH else ""
        until = 0.0 if self.best is None else self.best.trusted_until or 0.0
        located = ', contact="located"' if can_be_located(self.scene) else ""
        longer = f" and more than {self.patience:g} s" if math.isfinite(self.patience) else ""
        return AccuracyError(f"{accuracy:g} would take about {steps:.0e} steps{longer}, for stepping is of first order",
                             where=f"t = {until:.6g} s", argument="accuracy", code="too-many-steps", run=self.best,
                             remedy=f"give {smaller}no accuracy for the best effort (error.run, with the estimate "
                                    f"{self.least:.1g}){located}, or step={now:.1g}")  # fmt: skip


def with_reason(run: Trajectory, more: str) -> Trajectory:
    """The run with one more reason for the way it was solved."""
    return run if run.cost is None else replace(run, cost=replace(run.cost, why=f"{run.cost.why}; {more}"))


def _trajectory(
    scene: Scene,
    solution: SteppedSolution,
    seconds: float,
    verifying: float = 0.0,
    distance: np.ndarray | None = None,
    accuracy: float | None = None,
    events: Sequence[Event] = (),
) -> Trajectory:
    """The trajectory of a stepped solution. distance: to its neighbour at each sample (n,), rad or m."""
    record = solution.record
    cost = Cost(METHOD, None, record.steps, record.steps, seconds, verifying, rejected=record.halved,
                compiled=solution.compiled, why="stepped through", step=solution.step)  # fmt: skip
    error = None if distance is None else error_bar(distance, np.zeros_like(distance), STEPPED)
    return Trajectory(scene.robot, solution.t, solution.q, solution.v, error, cost, events, solution.interrupted,
                      accuracy=accuracy, solution=solution, title=scene.title, estimated=True, scene=scene)  # fmt: skip
