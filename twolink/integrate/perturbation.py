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
FARTHER = 8.0  # the second perturbation, which is used where rounding decides: it adds up along the way


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
        """The same with the initial state changed in the opposite direction, FARTHER times as much."""
        return replace(self, start_shift=-FARTHER * self.start_shift)

    def shifted(self, x: Array) -> Array:
        """Initial states x (size,) or (size, n), each entry shifted; the signs alternate."""
        shift = self.start_shift * np.fmax(1.0, np.abs(x))
        shift[1::2] *= -1.0
        return np.asarray(x + shift)


NO_PERTURBATION = Perturbation()


def second_solution(steps_ratio: float, touch_margin: float = 0.0) -> Perturbation:
    """The perturbation of the solution behind an error bar, with so many times as many of the longest steps."""
    return Perturbation(START_SHIFT, touch_margin, steps_ratio * MIN_STEPS)
