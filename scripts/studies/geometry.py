"""Do bodies touch where twolink says? Random placements of all pairs of shapes, against Coal and support functions.

    python -m scripts.studies.geometry [--scenes 10000] [--seed 0] [--first 0]

Shapes: spheres, capsules, cylinders, boxes, and hulls of 7 and of 60 corners. Half of the placements touch to 0.1 mm, a
quarter are up to 5 cm apart, and a quarter overlap by up to 0.3 of the thinner body. Of the point with the smallest
gap, or of hulls with that nearest to Coal's, for where edges cross the corners over the best face are points too:

    gap       the signed distance of Coal. Features of hulls that are apart are never farther than that up to 0.1 mm;
              where corners face corners there are none, and farther apart they may be any that do not overlap
    normal    n separates the bodies by that gap: min n . x of the first - max n . x of the second, by their supports
    witness   both ends x -+ g n / 2 are points of the bodies

The last two hold of no other normal and place: any other n separates less. off: by how much each misses, m. Rows go to
out/geometry-SEED.csv.
"""

import argparse
import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import coal
import numpy as np
import pinocchio as pin
from scipy.optimize import brentq

from scripts.runner import Bars, Table, study
from scripts.studies.scenes.robots import free_robot
from twolink import effects as fx
from twolink.effects.contact_pairs import select_pairs, solids_of
from twolink.geometry.detection import Detector
from twolink.geometry.points import Places
from twolink.robots.collisions import AnyShape

KINDS = ("sphere", "capsule", "cylinder", "box", "hull of 7", "hull of 60")
PAIRS = tuple(itertools.combinations_with_replacement(KINDS, 2))
HULLS = {"box", "hull of 7", "hull of 60"}
NEAR = 1e-4  # m
ACCURACY = 1e-6  # m: Coal's own of curved shapes is 2e-7
ROBOT = free_robot(("a", 1.0, (1.0, 1.0, 1.0)), ("b", 1.0, (1.0, 1.0, 1.0)))


@dataclass(frozen=True)
class Row:
    """A placement: the gap that it has by Coal, and by how much gap, normal and ends of twolink's miss, m."""

    scene: int
    pair: str
    true: float
    gap: float
    normal: float
    witness: float

    @property
    def fails(self) -> bool:
        return not max(self.gap, self.normal, self.witness) < ACCURACY


def shape_of(kind: str, random: np.random.Generator) -> AnyShape:
    """A random shape of a kind."""
    a, b, c = random.uniform(0.03, 0.3, 3).tolist()
    match kind:
        case "sphere":
            return fx.Sphere(a)
        case "capsule":
            return fx.Capsule(a, b)
        case "cylinder":
            return fx.Cylinder(a, b)
        case "box":
            return fx.Box((a, b, c))
    cloud = random.normal(size=(int(kind.split()[-1]), 3))
    cloud *= np.array([a, b, c]) / np.linalg.norm(cloud, axis=1)[:, None]
    return fx.Convex(tuple(map(tuple, (cloud - cloud.mean(axis=0)).tolist())))


def support(shape: AnyShape, n: np.ndarray) -> float:
    """max n . x over a shape, along its own axes, m."""
    if isinstance(shape, fx.Convex):
        return float((np.array(shape.vertices) @ n).max())
    if isinstance(shape, fx.Box):
        return float(0.5 * np.abs(n) @ shape.size)
    if isinstance(shape, fx.Sphere):
        return float(shape.radius)
    across = float(np.hypot(*n[:2])) if isinstance(shape, fx.Cylinder) else 1.0
    return float(shape.radius) * across + 0.5 * float(shape.length) * abs(float(n[2]))


def distance(a: Any, b: Any, places: list[pin.SE3]) -> float:
    """Coal's signed distance of two placed shapes, m."""
    request = coal.DistanceRequest()
    request.gjk_tolerance = request.epa_tolerance = 1e-10
    request.gjk_max_iterations = request.epa_max_iterations = 1000
    at = [coal.Transform3s(place.rotation, place.translation) for place in places]
    return float(coal.distance(a, at[0], b, at[1], request, coal.DistanceResult()))


def placed(pair: tuple[str, str], random: np.random.Generator) -> tuple[float, float, float, float]:
    """Of one random placement the gap by Coal, and by how much ours, the normal and the ends miss, m."""
    shapes = [shape_of(kind, random) for kind in pair]
    solids = [shape.coal() for shape in shapes]
    turns = [pin.Quaternion(x / np.linalg.norm(x)) for x in random.normal(size=(2, 4))]
    way, thin = random.normal(size=3), min(-distance(one, one, [pin.SE3.Identity()] * 2) for one in solids)
    way /= np.linalg.norm(way)
    low, high = ((-1e-4, 1e-4), (-1e-4, 1e-4), (0.0, 0.05), (-0.3 * thin, 0.0))[random.integers(4)]

    def places(far: float) -> list[pin.SE3]:
        return [pin.SE3(turns[0].matrix(), far * way), pin.SE3(turns[1].matrix(), np.zeros(3))]

    gap = max(random.uniform(low, high), 0.9 * distance(solids[0], solids[1], places(0.0)))
    at = places(brentq(lambda far: distance(solids[0], solids[1], places(far)) - gap, 0.0, 2.0, xtol=1e-13))
    pairs = select_pairs(ROBOT, solids_of(ROBOT, {"a": shapes[:1], "b": shapes[1:]}), [("a", "b")]).chosen
    frames = Places(*map(np.array, zip(*((x.rotation, x.translation) for x in (pin.SE3.Identity(), *at)), strict=True)))
    points = Detector(ROBOT, pairs).points(frames, 10.0)
    true, apart = distance(solids[0], solids[1], at), set(pair) <= HULLS and gap > 0.0
    if apart and not len(points.gap):
        return true, 0.0, 0.0, 0.0
    least = int(np.abs(points.gap - true).argmin() if set(pair) <= HULLS and true < 0.0 else points.gap.argmin())
    ours, n = float(points.gap[least]), points.normal[least]
    ends = {int(joint[least]): (x[least], sign) for x, joint, sign in points.ends}
    separation, outside = 0.0, 0.0
    for body, (shape, solid, place) in enumerate(zip(shapes, solids, at, strict=True), start=1):
        end, sign = ends[body]
        separation += sign * float(n @ place.translation) - support(shape, place.rotation.T @ (-sign * n))
        outside = max(outside, distance(coal.Sphere(0.0), solid, [pin.SE3(np.eye(3), end), place]))
    if apart:
        near = true < NEAR
        return true, max((ours - true) * near, -ours), abs(separation - ours) * near, 0.0
    return true, abs(ours - true), abs(separation - ours), outside


def rows_of(number: int, given: argparse.Namespace) -> Iterator[Row]:
    """One placement of a pair of shapes."""
    pair = PAIRS[number % len(PAIRS)]
    yield Row(number, " - ".join(pair), *placed(pair, np.random.default_rng([given.seed, number])))


def show(rows: list[Row], _given: argparse.Namespace) -> Bars:
    """The largest misses by pair."""
    table = Table("pair <24 | placements >6 | gap >9.1e | normal >9.1e | witness >9.1e | fail >6")
    for name in (*map(" - ".join, PAIRS), "all"):
        some = [row for row in rows if name in (row.pair, "all")]
        if some:
            worst = (max(getattr(row, what) for row in some) for what in ("gap", "normal", "witness"))
            table.add(name, len(some), *worst, sum(row.fails for row in some))
    bad = sum(row.fails for row in rows)
    return [(not bad, f"miss by {ACCURACY:g} m or more: {bad} of {len(rows)} (bar: none)")]


if __name__ == "__main__":
    raise SystemExit(study(__doc__, "geometry", Row, rows_of, show, scenes=10_000))
