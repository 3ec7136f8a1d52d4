"""A sampled loop: the controllers and sensors of a scene in a run, for each of its solutions.

Every solution has its own laws, states of controllers, calls and readings; noise and jitter are the same for all.
Their distance contains what the controllers make of an error.
"""

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from twolink.dynamics import Robot
from twolink.effects.sampled_control import Controller
from twolink.effects.sensors import Forces, Seen, Sensor, StateSensor
from twolink.errors import SceneError
from twolink.loop.ambiguity import FIRST_STEPPED, Ambiguity
from twolink.loop.calls import DiffersError, asked
from twolink.loop.clock import ACT, ARRIVE, READ, UPDATE, Clock, Random, Readings, reading
from twolink.loop.controls import HeldControl, ManyTicks, control_of, many_ticks
from twolink.loop.laws import Array, Given, own_laws
from twolink.loop.plain_functions import seen
from twolink.loop.replay import Replay


@dataclass(frozen=True, eq=False)
class Sampling:
    """The sampled parts of a scene: the controllers and sensors, by their places among its effects."""

    robot: Robot
    controllers: Mapping[int, Controller]
    sensors: Mapping[int, Sensor]

    @property
    def ticks_per_second(self) -> float:
        """Of all of them together."""
        parts: list[Any] = [*self.controllers.values(), *self.sensors.values()]
        return sum(1.0 / float(one.period) for one in parts)


@dataclass(eq=False)
class _Measuring:
    """A sensor in a run. latest: the readings (n, m) that arrived last. log: the times, and the readings of the run."""

    sensor: Sensor
    latest: Array
    random: Random
    waiting: dict[int, Array] = field(default_factory=dict)
    log: list[tuple[float, Array]] = field(default_factory=list)


class SampledLoop:
    """Controllers and sensors from tick to tick.

    Parameters
    ----------
    sampling : Sampling
    rows : mapping of str to int
        The rows of a state by the names of held numbers.
    states : tuple of str
        The names of the states of effects.
    x : ndarray (size, n)
        The states of the solutions at the start, the first of which is the run.
    look : callable
        (t, x) -> the forces at states x (size, n) at a time.
    start : float
        The time of the start, s: ticks before it are left out.
    endless : bool
        Call laws for each solution, unless they ask for another way. Keep no more of what was read and answered than is
        to come, and look now and then for laws that remember what is not their solution's own.
    """

    differs = DiffersError

    def __init__(
        self,
        sampling: Sampling,
        rows: Mapping[str, int],
        states: tuple[str, ...],
        x: Array,
        look: Callable[[float, Array], Forces],
        start: float = 0.0,
        *,
        endless: bool = False,
    ) -> None:
        self._endless = endless
        self.many: ManyTicks | None = None
        self._robot, self._states, self._look = sampling.robot, states, look
        self._nq, self._nv = sampling.robot.nq, sampling.robot.nv
        self._of_states = {one.label for one in sampling.sensors.values() if isinstance(one, StateSensor)}
        self._clock = Clock({**sampling.controllers, **sampling.sensors}, start)
        self._controls = {place: control_of(place, one, sampling.robot, rows) for place, one in
                          sampling.controllers.items()}  # fmt: skip
        self._sensors: dict[int, _Measuring] = {}
        for place, sensor in sampling.sensors.items():  # before a reading arrives, that of the start without noise
            values = sensor.read(self._seen(start, x))
            self._sensors[place] = _Measuring(sensor, values, Random(sensor.seed, sensor.label, values.shape[1]))
        self._replay = self._asked(sampling.controllers, start, x)

    def _asked(self, controllers: Mapping[int, Controller], start: float, x: Array) -> Replay:
        """Let laws be asked in the way that fits them, and what looks for their memory."""
        own = [own_laws(controllers) for _ in range(x.shape[1])]
        found = {place: seen(one.update, one.state) for place, one in controllers.items()}
        # A law that writes may do so to what another one reads.
        plain = all(found.values())
        alone = plain and not (len(found) > 1 and any(one is not None and one.writes for one in found.values()))
        for place, one in self._controls.items():
            look = found[place] if alone else None
            one.law = asked(place, one.controller, one.joints, [laws[place] for laws in own], look,
                            self._given(one, x), start, again=not self._endless)  # fmt: skip
        joints = {place: one.joints for place, one in self._controls.items()}
        replay = Replay(
            {} if plain else controllers, joints, start, lambda place: self._given(self._controls[place], x)
        )
        if not (self._endless or self._sensors):
            self.many = many_ticks([*self._controls.values()], self._clock, replay)
        return replay

    @property
    def time(self) -> float:
        """Time of the next action, s; infinite: never."""
        return self._clock.time

    @property
    def readings(self) -> dict[str, Readings]:
        """Readings of the sensors in the run so far, by name."""
        logs = {one.sensor.label: (one.log, one.latest.shape[1]) for one in self._sensors.values()}
        return {name: Readings(np.array([t for t, _ in log]), np.array([x for _, x in log]).reshape(-1, size))
                for name, (log, size) in logs.items()}  # fmt: skip

    def tick(self, x: Array) -> None:
        """Let happen what is due. x (size, n): the states of the solutions, whose held numbers are written.

        Where a controller fails, all of it is due again.
        """
        before, t = self._clock.saved(), self._clock.time
        due = self._clock.due()
        try:
            for kind, place, tick in due:
                self._do(kind, place, tick, t, x)
        except BaseException:
            self._clock.restore(before)
            raise
        for kind, place, tick in due:
            if kind in (ACT, ARRIVE):
                (self._controls if kind == ACT else self._sensors)[place].waiting.pop(tick)
        if self._endless:
            self._forget()
            self._replay.now_and_then()

    def _do(self, kind: int, place: int, tick: int, t: float, x: Array) -> None:
        """Do what is due of a controller or a sensor."""
        if kind == UPDATE:
            self._update(self._controls[place], t, tick, x)
        elif kind == ACT:
            self._controls[place].act(t, self._controls[place].waiting[tick], x)
        elif kind == READ:
            one = self._sensors[place]
            one.waiting[tick] = reading(one.sensor, one.random, tick, one.sensor.read(self._seen(t, x)))
            one.log.append((t, one.waiting[tick][0]))
        else:
            self._sensors[place].latest = self._sensors[place].waiting[tick]

    def _forget(self) -> None:
        """Keep no more of what was read and answered than what is to come."""
        for control in self._controls.values():
            control.log.clear()
        for one in self._sensors.values():
            one.log.clear()

    def notes(self) -> list[str]:
        """Notes on how the laws are asked, and why."""
        return [f"effects[{place}]: its law is {'' if one.law.how == 'traced' else 'called '}{one.law.how}"
                f"{one.law.why and f' ({one.law.why})'}" for place, one in self._controls.items()]  # fmt: skip

    def require_repeatable(self) -> None:
        """Require that no law remembers what is not its solution's own. Raises ControllerError."""
        self._replay.require()

    def saved(self) -> Any:
        """All that it goes on from; what controllers keep, in copies."""
        controls = [(one.law.own, one.waiting, one.last, one.ambiguity) for one in self._controls.values()]
        sensors = [(one.latest, one.waiting) for one in self._sensors.values()]
        return self._clock.saved(), self._replay.saved(), _copied((controls, sensors))

    def restore(self, saved: Any) -> None:
        """Go on from there."""
        self._clock.restore(saved[0])
        self._replay.restore(saved[1])
        controls, sensors = _copied(saved[2])
        for control, kept in zip(self._controls.values(), controls, strict=True):
            control.law.own, control.waiting, control.last, control.ambiguity = kept
        for one, kept in zip(self._sensors.values(), sensors, strict=True):
            one.latest, one.waiting = kept

    def ambiguous(self) -> list[tuple[float, str]]:
        """The ambiguous ticks so far: when, and what of."""
        return sorted((t, f"effects[{one.place}]") for one in self._controls.values() for t in one.ambiguity.ticks())

    def ambiguous_beside(self, other: "SampledLoop") -> list[tuple[float, str]]:
        """The ambiguous ticks of two solutions that were solved one after the other, by other steps."""
        for place, one in self._controls.items():
            one.ambiguity = Ambiguity(FIRST_STEPPED)
            for (t, *mine), (_, *theirs) in zip(one.log, other._controls[place].log, strict=False):
                both = (np.concatenate(pair, axis=1)[None] for pair in zip(mine, theirs, strict=True))
                one.ambiguity.add(np.array([t]), *both)
        return self.ambiguous()

    def unstable(self) -> list[tuple[float, str, float, float]]:
        """The controllers in unstable loops: from when, s, what, the rate of errors, 1/s, and the period, s."""
        found = ((one, one.ambiguity.growth()) for one in self._controls.values())
        return [(seen[0], f"effects[{one.place}]", seen[1], float(one.controller.period))
                for one, seen in found if seen]  # fmt: skip

    def _seen(self, t: float, x: Array) -> Seen:
        q, v = x[: self._nq].T.copy(), x[self._nq : self._nq + self._nv].T.copy()
        z = dict(zip(self._states, x[self._nq + self._nv :].copy(), strict=False))
        return Seen(self._robot, q, v, z, lambda: self._look(t, x))

    def _given(self, control: HeldControl, x: Array) -> Given:
        """The inputs that a controller asked for, of each solution (n, ...), as new copies."""
        given = control.state(x) | {one.sensor.label: one.latest.copy() for one in self._sensors.values()}
        return {name: given[name] if name in given else self._pose(given["q"], name)
                for name in control.controller.inputs}  # fmt: skip

    def _pose(self, q: Array, link: str) -> Array:
        """Poses (n, 4, 4)."""
        rotation, position = self._robot.frame_pose(q, link)
        pose = np.zeros((len(q), 4, 4))
        pose[:, :3, :3], pose[:, :3, 3], pose[:, 3, 3] = rotation, position, 1.0
        return pose

    def _update(self, control: HeldControl, t: float, tick: int, x: Array) -> None:
        """Ask the controller for each solution, and keep the answers until they act."""
        u = self._replay.asked(control.place, control.law, t, tick, self._given(control, x))
        moving = self._nq + self._nv
        control.require_sound(t, u, x[self._nq : moving])
        control.keep(t, u.T, x[: moving + (len(self._states) if self._of_states & {*control.controller.inputs} else 0)])
        u = u.T
        if control.limited:
            u = np.clip(u, -control.limits, control.limits)
        control.waiting[tick] = u


def _copied(kept: Any) -> Any:
    """A copy. Raises SceneError, code "controller-not-copied"."""
    try:
        return copy.deepcopy(kept)
    except Exception as error:
        raise SceneError(f"what a controller keeps cannot be copied: {type(error).__name__}: {error}", where="effects",
                         remedy="keep numbers, arrays and objects that copy.deepcopy copies",
                         code="controller-not-copied") from error  # fmt: skip
