"""Smooth motion: solutions without modes as columns of one batch, and the run of it for samples."""

from __future__ import annotations

import functools
import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from twolink.effects.inputs import Slot
from twolink.integrate.core.columns import Columns
from twolink.integrate.core.motion import LATER, Motion, again, driven
from twolink.integrate.core.track import Track
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.state import Array
from twolink.integrate.solution import Progress, Solution, events_of
from twolink.integrate.steps.methods import Method
from twolink.integrate.steps.perturbation import NO_PERTURBATION, Companions, Perturbation
from twolink.integrate.steps.step_map import StepMap, step_map
from twolink.integrate.steps.stepping import Block, take_samples
from twolink.native.ticks import TICKS

if TYPE_CHECKING:
    from twolink.effects.sensors import Forces
    from twolink.loop.sampled_loop import SampledLoop

SHORT = 16  # attempted steps of a block in which all solutions beside the run are looked at at all times
TOGETHER = 32  # of such blocks: they are looked at together
FAR, NEAR = 1.5, 0.5  # of its step: a time for which a method of lower order is left; of that time, for which it is not
MANY = 1_000_000  # steps, after which the count of steps of a motion without end begins anew


class SmoothMotion(Motion):
    """Solutions as columns of one batch.

    Parameters
    ----------
    by : StepMap
        Of the equations, from whose start it goes on.
    t, end : float
        The time of the start, and until when it is meant to go, s.
    setting : float
        The tolerance of the method, or its step, s.
    perturbations : tuple of Perturbation
        Of each solution.
    track : Track, optional
        Of what the first one passes.
    companions : Companions, optional
        Where the others are looked at.
    progress : callable, optional
        Called with the time now and then.
    nearer : StepMap, optional
        Of a method of lower order, which costs less where it is asked for times that are nearer than its steps.
    lose : bool
        As of `Columns`.
    """

    def __init__(
        self,
        by: StepMap,
        t: float,
        end: float,
        setting: float,
        perturbations: tuple[Perturbation, ...] = (NO_PERTURBATION,),
        *,
        track: Track | None = None,
        companions: Companions | None = None,
        progress: Progress | None = None,
        nearer: StepMap | None = None,
        lose: bool = False,
    ) -> None:
        self._nearer, self._too_far = nearer, math.inf
        self.equations, self._by = by.equations, by
        self.columns = Columns(by, t, end, setting, perturbations, progress, lose=lose)
        self.track, self._companions, self._steps = track, companions, 0
        self._unseen: list[Block] = []  # at whose samples of the solutions beside the first no one has looked
        self._end = end
        self._breaks, self._passed = [*(b for b in by.equations.breaks(end) if b > t), math.inf], 0
        self._checks, self._looked = [*([] if companions is None else companions.t.tolist()), math.inf], 0
        self._tables = [(at, x) for at, x in by.equations.layout.rows_of_tables() if not isinstance(x, Slot)]

    @property
    def t(self) -> float:
        """The time, s."""
        return self.columns.time

    @property
    def x(self) -> Array:
        """The states."""
        return self.columns.x[: self.equations.moving]

    @property
    def steps(self) -> int:
        """Accepted steps of the run."""
        return self._steps + self.columns.counts[0]

    def advance(self, t: float) -> None:
        """Go to a time, s. Steps end at breaks."""
        if self._nearer is not None:
            self._choose_method(self._nearer, t - self.t)
        while (stop := self._breaks[self._passed]) <= t * LATER:
            if stop > self.t:
                self._to(stop)
            self._passed += 1
            if self._tables:
                self._take_tables(0.5 * (stop + min(self._breaks[self._passed], self._end)))
        if t > self.t:
            self._to(t)
        if self.track is None and self.columns.counts[0] > MANY:
            self._steps = self.steps
            self.columns.count_anew()

    def _choose_method(self, nearer: StepMap, ahead: float) -> None:
        """Take the method of lower order for times that are so near that it gets there by a step."""
        columns = self.columns
        if columns.by.method is not nearer.method:  # columns of another motion have maps of their own
            if columns.too_exact and ahead < min(columns.step, NEAR * self._too_far):
                columns.go_on_by(nearer)
        elif ahead > FAR * columns.step:
            self._too_far = ahead
            columns.go_on_by(self._by)
        elif columns.embedded != columns.exact:
            columns.go_on_by(nearer, embedded=columns.exact)

    def _to(self, t: float) -> None:
        looks = self._companions is not None and self._checks[self._looked] <= t
        if not looks and self.track is None:
            self.columns.advance(t)
            return
        for block in self.columns.blocks(t):
            self._pass(block, looks=looks)
        while self._checks[self._looked] <= t:
            self._looked += 1

    def _pass(self, block: Block, *, looks: bool) -> None:
        """Take note of steps. looks: whether those beside the run are looked at."""
        if self.track is not None and block.worlds[0] == 0:
            self.track.add(block.t[1:, 0], block.states[1:, : self.equations.space.size, 0])
        if looks and self._companions is not None:
            self._look(self._companions, block)

    def take_ticks(self, loop: SampledLoop, until: float) -> bool:
        """Take some ticks of a traced law in one call; False where it is not so, or steps are shorter than ticks."""
        many = loop.many
        if many is None:
            return False
        times = many.ahead(TICKS + 1, min(until, self._breaks[self._passed]))
        found = self.columns.ticks(many.law, times, many.kept) if len(times) > 1 else None
        if found is None:
            return False
        ticks, taken, block = found
        if self.track is not None:
            self.track.change(block.states[0, : self.equations.space.size, 0])
        self._pass(block, looks=self._companions is not None)
        while self._checks[self._looked] <= block.t[-1].min():
            self._looked += 1
        many.taken(times[:taken], ticks)
        if ticks.error is not None:
            raise ticks.error
        self.columns.require_progress()
        return True

    def _look(self, companions: Companions, block: Block) -> None:
        """Look at the solutions beside the first, in many short blocks at once."""
        short = len(block.t) <= SHORT
        if short and len(block.worlds) == self.columns.x.shape[1] and not block.outcome.any():
            self._unseen.append(block._replace(states=block.states.copy(), t=block.t.copy()))
            if len(self._unseen) == TOGETHER:
                self.look()
            return
        self.look()  # for some go on alone: what they take there is in no later block
        self._take_samples(companions, block, few=short)

    def look(self) -> None:
        """Take the samples of the solutions beside the first that are left to take."""
        if self._companions is not None and self._unseen:
            states, t = (np.concatenate([one[i] for one in self._unseen]) for i in (1, 2))
            block, self._unseen = self._unseen[-1]._replace(states=states, t=t), []
            self._take_samples(self._companions, block, few=True)

    def _take_samples(self, companions: Companions, block: Block, *, few: bool) -> None:
        """Take the samples of the solutions beside the first, which are numbered behind it."""
        for others, often in companions.looks(block.worlds, few=few):
            part = Block(block.worlds[others] - 1, *(rows[..., others] for rows in block[1:]))
            take_samples(self._by, part, companions.t[often], companions.x[often])

    def _take_tables(self, t: float) -> None:
        """Write the pieces of tables that hold at a time."""
        for rows, table in self._tables:
            self.columns.x[rows] = table.rows_at(t)[:, None]
        if self.track is not None:
            self.track.change(self.columns.x[:, 0])

    def held(self) -> Array:
        """The states and numbers, as they are stepped."""
        return self.columns.x

    def hold(self, x: Array) -> None:
        """Let the numbers hold, which are written already."""
        if self.track is not None:
            self.track.change(x[:, 0])

    def forces(self, t: float, x: Array) -> Forces:
        """The forces at states (size, n)."""
        from twolink.integrate.forces_seen import forces_seen  # which scenes without sensors do not load

        return forces_seen(self.equations, t, x)

    def save(self) -> tuple[Columns, int, int, float]:
        """The columns, the steps before them, how many breaks are over, and the time for which a step is too long."""
        return self.columns.copied(), self._steps, self._passed, self._too_far

    def restore(self, saved: tuple[Columns, int, int, float]) -> None:
        """Go on from there."""
        columns, self._steps, self._passed, self._too_far = saved
        self.columns = columns.copied()


@again
def solve_smooth(
    equations: Equations,
    method: Method,
    times: Array,
    setting: float,
    progress: Progress | None = None,
    perturbation: Perturbation = NO_PERTURBATION,
    companions: Companions | None = None,
) -> Solution:
    """Solve from the equations' start for samples, with their controllers; see `solver.solve`.

    Raises ControllerError, whose `run` is the solution so far.
    """
    start, end = float(times[0]), float(times[-1])
    equations.require(start, end)
    by = step_map(equations, method)
    track = Track(by, times, start, equations.start)
    every = (perturbation, *(() if companions is None else companions.perturbations))
    motion = SmoothMotion(by, start, end, setting, every, track=track, companions=companions, progress=progress,
                          lose=equations.sampling is None)  # fmt: skip
    return driven(motion, end, equations.sampling, functools.partial(_solutions, motion, track))[0]


def _solutions(
    motion: SmoothMotion, track: Track, loop: SampledLoop | None, interrupted: bool, until: float
) -> list[Solution]:
    """The run so far, with the samples up to a time."""
    motion.look()
    run = track.solution(motion.columns, min(until * LATER, track.t), readings=loop and loop.readings)
    return [replace(run, interrupted=interrupted, events=() if loop is None else tuple(events_of(loop)))]
