"""simulate, where contacts are stepped: runs of smaller steps, until their distance is below the accuracy."""

import time
import weakref

import numpy as np

from twolink.contact.loops import LoopRows
from twolink.contact.solver import SteppedSolution, solve_stepped
from twolink.contact.stepping import Stepper
from twolink.effects.contact import Contact
from twolink.effects.loop import Loop
from twolink.effects.switching import Hold, Stop, SwitchingEffect
from twolink.errors import AccuracyError, SceneError
from twolink.integrate.scene_equations import equations_of
from twolink.integrate.solution import Progress
from twolink.scenes import Scene
from twolink.simulation.cost import Cost
from twolink.simulation.error_bar import error_bar
from twolink.simulation.trajectory import Trajectory

METHOD = "stepped"
FIRST = 1e-2  # s: the first step
STEPS = 200_000  # of a run that an accuracy may call for
SAFETY = 4.0  # of the distance to half the step: where in a step an impact falls changes its error by chance
STRIDE = 32.0  # by which the step is made smaller at most before the error is looked at again
OVERLAP = 1e-9  # m, at the start
_smooth: weakref.WeakKeyDictionary[Scene, tuple[Scene, Scene]] = weakref.WeakKeyDictionary()


def simulate_stepped(
    scene: Scene, times: np.ndarray, accuracy: float, step: float | None, progress: Progress | None, *, verify: bool
) -> Trajectory:
    """The run of a scene whose contacts are stepped, with samples at the times (n,).

    step: the caller's own [s], whose error is estimated and reported; None: smaller ones until the estimate is below
    the accuracy. Raises AccuracyError where that takes too many, with the best run.
    """
    stepper = stepper_of(scene)
    began, end = time.perf_counter(), float(times[-1])
    h, halvings = min(FIRST, end / 4) if step is None else step, 0

    def solved() -> tuple[SteppedSolution, float]:
        start = time.perf_counter()
        solution = solve_stepped(stepper, times, h, progress, halvings)
        return solution, time.perf_counter() - start

    coarse, seconds = solved()
    while verify and not coarse.interrupted:
        halvings += 1
        fine, taken = solved()
        total = time.perf_counter() - began
        if fine.interrupted:
            break
        off = stepper.equations.space.distance(coarse.q, fine.q)
        if step is not None:  # of first order: half the step has half the error
            return _trajectory(scene, coarse, seconds, total - seconds, 2.0 * off)
        run = _trajectory(scene, fine, taken, total - taken, off, accuracy)
        error = float(run.error[-1]) if run.error is not None else 0.0
        if error <= accuracy:
            return run
        now = h / 2**halvings
        needed = 0.7 * now * accuracy / error
        if end / needed > STEPS:
            raise _too_many_steps(accuracy, end / needed, run, error)
        coarse, seconds = fine, taken
        if needed < now / 4:
            h, halvings = max(needed, now / STRIDE), 0
            coarse, seconds = solved()
    return _trajectory(scene, coarse, seconds)


def _too_many_steps(accuracy: float, steps: float, run: Trajectory, error: float) -> AccuracyError:
    return AccuracyError(f"{accuracy:g} would take about {steps:.0e} steps, for stepping is of first order",
                         where=f"t = {run.trusted_until or 0.0:.6g} s", argument="accuracy", code="too-many-steps",
                         remedy=f"ask for less accuracy, such as {2 * error:.0e}, or give step= and read the error",
                         run=run)  # fmt: skip


def stepper_of(scene: Scene) -> Stepper:
    """What steps a scene. Raises SceneError for what cannot be stepped."""
    effects = [effect for effect in scene.effects if isinstance(effect, Contact)]
    if any(effect.impacts == "reflections" for effect in effects):
        raise SceneError('Contact with impacts="reflections" is not stepped: expected "newton", one impulse a step',
                         where="impacts", remedy='contact="located", or impacts="newton"',
                         code="not-stepped")  # fmt: skip
    others = [effect for effect in scene.effects if not isinstance(effect, Contact)]
    declared = [item for e in others if isinstance(e, SwitchingEffect) for item in e.modes(scene.robot)]
    stops = [item for item in declared if isinstance(item, Stop)]
    holds = [item for item in declared if isinstance(item, Hold) and item.entry is None]
    if len(stops) + len(holds) < len(declared):
        raise SceneError("effects that switch, other than joint stops and dry friction, cannot be stepped",
                         argument="contact", remedy='contact="located", or leave them out',
                         code="not-stepped")  # fmt: skip
    if scene not in _smooth:  # the same scene has the same equations, which are kept as long as it is
        smooth = [effect for effect in others if not isinstance(effect, SwitchingEffect)]
        looped = Scene(scene.base, scene.q, scene.v, smooth, scene.duration, scene.title)
        free = [effect for effect in smooth if not isinstance(effect, Loop)]
        q, v = equations_of(looped).space.rows(equations_of(looped).start)
        _smooth[scene] = looped, Scene(scene.base, q, v, free, scene.duration, scene.title)
    with_loops, equations = (equations_of(one) for one in _smooth[scene])
    loops = None if with_loops.constraints is None else LoopRows(with_loops, with_loops.constraints)
    stepper = Stepper(equations, effects, stops, holds, loops)
    overlap, pair = stepper.overlap(equations.start[: equations.space.nq])
    if overlap > OVERLAP:
        raise SceneError(f"{pair} overlap by {overlap:.3g} m at the start", where="q", code="overlap",
                         remedy="start with bodies apart, and joints within their stops")  # fmt: skip
    return stepper


def _trajectory(
    scene: Scene,
    solution: SteppedSolution,
    seconds: float,
    verifying: float = 0.0,
    distance: np.ndarray | None = None,
    accuracy: float | None = None,
) -> Trajectory:
    """The trajectory of a stepped solution. distance: to its neighbour at each sample (n,), rad or m."""
    record = solution.record
    cost = Cost(METHOD, None, record.steps, record.steps, seconds, verifying, rejected=record.halved,
                why="many contacts", step=solution.step)  # fmt: skip
    error = None if distance is None else error_bar(distance, np.zeros_like(distance), SAFETY)
    return Trajectory(
        scene.robot,
        solution.t,
        solution.q,
        solution.v,
        error,
        cost,
        interrupted=solution.interrupted,
        accuracy=accuracy,
        solution=solution,
        title=scene.title,
        estimated=True,
    )
