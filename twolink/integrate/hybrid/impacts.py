"""Impacts: velocities after stops and contacts are hit, by Newton's restitution and Coulomb's friction.

    M (v+ - v-) = J^T p + G^T r,   G v+ = 0
    normal:   p_n >= 0,  v_n+ >= -e v_n-,  one of them equal
    tangent:  |p_t| <= mu p_n,  against the sliding that is left, which is none below that

J: rows of all that touches, at rest or hit. G: rows of loops. This is the contact problem with velocities in place of
accelerations. Contacts that reflect are solved in rounds, each of what still approaches (Smith et al. 2012).
"""

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from twolink.effects.switching import Catch, Stop
from twolink.errors import AccuracyError
from twolink.integrate.hybrid.consistency import NEAR, different, still_speed
from twolink.integrate.hybrid.contact_problem import Rows, solve_contacts
from twolink.integrate.hybrid.contact_rows import contact_rows, inverse_under, loop_rows, mass_matrix
from twolink.integrate.hybrid.modes import Situation, System
from twolink.integrate.state import Array

ROUNDS = 1000  # of reflections


@dataclass(frozen=True)
class Touch:
    """What touches. rows: of its velocity, the normal one, with friction two tangential ones (1 or 3, nv).

    contact: its number; None for a stop. unit: of the velocity. reflects: in rounds.
    """

    name: str
    rows: Array
    restitution: float
    friction: float
    unit: str
    contact: int | None = None
    reflects: bool = False


@dataclass(frozen=True)
class Impact:
    """What an impact did to one touch: its speed of approach and the energy lost, J."""

    touch: Touch
    speed: float
    energy: float


def stop_touch(system: System, stop: Stop) -> Touch:
    """A stop that is hit."""
    return Touch(stop.name, _unit_row(system, stop.dof, stop.side), stop.restitution, 0.0, stop.unit)


def catch_touch(system: System, catch: Catch, v: float) -> Touch:
    """A catch, which stops a joint like a stop without restitution in the way of its velocity v."""
    row = _unit_row(system, catch.dof, -math.copysign(1.0, v))
    return Touch(system.names[catch.dof], row, 0.0, 0.0, catch.unit)


def contact_touch(here: Situation, i: int) -> Touch:
    """A contact that is hit or closed."""
    contact, rows = here.system.contacts[i], contact_rows(here, i)
    return Touch(contact.name, rows if contact.friction else rows[:1], contact.restitution, contact.friction, "m/s",
                 i, contact.reflects)  # fmt: skip


def collide(here: Situation, hit: Touch) -> tuple[Array, list[Impact]] | None:
    """Velocities after an impact, and what it did to each thing that was hit; None where it would only graze."""
    v, still = here.v, still_speed(here.v)
    touches = [hit, *_others(here, hit)]
    approach = np.array([-float(touch.rows[0] @ v) for touch in touches])
    if not approach[0] > 0.0:
        return None
    mass, fixed = mass_matrix(here), loop_rows(here)
    solve = after
    if any(touch.reflects for touch in touches):
        solve = functools.partial(_reflected, still=still)
    else:
        touches = [touch if speed > still else replace(touch, restitution=0.0)
                   for touch, speed in zip(touches, approach, strict=True)]  # fmt: skip
    new = solve(mass, v, touches, fixed)
    were_hit = approach > still
    were_hit[0] = True
    energy = (kinetic_energy(mass, v) - kinetic_energy(mass, new)) / were_hit.sum()  # shares are not determined
    every = [Impact(touch, float(speed), energy) for touch, speed in zip(touches, approach, strict=True)]
    return new, [impact for impact, now in zip(every, were_hit, strict=True) if now]


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


def onto_contact(here: Situation, i: int) -> Array:
    """q moved by the rounding that contact i's gap is off 0, in the direction of least kinetic energy."""
    gap, row = float(here.look().contacts[i, 0, 0]), contact_touch(here, i).rows[0]
    direction = np.linalg.solve(mass_matrix(here), row)
    q = here.x[: here.system.nq]
    return np.asarray(pin.integrate(here.system.robot.model, q, -gap / float(row @ direction) * direction))


def _unit_row(system: System, dof: int, side: float) -> Array:
    row = np.zeros((1, system.robot.nv))
    row[0, dof] = side
    return row


def _others(here: Situation, hit: Touch) -> list[Touch]:
    """What touches besides what is hit: stops at which joints are, and contacts without a gap."""
    system = here.system
    touches = [stop_touch(system, stop) for stop in system.stops if here.x[stop.entry] == stop.position]
    touches = [touch for touch in touches if (touch.name, touch.rows.tolist()) != (hit.name, hit.rows.tolist())]
    gaps = here.look().contacts[:, 0, 0] if system.contacts else ()
    return touches + [contact_touch(here, i) for i, kind in enumerate(here.mode.contacts)
                      if i != hit.contact and (kind != "free" or gaps[i] <= NEAR)]  # fmt: skip


def after(mass: Array, v: Array, touches: Sequence[Touch], fixed: Array) -> Array:
    """v+ after the impulses of all that touches. fixed (m, nv): rows of loops.

    Raises AccuracyError where the laws would create energy, or are not fulfilled by any impulses.
    """
    inverse = inverse_under(mass, fixed)
    wanted = [max(0.0, -touch.restitution * float(touch.rows[0] @ v)) for touch in touches]
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
    return new


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


def _reflected(mass: Array, v: Array, touches: Sequence[Touch], fixed: Array, *, still: float) -> Array:
    """v+ after rounds, each of the impulses of what approaches; without restitution where that has no end."""
    for _ in range(ROUNDS):
        hit = [touch for touch in touches if float(touch.rows[0] @ v) < -still]
        if not hit:
            return v
        v = after(mass, v, hit, fixed)
    return after(mass, v, [replace(touch, restitution=0.0) for touch in touches], fixed)


def kinetic_energy(mass: Array, v: Array) -> float:
    """v M v / 2, J."""
    return 0.5 * float(v.dot(mass.dot(v)))
