"""Convex hulls that touch when stepped: their separation is Coal's, and what they overlap is of second order."""

import itertools
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import pytest

import twolink as tl
from tests.effects.bodies import free_bodies, stepped
from tests.near import assert_near
from twolink.contact.choice import choose_contact_method
from twolink.geometry import hulls
from twolink.geometry.hulls import facing, hull_of, separation, touching
from twolink.robots.collisions import Box, Convex

E = tl.effects
SIDE, STEP = 0.1, 2e-3  # m, s
Placed = tuple[np.ndarray, np.ndarray]


def stone(count: int, seed: int) -> Convex:
    """The hull of points on a sphere of 0.05 m."""
    points = np.random.default_rng(seed).normal(size=(count, 3))
    return Convex(tuple(map(tuple, (0.05 * points / np.linalg.norm(points, axis=1)[:, None]).tolist())))


SHAPES: dict[str, Box | Convex] = {"box": Box((0.1, 0.06, 0.02)), "stone": stone(9, 1), "ball": stone(60, 2)}


def depth(shapes: list[Box | Convex], places: list[Placed]) -> float:
    """Coal's distance, below 0 the depth of overlap, m."""
    request = coal.DistanceRequest()
    request.gjk_tolerance = request.epa_tolerance = 1e-12
    request.gjk_max_iterations = request.epa_max_iterations = 1000
    (a, p), (b, q) = ((shape.coal(), coal.Transform3s(*place)) for shape, place in zip(shapes, places, strict=True))
    return float(coal.distance(a, p, b, q, request, coal.DistanceResult()))


def overlapping(shapes: list[Box | Convex], deep: float, random: np.random.Generator) -> tuple[list[Placed], Any, Any]:
    """Random rotations, and places in a random direction at which shapes overlap by so much, m; both hulls there."""
    turned, way = [pin.exp3(random.uniform(-2, 2, 3)) for _ in shapes], random.normal(size=3)
    near, far = 0.0, 0.3
    for _ in range(60):
        middle = 0.5 * (near + far)
        places = [(turned[0], middle * way / np.linalg.norm(way)), (turned[1], np.zeros(3))]
        near, far = (middle, far) if depth(shapes, places) < -deep else (near, middle)
    a, b = (hull_of(shape).placed(*place) for shape, place in zip(shapes, places, strict=True))
    return places, a, b


@pytest.mark.parametrize("kinds", [(a, b) for a in SHAPES for b in SHAPES], ids="-".join)
@pytest.mark.parametrize("deep", [1e-5, 1e-3])
def test_the_separation_of_hulls_that_overlap_is_coals(kinds: tuple[str, str], deep: float) -> None:
    """And what touches shows it, each point with a name of its own."""
    random, shapes = np.random.default_rng(3), [SHAPES[kind] for kind in kinds]
    for _ in range(12):
        places, a, b = overlapping(shapes, deep, random)
        found = separation(a, b)
        assert_near(found.gap, depth(shapes, places), 1e-10)
        moved = [(places[0][0], places[0][1] - found.gap * found.normal), places[1]]
        assert abs(depth(shapes, moved)) < 1e-9  # the normal is the way out
        points = touching(a, b, 1e-4)
        assert min(point.gap for point in points) < -0.99 * deep
        assert len({point.name for point in points}) == len(points)


def boxes(count: int) -> tl.Robot:
    """Free cubes of 0.2 kg."""
    return free_bodies(*(f"b{k}" for k in range(count)), mass=0.2, inertia=0.2 * SIDE**2 / 6)


def thrown(seed: int) -> tl.Scene:
    """Two cubes that fly and turn towards each other at 3 m/s, at a random offset."""
    random = np.random.default_rng(seed)
    turned = random.normal(size=(2, 4))
    turned /= np.linalg.norm(turned, axis=1)[:, None]
    y, z = random.uniform(-0.1, 0.1, 2)
    q, v = [-0.15, y, z, *turned[0], 0.15, 0, 0, *turned[1]], []
    for speed, (qx, qy, qz, qw) in zip((2.0, -1.0), turned, strict=True):
        v += [*(pin.Quaternion(qw, qx, qy, qz).toRotationMatrix().T @ [speed, 0, 0]), *random.uniform(-10, 10, 3)]
    contact = E.Contact(("self",), 0.4, 0.5, shapes={name: (E.Box((SIDE,) * 3),) for name in ("b0", "b1")})
    return tl.Scene(boxes(2), q, v, [contact])


def deepest(run: tl.Trajectory) -> float:
    """Coal's deepest overlap of cubes at the samples of a run, m."""
    cube, deep = Box((SIDE,) * 3), 0.0
    for q in run.q:
        places = [run.robot.frame_pose(q, f"b{k}") for k in range(len(q) // 7)]
        deep = min([deep, *(depth([cube] * 2, [places[i], places[k]]) for i in range(len(places)) for k in range(i))])
    return -deep


@pytest.mark.parametrize("seed", [70, 107, 142])
def test_cubes_that_hit_with_corners_and_edges_do_not_overlap(seed: int) -> None:
    """A corner that comes from beside a face is seen when it is over it: steps in which it does so are halved."""
    run = stepped(thrown(seed), 0.25, STEP, samples=500)
    assert_near(deepest(run), run.contact_record["overlap"], 1e-9)
    assert run.contact_record["overlap"] < 1e-4
    assert np.diff(run.energy).max() < 1e-9


def test_cubes_that_tumble_onto_each_other_do_not_overlap() -> None:
    """Where edges cross, corners over faces are looked at too: a cube that turns lands on them."""
    random = np.random.default_rng(1)
    q = np.concatenate([[*random.uniform(-0.06, 0.06, 2), 0.15 + 0.17 * k, *random.normal(size=4)] for k in range(4)])
    shapes = {f"b{k}": (E.Box((SIDE,) * 3),) for k in range(4)}
    scene = tl.Scene(boxes(4), boxes(4).normalize(q), effects=[E.Gravity(), E.Contact(shapes=shapes, friction=0.4)])
    run = stepped(scene, 0.35, STEP, samples=500)
    assert run.contact_record["overlap"] < 5e-5
    assert deepest(run) < 5e-5


@pytest.mark.parametrize("deep", [1e-5, 1e-3])
def test_features_that_look_at_each_other_decide_how_far_large_hulls_are_apart(deep: float) -> None:
    """Of hulls of up to 400 corners, placed so that they overlap, from normals that are off by some degrees."""
    random, large = np.random.default_rng(4), [stone(400, 5), stone(60, 6), SHAPES["box"]]
    for k in range(12):
        shapes = [large[k % 2], large[k % 3]]
        places, a, b = overlapping(shapes, deep, random)
        rough = places[0][1] / np.linalg.norm(places[0][1])
        parts = facing(a, b, rough)
        assert len(parts[0].edges) <= len(a.edges)
        assert_near(separation(*parts).gap, depth(shapes, places), 1e-10)
        if k % 2 and k % 3:
            assert separation(*parts).gap == separation(a, b).gap


def test_the_hull_of_many_corners_is_kept_by_its_content(monkeypatch: pytest.MonkeyPatch) -> None:
    """A second process, which knows the file alone, has the same hull."""
    shape = stone(300, 7)
    first = hull_of.__wrapped__(shape)
    monkeypatch.setattr(hulls, "_hull_of_points", None)
    again = hull_of.__wrapped__(shape)
    assert np.array_equal(first.normals, again.normals)
    assert [face.tolist() for face in first.faces] == [face.tolist() for face in again.faces]


def grid_of_a_cube(seed: int) -> Convex:
    """The corners of a cube of 0.2 m, and points of its faces and edges, in any order."""
    across = np.linspace(-0.1, 0.1, 5)
    grid = np.array([x for x in itertools.product(across, across, across) if np.abs(x).max() > 0.09])
    return Convex(tuple(map(tuple, np.random.default_rng(seed).permutation(grid).tolist())))


def rounded_cube(across: int) -> Convex:
    """A cube of 0.2 m with so many points along its edges, turned in its file, which has single precision, as STL."""
    steps, rpy = np.linspace(-0.1, 0.1, across), (0.3, 0.5, 0.7)
    points = np.array([x for x in itertools.product(steps, steps, steps) if np.abs(x).max() > 0.09])
    rounded = (points @ pin.rpy.rpyToMatrix(*rpy)).astype(np.float32).astype(float)
    return Convex(tuple(map(tuple, rounded.tolist())), rpy=rpy)


def test_corners_in_single_precision_make_whole_faces() -> None:
    """A cube's triangles are six faces, and it stands on all of one, whatever points lie on its edges and faces."""
    ground, turn = hull_of(Box((1.0, 1.0, 0.2))), pin.rpy.rpyToMatrix(0.3, 0.5, 0.7)
    for across in (2, 3, 5, 9):
        assert len(hull_of(rounded_cube(across)).faces) == 6
        points = touching(hull_of(rounded_cube(across)).placed(turn, np.array([0.0, 0.0, 0.2])), ground, 1e-6)
        middles = np.array([point.middle for point in points])
        assert_near(np.ptp(middles, axis=0), [0.2, 0.2, 0.0], 1e-7)


def test_prisms_in_single_precision_touch_as_they_do_in_double() -> None:
    """With many sides of any width: contacts were lost, and a face counted as the hole of another."""
    random, ground = np.random.default_rng(3), hull_of(Box((0.2, 0.15, 0.3)))
    for count in range(5, 40):
        angles = np.sort(random.uniform(0.0, 2.0 * np.pi, count))
        ring = 0.06 * np.column_stack([np.cos(angles), np.sin(angles)])
        corners = np.concatenate([np.insert(ring, 2, height, axis=1) for height in (-0.1, 0.1)])
        turned = corners @ pin.exp3(random.normal(size=3)) + random.uniform(-0.1, 0.1, 3)
        both = [hull_of(Convex(tuple(map(tuple, turned.astype(kind).tolist())))) for kind in (np.float64, np.float32)]
        rotation, origin = pin.exp3(random.normal(size=3)), random.normal(0.0, 0.2, 3)
        apart = separation(both[0].placed(rotation, origin), ground)
        origin -= (apart.gap + random.uniform(0.0, 1e-3)) * apart.normal
        points = [touching(hull.placed(rotation, origin), ground, 5e-3) for hull in both]
        assert len(points[0]) == len(points[1])
        first, second = (min((one.gap for one in each), default=1.0) for each in points)
        assert_near(first, second, 1e-6)


def test_points_inside_of_faces_change_no_touch() -> None:
    """Flat and turned a little, on a larger cube."""
    random, ground = np.random.default_rng(3), hull_of(Box((0.3, 0.3, 0.3)))
    for seed, turn in enumerate((0.0, 1e-9, 1e-3, 0.3)):
        bodies, rotation = (
            (hull_of(grid_of_a_cube(seed)), hull_of(Box((0.2,) * 3))),
            pin.exp3(turn * random.normal(size=3)),
        )
        for origin in random.uniform(0.2, 0.26, (9, 3)) * [0.3, 0.3, 1.0]:
            found, expected = (sorted([*one.middle, one.gap] for one in touching(body, ground, 0.2))
                               for body in (one.placed(rotation, origin) for one in bodies))  # fmt: skip
            assert_near(found, expected, 1e-12)


def test_points_inside_of_faces_and_rounding_change_no_run() -> None:
    """Cubes that fall flat on a box, slide and turn with it."""
    ends = []
    q, v = [0, 0, 0.25, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 1], [0.3, 0.1, 0, 0, 0, 0.5, 0, 0, 0, 0, 0, 0]
    held = E.FrameWrench("b", (0.0, 0.0, 3.0), axes="world")
    for shape in (Box((0.2,) * 3), *map(grid_of_a_cube, range(6)), *map(rounded_cube, (2, 3, 5))):
        contact = E.Contact((("a", "b"),), 0.5, shapes={"a": (shape,), "b": (Box((1.0, 1.0, 0.2)),)})
        scene = tl.Scene(free_bodies("a", "b"), q, v, [E.Gravity((0.0, 0.0, -3.0)), held, contact], 0.5)
        ends.append(tl.simulate(scene, contact="stepped", step=5e-3, verify=False).q[-1])
    assert_near(ends, [ends[0]] * 10, 1e-3)


@pytest.mark.parametrize(("names", "way"), [("ab", "located"), ("abc", "located"), ("abcd", "stepped")])
def test_up_to_24_corners_of_pairs_of_hulls_are_located_and_more_are_stepped(names: str, way: str) -> None:
    contact = E.Contact(("self",), shapes={name: (Box((SIDE,) * 3),) for name in names})
    q = np.concatenate([[0, 0, 2 * SIDE * k, 0, 0, 0, 1] for k in range(len(names))])
    choice = choose_contact_method(tl.Scene(free_bodies(*names), q, effects=[contact]))
    assert choice.method == way
    assert "24" in choice.why


@pytest.mark.parametrize("far", [1e10, 1e20, 1e200])
def test_bodies_that_steps_have_thrown_away_are_no_error(far: float) -> None:
    """Worlds of the gripper ended in an error of NumPy: so far away, a box has edges without length."""
    cube = hull_of(E.Box((SIDE, SIDE, SIDE)))
    for turned in np.random.default_rng(0).uniform(-2, 2, (20, 3)):
        one, other = cube.placed(np.eye(3), np.zeros(3)), cube.placed(pin.exp3(turned), far * turned)
        found = touching(one, other, 1e9 * far)
        assert all(np.isinf(point.gap) or point.gap > 1e-3 * far for point in found)


@pytest.mark.parametrize("count", [100, 150])
def test_a_body_stands_on_a_face_of_many_corners(count: int) -> None:
    """The native library keeps 128 corners of a face; on one of more a body fell through."""
    ring = [(0.5 * np.cos(x), 0.5 * np.sin(x)) for x in np.arange(count) * 2 * np.pi / count]
    disc = E.Convex(tuple((x, y, z) for z in (-0.1, 0.1) for x, y in ring))
    body = E.Convex(((0.1, 0.0, -0.05), (-0.05, 0.09, -0.05), (-0.05, -0.09, -0.05), (0.0, 0.0, 0.15)))
    scene = tl.Scene(tl.load_robot("world")).with_object(E.Box((0.01,) * 3), name="disc")
    scene = scene.with_object(E.Box((0.05,) * 3), (0.1, 0.05, 0.16), mass=1.0, name="body")
    contact = E.Contact((("disc", "body"),), 0.5, shapes={"disc": (disc,), "body": (body,)})
    run = stepped(scene.with_effects([E.Gravity(), contact]), 0.3, 2e-3)
    assert_near(run.q[-1, :3], [0.1, 0.05, 0.15], 1e-6)
