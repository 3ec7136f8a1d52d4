"""Guarding: what may end the modes of a scene, and what is done then."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from twolink.algorithms.namespaces import Numbers
from twolink.integrate.hybrid.locating import Guard
from twolink.integrate.hybrid.mode_selection import ALLOWED, Key
from twolink.integrate.hybrid.modes import Hybrid, Modes, Stop
from twolink.integrate.hybrid.snapshot import Moment
from twolink.integrate.state import Array

FRESH = 1e-13  # relative to the state: a guard that is so near to 0 at the start begins there
FRESH_FORCE = 2 * ALLOWED  # relative to the loads


def guards(hybrid: Hybrid, modes: Modes, moment: Moment, sides: dict[Key, float]) -> list[Guard]:
    """The guards of these modes; `moment` is where they begin. sides: of what may pass 0 either way, kept here."""
    found: list[Guard] = []
    x = moment.x[:, 0]
    size = 1.0 + float(np.abs(x[: moment.equations.moving]).max(initial=0.0))

    def add(key: Key, value: Any, *, force: bool = False, side: float | None = 1.0) -> None:
        with np.errstate(all="ignore"):
            first = float(np.squeeze(value(moment)))
        near = FRESH_FORCE * moment.largest_load if force else FRESH * size
        found.append(Guard(key, value, side, fresh=abs(first) <= near, noise=near))

    for k in hybrid.lockable:
        if k in modes.locked:
            least, most = hybrid.range(k, x)
            if math.isfinite(most):
                add(("holds less", k), lambda m, k=k, most=most: most - m.held(k), force=True)
            if math.isfinite(least):
                add(("holds more", k), lambda m, k=k, least=least: m.held(k) - least, force=True)
        elif k in hybrid.friction and modes.slipping.get(k):
            add(("stick", k), lambda m, k=k, sign=modes.slipping[k]: sign * m.v[k])
    for n, stop in enumerate(hybrid.stops):
        if not (stop.dof in modes.locked and stop in hybrid.standing(stop.dof, x)):
            add(("stop", n), lambda m, s=stop: _room(s, m))
    for i, mode in modes.contact.items():
        contact = hybrid.contacts[i]
        if mode == "free":
            add(("impact", i), lambda m, c=contact: c.gap(m.motion))
            continue
        loop = hybrid.touching(moment.equations, i)
        add(("leave", i), lambda m, loop=loop: m.multipliers[loop][0], force=True)
        if mode == "rolling":
            add(("slide", i), lambda m, loop=loop, mu=contact.friction: _cone(m.multipliers[loop], mu), force=True)
        elif contact.friction:
            way = modes.sliding[i]
            add(("roll", i), lambda m, c=contact, way=way: _along(c, way, m))
    for i, release in hybrid.releases.items():
        if modes.held[i] and release.when is not None:
            add(("release", i), lambda m, r=release: r.distance(m.motion), side=sides.get(("release", i)))
    for i, watch in hybrid.watches.items():
        if watch.at is None:
            add(("watch", i), lambda m, w=watch: w.distance(m.motion), side=sides.get(("watch", i)))
    for n in range(len(moment.equations.effort_limits)):
        add(("limit", n), lambda m, n=n: m.forces.kinks[n], side=sides.get(("limit", n)))
    return found


def _room(stop: Stop, moment: Moment) -> Array:
    """How far the joint is from its stop, rad or m."""
    return np.asarray(stop.side * (moment.q[stop.entry] - stop.position))


def _cone(rows: list[Any], mu: float) -> Any:
    """What is left of the friction that can be had, N."""
    return mu * rows[0] - Numbers.sqrt(rows[1] * rows[1] + rows[2] * rows[2])


def _along(contact: Any, way: tuple[float, float], moment: Moment) -> Any:
    """The sliding velocity along the direction in which it began, m/s."""
    slip = contact.slip(moment.motion)
    return sum(d * sum(a * b for a, b in zip(tangent, slip, strict=True))
               for d, tangent in zip(way, contact.tangents(), strict=True))  # fmt: skip
