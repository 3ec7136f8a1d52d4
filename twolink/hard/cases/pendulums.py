"""Pendulums: rest by symmetry, chaos, unstable balance, and very long runs."""

from __future__ import annotations

import math

from twolink.dynamics import Robot, load_robot
from twolink.effects import Gravity
from twolink.hard import truths
from twolink.hard.case import Motion, Truth, at
from twolink.hard.high_precision import stored
from twolink.lagrange.pinocchio_arm import arm_urdf
from twolink.scenes import Scene, load_scene

G = 9.81
W0 = math.sqrt(G)


SWING = Truth(
    "closed form, theta = 2 asin(k sn(K - w0 t, k)), in 60 digits",
    truths.of_configuration(lambda t: truths.swing(math.pi / 2, W0)(t)[:, None] - math.pi / 2),
    doubt=1e-15,
)


def _rods() -> Scene:
    """Two equal rods, from the level, at rest; of 3 kg, so that m l^2 / 12 is a double exactly."""
    return Scene(_arm(3.0, 3.0), effects=[Gravity((0.0, 0.0, -G))], title="The chaotic double pendulum")


def _arm(m1: float, m2: float) -> Robot:
    return load_robot(arm_urdf(1.0, 1.0, m1, m2))


CASES = (
    Motion(
        name="symmetric-rest", group="pendulums",
        title="Let go from exact symmetric rest",
        why="Both rods are level and at rest: every other Taylor coefficient vanishes, so that an error estimate made "
            "of the last two of them is zero, and the step it allows is endless. A step of any method that looks at "
            "one coefficient only may be accepted unseen.",
        scene=lambda: load_scene("arm-swing"), duration=10.0,
        truth=Truth("hand-derived equations in 200 bits, at 10 times",
                    truths.of_configuration(truths.at_known_times(*stored("arm-swing"))), doubt=1e-15),
        settings=at(1e-3, 1e-6, 1e-9),
    ),
    Motion(
        name="chaos", group="pendulums",
        title="The chaotic double pendulum, 10 s",
        why="Errors grow about 10^5-fold in 10 s. A tolerance for each step says nothing about the end.",
        scene=_rods, duration=10.0,
        truth=Truth("hand-derived equations in 200 bits, every 0.5 s",
                    truths.of_configuration(truths.at_known_times(*stored("chaos"))), doubt=1e-15),
        settings=at(1e-3, 1e-6, 1e-9),
    ),
    Motion(
        name="chaos-30s", group="pendulums",
        title="The chaotic double pendulum, 30 s: beyond double precision",
        why="Errors grow about 10^15-fold in 30 s: double precision has nothing left at the end. The right answer is "
            "'kept up to t = ...'.",
        scene=_rods, duration=30.0,
        truth=Truth("hand-derived equations in 200 bits, every 0.5 s",
                    truths.of_configuration(truths.at_known_times(*stored("chaos"))), doubt=1e-15),
        settings=at(1e-3, 1e-6, 1e-9), may_refuse=1e-3,
    ),
    Motion(
        name="chaos-30s-quad", group="pendulums", slow=True,
        title="The chaotic double pendulum, 30 s, in quadruple precision",
        why="Of 33 digits the motion leaves 18: enough, at a price.",
        scene=_rods, duration=30.0,
        truth=Truth("hand-derived equations in 200 bits, every 0.5 s",
                    truths.of_configuration(truths.at_known_times(*stored("chaos"))), doubt=1e-15),
        settings=at(1e-6, 1e-9, 1e-12, precision="quad"), peers=(),
    ),
    Motion(
        name="upright-balance", group="pendulums",
        title="A pendulum 1e-12 rad from upright",
        why="It falls after 9 s, and when it does is in the twelfth decimal of the start. An absolute tolerance of "
            "1e-6 is a million times the start itself: whoever rounds it away lets it stand, or fall elsewhere.",
        scene="upright",
        truth=Truth("closed form (Jacobi's sn, modulus 1 - 2.5e-25) in 60 digits",
                    truths.of_configuration(lambda t: truths.toppling(1e-12, W0)(t)[:, None]), doubt=1e-14),
        settings=(*at(1e-1, 1e-6), *at(1e-9, precision="quad")), may_refuse=1e-1,
    ),
    Motion(
        name="pendulum-1000s", group="pendulums",
        title="IFToMM A01's pendulum for 1,000 s",
        why="422 periods: what a step loses in energy or phase adds up, and the phase is lost long before the energy "
            "looks wrong.",
        scene="pendulum", duration=1000.0, samples=2.0, truth=SWING, settings=at(1e-3, 1e-6, 1e-9),
    ),
    Motion(
        name="pendulum-100000s", group="pendulums", slow=True,
        title="IFToMM A01's pendulum for 100,000 s: a day and a million steps",
        why="42,000 periods and about 10^6 steps: rounding itself adds up.",
        scene="pendulum", duration=100_000.0, samples=0.02, truth=SWING, settings=at(1e-3, 1e-6, 1e-8),
        may_refuse=1e-8, peers=(),
    ),
    Motion(
        name="million-steps", group="pendulums", slow=True,
        title="A million steps of one size, and no drift of energy",
        why="A symmetric method keeps the energy in the long run only if its steps are solved to rounding, and "
            "rounding is not biased.",
        scene="pendulum", duration=10_000.0, samples=0.2,
        truth=Truth("energy is kept: |E - E(0)| over m g l", truths.of_energy(G), "relative energy drift", exact=False,
                    bar=lambda _: 1e-9),
        settings=at(1e-9, method="suzuki4", step=0.01, verify=False),
        peers=(),
    ),
)  # fmt: skip
