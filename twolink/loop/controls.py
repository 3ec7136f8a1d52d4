"""Controls: controllers in a run, with the numbers that they write, one tick at a time or many in one native call."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from twolink.dynamics import Robot
from twolink.effects.sampled_control import STATE, Controller
from twolink.loop.ambiguity import Ambiguity
from twolink.loop.calls import Asked, is_often
from twolink.loop.clock import Clock
from twolink.loop.laws import Array, Given, Own, failure
from twolink.loop.replay import Replay
from twolink.native.library import library
from twolink.native.ticks import TickedLaw, Ticks

FASTEST = 1e6  # rad/s or m/s: no machine moves so fast, and a loop that diverges would be solved in ever smaller steps


@dataclass(eq=False)
class HeldControl:
    """A controller in a run. limits (m, 1). law: how it is asked. waiting: answers (m, n) to come, by tick.

    rows, slopes, since: of the state, that it writes. log: of a solution alone, the times, the
    answers and what they were to.
    """

    place: int
    controller: Controller
    robot: Robot
    joints: tuple[str, ...]
    limits: Array
    limited: bool
    rows: slice | None
    slopes: slice | None
    since: int
    law: Asked = field(init=False)
    ambiguity: Ambiguity = field(default_factory=Ambiguity)
    waiting: dict[int, Array] = field(default_factory=dict)
    last: tuple[float, Array] | None = None
    log: list[tuple[float, Array, Array]] = field(default_factory=list)

    def state(self, x: Array) -> Given:
        """Copies of q and v of states x (size, n), in rows."""
        nq, nv = self.robot.nq, self.robot.nv
        return {"q": x[:nq].T.copy(), "v": x[nq : nq + nv].T.copy()}

    def given(self, x: Array) -> Given:
        """The inputs of a controller that asks for q and v alone."""
        state = self.state(x)
        return {name: state[name] for name in self.controller.inputs}

    def keep(self, t: float, u: Array, x: Array) -> None:
        """Take note of the answers u (m, n) to states x (size, n)."""
        if x.shape[1] > 1:
            self.ambiguity.add(np.array([t]), u[None], x[None])
        else:
            self.log.append((t, u, x.copy()))

    def require_sound(self, t: float, u: Array, v: Array) -> None:
        """Require finite torques (n, m) and speeds (nv, n) that a machine can have. Raises ControllerError."""
        finite = math.isfinite(sum(u.ravel().tolist()))  # takes a quarter of the time of asking each
        if finite and np.vdot(v, v) < FASTEST**2:
            return
        if self.law.guessed:
            raise self.law.refused(t, "it has no sound answer")
        if not finite:
            joint = self.joints[int(np.argmin(np.isfinite(u).all(axis=0)))]
            raise failure(self.place, t, f"the torque of {joint!r} is not finite", code="controller-answer",
                         remedy="look at what it divides by", joint=joint)  # fmt: skip
        fastest = np.abs(v).max(axis=1)
        if fastest.max() > FASTEST:
            joint = next(one.name for one in self.robot.joints if one.v.start <= int(fastest.argmax()) < one.v.stop)
            what = f"the loop is unstable: {joint!r} moves at {fastest.max():.2g} rad/s or m/s"
            raise failure(self.place, t, what,
                         remedy="smaller gains of the velocity, a shorter period, or limit= of the torques",
                         code="unstable-loop", joint=joint)  # fmt: skip

    def act(self, t: float, u: Array, x: Array) -> None:
        """Write the held numbers."""
        x[self.rows] = u
        if self.slopes is not None:
            slope, x[self.since] = np.zeros_like(u), t
            if self.last is not None:
                bounds, longest = self.limits, float(self.controller.period + self.controller.jitter)  # until the next
                slope = (u - self.last[1]) / (t - self.last[0])
                slope = np.clip(slope, (-bounds - u) / longest, (bounds - u) / longest)
            x[self.slopes], self.last = slope, (t, u)


def control_of(place: int, one: Controller, robot: Robot, rows: Mapping[str, int]) -> HeldControl:
    """The control of a controller, which writes the rows of its held numbers."""
    held, joints = one.held(robot, place), one.joints(robot)
    values, slopes = (_rows_of([rows[slot.name] for slot in slots.values()]) for slots in (held.values, held.slopes))
    since = -1 if held.since is None else rows[held.since.name]
    limits = one.limits(robot)[:, None]
    return HeldControl(place, one, robot, joints, limits, bool(np.isfinite(limits).any()), values, slopes, since)


def _rows_of(numbers: list[int]) -> slice | None:
    """Rows that follow each other."""
    return slice(numbers[0], numbers[-1] + 1) if numbers else None


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
        control = self._control
        return self._replay.asked(control.place, control.law, t, self._first + before, control.given(x)).T

    def taken(self, times: Array, ticks: Ticks) -> None:
        """Take note of ticks that were taken. Raises ControllerError."""
        control, law, count = self._control, self._control.law, len(times)
        nq, moving = control.robot.nq, control.robot.nq + control.robot.nv
        u, x = ticks.u[:count], ticks.states[ticks.at[:count], :moving]
        self._clock.skip(count)
        if ticks.divided_by_zero and law.divides:
            raise law.refused(float(times[0]), "its program divides by 0")
        fine = np.isfinite(u).all(axis=(1, 2)) & (np.abs(x[:, nq:]).max(axis=(1, 2), initial=0.0) < FASTEST)
        often = is_often(np.arange(self._first, self._first + count)) & (self.law.call is None)
        for k in np.flatnonzero(often | ~fine):
            if self.law.call is None:
                law.own[0].state = ticks.z[k + 1].T.copy()
                law.require(float(times[k]), control.given(x[k]), Own(law.own[0].law, ticks.z[k].T), u[k].T)
            control.require_sound(float(times[k]), u[k].T, x[k, nq:])
        if self.law.call is None:
            law.own[0].state = ticks.z[count].T.copy()
        if u.shape[2] > 1:
            control.ambiguity.add(times, u, x)
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
