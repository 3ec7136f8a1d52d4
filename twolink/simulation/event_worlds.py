"""Worlds one after the other, as `simulate` solves them: with events or controllers, and those whose loops differ."""

import functools
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from twolink.contact.choice import choose_contact_method
from twolink.errors import AccuracyError, ControllerError, SceneError
from twolink.integrate.motion.assembly import assembled
from twolink.integrate.motion.scene_equations import equations_of, with_starting_states
from twolink.integrate.motion.state import Array
from twolink.integrate.solution import Event, Progress
from twolink.integrate.solver import choose
from twolink.scenes import Scene
from twolink.scenes.parameters import scene_with
from twolink.simulation.cost import Cost, together
from twolink.simulation.scene_run import ACCURACY, run_of
from twolink.simulation.trajectory import Trajectory

if TYPE_CHECKING:
    from twolink.contact.stepping import ContactStepper


class SolvedWorlds(NamedTuple):
    """The runs of n worlds at m times.

    q (m, n, nq), v (m, n, nv), where the last is the state at the end, or at the event that ended the world; NaN behind
    that, and for a lost world. error (n,): the bars at the end; None: not verified. steps (n,). cost: of all together.
    ends (n,): when each ended, s. events: of each. estimated: whether some errors are estimates.
    """

    q: Array
    v: Array
    error: Array | None
    steps: Array
    cost: Cost
    ends: Array
    events: tuple[tuple[Event, ...], ...] = ()
    estimated: bool = False


def solve_one_by_one(
    scene: Scene,
    states: Array,
    values: Mapping[str, Array],
    times: Array,
    accuracy: float | None,
    progress: Progress | None = None,
    *,
    verify: bool = True,
    contact: str | None = None,
) -> SolvedWorlds:
    """Solve the worlds from states (nq + nv, n), with parameters (n,) by name, for samples at the times (m,).

    Worlds without parameters share their equations, and so their compiled steps. Raises SceneError with the world whose
    start is refused.
    """
    count, nq, nv = states.shape[1], scene.robot.nq, scene.robot.nv
    q, v = np.full((len(times), count, nq), np.nan), np.full((len(times), count, nv), np.nan)
    error, steps, ends = np.full(count, np.nan), np.zeros(count, dtype=int), np.full(count, np.nan)
    costs, events, estimated = list[Cost](), list[tuple[Event, ...]](), False
    start = runs_of(scene, times, accuracy, verify=verify, contact=contact)
    for i in range(count):
        if values:
            own = scene_with(scene, {name: float(value[i]) for name, value in values.items()})
            start = runs_of(own, times, accuracy, verify=verify, contact=contact)
        run: Trajectory | None
        try:
            run = start(states[:, i])
        except AccuracyError as beyond:
            run = beyond.run  # the best one; None of a lost world
        except ControllerError as failed:
            raise ControllerError(failed.what, where=f"world {i}, {failed.where}", remedy=failed.remedy,
                                  code=failed.code, run=failed.run, **failed.data) from failed  # fmt: skip
        except SceneError as refused:
            raise SceneError(refused.what, where=f"world {i}", remedy=refused.remedy, code=refused.code) from None
        events.append(tuple(run.events) if run else ())
        if run is not None and run.cost is not None:
            reached = np.flatnonzero(np.isin(times, run.t))
            taken = np.searchsorted(run.t, times[reached])
            q[reached, i], v[reached, i] = run.q[taken], run.v[taken]
            q[-1, i], v[-1, i] = run.q[-1], run.v[-1]
            error[i] = np.nan if run.error is None else run.error[-1]
            steps[i], ends[i] = run.cost.steps, run.t[-1]
            costs.append(run.cost)
            estimated |= run.estimated
        if progress is not None:
            progress(float(times[-1]) * (i + 1) / count)
    cost = together(costs[0], costs[1:], "world by world") if costs else Cost("", None, 0, 0, 0.0)
    return SolvedWorlds(q, v, error if verify else None, steps, cost, ends, tuple(events), estimated)


def runs_of(
    scene: Scene, times: Array, accuracy: float | None, *, verify: bool = True, contact: str | None = None
) -> Callable[[Array], Trajectory]:
    """The run of a scene as a function of its start x (nq + nv,), located or stepped as `simulate` chooses.

    accuracy: None as in `simulate`. Runs of one scene share its equations, and so their programs. They raise what
    `simulate` raises.
    """
    nq, chosen = scene.robot.nq, choose_contact_method(scene, contact).method
    if chosen is not None:
        from twolink.contact.solver import stepper_of  # which scenes without contacts do not load
        from twolink.simulation.spliced_run import beyond_located
        from twolink.simulation.stepped_run import simulate_stepped
    steppers: list[ContactStepper] = []  # the last one

    def stepped(x: Array) -> Trajectory:
        own = scene.with_start(x[:nq], x[nq:])
        steppers[:] = [stepper_of(own, *steppers)]
        return simulate_stepped(own, times, accuracy, None, None, verify=verify, stepper=steppers[0])

    def located(x: Array) -> Trajectory:
        equations, bound = equations_of(scene, ticks=True), ACCURACY if accuracy is None else accuracy
        start = x if equations.constraints is None else assembled(equations.constraints, x)
        equations = replace(equations.starting_at(with_starting_states(equations, start), 0.0), assembled=(0.0, 0.0))
        choice = choose(equations, bound, float(times[-1]), "auto")
        try:
            return run_of(scene, equations, choice, times, bound, verify=verify)
        except AccuracyError as error:
            if chosen is None:
                raise
            first = functools.partial(run_of, scene, equations, choice, accuracy=bound, verify=verify)
            beyond = functools.partial(simulate_stepped, accuracy=None, step=None, progress=None, verify=verify)
            effort = contact is None and accuracy is None
            return beyond_located(scene.with_start(x[:nq], x[nq:]), times, error, first, beyond, best_effort=effort)

    return stepped if chosen == "stepped" else located
