"""Simulation step by step: torques are given, and states are looked at, from step to step."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from twolink.algorithms.motion import KinematicState
from twolink.algorithms.namespaces import Numbers
from twolink.contact.choice import choose_contact_method
from twolink.dynamics.arguments import array, configuration, positive
from twolink.effects.conditions import Condition, FrameReaches, JointReaches, check_condition
from twolink.effects.inputs import SAME_TIME, Sampled, curve_end, require_curves
from twolink.errors import QueryError, SceneError
from twolink.integrate.core.motion import Motion, drive, loop_of
from twolink.integrate.core.smooth import SmoothMotion
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.scene_equations import equations_of, sampled, with_starting_states
from twolink.integrate.motion.state import Array
from twolink.integrate.solution import Event, events_of
from twolink.integrate.solver import first_tolerance
from twolink.integrate.steps.step_map import step_map
from twolink.scenes import Scene
from twolink.scenes.scene import accuracy_of
from twolink.simulation.motion_error import METHOD, NEARER, MotionError, solutions_of
from twolink.simulation.sampling import duration_for

LOOKS = 64  # parts of the longest time to an event, after which it is looked for


class State(NamedTuple):
    """A state on the way: t, s; q (nq,), v (nv,); z: the states of effects, by name."""

    t: float
    q: Array
    v: Array
    z: dict[str, float]


Missing = Callable[[State], float]  # 0 at an event


@dataclass(frozen=True, eq=False)
class Saved:
    """A saved point of a simulation; for `Simulation.restore`.

    settings: of the simulation. start: q, v, t that the motion began with. motion, loop, error: all that the solutions,
    the controllers and the error go on from.
    """

    scene: Scene
    settings: tuple[float, bool, bool, float]
    start: tuple[Array, Array, float]
    motion: Any
    loop: Any
    error: Any


def equations_held(scene: Scene, names: Sequence[str]) -> tuple[Equations, slice]:
    """The equations of a scene with torques of these names, and their rows. Raises SceneError, "not-step-by-step"."""
    equations = equations_of(scene, ticks=True)
    equations = equations if equations.sampling is None else replace(equations, sampling=None)
    if any(isinstance(table, Sampled) for table in equations.layout.tables):
        raise SceneError("tables of samples are not solved step by step", where="effects", code="not-step-by-step",
                         remedy="look up the torques before step(dt, tau)")  # fmt: skip
    first = equations.layout.rows_of_slots().get(names[0], equations.moving) if names else equations.moving
    return equations, slice(first, first + len(names))


def start_of(scene: Scene, equations: Equations, q: ArrayLike, v: ArrayLike) -> Array:
    """The state (size,) of equations without loops at q, v: effects begin there, and no torques act."""
    robot = scene.robot
    at = configuration("q", one("q", q, robot.nq), robot.nq, robot.joints), one("v", v, robot.nv)
    return np.concatenate([with_starting_states(equations, np.concatenate(at)), equations.layout.numbers_at(0.0)])


def one(name: str, value: ArrayLike, size: int) -> Array:
    """Finite numbers (size,). Raises QueryError that names the argument."""
    given = array(name, value, size)
    if given.ndim != 1:
        raise QueryError(f"expected shape ({size},), got {given.shape}", argument=name, remedy="give one state")
    return given


def state_of(scene: Scene, equations: Equations, t: float, x: Array) -> State:
    """A row of states (size,) as what is seen, in copies."""
    space = equations.space
    own = x[: space.moving].copy()
    q = scene.robot.normalize(own[: space.nq]) if space.curved else own[: space.nq]
    z = dict(zip(space.states, own[space.z_rows].tolist(), strict=True)) if space.states else {}
    return State(t, q, own[space.v_rows], z)


class Simulation:
    """A scene that is solved step by step, with torques that are given from step to step.

    The steps of the method go on across calls: their size is that of the accuracy, and a call only ends one of them.
    Events (stops, dry friction, contacts, limits of effort) are located, as `simulate` does. Sampled controllers and
    sensors are called at their ticks; what is given as tau adds to the torques that controllers hold.

    Parameters
    ----------
    scene : Scene
        Without tables of samples.
    accuracy : float
        Which the tolerance of the steps is chosen for, rad or m. The error is kept below it over about the scene's
        duration; `error` tells, with `verify`.
    verify : bool
        Solve beside the motion a finer solution, and two that are disturbed by rounding: `error`. All have the torques
        that are given; how they would differ, were they computed from the others' states, is not in it.
    contact : {"located", "stepped"}, optional
        How contacts, stops and dry friction are computed, as of `simulate`.
    step : float
        The longest step of stepped contacts, s; their error is estimated.

    Raises
    ------
    SceneError
        The scene has tables of samples (code "not-step-by-step").

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

    def __init__(
        self, scene: Scene, *, accuracy: float = 1e-6, verify: bool = False, contact: str | None = None,
        step: float = 1e-3,
    ) -> None:  # fmt: skip
        duration_for(scene, None)  # raises SceneError for what is no scene
        self.scene, self._verify = scene, verify
        self._tolerance = first_tolerance(METHOD, accuracy_of(accuracy))
        self._solutions = solutions_of(self._tolerance, verify=verify)
        self._stepped = choose_contact_method(scene, contact).method == "stepped"
        self._step = positive(step, "step", SceneError, "such as 1e-3")
        self._driven, self._names = scene.with_held_torques()
        self._curves_end = curve_end(scene.effects)
        self._settings = self._tolerance, verify, self._stepped, self._step
        self._begin(scene.q, scene.v, 0.0)

    def _begin(self, q: Array, v: Array, t: float) -> None:
        """Begin at a state, with controllers that begin anew."""
        motion = self._motion = self._motion_from(q, v, t)
        self._start, sampling = (q, v, t), sampled(self._driven)[0]
        first = motion.equations.layout.rows_of_slots().get(self._names[0], 0) if self._names else 0
        self._torques = slice(first, first + len(self._names))
        self._loop = None if sampling is None else loop_of(motion, sampling, endless=True)
        self._error = MotionError(motion) if self._verify else None

    def _motion_from(self, q: Array, v: Array, t: float) -> Motion:
        """The motion from a state on, without controllers."""
        driven = self._driven
        if self._stepped:
            from twolink.contact.solver import SteppedMotion, stepper_of, steps_of  # which other scenes do not load

            plans = [steps_of(self._step, doubled) for doubled in range(1 + self._verify)]
            return SteppedMotion(stepper_of(driven.with_start(q, v)), t, plans)
        equations = equations_held(driven, self._names)[0]
        if equations.constraints is None:
            equations = replace(equations, start=start_of(driven, equations, q, v))
        elif not (np.array_equal(q, driven.q) and np.array_equal(v, driven.v)):  # loops are closed
            self._driven = driven.with_start(q, v)
            equations = equations_held(self._driven, self._names)[0]
        if equations.has_events:
            from twolink.integrate.hybrid.engine import Engine
            from twolink.integrate.hybrid.located import LocatedMotion  # with it come the effects of modes

            times = np.array([t, math.inf])
            engines = [Engine(equations, METHOD, times, self._tolerance, None, one) for one in self._solutions]
            return LocatedMotion(engines, endless=True)
        by, nearer = step_map(equations, METHOD), step_map(equations, NEARER)
        return SmoothMotion(by, t, t + self.scene.duration, self._tolerance, self._solutions, nearer=nearer)

    @property
    def t(self) -> float:
        """The time, s."""
        return self._motion.t

    @property
    def ended(self) -> bool:
        """True if an event has ended the motion."""
        return bool(self._motion.ended)

    @property
    def events(self) -> Sequence[Event]:
        """The located events so far, and with `verify` ambiguous ticks and from when a loop is unstable."""
        loop = self._loop if self._verify else None
        return (*self._motion.events, *(() if loop is None else events_of(loop)))

    @property
    def state(self) -> State:
        """The state of the motion, in copies."""
        motion = self._motion
        return state_of(self.scene, motion.equations, motion.t, motion.x[:, 0])

    @property
    def error(self) -> float:
        """A bound on the error of q so far, rad or m, for the torques that were given; NaN without `verify`.

        Of stepped contacts an estimate.
        """
        return math.nan if self._error is None else self._error.largest

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
        SceneError
            An event has ended the motion (code "motion-ended"), or a curve has (code "curve-ends").
        """
        motion = self._motion
        if tau is not None:
            try:
                given = np.asarray(tau, dtype=float)
            except (TypeError, ValueError):
                given = np.empty(0)
            if given.shape != (len(self._names),) or not math.isfinite(sum(given.tolist())):
                one("tau", tau, self.scene.robot.nv)  # says what is wrong
            x = motion.held()
            x[self._torques] = given[:, None]
            motion.hold(x)
        if not (isinstance(dt, float | int | np.number) and 0.0 < dt < math.inf):
            dt = positive(dt, "dt", SceneError, "a time in s")
        if self.ended:
            raise SceneError("an event has ended the motion", where=f"t = {motion.t:.9g} s", code="motion-ended",
                             remedy="look at events; then restore, or set_state")  # fmt: skip
        end = float(motion.t + dt)
        if end > self._curves_end:
            require_curves(self.scene.effects, end)
        drive(motion, end, self._loop)
        if self._error is not None:
            self._error.note()
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
            Whether the event came: the simulation stands at it, else at the limit, or at an event of the scene that has
            ended the motion. Of two events within a 64th of the limit it may miss both.

        Raises
        ------
        SceneError
            The limit is not a time, or the condition does not fit the robot.
        """
        limit, missing = positive(limit, "limit", SceneError, "a time in s"), self._distance(event)
        end, value = self.t + limit, missing(self.state)
        while self.t < end * (1.0 - SAME_TIME):
            before, to_curves_end = self.save(), self._curves_end - self.t
            ahead = to_curves_end if to_curves_end > SAME_TIME * self.t else math.inf  # an event may come before
            self.step(min(end - self.t, limit / LOOKS, ahead), tau)
            now = missing(self.state)
            if value * now < 0.0 or now == 0.0:
                self._back_to(before, self.t, missing, tau)
                return True
            if self.ended:
                break
            value = now
        return False

    def _back_to(self, before: Saved, after: float, missing: Missing, tau: ArrayLike | None) -> None:
        """Stand at the zero of `missing` between what was saved and the time `after`."""

        def at(dt: float) -> float:
            self.restore(before)
            return missing(self.step(dt, tau) if dt > 0.0 else self.state)

        self.restore(before)
        from scipy.optimize import brentq  # a service's workers start without it

        at(brentq(at, 0.0, after - self.t, xtol=1e-15 * max(1.0, after), rtol=1e-15))

    def _distance(self, event: Condition | Missing) -> Missing:
        if not isinstance(event, JointReaches | FrameReaches):
            if not callable(event):
                raise SceneError(f"expected a condition or a function, got {event!r:.60}", argument="event",
                                 remedy='such as tl.effects.JointReaches("elbow", 0.0)')  # fmt: skip
            return event
        check_condition(event, self.scene.robot, "event")
        model, mech = self._motion.equations.robot.model, self._motion.equations.mechanism
        return lambda at: float(event.distance(KinematicState(model, mech, list(at.q), list(at.v), at.t, Numbers)))

    def set_state(self, q: ArrayLike | None = None, v: ArrayLike | None = None, t: float | None = None) -> None:
        """Go on from another state, with the states of effects that they begin with, no torques, and a new error.

        Parameters
        ----------
        q, v : array_like, optional
            By default those there are.
        t : float, optional
            s; by default the time it is.

        Raises
        ------
        SceneError, QueryError
            They are no state of the robot.
        """
        now = self.state
        if self._loop is not None:  # what its laws have kept would act in the new motion
            self._loop.require_repeatable()
        robot = self.scene.robot
        q = now.q if q is None else one("q", q, robot.nq).copy()
        v = now.v if v is None else one("v", v, robot.nv).copy()
        self._begin(q, v, now.t if t is None else float(one("t", (t,), 1)[0]))

    def save(self) -> Saved:
        """All that the motion goes on from; what controllers keep as their states, in copies."""
        loop, error = self._loop, self._error
        return Saved(self.scene, self._settings, self._start, self._motion.save(), loop and loop.saved(),
                     error and error.saved())  # fmt: skip

    def restore(self, saved: Saved) -> None:
        """Go on from where it was saved, here or by another simulation of the scene, with the same bits.

        Raises
        ------
        SceneError
            A simulation of another scene, or with other arguments, has saved it (code "other-scene").
        """
        if not isinstance(saved, Saved) or saved.scene is not self.scene or saved.settings != self._settings:
            raise SceneError("it was saved by a simulation of another scene, or with other arguments", where="saved",
                             remedy="restore it there, or set_state", code="other-scene")  # fmt: skip
        if saved.start is not self._start:
            self._begin(*saved.start)
            self._start = saved.start
        self._motion.restore(saved.motion)
        if self._loop is not None:
            self._loop.restore(saved.loop)
        if self._error is not None:
            self._error.restore(saved.error)
