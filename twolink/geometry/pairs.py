"""Pairs of bodies, and the points at which they may touch, as gaps."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any, NamedTuple, cast

import msgspec
import numpy as np

from twolink.algorithms.motion import GROUND
from twolink.algorithms.namespaces import Array
from twolink.algorithms.spatial import ZERO, Vec, unit, vec
from twolink.errors import SceneError
from twolink.geometry.features import HullFeatures
from twolink.geometry.fields import HeightField
from twolink.geometry.gaps import Ball, BoxGap, CylinderGap, Gap, HullGap, PlaneGap, RimGap, RoundGap, StandGap
from twolink.geometry.hulls import hull_of
from twolink.robots.collisions import Box, Capsule, Convex, Cylinder, Solid, Sphere, Vector

STANDS_ON = 6  # points of the rim of a cylinder's end
MOST_FACES = 40  # of a convex mesh that has formulas: each is some of them
MOST_FEATURES = 50_000  # pairs of them of two meshes: each is looked at in every state


class Plane(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="plane"):
    """A plane of the world: n . x = height, with the bodies on the side that the normal n points to.

    Parameters
    ----------
    normal : (float, float, float)
        n, along the world's axes, of any length: it is scaled to 1.
    height : float
        Along n, m.
    """

    normal: Vector = (0.0, 0.0, 1.0)
    height: float = 0.0


class Pair(NamedTuple):
    """Two bodies that may touch, the rounder one first. name: of both."""

    name: str
    first: Solid
    second: Solid | Plane | HeightField


def gaps_of(pair: Pair) -> Sequence[Gap]:
    """The gaps of a pair. Raises SceneError where shapes have no formula."""
    a, b = pair.first, pair.second
    if isinstance(b, Plane):
        return _on_plane(a, GROUND, unit(b.normal, "pairs"), float(b.height))
    if isinstance(b, HeightField):
        raise _no_formula(pair, "there is none for height fields")
    # Points and lines without a radius have no distance to what they are inside of.
    if (
        isinstance(a.shape, (Sphere, Capsule))
        and isinstance(b.shape, (Sphere, Capsule))
        and (a.shape.radius + b.shape.radius > 0.0)
    ):
        return [RoundGap(middle_of(a), middle_of(b), half_of(a), half_of(b))]
    ball = isinstance(a.shape, Sphere) and a.shape.radius > 0.0
    if ball and isinstance(b.shape, Box):
        return [_box_gap(middle_of(a), b)]
    if isinstance(b.shape, Convex) and len(hull_of(b.shape).faces) > MOST_FACES:
        raise _no_formula(pair, f"there is none for meshes of more than {MOST_FACES} faces")
    if ball and isinstance(b.shape, Convex):
        return [_hull_gap(middle_of(a), b)]
    if isinstance(a.shape, Capsule) and a.shape.radius > 0.0 and isinstance(b.shape, (Box, Convex)):
        return _capsule_on_hull(a, b)
    if ball and isinstance(b.shape, Cylinder):
        radius, half = float(b.shape.radius), 0.5 * float(b.shape.length)
        return [CylinderGap(middle_of(a), b.link, vec(b.shape.point), _axes(b)[2], radius, half)]
    kinds = " and ".join(type(solid.shape).__name__.lower() for solid in (a, b))
    raise _no_formula(pair, f"there is no formula for {kinds}")


def _no_formula(pair: Pair, why: str) -> SceneError:
    return SceneError(f"contacts of {pair.name} cannot be located: {why}", where="pairs", code="no-located-contact",
                      remedy='give spheres and capsules as its shapes, or contact="stepped"')  # fmt: skip


def are_hulls(pair: Pair) -> bool:
    """True if both are boxes or convex meshes, which touch with features that change."""
    return all(isinstance(body, Solid) and isinstance(body.shape, (Box, Convex)) for body in (pair.first, pair.second))


def features_of(pair: Pair) -> HullFeatures:
    """The features of a pair of boxes or convex meshes. Raises SceneError for too many."""
    features = HullFeatures(pair.first, cast(Solid, pair.second))
    if len(features) > MOST_FEATURES:
        raise _no_formula(pair, f"they have {len(features)} pairs of corners, edges and faces, more than "
                                f"{MOST_FEATURES}")  # fmt: skip
    return features


def points_of(pair: Pair) -> int:
    """The number of points at which a pair may touch. Raises SceneError where it cannot be located.

    Two hulls touch at features that change; they count as the corners of the one that has more.
    """
    if not are_hulls(pair):
        return len(gaps_of(pair))
    features_of(pair)
    return max(len(balls_of(solid)[0]) for solid in (pair.first, cast(Solid, pair.second)))


def _capsule_on_hull(capsule: Solid, solid: Solid) -> list[Gap]:
    """Both ends against the box or mesh, and the segment between them against its edges."""
    ball, half = middle_of(capsule), half_of(capsule)
    ends = (Ball(ball.frame, vec(np.array(ball.point) + side * np.array(half)), ball.radius) for side in (-1.0, 1.0))
    gap = _box_gap if isinstance(solid.shape, Box) else _hull_gap
    edges = [np.array(edge, dtype=float) for edge in _edges(solid)]
    return [*(gap(end, solid) for end in ends),
            *(RoundGap(ball, Ball(solid.link, vec(0.5 * (a + b)), 0.0), half, vec(0.5 * (b - a)))
              for a, b in edges)]  # fmt: skip


def _hull_gap(ball: Ball, solid: Solid) -> HullGap:
    hull = hull_of(solid.shape)
    corners = [vec(corner) for corner in _placed(solid, hull.vertices)]
    return HullGap(ball, solid.link, _edges(solid), tuple(tuple(corners[i] for i in face) for face in hull.faces))


def _edges(solid: Solid) -> tuple[tuple[Vec, Vec], ...]:
    """The ends of the edges of a box or mesh, in the link's axes."""
    hull = hull_of(solid.shape)
    corners = [vec(corner) for corner in _placed(solid, hull.vertices)]
    return tuple((corners[i], corners[k]) for i, k in hull.edges)


def _half_edges(solid: Solid) -> Vec:
    return vec(0.5 * float(edge) for edge in solid.shape.size)  # type: ignore[union-attr]


def _box_gap(ball: Ball, solid: Solid) -> BoxGap:
    return BoxGap(ball, solid.link, vec(solid.shape.point), _axes(solid), _half_edges(solid))


def _on_plane(solid: Solid, frame: str, normal: Vec, height: float) -> list[Gap]:
    """The gaps between a solid and a plane that is fixed to a frame."""
    shape = solid.shape
    if isinstance(shape, Cylinder):
        return _cylinder_on_plane(solid, shape, frame, normal, height)
    points, radius = balls_of(solid)
    return [PlaneGap(Ball(solid.link, (x, y, z), radius), frame, normal, height) for x, y, z in points.tolist()]


def balls_of(solid: Solid) -> tuple[Array, float]:
    """The balls or points of a solid without a rim over planes: centres (n, 3) in its link's axes, and a radius."""
    shape = solid.shape
    if isinstance(shape, Sphere):
        return np.array([shape.point], dtype=float), float(shape.radius)
    if isinstance(shape, Capsule):
        ends = [(0.0, 0.0, side * 0.5 * float(shape.length)) for side in (-1.0, 1.0)]
        return _placed(solid, ends), float(shape.radius)
    x, y, z = _half_edges(solid) if isinstance(shape, Box) else ZERO
    corners = shape.vertices if isinstance(shape, Convex) else [*itertools.product((x, -x), (y, -y), (z, -z))]
    return _placed(solid, corners), 0.0


def _cylinder_on_plane(solid: Solid, shape: Cylinder, frame: str, normal: Vec, height: float) -> list[Gap]:
    """The rims of both ends, and points of them on which it stands."""
    axis, r, gaps = _axes(solid)[2], float(shape.radius), list[Gap]()
    for z in (-0.5 * float(shape.length), 0.5 * float(shape.length)):
        angles = np.arange(STANDS_ON) * 2.0 * np.pi / STANDS_ON
        rim = [(0.0, 0.0, z), *((r * np.cos(a), r * np.sin(a), z) for a in angles)]
        centre, *stands = map(vec, _placed(solid, rim))
        gaps.append(RimGap(solid.link, centre, axis, r, frame, normal, height))
        gaps += [StandGap(Ball(solid.link, point, 0.0), frame, normal, height, axis) for point in stands]
    return gaps


def middle_of(solid: Solid) -> Ball:
    """The ball about the middle of a sphere or capsule."""
    return Ball(solid.link, vec(solid.shape.point), float(getattr(solid.shape, "radius", 0.0)))


def half_of(solid: Solid) -> Vec:
    """From the middle of a capsule to the centre of an end, in the link's axes; 0 for a sphere."""
    if not isinstance(solid.shape, Capsule):
        return ZERO
    return vec(0.5 * float(solid.shape.length) * np.array(_axes(solid)[2]))


def _axes(solid: Solid) -> tuple[Vec, Vec, Vec]:
    """The shape's own x, y and z in the link's axes."""
    x, y, z = (vec(column) for column in solid.shape.placement.rotation.T)
    return x, y, z


def _placed(solid: Solid, points: Any) -> Array:
    """Points (n, 3) of the shape's own axes in the link's."""
    place = solid.shape.placement
    return np.asarray(np.array(points, float) @ place.rotation.T + place.translation)
