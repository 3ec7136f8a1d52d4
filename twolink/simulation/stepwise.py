"""Simulation step by step: torques are given, and states are looked at, from step to step."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from twolink.algorithms.motion import Motion
from twolink.algorithms.namespaces import Numbers
from twolink.dynamics.arguments import array, configuration, positive
from twolink.effects.conditions import Condition, FrameReaches, JointReaches
from twolink.effects.inputs import Slot
from twolink.effects.sampled_control import DofTorques
from twolink.effects.switching import switching_of
from twolink.errors import QueryError, SceneError
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.scene_equations import make_equations, starting_states
from twolink.integrate.motion.state import Array
from twolink.integrate.solvers.method_choice import first_tolerance
from twolink.integrate.solvers.ticks import Lanes
from twolink.integrate.steps.methods import METHODS
from twolink.integrate.steps.perturbation import NO_PERTURBATION, disturbed_solutions, finer_solution
from twolink.integrate.steps.step_map import step_map
from twolink.scenes import Scene
from twolink.scenes.scene import accuracy_of
from twolink.simulation.error_bar import DISTURBED, common_rounding, distances, error_bar, truncation_factor
from twolink.simulation.sampling import duration_for

METHOD = METHODS["dop853"]
ROUNDED = 2  # solutions that are disturbed by rounding, with verify
SAME_TIME = 1e-12  # relative
LOOKS = 64  # parts of the longest time to an event, after which it is looked for
MANY = 1_000_000  # steps, after which the count of steps begins anew


class State(NamedTuple):
    """A state on the way: t, s; q (nq,), v (nv,); z: the states of effects, by name."""

    t: float
    q: Array
    v: Array
    z: dict[str, float]


Missing = Callable[[State], float]  # 0 at an event


@dataclass(frozen=True, eq=False)
class Saved:
    """Where a simulation was; for `Simulation.restore`."""

    scene: Scene
    lanes: Lanes
    state: Array
    bar: float
    steps: int


def with_held_torques(scene: Scene, q: Array, v: Array) -> tuple[Equations, slice]:
    """The equations of a scene from a state on, with torques that are rows of the state; and these rows.

    Raises SceneError, code "not-step-by-step".
    """
    names = [f"torque {k}" for k in range(scene.robot.nv)]
    held = DofTorques({name: Slot(name) for name in names})
    switches = switching_of(scene.base, scene.robot, scene.effects)
    if switches is not None or any(effect.at_ticks == "controller" for effect in scene.effects):
        raise SceneError("events and sampled controllers are not solved step by step yet", where="effects",
                         remedy="tl.simulate; or smooth effects, and the controller's torques as tau",
                         code="not-step-by-step")  # fmt: skip
    equations = make_equations(scene.robot, q, v, [*enumerate(scene.effects), (len(scene.effects), held)])
    if equations.has_events or len(equations.layout.tables) > len(names):
        raise SceneError("limits of effort and tables of samples are not solved step by step", where="effects",
                         remedy="limit and look up the torques before step(dt, tau)",
                         code="not-step-by-step")  # fmt: skip
    rows = [at.start for at, _ in equations.layout.rows_of_tables()]  # of the slots, as there are no tables
    return equations, slice(rows[0], rows[-1] + 1)


def start_of(scene: Scene, equations: Equations, q: ArrayLike, v: ArrayLike) -> Array:
    """The state (size,) of equations without loops at q, v: effects begin there, and no torques act."""
    at = (
        configuration("q", one("q", q, scene.robot.nq), scene.robot.nq, scene.robot.joints),
        one("v", v, scene.robot.nv),
    )
    motion = Motion(equations.robot.model, equations.mechanism, list(at[0]), list(at[1]), 0.0, Numbers)
    z = np.array(list(starting_states(scene.effects, motion).values()), dtype=float)
    return np.concatenate([*at, z, equations.layout.numbers_at(0.0)])


def one(name: str, value: ArrayLike, size: int) -> Array:
    """Finite numbers (size,). Raises QueryError that names the argument."""
    given = array(name, value, size)
    if given.ndim != 1:
        raise QueryError(f"expected shape ({size},), got {given.shape}", argument=name, remedy="give one state")
    return given


def state_of(scene: Scene, equations: Equations, t: float, x: Array) -> State:
    """A row of states (size,) as what is seen, in copies."""
    space = equations.space
    q = scene.robot.normalize(x[: space.nq]) if space.curved else x[: space.nq].copy()
    return State(t, q, x[space.v_rows].copy(), dict(zip(space.states, x[space.z_rows].tolist(), strict=True)))


class Simulation:
    """A scene that is solved step by step, with torques that are given from step to step.

    The steps of the method go on across calls: their size is that of the accuracy, and a call only ends one of them.

    Parameters
    ----------
    scene : Scene
        Without events (stops, friction, contact, limits of effort) and sampled controllers.
    accuracy : float
        Which the tolerance of the steps is chosen for, rad or m. The error is kept below it over about the scene's
        duration; `error` tells, with `verify`.
    verify : bool
        Solve beside the motion a finer solution, and two that are disturbed by rounding: `error`. All have the torques
        that are given; how they would differ, were they computed from the others' states, is not in it.

    Raises
    ------
    SceneError
        The scene has events, tables or sampled controllers (code "not-step-by-step").

    Examples
    --------
    >>> import twolink as tl
    >>> sim = tl.Simulation(tl.load_scene("arm-swing"))
    >>> for _ in range(100):
    ...     t, q, v, _ = sim.state
    ...     state = sim.step(1e-3, tau=-5.0 * q - v)
    >>> round(state.t, 6)
    0.1
    """

    def __init__(self, scene: Scene, *, accuracy: float = 1e-6, verify: bool = False) -> None:
        duration_for(scene, None)  # raises SceneError for what is no scene
        self.scene, self._tolerance = scene, first_tolerance(METHOD, accuracy_of(accuracy))
        others = (finer_solution(METHOD, self._tolerance), *disturbed_solutions(ROUNDED)) if verify else ()
        self._solutions, self._bar, self._steps = (NO_PERTURBATION, *others), 0.0, 0
        self._equations, self._torques = with_held_torques(scene, scene.q, scene.v)
        self._map = step_map(self._equations, METHOD)
        self._lanes = self._begun(self._equations, 0.0)

    def _begun(self, equations: Equations, t: float) -> Lanes:
        """Solutions that begin at a time with the equations' start."""
        self._map.equations = equations
        return Lanes(self._map, t, t + self.scene.duration, self._tolerance, self._solutions)

    @property
    def t(self) -> float:
        """The time, s."""
        return self._lanes.time

    @property
    def state(self) -> State:
        """Where the motion is, in copies."""
        return state_of(self.scene, self._equations, self._lanes.time, self._lanes.x[:, 0])

    @property
    def error(self) -> float:
        """A bound on the error of q so far, rad or m, for the torques that were given; NaN without `verify`."""
        if len(self._solutions) == 1:
            return math.nan
        x, space = self._lanes.x[: self._equations.moving], self._equations.space
        steps = self._steps + self._lanes.counts[0]
        off = distances(space, x[None, :, :1], x[None, :, 1:])[0]
        bar = truncation_factor(METHOD, steps) * off[0] + DISTURBED[ROUNDED] * off[1:].max()
        same = common_rounding(space, np.array([0.0, 1.0]), np.stack([x[:, 0]] * 2), steps)[1]
        self._bar = max(self._bar, float(error_bar(np.array([bar]), np.zeros(1))[0] + same))
        return self._bar

    def step(self, dt: float, tau: ArrayLike | None = None) -> State:
        """Go on for a time with constant torques.

        Parameters
        ----------
        dt : float
            s.
        tau : array_like (nv,), optional
            Generalized forces, N m and N, from now on; by default those that act already, at first 0.

        Returns
        -------
        State
            Where the motion is then.

        Raises
        ------
        AccuracyError
            The motion cannot be solved on; the simulation stays where it got to.
        """
        lanes = self._lanes
        if tau is not None:
            given = np.asarray(tau, dtype=float)
            if given.shape != (self._torques.stop - self._torques.start,) or not np.isfinite(given).all():
                one("tau", tau, self.scene.robot.nv)  # says what is wrong
            lanes.x[self._torques] = given[:, None]
        if not 0.0 < dt < math.inf:
            positive(dt, "dt", SceneError, "a time in s")
        lanes.advance(lanes.time + dt)
        if len(self._solutions) > 1:
            _ = self.error
        if lanes.counts[0] > MANY:
            x, self._steps = lanes.x.copy(), self._steps + lanes.counts[0]
            self._lanes = self._begun(self._equations.starting_at(x[:, 0], lanes.time), lanes.time)
            self._lanes.x[:] = x
        return self.state

    def run_until(self, event: Condition | Missing, limit: float, tau: ArrayLike | None = None) -> bool:
        """Go on until a quantity passes 0.

        Parameters
        ----------
        event : JointReaches, FrameReaches or callable
            A condition of `tl.effects`, or a function of the state that changes its sign at the event.
        limit : float
            The longest time to go on, s.
        tau : array_like (nv,), optional
            As in `step`.

        Returns
        -------
        bool
            Whether the event came: the simulation stands at it, else at the limit. Of two events within a 64th of the
            limit it may miss both.

        Raises
        ------
        SceneError
            The limit is not a time, or the condition does not fit the robot.
        """
        limit, missing = positive(limit, "limit", SceneError, "a time in s"), self._distance(event)
        end, value = self.t + limit, missing(self.state)
        while self.t < end * (1.0 - SAME_TIME):
            before = self.save()
            self.step(min(end - self.t, limit / LOOKS), tau)
            now = missing(self.state)
            if value * now < 0.0 or now == 0.0:
                self._back_to(before, self.t, missing, tau)
                return True
            value = now
        return False

    def _back_to(self, before: Saved, after: float, missing: Missing, tau: ArrayLike | None) -> None:
        """Stand at the zero of `missing` between what was saved and the time `after`."""

        def at(dt: float) -> float:
            self.restore(before)
            return missing(self.step(dt, tau) if dt > 0.0 else self.state)

        self.restore(before)
        at(brentq(at, 0.0, after - self.t, xtol=1e-15 * max(1.0, after), rtol=1e-15))

    def _distance(self, event: Condition | Missing) -> Missing:
        if not isinstance(event, JointReaches | FrameReaches):
            return event
        event.check(self.scene.robot, "event")
        model, mech = self._equations.robot.model, self._equations.mechanism
        return lambda at: float(event.distance(Motion(model, mech, list(at.q), list(at.v), at.t, Numbers)))

    def set_state(self, q: ArrayLike | None = None, v: ArrayLike | None = None, t: float | None = None) -> None:
        """Go on from another state, with the states of effects that they begin with, no torques, and a new error.

        Parameters
        ----------
        q, v : array_like, optional
            By default those there are.
        t : float, optional
            s; by default the time it is.
        """
        now = self.state
        start = start_of(self.scene, self._equations, now.q if q is None else q, now.v if v is None else v)
        if self._equations.constraints is None:
            self._equations = replace(self._equations, start=start)
        else:  # loops are closed
            space = self._equations.space
            self._equations, _ = with_held_torques(self.scene, start[: space.nq], start[space.v_rows])
        self._bar, self._steps = 0.0, 0
        self._lanes = self._begun(self._equations, now.t if t is None else float(t))

    def save(self) -> Saved:
        """All that the motion goes on from."""
        return Saved(self.scene, copy.copy(self._lanes), self._lanes.state.copy(), self._bar, self._steps)

    def restore(self, saved: Saved) -> None:
        """Go on from where it was saved, with the same bits. Raises SceneError for what another scene saved."""
        if saved.scene is not self.scene:
            raise SceneError("it was saved by a simulation of another scene", where="saved", code="other-scene",
                             remedy="restore it there, or set_state")  # fmt: skip
        self._lanes, self._bar, self._steps = copy.copy(saved.lanes), saved.bar, saved.steps
        self._lanes.state, self._lanes.spare = saved.state.copy(), np.empty_like(saved.state)
