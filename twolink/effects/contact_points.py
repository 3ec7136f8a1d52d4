"""The points at which a pair of shapes may touch, as gaps."""

from __future__ import annotations

import itertools

import numpy as np

from twolink.algorithms.spatial import Vec
from twolink.effects.conditions import unit
from twolink.effects.contact_pairs import Pair, Plane
from twolink.effects.gaps import AnyGap, Ball, BoxGap, CylinderGap, PlaneGap, RimGap, RoundGap
from twolink.effects.motion import GROUND
from twolink.errors import SceneError
from twolink.robots.collisions import Solid
from twolink.robots.shapes import Box, Capsule, Convex, Cylinder, Sphere


def gaps_of(pair: Pair) -> list[AnyGap]:
    """The gaps of a pair. Raises SceneError where shapes have no formula."""
    a, b = pair.first, pair.second
    if isinstance(b, Plane):
        return _on_plane(a, GROUND, unit(b.normal, "pairs"), float(b.height))
    # Points and lines without a radius have no distance to what they are inside of.
    if (
        isinstance(a.shape, (Sphere, Capsule))
        and isinstance(b.shape, (Sphere, Capsule))
        and (a.shape.radius + b.shape.radius > 0.0)
    ):
        return [RoundGap(_middle(a), _middle(b), _half(a), _half(b))]
    ball = isinstance(a.shape, Sphere) and a.shape.radius > 0.0
    if ball and isinstance(b.shape, Box):
        x, y, z = (0.5 * float(edge) for edge in b.shape.size)
        return [BoxGap(_middle(a), b.link, _vec(b.shape.point), _axes(b), (x, y, z))]
    if ball and isinstance(b.shape, Cylinder):
        radius, half = float(b.shape.radius), 0.5 * float(b.shape.length)
        return [CylinderGap(_middle(a), b.link, _vec(b.shape.point), _axes(b)[2], radius, half)]
    kinds = " and ".join(type(solid.shape).__name__.lower() for solid in (a, b))
    raise SceneError(f"contacts of {pair.name} cannot be located: there is no formula for {kinds}", where="pairs",
                     remedy="give spheres and capsules as its shapes", code="no-located-contact")  # fmt: skip


def _on_plane(solid: Solid, frame: str, normal: Vec, height: float) -> list[AnyGap]:
    """The gaps between a solid and a plane that is fixed to a frame."""
    shape = solid.shape
    if isinstance(shape, Cylinder):
        ends = (_placed(solid, (0.0, 0.0, side * 0.5 * float(shape.length))) for side in (-1.0, 1.0))
        axis = _axes(solid)[2]
        return [RimGap(solid.link, end, axis, float(shape.radius), frame, normal, height) for end in ends]
    radius, points = 0.0, list[Vec]()
    if isinstance(shape, (Sphere, Capsule)):
        radius = float(shape.radius)
    if isinstance(shape, Sphere):
        points = [_vec(shape.point)]
    elif isinstance(shape, Capsule):
        points = [_placed(solid, (0.0, 0.0, side * 0.5 * float(shape.length))) for side in (-1.0, 1.0)]
    elif isinstance(shape, Box):
        x, y, z = (0.5 * float(edge) for edge in shape.size)
        points = [_placed(solid, corner) for corner in itertools.product((x, -x), (y, -y), (z, -z))]
    elif isinstance(shape, Convex):
        points = [_placed(solid, _vec(vertex)) for vertex in shape.vertices]
    return [PlaneGap(Ball(solid.link, point, radius), frame, normal, height) for point in points]


def _middle(solid: Solid) -> Ball:
    """The ball about the middle of a sphere or capsule."""
    return Ball(solid.link, _vec(solid.shape.point), float(getattr(solid.shape, "radius", 0.0)))


def _half(solid: Solid) -> Vec:
    """From the middle of a capsule to the centre of an end, in the link's axes; 0 for a sphere."""
    if not isinstance(solid.shape, Capsule):
        return 0.0, 0.0, 0.0
    return _vec(0.5 * float(solid.shape.length) * np.array(_axes(solid)[2]))


def _axes(solid: Solid) -> tuple[Vec, Vec, Vec]:
    """The shape's own x, y and z in the link's axes."""
    x, y, z = (_vec(column) for column in solid.shape.placement.rotation.T)
    return x, y, z


def _placed(solid: Solid, point: Vec) -> Vec:
    """A point of the shape's own axes in the link's."""
    return _vec(solid.shape.placement.act(np.array(point)))


def _vec(values: object) -> Vec:
    """Three floats, which formulas fold as constants."""
    x, y, z = (float(value) for value in values)  # type: ignore[attr-defined]
    return x, y, z
