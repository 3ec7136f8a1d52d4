"""simulate: Scene -> Trajectory."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

import numpy as np

from twolink.dynamics.arguments import positive
from twolink.dynamics.kernels import heyoka
from twolink.errors import AccuracyError, SceneError
from twolink.integrate.equations import Equations
from twolink.integrate.event import Event
from twolink.integrate.failures import MAX_STEPS
from twolink.integrate.method_choice import SAFETY, Choice, choose, second_tolerance
from twolink.integrate.methods import METHODS
from twolink.integrate.perturbation import NO_PERTURBATION, Perturbation, second_solution
from twolink.integrate.scene_equations import equations_of
from twolink.integrate.solution import Progress, Solution
from twolink.integrate.solver import smallest_tolerance, solve
from twolink.integrate.taylor import Precision
from twolink.scenes import Scene
from twolink.scenes.scene import accuracy_of, duration_of
from twolink.simulation.trajectory import Cost, Trajectory

MAX_SAMPLES = 20_000_000
ASSEMBLED = 1e-9  # rad, m: a start moved by more is said
LARGEST_TOLERANCE = 0.1
ROUNDING = 16 * np.finfo(float).eps
PILOT_STEPS = 20_000  # at most, of the first try of a method of fixed steps


@dataclass(frozen=True)
class Solved:
    """A solution with what it was asked for and what it took."""

    choice: Choice
    solution: Solution
    seconds: float


def simulate(
    scene: Scene,
    duration: float | None = None,
    accuracy: float = 1e-6,
    *,
    method: str = "auto",
    samples: float = 200.0,
    verify: bool = True,
    precision: Precision = "double",
    tolerance: float | None = None,
    step: float | None = None,
    progress: Progress | None = None,
) -> Trajectory:
    """Simulate a scene for `duration` seconds.

    accuracy: bound on the global error of q at every sample, max |difference(q, q_exact)|, rad or m.
    method: "auto", the cheapest for the accuracy, or one of `twolink methods`.
    samples: samples a second; the first is at 0, the last at `duration`.
    verify: solve a second time, more accurately and from a start a few roundings away, and take the distance as the
        error bar; the settings are refined until the bar is below `accuracy`. Without it run.error is None: not
        verified.
    precision: "double", or "quad" for 33 digits by Taylor's method; the digits are in run.precise.
    tolerance, step: of the method, in place of what `accuracy` calls for; the error bar is then measured and reported,
        and is what it is.
    progress: called with the simulated time now and then.

    Raises AccuracyError when the accuracy cannot be kept; its `run` is the best that was found, with its error bar.
    """
    if not isinstance(scene, Scene):
        raise SceneError(f"expected a Scene, got {type(scene).__name__}", where="scene", remedy="tl.load_scene(...)")
    accuracy = accuracy_of(accuracy)
    times = _times(scene.duration if duration is None else duration_of(duration), samples)
    equations = equations_of(scene)
    choice = choose(equations, accuracy, float(times[-1]), method, precision)
    choice, free = _as_told(choice, method, tolerance, step)
    if verify and not (free or choice.method.adaptive):  # a pilot, whose error tells the step that is needed
        end = float(times[-1])
        choice = replace(choice, setting=min(max(choice.setting, end / PILOT_STEPS), end / 4))
    coarse = _solve(equations, choice, times, progress)
    before = compiling = 0.0  # seconds of solutions that were given up
    while verify and not coarse.solution.interrupted:
        margin = coarse.choice.setting if coarse.choice.method.adaptive else 0.0
        perturbation = second_solution(margin) if precision == "double" else NO_PERTURBATION
        fine = _solve(equations, _finer(coarse.choice, equations, accuracy), times, progress, perturbation)
        compiling += coarse.solution.compile_seconds + fine.solution.compile_seconds
        run = _verified(scene, equations, coarse, fine, 0.0 if free else accuracy, before)
        if run.cost is not None:
            run = replace(run, cost=replace(run.cost, compile_seconds=compiling))
        if run.error is None or free or run.error[-1] <= accuracy:
            return run
        before += coarse.seconds + fine.seconds
        refined = _refined(coarse, equations, accuracy, float(run.error[-1]), run)
        coarse = _solve(equations, refined, times, progress)
    return _trajectory(scene, equations, coarse, _cost(coarse))


def _solve(
    equations: Equations,
    choice: Choice,
    times: np.ndarray,
    progress: Progress | None,
    perturbation: Perturbation = NO_PERTURBATION,
) -> Solved:
    start = time.perf_counter()
    solution = solve(equations, choice.method, times, choice.setting, progress, choice.precision, perturbation)
    return Solved(choice, solution, time.perf_counter() - start - solution.compile_seconds)


def _as_told(choice: Choice, name: str, tolerance: float | None, step: float | None) -> tuple[Choice, bool]:
    """The choice with the caller's own setting, and whether there is one."""
    if tolerance is None and step is None:
        return choice, False
    if tolerance is not None and step is not None:
        raise SceneError("tolerance and step are both given", argument="step", remedy="give one")
    what, value = ("tolerance", tolerance) if step is None else ("step", step)
    given = positive(value, what, AccuracyError, "such as 1e-6")
    if step is None and given > LARGEST_TOLERANCE:
        raise AccuracyError(f"expected a number up to {LARGEST_TOLERANCE:g}, got {tolerance!r}", argument="tolerance",
                            remedy="such as 1e-6")  # fmt: skip
    if choice.method.adaptive != (step is None):
        kind = "chooses its steps by a tolerance" if choice.method.adaptive else "takes steps of one size"
        remedy = "give tolerance=" if choice.method.adaptive else "give step="
        raise SceneError(f"{choice.method.name} {kind}", where="method", argument=what, remedy=remedy)
    return replace(choice, setting=given, why=choice.why if name == "auto" else "asked for"), True


def _finer(choice: Choice, equations: Equations, accuracy: float) -> Choice:
    """What solves more accurately than the choice by construction."""
    method, setting = choice.method, choice.setting
    if not method.adaptive:
        return replace(choice, setting=setting / 2)
    if method.kind == "taylor" and choice.precision == "double" and not equations.analytic:
        return Choice(METHODS["dop853"], max(setting / 30, 1e-13), "its series may not hold")
    if setting / 4 > smallest_tolerance(method, choice.precision):
        least = smallest_tolerance(method, choice.precision)
        return replace(choice, setting=max(second_tolerance(method, setting), least))
    if choice.precision == "double" and equations.analytic and heyoka() is not None:
        return Choice(METHODS["taylor"], 1e-18, "more digits", "extended")
    raise _unreachable(accuracy)


def _refined(coarse: Solved, equations: Equations, accuracy: float, error: float, run: Trajectory) -> Choice:
    """The next setting to try. Raises AccuracyError when there is none, with what there is."""
    choice, excess = coarse.choice, error / accuracy
    if not choice.method.adaptive:
        setting = choice.setting * (0.5 / excess) ** (1 / choice.method.order)
        steps = run.t[-1] / setting
        if steps > MAX_STEPS:
            raise _too_small(choice, accuracy, steps, run)
        return replace(choice, setting=setting)
    least = smallest_tolerance(choice.method, choice.precision)
    if not equations.analytic:  # what is finer must have room below
        least *= 5.0
    if choice.setting <= least * 1.01:
        raise _out_of_reach(accuracy, error, run, choice)
    return replace(choice, setting=max(choice.setting * 0.5 / excess, least))


def _verified(
    scene: Scene, equations: Equations, coarse: Solved, fine: Solved, accuracy: float, before: float
) -> Trajectory:
    """The coarse solution with its distance from the fine one as its error bar."""
    cost = _cost(coarse)
    cost = replace(cost, verify_seconds=before + fine.seconds)
    run = _trajectory(scene, equations, coarse, cost)
    if fine.solution.interrupted:
        return replace(run, interrupted=True)
    # A bar must not vanish where the difference happens to change its sign.
    distance = SAFETY * _distance(equations, run, coarse, fine)
    if run.precise is None:  # what the rounding of the model's constants does to both solutions alike
        distance[1:] += ROUNDING * np.abs(run.q[1:]).max(axis=1, initial=0.0)
    error = np.maximum.accumulate(_ahead(distance))
    error[1:] += accuracy / 1000
    return replace(run, error=error, accuracy=accuracy or None)


def _ahead(distance: np.ndarray) -> np.ndarray:
    """The largest distance from each sample to some samples later: one alone may happen to be small."""
    later = np.array(distance)
    for shift in range(1, min(len(distance) - 1, 2 + len(distance) // 40)):
        later[1:-shift] = np.fmax(later[1:-shift], distance[1 + shift :])
    return later


def _distance(equations: Equations, run: Trajectory, coarse: Solved, fine: Solved) -> np.ndarray:
    """What the coarse solution's q is off at each sample, by the fine one, (n,)."""
    space, digits = equations.space, fine.solution.precise
    if digits is None:
        # Where an event ends both solutions, it does so at times of their own.
        same = np.minimum(np.arange(len(run.t)), len(fine.solution.t) - 1)
        late = np.abs(run.t - fine.solution.t[same]) * np.abs(run.v).max(axis=1, initial=0.0)
        distance: np.ndarray = space.distance(run.q, space.rows(fine.solution.x)[0][same]) + late
        method = coarse.choice.method  # a half step leaves an error of 2^-order
        return distance if method.adaptive else distance / (1.0 - 0.5**method.order)
    ours = coarse.solution.x.T if run.precise is None else run.precise
    off = np.abs(ours[:, : space.nq].astype(digits.dtype) - digits[:, : space.nq]).max(axis=1, initial=0.0)
    # Twice, since a rotation is twice its quaternion's angle; and doubles are rounded.
    rounded = np.abs(run.q).max(axis=1, initial=0.0) * np.finfo(float).eps if run.precise is None else 0.0
    return np.asarray((2.0 if space.curved else 1.0) * off.astype(float) + rounded)


def _cost(solved: Solved) -> Cost:
    solution = solved.solution
    return Cost(
        solved.choice.method.name,
        solved.choice.setting,
        solution.steps,
        solution.evaluations,
        solved.seconds,
        compile_seconds=solution.compile_seconds,
        rejected=solution.rejected,
        compiled=solution.compiled,
        why=solved.choice.why,
    )


def _trajectory(scene: Scene, equations: Equations, solved: Solved, cost: Cost) -> Trajectory:
    solution = solved.solution
    q, v = equations.space.rows(solution.x)
    events = solution.events
    if max(equations.assembled) > ASSEMBLED:
        moved = "q moved by {:.3g}, v by {:.3g}".format(*equations.assembled)
        events = (Event(0.0, "assembled", "loops", moved), *events)
    robots = [(piece.equations.robot, piece.samples) for piece in solution.pieces]
    same = all(robot is robots[0][0] for robot, _ in robots)
    return Trajectory(scene.robot, solution.t, q, v, None, cost, events, solution.interrupted,
                      precise=solution.precise, robots=() if same else robots)  # fmt: skip


def _times(duration: float, samples: float) -> np.ndarray:
    """0, 1/samples, 2/samples, ... below the duration, and the duration itself."""
    samples = positive(samples, "samples", SceneError, "such as 200 a second")
    if duration * samples > MAX_SAMPLES:
        raise SceneError(
            f"{duration * samples:.3g} samples, the limit is {MAX_SAMPLES:.0e}",
            argument="samples",
            remedy="ask for fewer a second, or a shorter duration",
        )
    times = np.arange(max(1, math.ceil(duration * samples - 1e-9)) + 1) / samples
    times[-1] = duration
    return times if times[-2] < duration else np.append(times[times < duration], duration)


def _unreachable(accuracy: float) -> AccuracyError:
    return AccuracyError(
        f"{accuracy:g} is below what can be verified in double precision",
        argument="accuracy",
        remedy='precision="quad", or the answer without an error bar: verify=False',
    )


def _out_of_reach(accuracy: float, error: float, run: Trajectory, choice: Choice) -> AccuracyError:
    until = run.trusted_until or 0.0
    more = "" if choice.precision == "quad" else ', or precision="quad"'
    failure = AccuracyError(
        f"{accuracy:g} cannot be kept in {choice.precision} precision: the error bar is {error:.1e} at the end",
        where=f"t = {until:.6g} s",
        remedy=f"it is kept up to then: ask for duration={until:.6g}, for less accuracy{more}",
        code="accuracy-limit",
        argument="accuracy",
        trusted_until=until,
        precision="" if choice.precision == "quad" else "quad",
    )
    failure.run = run
    return failure


def _too_small(choice: Choice, accuracy: float, steps: float, run: Trajectory) -> AccuracyError:
    error = AccuracyError(
        f"{choice.method.name} would need {steps:.1e} steps for {accuracy:g}",
        argument="method",
        remedy='method="auto", or less accuracy',
    )
    error.run = run
    return error
