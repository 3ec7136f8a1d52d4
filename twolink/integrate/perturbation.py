"""Perturbation: how the second solution behind an error bar differs from the plain one.

The distance of two solutions measures their error only if their errors differ. The second one starts some roundings
away, since the motion amplifies that shift as it amplifies the roundings on the way. It takes other steps where both
solutions would take the longest allowed ones. It counts a near miss of a stop or a plane as a touch, which the plain
one does not.
"""

from dataclasses import dataclass, replace

import numpy as np

from twolink.integrate.state import Array

MIN_STEPS = 16.0  # of an adaptive method in a run: within one step that is too long, an instability is not seen
START_SHIFT = 2e-15  # relative: about what the roundings on the way change
STEPS_RATIO = 2.6  # no whole number: at a whole ratio, the ends of the longest steps would coincide


@dataclass(frozen=True)
class Perturbation:
    """What differs from the plain solution; by default nothing.

    Parameters
    ----------
    start_shift : float
        Change of the initial state, relative to max(1, |x|).
    touch_margin : float
        A guard of a stop or a plane that comes as near to 0 as this counts as 0, m or rad.
    min_steps : float
        The smallest number of steps of an adaptive method.
    """

    start_shift: float = 0.0
    touch_margin: float = 0.0
    min_steps: float = MIN_STEPS

    @property
    def opposite(self) -> "Perturbation":
        """The same with the initial state changed in the opposite direction."""
        return replace(self, start_shift=-self.start_shift)

    def shifted(self, x: Array) -> Array:
        """Initial states x (size,) or (size, n), each entry shifted; the signs alternate."""
        signs = np.where(np.arange(len(x)) % 2, -1.0, 1.0).reshape(-1, *[1] * (x.ndim - 1))
        return np.asarray(x + self.start_shift * signs * np.fmax(1.0, np.abs(x)))


NO_PERTURBATION = Perturbation()


def second_solution(touch_margin: float = 0.0) -> Perturbation:
    """The perturbation of the solution behind an error bar."""
    return Perturbation(START_SHIFT, touch_margin, STEPS_RATIO * MIN_STEPS)
