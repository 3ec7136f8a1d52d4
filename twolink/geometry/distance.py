"""The signed distance of two placed shapes with their nearest points: Coal's, whose normals are checked.

    f(n) = min n . x_a - max n . x_b

Along a unit normal n the bodies are apart by f(n), and along that of their nearest points by their distance, the
largest f. Coal's normal misses that where curved bodies overlap by little: two cylinders of some decimetres by up to
2 mm. It is exact for bodies that are apart. So a body is moved out along n by s, until it is; there the normal m of the
nearest points is the largest of f(m) + s n . m, from which follows f(m) >= f(n) + s (1 - n . m): it is a better one.

Of cylinders that overlap, Coal fails to refine two of a hundred to `NEAREST`, and then tells any depth, down to
-1.8e308 m. That with its own tolerance shows it.
"""

from __future__ import annotations

from typing import Any

import coal
import numpy as np

from twolink.algorithms.namespaces import Array
from twolink.geometry.hulls import FLAT, TouchPoint

NEAREST, ITERATIONS = 1e-10, 1000  # of Coal's nearest points, whose default of 1e-6 m shows at cylinders
FAILED = 1e-5  # m: by so much the refined depth is larger where it is wrong
AGREES = 1e-9  # m: by so much less f(n) may be than the distance
APART = 1e-3  # m: so far bodies are moved apart, where Coal's normals are good to 1e-7
ROUNDS = 20

Placed = tuple[Any, Array, Array]  # Coal's shape, its rotation and its origin


def distance(a: Placed, b: Placed) -> tuple[float, Any]:
    """The signed distance, m, and Coal's result."""
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    request.gjk_tolerance = request.epa_tolerance = NEAREST
    request.gjk_max_iterations = request.epa_max_iterations = ITERATIONS
    gap = float(coal.distance(*_placed(*a), *_placed(*b), request, result))
    if gap < 0.0:
        coarse = coal.DistanceResult()
        plain = float(coal.distance(*_placed(*a), *_placed(*b), coal.DistanceRequest(), coarse))
        if plain - gap > FAILED:
            return plain, coarse
    return gap, result


def nearest_points(a: Placed, b: Placed, result: Any) -> TouchPoint:
    """The middle of the nearest points, with the gap and the normal from b to a. result: of `distance`."""
    best = _touch(result, np.zeros(3))
    if not best.normal.any():  # of segments that cross and points on them
        ways = [*a[1].T, *b[1].T, np.cross(a[1][:, 2], b[1][:, 2])]
        ways = [sign * way / length for way in ways for sign in (1.0, -1.0) if (length := np.linalg.norm(way)) > FLAT]
        best = best._replace(normal=max(ways, key=lambda way: separation_along(way, a, b)))
    if best.gap > APART:
        return best
    along = separation_along(best.normal, a, b)
    if along > best.gap - AGREES:
        return best
    best = best._replace(gap=along)
    for _ in range(ROUNDS):
        out = (APART - best.gap) * best.normal
        found = _touch(distance((a[0], a[1], a[2] + out), b)[1], out)
        along = separation_along(found.normal, a, b)
        if along < best.gap + NEAREST:
            break
        best = found._replace(gap=along)
    return best


def separation_along(normal: Array, a: Placed, b: Placed) -> float:
    """f(n), m."""
    ends = ((shape, coal.Halfspace(sign * normal, 0.0)) for shape, sign in ((a, 1.0), (b, -1.0)))
    return sum(float(coal.distance(*_placed(*shape), half, coal.Transform3s(), coal.DistanceRequest(),
                                   coal.DistanceResult())) for shape, half in ends)  # fmt: skip


def _touch(result: Any, moved: Array) -> TouchPoint:
    """moved: of the first body, which its point goes back by, m."""
    first, second = np.array(result.getNearestPoint1()), np.array(result.getNearestPoint2())
    normal = -np.array(result.normal)
    return TouchPoint((), float(result.min_distance), normal, 0.5 * (first - moved + second))


def _placed(shape: Any, rotation: Array, origin: Array) -> tuple[Any, Any]:
    return shape, coal.Transform3s(rotation, origin)
