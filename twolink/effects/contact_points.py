"""The points at which a pair of shapes may touch, as gaps."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NoReturn

import numpy as np

from twolink.algorithms.spatial import Vec
from twolink.effects.box_gaps import BoxShape, CornerGap, separation
from twolink.effects.conditions import unit
from twolink.effects.contact_pairs import Pair, Plane
from twolink.effects.gaps import AnyGap, Ball, BoxGap, CylinderGap, PlaneGap, RimGap, RoundGap
from twolink.effects.motion import GROUND
from twolink.effects.switching import Trigger
from twolink.errors import AccuracyError, SceneError
from twolink.robots.collisions import Solid
from twolink.robots.shapes import Box, Capsule, Convex, Cylinder, Sphere

OVERLAP = 1e-7  # m: how far two boxes may overlap, by rounding


def gaps_of(pair: Pair) -> Sequence[AnyGap | CornerGap]:
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
        return [_box_gap(_middle(a), b)]
    if isinstance(a.shape, Box) and isinstance(b.shape, Box):
        return [CornerGap(corner, _box(box), second=box is a) for solid, box in ((a, b), (b, a))
                for corner in _corners(solid)]  # fmt: skip
    if isinstance(a.shape, Capsule) and a.shape.radius > 0.0 and isinstance(b.shape, Box):
        return _capsule_on_box(a, b)
    if ball and isinstance(b.shape, Cylinder):
        radius, half = float(b.shape.radius), 0.5 * float(b.shape.length)
        return [CylinderGap(_middle(a), b.link, _vec(b.shape.point), _axes(b)[2], radius, half)]
    kinds = " and ".join(type(solid.shape).__name__.lower() for solid in (a, b))
    raise SceneError(f"contacts of {pair.name} cannot be located: there is no formula for {kinds}", where="pairs",
                     remedy="give spheres and capsules as its shapes", code="no-located-contact")  # fmt: skip


def edges_meet(pair: Pair) -> list[Trigger]:
    """What refuses a pair of boxes whose edges meet, which has no corner on a side."""
    a, b = pair.first, pair.second
    if not (isinstance(b, Solid) and isinstance(a.shape, Box) and isinstance(b.shape, Box)):
        return []
    boxes = _box(a), _box(b)

    def refuse(*_: object) -> NoReturn:
        raise AccuracyError(f"edges of {pair.name} meet, for which there is no formula", where="effects",
                            remedy="give spheres or capsules as edges", code="no-located-contact")  # fmt: skip

    return [Trigger("overlap", pair.name, function=lambda motion: separation(*boxes, motion) + OVERLAP, state=refuse)]


def _capsule_on_box(capsule: Solid, box: Solid) -> list[AnyGap]:
    """Both ends against the box, and the segment between them against its edges."""
    radius, half = float(capsule.shape.radius), _half(capsule)  # type: ignore[union-attr]
    middle = np.array(_vec(capsule.shape.point))
    gaps: list[AnyGap] = [_box_gap(Ball(capsule.link, _vec(middle + side * np.array(half)), radius), box)
                          for side in (-1.0, 1.0)]  # fmt: skip
    edges = 0.5 * np.array(box.shape.size)  # type: ignore[union-attr]
    for k, signs in itertools.product(range(3), itertools.product((-1.0, 1.0), repeat=2)):
        centre, along = np.insert(signs, k, 0.0) * edges, edges * np.eye(3)[k]
        turned = _vec(box.shape.placement.rotation @ along)
        gaps.append(RoundGap(_middle(capsule), Ball(box.link, _placed(box, _vec(centre)), 0.0), half, turned))
    return gaps


def _box(solid: Solid) -> BoxShape:
    x, y, z = (0.5 * float(edge) for edge in solid.shape.size)  # type: ignore[union-attr]
    return BoxShape(solid.link, _vec(solid.shape.point), _axes(solid), (x, y, z))


def _box_gap(ball: Ball, solid: Solid) -> BoxGap:
    box = _box(solid)
    return BoxGap(ball, box.frame, box.point, box.axes, box.half)


def _corners(solid: Solid) -> list[Ball]:
    x, y, z = _box(solid).half
    return [Ball(solid.link, _placed(solid, corner), 0.0) for corner in itertools.product((x, -x), (y, -y), (z, -z))]


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
        points = [corner.point for corner in _corners(solid)]
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
