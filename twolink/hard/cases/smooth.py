"""Smooth cases without loops and events: pendulums, chains, spinning bodies, stiff springs, extreme scales, inputs."""

import functools
import math
from collections.abc import Sequence
from typing import Any

import mpmath as mp
import numpy as np

from twolink.dynamics import Robot, load_robot
from twolink.effects import Gravity
from twolink.hard import truths
from twolink.hard.case import StateHistory
from twolink.hard.high_precision import CHAINS
from twolink.lagrange.check import arm_urdf
from twolink.scenes import Scene

G = 9.81
W0 = math.sqrt(G)
RIGID_W0 = math.sqrt(0.75 * G)  # two rods as one: m g c / I = 6 g / 8
FIXED_W0 = math.sqrt((2.0 * 0.5 + 1.0 * 1.0) * G / (0.3 + 2.0 * 0.5**2 + 0.1 + 1.0))  # fixed-child.urdf
WHEEL_RATE = 2 * math.pi * 1000.0
CREEP_D, CREEP_K = 1e8, 1e8
SLIDER_K, SLIDER_M, SLIDER_X = 1e-3, 1e-12, 1e-6
GEAR_K, GEAR_I, GEAR_J, GEAR_N = 1e-15, 1e-21, 4e-21, -2.0
GEAR_W = (GEAR_K / (GEAR_I + GEAR_N**2 * GEAR_J)) ** 0.5
_LINK = """<link name="link{k}"><inertial><origin xyz="0.5 0 0"/><mass value="{mass!r}"/>
<inertia ixx="0" iyy="{moment!r}" izz="{moment!r}" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="joint{k}" type="revolute"><parent link="link{before}"/><child link="link{k}"/>
<origin xyz="{at} 0 0"{turned}/><axis xyz="0 -1 0"/>
<limit lower="-1e9" upper="1e9" effort="1e9" velocity="1e9"/></joint>"""
_DOWN = f' rpy="0 {math.pi / 2!r} 0"'


def chain_urdf(masses: Sequence[float]) -> str:
    """Rods of 1 m, one hinged to the end of the other; q = 0 hangs straight down."""
    parts = [
        _LINK.format(k=k, before=k - 1, mass=m, moment=m / 12, at=0 if k == 1 else 1, turned=_DOWN if k == 1 else "")
        for k, m in enumerate(masses, 1)
    ]
    return f'<robot name="chain{len(masses)}"><link name="link0"/>{"".join(parts)}</robot>'


def _chain(masses: Sequence[float], angle: float) -> Scene:
    start = [angle] + [0.0] * (len(masses) - 1)
    return Scene(load_robot(chain_urdf(masses)), start, effects=[Gravity((0.0, 0.0, -9.81))], duration=1.0)


def _rods(m1: float, m2: float, q: Sequence[float]) -> Scene:
    """Two rods of 1 m, at rest."""
    return Scene(load_robot(arm_urdf(1.0, 1.0, m1, m2)), q, effects=[Gravity((0.0, 0.0, -G))])


def _quaternion_length(robot: Robot, track: StateHistory) -> np.ndarray:
    """| |p| - 1 | of the free body's quaternion p."""
    del robot
    return np.asarray(np.abs(np.linalg.norm(track.q[:, 3:7], axis=1) - 1.0))


def _wheel(t: Any) -> Sequence[Any]:
    """The cosine and sine of the angle of a wheel that turns at WHEEL_RATE."""
    return [mp.cos(mp.mpf(WHEEL_RATE) * t), mp.sin(mp.mpf(WHEEL_RATE) * t)]


def _creep(t: Any) -> Sequence[Any]:
    """x'' + d x' + k x = 0 from x = 1 at rest, overdamped: the sum of two exponentials."""
    d, k = mp.mpf(CREEP_D), mp.mpf(CREEP_K)
    root = mp.sqrt(d * d / 4 - k)
    slow, fast = -k / (d / 2 + root), -(d / 2 + root)
    return [(fast * mp.exp(slow * t) - slow * mp.exp(fast * t)) / (fast - slow)]


def _spin_change(robot: Robot, track: StateHistory) -> np.ndarray:
    """The relative change of the governor's angular momentum about its shaft, about which no torque acts."""
    momentum = np.einsum("nj,nj->n", robot.mass_matrix(track.q)[:, 0, :], track.v)
    return np.asarray(np.abs(momentum / momentum[0] - 1.0))


def _pieces(times: tuple[float, ...], forces: tuple[float, ...]) -> truths.ExactMotion:
    """1 kg from rest under a force [N] that is constant between times [s]: a parabola for each piece."""

    def exact(t: np.ndarray) -> np.ndarray:
        out = np.zeros(len(t))
        position = speed = 0.0
        for force, begin, length in zip(forces, times, np.diff(times, append=times[-1]), strict=True):
            s = t[t >= begin] - begin
            out[t >= begin] = position + speed * s + force * s * s / 2
            position, speed = position + speed * length + force * length**2 / 2, speed + force * length
        return out[:, None]

    return exact


CHAIN_SCENES = {name: functools.partial(_chain, masses, angle) for name, masses, angle in CHAINS}
SCENES = {
    **CHAIN_SCENES,
    # Of 3 kg, so that m l^2 / 12 is a double exactly.
    **dict.fromkeys(("chaos", "chaos-30s", "chaos-30s-quad"), functools.partial(_rods, 3.0, 3.0, (0.0, 0.0))),
    "light-tip": functools.partial(_rods, 1.0, 1e-9, (0.3, -0.5)),
    "heavy-tip": functools.partial(_rods, 1e-9, 1.0, (0.3, -0.5)),
}
STORED = {"symmetric-rest": "arm-swing", "chaos": "chaos", "chaos-30s": "chaos", "chaos-30s-quad": "chaos",
          "light-tip": "light-tip", "heavy-tip": "heavy-tip", "dzhanibekov": "dzhanibekov"}  # fmt: skip
EXACT = {
    "upright-balance": truths.toppling(1e-12, W0),
    **dict.fromkeys(
        ("pendulum-1000s", "pendulum-100000s", "picosecond", "thirty-years"),
        truths.swing(math.pi / 2, W0, -math.pi / 2),
    ),
    "fast-spin": truths.symmetric_top(1.0, 2.0, 1.0, 1e4),
    "tumbling-3h": truths.symmetric_top(1.0, 2.0, 3.0, 4.0),
    "million-turns": truths.in_digits(_wheel),
    "fixed-child": truths.swing(2.0, FIXED_W0),
    "stiff-spring": truths.oscillation(1.0, 1e5),
    "stiff-elbow": truths.swing(1.0, RIGID_W0, factors=(1.0, 0.0)),
    "stiff-damper": truths.in_digits(_creep),
    "step-too-long": truths.oscillation(1.0, 1000.0),
    "micrometre-slider": truths.oscillation(SLIDER_X, (SLIDER_K / SLIDER_M) ** 0.5),
    "micrometre-gears": truths.oscillation(0.1, GEAR_W, (1.0, GEAR_N)),
    "kilometre-crane": truths.swing(1.0, math.sqrt(G / 1000.0)),
    "short-pulse": _pieces((5.0, 5.001), (1000.0, 0.0)),
    "torque-steps": _pieces((0.0, 0.3, 0.7, 1.1), (1.0, -2.0, 5.0, 0.0)),
    "overflowing-torque": lambda t: np.full((len(t), 2), np.inf),
}
ERRORS = {
    "million-steps": truths.energy_error(G),
    "quaternion-stays-unit": _quaternion_length,
    "tumbling-energy": truths.energy_error(20.5),  # (1 3^2 + 2 4^2) / 2
    "governor": _spin_change,
    **{name: truths.stored(reference) for name, reference in STORED.items()},
    **{name: truths.stored(name) for name in CHAIN_SCENES},
    **{name: truths.configuration_error(exact) for name, exact in EXACT.items()},
}
