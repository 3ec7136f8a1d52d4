"""Rest: what bounces lower than a run resolves comes to rest at once, all of it together.

    v+ = v - W B (J W B)^+ J v,   so that J v+ = 0

J: rows of what rests, B: the forces there, with the friction of contacts that slide. A stop or contact that parts with
a speed u comes back if it presses with a force p where all that rests is held: it is accelerated back by g = p J W J^T,
from a height u^2 / (2 g). Bounces with restitution e end after 2 u / (g (1 - e)) seconds.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from twolink.integrate.hybrid.consistency import NEAR, Problem, still_speed
from twolink.integrate.hybrid.impacts import kinetic_energy
from twolink.integrate.hybrid.modes import Situation
from twolink.integrate.state import Array

STRONGEST = 1e4  # m/s^2 or rad/s^2: bounces that come back faster are followed
RESOLVED = 4e-13  # relative to the state: lower bounces are not seen


@dataclass(frozen=True)
class Bounce:
    """What parts with a speed. contact: whether it is a contact, else a stop; number: its own, or the joint's."""

    name: str
    contact: bool
    number: int
    speed: float
    restitution: float


def brought_to_rest(here: Situation, small: float) -> tuple[Array, list[tuple[str, float]], float] | None:
    """The velocities without bounces lower than `small`, each one's name and seconds until it ends, and the loss, J.

    None where there are no such bounces.
    """
    seen = RESOLVED * (1.0 + float(np.abs(here.x).max()))
    low = max(small, seen)
    parting = list(_parting(here, math.sqrt(2.0 * STRONGEST * low)))
    if not parting:
        return None
    still, problem = still_speed(here.v), Problem(here, still_speed(here.v))
    resting = {k for k in here.system.lockable if abs(here.v[k]) <= still and here.system.holds(k, here.x)}
    rows = here.look().contacts[:, :2, 0] if here.system.contacts else np.empty((0, 2))
    touching = {i for i, (gap, rate) in enumerate(rows) if gap <= NEAR and abs(rate) <= still}
    while parting:
        contacts = sorted(touching | {one.number for one in parting if one.contact})
        joints = sorted(resting | {one.number for one in parting if not one.contact})
        solved = problem.solved(contacts, joints, {i for i in contacts if problem.slip(i) is None})
        if solved is None:
            return None
        forces = {(True, i): force[0] for i, force in zip(contacts, solved.forces, strict=False)}
        forces |= {(False, k): abs(force[0]) for k, force in zip(joints, solved.forces[len(contacts) :], strict=True)}
        back = [forces[one.contact, one.number] * problem.gain(one.contact, one.number) for one in parting]
        rests = [g > 0.0 and one.speed**2 <= 2.0 * g * (low if one.restitution < 1.0 else seen)
                 for one, g in zip(parting, back, strict=True)]  # fmt: skip
        if all(rests):
            break
        parting = [one for one, stays in zip(parting, rests, strict=True) if stays]
    else:
        return None
    pressing = [i for i, rates in zip(contacts, solved.rates, strict=False) if not rates[0] > 0.0]
    held = [k for k, rates in zip(joints, solved.rates[len(contacts) :], strict=True) if not rates[0]]
    new = problem.without_rates(pressing, held)
    ends = [(one.name, 2.0 * one.speed / (g * (1.0 - one.restitution)) if 0.0 < one.restitution < 1.0 else 0.0)
            for one, g in zip(parting, back, strict=True)]  # fmt: skip
    return new, ends, kinetic_energy(problem.mass, here.v) - kinetic_energy(problem.mass, new)


def _parting(here: Situation, fastest: float) -> Iterator[Bounce]:
    """What touches and parts, but not fast."""
    still = still_speed(here.v)
    for stop in here.system.stops:
        rate = stop.side * float(here.v[stop.dof])
        if here.x[stop.entry] == stop.position and still < rate <= fastest:
            yield Bounce(stop.name, False, stop.dof, rate, stop.restitution)
    rows = here.look().contacts[:, :2, 0] if here.system.contacts else ()
    for i, (gap, rate) in enumerate(rows):
        if gap <= NEAR and still < rate <= fastest:
            contact = here.system.contacts[i]
            yield Bounce(contact.name, True, i, float(rate), contact.restitution)
