"""Run: a scene with switches, piece by piece, from event to event."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from twolink.effects.plane_contact import Mode
from twolink.errors import AccuracyError, SceneError
from twolink.integrate.equations import Equations
from twolink.integrate.event import Event
from twolink.integrate.hybrid.guards import guards
from twolink.integrate.hybrid.impacts import collide, snapped
from twolink.integrate.hybrid.locating import Guard, Hit, Watcher
from twolink.integrate.hybrid.mode_selection import Key, decide, slide, unlock
from twolink.integrate.hybrid.modes import Hybrid
from twolink.integrate.hybrid.snapshot import Moment
from twolink.integrate.methods import Method
from twolink.integrate.perturbation import NO_PERTURBATION, Perturbation
from twolink.integrate.solution import Piece, Progress, Solution, joined
from twolink.integrate.state import Array
from twolink.integrate.step_map import StepMap, step_map
from twolink.integrate.stepping import integrate
from twolink.io.text import kebab_case

AT_ONCE = 200  # events at one time
SAME = 1e-13  # relative: times that are one
SMALL_BOUNCE = 1e-2  # of the tolerance: bounces lower than that are over
LEAST_BOUNCE = 1e-13  # m or rad: what numbers resolve
MOST_EVENTS = 100_000
MET = 1e-9  # m: a contact that is at its plane
BEYOND = 1e-9  # m or rad: a start so far beyond a stop or a plane is a mistake


def solve(
    equations: Equations,
    method: Method,
    times: Array,
    setting: float,
    progress: Progress | None = None,
    perturbation: Perturbation = NO_PERTURBATION,
) -> Solution:
    """Solve a scene with switches for the samples `times` (n,). Raises AccuracyError and SceneError."""
    return _Run(equations, method, setting, progress, perturbation).to(times)


class _Run:
    def __init__(
        self,
        equations: Equations,
        method: Method,
        setting: float,
        progress: Progress | None,
        perturbation: Perturbation,
    ) -> None:
        self.whole, self.method, self.setting, self.progress = equations, method, setting, progress
        self.perturbation = perturbation
        self.hybrid = Hybrid.of(equations)
        self.nq = equations.space.nq
        self.x = equations.start[: equations.moving].copy()
        self.modes = self.hybrid.first()
        self.t = 0.0
        self.events: list[Event] = []
        self.sides: dict[Key, float] = {}
        self.small = max(SMALL_BOUNCE * setting, LEAST_BOUNCE) if method.adaptive else LEAST_BOUNCE
        self.at_once = 0
        self.opened: set[Key] = set()  # what events of this instant have let go
        self.told: set[str] = set()  # what an impact has already said to rest
        self.ended = False
        self.span = 0.0
        self.piece = equations

    def to(self, times: Array) -> Solution:
        """The samples up to the last of `times`, or to where the run ends or is interrupted."""
        end, self.t = float(times[-1]), float(times[0])
        self.whole.require(self.t, end)
        stops = [*(t for t in self.whole.breaks(end) if t > self.t), end]
        self._require_room("the start")
        self._settle()
        self.events.clear()  # how it starts is no event
        self._timed(self.t)
        self._settle()
        self.span = end - self.t
        parts: list[Solution] = []
        try:
            while self.t < end and not self.ended:
                parts.append(self._next(times, next(t for t in stops if t > self.t), first=not parts))
                if parts[-1].interrupted:
                    break
        except KeyboardInterrupt:
            if not parts:
                raise
            parts[-1] = replace(parts[-1], interrupted=True)
        solution = joined(parts)
        if self.ended and solution.t[-1] < self.t:
            solution = _with(solution, self.t, self.x)
        return replace(solution, events=tuple(sorted(self.events, key=lambda e: e.t)))

    def _next(self, times: Array, stop: float, *, first: bool) -> Solution:
        """The next piece, and what happens at its end."""
        begin, inside = self.t, times[(times > self.t) & (times <= stop)]
        extra = not inside.size or inside[-1] < stop
        part, hit = self._piece(np.concatenate([[begin], inside, [stop] if extra else []]), stop)
        taken = np.isin(part.t, times)
        taken[0] &= first
        kept = replace(part, t=part.t[taken], x=part.x[: self.whole.moving, taken],
                       pieces=(Piece(self.piece, begin, int(taken.sum())),))  # fmt: skip
        if part.interrupted:
            return kept
        if hit is not None and not extra and stop - hit.t <= SAME * max(1.0, stop) and kept.t[-1:] != stop:
            kept = _with(kept, stop, hit.x[: self.whole.moving])
        self.t = stop if hit is None else hit.t
        self.x = np.array((part.x[:, -1] if hit is None else hit.x)[: self.whole.moving])
        if stop - self.t <= SAME * max(1.0, stop):
            self.t = stop
        if self.t - begin > SAME * max(1.0, self.t):
            self.at_once = 0
            self.opened.clear()
        self.at_once += 1
        if hit is not None:
            self._handle(hit.guard)
        if self.t == stop:
            self._timed(stop)
            self._settle(frozenset(self.opened))
        if self.at_once > AT_ONCE or len(self.events) > MOST_EVENTS:
            raise AccuracyError("events follow each other without end", where=f"t = {self.t:.9g} s",
                                remedy="more restitution, smooth friction, or a shorter duration")  # fmt: skip
        return kept

    def _piece(self, grid: Array, stop: float) -> tuple[Solution, Hit | None]:
        """Solve from now to the next event or stop."""
        middle = 0.5 * (self.t + stop)
        equations = self.hybrid.beginning(self.modes, self.x, middle)
        self.piece = equations
        steps = step_map(equations, self.method)
        here = Moment(equations, np.array([self.t]), equations.start[:, None])
        watching = guards(self.hybrid, self.modes, here, self.sides)
        watcher = Watcher(equations, steps, watching, self.t, self.perturbation.touch_margin)
        longest = self.span / self.perturbation.min_steps
        part = integrate(steps, grid, self.setting, self.progress, watcher=watcher, longest=longest)
        if part.hit is not None and not self.method.adaptive:
            part = self._resolved(part, steps, watcher, grid)
        for guard in watching:
            if guard.key[0] in ("release", "watch", "limit") and guard.side is not None:
                self.sides[guard.key] = guard.side
        return part, part.hit

    def _resolved(self, part: Solution, steps: StepMap, watcher: Watcher, grid: Array) -> Solution:
        """A piece of a few steps of fixed size again in more: else half the step would take the same ones.

        Their number grows with the root of the run's, so that a finer run is finer here too.
        """
        length = float(part.hit.t) - float(grid[0])
        count = max(4.0, math.sqrt(self.span / self.setting))
        while part.hit is not None and 0.0 < length < count * self.setting:
            end = float(grid[0]) + 2.0 * length
            shorter = np.append(grid[grid < end], end) if end < grid[-1] else grid
            again = integrate(steps, shorter, length / count, self.progress, watcher=watcher)
            if again.hit is not None or end >= grid[-1]:
                return again
            length *= 2.0  # the event is later than the few steps said
        return part

    def _handle(self, guard: Guard) -> None:
        kind, i = guard.key
        opened = self.opened
        quiet, before = False, (set(self.modes.locked), dict(self.modes.contact))
        if kind in ("holds less", "holds more"):
            unlock(self.hybrid, self.modes, i, 1.0 if kind == "holds less" else -1.0, self.x)
            opened.add(("joint", i))
        elif kind == "stick":
            self.x[self.nq + i] = 0.0
            opened.discard(("joint", i))
        elif kind == "stop":
            stop = self.hybrid.stops[i]
            self.x[stop.entry] = stop.position
            self._collide(("stop", i))
        elif kind == "impact":
            self.x[: self.nq] = snapped(self.hybrid, self.modes, self.x, self.t, i)
            self._collide(("contact", i))
        elif kind == "leave":
            self.modes.contact[i] = "free"
            opened.add(("contact", i))
        elif kind == "slide":
            moment = self._moment()
            rows = moment.multipliers[self.hybrid.touching(moment.equations, i)]
            slide(self.modes, i, [float(row[0]) for row in rows])
            opened.add(("roll", i))
        elif kind == "release":
            self._let_go(i)
        elif kind == "watch":
            self.sides[guard.key] = -(guard.side or 1.0)
            if self.hybrid.watches[i].then is not None:
                del self.sides[guard.key]  # it may be on any side then
            self._notice(i)
        elif kind == "limit":
            self.sides[guard.key] = -(guard.side or 1.0)
            name = self.whole.effort_limits[i]
            self._note("limit", name, "reached" if guard.side == 1.0 else "left")
            quiet = True
        if not quiet:
            self._settle(frozenset(opened), before)
        if kind == "stick" and i not in self.modes.locked:
            self._note("reverse", self.hybrid.names[i])

    def _settle(
        self, opened: frozenset[Key] = frozenset(), before: tuple[set[int], dict[int, Mode]] | None = None
    ) -> None:
        """Decide the modes, and note what has changed since `before`."""
        if before is None:
            before = (set(self.modes.locked), dict(self.modes.contact))
        decide(self.hybrid, self.modes, self.x, self.t, opened)
        for k in sorted(before[0] ^ self.modes.locked):
            name = self.hybrid.names[k]
            if k in self.modes.locked:
                stopped = self.hybrid.standing(k, self.x)
                if not (stopped and name in self.told):
                    self._note("rest" if stopped else "stick", name)
            else:
                self._note("slip" if k in self.hybrid.friction else "leave", name)
        kinds = {"free": "leave", "sliding": "slide", "rolling": "roll"}
        for i, mode in self.modes.contact.items():
            if mode != before[1][i]:
                frictionless = mode == "sliding" and not self.hybrid.contacts[i].friction
                if not (frictionless and self.hybrid.contacts[i].frame in self.told):
                    self._note("rest" if frictionless else kinds[mode], self.hybrid.contacts[i].frame)
        self.told.clear()

    def _moment(self) -> Moment:
        equations = self.hybrid.beginning(self.modes, self.x, self.t)
        return Moment(equations, np.array([self.t]), equations.start[:, None])

    def _note(self, kind: str, what: str, detail: str = "", energy: float = 0.0, t: float | None = None) -> None:
        self.events.append(Event(self.t if t is None else t, kind, what, detail, energy))

    def _collide(self, key: Key) -> None:
        """Velocities after what is hit, if it is not only grazed."""
        found = collide(self.hybrid, self.modes, self.x, self.t, key, self.small)
        if found is None:
            return
        self.x[self.nq :] = found.v
        for name, speed, lost, rest in found.met:
            self._note("impact", name, f"at {speed:.6g}", lost)
            if rest is not None:
                why = "after bounces too small to follow, summed in closed form"
                self._note("rest", name, why, t=self.t + rest)
                self.told.add(name)

    def _timed(self, t: float) -> None:
        """What happens at a time that is given."""
        for i, release in self.hybrid.releases.items():
            if self.modes.held[i] and release.at is not None and abs(release.at - t) <= SAME * max(1.0, t):
                self._let_go(i)
        for i, watch in self.hybrid.watches.items():
            if watch.at is not None and abs(watch.at - t) <= SAME * max(1.0, t):
                self._notice(i)

    def _let_go(self, i: int) -> None:
        before = self._energy()
        self.modes.held[i] = False
        gone = before - self._energy()  # a payload takes its own along
        self._note("release", kebab_case(type(self.hybrid.releases[i].of).__name__), energy=gone)

    def _energy(self) -> float:
        """Kinetic and potential energy now, J."""
        robot = self.hybrid.equations(self.modes, self.x).robot
        kinetic, potential = robot.energy(self.x[: self.nq], self.x[self.nq :])
        return float(kinetic + potential)

    def _notice(self, i: int) -> None:
        watch = self.hybrid.watches[i]
        self._note("watch", watch.name)
        self.ended |= watch.stop
        if watch.then is not None:
            given = watch.then(self.x[: self.nq].copy(), self.x[self.nq :].copy())
            self.x = _checked(given, self.nq, self.whole.space.nv, watch.name)
            self._require_room(f"`then` of {watch.name!r}")

    def _require_room(self, who: str) -> None:
        """Require a state within stops and above planes; one that is beyond by a rounding is moved onto them."""
        for stop in self.hybrid.stops:
            room = stop.side * (self.x[stop.entry] - stop.position)
            if room < -BEYOND:
                raise SceneError(f"{who} has joint {stop.joint!r} {-room:.3g} beyond its stop at {stop.position:g}",
                                 where="q", remedy="keep it within its limits")  # fmt: skip
            if abs(room) <= BEYOND:
                self.x[stop.entry] = stop.position
        for i, contact in self.hybrid.contacts.items():
            gap = float(np.squeeze(contact.gap(self._moment().motion)))
            if gap < -BEYOND:
                raise SceneError(f"{who} has {contact.frame!r} {-gap:.3g} m below its plane", where="q",
                                 remedy="keep it above")  # fmt: skip
            if abs(gap) <= BEYOND:
                self.x[: self.nq] = snapped(self.hybrid, self.modes, self.x, self.t, i)


def _with(part: Solution, t: float, x: Array) -> Solution:
    """A solution with a sample more, of its last piece."""
    *before, last = part.pieces
    return replace(part, t=np.append(part.t, t), x=np.concatenate([part.x, x[:, None]], axis=1),
                   pieces=(*before, replace(last, samples=last.samples + 1)))  # fmt: skip


def _checked(given: Any, nq: int, nv: int, name: str) -> Array:
    """The state that a watch's change gives. Raises SceneError."""
    try:
        q, v = (np.asarray(part, dtype=float) for part in given)
        x = np.concatenate([q, v])
        fits = q.shape == (nq,) and v.shape == (nv,) and bool(np.isfinite(x).all())
    except (TypeError, ValueError):
        fits = False
    if not fits:
        raise SceneError(f"`then` of {name!r} gave no state", where="effects",
                         remedy=f"return (q, v) of sizes {nq} and {nv}")  # fmt: skip
    return x
