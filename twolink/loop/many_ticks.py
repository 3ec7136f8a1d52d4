"""Many ticks of a traced law in one native call, and what they showed."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from twolink.effects.sampled_control import STATE
from twolink.loop.calls import is_often
from twolink.loop.clock import Clock
from twolink.loop.controls import FASTEST, HeldControl
from twolink.loop.laws import Own
from twolink.native.ticks import TickedLaw, Ticks

Array = np.ndarray[Any, np.dtype[Any]]


class ManyTicks:
    """Ticks of a control whose law is traced and sees the state, and whose answers act at once.

    Attributes
    ----------
    law : TickedLaw
    """

    def __init__(self, control: HeldControl, clock: Clock, law: TickedLaw) -> None:
        self._control, self._clock, self.law = control, clock, law

    def ahead(self, count: int, until: float) -> Array:
        """The times of the next ticks, up to so many and an end, s."""
        return self._clock.ahead(count, until)

    @property
    def kept(self) -> Array:
        """The numbers that the law keeps (n, k)."""
        return np.asarray(self._control.law.own[0].state)

    def taken(self, times: Array, ticks: Ticks) -> None:
        """Take note of ticks that were taken. Raises ControllerError."""
        control, law, count = self._control, self._control.law, len(times)
        nq, moving = control.robot.nq, control.robot.nq + control.robot.nv
        u, x = ticks.u[:count], ticks.states[ticks.at[:count], :moving]
        first = self._clock.skip(count)
        if ticks.divided_by_zero and law.divides:
            raise law.refused(float(times[0]), "its program divides by 0")
        fine = np.isfinite(u).all(axis=(1, 2)) & (np.abs(x[:, nq:]).max(axis=(1, 2), initial=0.0) < FASTEST)
        for k in (k for k in range(count) if is_often(first + k) or not fine[k]):
            given = {name: rows for name, rows in control.state(x[k]).items() if name in control.controller.inputs}
            law.own[0].state = ticks.z[k + 1].T.copy()
            law.require(float(times[k]), given, Own(law.own[0].law, ticks.z[k].T), u[k].T)
            control.require_sound(float(times[k]), u[k].T, x[k, nq:])
        law.own[0].state = ticks.z[count].T.copy()
        if u.shape[2] > 1:
            control.ambiguity.add_many(times, u, x)
        else:
            control.log += zip(times.tolist(), u.copy(), x, strict=True)


def many_ticks(controls: Sequence[HeldControl], clock: Clock) -> ManyTicks | None:
    """The ticks of the one control of a loop without sensors; None where they are taken one by one."""
    control, *others = controls
    one, law = control.controller, control.law
    late = one.delay or one.jitter or one.hold != "zero"
    if others or late or law.program is None or law.how != "traced" or {*one.inputs} - {*STATE} or not control.rows:
        return None
    nq, moving = control.robot.nq, control.robot.nq + control.robot.nv
    rows = {"q": range(nq), "v": range(nq, moving)}
    seen = [k for name in one.inputs for k in rows[name]]
    held = range(control.rows.start, control.rows.stop)
    return ManyTicks(control, clock, TickedLaw(law.program, seen, held, control.limits, law.own[0].state.shape[1]))
