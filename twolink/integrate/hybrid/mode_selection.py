"""Deciding: which joints stick or rest, and which contacts press, slide or roll, so that the laws hold.

All that may be at rest is tried at rest. The force that breaks its law most is given up, one at a time, until none
does; what then would move the wrong way is tried at rest again.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from twolink.effects.conditions import unit
from twolink.errors import AccuracyError
from twolink.integrate.hybrid.modes import Hybrid, Modes
from twolink.integrate.hybrid.snapshot import Moment
from twolink.integrate.state import Array

TINY = 1e-11  # relative: velocities that are 0
ALLOWED = 1e-10  # relative: forces at the edge of a law
Key = tuple[str, int]  # ("joint", degree of freedom), ("contact", place), ("roll", place)
NEAR = 1e-9  # m: a contact that touches


def decide(hybrid: Hybrid, modes: Modes, x: Array, t: float, opened: frozenset[Key] = frozenset()) -> None:
    """Set the modes for the state x at time t; in x, set to 0 what is at rest.

    opened: what an event has just let go; it is not tried at rest again unless it would move the wrong way.
    """
    nq = hybrid.robot.nq
    still = TINY * (1.0 + float(np.abs(x[nq:]).max(initial=0.0)))
    _sort_joints(hybrid, modes, x, still, opened)
    _sort_contacts(hybrid, modes, x, t, still, opened)
    again: set[Key] = set(opened)
    for _ in range(20 + 6 * (len(hybrid.names) + len(hybrid.contacts))):
        _drop_redundant(hybrid, modes, x)
        found = _worst(hybrid, modes, x, t, again)
        if found is None:
            return
        again.add(found)
    raise AccuracyError("friction and contact allow no motion, or several: no consistent forces were found",
                        where=f"t = {t:.9g} s", remedy="less friction, or smooth friction")  # fmt: skip


def _sort_joints(hybrid: Hybrid, modes: Modes, x: Array, still: float, opened: frozenset[Key]) -> None:
    nq = hybrid.robot.nq
    modes.locked = set()
    for k in hybrid.lockable:
        v = x[nq + k]
        if abs(v) > still:
            if k in hybrid.friction:
                modes.slipping[k] = math.copysign(1.0, v)
            continue
        x[nq + k] = 0.0
        if ("joint", k) not in opened and (k in hybrid.friction or hybrid.standing(k, x)):
            modes.locked.add(k)


def _sort_contacts(hybrid: Hybrid, modes: Modes, x: Array, t: float, still: float, opened: frozenset[Key]) -> None:
    if not hybrid.contacts:
        return
    moment = Moment(hybrid.beginning(modes, x, t), np.array([t]), x[:, None])
    for i, contact in hybrid.contacts.items():
        gap = float(np.squeeze(contact.gap(moment.motion)))
        rate, slip = rates(hybrid, i, moment)
        near = NEAR if modes.contact[i] == "free" else 1e-6
        hits = rate < -still and modes.contact[i] == "free"  # an impact is to come
        if gap > near or rate > still or hits or ("contact", i) in opened:
            modes.contact[i] = "free"
            continue
        speed = math.hypot(*slip)
        if not contact.friction:
            modes.contact[i], modes.sliding[i] = "sliding", (0.0, 0.0)
        elif speed <= still and ("roll", i) not in opened:
            modes.contact[i] = "rolling"
        else:
            modes.contact[i] = "sliding"
            if speed > still:
                modes.sliding[i] = slip[0] / speed, slip[1] / speed


def rates(hybrid: Hybrid, i: int, moment: Moment) -> tuple[float, tuple[float, float]]:
    """The rate of contact i's gap, and its sliding velocity along the tangents, of one state."""
    contact = hybrid.contacts[i]
    slip = [float(np.squeeze(c)) for c in contact.slip(moment.motion)]
    normal, first, second = (sum(a * b for a, b in zip(axis, slip, strict=True))
                             for axis in (unit(contact.normal, "normal"), *contact.tangents()))  # fmt: skip
    return normal, (first, second)


def _drop_redundant(hybrid: Hybrid, modes: Modes, x: Array) -> None:
    """Unlock joints that loops hold already: their friction is not determined, and takes no part."""
    equations = hybrid.equations(modes, x)
    if equations.constraints is None or not modes.locked:
        return
    jacobian = equations.constraints.jacobian_at(x[: equations.space.nq], equations.constraints.kept)
    wanted = np.linalg.matrix_rank(jacobian, tol=1e-7)
    free = np.ones(jacobian.shape[1])
    for k in sorted(modes.locked):
        free[k] = 0.0
        if np.linalg.matrix_rank(jacobian * free, tol=1e-7) < wanted:
            free[k] = 1.0
            modes.locked.discard(k)
            modes.slipping[k] = 0.0


def _worst(hybrid: Hybrid, modes: Modes, x: Array, t: float, again: set[Key]) -> Key | None:
    """Give up what breaks its law most; returns it, or None if nothing does."""
    equations = hybrid.beginning(modes, x, t)
    moment = Moment(equations, np.array([t]), equations.start[:, None])
    a = moment.forces.a[:, 0]
    if not np.isfinite(a).all():
        raise AccuracyError("contact or friction allows no motion here: the forces are not determined, or friction "
                            "drives what it should stop (Painleve's paradox)", where=f"t = {t:.9g} s",
                            remedy="less friction, or smooth friction")  # fmt: skip
    scale = moment.largest_load
    breaches: list[tuple[float, Key]] = []
    held = {k: float(moment.held(k)[0]) for k in modes.locked}
    for k in modes.locked:
        least, most = hybrid.range(k, x)
        breaches.append((max(held[k] - most, least - held[k]) - ALLOWED * scale, ("joint", k)))
    pressing: dict[int, list[float]] = {}
    for i, mode in modes.contact.items():
        if mode == "free":
            continue
        rows = pressing[i] = [float(row[0]) for row in moment.multipliers[hybrid.touching(equations, i)]]
        breaches.append((-rows[0] - ALLOWED * scale, ("contact", i)))
        if mode == "rolling":
            mu = hybrid.contacts[i].friction
            breaches.append((math.hypot(*rows[1:]) - mu * rows[0] - ALLOWED * scale, ("roll", i)))
    # What pulls is let go before what rubs too much: where several press, who rubs how much is not determined.
    size, what = max(breaches, key=lambda breach: (breach[0] > 0.0 and breach[1][0] == "contact", breach),
                     default=(0.0, ("", 0)))  # fmt: skip
    if size > 0.0:
        kind, which = what
        if kind == "joint":
            unlock(hybrid, modes, which, held[which], x)
        elif kind == "contact":
            modes.contact[which] = "free"
        else:
            slide(modes, which, pressing[which])
        return what
    return _wrong_way(hybrid, modes, x, a, again, scale)


def unlock(hybrid: Hybrid, modes: Modes, k: int, held: float, x: Array) -> None:
    """Let a joint go that would take the torque `held` to hold: it slips where the load drives it."""
    modes.locked.discard(k)
    if k in hybrid.friction:
        modes.slipping[k] = 1.0 if held < hybrid.range(k, x)[0] or held < 0.0 else -1.0


def slide(modes: Modes, i: int, rows: Sequence[float]) -> None:
    """Let contact i slide, against the force that would hold it: rows are its multipliers."""
    size = math.hypot(*rows[1:])
    modes.contact[i], modes.sliding[i] = "sliding", (-rows[1] / size, -rows[2] / size)


def _wrong_way(hybrid: Hybrid, modes: Modes, x: Array, a: Array, again: set[Key], scale: float) -> Key | None:
    """Hold again what would start against its own slip or into its stop; None if nothing does."""
    nq = hybrid.robot.nq
    for k in hybrid.lockable:
        if k in modes.locked or x[nq + k] != 0.0 or ("held", k) in again:
            continue
        slip = modes.slipping.get(k, 0.0) if k in hybrid.friction else 0.0
        into = any(stop.side * a[k] < -ALLOWED * scale for stop in hybrid.standing(k, x))
        if slip * a[k] < -ALLOWED * scale or into:
            modes.locked.add(k)
            return ("held", k)
        if k in hybrid.friction and not slip and abs(a[k]) > ALLOWED * scale:  # loops held it, and do no more
            modes.slipping[k] = math.copysign(1.0, a[k])
            return ("held", k)
    return None
