"""Mass ratios, and units from micrometres to kilometres."""

from __future__ import annotations

import functools
import math

from twolink.dynamics import load_robot
from twolink.effects import Gravity
from twolink.hard import truths
from twolink.hard.case import Motion, Truth, at
from twolink.hard.high_precision import stored
from twolink.lagrange.pinocchio_arm import arm_urdf
from twolink.scenes import Scene


def _rods(m1: float, m2: float) -> Scene:
    return Scene(load_robot(arm_urdf(1.0, 1.0, m1, m2)), q=[0.3, -0.5], effects=[Gravity((0.0, 0.0, -9.81))])


def _ratio(name: str, title: str, why: str, masses: tuple[float, float]) -> Motion:
    return Motion(
        name=name, group="scales", title=title, why=why, scene=functools.partial(_rods, *masses), duration=5.0,
        truth=Truth("hand-derived equations in 200 bits, at 5 times",
                    truths.of_configuration(truths.at_known_times(*stored(name))), doubt=1e-15),
        settings=at(1e-3, 1e-6, 1e-9),
    )  # fmt: skip


MICRO_K, MICRO_M, MICRO_X = 1e-3, 1e-12, 1e-6
GEAR_K, GEAR_I, GEAR_J, GEAR_N = 1e-15, 1e-21, 4e-21, -2.0
GEAR_W = (GEAR_K / (GEAR_I + GEAR_N**2 * GEAR_J)) ** 0.5
CRANE_W0 = math.sqrt(9.81 / 1000.0)

CASES = (
    _ratio("light-tip", "A forearm of 1e-9 of the upper arm's mass", "The tip is thrown about by the arm, and has no "
           "say: the mass matrix has a condition of 10^9.", (1.0, 1e-9)),
    _ratio("heavy-tip", "A forearm of 1e9 times the upper arm's mass", "The upper arm's inertia vanishes beside what "
           "hangs on it. Solvers that share out impulses, or subtract, lose it.", (1e-9, 1.0)),
    Motion(
        name="micrometre-slider", group="scales",
        title="A slider of a nanogram on a spring, that moves by a micrometre",
        why="1e-12 kg, 1e-3 N/m, 1e-6 m: in SI units the whole motion lies below the absolute tolerances and least "
            "inertias that tools take for granted.",
        scene="micrometre-slider", duration=0.01, samples=5e4, size=MICRO_X,
        truth=Truth("closed form, x0 cos(w t)",
                    truths.of_configuration(truths.column(truths.oscillation(MICRO_X, (MICRO_K / MICRO_M) ** 0.5))),
                    quantity="error of q [m]", doubt=1e-21),
        settings=at(1e-8, 1e-10, 1e-12),
    ),
    Motion(
        name="micrometre-gears", group="scales",
        title="Two gears of 10 and 20 micrometres in mesh, on a torsion spring",
        why="Moments of inertia of 1e-21 kg m^2, below what MuJoCo takes at all, and a loop between them.",
        scene="micrometre-gears", duration=0.1, samples=5e3, size=0.1,
        truth=Truth("closed form: q1 = 0.1 cos(w t), q2 = -2 q1, w^2 = k / (I1 + 4 I2)",
                    truths.of_configuration(truths.column(truths.oscillation(0.1, GEAR_W), factors=(1.0, GEAR_N))),
                    doubt=1e-14),
        settings=at(1e-3, 1e-6, 1e-9), peers=(),
    ),
    Motion(
        name="kilometre-crane", group="scales",
        title="A load of a thousand tons on a rope of a kilometre",
        why="1e6 kg and 1e3 m: energies of 1e10 J, of which an absolute tolerance of 1e-6 is nothing.",
        scene="kilometre-crane", duration=600.0, samples=1.0,
        truth=Truth("closed form, theta = 2 asin(k sn(K - w0 t, k)), in 60 digits",
                    truths.of_configuration(lambda t: truths.swing(1.0, CRANE_W0)(t)[:, None])),
        settings=at(1e-3, 1e-6, 1e-9),
    ),
)  # fmt: skip
