"""Do bodies touch where twolink says? Random placements of all pairs of shapes, against Coal, supports and SciPy.

    python -m scripts.studies.geometry [--scenes 10000] [--seed 0] [--first 0]

Shapes: spheres, capsules, cylinders, boxes, hulls of 7 and of 60 corners, and planes. Half of the placements touch to
0.1 mm, a quarter are up to 5 cm apart, and a quarter overlap by up to 0.3 of the thinner body. Of the point with the
smallest gap, or of hulls with that nearest to Coal's, for where edges cross the corners over the best face are points
too:

    gap       the signed distance of Coal. Features of hulls that are apart are never farther than that up to 0.1 mm;
              where corners face corners there are none, and farther apart they may be any that do not overlap
    normal    n separates the bodies by that gap: min n . x of the first - max n . x of the second, by their supports
    witness   both ends x -+ g n / 2 are points of the bodies
    better    of bodies that overlap, by how much another normal separates them more, which SciPy looks for
    features  of hulls turned so that a face lies on one of the other: the points reach as far along it as the part that
              both faces share, by a linear program

Of bodies that are apart no other normal and ends keep the second and third. off: by how much each misses, m. Rows go to
out/geometry-SEED.csv.
"""

import argparse
import itertools
from dataclasses import dataclass
from typing import Any, NamedTuple

import coal
import numpy as np
import pinocchio as pin
from scipy.optimize import brentq, linprog, minimize
from scipy.spatial import ConvexHull

from scripts.runner import Bars, Table, study
from scripts.studies.scenes.robots import free_robot
from twolink import effects as fx
from twolink.effects.contact_pairs import select_pairs, solids_of
from twolink.geometry.detection import Detector
from twolink.geometry.points import Places, Points
from twolink.robots.collisions import AnyShape

KINDS = ("sphere", "capsule", "cylinder", "box", "hull of 7", "hull of 60")
PAIRS = (*itertools.combinations_with_replacement(KINDS, 2), *((kind, "plane") for kind in KINDS))
HULLS = {"box", "hull of 7", "hull of 60"}
NEAR = 1e-4  # m
ACCURACY = 1e-6  # m: Coal's own of curved shapes is 2e-7
ROBOT = free_robot(("a", 1.0, (1.0, 1.0, 1.0)), ("b", 1.0, (1.0, 1.0, 1.0)))
PLANE = fx.Plane()
MEASURES = ("gap", "normal", "witness", "better", "features")


@dataclass(frozen=True)
class Row:
    """A placement: the gap that it has by Coal, and by how much twolink's points miss, m."""

    scene: int
    pair: str
    true: float
    gap: float
    normal: float
    witness: float
    better: float
    features: float

    @property
    def fails(self) -> bool:
        return not max(getattr(self, name) for name in MEASURES) < ACCURACY


class Body(NamedTuple):
    """A placed shape."""

    shape: AnyShape | fx.Plane
    solid: Any
    place: pin.SE3

    def at(self, x: Any, turn: Any = None) -> "Body":
        return self._replace(place=pin.SE3(self.place.rotation if turn is None else turn, np.asarray(x, float)))

    def support(self, n: np.ndarray) -> np.ndarray:
        """max n . x of directions (..., 3), m."""
        local = n @ self.place.rotation
        return np.asarray(n @ self.place.translation + _support(self.shape, local))


def shape_of(kind: str, random: np.random.Generator) -> AnyShape | fx.Plane:
    """A random shape of a kind."""
    a, b, c = random.uniform(0.03, 0.3, 3).tolist()
    if not kind.startswith("hull"):
        shapes: dict[str, AnyShape | fx.Plane] = {"sphere": fx.Sphere(a), "capsule": fx.Capsule(a, b), "plane": PLANE,
                                                  "cylinder": fx.Cylinder(a, b), "box": fx.Box((a, b, c))}  # fmt: skip
        return shapes[kind]
    cloud = random.normal(size=(int(kind.split()[-1]), 3))
    cloud *= np.array([a, b, c]) / np.linalg.norm(cloud, axis=1)[:, None]
    return fx.Convex(tuple(map(tuple, (cloud - cloud.mean(axis=0)).tolist())))


def _support(shape: AnyShape | fx.Plane, n: np.ndarray) -> Any:
    """max n . x over a shape, along its own axes, m."""
    if isinstance(shape, fx.Plane):  # the half space below it
        return np.where(n[..., 2] > 1.0 - 1e-15, 0.0, np.inf)
    if isinstance(shape, fx.Convex):
        return (n @ np.array(shape.vertices).T).max(axis=-1)
    if isinstance(shape, fx.Box):
        return 0.5 * np.abs(n) @ shape.size
    across = np.linalg.norm(n[..., :2] if isinstance(shape, fx.Cylinder) else n, axis=-1)
    return shape.radius * across + 0.5 * getattr(shape, "length", 0.0) * np.abs(n[..., 2])


def body_of(kind: str, random: np.random.Generator) -> Body:
    """A random body of a kind, turned."""
    shape, x = shape_of(kind, random), random.normal(size=4)
    if isinstance(shape, fx.Plane):
        return Body(shape, coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0), pin.SE3.Identity())
    return Body(shape, shape.coal(), pin.SE3(pin.Quaternion(x / np.linalg.norm(x)).matrix(), np.zeros(3)))


def distance(a: Body, b: Body) -> float:
    """Coal's signed distance, m."""
    request = coal.DistanceRequest()
    request.gjk_tolerance = request.epa_tolerance = 1e-10
    request.gjk_max_iterations = request.epa_max_iterations = 1000
    at = [coal.Transform3s(one.place.rotation, one.place.translation) for one in (a, b)]
    return float(coal.distance(a.solid, at[0], b.solid, at[1], request, coal.DistanceResult()))


def separation(n: np.ndarray, a: Body, b: Body) -> Any:
    """How far bodies are apart along directions (..., 3) from the second to the first, m."""
    return -a.support(-n) - b.support(n)


def points_of(a: Body, b: Body) -> Points:
    """twolink's points of two placed bodies."""
    plane = isinstance(b.shape, fx.Plane)
    shapes: dict[str, list[Any]] = {"a": [a.shape]} | ({} if plane else {"b": [b.shape]})
    pairs = select_pairs(ROBOT, solids_of(ROBOT, shapes), [("a", PLANE if plane else "b")]).chosen
    places = (pin.SE3.Identity(), a.place, pin.SE3.Identity() if plane else b.place)
    frames = Places(np.array([x.rotation for x in places]), np.array([x.translation for x in places]))
    return Detector(ROBOT, pairs).points(frames, 10.0)


def placed(pair: tuple[str, str], random: np.random.Generator) -> tuple[float, ...]:
    """Of one random placement the gap by Coal, and by how much each of MEASURES misses, m."""
    a, b = (body_of(kind, random) for kind in pair)
    way = np.array([0.0, 0.0, 1.0]) if pair[1] == "plane" else random.normal(size=3)
    solids = [body for body in (a, b) if not isinstance(body.shape, fx.Plane)]
    way, thin = way / np.linalg.norm(way), min(-distance(one, one) for one in solids)
    low, high = ((-1e-4, 1e-4), (-1e-4, 1e-4), (0.0, 0.05), (-0.3 * thin, 0.0))[random.integers(4)]
    gap = max(random.uniform(low, high), 0.9 * distance(a, b))
    a = a.at(brentq(lambda far: distance(a.at(far * way), b) - gap, 0.0, 2.0, xtol=1e-13) * way)
    return *nearest_off(a, b), features_off(a, b, random) if set(pair) <= HULLS else 0.0


def nearest_off(a: Body, b: Body) -> tuple[float, ...]:
    """The gap by Coal, and by how much the nearest points miss in all but features, m."""
    points, true = points_of(a, b), distance(a, b)
    hulls = all(isinstance(body.shape, (fx.Box, fx.Convex)) for body in (a, b))
    apart = hulls and true > 0.0
    if apart and not len(points.gap):
        return true, 0.0, 0.0, 0.0, 0.0
    least = int(np.abs(points.gap - true).argmin() if hulls and true < 0.0 else points.gap.argmin())
    ours, n = float(points.gap[least]), points.normal[least]
    along = float(separation(n, a, b))
    if apart:
        near = true < NEAR
        return true, max((ours - true) * near, -ours), abs(along - ours) * near, 0.0, 0.0
    first = 1.0 if points.first[least] == 1 else -1.0  # the rounder one is the first
    n, along = first * n, float(separation(first * n, a, b))
    ends = [points.position[least] + sign * 0.5 * ours * n for sign in (1.0, -1.0)]
    outside = max(distance(Body(PLANE, coal.Sphere(0.0), pin.SE3(np.eye(3), end)), body)
                  for end, body in zip(ends, (a, b), strict=True))  # fmt: skip
    better = best_separation(a, b, n) - along if true < 0.0 and not isinstance(b.shape, fx.Plane) else 0.0
    return true, abs(ours - true), abs(along - ours), max(outside, 0.0), max(better, 0.0)


def best_separation(a: Body, b: Body, normal: np.ndarray) -> float:
    """The largest separation that is found from some directions, m."""
    ways = np.random.default_rng(0).normal(size=(400, 3))
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    starts = [normal, *ways[np.argsort(-separation(ways, a, b))[:2]]]
    found = (minimize(lambda n: -float(separation(n / np.linalg.norm(n), a, b)), start, method="Nelder-Mead",
                      options={"xatol": 1e-9, "fatol": 1e-12}).fun for start in starts)  # fmt: skip
    return -min(found)


def features_off(a: Body, b: Body, random: np.random.Generator) -> float:
    """By how much the points of hulls that lie on each other miss the part that a face of both shares, m."""
    down, up = (random.choice(ConvexHull(corners_of(body)).equations)[:3] for body in (a, b))
    turn = pin.Quaternion.FromTwoVectors(down, -up).matrix()
    a = a.at(np.zeros(3), pin.AngleAxis(random.uniform(0.0, 6.0), up).matrix() @ turn @ a.place.rotation)
    faces = [face_of(corners_of(body), n) for body, n in ((a, -up), (b, up))]
    on_a, on_b = (random.dirichlet(np.ones(len(face))) @ face for face in faces)
    points = points_of(a.at(on_b - on_a + random.uniform(-1e-5, 1e-5) * up), b)
    near = points.position[points.gap < NEAR]
    if not len(near):
        return np.inf
    along = np.linalg.svd(up[None])[2][1:].T  # (3, 2), across the normal
    polygons = [ConvexHull((face - on) @ along).equations for face, on in zip(faces, (on_a, on_b), strict=True)]
    sides, x, misses = np.concatenate(polygons), (near - on_b) @ along, list[float]()
    for way in random.normal(size=(4, 2)):
        found = linprog(-way, sides[:, :2], -sides[:, 2], bounds=(None, None),
                        options={"primal_feasibility_tolerance": 1e-10})  # fmt: skip
        misses.append(abs(float((x @ way).max()) + found.fun) / float(np.linalg.norm(way)))
    return max(misses)


def corners_of(body: Body) -> np.ndarray:
    """The corners (n, 3) of a placed hull."""
    shape = body.shape
    box = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
    cloud = box * shape.size if isinstance(shape, fx.Box) else np.array(shape.vertices)
    return np.asarray(cloud @ body.place.rotation.T + body.place.translation)


def face_of(corners: np.ndarray, n: np.ndarray) -> np.ndarray:
    """Those of the corners at the face with the normal n."""
    heights = corners @ n
    return corners[heights > heights.max() - 1e-9]


def rows_of(number: int, given: argparse.Namespace) -> list[Row]:
    """One placement of a pair of shapes."""
    pair = PAIRS[number % len(PAIRS)]
    return [Row(number, " - ".join(pair), *placed(pair, np.random.default_rng([given.seed, number])))]


def show(rows: list[Row], _given: argparse.Namespace) -> Bars:
    """The largest misses by pair."""
    table = Table(f"pair <24 | placements >6 | {' | '.join(f'{name} >9.1e' for name in MEASURES)} | fail >6")
    for name in (*map(" - ".join, PAIRS), "all"):
        some = [row for row in rows if name in (row.pair, "all")]
        if some:
            worst = (max(getattr(row, what) for row in some) for what in MEASURES)
            table.add(name, len(some), *worst, sum(row.fails for row in some))
    bad = sum(row.fails for row in rows)
    return [(not bad, f"miss by {ACCURACY:g} m or more: {bad} of {len(rows)} (bar: none)")]


if __name__ == "__main__":
    raise SystemExit(study(__doc__, "geometry", Row, rows_of, show, scenes=10_000))
