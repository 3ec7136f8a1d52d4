"""Guard: a value that ends a mode where it passes 0."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from twolink.integrate.hybrid.snapshot import Snapshot
from twolink.integrate.state import Array

Key = tuple[str, int]


class Guard:
    """A value that has one sign while a mode lasts, with the transition that its zero causes.

    A guard may begin at 0, as the distance from a stop does after an impact, or the value that has just caused an
    event. That zero is no event. Then the value is nothing until it has been farther from 0 than `noise`, and from
    there on it is judged by value / (t - start), which is not 0 at the start.

    key: names the guard from piece to piece. value: of a snapshot, (n,); rate: its derivative, of a gap. side: the sign
    while the mode lasts; None where it is not known before the first look. touching: it is a distance or a speed, for
    which a near miss may count. is_force: it is a force or a torque.
    """

    def __init__(
        self,
        key: Key,
        value: Callable[[Snapshot], Any],
        transition: Callable[[Any], None],
        start: float,
        *,
        side: float | None = 1.0,
        touching: bool = False,
        is_force: bool = False,
        rate: Callable[[Snapshot], Any] | None = None,
    ) -> None:
        self.key, self.value, self.transition, self.start, self.rate = key, value, transition, start, rate
        self.side, self.touching, self.is_force = side, touching, is_force
        self.at_zero, self.noise, self.moved = False, 0.0, True

    def begin(self, first: float, noise: float, *, fired: bool) -> None:
        """Take the value at the start. noise: what counts as 0. fired: its zero has just caused an event."""
        self.at_zero = fired or abs(first) <= noise
        self.noise = max(noise, 2.0 * abs(first)) if fired else noise
        self.moved = not self.at_zero

    def observe(self, t: Array, raw: Array) -> Array:
        """Values at increasing times, above 0 while the mode lasts; infinite before it has moved away from 0."""
        quiet: Array | None = None
        if not self.moved:
            quiet = ~np.logical_or.accumulate((np.abs(raw) > self.noise) & (t > self.start))
            self.moved = not quiet.all()
        if self.side is None:
            seen = raw[np.isfinite(raw) & (raw != 0.0) & (True if quiet is None else ~quiet)]
            self.side = float(np.sign(seen[0])) if seen.size else None
        values = self.signed(t, raw)
        return values if quiet is None else np.where(quiet, math.inf, values)

    def signed(self, t: Array, raw: Array) -> Array:
        """Values above 0 while the mode lasts."""
        values = raw * (self.side or 1.0)
        if not self.at_zero:
            return values
        late = t > self.start
        return np.where(late, values / np.where(late, t - self.start, 1.0), math.inf)
