"""simulate_many: one scene, many initial states and physical constants, each world with steps of its own."""

from collections.abc import Collection, Mapping

import numpy as np
from numpy.typing import ArrayLike

from twolink.dynamics.kernels import heyoka
from twolink.errors import AccuracyError, MissingExtraError, SceneError
from twolink.integrate.effect_numbers import PREFIX, effect_numbers
from twolink.integrate.equations import Equations
from twolink.integrate.methods import METHODS
from twolink.integrate.scene_equations import equations_of
from twolink.integrate.solution import Progress
from twolink.integrate.step_map import StepMap, step_map
from twolink.scenes import Scene
from twolink.scenes.scene import accuracy_of
from twolink.simulation.cost import Cost
from twolink.simulation.event_worlds import solve_one_by_one
from twolink.simulation.many_runs import Worlds
from twolink.simulation.sampling import duration_for, with_looks
from twolink.simulation.world_solving import can_be_finer, solve_worlds
from twolink.simulation.world_states import close_loops, world_states

LOOKS = 17  # times at least at which errors are looked at
MAX_NUMBERS = 200_000_000


def simulate_many(
    scene: Scene,
    q: ArrayLike | None = None,
    v: ArrayLike | None = None,
    parameters: Mapping[str, ArrayLike] | None = None,
    duration: float | None = None,
    accuracy: float = 1e-6,
    *,
    samples: int = 0,
    verify: bool = True,
    progress: Progress | None = None,
) -> Worlds:
    """Simulate n worlds of a scene at once, to the same time.

    Parameters
    ----------
    scene : Scene
    q, v : array_like (n, nq), (n, nv), optional
        Initial states; by default the scene's own.
    parameters : mapping of names to numbers or array_like (n,), optional
        Physical constants by name (`algorithms.mechanism.parameter_names`: "forearm.mass", ...), and numbers of effects
        by the effect's place in the scene, its field and what is in that: "effects.1.damping.elbow".
    duration : float, optional
        Simulated time, s; by default the scene's own.
    accuracy : float
        Bound on the global error of q, rad or m. Worlds whose error bar is above it are solved again with smaller
        tolerances, where those can reach it; a bar that is still above is reported in `error`.
    samples : int
        Number of equally spaced times to keep besides the end.
    verify : bool
        Compute error bars from a second, more accurate and perturbed solution.
    progress : callable, optional
        Called now and then with the mean of the times that worlds have reached.

    Returns
    -------
    Worlds

    Notes
    -----
    Smooth worlds are steps of one batch. Worlds of a scene with events are solved one after the other, each as
    `simulate` solves it, by the same compiled steps. So are worlds that differ in parameters of closed loops or of a
    scene with events, or in numbers of effects that change the robot; each of them compiles steps of its own.

    Raises
    ------
    SceneError
        An argument does not fit.
    AccuracyError
        The accuracy cannot be verified (code "accuracy-not-verifiable").
    """
    end, accuracy = duration_for(scene, duration), accuracy_of(accuracy)
    states, values = world_states(scene, q, v, parameters)
    _require_samples(samples, states.shape)
    times = np.linspace(0.0, end, samples + 2) if samples else np.array([0.0, end])
    kept = slice(0, samples + 1 if samples else 0)
    begun = states[: scene.robot.nq].T.copy(), states[scene.robot.nq :].T.copy(), values
    if differs_beyond_numbers(scene, values):
        ones = solve_one_by_one(scene, states, values, times, accuracy, progress, verify=verify)
        return Worlds(scene.robot, end, ones.q[-1], ones.v[-1], ones.error, accuracy, ones.steps, ones.cost,
                      times[kept], ones.q[kept], ones.v[kept], ones.events, ones.ends, scene, *begun)  # fmt: skip
    steps_by = _step_map(scene, tuple(values), end)
    close_loops(steps_by.equations, states)
    parameter_rows = np.array(list(values.values())) if values else None
    looks, method = with_looks(times, LOOKS) if verify else times, steps_by.method
    if verify and not can_be_finer(method, accuracy):
        raise AccuracyError(f"{accuracy:g} is below what can be verified in batches", argument="accuracy",
                            remedy="ask for 1e-12, or verify=False", code="accuracy-not-verifiable")  # fmt: skip
    solved = solve_worlds(steps_by, states, looks, accuracy, parameter_rows, progress, verify=verify)
    steps, rejected = int(solved.steps.sum()), int(solved.rejected.sum())
    cost = Cost(method.name, solved.tolerance, steps, (steps + rejected) * method.evaluations, solved.seconds,
                solved.verify_seconds, steps_by.compile_seconds, rejected, steps_by.compiled, "a batch")  # fmt: skip
    qs, vs = _configurations(steps_by.equations, solved.x[np.searchsorted(looks, times)])
    return Worlds(scene.robot, end, qs[-1], vs[-1], solved.error, accuracy, solved.steps, cost, times[kept], qs[kept],
                  vs[kept], (), np.full(len(qs[-1]), end), scene, *begun)  # fmt: skip


def differs_beyond_numbers(scene: Scene, names: Collection[str]) -> bool:
    """Whether worlds that differ in these parameters are no batch of one step.

    They have events, loops of their own, or constants of their own.
    """
    equations, known = equations_of(scene), effect_numbers(scene)
    constant = any(name.startswith(PREFIX) and name not in known for name in names)
    if constant or equations.switching is not None or (names and equations.constraints is not None):
        return True
    try:
        equations_of(scene, tuple(names))
    except TypeError:  # a number that a formula takes as a constant, such as a limit of effort
        return True
    return False


def _configurations(equations: Equations, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(q (m, n, nq), v (m, n, nv)) of states (m, size, n); q on its manifold, NaN for a world that is lost."""
    by_world, space = np.moveaxis(x, 2, 1), equations.space
    q, v = by_world[..., : space.nq].copy(), by_world[..., space.nq : equations.moving]
    if space.curved:
        finite = np.isfinite(q).all(axis=-1)
        q[finite] = space.robot.normalize(q[finite])
    return q, v


def _require_samples(samples: int, shape: tuple[int, ...]) -> None:
    if not isinstance(samples, (int, np.integer)) or isinstance(samples, bool) or samples < 0:
        raise SceneError(f"expected a whole number from 0, got {samples!r}", argument="samples", remedy="such as 10")
    if samples * shape[0] * shape[1] > MAX_NUMBERS:
        raise SceneError(f"{samples:.1e} samples of {shape[1]} worlds are too many", argument="samples",
                         remedy="ask for fewer, or for fewer worlds at once", code="too-many-samples")  # fmt: skip


def _step_map(scene: Scene, parameters: tuple[str, ...], end: float) -> StepMap:
    if parameters and heyoka() is None:
        raise MissingExtraError("parameters that differ by world need heyoka", remedy="pip install heyoka (Linux)")
    equations = equations_of(scene, parameters)
    equations.require(0.0, end)
    return step_map(equations, METHODS["dop853"], whole=True)
