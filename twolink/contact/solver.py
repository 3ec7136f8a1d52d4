"""Stepping a scene from sample to sample: its smooth effects as equations, the others as impulses."""

from __future__ import annotations

import functools
import weakref
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from twolink.contact.joints import LoopRows
from twolink.contact.stepping import ContactStepper
from twolink.contact.steps import Record, Step, StepPlan, plan_steps
from twolink.effects.contact import Contact
from twolink.effects.loops import Loop
from twolink.effects.sensors import Forces
from twolink.effects.switching import Hold, Stop, SwitchingEffect
from twolink.errors import ControllerError, SceneError
from twolink.geometry.points import pair_of
from twolink.integrate.joint_forces import accelerations_and_joint_torques
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.scene_equations import make_equations, sampled
from twolink.integrate.motion.state import Array
from twolink.integrate.solution import Impulse, Piece, Progress
from twolink.loop.clock import SAME_TIME
from twolink.loop.sampled_loop import SampledLoop, Sampling
from twolink.scenes import Scene

OVERLAP = 1e-9  # m, at the start
_smooth: weakref.WeakKeyDictionary[Scene, tuple[Equations, Equations]] = weakref.WeakKeyDictionary()


def stepper_of(scene: Scene) -> ContactStepper:
    """The stepper of a scene. Raises SceneError for what cannot be stepped."""
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
        sampling, every = sampled(scene)
        smooth = [(place, effect) for place, effect in enumerate(every)
                  if not isinstance(effect, SwitchingEffect)]  # fmt: skip
        looped = replace(make_equations(scene.robot, scene.q, scene.v, smooth), sampling=sampling)
        free = [(place, effect) for place, effect in smooth if not isinstance(effect, Loop)]
        q, v = looped.space.rows(looped.start)
        _smooth[scene] = looped, looped if looped.constraints is None else replace(
            make_equations(scene.robot, q, v, free), sampling=sampling)  # fmt: skip
    with_loops, equations = _smooth[scene]
    if equations.space.states:
        raise SceneError(f"effects with states of their own, such as {equations.space.states[0]!r}, cannot be stepped",
                         argument="contact", remedy='contact="located", or leave them out',
                         code="not-stepped")  # fmt: skip
    loops = None if with_loops.constraints is None else LoopRows(with_loops, with_loops.constraints)
    stepper = ContactStepper(equations, effects, stops, holds, loops)
    overlap, pair = stepper.overlap(equations.start[: equations.space.nq])
    if overlap > OVERLAP:
        raise SceneError(f"{pair} overlap by {overlap:.3g} m at the start", where="q", code="overlap",
                         remedy="start with bodies apart, and joints within their stops")  # fmt: skip
    return stepper


REPORT = 50  # steps
Pressing = dict[str, list[tuple[Array, Array, Array]]]  # by pair points, m, forces, N, and slips, m/s


@dataclass(frozen=True, eq=False)
class SteppedSolution:
    """States at samples, and between them by interpolation.

    Parameters
    ----------
    pieces : tuple of Piece
        One: the equations without contacts.
    t : ndarray (n,)
        Times of the samples, s.
    q, v, a : ndarray (n, nq), (n, nv), (n, nv)
        Configurations, velocities, and the mean accelerations over the step before each sample; over the first step at
        the first sample. So it is with `held`, `numbers` and `pressing`.
    held : ndarray (n, nv)
        The mean torques of joints' stops and dry friction over that step, N m or N.
    numbers : ndarray (n, m)
        The numbers that held behind (q, v) in that step.
    pressing : sequence of dict
        Of each sample by pair the points that pressed in the step before it, with their mean forces, N, and their slips
        at its end, m/s.
    record : Record
        What the steps were and how they obey the laws.
    overlap : float
        The largest overlap of bodies at a sample, m.
    step : float
        The longest step, but for halved ones, s.
    interrupted : bool
        Ctrl-C ended it.
    unfollowed : ndarray (n,)
        By how much bounces that were too low for the steps would have moved a joint at most, up to each sample, rad or
        m.
    loop : SampledLoop or None
        The controllers and sensors, where there are any.
    impulses : tuple of Impulse
        Those of impacts.
    """

    pieces: tuple[Piece, ...]
    t: Array
    q: Array
    v: Array
    a: Array
    held: Array
    numbers: Array
    pressing: Sequence[Pressing]
    record: Record
    overlap: float
    step: float
    unfollowed: Array
    interrupted: bool = False
    loop: SampledLoop | None = None
    impulses: tuple[Impulse, ...] = ()

    def states(self, times: Array) -> Array:
        """The states (nq + nv, m) at times (m,), interpolated between samples."""
        model = self.pieces[0].equations.robot.model
        after = np.clip(np.searchsorted(self.t, times, side="left"), 1, max(1, len(self.t) - 1))
        out = np.empty((self.q.shape[1] + self.v.shape[1], len(times)))
        for k, (i, t) in enumerate(zip(np.minimum(after, len(self.t) - 1).tolist(), times.tolist(), strict=True)):
            share = (t - self.t[i - 1]) / (self.t[i] - self.t[i - 1]) if i else 0.0
            q = pin.interpolate(model, self.q[i - 1], self.q[i], share)
            out[:, k] = np.concatenate([q, self.v[i - 1] + share * (self.v[i] - self.v[i - 1])])
        return out

    def accelerations_and_torques(self) -> tuple[Array, Array]:
        """Mean accelerations over the step before each sample (n, nv), and applied joint torques (n, nv)."""
        states = np.concatenate([self.q, self.v, self.numbers], axis=1).T
        return self.a, accelerations_and_joint_torques(self.pieces[0].equations, self.t, states)[1].T + self.held

    def forces_on_links(self) -> dict[str, tuple[Array, Array]]:
        """None: steps have no equations of motion."""
        return {}

    def contacts(self) -> dict[str, tuple[Array, Array]]:
        """As `DenseOutput.contacts`: points (n, k, 3) and forces (n, k, 3) by pair, means over the step before."""
        return {pair: (rows[0], rows[1]) for pair, rows in self._rows.items()}

    def contact_slips(self) -> dict[str, tuple[Array, Array]]:
        """As `contacts`, with slips of the first body on the second, m/s, in place of forces."""
        return {pair: (rows[0], rows[2]) for pair, rows in self._rows.items()}

    @functools.cached_property
    def _rows(self) -> dict[str, Array]:
        """By pair points, forces and slips (3, n, k, 3)."""
        most: dict[str, int] = {}
        for found in self.pressing:
            for pair, rows in found.items():
                most[pair] = max(most.get(pair, 0), len(rows))
        out = {pair: np.full((3, len(self.t), k, 3), np.nan) for pair, k in most.items()}
        for sample, found in enumerate(self.pressing):
            for pair, rows in found.items():
                out[pair][:, sample, : len(rows)] = np.array(rows).swapaxes(0, 1)
        return out


def _means(stepper: ContactStepper, one: Step) -> tuple[Array, Array]:
    """The mean acceleration over a step (nv,), and the mean torques of joints' stops and dry friction (nv,)."""
    mean = stepper.bodies.to_local_velocity(one.q, one.mean)
    return mean, np.zeros_like(mean) if one.joints is None else one.joints / one.h


def _pressing(stepper: ContactStepper, one: Step) -> Pressing:
    """By pair the points that press in a step, their mean forces, and their slips."""
    found: Pressing = {}
    slips = np.zeros_like(one.place) if one.slips is None else one.slips
    for pair, place, impulse, slip in zip(pair_of(one.keys).tolist(), one.place, one.on_first, slips, strict=True):
        found.setdefault(stepper.detector.names[pair], []).append((place, impulse / one.h, slip))
    return found


def _impulses(stepper: ContactStepper, begin: float, one: Step) -> Iterator[Impulse]:
    """Impulses of the impacts in a step."""
    for blow in one.blows:
        for pair, p in zip(pair_of(blow.keys).tolist(), blow.on_first, strict=True):
            yield Impulse(begin + blow.late, stepper.detector.names[pair], p)


@np.errstate(over="ignore", invalid="ignore")  # what steps that are too long give is refused ("step-too-large")
def solve_stepped(
    stepper: ContactStepper, times: Array, step: float, progress: Progress | None = None, halvings: int = 0
) -> SteppedSolution:
    """Step a scene for samples at times (n,), in steps of at most `step` [s]. Raises AccuracyError.

    halvings: see `plan_steps`.
    """
    equations, record = stepper.equations, Record()
    nq, local = equations.space.nq, stepper.bodies.to_local_velocity
    q, v = np.array(equations.start[:nq]), np.array(equations.start[nq : equations.moving])
    plan, first = plan_steps(equations, times, step, halvings), 0
    none = np.zeros_like(v)
    states, overlap = [(q, v, none, none, plan.numbers[0], 0.0)], stepper.overlap(q)[0]
    pressing: list[Pressing] = [{}]
    impulses: list[Impulse] = []
    ticks = None if equations.sampling is None else _SteppedTicks(equations, equations.sampling, plan)
    v = local(q, v, -1)
    memory = stepper.start(float(times[0]), q, v, equations.layout.numbers_at(float(times[0])))
    stepper.record, interrupted, failed = record, False, None
    try:
        while first < len(plan.h):
            until = len(plan.h) if ticks is None else ticks.next(first, q, local(q, v))
            steps = stepper.run(plan, first, until, q, v, memory)
            if first == 0:
                states[0] = (*states[0][:2], *_means(stepper, steps[0]), plan.numbers[0].copy(), 0.0)
                pressing[0] = _pressing(stepper, steps[0])
            for j in np.flatnonzero(plan.sampled[first : first + len(steps)]).tolist():
                one = steps[j]
                pressing.append(_pressing(stepper, one))
                now = plan.numbers[plan.piece[first + j]].copy()
                states.append((one.q, local(one.q, one.v), *_means(stepper, one), now, one.memory.unfollowed))
                overlap = max(overlap, stepper.overlap(one.q)[0] if one.overlap is None else one.overlap)
            end = steps[len(steps) - 1]
            impulses += _impulses(stepper, float(plan.t[first]), end)  # what repeats or rests has none
            q, v, memory = end.q, end.v, end.memory
            last, first = first, first + len(steps)
            if progress is not None and first // REPORT > last // REPORT:
                progress(float(plan.t[first - 1]))
        if ticks is not None:
            ticks.end(first, q, local(q, v))
    except KeyboardInterrupt:
        interrupted = True
    except ControllerError as error:
        interrupted, failed = True, error
    qs, vs, accelerations, held, numbers, unfollowed = (np.array(column) for column in zip(*states, strict=True))
    n, loop = len(qs), None if ticks is None else ticks.loop
    readings = None if loop is None else loop.readings
    solution = SteppedSolution((Piece(equations, float(times[0]), n, readings=readings),), times[:n], qs, vs,
                               accelerations, held, numbers, pressing[:n], record, overlap, float(plan.h.max()),
                               unfollowed, interrupted, loop, tuple(impulses))  # fmt: skip
    if failed is not None:
        failed.run = solution
        raise failed
    return solution


class _SteppedTicks:
    """The controllers and sensors of one solution; ends of steps are their ticks."""

    def __init__(self, equations: Equations, sampling: Sampling, plan: StepPlan) -> None:
        self._plan, moving = plan, equations.moving
        self._x = np.array(equations.start[:, None], dtype=float)
        self._x[moving:, 0] = plan.numbers[0]
        rows = equations.layout.rows_of_slots()
        self._rows = np.array(list(rows.values()), dtype=int)
        self._numbers = self._rows - moving
        self.loop = SampledLoop(sampling, rows, equations.space.states, self._x, no_forces)

    def next(self, first: int, q: Array, v: Array) -> int:
        """Let happen what is due before the step `first` from (q, v). Returns the step before which more is."""
        plan, loop = self._plan, self.loop
        t = float(plan.t[first]) if first < len(plan.t) else float(plan.t[-1] + plan.h[-1])
        while loop.time <= t * (1.0 + SAME_TIME):
            self._x[: len(q) + len(v), 0] = np.concatenate([q, v])
            loop.tick(self._x)
            if first < len(plan.t):
                plan.numbers[plan.piece[first] :, self._numbers] = self._x[self._rows, 0]
        return int(np.searchsorted(plan.t, loop.time * (1.0 - SAME_TIME)))

    def end(self, first: int, q: Array, v: Array) -> None:
        """Let happen what is due at the end, and require laws that remember nothing beside their states."""
        self.next(first, q, v)
        self.loop.require_repeatable()


def no_forces(*_: object) -> Forces:
    """Raises SceneError, code "sensor-of-forces"."""
    raise SceneError("the forces of stepped contacts are means over steps: no sensor reads them", where="effects",
                     remedy='contact="located", or sensors of positions and velocities; afterwards run.tau and '
                            "run.contact_forces", code="sensor-of-forces")  # fmt: skip
