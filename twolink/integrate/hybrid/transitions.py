"""Transitions: what the zero of each guard does, and the guards of a mode with the transitions they cause."""

import itertools
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from twolink.effects.switching import Trigger, same_time
from twolink.errors import SceneError
from twolink.integrate.hybrid.consistency import ALLOWED, NEAR, SLOW
from twolink.integrate.hybrid.contact_problem import lock_limits
from twolink.integrate.hybrid.force_share import EMPTY, TIGHT, ForceDistributionProblem, share_of
from twolink.integrate.hybrid.impacts import catch_touch, contact_touch, onto_contact, resolved, stop_touch
from twolink.integrate.hybrid.locating import Guard, Key
from twolink.integrate.hybrid.modes import freed, sliding
from twolink.integrate.hybrid.snapshot import Snapshot
from twolink.integrate.hybrid.state import RunState, no_single_point, pair_guards, pass_edge, single_point
from twolink.integrate.motion.state import Array

AT_ZERO = 1e-13  # relative to the state: a guard that is so near to 0 at the start begins there
FORCE_AT_ZERO = 2 * ALLOWED  # relative to the loads
Value = Callable[[Snapshot], Any]


def guards_of(run: RunState, snapshot: Snapshot) -> list[Guard]:
    """The guards of the mode of a run, from its state on, of which this is the snapshot."""
    run = run.copied()  # their values are those of this mode, also where the run is in another one and comes back
    guards = [*_every_guard(run)]
    forces = any(guard.of == "force" for guard in guards)
    state = AT_ZERO * (1.0 + float(np.abs(run.x).max(initial=0.0)))
    noise = {"distance": 0.25 * resolved(run), "speed": state, "state": state,
             "force": FORCE_AT_ZERO * run.own.largest_load(snapshot) if forces else 0.0}  # fmt: skip
    with np.errstate(all="ignore"):
        for guard in guards:
            first = np.asarray(guard.value(snapshot)).item()
            guard.begin(first, noise[guard.of], fired=guard.key in run.fired)
    return guards


def guard_of(run: RunState, key: Key) -> Guard | None:
    """The guard of this key in the mode of a run, which has not begun; None where the mode has none."""
    return next((guard for guard in _every_guard(run) if guard.key == key), None)


def _every_guard(run: RunState) -> Iterator[Guard]:
    return itertools.chain(_joint_guards(run), _contact_guards(run), pair_guards(run), _trigger_guards(run))


def _joint_guards(run: RunState) -> Iterator[Guard]:
    """Locks that may be overcome, joints that may come to rest, stops that may be hit."""
    system, mode, x, t, limits = run.system, run.mode, run.x, run.t, lock_limits(run)
    for i, k in enumerate(system.lockable):
        if k in mode.locked:
            if run.own.redundant:
                continue  # its share is watched
            for torque, side in zip(limits[k], (1.0, -1.0), strict=True):
                if math.isfinite(torque):  # the lock gives more than the least torque, and less than the greatest
                    yield Guard((f"lock {side:+g}", k), partial(_row, "locks", i, side, torque),
                                partial(_free_joint, k, -side), t, of="force")  # fmt: skip
        elif k in system.has_friction and mode.slip.get(k):
            yield Guard(("stick", k), partial(_row, "x", system.nq + k, mode.slip[k], 0.0),
                        partial(_stick, k), t, of="speed")  # fmt: skip
    for n, stop in enumerate(system.stops):
        if not (stop.dof in mode.locked and x[stop.entry] == stop.position):
            yield Guard(("stop", n), partial(_row, "x", stop.entry, stop.side, stop.position),
                        partial(_hit_stop, n), t, of="distance")  # fmt: skip


def _contact_guards(run: RunState) -> Iterator[Guard]:
    """Gaps that may close; closed contacts that may open, begin to slide, or begin to roll."""
    system, mode, t = run.system, run.mode, run.t
    fixed = len(system.contacts) - len(system.features)
    for i, contact in enumerate(system.contacts):
        if mode.contacts[i] == "free":
            if i >= fixed:
                continue  # its pair has a guard
            gap, rate = (partial(_row, "contacts", (i, row), 1.0, 0.0) for row in (0, 1))
            yield Guard(("impact", i), gap, partial(_hit_contact, i), t, of="distance", rate=rate)
            continue
        if single_point(run, i, run.evaluate()) is not None:
            ends = _require_point if i < fixed else pass_edge
            yield Guard(("single", i), partial(single_point, run, i), partial(ends, i), t)
        if mode.contacts[i] == "sliding" and contact.friction:
            yield Guard(("roll", i), partial(_slip, i, mode.directions[i]), _turn, t)
        if run.own.redundant:
            continue
        forces = partial(run.own.contact_forces, i=i)
        yield Guard(("leave", i), partial(_normal_force, forces), partial(_open, i), t, of="force")
        if mode.contacts[i] == "rolling":
            yield Guard(("slide", i), partial(_cone, forces, contact.static), partial(_slide, i), t, of="force")
    if run.own.redundant:
        share = share_of(run)
        yield Guard(("share", 0), partial(_margin, share), partial(_give_way, share), t, of="force")


def _require_point(i: int, run: RunState) -> None:
    """Raise AccuracyError for bodies that touch along a line, with a flat side, or over an edge."""
    raise no_single_point(run.system.contacts[i].name, run.t)


def _trigger_guards(run: RunState) -> Iterator[Guard]:
    """Triggers of effects that act, but for those at a time."""
    for n, (place, trigger) in enumerate(run.system.triggers):
        value = None if _is_over(run, place, trigger) or _is_caught(run, trigger) else _trigger_value(run, n)
        if value is not None:
            yield Guard(("trigger", n), value, partial(_fire, n), run.t, side=run.sides.get(("trigger", n)))


def _row(field: str, row: Any, side: float, offset: float, s: Snapshot) -> Any:
    """A row of a field of a snapshot less an offset, with a sign."""
    return side * (getattr(s, field)[row] - offset)


def _margin(share: ForceDistributionProblem, s: Snapshot) -> Any:
    """The margin of the best share of the contact forces within the laws, N."""
    return share.best(s).margin


def _slip(i: int, direction: tuple[float, float], s: Snapshot) -> Any:
    """The speed of sliding of contact i in the direction in which it began, m/s."""
    return direction[0] * s.contacts[i, 2] + direction[1] * s.contacts[i, 3]


def _normal_force(forces: Value, s: Snapshot) -> Any:
    """The normal force of a closed contact, N."""
    return forces(s)[0]


def _cone(forces: Value, friction: float, s: Snapshot) -> Any:
    """The margin of the friction within its cone, N."""
    normal, first, second = forces(s)
    return friction * normal - np.hypot(first, second)


def fire_timed(run: RunState) -> bool:
    """Cause what happens at the present time; whether anything does."""
    now = timed_triggers(run)
    fire(run, now)
    return bool(now)


def timed_triggers(run: RunState) -> list[int]:
    """The triggers whose time is the present, by number."""
    return [n for n, (place, trigger) in enumerate(run.system.triggers)
            if trigger.at is not None and same_time(trigger.at, run.t)
            and not _is_over(run, place, trigger)]  # fmt: skip


def fire(run: RunState, numbers: Iterable[int]) -> None:
    """Cause what these triggers do."""
    for n in numbers:
        _act(run, n)


def _trigger_value(run: RunState, n: int) -> Value | None:
    """The value that passes 0 where a trigger fires; None for one at a time."""
    system, (_, trigger) = run.system, run.system.triggers[n]
    if trigger.condition is not None:
        row = [i for i, (_, other) in enumerate(system.triggers) if other.condition is not None].index(n)
        return partial(_row, "conditions", row, 1.0, 0.0)
    if (function := trigger.function) is not None:
        return lambda s: function(run.motion(s))
    if trigger.at is None:  # a limit of effort
        return _limit_value(run, n - len(system.switching.triggers))
    return None


def _limit_value(run: RunState, i: int) -> Value | None:
    """The distance to the i-th limit of effort of all effects; None where its effect does not act."""
    limits, own = run.system.whole.effort_limits, run.own.equations.effort_limits
    same = [row for row, limit in enumerate(own) if limit == limits[i]]  # as of a controller with play behind it
    k = len(same) - limits[i:].count(limits[i])  # from the end: what is inside comes first, and may have none in a mode
    return partial(_row, "limits", same[k], 1.0, 0.0) if k >= 0 else None


def _is_over(run: RunState, place: int, trigger: Trigger) -> bool:
    """True if the effect of a trigger has ceased to act, or has begun where that is what the trigger does."""
    return place in run.mode.dropped or (trigger.begins and place not in run.mode.waiting)


def _is_caught(run: RunState, trigger: Trigger) -> bool:
    """True if the joint of a catch is locked where that catches it."""
    catch = trigger.catch
    return catch is not None and catch.dof in run.mode.locked and run.x[catch.entry] == catch.position


def _free_joint(k: int, torque: float, run: RunState) -> None:
    before = run.mode
    run.mode = freed(run, k, torque)
    run.opened.add(("joint", k))
    run.resolve_mode(before)


def _stick(k: int, run: RunState) -> None:
    run.x[run.system.nq + k] = 0.0
    run.opened.discard(("joint", k))
    run.resolve_mode()
    if k not in run.mode.locked:
        run.note("reverse", run.system.names[k])


def _hit_stop(n: int, run: RunState) -> None:
    stop = run.system.stops[n]
    run.x[stop.entry] = stop.position
    run.apply_impact(stop_touch(run.system, stop))
    run.resolve_mode()


def _hit_contact(i: int, run: RunState) -> None:
    single = single_point(run, i, run.evaluate())
    if single is not None and not np.asarray(single).item() > 0.0:
        _require_point(i, run)
    run.x[: run.system.nq] = onto_contact(run, i)
    run.apply_impact(contact_touch(run, i))
    run.resolve_mode()


def _turn(run: RunState) -> None:
    """A contact whose slip has turned by 90 degrees: it stops, or slides on in another direction.

    A slip that stops comes to 0 but for the error of steps, and for the speed below which friction does not follow its
    direction. Past that friction would turn it about 0 without end.
    """
    run.resolve_mode(slow=max(SLOW, run.system.slow))


def _open(i: int, run: RunState) -> None:
    before = run.mode
    run.mode = run.mode.with_contact(i, "free")
    run.opened.add(("contact", i))
    run.resolve_mode(before)


def _slide(i: int, run: RunState) -> None:
    run.x = run.closed()  # the rounding of slips that are 0 would be the direction of a sliding that begins
    before = run.mode
    run.mode = sliding(before, i, run.own.contact_forces(run.evaluate(), i)[:, 0])
    run.opened.add(("roll", i))
    run.resolve_mode(before)


def _give_way(share: ForceDistributionProblem, run: RunState) -> None:
    """Free the contacts and joints at their limits, where no share of the contact forces obeys the laws any more."""
    run.x = run.closed()  # the rounding of slips that are 0 would be the direction of a sliding that begins
    before, best = run.mode, share.best(run.evaluate())
    tight, count = best.weight[0] > TIGHT * best.weight[0].max(), len(share.contacts)
    for one, force, gives in zip(share.supports, best.forces[0, count:], tight[count:], strict=True):
        if gives:
            run.mode = freed(run, one.dof, one.torque(force))
            run.opened.add(("joint", one.dof))
    for i, force, gives in zip(share.contacts, best.forces[0], tight, strict=False):
        if gives:
            opens = run.mode.contacts[i] != "rolling" or force[0] <= EMPTY * best.load
            run.mode = run.mode.with_contact(i, "free") if opens else sliding(run.mode, i, force)
            run.opened.add(("contact" if opens else "roll", i))
    run.resolve_mode(before)


def _fire(n: int, run: RunState) -> None:
    """A trigger whose value has passed 0."""
    key, (place, trigger) = ("trigger", n), run.system.triggers[n]
    side = run.sides.get(key, 1.0)
    run.sides[key] = -side
    if place < 0:  # a limit of effort: the loads have the same value on both sides
        run.note(trigger.kind, trigger.name, "reached" if side > 0 else "left")
        return
    if trigger.direction == side:
        return
    before = run.mode
    _act(run, n, -int(side))
    if trigger.changes:
        run.resolve_mode(before)


def _act(run: RunState, n: int, direction: int = 0) -> None:
    """Do what a trigger does, but for choosing a consistent mode. direction: in which its value has passed 0."""
    place, trigger = run.system.triggers[n]
    catch = trigger.catch
    if catch is not None:
        v = float(run.x[run.system.nq + catch.dof])
        if abs(v) <= catch.speed:
            run.x[catch.entry] = catch.position
            run.apply_impact(catch_touch(run.system, catch, v), trigger.kind)
        return
    before = run.stored_energy() if trigger.changes else 0.0
    if trigger.begins:
        run.mode = replace(run.mode, waiting=run.mode.waiting - {place})
        _begin_states(run, place)
    if trigger.drops:
        run.mode = replace(run.mode, dropped=run.mode.dropped | {place})  # a payload takes its energy along
    run.ended |= trigger.ends
    if trigger.state is not None:
        nq, v_rows = run.system.nq, run.system.whole.space.v_rows
        changed = trigger.state(run.x[:nq].copy(), run.x[v_rows].copy())
        run.x[: v_rows.stop] = _checked(changed, nq, run.system.robot.nv, trigger.name)
        if run.system.whole.constraints is not None:
            run.x = _closed(run, trigger.name)
        run.sides.pop(("trigger", n), None)  # its value may be on any side then
        run.fired.clear()
        run.require_room(f"`then` of {trigger.name!r}")
    energy = before - run.stored_energy() if trigger.changes else 0.0
    run.note(trigger.kind, trigger.name, energy=energy, effect=place, direction=direction)


def _closed(run: RunState, name: str) -> Array:
    """The state after a change, with the impulse by which loops answer a kick. Raises SceneError for open loops."""
    free = replace(run.mode.with_contacts((), len(run.mode.contacts)), locked=frozenset())
    closed, nq = run.in_mode(free).closed(), run.system.nq
    opened = float(np.abs(closed[:nq] - run.x[:nq]).max(initial=0.0))
    if opened > NEAR:
        raise SceneError(f"`then` of {name!r} opens the loops: q is {opened:.3g} off", where="effects",
                         remedy="change v alone, or q along what they allow", code="loops-open")  # fmt: skip
    return closed


def _begin_states(run: RunState, place: int) -> None:
    """Give the states of an effect that begins to act what they begin with: a motor moves as its joint does then."""
    space, motion = run.system.whole.space, run.motion(run.evaluate())
    for name, value in run.system.switching.effects[place].acting()[0].states(motion).items():
        run.x[space.z_rows.start + space.states.index(name)] = np.asarray(value).item()


def _checked(changed: Any, nq: int, nv: int, name: str) -> Array:
    """The state that a trigger's change gives. Raises SceneError."""
    try:
        q, v = (np.asarray(part, dtype=float) for part in changed)
        x = np.concatenate([q, v])
        fits = q.shape == (nq,) and v.shape == (nv,) and bool(np.isfinite(x).all())
    except (TypeError, ValueError):
        fits = False
    if not fits:
        raise SceneError(f"`then` of {name!r} gave no state", where="effects", code="no-state",
                         remedy=f"return (q, v) of sizes {nq} and {nv}")  # fmt: skip
    return x
