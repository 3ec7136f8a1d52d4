"""The URDF of small robots, part by part."""

import numpy as np


def link(
    name: str, mass: float = 1.0, moment: float | tuple[float, ...] = 1.0, at: str = "0 0 0", more: str = ""
) -> str:
    """A link of a mass, whose centre is somewhere, and whose three moments of inertia are given, or one for all."""
    x, y, z = np.broadcast_to(moment, 3)
    return (f'<link name="{name}"><inertial><origin xyz="{at}"/><mass value="{mass}"/>'
            f'<inertia ixx="{x}" iyy="{y}" izz="{z}" ixy="0" ixz="0" iyz="0"/></inertial>{more}</link>')  # fmt: skip


def joint(
    name: str, kind: str, parent: str, child: str, axis: str = "0 0 1",
    *, lower: float = -99.0, upper: float = 99.0, effort: float = 1000.0, more: str = "",
) -> str:  # fmt: skip
    """A joint with wide limits."""
    return (f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><axis xyz="{axis}"/>'
            f'<limit lower="{lower:g}" upper="{upper}" effort="{effort}" velocity="100"/>{more}</joint>')  # fmt: skip


def robot_of(*parts: str) -> str:
    """A robot that stands on the link `ground`."""
    return f'<robot name="r"><link name="ground"/>{"".join(parts)}</robot>'
