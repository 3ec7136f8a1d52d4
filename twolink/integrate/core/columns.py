"""Columns: solutions of one scene as columns of a state array, whose steps go on from call to call.

Steps end at the times that are asked for, and go on as if they had not.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from twolink.effects.inputs import SAME_TIME
from twolink.integrate.motion.state import Array
from twolink.integrate.solution import Progress
from twolink.integrate.steps.perturbation import Perturbation, step_disturbances
from twolink.integrate.steps.step_control import MIN_SQUARE
from twolink.integrate.steps.step_map import StepMap
from twolink.integrate.steps.stepping import BLOCK, FINE, Block, advance, failure_of, outcome_of, start_state
from twolink.native.ticks import TickedLaw, Ticks

TICKS = 64  # short calls between two looks at whether steps get on
AT_ONCE = 8  # attempted steps in a short call, at most: a call ends where all have arrived
SHORT = 32  # attempted steps, after which solutions that have arrived are left out of what follows
EXACT = 1e-6  # e^2 of a step, by its tolerance: a thousand of such errors are below the tolerance
LEAST = 0.1  # of the time to the next stop: steps may grow to it


class Columns:
    """Solutions of one scene side by side, advanced by a step map.

    Parameters
    ----------
    by : StepMap
    t : float
        Time of the start, s.
    end : float
        Until when they are meant to go, s: it sets the first and the longest steps.
    setting : float
        The tolerance of the method, or its step, s.
    perturbations : tuple of Perturbation
        Of each.
    progress : callable, optional
        Called with the time now and then.
    rate : ndarray (nq + nv, 1), optional
        Of the states at the start, where the caller knows it.
    lose : bool
        Solutions beside the first one that cannot go on are lost: NaN from there on. Else they raise AccuracyError, as
        the first one does.

    Attributes
    ----------
    x : ndarray (size, n)
        The states with the numbers that they hold, which may be written between two calls of `advance`.
    by : StepMap
    """

    def __init__(
        self,
        by: StepMap,
        t: float,
        end: float,
        setting: float,
        perturbations: tuple[Perturbation, ...],
        progress: Progress | None = None,
        rate: Array | None = None,
        *,
        lose: bool = False,
    ) -> None:
        start = np.repeat(by.equations.start[:, None], len(perturbations), axis=1)
        self.by, self._rows, self._perturbations, self._lose = by, by.rows, perturbations, lose
        self.state, self._limit = start_state(by, start, t, end, setting, perturbations, span=end - t, rate=rate)
        self._size, self._every = by.equations.space.size, np.arange(len(perturbations))
        self._fine = np.full(len(perturbations), FINE)
        self._disturbances = step_disturbances(perturbations, self.state, by.equations)
        self._finer = np.flatnonzero([one.finer > 1.0 for one in perturbations])
        self._longest, self._embedded = self.state[by.rows.longest, self._finer], False
        self._progress, self._told, self._end = progress, t, end
        self._start = self.state[by.rows.time].copy()
        self._ticks, self._half = 0, 0.0
        self._own_steps()

    def _own_steps(self) -> None:
        """Let attempts begin at the state, in a place of their own."""
        self._steps = np.empty((AT_ONCE + 1, *self.state.shape))
        self._steps[0] = self.state
        self.state = self._steps[0]
        self._attempt: Callable[[int, int], int] | None = None
        self._law: TickedLaw | None = None
        self._native_ticks: Ticks | None = None

    def copied(self) -> Columns:
        """Solutions that go on from here with the same bits, whatever these do."""
        other = copy.copy(self)
        other._own_steps()
        return other

    @property
    def x(self) -> Array:
        """The states (size, n)."""
        return self.state[: self._size]

    @property
    def time(self) -> float:
        """The time that the solutions have reached, s."""
        return float(self.state.item(self._rows.time, 0))

    def shorten(self, step: float) -> None:
        """Let the next step of each solution be so long at most, s."""
        for row in (self._rows.step, self._rows.good):
            self.state[row] = np.minimum(self.state[row], step)

    @property
    def step(self) -> float:
        """The planned length of the first solution's next step, s."""
        return float(self.state.item(self._rows.step, 0))

    @property
    def too_exact(self) -> bool:
        """True if the error of the first solution's last step is as small a part of the tolerance as counts."""
        return bool(self.state.item(self._rows.previous, 0) <= MIN_SQUARE)

    @property
    def exact(self) -> bool:
        """True if the error of the first solution's last step is far below the tolerance."""
        return bool(self.state.item(self._rows.previous, 0) <= EXACT)

    def go_on_by(self, by: StepMap, *, embedded: bool = False) -> None:
        """Take the next steps by another method, of the same equations.

        embedded: of finer solutions by its embedded formula, whose steps are those of the first.
        """
        self.by, self._attempt, self._law = by, None, None
        if embedded != self._embedded and self._disturbances is not None:
            finer = np.isin(self._every, self._finer).astype(float)
            self._disturbances = replace(self._disturbances, embedded=embedded * finer)
            self.state[self._rows.longest, self._finer] = self._longest
            self._half = 0.0
        self._embedded = embedded

    @property
    def embedded(self) -> bool:
        """True if finer solutions go on by an embedded formula."""
        return self._embedded

    @property
    def counts(self) -> tuple[int, int]:
        """Accepted and rejected steps of the first."""
        return int(self.state[self._rows.accepted, 0]), int(self.state[self._rows.rejected, 0])

    def count_anew(self) -> None:
        """Count steps, which are limited, from here on."""
        self.state[self._rows.accepted] = self.state[self._rows.rejected] = 0.0
        self._start = self.state[self._rows.time].copy()

    @property
    def companion_steps(self) -> int:
        """The most steps that another solution has attempted beyond those of the first."""
        tried = self.state[self._rows.accepted] + self.state[self._rows.rejected]
        return int(tried.max() - tried[0])

    def advance(self, end: float) -> None:
        """Advance all to a time, s. Raises AccuracyError."""
        for _ in self.blocks(end):
            pass

    def blocks(self, end: float, first: int | None = None) -> Iterator[Block]:
        """Advance all to a time, s, and yield the states on the way, whose arrays are written to afterwards.

        first: of attempted steps in a first block, where more than a few are expected. Raises AccuracyError.
        """
        rows, state = self._rows, self.state
        time, step_row, start, step = rows.time, rows.step, state.item(rows.time, 0), state.item(rows.step, 0)
        adaptive = self.by.method.adaptive
        short = end - start
        planned = None if adaptive else state[step_row].copy()
        self._halve(short, step, end)
        state[rows.end] = end
        first = (1 if short <= AT_ONCE * step else BLOCK) if first is None else first
        attempt, steps, tried, going = self._attempt or self._begun(), self._steps, 0, True
        while going and first <= AT_ONCE and tried < SHORT:
            made = attempt(AT_ONCE, AT_ONCE)
            tried += made
            yield Block(self._every, steps[: made + 1], steps[: made + 1, time], self._fine)
            state[:] = steps[made]
            going = made == AT_ONCE and bool(state[time].min() < end)
        if going:
            tried += 1
            yield from self._long(max(first, tried))
        if planned is not None:
            state[step_row] = planned
        elif step < short and state.item(rows.previous, 0) <= MIN_SQUARE:
            # Two steps to a stop are as short as their end makes them, not as their error.
            np.minimum(2.0 * state[step_row], state[rows.longest], out=state[step_row])
        self._ticks += 1
        if self._ticks % TICKS == 0:
            self.require_progress()
        elif end >= self._end:
            self._tell()

    def ticks(self, law: TickedLaw, times: Array, kept: Array) -> tuple[Ticks, int, Block] | None:
        """Take ticks of a law at times (k,), the last of which ends them, with the steps between, in one call.

        kept (n, k): its numbers. The ticks, how many were taken, and the states on the way, whose arrays are written to
        afterwards; None where steps are shorter, or not native.
        """
        if self._law is not law:
            self._law, self._native_ticks = law, self.by.ticks(len(self._every), law, self._disturbances)
        ticks, rows = self._native_ticks, self._rows
        apart = float(times[1] - times[0])
        if ticks is None or self.step < (1.0 - SAME_TIME) * apart:
            return None
        self._halve(apart, self.step, float(times[-1]))
        ticks.states[0], ticks.z[0] = self.state, kept.T
        taken, made = ticks(times)
        if not taken and ticks.error is None:
            return None
        self.state[:] = ticks.states[made]
        states = ticks.states[: made + 1]
        return ticks, taken, Block(self._every, states, states[:, rows.time], self._fine)

    def require_progress(self) -> None:
        """Require that steps get on, and tell how far they are. Raises AccuracyError."""
        state, time = self.state, self._rows.time
        outcome = outcome_of(self.by, state, self._start, self._limit)
        self._require_fine(Block(self._every, state[None], state[None, time], outcome))
        self._tell()

    def _halve(self, short: float, step: float, end: float) -> None:
        """Let the steps of finer solutions be at most half as long as the run's, also where a stop ends both."""
        if self._embedded or not len(self._finer):
            return
        alone = len(self._every) == 1
        half = 0.5 * (short if step > short or alone else max(step, LEAST * short))
        if abs(half - self._half) > SAME_TIME * end:
            rows, self._half = self._rows, half
            self.state[rows.longest, self._finer] = longest = np.minimum(self._longest, half)
            self.state[rows.step, self._finer] = np.minimum(self.state[rows.step, self._finer], longest)

    def _begun(self) -> Callable[[int, int], int]:
        """Prepare attempts: the function that makes them."""
        attempt = self._attempt = self.by.on(self._steps, self._disturbances)
        return attempt

    def _long(self, first: int) -> Iterator[Block]:
        """Advance those that have not arrived in growing blocks."""
        for block in advance(self.by, self.state, self._limit, min(first, BLOCK), self._perturbations, self._start):
            failed = block.outcome != FINE
            self._require_fine(block)
            yield block
            self._tell()
            lost = block.worlds[failed]
            self.state[: self._size, lost], self.state[self._rows.time, lost] = np.nan, np.inf

    def _require_fine(self, block: Block) -> None:
        """Require that the steps get on. Raises AccuracyError."""
        for i in np.flatnonzero(block.outcome != FINE):
            if block.worlds[i] == 0 or not self._lose:
                alone = Block(*(part[..., [i]] for part in block))
                raise failure_of(self.by, alone, self._limit)

    def _tell(self) -> None:
        """Tell how far the first solution is."""
        if self._progress is not None and self.time > self._told:
            self._told = self.time
            self._progress(self._told)
