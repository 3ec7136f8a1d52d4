"""Robots of the scenes: pendulums, sliders and rods, whose motions are known, and random chains and trees."""

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


# The probability of each number of joints: compiling takes longer for more of them.
SIZES = {2: 0.3, 3: 0.3, 4: 0.25, 5: 0.07, 6: 0.05, 7: 0.03}
KINDS = {"revolute": 0.55, "continuous": 0.25, "prismatic": 0.2}
FLOATING = 0.15  # the share of robots with a floating base, which have 1 or 2 joints in addition
GRAVITY = 0.8


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


def random_scene(
    random: np.random.Generator,
    sizes: dict[int, float] | None = None,
    floating: float = FLOATING,
    kinds: dict[str, float] | None = None,
) -> tuple[tl.Scene, str]:
    """A scene, and its robot in words.

    sizes, kinds: the probability of each number of joints, and of each kind. floating: that of a floating base.
    """
    sizes = SIZES if sizes is None else sizes
    base = bool(random.random() < floating)
    joints = int(random.integers(1, 3)) if base else int(random.choice(list(sizes), p=list(sizes.values())))
    text, chosen = random_urdf(random, joints, base=base, kinds=kinds or KINDS)
    robot = tl.load_robot(text, root="free" if base else "fixed")
    lively = random.uniform(0.0, 3.0)
    q = robot.neutral + 0.0
    for joint in robot.joints:
        if joint.kind == "vector":
            q[joint.q] = random.uniform(-1.5, 1.5)
        elif joint.kind == "cos-sin":
            angle = random.uniform(-np.pi, np.pi)
            q[joint.q] = [np.cos(angle), np.sin(angle)]
    v = random.uniform(-1, 1, robot.nv) * lively
    effects = [tl.effects.Gravity()] if random.random() < GRAVITY else []
    name = ("float " if base else "") + "".join(kind[0] for kind in chosen)
    return tl.Scene(robot, q, v, effects=effects), name + ("" if effects else " no gravity")


def random_urdf(
    random: np.random.Generator, joints: int, *, base: bool, kinds: dict[str, float]
) -> tuple[str, list[str]]:
    """The text of a URDF with this number of joints, and their kinds. base: whether the first link has a mass."""
    text = _link(random, "link0") if base else '<link name="link0"/>'
    chosen: list[str] = []
    for i in range(1, joints + 1):
        chosen.append(str(random.choice(list(kinds), p=list(kinds.values()))))
        parent = i - 1 if random.random() < 0.7 else int(random.integers(0, i))
        text += f"""{_link(random, f"link{i}")}<joint name="joint{i}" type="{chosen[-1]}">
<parent link="link{parent}"/><child link="link{i}"/><origin xyz="{_numbers(random.uniform(-0.5, 0.5, 3))}"
rpy="{_numbers(_angles(random))}"/><axis xyz="{_axis(random)}"/>{LIMIT if chosen[-1] != "continuous" else ""}</joint>"""
    return f'<robot name="random">{text}</robot>', chosen


def _link(random: np.random.Generator, name: str) -> str:
    """A solid box, so that the inertia is that of a real body."""
    a, b, c = random.uniform(0.05, 0.5, 3)
    mass = random.uniform(0.3, 3.0)
    ixx, iyy, izz = mass / 12 * np.array([b * b + c * c, a * a + c * c, a * a + b * b])
    return f"""<link name="{name}"><inertial><origin xyz="{_numbers(random.uniform(-0.4, 0.4, 3))}"
rpy="{_numbers(_angles(random))}"/><mass value="{mass:.6f}"/>
<inertia ixx="{ixx:.9f}" iyy="{iyy:.9f}" izz="{izz:.9f}" ixy="0" ixz="0" iyz="0"/></inertial></link>"""


def _axis(random: np.random.Generator) -> str:
    if random.random() < 0.6:
        return ("1 0 0", "0 1 0", "0 0 1", "0 -1 0")[int(random.integers(4))]
    axis = random.normal(size=3)
    return _numbers(axis / np.linalg.norm(axis), 9)


def _angles(random: np.random.Generator) -> np.ndarray:
    return np.zeros(3) if random.random() < 0.4 else random.uniform(-np.pi, np.pi, 3)


def _numbers(values: np.ndarray, digits: int = 6) -> str:
    return " ".join(f"{value:.{digits}f}" for value in values)
