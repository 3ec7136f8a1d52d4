"""simulate: Scene -> Trajectory."""

import functools
import time
from dataclasses import replace

import numpy as np

from twolink.contact.choice import choose_way
from twolink.dynamics import Robot
from twolink.dynamics.arguments import positive
from twolink.errors import AccuracyError, SceneError
from twolink.integrate.dense_output import DenseOutput
from twolink.integrate.equations import Equations
from twolink.integrate.event import Event
from twolink.integrate.first_steps import count, rate_name
from twolink.integrate.method_choice import MethodChoice, choose
from twolink.integrate.perturbation import NO_PERTURBATION, Perturbation
from twolink.integrate.scene_equations import equations_of
from twolink.integrate.solution import Progress, Solution
from twolink.integrate.solver import solve
from twolink.integrate.taylor import Precision
from twolink.scenes import Scene
from twolink.scenes.scene import accuracy_of
from twolink.simulation.certificate import certificate
from twolink.simulation.cost import Cost
from twolink.simulation.error_bar import SLACK, bar_of_run
from twolink.simulation.refinement import limit_of_loops, refined
from twolink.simulation.sampling import duration_for, sample_times, spread_out, with_looks
from twolink.simulation.trajectory import Trajectory
from twolink.simulation.verification import SecondSolutions, Solved, second_solutions

MAX_SAMPLES = 20_000_000
LOOKS, MAX_LOOKS = 41, 400  # times at which errors are looked at, at least and about at most
ASSEMBLED = 1e-9  # rad, m: a start that was moved by more is an event
MAX_TOLERANCE = 0.1
PILOT_STEPS = 20_000  # at most, of the first try of a method of fixed steps
NOT_LOCATED = ("no-impact", "no-consistent-mode", "indeterminate-forces", "no-single-point",
               "events-without-end")  # fmt: skip  # codes of contacts that stepping may solve


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
    contact: str | None = None,
) -> Trajectory:
    """Simulate a scene.

    Parameters
    ----------
    scene : Scene
    duration : float, optional
        Simulated time, s; by default the scene's own.
    accuracy : float
        Bound on the global error of q at every sample, max |difference(q, q_exact)|, rad or m.
    method : str
        "auto", the cheapest for the accuracy, or one of `twolink methods`.
    samples : float
        Samples a second; the first is at 0, the last at `duration`.
    verify : bool
        Solve a second time, more accurately and perturbed, and take the distance as the error bar; the settings are
        refined until the bar is below `accuracy`. Without it run.error is None: not verified.
    precision : {"double", "quad"}
        "quad" for 33 digits by Taylor's method; the digits are in run.precise.
    tolerance, step : float, optional
        Of the method, in place of what `accuracy` calls for, the step in s; the error bar is measured and reported.
    progress : callable, optional
        Called with the simulated time now and then.
    contact : {"located", "stepped"}, optional
        How contacts are computed: each one located, with an error bar; or stepped through, with an error that is
        estimated (run.bound). By default as `explain` says.

    Returns
    -------
    Trajectory

    Raises
    ------
    AccuracyError
        The accuracy cannot be kept (code "accuracy-limit", with data trusted_until [s] and precision, the one that
        would reach further, or ""); its `run` is the best trajectory, with its error bar. Or the motion cannot be
        solved (codes "steps-collapsed", "loops-singular", "not-finite", "too-many-steps").
    SceneError
        An argument does not fit.
    """
    end, accuracy = duration_for(scene, duration), accuracy_of(accuracy)
    times = sample_times(end, samples, MAX_SAMPLES)
    way = choose_way(scene, contact)
    if way.way == "stepped":
        return _stepped(scene, times, accuracy, method, tolerance, step, precision, progress, verify=verify)
    equations = equations_of(scene)
    choice, measured = _with_setting(choose(equations, accuracy, end, method, precision), method, tolerance, step)
    if verify and not (measured or choice.method.adaptive):  # a pilot, whose error tells the step that is needed
        choice = replace(choice, setting=min(max(choice.setting, end / PILOT_STEPS), end / 4))
    try:
        return run_of(scene, equations, choice, times, accuracy, progress, measured=measured, verify=verify)
    except AccuracyError as error:
        if way.way == "located" and error.code in NOT_LOCATED:
            parts = {"where": error.where, "code": error.code, "run": error.run, **error.data}
            remedy = f'{error.remedy}; or contact="stepped" and step=1e-3, whose error is estimated'
            raise AccuracyError(error.what, remedy=remedy, **parts) from None
        raise


def _stepped(
    scene: Scene,
    times: np.ndarray,
    accuracy: float,
    method: str,
    tolerance: float | None,
    step: float | None,
    precision: Precision,
    progress: Progress | None,
    *,
    verify: bool,
) -> Trajectory:
    """The run of a scene whose contacts are stepped, which has a step and no method."""
    from twolink.simulation.stepped_run import simulate_stepped  # which other scenes do not load

    for argument, given in (("method", method != "auto"), ("tolerance", tolerance is not None),
                            ("precision", precision != "double")):  # fmt: skip
        if given:
            raise SceneError("stepped contacts have a method of their own, in double precision", argument=argument,
                             remedy="leave it out, or give step=")  # fmt: skip
    h = None if step is None else positive(step, "step", AccuracyError, "such as 1e-3")
    return simulate_stepped(scene, times, accuracy, h, progress, verify=verify)


def run_of(
    scene: Scene,
    equations: Equations,
    choice: MethodChoice,
    times: np.ndarray,
    accuracy: float,
    progress: Progress | None = None,
    *,
    measured: bool = False,
    verify: bool = True,
) -> Trajectory:
    """The run of a scene from the start of its equations, as `simulate` returns it for samples at the times (n,).

    measured: the setting of the choice is the caller's own, and is not refined.
    """
    all_times = with_looks(times, LOOKS) if verify else times
    looks = spread_out(len(all_times), MAX_LOOKS)
    solved = functools.partial(_solve, equations, all_times, progress)
    solved_again = functools.partial(_solve, equations, all_times[looks], progress)
    coarse, others = solved(choice), list[Solved]()
    verifying = compiling = 0.0
    run: Trajectory | None = None
    try:
        while verify and not coarse.solution.interrupted:
            kept = others
            second = second_solutions(_looked_at(coarse, looks), solved_again, equations, accuracy, kept)
            others = second.solutions
            verifying += sum(other.seconds for other in others if other not in kept)
            compiling += sum(one.solution.compile_seconds for one in (coarse, *others) if one not in kept)
            cost = replace(_cost(coarse), verify_seconds=verifying, compile_seconds=compiling)
            run = _trajectory(scene, equations, coarse, cost, times, None if measured else accuracy, looks, second)
            if run.error is None or measured or run.error[-1] <= accuracy:
                return run
            verifying += coarse.seconds
            coarse = solved(refined(coarse.choice, equations, accuracy, run))
    except AccuracyError as error:
        raise limit_of_loops(error, coarse.choice, equations, accuracy, run) from None
    return _trajectory(scene, equations, coarse, _cost(coarse), times, None, looks)


def _solve(
    equations: Equations,
    times: np.ndarray,
    progress: Progress | None,
    choice: MethodChoice,
    perturbation: Perturbation = NO_PERTURBATION,
) -> Solved:
    start = time.perf_counter()
    solution = solve(equations, choice.method, times, choice.setting, progress, choice.precision, perturbation)
    seconds = time.perf_counter() - start - solution.compile_seconds
    if choice.method.kind == "scipy":
        count(rate_name(equations), seconds)
    return Solved(choice, solution, seconds)


def _looked_at(solved: Solved, looks: np.ndarray) -> Solved:
    """The samples of a solution at which its error is looked at."""
    solution = solved.solution
    numbers = _numbers(solution, looks)
    precise = None if solution.precise is None else solution.precise.take(numbers, axis=0)
    some = replace(solution, t=solution.t.take(numbers), x=solution.x.take(numbers, axis=1), precise=precise)
    return replace(solved, solution=some)


def _numbers(solution: Solution, looks: np.ndarray) -> np.ndarray:
    """The numbers of these samples, and of the last one of a solution that an event ended before."""
    last = len(solution.t) - 1
    return looks if looks[-1] == last else np.append(looks[looks < last], last)


def _with_setting(
    choice: MethodChoice, name: str, tolerance: float | None, step: float | None
) -> tuple[MethodChoice, bool]:
    """The choice with the caller's own setting, and whether there is one."""
    if tolerance is None and step is None:
        return choice, False
    if tolerance is not None and step is not None:
        raise SceneError("tolerance and step are both given", argument="step", remedy="give one")
    argument, value = ("tolerance", tolerance) if step is None else ("step", step)
    setting = positive(value, argument, AccuracyError, "such as 1e-6")
    if step is None and setting > MAX_TOLERANCE:
        raise AccuracyError(f"expected a number up to {MAX_TOLERANCE:g}, got {tolerance!r}", argument="tolerance",
                            remedy="such as 1e-6")  # fmt: skip
    if choice.method.adaptive != (step is None):
        kind = "chooses its steps by a tolerance" if choice.method.adaptive else "takes steps of one size"
        remedy = "give tolerance=" if choice.method.adaptive else "give step="
        raise SceneError(f"{choice.method.name} {kind}", argument="method", remedy=remedy)
    return replace(choice, setting=setting, why=choice.why if name == "auto" else "asked for"), True


def _cost(solved: Solved) -> Cost:
    choice, solution = solved.choice, solved.solution
    return Cost(
        choice.method.name,
        choice.setting if choice.method.adaptive else None,
        solution.steps,
        solution.evaluations,
        solved.seconds,
        compile_seconds=solution.compile_seconds,
        rejected=solution.rejected,
        compiled=solution.compiled,
        why=choice.why,
        step=None if choice.method.adaptive else choice.setting,
    )


def _trajectory(
    scene: Scene,
    equations: Equations,
    solved: Solved,
    cost: Cost,
    times: np.ndarray,
    accuracy: float | None,
    looks: np.ndarray,
    second: SecondSolutions | None = None,
) -> Trajectory:
    """The solution at the asked times, with its error bar where there are second solutions."""
    choice, solution = solved.choice, solved.solution
    error, cut = None, second is not None and second.interrupted
    if second is not None and not cut:
        error = bar_of_run(equations.space, solution, _numbers(solution, looks), second.distance, second.safety)
        error[1:] += SLACK * (accuracy or 0.0)
    # An event may end the run at a time that was not asked for.
    all_asked = len(times) >= LOOKS or np.array_equal(solution.t, times)
    kept = np.ones(len(solution.t), dtype=bool) if all_asked else np.isin(solution.t, times)
    kept[-1] |= not solution.interrupted
    q, v = equations.space.rows(solution.x.compress(kept, axis=1))
    events = solution.events
    if max(equations.assembled) > ASSEMBLED:
        moved = "q moved by {:.3g}, v by {:.3g}".format(*equations.assembled)
        events = (Event(0.0, "assembled", "loops", moved), *events)
    dense = DenseOutput(solution.pieces, solution.t, solution.x[: equations.moving], choice.method.name,
                        choice.setting, choice.precision)  # fmt: skip
    run = Trajectory(
        scene.robot,
        solution.t[kept],
        q,
        v,
        None if error is None else error[kept],
        cost,
        events,
        solution.interrupted or cut,
        accuracy=None if error is None else accuracy,
        precise=None if solution.precise is None else solution.precise[kept],
        robots=_robots(solution, kept),
        solution=dense,
        title=scene.title,
        certificate=None if equations.switching is None else certificate(equations.switching, solution),
    )
    if run.certificate is not None:
        run.certificate.require(run)
    return run


def _robots(solution: Solution, kept: np.ndarray) -> list[tuple[Robot, int]]:
    """The robot of each piece and its number of kept samples; empty where it is the same robot throughout."""
    robots = [piece.equations.robot for piece in solution.pieces]
    if all(robot is robots[0] for robot in robots):
        return []
    parts = np.split(kept, np.cumsum([piece.samples for piece in solution.pieces])[:-1])
    return [(robot, int(part.sum())) for robot, part in zip(robots, parts, strict=True)]
