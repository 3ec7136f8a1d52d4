"""Closed loops: dead centres, bifurcations, redundant, nearly redundant and inconsistent ones."""

from __future__ import annotations

import functools
import math

import numpy as np

from twolink.dynamics import Robot, load_robot
from twolink.effects import Gravity, HingeLoop
from twolink.hard import truths
from twolink.hard.case import SCENES, Motion, Track, Truth, at
from twolink.scenes import Scene, load_scene

G = 9.81


def _parallel(t: np.ndarray, links: int) -> np.ndarray:
    """The angle of the upright links from the x axis: N four-bars move as one compound pendulum."""
    inertia, pull = (links + 1) / 3 + links, (links + 1) / 2 + links
    return np.asarray(math.pi / 2 - truths.whirl(1.0, math.sqrt(pull / inertia * G))(t))


def _two_bars(t: np.ndarray) -> np.ndarray:
    up = _parallel(t, 2)
    return np.stack([up, -up, up, -up, up], axis=1)


def _one_bar(t: np.ndarray) -> np.ndarray:
    up = _parallel(t, 1)
    return np.stack([up, -up, up], axis=1)


def _crank(robot: Robot, track: Track) -> np.ndarray:
    """The crank's angle at the three times that the quadrature gives."""
    known = truths.at_known_times([0.5, 1.0, 3.0], [[4.073130130354], [14.12789221775], [121.8862775082]])
    at_crank = next(j for j in robot.joints if j.name == "crank_joint").q.start
    return np.asarray(np.abs(track.q[:, at_crank] - known(track.t)[:, 0]))


def _tilted_hinge(tilt: float) -> Scene:
    """The single four-bar with a hinge, whose axis is tilted, in the place of a point: three redundant rows."""
    robot = load_robot(str(SCENES / "parallelogram.urdf"))
    loop = HingeLoop(a="coupler", b="right_link", axis_a=(0.0, 0.0, 1.0), axis_b=(tilt, 0.0, 1.0),
                     point_a=(1.0, 0.0, 0.0), point_b=(1.0, 0.0, 0.0))  # fmt: skip
    start, spin = [math.pi / 2, -math.pi / 2, math.pi / 2], [-1.0, 1.0, -1.0]
    return Scene(robot, start, spin, effects=[Gravity((0.0, -G, 0.0)), loop], duration=10.0)


FOUR_BAR = "closed form of the compound pendulum it is, in 60 digits"

CASES = (
    Motion(
        name="four-bar-singular", group="loops",
        title="IFToMM A02: two four-bars through the position where they could move in three ways",
        why="When the links are level the constraints lose rank for an instant: the multipliers are 0/0 there, and "
            "whoever steps near it comes out on another motion, or with another energy.",
        scene=lambda: load_scene("four-bar"), duration=10.0,
        truth=Truth(FOUR_BAR, truths.of_configuration(_two_bars), doubt=1e-12),
        settings=at(1e-3, 1e-5, 1e-7), may_refuse=1e-7,
    ),
    Motion(
        name="parallelogram", group="loops",
        title="A parallelogram through its bifurcation",
        why="Where all links are in one line it may go on as a parallelogram or as an anti-parallelogram; only its "
            "velocity says which.",
        scene="parallelogram", duration=10.0,
        truth=Truth(FOUR_BAR, truths.of_configuration(_one_bar), doubt=1e-12),
        settings=at(1e-3, 1e-5, 1e-7), may_refuse=1e-7,
    ),
    Motion(
        name="dead-centres", group="loops",
        title="A slider-crank through both dead centres, 38 times",
        why="At a dead centre the slider cannot move the crank: coordinates that start from the slider are singular.",
        scene=lambda: load_scene("crankshaft"), duration=3.0, samples=100.0,
        truth=Truth("exact integral I(theta) theta'^2 / 2 = M theta, by quadrature, at 3 times", _crank, doubt=1e-10),
        settings=at(1e-3, 1e-6, 1e-8),
    ),
    Motion(
        name="bricard", group="loops",
        title="IFToMM A04: Bricard's mechanism, redundant along its whole motion",
        why="Six hinges in a ring should not move at all, by counting; one constraint is redundant, everywhere, and a "
            "factorization without a look at ranks divides by rounding.",
        scene=lambda: load_scene("bricard"), duration=10.0,
        truth=Truth("energy is kept: |E - E(0)| over 25 J, half the largest kinetic energy", truths.of_energy(25.0),
                    "relative energy drift", exact=False, bar=lambda accuracy: 10 * accuracy),
        settings=at(1e-3, 1e-6, 1e-9),
    ),
    Motion(
        name="redundant-hinge", group="loops",
        title="A planar parallelogram closed by a hinge: three rows say nothing",
        why="A hinge has five rows, two of which a planar loop needs; the three others are zero, or the same.",
        scene=functools.partial(_tilted_hinge, 0.0), duration=10.0,
        truth=Truth(FOUR_BAR, truths.of_configuration(_one_bar), doubt=1e-12),
        settings=at(1e-3, 1e-5, 1e-7), may_refuse=1e-7,
    ),
    Motion(
        name="misaligned-hinge", group="loops",
        title="The same with a hinge's axis off by 1e-8 rad",
        why="Strictly it is jammed; built of metal it moves as if aligned. Either answer is right: the aligned motion "
            "to 1e-8, or a refusal with the residual; never a motion of its own.",
        scene=functools.partial(_tilted_hinge, 1e-8), duration=10.0,
        truth=Truth(FOUR_BAR + ", for the aligned hinge", truths.of_configuration(_one_bar), doubt=1e-7),
        settings=at(1e-3, 1e-5, 1e-6), may_refuse=1.0,
    ),
)  # fmt: skip
