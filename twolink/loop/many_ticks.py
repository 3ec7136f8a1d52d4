"""Many ticks of a law in one native call, and what they showed."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from twolink.effects.sampled_control import STATE
from twolink.loop.calls import is_often
from twolink.loop.clock import Clock
from twolink.loop.controls import FASTEST, HeldControl
from twolink.loop.laws import Own
from twolink.loop.replay import Replay
from twolink.native.library import library
from twolink.native.ticks import TickedLaw, Ticks

Array = np.ndarray[Any, np.dtype[Any]]


class ManyTicks:
    """Ticks of a control whose law sees the state, and whose answers act at once."""

    def __init__(self, control: HeldControl, clock: Clock, replay: Replay) -> None:
        self._control, self._clock, self._replay, self._first = control, clock, replay, 0
        rows, law, (nq, nv) = control.rows, control.law, (control.robot.nq, control.robot.nv)
        held = range(rows.start, rows.stop) if rows is not None else ()
        seen = [k for name in control.controller.inputs for k in (range(nq) if name == "q" else range(nq, nq + nv))]
        if law.how == "traced":
            self.law = TickedLaw(held, control.limits, law.program, seen, law.own[0].state.shape[1])
        else:
            self.law = TickedLaw(held, control.limits, call=self._ask)

    def ahead(self, count: int, until: float) -> Array:
        """The times of the next ticks, up to so many and an end, s."""
        self._first = self._clock.tick
        return self._clock.ahead(count, until)

    @property
    def kept(self) -> Array:
        """The numbers that a traced law keeps (n, k)."""
        return np.asarray(self._control.law.own[0].state if self.law.call is None else np.zeros((1, 0)))

    def _ask(self, before: int, t: float, x: Array) -> Array:
        """The answers (m, n) to states x (rows, n)."""
        given = self._control.given(x)
        noted = self._replay.noted(self._control.place, given)
        u = self._control.law(t, self._first + before, given)
        self._replay.add(self._control.place, t, noted, u)
        return u.T

    def taken(self, times: Array, ticks: Ticks) -> None:
        """Take note of ticks that were taken. Raises ControllerError."""
        control, law, count = self._control, self._control.law, len(times)
        nq, moving = control.robot.nq, control.robot.nq + control.robot.nv
        u, x = ticks.u[:count], ticks.states[ticks.at[:count], :moving]
        self._clock.skip(count)
        if ticks.divided_by_zero and law.divides:
            raise law.refused(float(times[0]), "its program divides by 0")
        v, fine = x[:, nq:], np.full(count, True)
        if not (np.isfinite(u.sum()) and v.min(initial=0.0) > -FASTEST and v.max(initial=0.0) < FASTEST):
            fine = np.isfinite(u).all(axis=(1, 2)) & (np.abs(v).max(axis=(1, 2), initial=0.0) < FASTEST)
        often = is_often(np.arange(self._first, self._first + count)) & (self.law.call is None)
        for k in np.flatnonzero(often | ~fine):
            if self.law.call is None:
                law.own[0].state = ticks.z[k + 1].T.copy()
                law.require(float(times[k]), control.given(x[k]), Own(law.own[0].law, ticks.z[k].T), u[k].T)
            control.require_sound(float(times[k]), u[k].T, x[k, nq:])
        if self.law.call is None:
            law.own[0].state = ticks.z[count].T.copy()
        if u.shape[2] > 1:
            control.ambiguity.add_many(times, u, x)
        else:
            control.log += zip(times.tolist(), u.copy(), x, strict=True)


def many_ticks(controls: Sequence[HeldControl], clock: Clock, replay: Replay) -> ManyTicks | None:
    """The ticks of the one control of a loop without sensors; None where they are taken one by one."""
    control, *others = controls
    one = control.controller
    late = one.delay or one.jitter or one.hold != "zero"
    if others or late or {*one.inputs} - {*STATE} or library() is None:
        return None
    return ManyTicks(control, clock, replay)
