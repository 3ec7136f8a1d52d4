"""The solution of stepped contacts: states at samples, and what presses there."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from twolink.contact.stepping import ContactStepper
from twolink.contact.steps import SAMPLED, SEEN, Record, Step, TakenSteps
from twolink.geometry.points import pair_of
from twolink.integrate.joint_forces import accelerations_and_joint_torques, wrenches_on_links
from twolink.integrate.motion.state import Array
from twolink.integrate.solution import Code, Impulse, Segment
from twolink.loop.sampled_loop import SampledLoop
from twolink.native.contact import StepPlan

Pressing = dict[str, list[tuple[Array, Array, Array]]]  # by pair points, m, forces, N, and slips, m/s


@dataclass(frozen=True, eq=False)
class SteppedSolution:
    """States at samples and where sensors are read, and between them by interpolation.

    Parameters
    ----------
    segments : tuple of Segment
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
    compiled : {"steps", ""}
        Whether the steps were native.
    ends : tuple of ndarray (m,), (m, nq), (m, nv)
        Times, configurations and velocities at samples, and at ticks of sensors that are read afterwards.
    """

    segments: tuple[Segment, ...]
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
    ends: tuple[Array, Array, Array]
    interrupted: bool = False
    loop: SampledLoop | None = None
    impulses: tuple[Impulse, ...] = ()
    compiled: Code = ""

    def states(self, times: Array) -> Array:
        """The states (nq + nv, m) at times (m,), interpolated between the known ones."""
        model, (ends, q, v) = self.segments[0].equations.robot.model, self.ends
        after = np.clip(np.searchsorted(ends, times, side="left"), 1, max(1, len(ends) - 1))
        out = np.empty((q.shape[1] + v.shape[1], len(times)))
        for k, (i, t) in enumerate(zip(np.minimum(after, len(ends) - 1).tolist(), times.tolist(), strict=True)):
            share = (t - ends[i - 1]) / (ends[i] - ends[i - 1]) if i else 0.0
            out[:, k] = np.append(pin.interpolate(model, q[i - 1], q[i], share), v[i - 1] + share * (v[i] - v[i - 1]))
        return out

    def accelerations_and_torques(self) -> tuple[Array, Array]:
        """Mean accelerations over the step before each sample (n, nv), and applied joint torques (n, nv)."""
        states = self._states_with_numbers
        return self.a, accelerations_and_joint_torques(self.segments[0].equations, self.t, states)[1].T + self.held

    def marks(self, what: str) -> dict[str, tuple[Array, ...]]:
        """As `DenseOutput.marks`; forces of contacts are means over the step before."""
        if what == "wrenches_on_links":
            every: dict[str, list[Array]] = {}
            for link, *vectors in wrenches_on_links(self.segments[0].equations, self.t, self._states_with_numbers):
                every.setdefault(link, []).append(np.array(vectors).swapaxes(1, 2))
            return {link: tuple(np.stack(vectors, axis=2)) for link, vectors in every.items()}
        values = {"contacts": 1, "contact_slips": 2}[what]
        return {pair: (rows[0], rows[values]) for pair, rows in self._rows.items()}

    @property
    def _states_with_numbers(self) -> Array:
        """The states with the numbers that held (size, n)."""
        return np.concatenate([self.q, self.v, self.numbers], axis=1).T

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


class SteppedTrack:
    """The states that a solution passed: of each sample the state, and what pressed in the step before it.

    Parameters
    ----------
    stepper : ContactStepper
    plan : StepPlan
        Of all steps, whose numbers controllers change on the way.
    times : ndarray (n,)
        Of the samples, s.
    """

    def __init__(self, stepper: ContactStepper, plan: StepPlan, times: Array) -> None:
        self._stepper, self._plan, self._times, equations = stepper, plan, times, stepper.equations
        q, v = equations.space.rows(equations.start)
        none = np.zeros_like(v)
        self._states = [(q, v, none, none, plan.numbers[0], 0.0)]
        self._ends = [(float(times[0]), q, v)]
        self._pressing: list[Pressing] = [{}]
        self._impulses: list[Impulse] = []
        self._overlap = stepper.overlap_at_begin[0]

    def add(self, first: int, steps: TakenSteps) -> None:
        """Add steps, the first of which has a number in the plan."""
        stepper, plan, local = self._stepper, self._plan, self._stepper.bodies.to_local_velocity
        if first == 0:
            one = steps[0]
            (q, w, _), v = stepper.begin, self._states[0][1]
            self._states[0] = (q, v, *_means(stepper, one, q, w), plan.numbers[0].copy(), 0.0)
            self._pressing[0] = _pressing(stepper, one)
        marks = plan.mark[first : first + len(steps)]
        for j in np.flatnonzero(marks & (SAMPLED | SEEN)).tolist():
            one, t = steps[j], plan.t[first + j] + plan.h[first + j]
            sampled = marks[j] & SAMPLED
            self._ends.append((self._times[len(self._states)] if sampled else t, one.q, local(one.q, one.v)))
            if not sampled:
                continue
            self._pressing.append(_pressing(stepper, one))
            now, means = plan.numbers[plan.piece[first + j]].copy(), _means(stepper, one, one.q, one.v)
            self._states.append((*self._ends[-1][1:], *means, now, one.memory.unfollowed))
            self._overlap = max(self._overlap, stepper.overlap(one.q)[0] if one.overlap is None else one.overlap)
        # What repeats or rests has no impacts.
        self._impulses += _impulses(stepper, float(plan.t[first]), steps[len(steps) - 1])

    def solution(self, loop: SampledLoop | None, *, interrupted: bool = False) -> SteppedSolution:
        """The solution so far."""
        plan, n = self._plan, len(self._states)
        q, v, a, held, numbers, unfollowed = (np.array(column) for column in zip(*self._states, strict=True))
        segment = Segment(self._stepper.equations, float(self._times[0]), n, readings=loop and loop.readings)
        times, *states = zip(*self._ends, strict=True)
        ends = np.array(times), np.array(states[0]), np.array(states[1])
        return SteppedSolution((segment,), self._times[:n], q, v, a, held, numbers, self._pressing[:n],
                               self._stepper.record, self._overlap, float(plan.h.max()), unfollowed, ends, interrupted,
                               loop, tuple(self._impulses),
                               "" if self._stepper.native is None else "steps")  # fmt: skip


def _means(stepper: ContactStepper, one: Step, q: Array, w: Array) -> tuple[Array, Array]:
    """The mean acceleration over a step (nv,), and the mean torques of joints' stops and dry friction (nv,).

    q, w: of the sample, along whose axes it is.
    """
    mean = stepper.bodies.to_local_acceleration(q, w, one.mean)
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
