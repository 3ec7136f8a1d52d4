"""Transitions: what the zero of each guard does, and the guards of a mode with the transitions they cause."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from twolink.algorithms.namespaces import Numbers
from twolink.effects.switching import Stop, Trigger
from twolink.errors import SceneError
from twolink.integrate.formulas import motion_of
from twolink.integrate.hybrid.consistency import ALLOWED, freed, sliding
from twolink.integrate.hybrid.guard import Guard, Key
from twolink.integrate.hybrid.impacts import catch_touch, contact_touch, onto_contact, stop_touch
from twolink.integrate.hybrid.modes import ModeEquations
from twolink.integrate.hybrid.snapshot import Snapshot
from twolink.integrate.hybrid.state import RunState
from twolink.integrate.state import Array

AT_ZERO = 1e-13  # relative to the state: a guard that is so near to 0 at the start begins there
FORCE_AT_ZERO = 2 * ALLOWED  # relative to the loads
Value = Callable[[Snapshot], Any]


def guards_of(run: RunState, here: Snapshot) -> list[Guard]:
    """The guards of the mode of a run, from its state on, of which `here` is the snapshot."""
    system, mode = run.system, run.mode
    own = system.in_mode(mode, run.x)
    distance = AT_ZERO * (1.0 + float(np.abs(run.x).max(initial=0.0)))
    force = FORCE_AT_ZERO * own.largest_load(here)
    guards: list[Guard] = []

    def add(key: Key, value: Value, transition: Callable[[RunState], None], noise: float, **how: Any) -> None:
        guard = Guard(key, value, transition, run.t, **how)
        with np.errstate(all="ignore"):
            first = float(np.asarray(value(here)).reshape(-1)[0])
        guard.begin(first, noise, fired=key in run.fired)
        guards.append(guard)

    for i, k in enumerate(system.lockable):
        if k in mode.locked:
            least, greatest = system.torque_range(k, run.x)
            if math.isfinite(greatest):
                add(("above", k), partial(_below, i, greatest), partial(_free_joint, k, 1.0), force)
            if math.isfinite(least):
                add(("below", k), partial(_above, i, least), partial(_free_joint, k, -1.0), force)
        elif k in system.rubbing and mode.slip.get(k):
            add(("stick", k), partial(_speed, system.nq + k, mode.slip[k]), partial(_stick, k), distance, touching=True)
    for n, stop in enumerate(system.stops):
        if not (stop.dof in mode.locked and run.x[stop.entry] == stop.position):
            add(("stop", n), partial(_room, stop),
                partial(_hit_stop, n), distance, touching=True)  # fmt: skip
    for i, contact in enumerate(system.contacts):
        if mode.contacts[i] == "free":
            add(("impact", i), partial(_gap, i), partial(_hit_contact, i), distance, touching=True)
            continue
        add(("leave", i), partial(_normal_force, own, i), partial(_open, i), force)
        if mode.contacts[i] == "rolling":
            add(("slide", i), partial(_cone, own, i, contact.friction), partial(_slide, i), force)
        elif contact.friction:
            add(("roll", i), partial(_slip, i, mode.directions[i]), RunState.settle, distance)
    for n, (place, trigger) in enumerate(system.triggers):
        key = ("trigger", n)
        value = None if place in mode.dropped else _trigger_value(run, own, n)
        if value is not None and not _is_caught(run, trigger):
            add(key, value, partial(_fire, n), distance, side=run.sides.get(key))
    return guards


def fire_timed(run: RunState) -> None:
    """Cause what happens at the present time."""
    for n, (place, trigger) in enumerate(run.system.triggers):
        if trigger.at is not None and place not in run.mode.dropped and same_time(trigger.at, run.t):
            _act(run, n)


def same_time(a: float, b: float) -> bool:
    """Whether no step lies between two times."""
    return abs(a - b) <= 1e-13 * max(1.0, b)


def _below(i: int, greatest: float, s: Snapshot) -> Any:
    """How far the torque of a lock is below its largest, N m or N."""
    return greatest - s.locks[i]


def _above(i: int, least: float, s: Snapshot) -> Any:
    """How far the torque of a lock is above its smallest, N m or N."""
    return s.locks[i] - least


def _speed(row: int, slip: float, s: Snapshot) -> Any:
    """The speed of a joint in the direction of its slip."""
    return slip * s.x[row]


def _room(stop: Stop, s: Snapshot) -> Any:
    """How far a joint is from its stop, rad or m."""
    return stop.side * (s.x[stop.entry] - stop.position)


def _gap(i: int, s: Snapshot) -> Any:
    """The gap of a contact, m."""
    return s.contacts[i, 0]


def _normal_force(own: ModeEquations, i: int, s: Snapshot) -> Any:
    """The normal force of a closed contact, N."""
    return own.contact_forces(s, i)[0]


def _slip(i: int, direction: tuple[float, float], s: Snapshot) -> Any:
    """The speed of sliding in the direction in which it began, m/s."""
    return direction[0] * s.contacts[i, 2] + direction[1] * s.contacts[i, 3]


def _cone(own: ModeEquations, i: int, friction: float, s: Snapshot) -> Any:
    """What is left of the friction that can be had, N."""
    normal, first, second = own.contact_forces(s, i)
    return friction * normal - np.hypot(first, second)


def _trigger_value(run: RunState, own: ModeEquations, n: int) -> Value | None:
    """What passes 0 where a trigger fires; None for one at a time."""
    system, (_, trigger) = run.system, run.system.triggers[n]
    if trigger.condition is not None:
        row = [i for i, (_, other) in enumerate(system.triggers) if other.condition is not None].index(n)
        return lambda s: s.conditions[row]
    if (function := trigger.function) is not None:
        equations = own.equations
        return lambda s: function(motion_of(equations, equations.mechanism, s.t, s.x, Numbers))
    if trigger.at is None:  # a limit of effort
        row = n - len(system.switching.triggers)
        return lambda s: s.limits[row]
    return None


def _is_caught(run: RunState, trigger: Trigger) -> bool:
    """Whether the joint of a catch is held where that catches it."""
    catch = trigger.catch
    return catch is not None and catch.dof in run.mode.locked and run.x[catch.entry] == catch.position


def _free_joint(k: int, torque: float, run: RunState) -> None:
    before = run.mode
    run.mode = freed(run.system, run.mode, k, torque, run.x)
    run.opened.add(("joint", k))
    run.settle(before)


def _stick(k: int, run: RunState) -> None:
    run.x[run.system.nq + k] = 0.0
    run.opened.discard(("joint", k))
    run.settle()
    if k not in run.mode.locked:
        run.note("reverse", run.system.names[k])


def _hit_stop(n: int, run: RunState) -> None:
    stop = run.system.stops[n]
    run.x[stop.entry] = stop.position
    run.strike(stop_touch(run.system, stop))
    run.settle()


def _hit_contact(i: int, run: RunState) -> None:
    run.x[: run.system.nq] = onto_contact(run.system, run.mode, run.x, run.t, i)
    run.strike(contact_touch(run.system, run.mode, run.x, run.t, i))
    run.settle()


def _open(i: int, run: RunState) -> None:
    before = run.mode
    run.mode = run.mode.with_contact(i, "free")
    run.opened.add(("contact", i))
    run.settle(before)


def _slide(i: int, run: RunState) -> None:
    before, own = run.mode, run.system.in_mode(run.mode, run.x)
    forces = own.contact_forces(run.system.look(run.mode, run.x, run.t), i)[:, 0]
    run.mode = sliding(run.mode, i, forces)
    run.opened.add(("roll", i))
    run.settle(before)


def _fire(n: int, run: RunState) -> None:
    """A trigger whose value has passed 0."""
    key, (place, trigger) = ("trigger", n), run.system.triggers[n]
    side = run.sides.get(key, 1.0)
    run.sides[key] = -side
    if place < 0:  # a limit of effort: the loads have the same value on both sides
        run.note(trigger.kind, trigger.name, "reached" if side > 0 else "left")
        return
    before = run.mode
    _act(run, n)
    run.settle(before)


def _act(run: RunState, n: int) -> None:
    """What a trigger does, but for choosing a consistent mode."""
    place, trigger = run.system.triggers[n]
    catch = trigger.catch
    if catch is not None:
        v = float(run.x[run.system.nq + catch.dof])
        if abs(v) <= catch.speed:
            run.x[catch.entry] = catch.position
            run.strike(catch_touch(run.system, catch, v), trigger.kind)
        return
    energy = 0.0
    if trigger.drops:
        energy = run.stored_energy()
        run.mode = run.mode.without(place)
        energy -= run.stored_energy()  # a payload takes its own along
    run.note(trigger.kind, trigger.name, energy=energy)
    run.ended |= trigger.ends
    if trigger.state is not None:
        nq = run.system.nq
        given = trigger.state(run.x[:nq].copy(), run.x[nq:].copy())
        run.x = _checked(given, nq, len(run.x) - nq, trigger.name)
        run.sides.pop(("trigger", n), None)  # its value may be on any side then
        run.fired.clear()
        run.require_room(f"`then` of {trigger.name!r}")


def _checked(given: Any, nq: int, nv: int, name: str) -> Array:
    """The state that a trigger's change gives. Raises SceneError."""
    try:
        q, v = (np.asarray(part, dtype=float) for part in given)
        x = np.concatenate([q, v])
        fits = q.shape == (nq,) and v.shape == (nv,) and bool(np.isfinite(x).all())
    except (TypeError, ValueError):
        fits = False
    if not fits:
        raise SceneError(f"`then` of {name!r} gave no state", where="effects", code="no-state",
                         remedy=f"return (q, v) of sizes {nq} and {nv}")  # fmt: skip
    return x
