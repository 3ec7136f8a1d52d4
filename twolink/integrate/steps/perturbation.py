"""Solutions beside a run, and how they differ from it, so that their distance shows an error of the run.

Truncation and rounding are shown by different solutions, so that neither hides the other. A finer solution, which is
not disturbed, shows truncation. Solutions of the run's own setting, disturbed at every step by random numbers of the
size of rounding, show what the motion makes of rounding (Conrad et al., Stat. Comput. 27 (2017) 1065-1082).

In a sampled loop, where each solution calls the controllers, two finer ones whose disturbances mirror each other show
both: their middle is undisturbed but for terms of second order, and half their distance is what rounding makes.
"""

import functools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.state import Array
from twolink.integrate.steps.methods import Method
from twolink.native.stepper import Disturbances

LOOSE = 1e-7  # the tolerance of DOP853 below which its errors follow it
MIN_STEPS = 16.0  # of an adaptive method in a run
EPS = float(np.finfo(float).eps)
ROUNDING = 2 * EPS  # of each entry of a state, relative to its size, in each step
# Of each entry in each step on the mean, relative to it. Rounding is not all chance: energy drifts, in all solutions
# alike, and the phase of a swing by the square of its steps. Without it, bars of swings of 1e5 steps of DOP853 were up
# to 2.3 times too small; with it, 1.7 times the errors of 64 of them or more.
BIAS = 0.01 * EPS
SHARE = 0.1  # of the largest entry of q, or of v: the least size that counts, as forces of one joint act on others
WIDEST, LEAST_WIDE, WIDE_SHARE = 1e3, 100.0, 0.01  # times rounding, at most and at least; a part of the tolerance
PERIOD = 4096  # random numbers of an entry, then they repeat
APART = 613  # places between the random numbers of two solutions


@dataclass(frozen=True)
class Perturbation:
    """Differences of a second solution from the run; by default none.

    Parameters
    ----------
    finer : float
        By which the tolerance of an adaptive method, or the step of another one, is divided.
    rounding : float
        The largest disturbance of an entry of the state in a step, relative to its size.
    number : int
        Names the sequence of random numbers of the disturbances. Odd ones have the opposite bias.
    touch_margin : float
        A guard of a stop or a plane that comes as near to 0 as this counts as 0, m or rad.
    sign : float
        Of the disturbances: -1 mirrors those of another solution of the same number.
    restarts : bool
        Of SciPy's methods: begin anew where solutions are disturbed.
    embedded : bool
        Go on by the embedded formula of lower order, whose difference from the method's is the error estimate of steps.
    """

    finer: float = 1.0
    rounding: float = 0.0
    number: int = 0
    touch_margin: float = 0.0
    sign: float = 1.0
    restarts: bool = False
    embedded: bool = False

    def min_steps(self, method: Method) -> float:
        """The smallest number of steps in a run: a finer solution has as many more as by its tolerance."""
        return MIN_STEPS * (self.finer ** (1.0 / method.order) if method.adaptive else 1.0)


NO_PERTURBATION, RESTARTED = Perturbation(), Perturbation(restarts=True)


def finer_solution(method: Method, setting: float) -> Perturbation:
    """The perturbation of the solution that shows the truncation of a method at a setting.

    A 50th of the tolerance takes 1.6 times as many steps by DOP853; at low order that would take too many. Above LOOSE
    its errors do not follow the tolerance: a solution of 3.3e-5 and one of a 50th had the same error by chance. The
    order of Taylor's method rises by 4: one or two orders more may be no better.
    """
    if not method.adaptive:
        return Perturbation(finer=2.0)
    ratio = math.exp(8.0) if method.kind == "taylor" else max(50.0, setting / LOOSE) if method.order >= 8 else 30.0
    return Perturbation(finer=ratio, touch_margin=setting)


def disturbed_solutions(count: int, finer: float = 1.0) -> tuple[Perturbation, ...]:
    """The perturbations of solutions that show rounding, beside an undisturbed one that is as fine."""
    return tuple(Perturbation(finer, ROUNDING, i) for i in range(count))


def disturbed_finer(
    finer: Perturbation, tolerance: float, unit: float = EPS, widest: float = WIDEST
) -> tuple[Perturbation, float]:
    """A finer solution that shows both errors, and how many times as much as by rounding it is disturbed.

    The disturbances are far below its tolerance, so that its distance is one of truncation; what rounding makes is no
    more than that distance over their number. 0: none, as its tolerance is too near to the rounding of the numbers.

    Parameters
    ----------
    finer : Perturbation
        The finer solution.
    tolerance : float
        Of the run.
    unit : float
        The relative rounding of the numbers.
    widest : float
        The most of how many times.
    """
    wide = min(widest, WIDE_SHARE * tolerance / finer.finer / unit)
    return (replace(finer, rounding=wide * ROUNDING), wide) if wide >= LEAST_WIDE else (finer, 0.0)


@functools.lru_cache(64)
def _random(size: int) -> Array:
    """Random numbers (PERIOD, size) from -1 to 1, the same in every process."""
    return np.random.default_rng(size).uniform(-1.0, 1.0, (PERIOD, size))


@functools.lru_cache(64)
def _numbers(perturbations: tuple[Perturbation, ...]) -> tuple[Array, Array, Array]:
    """The places of the first random numbers of each, its rounding with its sign, and its bias."""
    rounding = np.array([one.sign * one.rounding for one in perturbations])
    numbers = np.array([one.number for one in perturbations], dtype=int)
    return APART * numbers, rounding, BIAS / ROUNDING * rounding * (1 - 2 * (numbers % 2))


def step_disturbances(
    perturbations: tuple[Perturbation, ...], state: Array, equations: Equations
) -> Disturbances | None:
    """Disturbances added to solutions before each attempt: r |x|, r random, and b x, b the bias.

    Parameters
    ----------
    perturbations : tuple of Perturbation
        Of the n solutions; or one, of all of them.
    state : ndarray (rows, n)
        Of the solutions: which joints are locked, and do not move.
    equations : Equations
        Of the states: which entries are of q and of v, and which never change, so that nothing is rounded.

    Returns
    -------
    Disturbances or None
        None where no solution is disturbed. How many steps a solution has attempted chooses its random numbers, so that
        these do not depend on what else is solved.
    """
    if not any(one.rounding or one.embedded for one in perturbations):
        return None
    space, count = equations.space, state.shape[1]
    first, rounding, bias = (np.repeat(a, count // len(a)) for a in _numbers(perturbations))
    moves = equations.layout.moves(state[equations.moving : space.size])
    moves[list(equations.steady)] = 0.0
    parts = (0, space.nq, space.v_rows.start, space.v_rows.stop)
    embedded = np.repeat([float(one.embedded) for one in perturbations], count // len(perturbations))
    return Disturbances(_random(equations.moving), rounding, bias, first, moves, parts, SHARE, embedded)


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
