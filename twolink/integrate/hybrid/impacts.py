"""Impacts: velocities after stops and contacts are hit, by Newton's restitution and Coulomb's friction.

    M (v+ - v-) = J^T p + G^T r,   G v+ = 0
    normal:   p_n >= 0,  v_n+ >= -e v_n-,  one of them equal
    tangent:  |p_t| <= mu p_n,  against the sliding that is left, which is none below that

J: rows of all that touches, at rest or hit. G: rows of loops. This is the contact problem with velocities in place of
accelerations. Contacts that reflect are solved in rounds, each of what still approaches (Smith et al. 2012).

What bounces lower than a run resolves comes to rest at once, all of it together.

    v+ = v - W B (J W B)^+ J v,   so that J v+ = 0

J: rows of what rests, B: the forces there, with the friction of contacts that slide. A stop or contact that parts with
a speed u comes back if it presses with a force p where all that rests stays: it is accelerated back by g = p J W J^T,
from a height u^2 / (2 g). Bounces with restitution e end after 2 u / (g (1 - e)) seconds.
"""

import functools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from twolink.effects.switching import Catch, Stop
from twolink.errors import AccuracyError
from twolink.integrate.hybrid.consistency import NEAR, ModeProblem, different, still_speed
from twolink.integrate.hybrid.contact_problem import (
    Rows,
    contact_rows,
    inverse_under,
    loop_rows,
    mass_matrix,
    solve_contacts,
)
from twolink.integrate.hybrid.least_bounce import LeastBounce
from twolink.integrate.hybrid.modes import ModeState, System
from twolink.integrate.motion.state import Array

ROUNDS = 1000  # of reflections


@dataclass(frozen=True)
class Touch:
    """A touch in an impact. rows: of its velocity, the normal one, with friction two tangential ones (1 or 3, nv).

    contact: its number; None for a stop. unit: of the velocity. reflects: in rounds. threshold: the speed of approach
    up to which it does not bounce.
    """

    name: str
    rows: Array
    restitution: float
    friction: float
    unit: str
    contact: int | None = None
    reflects: bool = False
    threshold: float = 0.0

    def rebound(self, v: Array) -> float:
        """The least speed of parting after an impact with velocities v."""
        speed = -float(self.rows[0] @ v)
        return self.restitution * speed if speed > self.threshold else 0.0


@dataclass(frozen=True)
class Impact:
    """The effect of an impact on one touch: its speed of approach, the energy lost, J, and the impulse (1 or 3,), N s.

    was_hit: whether it approached, else it only passed the impact on.
    """

    touch: Touch
    speed: float
    energy: float
    impulse: Array
    was_hit: bool


def stop_touch(system: System, stop: Stop) -> Touch:
    """A stop that is hit."""
    return Touch(stop.name, _unit_row(system, stop.dof, stop.side), stop.restitution, 0.0, stop.unit)


def catch_touch(system: System, catch: Catch, v: float) -> Touch:
    """A catch, which stops a joint like a stop without restitution in the way of its velocity v."""
    row = _unit_row(system, catch.dof, -math.copysign(1.0, v))
    return Touch(system.names[catch.dof], row, 0.0, 0.0, catch.unit)


def contact_touch(state: ModeState, i: int) -> Touch:
    """A contact that is hit or closed."""
    contact, rows = state.system.contacts[i], contact_rows(state, i)
    return Touch(contact.name, rows if contact.friction else rows[:1], contact.restitution, contact.friction, "m/s",
                 i, contact.reflects, contact.threshold)  # fmt: skip


def collide(state: ModeState, hit: Touch) -> tuple[Array, list[Impact]] | None:
    """Velocities after an impact, and what it did to each thing that touches; None where it would only graze."""
    v, still = state.v, still_speed(state.v)
    touches = [hit, *_others(state, hit)]
    approach = np.array([-float(touch.rows[0] @ v) for touch in touches])
    if not approach[0] > 0.0:
        return None
    mass, fixed = mass_matrix(state), loop_rows(state)
    solve = after
    if any(touch.reflects for touch in touches):
        solve = functools.partial(_reflected, still=still)
    else:
        touches = [touch if speed > still else replace(touch, restitution=0.0)
                   for touch, speed in zip(touches, approach, strict=True)]  # fmt: skip
    new, impulses = solve(mass, v, touches, fixed)
    were_hit = approach > still
    were_hit[0] = True
    energy = (kinetic_energy(mass, v) - kinetic_energy(mass, new)) / were_hit.sum()  # shares are not determined
    return new, [Impact(touch, float(speed), energy, p, bool(hit))
                 for touch, speed, p, hit in zip(touches, approach, impulses, were_hit, strict=True)]  # fmt: skip


def whole(impacts: Sequence[Impact]) -> list[Impact]:
    """One impact for each pair of bodies: the fastest of those of its points, with the energy of all."""
    pairs: dict[tuple[str, bool], Impact] = {}
    for impact in impacts:
        key = impact.touch.name, impact.touch.contact is None
        before = pairs.get(key, impact)
        energy = impact.energy + (before.energy if key in pairs else 0.0)
        fastest = impact if impact.speed > before.speed else before
        pairs[key] = replace(fastest, energy=energy)
    return list(pairs.values())


def onto_contact(state: ModeState, i: int) -> Array:
    """q moved by the rounding that contact i's gap is off 0, in the direction of least kinetic energy."""
    gap, row = float(state.evaluate().contacts[i, 0, 0]), contact_touch(state, i).rows[0]
    direction = np.linalg.solve(mass_matrix(state), row)
    q = state.x[: state.system.nq]
    return np.asarray(pin.integrate(state.system.robot.model, q, -gap / float(row @ direction) * direction))


def _unit_row(system: System, dof: int, side: float) -> Array:
    row = np.zeros((1, system.robot.nv))
    row[0, dof] = side
    return row


def _others(state: ModeState, hit: Touch) -> list[Touch]:
    """Touches besides the one that is hit: stops at which joints are, and contacts without a gap."""
    system = state.system
    touches = [stop_touch(system, stop) for stop in system.stops if state.x[stop.entry] == stop.position]
    touches = [touch for touch in touches if (touch.name, touch.rows.tolist()) != (hit.name, hit.rows.tolist())]
    gaps = state.evaluate().contacts[:, 0, 0] if system.contacts else ()
    return touches + [contact_touch(state, i) for i, kind in enumerate(state.mode.contacts)
                      if i != hit.contact and (kind != "free" or gaps[i] <= NEAR)]  # fmt: skip


def after(mass: Array, v: Array, touches: Sequence[Touch], fixed: Array) -> tuple[Array, list[Array]]:
    """v+ after the impulses of all that touches, and the impulses along their rows. fixed (m, nv): rows of loops.

    Raises AccuracyError where the laws would create energy, or are not fulfilled by any impulses.
    """
    inverse = inverse_under(mass, fixed)
    wanted = [touch.rebound(v) for touch in touches]
    rows = [Rows(touch.rows, np.array([-speed, 0.0, 0.0])[: len(touch.rows)], touch.friction, touch.friction, None)
            for touch, speed in zip(touches, wanted, strict=True)]  # fmt: skip
    outcome = solve_contacts(v, inverse, rows)
    if outcome is None:
        raise AccuracyError(f"no impulses were found that fulfil the laws of impact and friction of {touches[0].name}",
                            where="effects", remedy="less friction, or no restitution",
                            code="no-impact")  # fmt: skip
    new = outcome.a
    if kinetic_energy(mass, new) > kinetic_energy(mass, v) * (1.0 + 1e-9) + 1e-300:
        raise AccuracyError(f"the impact of {touches[0].name} would create energy under its laws of restitution and "
                            "friction", where="effects", remedy="less restitution or friction",
                            code="no-impact")  # fmt: skip
    closed = [touch for touch, least in zip(touches, wanted, strict=True)
              if float(touch.rows[0] @ new) - least <= still_speed(v)]  # fmt: skip
    _require_determined(closed, new, inverse)
    return new, outcome.forces


def _require_determined(touches: Sequence[Touch], new: Array, inverse: Array) -> None:
    """Raise AccuracyError if v+ depends on how the impulses of touches are shared, as friction with several slips does.

    A share may change along impulses that leave the normal velocities, and those of what sticks, as they are.
    """
    if len(touches) < 3:
        return
    kept, columns, slips = [], [], []
    for touch in touches:
        slip = touch.rows[1:] @ new
        speed = math.hypot(*slip)
        if speed <= still_speed(new):
            kept.append(touch.rows)
            columns.append(touch.rows)
            continue
        kept.append(touch.rows[:1])
        columns.append(touch.rows[:1] - touch.friction * (slip / speed) @ touch.rows[1:])
        slips.append(slip)
    if not slips:
        return
    least = different(new, np.array(slips))
    e, axes = np.linalg.eigh(inverse)
    root = axes * np.sqrt(np.maximum(e, 0.0))  # forces by the velocities that they give
    ranks = []
    for rows in (kept, columns):
        sizes = np.linalg.svd(np.concatenate(rows) @ root, compute_uv=False)
        ranks.append(int((sizes > least * sizes[0]).sum()))
    if ranks[1] > ranks[0]:
        raise AccuracyError(f"{touches[0].name} slide at an impact on more points than determine their impulses, and "
                            "the velocities after it depend on the share of each", where="effects",
                            remedy="let them touch at three points",
                            code="indeterminate-forces")  # fmt: skip


def _reflected(
    mass: Array, v: Array, touches: Sequence[Touch], fixed: Array, *, still: float
) -> tuple[Array, list[Array]]:
    """As `after`, by rounds, each of the impulses of what approaches; without restitution where that has no end."""
    total = [np.zeros(len(touch.rows)) for touch in touches]
    for _ in range(ROUNDS):
        hit = [k for k, touch in enumerate(touches) if float(touch.rows[0] @ v) < -still]
        if not hit:
            return v, total
        v, impulses = after(mass, v, [touches[k] for k in hit], fixed)
        for k, p in zip(hit, impulses, strict=True):
            total[k] += p
    v, impulses = after(mass, v, [replace(touch, restitution=0.0) for touch in touches], fixed)
    return v, [before + p for before, p in zip(total, impulses, strict=True)]


def kinetic_energy(mass: Array, v: Array) -> float:
    """v M v / 2, J."""
    return 0.5 * float(v.dot(mass.dot(v)))


STRONGEST = 1e4  # m/s^2 or rad/s^2: bounces that come back faster are followed
RESOLVED = 2e-14  # relative to positions: the height of bounces that numbers resolve


@dataclass(frozen=True)
class Bounce:
    """A touch that parts with a speed. contact: True of a contact, else a stop; number: its own, or the joint's."""

    name: str
    contact: bool
    number: int
    speed: float
    restitution: float


def brought_to_rest(state: ModeState, least: LeastBounce) -> tuple[Array, list[tuple[str, float]], float] | None:
    """The velocities without bounces too low to follow, each one's name and seconds until it ends, and the loss, J.

    None where there are no such bounces.
    """
    seen = resolved(state)
    parting = [(one, 2.0 * least.of(one.restitution, seen)) for one in _parting(state)]
    parting = [(one, low) for one, low in parting if one.speed**2 <= STRONGEST * low]
    if not parting:
        return None
    still, problem = still_speed(state.v), ModeProblem(state, still_speed(state.v))
    resting = {k for k in state.system.lockable if abs(state.v[k]) <= still and state.system.locks(k, state.x)}
    rows = state.evaluate().contacts[:, :2, 0] if state.system.contacts else np.empty((0, 2))
    touching = {i for i, (gap, rate) in enumerate(rows) if gap <= NEAR and abs(rate) <= still}
    while parting:
        contacts = sorted(touching | {one.number for one, _ in parting if one.contact})
        joints = sorted(resting | {one.number for one, _ in parting if not one.contact})
        # Of a state without rates: those that part have accelerations v^2 / r, which no force ends.
        x = state.x.copy()
        x[state.system.whole.space.v_rows] = problem.without_rates(contacts, joints)
        at_rest = ModeProblem(state.in_mode(state.mode, x), still)
        solved = at_rest.solved(contacts, joints, {i for i in contacts if at_rest.slip(i) is None})
        if solved is None:
            return None
        forces = {(True, i): force[0] for i, force in zip(contacts, solved.forces, strict=False)}
        forces |= {(False, k): abs(force[0]) for k, force in zip(joints, solved.forces[len(contacts) :], strict=True)}
        back = [forces[one.contact, one.number] * problem.gain(one.contact, one.number) for one, _ in parting]
        rests = [g > 0.0 and one.speed**2 <= g * low for (one, low), g in zip(parting, back, strict=True)]
        if all(rests):
            break
        parting = [one for one, stays in zip(parting, rests, strict=True) if stays]
    else:
        return None
    pressing = [i for i, rates in zip(contacts, solved.rates, strict=False) if not rates[0] > 0.0]
    held = [k for k, rates in zip(joints, solved.rates[len(contacts) :], strict=True) if not rates[0]]
    new = problem.without_rates(pressing, held)
    ends = [(one.name, 2.0 * one.speed / (g * (1.0 - one.restitution)) if 0.0 < one.restitution < 1.0 else 0.0)
            for (one, _), g in zip(parting, back, strict=True)]  # fmt: skip
    return new, ends, kinetic_energy(problem.mass, state.v) - kinetic_energy(problem.mass, new)


def resolved(state: ModeState) -> float:
    """The height of bounces that numbers resolve, m or rad."""
    return RESOLVED * (1.0 + float(np.abs(state.x[: state.system.nq]).max(initial=0.0)))


def _parting(state: ModeState) -> Iterator[Bounce]:
    """Contacts and stops that touch and part."""
    still = still_speed(state.v)
    for stop in state.system.stops:
        rate = stop.side * float(state.v[stop.dof])
        if state.x[stop.entry] == stop.position and rate > still:
            yield Bounce(stop.name, False, stop.dof, rate, stop.restitution)
    rows = state.evaluate().contacts[:, :2, 0] if state.system.contacts else ()
    for i, (gap, rate) in enumerate(rows):
        if gap <= NEAR and rate > still:
            contact = state.system.contacts[i]
            yield Bounce(contact.name, True, i, float(rate), contact.restitution)
