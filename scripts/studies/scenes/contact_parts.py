"""What scenes with contacts are made of: free bodies, random numbers, and a scene with its truth."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import twolink as tl
from scripts.studies.scenes.robots import JOINT, uniform
from twolink import effects as fx
from twolink.robots.collisions import AnyShape

Moments = tuple[float, float, float]
LINK = """<link name="{name}"><inertial><origin xyz="{com}"/><mass value="{mass}"/>
<inertia ixx="{i[0]}" iyy="{i[1]}" izz="{i[2]}" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
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
    text = '<link name="base"/>' if base else '<link name="ground"/>'
    for name, mass, moments in parts:
        text += LINK.format(name=name, com="0 0 0", mass=mass, i=moments)
        text += JOINT.format(name=f"{name}_joint", kind="floating", parent="base" if base else "ground", child=name,
                             at="0 0 0", axis="0 0 1", limit="")  # fmt: skip
    return tl.load_robot(f'<robot name="bodies"><{text[1:]}</robot>')


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
