"""Robots with few parts whose motions are known: pendulums, sliders, rods that hang from each other."""

import functools

import mpmath as mp
import numpy as np

import twolink as tl
from twolink import effects as fx
from twolink.hard import truths

LINK = """<link name="{name}"><inertial><origin xyz="{com}"/><mass value="{mass}"/>
<inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{at}"/>
<axis xyz="{axis}"/>{limit}</joint>"""
LIMIT = '<limit lower="-1e6" upper="1e6" effort="1e6" velocity="1e6"/>'


@functools.lru_cache(64)
def pendulum(kind: str, mass: float, com: float, inertia: float) -> tl.Robot:
    """One rod about y, its centre of mass `com` [m] above the joint."""
    text = LINK.format(name="rod", com=f"0 0 {com}", mass=mass, i=inertia)
    limit = "" if kind == "continuous" else LIMIT
    text += JOINT.format(name="joint", kind=kind, parent="world", child="rod", at="0 0 0", axis="0 1 0", limit=limit)
    return tl.load_robot(f'<robot name="pendulum"><link name="world"/>{text}</robot>')


@functools.lru_cache(64)
def slider(mass: float) -> tl.Robot:
    """A body that slides along z."""
    text = LINK.format(name="body", com="0 0 0", mass=mass, i=0.25)
    text += JOINT.format(name="joint", kind="prismatic", parent="world", child="body", at="0 0 0", axis="0 0 1",
                         limit=LIMIT)  # fmt: skip
    return tl.load_robot(f'<robot name="slider"><link name="world"/>{text}</robot>')


def double_pendulum(rods: list[tuple[float, float, float]], weights: list[float] | None = None) -> tl.Robot:
    """Rods of 1 m about y that hang from each other, with weights at their ends."""
    text = rods_text(rods)
    for k, weight in enumerate(weights or [], 1):
        text += LINK.format(name=f"end{k}", com="0 0 0", mass=weight, i=0)
        text += JOINT.format(name=f"fixed{k}", kind="fixed", parent=f"rod{k}", child=f"end{k}", at="0 0 -1",
                             axis="0 1 0", limit="")  # fmt: skip
    return tl.load_robot(f'<robot name="rods"><link name="world"/>{text}</robot>')


def rods_text(rods: list[tuple[float, float, float]]) -> str:
    """Rods (mass, centre of mass below the joint, inertia) of 1 m that hang from each other."""
    text = ""
    for k, (mass, com, inertia) in enumerate(rods, 1):
        text += LINK.format(name=f"rod{k}", com=f"0 0 {-com}", mass=mass, i=inertia)
        text += JOINT.format(name=f"joint{k}", kind="revolute", parent="world" if k == 1 else f"rod{k - 1}",
                             child=f"rod{k}", at=f"0 0 {-int(k > 1)}", axis="0 1 0", limit=LIMIT)  # fmt: skip
    return text


def constants(random: np.random.Generator) -> tuple[float, float, float, float]:
    """Gravity [m/s^2] and a rod's mass, centre of mass and inertia, of few digits: their products are not rounded."""
    g, mass, com, inertia = random.integers([150, 8, 4, 4], [165, 48, 16, 32])
    return float(g) / 16, float(mass) / 16, float(com) / 16, float(inertia) / 64


def frequency(g: float, mass: float, com: float, inertia: float) -> mp.mpf:
    """w0 of a pendulum, 1/s: w0^2 = m g c / (I + m c^2)."""
    with mp.workdps(truths.DIGITS):
        return mp.sqrt(mp.mpf(g) * mass * com / (inertia + mp.mpf(mass) * com**2))


def gravity(g: float) -> fx.Gravity:
    """Gravity of g [m/s^2] along -z."""
    return fx.Gravity((0.0, 0.0, -g))


def uniform(random: np.random.Generator, low: float, high: float) -> float:
    """A random number of three digits behind the point."""
    return round(float(random.uniform(low, high)), 3)
