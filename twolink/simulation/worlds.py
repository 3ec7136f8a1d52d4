"""simulate_many: one scene, many initial states and physical constants, each world with steps of its own."""

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from twolink.contact.choice import choose_contact_method
from twolink.dynamics.arguments import Positive, array, configuration
from twolink.errors import AccuracyError, SceneError
from twolink.integrate.motion.assembly import assembled
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.scene_equations import decides_states, equations_of, with_starting_states
from twolink.integrate.solution import Progress
from twolink.integrate.steps.methods import METHODS
from twolink.integrate.steps.step_map import step_map
from twolink.io.progress import Report, in_time
from twolink.native.programs import SPENT
from twolink.scenes import Scene
from twolink.scenes.parameters import NOT_NEGATIVE, PREFIX, Parameter, named_parameters, parameters_of, scene_with
from twolink.scenes.scene import accuracy_of
from twolink.simulation.event_worlds import SolvedWorlds, solve_one_by_one
from twolink.simulation.many_runs import Worlds
from twolink.simulation.sampling import duration_for, sample_times, with_check_times, with_ends
from twolink.simulation.scene_run import ACCURACY
from twolink.simulation.world_solving import can_be_finer, solve_worlds

CHECKS = 17  # times at least at which errors are checked
MAX_NUMBERS = 200_000_000


def simulate_many(
    scene: Scene,
    duration: Positive | None = None,
    *,
    q: ArrayLike | None = None,
    v: ArrayLike | None = None,
    parameters: Mapping[str, ArrayLike] | None = None,
    accuracy: Positive | None = None,
    t_eval: ArrayLike | None = None,
    samples_per_second: float = 0.0,
    verify: bool = True,
    progress: Report | None = None,
    contact: str | None = None,
) -> Worlds:
    """Simulate n worlds of a scene at once, to the same time.

    Parameters
    ----------
    scene : Scene
    duration : float, optional
        Simulated time, s; by default the scene's own.
    q, v : array_like (n, nq), (n, nv), optional
        Initial states; by default the scene's own.
    parameters : mapping of names to numbers or array_like (n,), optional
        By name (`scenes.parameters`): physical constants such as "forearm.mass", numbers of effects by the effect's
        place in the scene, its field and what is in that, "effects.1.damping.elbow", or coordinates, "q.elbow".
    accuracy : float, optional
        Bound on the global error of q, rad or m; by default as in `simulate`. Worlds whose error bar is above it are
        solved again with smaller tolerances, where those can reach it; a bar that is still above is in `error`.
    t_eval : array_like (m,), optional
        Times of the samples, s, increasing, from 0 at least to the duration at most.
    samples_per_second : float
        Without t_eval, samples a second. 0: only the end is kept.
    verify : bool
        Compute error bars from a second, more accurate and perturbed solution.
    progress : callable, optional
        Called now and then with what is done, the total and a label; here simulated seconds, the mean of all.
    contact : {"located", "stepped"}, optional
        How contacts, stops and dry friction are computed, as of `simulate`, which chooses by default.

    Returns
    -------
    Worlds

    Notes
    -----
    Smooth worlds are steps of one batch. Worlds of a scene with events or sampled controllers are solved one after the
    other, each as `simulate` solves it, by the same compiled steps; each has its own controller state. So are worlds
    that differ in parameters of closed loops or of such a scene, or in numbers of effects that change the robot or are
    the gain of a state, such as ki of `PID`; each of them compiles steps of its own.

    Raises
    ------
    SceneError
        An argument does not fit, or a name is unknown (code "unknown-parameter").
    AccuracyError
        The accuracy cannot be verified (code "accuracy-not-verifiable").
    ControllerError
        A controller fails in a world, which `where` names; its `run` is that world's motion so far.
    """
    end, asked = duration_for(scene, duration), None if accuracy is None else accuracy_of(accuracy)
    accuracy = ACCURACY if asked is None else asked
    states, values = world_states(scene, q, v, parameters)
    wanted = np.empty(0)
    if t_eval is not None or samples_per_second != 0.0:
        wanted = sample_times(end, t_eval, samples_per_second, MAX_NUMBERS // states.size)
    times, told = with_ends(wanted, end), in_time(progress, end)
    kept = np.isin(times, wanted)
    begun = states[: scene.robot.nq].T.copy(), states[scene.robot.nq :].T.copy(), values
    if choose_contact_method(scene, contact).method is not None or differs_beyond_numbers(scene, values):
        found = solve_one_by_one(scene, states, values, times, asked, told, verify=verify, contact=contact)
    else:
        found = _in_batch(scene, states, values, times, accuracy, told, verify=verify)
    qs, vs = found.q[kept], found.v[kept]
    qs[wanted[:, None] > found.ends] = vs[wanted[:, None] > found.ends] = np.nan
    return Worlds(scene.robot, end, found.q[-1], found.v[-1], found.error, accuracy, found.steps, found.cost, wanted,
                  qs, vs, found.events, found.ends, scene, *begun, found.estimated)  # fmt: skip


def _in_batch(
    scene: Scene,
    states: np.ndarray,
    values: Mapping[str, np.ndarray],
    times: np.ndarray,
    accuracy: float,
    progress: Progress | None,
    *,
    verify: bool,
) -> SolvedWorlds:
    """Solve worlds whose steps are a batch, as `solve_one_by_one` does others."""
    equations = equations_of(scene, tuple(values))
    equations.require(0.0, float(times[-1]))
    before = SPENT.seconds
    steps_by = step_map(equations, METHODS["dop853"])
    compiling = SPENT.seconds - before
    close_loops(equations, states)
    states = with_starting_states(equations, states, values)
    parameter_rows = np.array(list(values.values())) if values else None
    check_times = with_check_times(times, CHECKS) if verify else times
    if verify and not can_be_finer(steps_by.method, accuracy):
        raise AccuracyError(f"{accuracy:g} is below what can be verified in batches", argument="accuracy",
                            remedy="ask for 1e-12, or verify=False", code="accuracy-not-verifiable")  # fmt: skip
    x, error, steps, cost = solve_worlds(steps_by, states, check_times, accuracy, parameter_rows, progress,
                                         verify=verify)  # fmt: skip
    q, v = _configurations(equations, x[np.searchsorted(check_times, times)])
    cost = replace(cost, compile_seconds=compiling)
    return SolvedWorlds(q, v, error, steps, cost, np.full(len(steps), times[-1]))


def differs_beyond_numbers(scene: Scene, names: Collection[str]) -> bool:
    """True if worlds that differ in these parameters are no batch of one step.

    They have events, sampled controllers, or loops, constants or states of effects of their own.
    """
    equations, known = equations_of(scene, ticks=True), parameters_of(scene)
    if equations.sampling is not None or any(decides_states(scene, name) for name in names):
        return True
    constant = any(name not in known or not known[name].acts for name in names)
    if equations.has_events and equations.space.states:  # play, whose kinks are to be located
        return True
    if constant or equations.switching is not None or (names and equations.constraints is not None):
        return True
    try:
        equations_of(scene, tuple(names))
    except TypeError:  # a number that a formula takes as a constant, such as a limit of effort
        return True
    return False


def world_states(scene: Scene, q: Any, v: Any, parameters: Any) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """The initial states (nq + nv, n), and the values (n,) of the other parameters by name. Raises SceneError."""
    robot = scene.robot
    if not (parameters is None or isinstance(parameters, Mapping)):
        raise SceneError(f"expected values by name, got {type(parameters).__name__}", argument="parameters",
                         remedy='such as {"forearm.mass": [1.0, 2.0]}')  # fmt: skip
    by_name = {str(name): value for name, value in (parameters or {}).items()}
    known = named_parameters(scene, by_name, "parameters")
    qs = configuration("q", scene.q if q is None else q, robot.nq, robot.joints)
    vs = array("v", scene.v if v is None else v, robot.nv)
    values = {parameter.name: _values(parameter, by_name[parameter.name]) for parameter in known}
    _check_effects(scene, values)
    sizes = {"q": qs.shape[:-1], "v": vs.shape[:-1], **{name: a.shape for name, a in values.items()}}
    try:
        shape = np.broadcast_shapes(*sizes.values())
    except ValueError:
        raise SceneError(f"the worlds do not match: {sizes}", where="q, v, parameters",
                         remedy="give each one world, or the same number") from None  # fmt: skip
    if len(shape) > 1:
        raise SceneError(f"expected worlds (n,), got {shape}", argument="q", remedy="reshape to (n, nq)")
    count = shape[0] if shape else 1
    if count == 0:
        raise SceneError("there are no worlds", argument="q", remedy="give at least one")
    qs, vs = (np.broadcast_to(x, (count, x.shape[-1])).copy() for x in (qs, vs))
    for parameter in known:
        if parameter.kind in ("q", "v"):
            parameter.put(qs, vs, values.pop(parameter.name))
    states = np.ascontiguousarray(np.concatenate([qs, vs], axis=1).T)
    values = {name: np.broadcast_to(a, (count,)).copy() for name, a in values.items()}
    _check_bodies(scene, values)
    return states, values


def _check_effects(scene: Scene, values: Mapping[str, np.ndarray]) -> None:
    """Require that effects may have the smallest and the largest of the values of their numbers. Raises SceneError."""
    for name in (name for name in values if name.startswith(PREFIX)):
        for value in (values[name].min(), values[name].max()) if values[name].size else ():
            scene_with(scene, {name: float(value)})


def _check_bodies(scene: Scene, values: Mapping[str, np.ndarray]) -> None:
    """Require that bodies without a mass or a moment of inertia may be, in all worlds (n,). Raises SceneError."""
    constants = {name: x for name, x in values.items() if not name.startswith(PREFIX)}
    zero = np.array([x == 0.0 for name, x in constants.items() if name.endswith(NOT_NEGATIVE)])
    if zero.any():
        which, first = np.unique(zero, axis=1, return_index=True)  # the same ones are 0 in the other worlds
        for world in first[which.any(axis=0)]:
            scene_with(scene, {name: float(x[world]) for name, x in constants.items()})


def _values(parameter: Parameter, value: Any) -> np.ndarray:
    """The values (...,) of a parameter: finite numbers that it can have."""
    where = f"parameters[{parameter.name!r}]"
    try:
        numbers = np.asarray(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise SceneError(f"expected numbers, got {value!r:.60}", where=where, argument="parameters",
                         remedy="one, or one for each world") from None  # fmt: skip
    checked = np.asarray(array(where, numbers[..., None], 1)[..., 0])
    if (checked < parameter.lowest).any():
        raise SceneError(f"expected at least {parameter.lowest:g}, got {float(checked.min()):g}", where=where,
                         argument="parameters", remedy="give numbers of at least that")  # fmt: skip
    return checked


def close_loops(equations: Equations, states: np.ndarray) -> None:
    """Move the starts onto the loops, in place. Raises SceneError with the world that cannot be closed."""
    if equations.constraints is None:
        return
    for world in range(states.shape[1]):
        try:
            states[:, world] = assembled(equations.constraints, states[:, world])
        except SceneError as error:
            raise SceneError(error.what, where=f"world {world}", remedy=error.remedy) from None


def _configurations(equations: Equations, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(q (m, n, nq), v (m, n, nv)) of states (m, size, n); q on its manifold, NaN for a world that is lost."""
    by_world, space = np.moveaxis(x, 2, 1), equations.space
    q, v = by_world[..., : space.nq].copy(), by_world[..., space.v_rows]
    if space.curved:
        finite = np.isfinite(q).all(axis=-1)
        q[finite] = space.robot.normalize(q[finite])
    return q, v
