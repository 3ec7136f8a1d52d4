"""Switching effects: what changes at events, as a few frozen concepts that an effect declares.

JointLock     locks one degree of freedom at rest, up to a torque
Stop          a joint's coordinate that stays on one side of a position
ContactPoint  a gap between bodies that stays at or above 0
ContactPair   two bodies whose points of contact are found where they touch
Trigger       what happens where a value passes 0, or at a time

The engine in integrate.hybrid knows these concepts and no effect by name.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

import numpy as np

from twolink.algorithms.motion import KinematicState
from twolink.algorithms.spatial import Scalar
from twolink.effects.effect import Effect
from twolink.effects.inputs import Slot
from twolink.effects.loops import Loop
from twolink.geometry.features import Feature

if TYPE_CHECKING:
    from twolink.dynamics import Robot
    from twolink.effects.conditions import Condition

State = tuple[np.ndarray, np.ndarray]  # (q, v)


def same_time(a: float, b: float) -> bool:
    """True if no step lies between two times."""
    return abs(a - b) <= 1e-13 * max(1.0, b)


@dataclass(frozen=True)
class JointLock:
    """Keeps a degree of freedom at rest while that takes a torque from `least` to `greatest`, N m or N.

    kinetic: the torque against the motion while the joint slips. entry, position: it acts only where q[entry] is the
    position exactly, to which events move it; entry None: anywhere. kinds: of the events at which it locks and gives
    way.
    """

    dof: int
    least: float
    greatest: float
    kinetic: float = 0.0
    entry: int | None = None
    position: float = 0.0
    kinds: tuple[str, str] = ("stick", "slip")

    def acts(self, q: np.ndarray) -> bool:
        """True if it can lock the joint at its position."""
        return self.entry is None or bool(q[self.entry] == self.position)


@dataclass(frozen=True)
class Stop:
    """A stop of a joint: side (q[entry] - position) >= 0, with the side +1 or -1.

    At an impact the joint's velocity v becomes -restitution v. In contact the joint is locked, see `lock`.
    """

    name: str
    dof: int
    entry: int
    position: float
    side: float
    restitution: float
    unit: str  # of the velocity

    @property
    def lock(self) -> JointLock:
        """The stop's force on a joint at rest against it: away from it, of any size."""
        least, greatest = (0.0, math.inf) if self.side > 0 else (-math.inf, 0.0)
        return JointLock(self.dof, least, greatest, 0.0, self.entry, self.position, ("rest", "leave"))


@dataclass(frozen=True)
class ContactPoint:
    """A gap g(q) >= 0 with restitution and Coulomb's friction.

    friction, static: mu while the bodies slide and while they do not. gap: g, m. velocity: (g', slip along two
    tangents), m/s. constraint: from whether it rolls, and the direction of sliding when that began, the rows in force
    while the gap is 0. content: what gap and velocity are made of, as text. single: above 0 where they touch at one
    point; None where they always do. reflects: impacts that it takes part in are solved in rounds. threshold: the speed
    of approach up to which nothing bounces, m/s.
    """

    name: str
    restitution: float
    friction: float
    static: float
    gap: Callable[[KinematicState], Scalar]
    velocity: Callable[[KinematicState], tuple[Scalar, Scalar, Scalar]]
    constraint: Callable[[bool, tuple[Slot, Slot]], Loop]
    content: str
    single: Callable[[KinematicState], Scalar | None]
    reflects: bool
    threshold: float


@dataclass(frozen=True)
class ContactPair:
    """Two bodies of which some of many features may touch: only those that do are contacts.

    gaps: the smallest gap (n,) of the features that are over each other, without those of these numbers, m. touching:
    the features of one state that touch, up to a gap, those together of which one is enough. separation: of one state,
    m; below 0 where the bodies overlap. NumPy evaluates all of them. point: the contact of a feature from its gap.
    content: what the pair is made of, as text.
    """

    name: str
    gaps: Callable[[KinematicState, Collection[int]], np.ndarray]
    touching: Callable[[KinematicState, float], list[list[Feature]]]
    separation: Callable[[KinematicState], float]
    point: Callable[[Any], ContactPoint]
    content: str


@dataclass(frozen=True)
class Catch:
    """Brings a joint that passes a position no faster than `speed` to rest there by an impulse, with loss of energy."""

    dof: int
    entry: int
    position: float
    speed: float
    unit: str


@dataclass(frozen=True)
class Trigger:
    """An event where a condition is reached from either side, where a function passes 0, or at a time.

    kind, name: of the event. at: s. condition: of the motion, compiled. function: of the motion, for NumPy alone.
    drops: its effect ceases to act; begins: it begins to. catch: see there; a joint that is too fast passes without an
    event. state: (q, v) -> (q, v) after it. ends: the run ends. direction: 1 where the
    value rises only, -1 where it falls, 0 both.
    """

    kind: str
    name: str
    at: float | None = None
    condition: Condition | None = None
    function: Callable[[KinematicState], Any] | None = None
    drops: bool = False
    begins: bool = False
    catch: Catch | None = None
    state: Callable[[np.ndarray, np.ndarray], State] | None = None
    ends: bool = False
    direction: int = 0

    @property
    def changes(self) -> bool:
        """True if it changes the state or the forces."""
        return self.drops or self.begins or self.catch is not None or self.state is not None


_D = TypeVar("_D", JointLock, Stop, ContactPoint, ContactPair, Trigger)
Declared = JointLock | Stop | ContactPoint | ContactPair | Trigger


class SwitchingEffect(Effect, frozen=True):
    """An effect that is smooth only between events, at which its mode changes."""

    analytic: ClassVar[bool] = False  # only between events

    def modes(self, robot: Robot) -> Iterable[Declared]:
        """Declarations of what changes at events: locks, stops, contacts and triggers."""
        raise NotImplementedError

    def acting(self) -> tuple[Effect, ...]:
        """The effects in its place until a trigger drops them."""
        return ()


@dataclass(frozen=True, eq=False)
class Switching:
    """The declarations of a scene's switching effects, each with the place of its effect in the scene.

    base: the robot before effects changed its constants; robot: after that.
    """

    base: Robot
    robot: Robot
    effects: tuple[Effect, ...] = ()
    locks: tuple[tuple[int, JointLock], ...] = ()
    stops: tuple[Stop, ...] = ()
    contacts: tuple[tuple[int, ContactPoint], ...] = ()
    pairs: tuple[tuple[int, ContactPair], ...] = ()
    triggers: tuple[tuple[int, Trigger], ...] = ()

    @property
    def lockable(self) -> tuple[int, ...]:
        """The degrees of freedom that something may lock at rest."""
        return tuple(sorted({lock.dof for _, lock in self.locks}))

    @property
    def times(self) -> tuple[float, ...]:
        """The times at which something happens."""
        return tuple(float(trigger.at) for trigger in self.timed if trigger.at is not None)

    @property
    def timed(self) -> tuple[Trigger, ...]:
        """Its triggers at a time."""
        return tuple(trigger for _, trigger in self.triggers if trigger.at is not None)

    @property
    def conditions(self) -> tuple[Condition, ...]:
        """The conditions of its triggers."""
        return tuple(trigger.condition for _, trigger in self.triggers if trigger.condition is not None)

    def idle_at(self, t: float) -> tuple[frozenset[int], frozenset[int]]:
        """The places of effects that have ceased to act before a time, and of those that do not act until it."""
        dropped, waiting = set[int](), {place for place, trigger in self.triggers if trigger.begins}
        for place, trigger in self.triggers:
            if trigger.at is not None and trigger.at < t and not same_time(trigger.at, t):
                dropped |= {place} if trigger.drops else set()
                waiting -= {place} if trigger.begins else set()
        return frozenset(dropped), frozenset(waiting)

    @property
    def every(self) -> list[Effect]:
        """The effects that act at some time."""
        return [one for effect in self.effects for one in effect.acting()]

    def acting(
        self, dropped: frozenset[int] = frozenset(), constraints: Sequence[tuple[int, Loop]] = ()
    ) -> tuple[tuple[int, Effect], ...]:
        """The effects that act, with their places, without those dropped, and with the constraints of contacts.

        What is released changes the robot last: constants that other effects set are those of the robot without it.
        """
        kept = ((place, effect) for place, effect in enumerate(self.effects) if place not in dropped)
        placed = [(place, own) for place, effect in kept for own in effect.acting()]
        placed.sort(key=lambda one: isinstance(self.effects[one[0]], SwitchingEffect) and one[1].changes)
        return (*placed, *constraints)

    def robot_with(self, effects: Sequence[Effect]) -> Robot:
        """The robot with the constants that these effects change."""
        changing, now = ([e for e in some if e.changes] for some in (self.effects, effects))
        if changing == now:
            return self.robot

        def change(model: Any) -> None:
            model.gravity.linear = np.zeros(3)
            for effect in now:
                effect.change(model)

        return self.base.changed(change)


def switching_of(base: Robot, robot: Robot, effects: Sequence[Effect]) -> Switching | None:
    """The declarations of a scene's switching effects; None where there are none."""
    own = [(place, effect) for place, effect in enumerate(effects) if isinstance(effect, SwitchingEffect)]
    if not own:
        return None
    declared = [(place, item) for place, effect in own for item in effect.modes(robot)]

    def those(kind: type[_D]) -> tuple[tuple[int, _D], ...]:
        return tuple((place, item) for place, item in declared if isinstance(item, kind))

    stops = those(Stop)
    locks = (*those(JointLock), *((place, stop.lock) for place, stop in stops))
    return Switching(base, robot, tuple(effects), locks, tuple(stop for _, stop in stops), those(ContactPoint),
                     those(ContactPair), those(Trigger))  # fmt: skip
