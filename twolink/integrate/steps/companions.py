"""Solutions beside a run, which show its error."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from twolink.integrate.motion.state import Array
from twolink.integrate.steps.perturbation import Perturbation

SELDOM = 4  # of the times: at which all but one of few solutions that differ by rounding are looked at
OFTEN = 2  # solutions beside the run that are looked at at all times: the finer one, and one that differs by rounding


@dataclass(eq=False)
class Companions:
    """Solutions beside a run, as columns of one batch.

    perturbations: how each of the n differs from the run, the first by being finer, the others by rounding. t (m,): the
    times at which they are looked at. x (m, n, nq + nv): their states there, NaN where one did not get there, or was
    not looked at. stride: of the times at which those behind the first OFTEN are looked at: errors of a swing are large
    where it is fast, which looks in step with it may miss.
    """

    perturbations: tuple[Perturbation, ...]
    t: Array
    x: Array
    stride: int = SELDOM

    @property
    def seldom(self) -> slice:
        """Of the times t: those of the stride, with the last."""
        return slice((len(self.t) - 1) % self.stride, None, self.stride)

    def looks(self, worlds: Array, *, few: bool = False) -> Iterator[tuple[Array, slice]]:
        """The worlds of some, of which 0 is the run, that are looked at, and at which of the times.

        few: of the times are of interest, so that one look at all costs less than two.
        """
        every = ((worlds > 0, slice(None)),) if few or self.stride == 1 else (
            ((worlds > 0) & (worlds <= OFTEN), slice(None)), (worlds > OFTEN, self.seldom))  # fmt: skip
        return ((others, often) for others, often in every if others.any())

    @classmethod
    def of(cls, perturbations: tuple[Perturbation, ...], t: Array, start: Array, stride: int = SELDOM) -> "Companions":
        """Solutions that begin at a start (nq + nv,)."""
        x = np.full((len(t), len(perturbations), len(start)), np.nan)
        x[0] = start
        return cls(perturbations, t, x, stride)
