"""Straight chains of uniform rods: mass matrices whose condition grows with the fourth power of the length."""

import functools
import math
from collections.abc import Sequence

from twolink.dynamics import load_robot
from twolink.effects import Gravity
from twolink.hard import truths
from twolink.hard.high_precision import CHAINS
from twolink.scenes import Scene

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


SCENES = {name: functools.partial(_chain, masses, angle) for name, masses, angle in CHAINS}
ERRORS = {name: truths.stored(name) for name in SCENES}
