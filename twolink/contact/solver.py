"""Stepping a scene from sample to sample: its smooth effects as equations, the others as impulses."""

from __future__ import annotations

import math
import weakref
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from twolink.contact.joints import LoopRows
from twolink.contact.stepped_solution import SteppedSolution, SteppedTrack
from twolink.contact.stepping import ContactStepper
from twolink.contact.steps import Record, StepEnd, plan_steps, twice_as_many
from twolink.effects.contact import Contact
from twolink.effects.inputs import SAME_TIME
from twolink.effects.loops import Loop
from twolink.effects.sensors import Forces, Sensor
from twolink.effects.switching import JointLock, Stop, SwitchingEffect
from twolink.errors import SceneError
from twolink.integrate.core.motion import Motion, again, driven
from twolink.integrate.motion.scene_equations import make_equations, sampled
from twolink.integrate.motion.state import Array
from twolink.integrate.solution import Progress
from twolink.loop.sampled_loop import Sampling
from twolink.native.contact import StepPlan
from twolink.scenes import Scene

OVERLAP = 1e-9  # m, at the start
_steppers: weakref.WeakKeyDictionary[Scene, ContactStepper] = weakref.WeakKeyDictionary()


def stepper_of(scene: Scene, like: ContactStepper | None = None) -> ContactStepper:
    """A stepper of a scene, for one motion. like: that of the same scene with another start, whose parts it takes.

    Raises SceneError for what cannot be stepped.
    """
    if like is not None and like.loops is None:
        return _apart(like.starting_at(scene.q, scene.v))
    if scene not in _steppers:  # its parts are kept as long as the scene is
        _steppers[scene] = _apart(_stepper_of(scene))
    return _steppers[scene].another()


def _apart(stepper: ContactStepper) -> ContactStepper:
    """The stepper, whose bodies are apart at the start."""
    overlap, pair = stepper.overlap_at_begin
    if overlap > OVERLAP:
        raise SceneError(f"{pair} overlap by {overlap:.3g} m at the start", where="q", code="overlap",
                         remedy="start with bodies apart, and joints within their stops")  # fmt: skip
    return stepper


def _stepper_of(scene: Scene) -> ContactStepper:
    """The stepper of a scene, made anew. Raises SceneError for what cannot be stepped."""
    effects = [effect for effect in scene.effects if isinstance(effect, Contact)]
    if any(effect.impacts == "reflections" for effect in effects):
        raise SceneError('Contact with impacts="reflections" is not stepped: expected "newton", one impulse a step',
                         where="impacts", remedy='contact="located", or impacts="newton"',
                         code="not-stepped")  # fmt: skip
    others = [effect for effect in scene.effects if not isinstance(effect, Contact)]
    declared = [item for e in others if isinstance(e, SwitchingEffect) for item in e.modes(scene.robot)]
    stops = [item for item in declared if isinstance(item, Stop)]
    locks = [item for item in declared if isinstance(item, JointLock) and item.entry is None]
    if len(stops) + len(locks) < len(declared):
        raise SceneError("effects that switch, other than joint stops and dry friction, cannot be stepped",
                         argument="contact", remedy='contact="located", or leave them out',
                         code="not-stepped")  # fmt: skip
    sampling, every = sampled(scene)
    sensors = {i: one for i, one in enumerate(every) if isinstance(one, Sensor) and not one.of_forces}
    if sampling is None and sensors:  # which are read afterwards, at the ends of steps
        sampling = Sampling(scene.robot, {}, sensors)
    smooth = [(place, effect) for place, effect in enumerate(every) if not isinstance(effect, SwitchingEffect)]
    with_loops = equations = replace(make_equations(scene.robot, scene.q, scene.v, smooth), sampling=sampling)
    if with_loops.constraints is not None:
        free = [(place, effect) for place, effect in smooth if not isinstance(effect, Loop)]
        start = with_loops.space.rows(with_loops.start)
        equations = replace(make_equations(scene.robot, *start, free), sampling=sampling)
    if equations.space.states:
        raise SceneError(f"effects with states of their own, such as {equations.space.states[0]!r}, cannot be stepped",
                         argument="contact", remedy='contact="located", or leave them out',
                         code="not-stepped")  # fmt: skip
    loops = None if with_loops.constraints is None else LoopRows(with_loops, with_loops.constraints)
    return ContactStepper(equations, effects, stops, locks, loops)


REPORT = 50  # steps
Planned = Callable[[float, float, Array], tuple[StepPlan, range]]


class SteppedMotion(Motion):
    """Solutions with stepped contacts, each by steps of its own.

    Parameters
    ----------
    stepper : ContactStepper
    t : float
        The time of the start, s.
    plans : sequence of callable
        Of each solution: (t, end, numbers (m,)) -> a plan, and the numbers of its steps up to an end.
    track : SteppedTrack, optional
        Of what the first solution passes.
    progress : callable, optional
        Called with the time now and then.
    """

    def __init__(
        self,
        stepper: ContactStepper,
        t: float,
        plans: Sequence[Planned],
        *,
        track: SteppedTrack | None = None,
        progress: Progress | None = None,
    ) -> None:
        self._stepper, self._t, self._plans, self._track, self._progress = stepper, t, plans, track, progress
        self.equations, stepper.record = stepper.equations, Record()
        numbers = self.equations.layout.numbers_at(t)
        self._numbers = np.repeat(numbers[:, None], len(plans), axis=1)
        self._x: Array | None = None
        self.states = [StepEnd(*stepper.begin)] * len(plans)

    @property
    def t(self) -> float:
        """The time, s."""
        return self._t

    @property
    def x(self) -> Array:
        """The states."""
        if self._x is None:
            local = self._stepper.bodies.to_local_velocity
            rows = [part for q, w, _ in self.states for part in (q, local(q, w))]
            self._x = np.concatenate(rows).reshape(len(self.states), -1).T
        return self._x

    @property
    def steps(self) -> int:
        """Steps of all solutions."""
        return self._stepper.record.steps

    @property
    def unfollowed(self) -> float:
        """The most that bounces too low for the steps would have moved a joint, rad or m."""
        return max(state.memory.unfollowed for state in self.states)

    def advance(self, t: float) -> None:
        """Go to a time, s."""
        ends = [self._solved(k, t) for k in range(len(self.states))]
        self.states, self._t, self._x = ends, t, None

    def _solved(self, number: int, end: float) -> StepEnd:
        plan, left = self._plans[number](self._t, end, self._numbers[:, number])
        q, w, memory = self.states[number]
        while left:
            steps = self._stepper.run(plan, left, q, w, memory)
            if self._track is not None:
                self._track.add(left.start, steps)
            (q, w, memory), before, left = steps.end, left.start, left[len(steps) :]
            if self._progress is not None and left.start // REPORT > before // REPORT:
                self._progress(float(plan.t[left.start - 1]))
        return StepEnd(q, w, memory)

    def held(self) -> Array:
        """The states with the numbers."""
        return np.concatenate([self.x, self._numbers])

    def hold(self, x: Array) -> None:
        """Let the numbers hold from now on."""
        self._numbers = x[self.equations.moving :].copy()

    def forces(self, *_: object) -> Forces:
        """Raises SceneError, code "sensor-of-forces": steps have no forces at an instant."""
        raise SceneError("the forces of stepped contacts are means over steps: no sensor reads them", where="effects",
                         remedy='contact="located", or sensors of positions and velocities; afterwards run.tau and '
                                "run.contact_forces", code="sensor-of-forces")  # fmt: skip

    def save(self) -> tuple[float, Array, list[StepEnd]]:
        """The time, the held numbers, and the solutions, none of which is written to."""
        return self._t, self._numbers, self.states

    def restore(self, saved: tuple[float, Array, list[StepEnd]]) -> None:
        """Go on from there."""
        (self._t, self._numbers, self.states), self._x = saved, None


def steps_of(step: float, doubled: int = 0) -> Planned:
    """Equal steps of at most a length [s] to each end; their number is doubled so often (`twice_as_many`)."""
    plan, every = StepPlan(0, np.empty((1, 0))), np.empty(0)  # of the last, for the next of as many steps

    def planned(t: float, end: float, numbers: Array) -> tuple[StepPlan, range]:
        nonlocal plan, every
        count = max(1, math.ceil((end - t) / step - 1e-9))
        for _ in range(doubled):
            count = twice_as_many(count)
        if plan.t.size != count:
            plan, every = StepPlan(count, numbers[None]), np.arange(count, dtype=float)
        h = (end - t) / count
        plan.h.fill(h)
        np.multiply(every, h, out=plan.t)
        plan.t += t
        plan.numbers[0] = numbers
        return plan, range(count)

    return planned


@again
def solve_stepped(
    stepper: ContactStepper, times: Array, step: float, progress: Progress | None = None, halvings: int = 0
) -> SteppedSolution:
    """Step a scene for samples at times (n,), in steps of at most `step` [s]. Raises AccuracyError.

    halvings: see `plan_steps`. Raises ControllerError, whose `run` is the solution so far.
    """
    equations = stepper.equations
    plan, moving = plan_steps(equations, times, step, halvings), equations.moving
    slots = np.array(list(equations.layout.rows_of_slots().values()), dtype=int) - moving

    def planned(t: float, end: float, numbers: Array) -> tuple[StepPlan, range]:
        first, until = np.searchsorted(plan.t, np.array([t, end]) * (1.0 - SAME_TIME)).tolist()
        plan.numbers[plan.piece[first] :, slots] = numbers[slots]  # the others are those of tables
        return plan, range(first, until)

    track = SteppedTrack(stepper, plan, times)
    motion = SteppedMotion(stepper, float(times[0]), [planned], track=track, progress=progress)
    sampling = equations.sampling if equations.sampling and equations.sampling.controllers else None
    return driven(motion, float(times[-1]), sampling,
                  lambda loop, interrupted, _: [track.solution(loop, interrupted=interrupted)])[0]  # fmt: skip
