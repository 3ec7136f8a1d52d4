"""Closed loops: dead centres, bifurcations, redundant and nearly redundant ones."""

import functools
import math

import numpy as np

from twolink.dynamics import Robot, load_robot
from twolink.effects import Gravity, HingeLoop
from twolink.hard import truths
from twolink.hard.case import FOLDER, ErrorFunction, StateHistory
from twolink.scenes import Scene

G = 9.81


def four_bars(number: int) -> ErrorFunction:
    """Four-bars in a row move as one compound pendulum; q alternates between the angle of a vertical link and minus it.

    The links are 1 m and 1 kg each: number + 1 vertical ones, `number` horizontal ones.
    """
    inertia, pull = (number + 1) / 3 + number, (number + 1) / 2 + number
    factors = [(-1.0) ** k for k in range(2 * number + 1)]
    return truths.configuration_error(truths.whirl(1.0, math.sqrt(pull / inertia * G), factors))


def _crank(robot: Robot, track: StateHistory) -> np.ndarray:
    """The error of the crank's angle at the three times that the quadrature gives."""
    exact = truths.at_table_times([0.5, 1.0, 3.0], [[4.073130130354], [14.12789221775], [121.8862775082]])
    crank = next(j for j in robot.joints if j.name == "crank_joint").q
    return np.asarray(np.abs(track.q[:, crank] - exact(track.t))[:, 0])


def _tilted_hinge(tilt: float) -> Scene:
    """The single four-bar, closed by a hinge with a tilted axis [rad] instead of a point: three redundant rows."""
    robot = load_robot(str(FOLDER / "parallelogram.urdf"))
    loop = HingeLoop(a="coupler", b="right_link", axis_a=(0.0, 0.0, 1.0), axis_b=(tilt, 0.0, 1.0),
                     point_a=(1.0, 0.0, 0.0), point_b=(1.0, 0.0, 0.0))  # fmt: skip
    start, spin = [math.pi / 2, -math.pi / 2, math.pi / 2], [-1.0, 1.0, -1.0]
    return Scene(robot, start, spin, effects=[Gravity((0.0, -G, 0.0)), loop], duration=10.0)


SCENES = {
    "redundant-hinge": functools.partial(_tilted_hinge, 0.0),
    "misaligned-hinge": functools.partial(_tilted_hinge, 1e-8),
}
ERRORS = {
    "four-bar-singular": four_bars(2),
    **dict.fromkeys(("parallelogram", "redundant-hinge", "misaligned-hinge"), four_bars(1)),
    "dead-centres": _crank,
    "bricard": truths.energy_error(25.0),
}
