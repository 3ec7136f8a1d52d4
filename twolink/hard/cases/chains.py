"""Straight chains of uniform rods: mass matrices whose condition grows with the fourth power of the length."""

from __future__ import annotations

import functools
import math

from twolink.dynamics import load_robot
from twolink.effects import Gravity
from twolink.hard import truths
from twolink.hard.case import Motion, Truth, at
from twolink.hard.high_precision import CHAINS, stored
from twolink.scenes import Scene

_LINK = """<link name="link{k}"><inertial><origin xyz="0.5 0 0"/><mass value="{mass!r}"/>
<inertia ixx="0" iyy="{moment!r}" izz="{moment!r}" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="joint{k}" type="revolute"><parent link="link{before}"/><child link="link{k}"/>
<origin xyz="{at} 0 0"{turned}/><axis xyz="0 -1 0"/>
<limit lower="-1e9" upper="1e9" effort="1e9" velocity="1e9"/></joint>"""
_DOWN = f' rpy="0 {math.pi / 2!r} 0"'


def chain_urdf(masses: list[float]) -> str:
    """Rods of 1 m, one hinged to the end of the other; q = 0 hangs straight down."""
    parts = [
        _LINK.format(k=k, before=k - 1, mass=m, moment=m / 12, at=0 if k == 1 else 1, turned=_DOWN if k == 1 else "")
        for k, m in enumerate(masses, 1)
    ]
    return f'<robot name="chain{len(masses)}"><link name="link0"/>{"".join(parts)}</robot>'


def _scene(masses: list[float], angle: float) -> Scene:
    robot = load_robot(chain_urdf(masses))
    start = robot.neutral + 0.0
    start[0] = angle
    return Scene(robot, start, effects=[Gravity((0.0, 0.0, -9.81))], duration=1.0)


_TITLES = {
    "chain-10": "A straight chain of 10 links",
    "chain-50": "A straight chain of 50 links",
    "chain-100": "A straight chain of 100 links",
    "chain-200": "A straight chain of 200 links",
    "chain-outward": "Ten links, each ten times as heavy as the one before",
    "chain-inward": "Ten links, each a tenth of the one before",
}
_CONDITION = "The condition of the mass matrix is about 4 N^4: {:.0e} here."
_WHY = {
    "chain-10": _CONDITION.format(4e4),
    "chain-50": _CONDITION.format(2.5e7),
    "chain-100": _CONDITION.format(4e8) + " Whatever costs N^3 operations, or compiles as many, does not end.",
    "chain-200": _CONDITION.format(6.4e9) + " Whatever costs N^3 operations, or compiles as many, does not end.",
    "chain-outward": "Mass ratios of 10^9: the inertia of a light link vanishes beside what hangs on it, and the "
                     "articulated-body algorithm subtracts nearly equal numbers.",
    "chain-inward": "Mass ratios of 10^-9: the tip whips, and weighs nothing.",
}  # fmt: skip

CASES = tuple(
    Motion(
        name=name, group="chains", title=_TITLES[name], why=_WHY[name], slow=len(masses) > 10,
        scene=functools.partial(_scene, masses, angle), duration=1.0, samples=10.0,
        truth=Truth("planar equations in absolute angles, long double, extrapolation of order 14, 300 steps",
                    truths.of_configuration(truths.at_known_times(*stored(name))), doubt=3e-11),
        settings=at(1e-3, 1e-6, 1e-9),
    )
    for name, masses, angle in CHAINS
)  # fmt: skip
