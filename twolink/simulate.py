"""simulate: Scene -> Trajectory."""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np
import pinocchio as pin

from twolink.errors import AccuracyError, SceneError
from twolink.integrate import Method, Solution, StateSpace, method_named, solve
from twolink.integrate.scipy_solver import SMALLEST_TOLERANCE, Progress, Rate, solver_class
from twolink.scenes import Scene
from twolink.scenes.scene import duration_of
from twolink.trajectory import Cost, Trajectory

MAX_SAMPLES = 20_000_000
CLOSER = 4.0  # how many times smaller the second solution's tolerance must be for its distance to tell the error


def simulate(
    scene: Scene,
    duration: float | None = None,
    accuracy: float = 1e-6,
    *,
    method: str = "auto",
    samples: float = 200.0,
    verify: bool = True,
    progress: Progress | None = None,
) -> Trajectory:
    """Simulate a scene for `duration` seconds.

    accuracy: bound on the global error of q at every sample, max |difference(q, q_exact)|, rad or m.
    method: "auto", or one of `twolink.integrate.METHODS`.
    samples: samples a second; the first is at 0, the last at `duration`.
    verify: solve a second time with a hundredth of the tolerance, and take the distance as the error bar; the
    tolerance is lowered until the bar is below `accuracy`. Without it run.error is None: not verified.
    progress: called with the simulated time now and then.

    Raises AccuracyError when the accuracy cannot be kept, with the time up to which it is.
    """
    if not isinstance(scene, Scene):
        raise SceneError(f"expected a Scene, got {type(scene).__name__}", where="scene", remedy="tl.load_scene(...)")
    accuracy = _accuracy(accuracy)
    chosen = method_named(method)
    solver_class(chosen)  # imported before the clock starts
    times = _times(scene.duration if duration is None else duration_of(duration), samples)
    space = StateSpace(scene.robot)
    rate = smooth_rate(scene, space)
    start = space.pack(scene.q, scene.v)
    tolerance = max(accuracy / 10, SMALLEST_TOLERANCE)
    solution, seconds = _timed(rate, start, times, chosen, tolerance, progress)
    if not verify or solution.interrupted:
        return _trajectory(scene, space, solution, None, _cost(chosen, tolerance, solution, seconds))
    verify_seconds = 0.0
    while True:
        finer_tolerance = max(tolerance / 100, SMALLEST_TOLERANCE)
        if finer_tolerance > tolerance / CLOSER:
            raise _unreachable(accuracy)
        # The finer solution is closer by construction: its distance is the coarse one's error, a quarter more or less.
        finer, more = _timed(rate, start, times, chosen, finer_tolerance, progress)
        verify_seconds += more
        cost = replace(_cost(chosen, tolerance, solution, seconds), verify_seconds=verify_seconds)
        if finer.interrupted:
            return replace(_trajectory(scene, space, solution, None, cost), interrupted=True)
        error = space.distance(space.unpack(solution.x)[0], space.unpack(finer.x)[0])
        # A bar, not an estimate: it must not vanish where the difference happens to change its sign.
        error = np.maximum.accumulate(1.5 * error)
        error[1:] += accuracy / 100
        if error[-1] <= accuracy:
            return _trajectory(scene, space, solution, error, cost)
        if finer_tolerance / CLOSER < SMALLEST_TOLERANCE:
            raise _out_of_reach(accuracy, times, error)
        solution, seconds, tolerance = finer, more, finer_tolerance


def smooth_rate(scene: Scene, space: StateSpace) -> Rate:
    """x' = (q', M^-1 (tau - h)) of a scene of smooth forces, straight from Pinocchio."""
    model, data, nq = scene.robot.model, scene.robot.model.createData(), scene.robot.nq
    tau = np.zeros(scene.robot.nv)
    if scene.robot.has_mimic:
        raise SceneError("mimic joints cannot be simulated yet", where="robot", remedy="load it with mimic=False")
    if not space.curved:

        def flat(t: float, x: np.ndarray) -> np.ndarray:
            return _finite(t, np.concatenate([x[nq:], pin.aba(model, data, x[:nq], x[nq:], tau)]))

        return flat

    def curved(t: float, x: np.ndarray) -> np.ndarray:
        q, v = space.unpack(x)
        return _finite(t, np.concatenate([space.rate(x[:nq], v), pin.aba(model, data, q, v, tau)]))

    return curved


def _finite(t: float, rate: np.ndarray) -> np.ndarray:
    """The rate, or an error: an integrator that is given NaN shortens its step for ever."""
    if not math.isfinite(sum(rate.tolist())):
        raise AccuracyError("the acceleration is not finite", where=f"t = {t:.6g} s",
                            remedy="check forces, masses and the initial state")  # fmt: skip
    return rate


def _accuracy(value: float) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not (math.isfinite(number) and number > 0):
        raise AccuracyError(f"expected a number above 0, got {value!r}", where="accuracy", remedy="such as 1e-6")
    return number


def _times(duration: float, samples: float) -> np.ndarray:
    """0, 1/samples, 2/samples, ... below the duration, and the duration itself."""
    if not (isinstance(samples, (int, float)) and math.isfinite(samples) and samples > 0):
        raise SceneError(f"expected a number above 0, got {samples!r}", where="samples", remedy="such as 200 a second")
    if duration * samples > MAX_SAMPLES:
        raise SceneError(
            f"{duration * samples:.3g} samples, the limit is {MAX_SAMPLES:.0e}",
            where="samples",
            remedy="ask for fewer a second, or a shorter duration",
        )
    inner = np.arange(max(1, math.ceil(duration * samples - 1e-9))) / samples
    return np.append(inner[inner < duration], duration)


def _timed(
    rate: Rate,
    start: np.ndarray,
    times: np.ndarray,
    method: Method,
    tolerance: float,
    progress: Progress | None,
) -> tuple[Solution, float]:
    before = time.perf_counter()
    solution = solve(rate, start, times, method, tolerance, progress)
    return solution, time.perf_counter() - before


def _cost(method: Method, tolerance: float, solution: Solution, seconds: float) -> Cost:
    return Cost(method.name, tolerance, solution.steps, solution.evaluations, seconds)


def _trajectory(
    scene: Scene, space: StateSpace, solution: Solution, error: np.ndarray | None, cost: Cost
) -> Trajectory:
    q, v = space.unpack(solution.x)
    kinetic, potential = scene.robot.energy(q, v)
    return Trajectory(scene.robot, solution.t, q, v, kinetic + potential, error, cost, interrupted=solution.interrupted)


def _unreachable(accuracy: float) -> AccuracyError:
    least = 10 * CLOSER * SMALLEST_TOLERANCE
    return AccuracyError(
        f"{accuracy:g} is below what can be verified in double precision",
        where="accuracy",
        remedy=f"ask for {least:.1e} or more, or take the answer without an error bar: verify=False",
    )


def _out_of_reach(accuracy: float, times: np.ndarray, error: np.ndarray) -> AccuracyError:
    kept = times[error <= accuracy]
    until = float(kept[-1]) if kept.size else 0.0
    return AccuracyError(
        f"{accuracy:g} cannot be kept in double precision: the error bar is {error[-1]:.1e} at the end",
        where=f"t = {until:.6g} s",
        remedy=f"it is kept up to then: ask for duration={until:.6g}, or less accuracy",
    )
