"""simulate: Scene -> Trajectory."""

import functools
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from twolink.contact.choice import choose_contact_method
from twolink.dynamics import Robot
from twolink.dynamics.arguments import Positive, positive
from twolink.errors import AccuracyError, ControllerError, SceneError
from twolink.integrate.dense_output import DenseOutput
from twolink.integrate.digits import decimals
from twolink.integrate.hybrid.least_bounce import LeastBounce
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.scene_equations import equations_of
from twolink.integrate.solution import Event, Progress, Solution
from twolink.integrate.solver import MethodChoice
from twolink.integrate.solvers.taylor import Precision
from twolink.integrate.steps.methods import known_as
from twolink.io.progress import Report, in_time
from twolink.scenes import Scene
from twolink.scenes.scene import accuracy_of
from twolink.simulation.certificate import certificate
from twolink.simulation.cost import Cost
from twolink.simulation.error_bar import SLACK
from twolink.simulation.refinement import PATIENCE, Refinement, first_choice, precisions_of
from twolink.simulation.sampling import duration_for, only_at, sample_times, spread_out, with_check_times, with_ends
from twolink.simulation.time_limit import OutOfTime, TimeLimit
from twolink.simulation.trajectory import Trajectory
from twolink.simulation.verification import Verification
from twolink.simulation.verified import Verified

CHECKS, MAX_CHECKS = 41, 100  # times at which errors are checked, at least and about at most
ACCURACY = 1e-6  # rad or m, where none is asked for
ASSEMBLED = 1e-9  # rad, m: a start that was moved by more is an event
MAX_TOLERANCE = 0.1
PILOT_STEPS = 20_000  # at most, of the first try of a method of fixed steps
UNSOLVED = "steps-collapsed", "loops-singular", "too-many-steps"  # codes: another method may go on


def simulate(
    scene: Scene,
    duration: Positive | None = None,
    *,
    accuracy: Positive | None = None,
    t_eval: ArrayLike | None = None,
    samples_per_second: Positive = 200.0,
    method: str = "auto",
    verify: bool = True,
    precision: Precision | Literal["auto"] = "auto",
    tolerance: Positive | None = None,
    step: Positive | None = None,
    progress: Report | None = None,
    contact: str | None = None,
    patience: float | None = None,
) -> Trajectory:
    """Simulate a scene.

    Parameters
    ----------
    scene : Scene
    duration : float, optional
        Simulated time, s; by default the scene's own.
    accuracy : float, optional
        Bound on the global error of q at every sample, max |difference(q, q_exact)|, rad or m; by default 1e-6. Of
        contacts that are stepped, by default what a count of steps allows that is the same on every machine.
    t_eval : array_like (n,), optional
        Times of the samples, s, increasing, from 0 at least to the duration at most.
    samples_per_second : float
        Without t_eval, samples a second; the first is at 0, the last at `duration`.
    method : str
        "auto", the cheapest for the accuracy, or one of `twolink methods`.
    verify : bool
        Solve beside the run a finer solution, and some that are disturbed by rounding, and take the distances as the
        error bar; the settings are refined until the bar is below `accuracy`. Without it run.error is None.
    precision : {"auto", "double", "extended", "quad"}
        Of the numbers: 16 digits, 31 or 47. The latter two by Taylor's method, for smooth scenes; their digits are in
        run.precise, which the error bar is for. "auto" takes more digits where 16 do not keep the accuracy.
    tolerance, step : float, optional
        Of the method, in place of what `accuracy` calls for, the step in s; the error bar is measured and reported.
    progress : callable, optional
        Called now and then with what is done, the total and a label; here simulated seconds.
    contact : {"located", "stepped"}, optional
        How contacts, stops and dry friction are computed: each event located, with an error bar; or stepped through,
        with an error that is estimated (run.bound). By default as `explain` says: only contacts are stepped unasked;
        where they cannot be located any further and no accuracy is asked for, they are stepped from there (event
        "stepped").
    patience : float, optional
        Wall clock that solving may take, s; by default 600, and without end where contacts are stepped.

    Returns
    -------
    Trajectory

    Raises
    ------
    AccuracyError
        The accuracy cannot be kept (code "accuracy-limit", with data trusted_until [s] and tried, what was), or not
        within the patience (code "out-of-time"); its `run` is the best trajectory, with its error bar. Or the motion
        cannot be solved (codes "steps-collapsed", "loops-singular", "not-finite", "too-many-steps").
    SceneError
        An argument does not fit.
    """
    end, asked = duration_for(scene, duration), None if accuracy is None else accuracy_of(accuracy)
    wanted = sample_times(end, t_eval, samples_per_second)
    times, told = with_ends(wanted, end), in_time(progress, end)
    if patience is not None:
        patience = positive(patience, "patience", AccuracyError, "such as 600")
    chosen = choose_contact_method(scene, contact)
    stepped = functools.partial(_stepped, method=method, precision=precision, progress=told, patience=patience,
                                verify=verify)  # fmt: skip
    if chosen.method == "stepped":
        return only_at(stepped(scene, times, asked, tolerance=tolerance, step=step), wanted, end)
    limit = TimeLimit(patience or PATIENCE, progress=told, from_now=True)
    accuracy, equations = ACCURACY if asked is None else asked, equations_of(scene, ticks=True)
    free = method == "auto" and tolerance is None and step is None
    more = precisions_of(equations) if precision == "auto" and method in ("auto", "taylor") else ()
    first = first_choice(equations, accuracy, end, method, precision, more if free else ())
    choice, measured = _with_setting(first, method, tolerance, step)
    if verify and not (measured or choice.method.adaptive):  # a pilot, whose error tells the step that is needed
        choice = replace(choice, setting=min(max(choice.setting, end / PILOT_STEPS), end / 4))
    search = Refinement(equations, accuracy, any_method=free, precisions=() if measured else more)
    try:
        run = run_of(scene, equations, choice, times, accuracy, limit, search=search, measured=measured, verify=verify)
        return only_at(run, wanted, end)
    except ControllerError as error:
        error.run = only_at(error.run, wanted, end)
        raise
    except AccuracyError as error:
        if chosen.method != "located":
            raise
        from twolink.simulation.spliced_run import beyond_located  # which other scenes do not load

        located = functools.partial(run_of, scene, equations, choice, accuracy=accuracy, progress=limit, verify=verify)
        effort = free and contact is None and asked is None
        return only_at(beyond_located(scene, times, error, located, stepped, best_effort=effort), wanted, end)


def _stepped(
    scene: Scene,
    times: np.ndarray,
    accuracy: float | None = None,
    *,
    method: str,
    precision: Precision | Literal["auto"],
    progress: Progress | None,
    patience: float | None,
    verify: bool,
    tolerance: float | None = None,
    step: float | None = None,
) -> Trajectory:
    """The run of a scene whose contacts are stepped, which has a step and no method."""
    from twolink.simulation.stepped_run import simulate_stepped  # which other scenes do not load

    for argument, given in (("method", method != "auto"), ("tolerance", tolerance is not None),
                            ("precision", precision not in ("auto", "double"))):  # fmt: skip
        if given:
            raise SceneError("stepped contacts have a method of their own, in double precision", argument=argument,
                             remedy="leave it out, or give step=")  # fmt: skip
    h = None if step is None else positive(step, "step", AccuracyError, "such as 1e-3")
    return simulate_stepped(scene, times, accuracy, h, progress, verify=verify, patience=patience)


def run_of(
    scene: Scene,
    equations: Equations,
    choice: MethodChoice,
    times: np.ndarray,
    accuracy: float,
    progress: Progress | None = None,
    *,
    search: Refinement | None = None,
    measured: bool = False,
    verify: bool = True,
) -> Trajectory:
    """The run of a scene from the start of its equations, as `simulate` returns it for samples at the times (n,).

    search: what may be tried beside smaller settings. measured: the setting of the choice is the caller's own, and is
    not refined.
    """
    all_times = with_check_times(times, CHECKS) if verify else times
    # SciPy's samples are interpolated: their errors within a step are many times those at its ends.
    checks = np.arange(len(all_times)) if choice.method.kind == "scipy" else spread_out(len(all_times), MAX_CHECKS)
    verification = Verification(equations, all_times, checks, 0.0 if measured else accuracy, progress)
    search, spent, following = search or Refinement(equations, accuracy), 0.0, choice
    try:
        if not verify:
            one = verification.unverified(choice)
            return _lawful(_trajectory(scene, equations, one, times, None), equations, one.solution)
        while True:
            try:
                one = verification(following)
            except AccuracyError as error:
                if measured or error.code not in UNSOLVED:
                    raise
                search.seen(following, None)
                other = search.after_failure(following, error.code)
                if other is None and search.best is None:
                    raise
            else:
                run = _trajectory(scene, equations, one, times, None if measured else accuracy, spent)
                if run.error is None or measured or run.error[-1] <= accuracy:
                    return _lawful(run, equations, one.solution)
                search.seen(following, run)
                spent += one.seconds + one.verify_seconds
                other = search.after(one)
            if other is None:
                raise search.failure()
            following = other
    except OutOfTime as late:
        raise late.with_run(search.best) from None
    except ControllerError as error:
        so_far = Verified(following, error.run, 0.0, np.arange(len(error.run.t)))
        error.run = _trajectory(scene, equations, so_far, times, None)
        raise


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
        raise AccuracyError(f"expected a number up to {MAX_TOLERANCE:g}, got {tolerance!r:.60}", argument="tolerance",
                            remedy="such as 1e-6")  # fmt: skip
    if choice.method.adaptive != (step is None):
        kind = "chooses its steps by a tolerance" if choice.method.adaptive else "takes steps of one size"
        remedy = "give tolerance=" if choice.method.adaptive else "give step="
        if name == "auto" and step is not None:  # and no method to take it
            remedy = 'give method="rk4" with step=, or accuracy= for its own steps'
        raise SceneError(f"{choice.method.name} {kind}", argument="method", remedy=remedy)
    return replace(choice, setting=setting, why=choice.why if name == "auto" else f"asked for{known_as(name)}"), True


def _lawful(run: Trajectory, equations: Equations, solution: Solution) -> Trajectory:
    """The run with its certificate, where it has events. Raises AccuracyError, code "laws-violated"."""
    if equations.switching is None:
        return run
    checked = certificate(equations.switching, solution)
    run = replace(run, certificate=checked)
    checked.require(run)
    return run


def _cost(one: Verified, spent: float) -> Cost:
    """The cost of a run. spent: s, on runs before it whose error bars were too large."""
    choice, solution = one.choice, one.solution
    return Cost(
        choice.method.name, choice.setting if choice.method.adaptive else None, solution.steps, solution.evaluations,
        one.seconds, verify_seconds=spent + one.verify_seconds, compile_seconds=solution.compile_seconds,
        rejected=solution.rejected, compiled=solution.compiled, why=choice.why,
        step=None if choice.method.adaptive else choice.setting, precision=choice.precision,
    )  # fmt: skip


def _trajectory(
    scene: Scene,
    equations: Equations,
    one: Verified,
    times: np.ndarray,
    accuracy: float | None,
    spent: float = 0.0,
) -> Trajectory:
    """The solution at the asked times, with its error bar where there are solutions beside it."""
    choice, solution = one.choice, one.solution
    if accuracy:
        slack = SLACK * accuracy
    else:  # after all solutions have ended their bounces, none shows what is left of them
        slack = LeastBounce.of_run(choice.method, choice.setting).height if equations.has_events else 0.0
    error = one.bar(equations.space, slack)
    # An event may end the run at a time that was not asked for.
    all_asked = len(times) >= CHECKS or np.array_equal(solution.t, times)
    kept = np.ones(len(solution.t), dtype=bool) if all_asked else np.isin(solution.t, times)
    kept[-1] |= not solution.interrupted
    space = equations.space
    q, v = space.rows(solution.x.compress(kept, axis=1))
    events = solution.events
    if max(equations.assembled) > ASSEMBLED:
        moved = "q moved by {:.3g}, v by {:.3g}".format(*equations.assembled)
        events = (Event(0.0, "assembled", "loops", moved), *events)
    dense = DenseOutput(solution.segments, solution.t, solution.x[: equations.moving], choice.method.name,
                        choice.setting, choice.precision, solution.impulses)  # fmt: skip
    z = solution.x[space.z_rows].compress(kept, axis=1)
    return Trajectory(
        scene.robot, solution.t[kept], q, v, None if error is None else error[kept], _cost(one, spent), events,
        solution.interrupted, accuracy=None if error is None else accuracy,
        precise=None if solution.precise is None else decimals(solution.precise[kept]),
        robots=_robots(solution, kept, scene.robot), solution=dense, title=scene.title, scene=scene,
        states=dict(zip(space.states, z, strict=True)),
    )  # fmt: skip


def _robots(solution: Solution, kept: np.ndarray, own: Robot) -> list[tuple[Robot, int]]:
    """The robot of each segment and its number of kept samples; empty where it is the run's own throughout."""
    robots = [segment.equations.robot for segment in solution.segments]
    if all(robot is own for robot in robots):
        return []
    parts = np.split(kept, np.cumsum([segment.samples for segment in solution.segments])[:-1])
    return [(robot, int(part.sum())) for robot, part in zip(robots, parts, strict=True)]
