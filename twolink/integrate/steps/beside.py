"""Solutions beside a run, which show its error."""

from dataclasses import dataclass

import numpy as np

from twolink.integrate.motion.state import Array
from twolink.integrate.steps.perturbation import Perturbation

SELDOM = 2  # of the times: at which solutions that differ by rounding are looked at


@dataclass(eq=False)
class Beside:
    """Solutions beside a run, as lanes of one batch.

    perturbations: how each of the n differs from the run, the first by being finer, the others by rounding. t (m,): the
    times at which they are looked at. x (m, n, nq + nv): their states there, NaN where one did not get there, or was
    not looked at. stride: of the times at which those behind the first are looked at.
    """

    perturbations: tuple[Perturbation, ...]
    t: Array
    x: Array
    stride: int = SELDOM

    @property
    def seldom(self) -> slice:
        """Of the times t: those of the stride, with the last."""
        return slice((len(self.t) - 1) % self.stride, None, self.stride)

    def within(self, begin: float, end: float) -> bool:
        """True if one of the times lies behind a begin and not behind an end, s."""
        first, after = self.t.searchsorted((begin, end), side="right").tolist()
        return bool(first < after)

    @classmethod
    def of(cls, perturbations: tuple[Perturbation, ...], t: Array, start: Array, stride: int = SELDOM) -> "Beside":
        """Solutions that begin at a start (nq + nv,)."""
        x = np.full((len(t), len(perturbations), len(start)), np.nan)
        x[0] = start
        return cls(perturbations, t, x, stride)
