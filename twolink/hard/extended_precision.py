"""References of a scene in numbers of more digits: Taylor series in extended precision, checked by a second one."""

import numpy as np

from twolink.hard.truths import distance
from twolink.integrate import taylor
from twolink.integrate.scene_equations import equations_of
from twolink.integrate.solution import Solution
from twolink.scenes import Scene

FINE, COARSE, QUAD = 1e-19, 1e-17, 1e-22  # tolerances of the reference and of its check


def extended_reference(scene: Scene, times: np.ndarray, *, quad: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Solve a smooth scene in numbers of 19 digits.

    Parameters
    ----------
    scene : Scene
        A scene without events.
    times : (n,) array
        Samples, s, from 0.
    quad : bool
        Check by quadruple precision, which compiles for up to a minute; else by another tolerance, and with it other
        orders and steps.

    Returns
    -------
    q : (n, nq) array of numpy.longdouble
        Configurations.
    error : (n,) array
        The reference's own error, rad or m: the distance from its check, the largest up to each sample.
    """
    equations, nq = equations_of(scene), scene.robot.nq
    best = _digits(taylor.solve(equations, times, FINE, precision="extended"))
    if quad:
        digits = _digits(taylor.solve(equations, times, QUAD, precision="quad"))
        leading = digits.astype(float)  # there is no cast from quadruple to extended: add what a double leaves
        second = leading.astype(np.longdouble) + (digits - leading.astype(digits.dtype)).astype(float)
    else:
        second = _digits(taylor.solve(equations, times, COARSE, precision="extended"))
    return best[:, :nq], np.maximum.accumulate(distance(scene.robot, best[:, :nq], second[:, :nq]))


def _digits(solution: Solution) -> np.ndarray:
    return np.asarray(solution.precise)
