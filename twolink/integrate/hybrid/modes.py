"""Modes: what each switch of a scene is doing, and the equations that hold then."""

from __future__ import annotations

import math
import weakref
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from twolink.effects import Effect
from twolink.effects.dry_friction import DryFriction
from twolink.effects.joint_stops import JointStops
from twolink.effects.plane_contact import Mode, PlaneContact, Touching
from twolink.effects.release import Release
from twolink.effects.switching import Switching
from twolink.effects.watch import Watch
from twolink.integrate.equations import Equations
from twolink.integrate.scene_equations import make_equations
from twolink.integrate.state import Array


@dataclass(frozen=True)
class Stop:
    """One end of a joint: its places in q and v, the position, and its side: 1 where q stays above it, else -1."""

    entry: int
    dof: int
    position: float
    side: float
    restitution: float
    joint: str


@dataclass
class Modes:
    """What the switches are doing.

    locked: degrees of freedom at rest. slipping: the direction of slip of those with friction that are not. contact:
    the mode of each plane contact. sliding: its direction of sliding when that began, along the tangents. held: whether
    each release still holds.
    """

    locked: set[int] = field(default_factory=set)
    slipping: dict[int, float] = field(default_factory=dict)
    contact: dict[int, Mode] = field(default_factory=dict)
    sliding: dict[int, tuple[float, float]] = field(default_factory=dict)
    held: dict[int, bool] = field(default_factory=dict)


class Hybrid:
    """The switches of a scene, by kind, and its equations in each mode. Contacts and releases go by their places."""

    def __init__(self, switching: Switching) -> None:
        self.base, self.effects = switching.base, switching.effects
        self.robot = robot = switching.robot
        self.friction: dict[int, tuple[float, float]] = {}
        self.stops: list[Stop] = []
        self.contacts: dict[int, PlaneContact] = {}
        self.releases: dict[int, Release] = {}
        self.watches: dict[int, Watch] = {}
        self.names = {joint.v.start: joint.name for joint in robot.joints}
        for i, effect in enumerate(switching.effects):
            if isinstance(effect, DryFriction):
                for k, (static, kinetic) in effect.levels(robot).items():
                    before = self.friction.get(k, (0.0, 0.0))
                    self.friction[k] = before[0] + static, before[1] + kinetic
            elif isinstance(effect, JointStops):
                for (entry, k), ends in effect.stops(robot).items():
                    for position, side in zip(ends, (1.0, -1.0), strict=True):
                        if math.isfinite(position):
                            self.stops.append(Stop(entry, k, position, side, effect.restitution, self.names[k]))
            elif isinstance(effect, PlaneContact):
                self.contacts[i] = effect
            elif isinstance(effect, Release):
                self.releases[i] = effect
            elif isinstance(effect, Watch):
                self.watches[i] = effect
        self.lockable = sorted({*self.friction, *(stop.dof for stop in self.stops)})
        self._equations: dict[tuple[object, ...], Equations] = {}

    @classmethod
    def of(cls, equations: Equations) -> Hybrid:
        """The switches of the scene that equations are of, found once."""
        switching = equations.switching or Switching(equations.robot, equations.robot, equations.effects)
        if switching not in _known:
            _known[switching] = cls(switching)
        return _known[switching]

    def first(self) -> Modes:
        """Everything held and nothing touching: what is at rest is decided by forces."""
        contact: dict[int, Mode] = dict.fromkeys(self.contacts, "free")
        return Modes(contact=contact, held=dict.fromkeys(self.releases, True))

    def equations(self, modes: Modes, x: Array) -> Equations:
        """The equations in these modes, their loops chosen at the state x where they are met first."""
        name = (*modes.contact.values(), *modes.held.values())
        if name not in self._equations:

            def stand_in(i: int, effect: Effect) -> Sequence[Effect]:
                if i in self.contacts:
                    return self.contacts[i].in_mode(modes.contact[i], f"contact {i}")
                if i in self.releases:
                    return [self.releases[i].of] if modes.held[i] else []
                return [] if i in self.watches else [effect]

            switching = Switching(self.base, self.robot, self.effects)
            effects = switching.replaced(stand_in)
            nq, nv = self.robot.nq, self.robot.nv
            q = self.robot.normalize(x[None, :nq])[0]
            robot = switching.robot_with(effects)
            self._equations[name] = make_equations(robot, q, x[nq : nq + nv], effects, switching)
        return self._equations[name]

    def beginning(self, modes: Modes, x: Array, t: float) -> Equations:
        """The equations in these modes from a state on, at a time within a piece of tables."""
        equations = self.equations(modes, x)
        dofs = equations.layout.lockable
        locks = [1.0 if k in modes.locked else 0.0 for k in dofs]
        rubs = [0.0 if k in modes.locked else -modes.slipping.get(k, 0.0) * self.friction.get(k, (0.0, 0.0))[1]
                for k in dofs]  # fmt: skip
        slots = {f"contact {i}.{n}": d for i, way in modes.sliding.items() for n, d in enumerate(way)}
        return equations.starting_at(x, t, np.array([*locks, *rubs]), slots)

    def touching(self, equations: Equations, i: int) -> int:
        """The id of the constraint that stands for contact i in these equations."""
        loops = equations.constraints.loops if equations.constraints is not None else ()
        return next(id(loop) for loop in loops if isinstance(loop, Touching) and loop.contact == self.contacts[i])

    def standing(self, k: int, q: Array) -> list[Stop]:
        """The stops at which a joint stands: events put it there exactly."""
        return [stop for stop in self.stops if stop.dof == k and q[stop.entry] == stop.position]

    def range(self, k: int, q: Array) -> tuple[float, float]:
        """The torques (least, most) that hold a joint at rest: friction's, and a stop's where it stands at one."""
        static = self.friction.get(k, (0.0, 0.0))[0]
        at = {stop.side for stop in self.standing(k, q)}
        return (-math.inf if -1.0 in at else -static), (math.inf if 1.0 in at else static)


_known: weakref.WeakKeyDictionary[Switching, Hybrid] = weakref.WeakKeyDictionary()
