"""The state of a run with events: time, motion, mode, and what has happened; and contacts of bodies at features.

Of corners, faces and edges those that touch are contacts: which are hit, and how one follows another over an edge.
"""

import copy
import itertools
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np

from twolink.algorithms.motion import KinematicState
from twolink.algorithms.namespaces import Numbers
from twolink.algorithms.spatial import ZERO
from twolink.errors import AccuracyError, SceneError
from twolink.geometry.features import Feature
from twolink.integrate.hybrid.consistency import NEAR, SLOW, consistent, still_speed
from twolink.integrate.hybrid.impacts import Impact, Touch, brought_to_rest, collide, contact_touch, onto_contact, whole
from twolink.integrate.hybrid.least_bounce import EVERY_BOUNCE, LeastBounce
from twolink.integrate.hybrid.locating import Guard, Key
from twolink.integrate.hybrid.modes import SLOW_SLIP, Mode, ModeState, System
from twolink.integrate.hybrid.snapshot import Snapshot
from twolink.integrate.motion.effect_numbers import contact_slots
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.formulas import motion_of
from twolink.integrate.solution import Event, Impulse

BEYOND = 1e-9  # m or rad: a state so far beyond a stop or a plane is refused
SAME_PLACE = 2 * NEAR  # m: of features that touch at one place
OF_CONTACTS = ("impact", "single", "leave", "slide", "roll", "contact")  # keys with the number of a contact
CHANGED = np.ndarray, list, dict, set  # kinds of what a run changes in place
Touched = tuple[int, Feature]  # with the number of its pair


class RunState(ModeState):
    """Time t, motion x = (q, v, z) and mode of a run, which transitions change.

    events, impulses: so far. sides: of each trigger, the sign of its value. fired: guards whose zero has caused an
    event at this instant. opened: what events of this instant have freed. passed: features that have passed an edge or
    opened in it, by the pair's number and their own. ended: the run is over. least: which bounces are followed.
    """

    def __init__(
        self, equations: Equations, t: float, least: LeastBounce = EVERY_BOUNCE, slow: float = SLOW_SLIP
    ) -> None:
        system = System(equations, slow)
        dropped, waiting = system.switching.idle_at(t)
        mode = Mode(dropped=dropped, waiting=waiting).with_contacts((), len(system.contacts))
        super().__init__(system, mode, np.array(equations.start[: equations.moving]), t)
        self.events: list[Event] = []
        self.impulses: list[Impulse] = []
        self.sides: dict[Key, float] = {}
        self.fired: set[Key] = set()
        self.opened: set[Key] = set()
        self.ended = False
        self.least = least
        self.passed: set[tuple[int, int]] = set()
        self._rest_noted: set[str] = set()

    def copied(self) -> "RunState":
        """A run that may be changed."""
        other = copy.copy(self)
        for name, value in vars(self).items():
            if isinstance(value, CHANGED):
                setattr(other, name, value.copy())
        return other

    def moved_on(self) -> None:
        """Forget what has happened at an instant that is over."""
        for happened in (self.opened, self.passed, self.fired):
            happened.clear()

    def note(self, kind: str, what: str, detail: str = "", energy: float = 0.0, **more: Any) -> None:
        """Add an event, now unless t is said."""
        self.events.append(Event(more.pop("t", self.t), kind, what, detail, energy, **more))

    def resolve_mode(self, before: Mode | None = None, slow: float = SLOW) -> None:
        """Go to the consistent mode, and note what has changed since the mode `before`. slow: see `consistent`."""
        before = self.mode if before is None else before
        self.add_touching()
        before = before.with_contacts(range(len(before.contacts)), len(self.mode.contacts) - len(before.contacts))
        directions = self.mode.directions
        self._end_bounces()
        found = consistent(self, frozenset(self.opened), slow)
        self.mode, self.x = found.mode, found.x
        for k in sorted(before.locked ^ self.mode.locked):
            self._note_joint(k)
        for i, (last, now) in enumerate(zip(directions, self.mode.directions, strict=True)):
            if last != now:  # the guard of another direction of sliding is another one: it has not fired
                self.fired.discard(("roll", i))
        kinds = {"free": "leave", "sliding": "slide", "rolling": "roll"}
        noted = dict[tuple[str, str], None]()  # a pair that touches at several points is noted once
        for contact, old, new in zip(self.system.contacts, before.contacts, self.mode.contacts, strict=True):
            rests = new == "sliding" and not contact.friction
            if old != new and not (rests and contact.name in self._rest_noted):
                noted["rest" if rests else kinds[new], contact.name] = None
        for kind, name in noted:
            self.note(kind, name)
        self._rest_noted.clear()

    def _end_bounces(self) -> None:
        """Bring to rest what bounces too low to follow."""
        result = brought_to_rest(self, self.least)
        if result is None:
            return
        self.x[self.system.whole.space.v_rows], ends, energy = result
        for name, seconds in ends:
            why = "after bounces too small to follow, summed in closed form"
            self.note("rest", name, why, energy / len(ends), t=self.t + seconds)
            self._rest_noted.add(name)

    def _note_joint(self, k: int) -> None:
        """Note that a joint is locked now, or free: by what locks it there, else by what locks it anywhere."""
        locks = sorted(self.system.locks(k, self.x), key=lambda lock: lock.entry is None)
        name, locked = self.system.names[k], k in self.mode.locked
        if locked and not (locks[0].entry is not None and name in self._rest_noted):
            self.note(locks[0].kinds[0], name)
        if not locked:
            self.note(locks[-1].kinds[1] if locks else "leave", name)

    def apply_impact(self, touch: Touch, kind: str = "impact") -> None:
        """Change the velocities by the impulses of what is hit, if it is not only grazed."""
        self.add_touching()
        result = collide(self, touch)
        if result is None:
            return
        self.x[self.system.whole.space.v_rows], impacts = result
        self.impulses += [self._impulse(one, i) for one in impacts
                          if (i := one.touch.contact) is not None and one.impulse.any()]  # fmt: skip
        for impact in whole([impact for impact in impacts if impact.was_hit]):
            name = impact.touch.name
            self.note(kind if impact.touch is touch else "impact", name, f"at {impact.speed:.6g} {impact.touch.unit}",
                      impact.energy)  # fmt: skip
            if kind != "impact":
                self._rest_noted.add(name)

    def _impulse(self, impact: Impact, i: int) -> Impulse:
        """The impulse of an impact at contact i."""
        p = [*impact.impulse.tolist(), 0.0, 0.0][:3]
        contact = self.system.contacts[i]
        found = contact.constraint(True, contact_slots(i)).contact_force(self.motion(), p)
        on_first = [np.asarray(entry).item() for entry in (found[2] if found else ZERO)]
        return Impulse(self.t, contact.name, np.array(on_first))

    def touching(self, reach: float = NEAR) -> list[tuple[int, list[Feature]]]:
        """The features that touch, with their pair's number, those together of which one is enough."""
        motion = self.motion()
        return [(p, group) for p, pair in enumerate(self.system.pairs) for group in pair.touching(motion, reach)]

    def motion(self, snapshot: Snapshot | None = None) -> KinematicState:
        """The motion of the states of a snapshot, or of the present one."""
        snapshot, equations = snapshot or self.evaluate(), self.own.equations
        return motion_of(equations, equations.mechanism, snapshot.t, snapshot.x, Numbers)

    def add_touching(self, reach: float = NEAR) -> None:
        """Make contacts of features that touch, unless one that is together with them is one. Raises AccuracyError."""
        if not self.system.pairs:
            return
        taken = {(p, one.number): i for i, p, one in self.features}
        closed, found = list[Touched](), list[Touched]()
        for p, group in self.touching(reach):
            own = {one.number: taken[p, one.number] for one in group if (p, one.number) in taken}
            standing = [one for one in group if one.number in own and ("contact", own[one.number]) not in self.opened]
            fresh = [one for one in group if (p, one.number) not in {*taken, *self.passed}]
            if standing:
                closed.append((p, standing[0]))
            elif fresh:
                found.append((p, fresh[0]))
        if found:
            self._require_normals(closed, found)
            self.mode = self.mode.with_contacts(range(len(self.mode.contacts)), len(found))
            self.system = self.system.having([*self.system.features, *found])

    def _require_normals(self, closed: Sequence[Touched], found: Sequence[Touched]) -> None:
        """Require that no corner on an edge, or on a corner, is pressed on: it has several normals. AccuracyError."""
        motion, still = self.motion(), still_speed(self.v)
        presses = [(p, one) for p, one in found if float(np.asarray(one.gap.velocity(motion)[0]).item()) <= still]
        for (p, one), (k, other) in itertools.combinations([*closed, *presses], 2):
            if p == k and np.abs(one.place - other.place).max() <= SAME_PLACE:
                raise no_single_point(self.system.pairs[p].name, self.t)

    @property
    def features(self) -> list[tuple[int, int, Feature]]:
        """Contacts that are features of pairs: number, that of the pair, and the feature."""
        first = len(self.system.contacts) - len(self.system.features)
        return [(first + k, p, one) for k, (p, one) in enumerate(self.system.features)]

    def keep_contacts(self, kept: Sequence[int]) -> None:
        """Keep these contacts alone."""
        number = {i: k for k, i in enumerate(kept)}
        self.system = self.system.having([(p, one) for i, p, one in self.features if i in number])
        self.mode = self.mode.with_contacts(kept)
        for keys in (self.fired, self.opened):
            of_contacts = {key for key in keys if key[0] in OF_CONTACTS}
            keys -= of_contacts
            keys |= {(kind, number[i]) for kind, i in of_contacts if i in number}

    def drop_open_features(self) -> None:
        """Drop the features that are not closed; those that opened in this instant stay open in it."""
        free = {i: (p, one.number) for i, p, one in self.features if self.mode.contacts[i] == "free"}
        if free:
            self.passed |= {feature for i, feature in free.items() if ("contact", i) in self.opened}
            self.keep_contacts([i for i in range(len(self.mode.contacts)) if i not in free])

    def require_room(self, who: str) -> None:
        """Require a state within stops and above planes. What is there but for a rounding is moved there exactly."""
        for stop in self.system.stops:
            room = stop.side * (self.x[stop.entry] - stop.position)
            if room < -BEYOND:
                raise SceneError(f"{who} has joint {stop.name!r} {-room:.3g} beyond its stop at {stop.position:g}",
                                 where="q", remedy="keep it within its limits", code="beyond-stop")  # fmt: skip
        for _, lock in self.system.switching.locks:
            if lock.entry is not None and abs(self.x[lock.entry] - lock.position) <= BEYOND:
                self.x[lock.entry] = lock.position
        for pair in self.system.pairs:
            _require_gap(who, pair.name, pair.separation(self.motion()))
        self.add_touching()
        for i, contact in enumerate(self.system.contacts):
            gap = float(self.evaluate().contacts[i, 0, 0])
            _require_gap(who, contact.name, gap)
            if abs(gap) <= BEYOND:
                self.x[: self.system.nq] = onto_contact(self, i)

    def stored_energy(self) -> float:
        """Kinetic and potential energy of what acts now, J."""
        robot = self.own.equations.robot
        kinetic, potential = robot.energy(self.x[: self.system.nq], self.v)
        return float(kinetic + potential)


def _require_gap(who: str, name: str, gap: float) -> None:
    if gap < -BEYOND:
        raise SceneError(f"{who} has a gap of {gap:.3g} m at {name!r}: it is below the plane, or bodies overlap",
                         where="q", remedy="start with gaps of 0 or more", code="below-plane")  # fmt: skip


def no_single_point(name: str, t: float) -> AccuracyError:
    """For bodies that touch along a line, with a flat side, or with a corner on an edge."""
    return AccuracyError(f"{name} touch along a line, a flat side or an edge, not at points", where=f"t = {t:.9g} s",
                         remedy="give them spheres or corners that touch within a side", code="no-single-point",
                         t=t)  # fmt: skip


REACHES = (NEAR, 1e-6, 1e-3)  # m: of features that are hit; wider for states beside a motion


def pair_guards(run: RunState) -> Iterator[Guard]:
    """Pairs of which further features may touch."""
    covered: dict[int, set[int]] = {p: set() for p in range(len(run.system.pairs))}
    closed = {(p, one.number) for i, p, one in run.features if run.mode.contacts[i] != "free"}
    for p, number in closed:
        covered[p].add(number)
    for p, group in run.touching() if closed else ():
        if any((p, one.number) in closed for one in group):
            covered[p] |= {one.number for one in group}
    for p, without in covered.items():
        yield Guard(("meet", p), partial(_least_gap, run, p, without), partial(_meet, p), run.t, of="distance")


def _least_gap(run: RunState, p: int, without: set[int], s: Snapshot) -> Any:
    """The smallest gap of what may touch of a pair, m."""
    return run.system.pairs[p].gaps(run.motion(s), without)


def single_point(run: RunState, i: int, s: Snapshot) -> Any:
    """The value that is above 0 while a contact touches at one point; None where it always does."""
    return run.system.contacts[i].single(run.motion(s))


def _meet(p: int, run: RunState) -> None:
    """Features of a pair that touch: the one that is approached fastest is hit, and what touches beside it."""
    run.fired.discard(("meet", p))  # what is smallest after this is another gap
    for reach in REACHES:
        run.add_touching(reach)
        own = [i for i, pair, _ in run.features if pair == p and run.mode.contacts[i] == "free"]
        if own:
            break
        if any(pair == p for pair, _ in run.touching()):  # it comes to where another feature touches already
            return
    else:
        raise no_single_point(run.system.pairs[p].name, run.t)
    rates = run.evaluate().contacts[:, 1, 0]
    i = min(own, key=lambda i: float(rates[i]))
    run.x[: run.system.nq] = onto_contact(run, i)
    run.apply_impact(contact_touch(run, i))
    run.resolve_mode()


def pass_edge(i: int, run: RunState) -> None:
    """A corner that leaves a face, or the end of an edge: the features beside it that touch become contacts."""
    snapshot, name = run.evaluate(), run.system.contacts[i].name
    closed = [k for k, _, _ in run.features if run.mode.contacts[k] != "free"]
    gone = {i, *(k for k in closed if np.asarray(single_point(run, k, snapshot)).item() <= NEAR)}
    run.passed |= {(p, one.number) for k, p, one in run.features if k in gone}
    run.keep_contacts([k for k in range(len(run.system.contacts)) if k not in gone])
    known = len(run.events)
    run.resolve_mode()
    touches = any(run.mode.contacts[k] != "free" and run.system.contacts[k].name == name for k, _, _ in run.features)
    run.events[known:] = [event for event in run.events[known:] if event.what != name]
    run.note("edge" if touches else "leave", name)
