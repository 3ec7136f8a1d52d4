"""Solutions beside a run, which show its error."""

from dataclasses import dataclass

import numpy as np

from twolink.integrate.motion.state import Array
from twolink.integrate.steps.perturbation import Perturbation

SELDOM = 2


@dataclass(eq=False)
class Beside:
    """Solutions beside a run, as lanes of one batch.

    perturbations: how each of the n differs from the run, the first by being finer, the others by rounding. t (m,): the
    times at which they are looked at. x (m, n, nq + nv): their states there, NaN where one did not get there, or was
    not looked at: those that differ by rounding need be looked at `seldom`. now (nq + nv, n): where they are.
    """

    perturbations: tuple[Perturbation, ...]
    t: Array
    x: Array
    now: Array

    @property
    def seldom(self) -> slice:
        """Of the times t: every other one, with the last."""
        return slice((len(self.t) - 1) % SELDOM, None, SELDOM)

    @classmethod
    def of(cls, perturbations: tuple[Perturbation, ...], t: Array, start: Array) -> "Beside":
        """Solutions that begin at a start (nq + nv,)."""
        now = np.repeat(start[:, None], len(perturbations), axis=1)
        x = np.full((len(t), len(perturbations), len(start)), np.nan)
        x[0] = now.T
        return cls(perturbations, t, x, now)
