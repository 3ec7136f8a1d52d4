"""Random numbers that scenes with contacts are made of."""

import numpy as np
from honest_robots import uniform

from twolink import effects as fx
from twolink.robots.shapes import AnyShape


def direction(random: np.random.Generator) -> np.ndarray:
    """A random unit vector."""
    v = random.normal(size=3)
    return np.asarray(v / np.linalg.norm(v))


def turn(random: np.random.Generator) -> list[float]:
    """A random quaternion."""
    q = random.normal(size=4)
    return list(map(float, q / np.linalg.norm(q)))


def times(mass: float, moments: tuple[float, float, float]) -> tuple[float, float, float]:
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
