"""What a figure draws of a run: between few samples the solution itself."""

from collections.abc import Callable, Sequence

import numpy as np

from twolink.dynamics import Robot
from twolink.errors import AccuracyError
from twolink.simulation.trajectory_tables import Samples

SMOOTH = 400  # times that make a smooth curve
Curves = tuple[np.ndarray, np.ndarray, np.ndarray]
At = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


def drawn_curves(
    samples: Samples, at: At | None, robots: Sequence[tuple[Robot, int]]
) -> tuple[Curves, tuple[np.ndarray, np.ndarray]]:
    """(t, q, v), and times with energies.

    at: the solution (q, v) at times, if it is kept. robots: those of the samples, in order; where they change, the
    energies are those at the samples.
    """
    t, q, v = _states(samples, at)
    if t is samples.t or len(robots) > 1:
        return (t, q, v), (samples.t, samples.energy)
    robot = robots[0][0] if robots else samples.robot
    return (t, q, v), (t, np.sum(robot.energy(q, v), axis=0))


def _states(samples: Samples, at: At | None) -> Curves:
    own = samples.t, samples.q, samples.v
    if at is None or len(samples.t) >= SMOOTH:
        return own
    times = np.union1d(samples.t, np.linspace(samples.t[0], samples.t[-1], SMOOTH))
    try:
        return times, *at(times)
    except AccuracyError:
        return own
