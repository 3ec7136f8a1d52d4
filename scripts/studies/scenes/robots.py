"""Parts of the scenes: robots whose motions are known, random chains and trees, free bodies, and random numbers."""

import functools
from collections.abc import Callable
from dataclasses import dataclass

import mpmath as mp
import numpy as np

import twolink as tl
from twolink import effects as fx
from twolink.hard import truths
from twolink.robots.collisions import AnyShape

Moments = tuple[float, float, float]
LIMIT = '<limit lower="-1e6" upper="1e6" effort="1e6" velocity="1e6"/>'


# The probability of each number of joints: compiling takes longer for more of them.
SIZES = {2: 0.3, 3: 0.3, 4: 0.25, 5: 0.07, 6: 0.05, 7: 0.03}
KINDS = {"revolute": 0.55, "continuous": 0.25, "prismatic": 0.2}
FLOATING = 0.15  # the share of robots with a floating base, which have 1 or 2 joints in addition
GRAVITY = 0.8


def body(
    name: str, mass: float, moments: float | Moments, kind: str, joint: str = "joint", *, parent: str = "world",
    com: str = "0 0 0", at: str = "0 0 0", axis: str = "0 0 1",
) -> str:  # fmt: skip
    """A link and the joint that holds it. moments: of inertia, about the centre of mass."""
    x, y, z = moments if isinstance(moments, tuple) else (moments,) * 3
    limit = LIMIT if kind in ("revolute", "prismatic", "planar") else ""
    return f"""<link name="{name}"><inertial><origin xyz="{com}"/><mass value="{mass}"/>
<inertia ixx="{x}" iyy="{y}" izz="{z}" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="{joint}" type="{kind}"><parent link="{parent}"/><child link="{name}"/><origin xyz="{at}"/>
<axis xyz="{axis}"/>{limit}</joint>"""


def robot_of(bodies: str, ground: str = "world") -> tl.Robot:
    """The robot of some bodies and the link they begin at."""
    return tl.load_robot(f'<robot name="made"><link name="{ground}"/>{bodies}</robot>')


@functools.lru_cache(64)
def pendulum(kind: str, mass: float, com: float, inertia: float) -> tl.Robot:
    """One rod about y, its centre of mass `com` [m] above the joint."""
    return robot_of(body("rod", mass, inertia, kind, com=f"0 0 {com}", axis="0 1 0"))


@functools.lru_cache(64)
def slider(mass: float) -> tl.Robot:
    """A body that slides along z."""
    return robot_of(body("body", mass, 0.25, "prismatic"))


def double_pendulum(rods: list[tuple[float, float, float]], weights: list[float] | None = None) -> tl.Robot:
    """Rods of 1 m about y that hang from each other, with weights at their ends."""
    text = rods_text(rods)
    for k, weight in enumerate(weights or [], 1):
        text += body(f"end{k}", weight, 0, "fixed", f"fixed{k}", parent=f"rod{k}", at="0 0 -1", axis="0 1 0")
    return robot_of(text)


def rods_text(rods: list[tuple[float, float, float]]) -> str:
    """Rods (mass, centre of mass below the joint, inertia) of 1 m that hang from each other."""
    text = ""
    for k, (mass, com, inertia) in enumerate(rods, 1):
        before = "world" if k == 1 else f"rod{k - 1}"
        text += body(f"rod{k}", mass, inertia, "revolute", f"joint{k}", parent=before, com=f"0 0 {-com}",
                     at=f"0 0 {-int(k > 1)}", axis="0 1 0")  # fmt: skip
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


Truth = Callable[[np.ndarray], np.ndarray]
"""Positions (n, 3 k) at times (n,) of the k free bodies."""


@dataclass(frozen=True)
class Case:
    """A scene to simulate. truth: None where there is none. way: how contacts are computed, None: as the scene asks."""

    what: str
    scene: tl.Scene
    duration: float
    accuracy: float
    truth: Truth | None = None
    way: str | None = None


def free_robot(*parts: tuple[str, float, Moments], base: bool = False) -> tl.Robot:
    """Free bodies (name, mass, moments of inertia about the link's origin). base: with a fixed link "base"."""
    ground = "base" if base else "ground"
    return robot_of("".join(body(*part, "floating", f"{part[0]}_joint", parent=ground) for part in parts), ground)


def accuracy_of(random: np.random.Generator, finest: float = -10.0) -> float:
    return float(10 ** random.uniform(finest, -4))


def free_positions(q: np.ndarray, width: int) -> np.ndarray:
    """The positions (n, width) of free bodies, three columns each, of their configurations (n, nq)."""
    return q[:, [7 * (k // 3) + k % 3 for k in range(width)]]


def direction(random: np.random.Generator) -> np.ndarray:
    """A random unit vector."""
    v = random.normal(size=3)
    return np.asarray(v / np.linalg.norm(v))


def turn(random: np.random.Generator) -> list[float]:
    """A random quaternion."""
    q = random.normal(size=4)
    return list(map(float, q / np.linalg.norm(q)))


def times(mass: float, moments: Moments) -> Moments:
    """The moments of inertia of a body of this mass."""
    x, y, z = moments
    return mass * x, mass * y, mass * z


def reach(shape: AnyShape) -> float:
    """A radius about the link's origin that holds the shape."""
    match shape:
        case fx.Sphere():
            return float(shape.radius + np.linalg.norm(shape.point))
        case fx.Box():
            return float(np.linalg.norm(shape.size) / 2)
        case fx.Convex():
            return float(np.linalg.norm(shape.vertices, axis=1).max())
    return float(shape.radius + shape.length / 2 + (0.3 * shape.radius if isinstance(shape, fx.Cylinder) else 0.0))


def law(random: np.random.Generator) -> dict[str, float]:
    """Friction and restitution, either may be 0."""
    return {"friction": float(random.choice([0.0, uniform(random, 0.05, 0.7)], p=[0.3, 0.7])),
            "restitution": float(random.choice([0.0, uniform(random, 0.1, 0.9)]))}  # fmt: skip
