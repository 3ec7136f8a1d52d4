"""Steps: what they begin with, their ends, what they pass on, and the record of all steps of a run."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from twolink.contact.impulses import Impulses
from twolink.effects.inputs import SAME_TIME
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.state import Array
from twolink.loop.clock import Clock
from twolink.native.contact import StepPlan

# Marks of steps: a sample is at the end; the first, whose means stand at the first sample; a sensor is read at the end.
SAMPLED, FIRST, SEEN = 1, 2, 4


def plan_steps(equations: Equations, times: Array, step: float, halvings: int) -> StepPlan:
    """Steps of at most `step` [s] for samples at times (n,). Samples, breaks and ticks end a step.

    halvings: how often the steps between two of those are doubled in number (`twice_as_many`).
    """
    grid, sampling, end = times, equations.sampling, float(times[-1])
    breaks = [t for t in equations.breaks(end) if t > times[0]]
    ticks = [] if sampling is None else Clock({**sampling.controllers, **sampling.sensors}).until(end)
    for more in (np.array(breaks), np.array(ticks)):
        near = grid[np.minimum(np.searchsorted(grid, more * (1.0 - SAME_TIME)), len(grid) - 1)]
        grid = np.union1d(grid, more[np.abs(more - near) > SAME_TIME * near])
    count = np.maximum(1, np.ceil(np.diff(grid) / step - 1e-9).astype(int))
    for _ in range(halvings):
        count = twice_as_many(count)
    after, piece = np.cumsum(count), np.repeat(np.arange(len(count)), count)
    numbers = np.array([equations.layout.numbers_at(t) for t in (0.5 * (grid[:-1] + grid[1:])).tolist()])
    plan = StepPlan(len(piece), numbers)
    plan.h[:], plan.piece[:] = (np.diff(grid) / count)[piece], piece
    plan.t[:] = grid[piece] + (np.arange(len(piece)) - (after - count)[piece]) * plan.h
    plan.mark[after - 1] = np.where(np.isin(grid[1:], times), SAMPLED, 0)
    plan.mark[:1] |= FIRST
    if sampling is not None and not sampling.controllers:
        plan.mark[after - 1] |= np.where(np.isin(grid[1:], ticks), SEEN, 0)
    return plan


def twice_as_many(count: Any) -> Any:
    """About twice a number of steps n: one or two more, odd and even by turns, without a common divisor.

    No two steps of n and of the next n have the same begin or the same middle, but where all begin. Else an impact
    could fall on the same place within both, and their error be the same.
    """
    return 2 * count + 1 + count % 2


def along(parts: Array, axes: Array) -> Array:
    """Vectors (n, 3) from their parts (n, k) along axes (n, k, 3)."""
    return np.asarray(np.einsum("ni,nij->nj", parts, axes))


STILL = 1e-9  # m/s: a slip that counts as none
HEAD, EACH = 3, 6  # words of a memory before the change, and of each contact


class Memory(NamedTuple):
    """The memory that a step passes on to the next one of its solution, all of it: steppers remember nothing.

    words: as the native library has them: the number n of contacts as a whole number, the overlap, `unfollowed`, change
    (2, nv), keys (n,) as whole numbers that rise, forces (n, 3), and stuck, still (n,) as whole numbers. rest: where
    the bodies are at rest.
    """

    words: Array
    rest: AtRest | None = None

    @staticmethod
    def of(
        keys: Array, forces: Array, stuck: Array, still: Array, change: Array, overlap: float = 0.0,
        unfollowed: float = 0.0,
    ) -> Memory:  # fmt: skip
        """A memory of bodies that move, from what it says."""
        wholes = [np.asarray(x, dtype=np.int64) for x in ([len(keys)], keys, stuck, still)]
        count, first, *marks = (x.view(float) for x in wholes)
        return Memory(np.concatenate([count, [overlap, unfollowed], change.ravel(), first, forces.ravel(), *marks]))

    @staticmethod
    def empty(change: Array, unfollowed: float = 0.0) -> Memory:
        """Of a step without contacts."""
        none = np.empty(0, int)
        return Memory.of(none, np.empty((0, 3)), none, none, change, unfollowed=unfollowed)

    @property
    def _count(self) -> int:
        """The number n of contacts that pressed or stayed closed."""
        return int(self.words[:1].view(np.int64)[0])

    @property
    def overlap(self) -> float:
        """Of hulls at the end, m."""
        return float(self.words[1])

    @property
    def unfollowed(self) -> float:
        """By how much bounces that were too low for the steps would have moved a joint so far at most, rad or m."""
        return float(self.words[2])

    @property
    def change(self) -> Array:
        """w' of the last two steps (2, nv), 0 where it was not smooth."""
        return self.words[HEAD : len(self.words) - EACH * self._count].reshape(2, -1)

    @property
    def keys(self) -> Array:
        """Keys of the contacts (n,)."""
        return self._of_contacts(0, 1).view(np.int64)

    @property
    def forces(self) -> Array:
        """Their forces (n, 3), N."""
        return self._of_contacts(1, 4).reshape(-1, 3)

    @property
    def stuck(self) -> Array:
        """Mask of those that had no slip at the end (n,)."""
        return self._of_contacts(4, 5).view(np.int64) > 0

    @property
    def still(self) -> Array:
        """Mask of those that had no velocity along the normal (n,)."""
        return self._of_contacts(5, EACH).view(np.int64) > 0

    def _of_contacts(self, first: int, end: int) -> Array:
        n = self._count
        begin = len(self.words) - EACH * n
        return self.words[begin + first * n : begin + end * n]

    def with_overlap(self, overlap: float) -> Memory:
        """This memory with another overlap, m."""
        words = self.words.copy()
        words[1] = overlap
        return Memory(words, self.rest)

    def changes(self, mean: Array, *, smooth: bool = True) -> Array:
        """The changes w' of the last two steps for the next one; 0 where the step was not smooth."""
        if not smooth:
            return np.zeros_like(self.change)
        return np.array([mean, self.change[0] if self.change[0].any() else mean])


class Blow(NamedTuple):
    """Impulses of impacts in a step: when they act after its begin, s, the points' keys, and impulses as `on_first`.

    on_joints (nv,): all of them as generalized impulses.
    """

    late: float
    keys: Array
    on_first: Array
    on_joints: Array


@dataclass(frozen=True)
class Step:
    """The end of a step of length h: q, w, the memory, and of the points that pressed the keys, places and impulses.

    mean (nv,): of w'. on_first (n, 3): impulses on the first of two bodies, along the world's axes, N s. impulses: with
    the residuals of the laws. overlap: the largest at the end, m; None where it is not known. joints (nv,): impulses of
    stops and of dry friction; None without. slips (n, 3): at the end, of the first body on the second, m/s. blows:
    what impacts did, where there are some. rows: J of the points that pressed, at the middle of the (last) step.
    softened: whether bodies bounce with less than their restitution. apart: of the step, the longest time between
    bounces of one pair in it.
    """

    h: float
    q: Array
    v: Array
    mean: Array
    memory: Memory
    keys: Array
    place: Array
    on_first: Array
    impulses: Impulses | None = None
    overlap: float | None = None
    joints: Array | None = None
    slips: Array | None = None
    blows: tuple[Blow, ...] = ()
    rows: Any = None
    softened: bool = False
    apart: float = 0.0

    def with_next(self, after: Step) -> Step:
        """This step and the next one as one: the impulses of both at each point, where it was last."""
        h, both = self.h + after.h, (self, after)
        keys, number = np.unique(np.concatenate([one.keys for one in both]), return_inverse=True)
        place, on_first, slips = np.zeros((3, len(keys), 3))
        place[number] = np.concatenate([one.place for one in both])
        slips[number] = np.concatenate([np.zeros_like(one.place) if one.slips is None else one.slips for one in both])
        np.add.at(on_first, number, np.concatenate([one.on_first for one in both]))
        joints = [one.joints for one in both if one.joints is not None]
        return replace(after, h=h, mean=(self.h * self.mean + after.h * after.mean) / h, keys=keys, place=place,
                       on_first=on_first, joints=np.sum(joints, axis=0) if joints else None, slips=slips,
                       blows=(*self.blows, *(one._replace(late=self.h + one.late) for one in after.blows)))  # fmt: skip


class StepEnd(NamedTuple):
    """A state that a solution goes on from: q, w (see `Multibody`), and the memory."""

    q: Array
    w: Array
    memory: Memory


class TakenSteps(ABC):
    """Steps that follow each other."""

    @abstractmethod
    def __len__(self) -> int:
        """Their number."""

    @abstractmethod
    def __getitem__(self, j: int) -> Step:
        """The step j, from 0 on."""

    @property
    def end(self) -> StepEnd:
        """The end of the last."""
        last = self[len(self) - 1]
        return StepEnd(last.q, last.v, last.memory)


class OneStep(TakenSteps):
    """A single step."""

    def __init__(self, step: Step) -> None:
        self._step = (step,)

    def __len__(self) -> int:
        return 1

    def __getitem__(self, j: int) -> Step:
        """The step."""
        return self._step[j]


@dataclass(frozen=True)
class AtRest:
    """Bodies at rest: the step that began and ended so, and the forces tau - h (nv,) that act then."""

    step: Step
    forces: Array


@dataclass
class Record:
    """Of a run: counts of steps, of halved ones and by solver; the largest misses of the laws (m/s and J).

    softened: impacts with less than their restitution, with which they would create energy.
    """

    steps: int = 0
    halved: int = 0
    softened: int = 0
    solvers: dict[str, int] = field(default_factory=dict)
    feasibility: float = 0.0
    complementarity: float = 0.0

    def add(self, impulses: Impulses | None, count: int = 1) -> None:
        """Count steps. impulses: None where nothing touched."""
        self.steps += count
        if impulses is not None:
            self.solvers[impulses.solver] = self.solvers.get(impulses.solver, 0) + count
            self.feasibility = max(self.feasibility, impulses.feasibility)
            self.complementarity = max(self.complementarity, impulses.complementarity)
