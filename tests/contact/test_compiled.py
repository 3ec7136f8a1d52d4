"""Steps of the native library are those of the contact law in NumPy, from the same state and memory."""

import math

import numpy as np
import pytest

import twolink as tl
from scripts.studies.steps import SAME, difference, pairs_of_steps
from tests.dynamics import robots
from tests.effects.bodies import free_bodies, grounded, spheres, stepped
from tests.near import assert_near
from twolink.contact import compiled, stepping
from twolink.contact.bodies import FreeBodies
from twolink.contact.compiled_steps import take_steps
from twolink.contact.impulses import EXACT
from twolink.contact.solver import stepper_of
from twolink.contact.steps import Step, plan_steps
from twolink.robots.collisions import AnyShape

E = tl.effects
TETRAHEDRON = E.Convex(((0.1, 0.0, -0.05), (-0.07, 0.08, -0.05), (-0.06, -0.09, -0.05), (0.01, 0.0, 0.12)))
PRISM = E.Convex(
    tuple((0.06 * math.cos(a), 0.06 * math.sin(a), z) for a in (0.3, 1.4, 2.4, 3.9, 5.0) for z in (-0.1, 0.1))
)
POINTS = np.random.default_rng(5).normal(size=(40, 3))
STONE = E.Convex(tuple(tuple(x) for x in (0.1 * POINTS / np.linalg.norm(POINTS, axis=1)[:, None]).tolist()))
SHAPES: dict[str, tuple[AnyShape, ...]] = {
    "balls": (E.Sphere(0.1), E.Sphere(0.07), E.Sphere(0.12)),
    "capsules": (E.Capsule(0.05, 0.2), E.Sphere(0.08), E.Capsule(0.06, 0.1, (0.02, 0.0, 0.0), (0.5, 0.2, 0.0))),
    "boxes": (E.Box((0.2, 0.16, 0.1)), E.Box((0.1, 0.1, 0.3), (0.0, 0.01, 0.02), (0.1, 0.0, 0.3))),
    "balls and a box": (E.Sphere(0.1), E.Box((0.3, 0.2, 0.2)), E.Sphere(0.05)),
    "balls and a cylinder": (E.Sphere(0.1), E.Cylinder(0.1, 0.15), E.Sphere(0.05)),
    "meshes": (TETRAHEDRON, PRISM, E.Box((0.2, 0.1, 0.15))),
    "meshes of many edges": (STONE, STONE, E.Box((0.2, 0.1, 0.15))),
    "what has no formula": (E.Cylinder(0.1, 0.15), E.Capsule(0.05, 0.2), E.Box((0.2, 0.1, 0.15))),
}


def require_same(one: Step, other: Step) -> None:
    """All that a step says and remembers, but forces that motions do not determine."""
    same = SAME * max(1.0, np.abs(one.v).max())
    assert_near(other.v, one.v, same)
    assert_near(other.q, one.q, same)
    assert other.h == one.h
    assert_near(other.h * other.mean, one.h * one.mean, same)
    a, b = one.memory, other.memory
    assert np.array_equal(a.keys, b.keys)
    assert np.array_equal(a.stuck, b.stuck)
    assert np.array_equal(a.still, b.still)
    assert b.change == pytest.approx(a.change, rel=1e-6, abs=1e-6)
    assert_near(b.overlap, a.overlap, 1e-12)
    assert b.unfollowed == pytest.approx(a.unfollowed, rel=1e-6, abs=1e-12)
    assert (one.impulses is None) == (other.impulses is None)
    assert len(one.keys) == len(other.keys)
    if one.joints is None:  # with friction in joints, those of contacts need not be determined
        assert_near(other.on_first.sum(axis=0), one.on_first.sum(axis=0), 1e-8)
    assert len(one.blows) == len(other.blows)
    for blow, same in zip(one.blows, other.blows, strict=True):
        assert_near(same.late, blow.late, 1e-9)
        assert np.array_equal(np.sort(blow.keys), np.sort(same.keys))
    assert (one.joints is None) == (other.joints is None)


def require_same_steps(scene: tl.Scene, h: float, count: int) -> None:
    """Steps are the same; a few may differ whose laws have several solutions, which both obey."""
    others, touched = 0, 0
    for one, other in pairs_of_steps(stepper_of(scene), h, count):
        touched += one.impulses is not None
        if difference(one, other) > SAME:
            others += 1
            assert other.impulses.residual <= EXACT
        else:
            require_same(one, other)
    assert touched > 0
    assert others <= 0.05 * count


def thrown(kind: str, seed: int, restitution: float) -> tl.Scene:
    """Bodies that fall onto each other and onto a plane that is inclined."""
    random, shapes = np.random.default_rng(seed), SHAPES[kind]
    names = tuple("abc"[: len(shapes)])
    robot = free_bodies(*names)
    places = np.zeros((len(names), 7))
    places[:, :2], places[:, 3:] = random.uniform(-0.02, 0.02, (len(names), 2)), random.normal(size=(len(names), 4))
    places[:, 2] = 0.25 + 0.4 * np.arange(len(names))
    v = random.uniform(-1.0, 1.0, (len(names), 6))
    v[:, 2] -= np.arange(len(names)) + 1.0
    plane = E.Plane((0.1, -0.2, 1.0), -0.1)
    placed = {name: (shape,) for name, shape in zip(names, shapes, strict=True)}
    contact = E.Contact(("self", *((name, plane) for name in names)), 0.3, static=0.5, restitution=restitution,
                        threshold=0.3, shapes=placed)  # fmt: skip
    return tl.Scene(robot, robot.normalize(places.ravel()), v.ravel(), [E.Gravity(), contact])


@pytest.mark.parametrize(
    ("seed", "restitution"),
    [
        (0, 0.0),
        *(pytest.param(seed, e, marks=pytest.mark.slow) for seed, e in ((1, 0.0), (2, 0.0), (0, 0.6), (1, 0.6))),
    ],
)
@pytest.mark.parametrize("kind", SHAPES)
def test_steps_of_shapes_are_those_of_the_law(kind: str, seed: int, restitution: float) -> None:
    require_same_steps(thrown(kind, seed, restitution), 0.005, 120)


@pytest.mark.parametrize(("seed", "least"), [(0, 0.03), (1, 0.03), (2, 0.0), (3, 0.0)])
def test_steps_of_balls_on_rough_ground_are_those_of_the_law(seed: int, least: float) -> None:
    """The largest is wider than a cell, the least, or a point, falls over an edge; one begins with its middle below."""
    random, radii = np.random.default_rng(seed), {"a": 0.12, "b": least, "c": 0.07}
    ground = E.HeightField(random.uniform(0.0, 0.1, (9, 7)), (0.1, 0.13), (-0.4, -0.4, 0.0))
    places = {"a": (0.0, 0.0, 0.25), "b": (0.37, 0.3, 0.2), "c": (-0.2, 0.15, 0.22)}
    contact = E.Contact(("self", *((name, ground) for name in radii)), 0.4, restitution=0.3,
                        shapes={name: (E.Sphere(radius),) for name, radius in radii.items()})  # fmt: skip
    robot = free_bodies(*radii)
    q = np.concatenate([[*place, 0.0, 0.0, 0.0, 1.0] for place in places.values()])
    scene = tl.Scene(robot, q, random.uniform(-1.0, 1.0, robot.nv), [E.Gravity(), contact])
    assert stepper_of(scene).price == 1.0
    require_same_steps(scene, 0.002, 150)
    q[16] = -0.02
    below = stepper_of(scene).starting_at(q, 0.0 * scene.v)
    assert below.overlap(q)[0] > 0.07
    for one, other in pairs_of_steps(below, 0.002, 5):
        require_same(one, other)


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 8))])
@pytest.mark.parametrize("kind", ["capsules", "boxes", "meshes", "meshes of many edges", "what has no formula"])
def test_steps_of_shapes_on_rough_ground_are_those_of_the_law(kind: str, seed: int) -> None:
    """Corners on triangles, edges on ridges, faces on peaks, sides, rims and ends; cells of their size and smaller."""
    scene, random = thrown(kind, seed, 0.3 * (seed % 2)), np.random.default_rng(seed)
    cell, (contact,) = random.uniform(0.05, 0.3, 2), (one for one in scene.effects if isinstance(one, E.Contact))
    heights = random.choice([0.02, 0.2]) * random.uniform(-1.0, 0.0, (15, 13))
    ground = E.HeightField(heights, tuple(cell.tolist()), (*(-6.3 * cell).tolist(), 0.0))
    on_ground = E.Contact(tuple((name, ground) for name in contact.shapes), 0.3, static=0.5,
                          restitution=contact.restitution, threshold=0.3, shapes=contact.shapes)  # fmt: skip
    scene = scene.with_effects([E.Gravity(), on_ground])
    assert stepper_of(scene).price == 1.0
    require_same_steps(scene, 0.003, 120)


def test_steps_of_many_free_bodies_with_effects_are_those_of_the_law() -> None:
    names = tuple(f"b{k}" for k in range(22))
    robot, random = free_bodies(*names), np.random.default_rng(1)
    places = np.zeros((22, 7))
    places[:, :3] = 0.3 * np.array([(k % 4, k // 4 % 4, k // 16) for k in range(22)]) + random.uniform(
        -0.02, 0.02, (22, 3)
    )
    places[:, 2] += 0.2
    places[:, 6] = 1.0
    contact = E.Contact(("self", "ground"), 0.3, shapes=spheres(*names))
    pushes = [E.FrameWrench(name, (0.5 * k, 0.3, -2.0), point=(0.0, 0.1, 0.0)) for k, name in enumerate(names[:4])]
    scene = tl.Scene(robot, places.ravel(), random.uniform(-2.0, 2.0, 132), [E.Gravity(), contact, *pushes])
    assert isinstance(stepper_of(scene).bodies, FreeBodies)
    require_same_steps(scene, 0.005, 60)


def on_plane(name: str, seed: int) -> tl.Scene:
    """A robot with balls on its links, one just above a plane; with stops, dry friction, springs and dampers."""
    robot, random = robots.of_every_kind()[name], np.random.default_rng(seed)
    (q,), (v,) = robot.random_state(1, seed=seed)
    single = [
        joint for joint in robot.joints if joint.v.stop == joint.v.start + 1 and joint.q.stop == joint.q.start + 1
    ]
    links = [link for link in robot.frame_names if robot.model.frames[robot.model.getFrameId(link)].parentJoint]
    chosen = sorted(set(random.choice(links, size=min(4, len(links)), replace=False).tolist()))
    shapes = {link: (E.Sphere(0.05, tuple(random.uniform(-0.1, 0.1, 3).tolist())),) for link in chosen}
    low = min(float(_centre(robot, q, link, shapes[link][0].point)[2]) for link in chosen) - 0.051
    plane = E.Plane((0.0, 0.0, 1.0), low)
    contact = E.Contact(tuple((link, plane) for link in chosen), 0.4, restitution=0.3, shapes=shapes)
    effects: list[tl.effects.Effect] = [E.Gravity(), contact]
    if single:
        stops = {joint.name: (float(q[joint.q.start]) - 0.02, float(q[joint.q.start]) + 0.05) for joint in single[:2]}
        effects += [E.JointStops(stops), E.JointDamping({joint.name: 0.3 for joint in single}),
                    E.JointSpring({joint.name: 5.0 for joint in single})]  # fmt: skip
    if single[1:]:
        rubs = [joint.name for joint in (single[-1:] if seed else single)]
        effects.append(E.DryFriction(dict.fromkeys(rubs, 0.5), dict.fromkeys(rubs, 0.7)))
    return tl.Scene(robot, q, 0.3 * v, effects)


def _centre(robot: tl.Robot, q: np.ndarray, link: str, point: tuple[float, ...]) -> np.ndarray:
    rotation, origin = robot.frame_pose(q, link)
    return np.asarray(rotation @ np.array(point) + origin)


@pytest.mark.parametrize("name", ["two_link", "chain", "planar", "spherical", "kinova", "panda", "anymal"])
def test_steps_of_every_kind_of_joint_are_those_of_the_law(name: str) -> None:
    for seed in range(2):
        require_same_steps(on_plane(name, seed), 0.002, 60)


def in_loop(name: str, seed: int) -> tl.Scene:
    """A robot as `on_plane`, whose last link is pinned to the world."""
    scene, random = on_plane(name, seed), np.random.default_rng(seed)
    link, point = scene.robot.frame_names[-1], random.uniform(-0.05, 0.05, 3)
    pin = E.PointLoop(link, point_a=tuple(point.tolist()), point_b=tuple(_centre(scene.robot, scene.q, link, point)))
    return tl.Scene(scene.robot, scene.q, scene.v, [*scene.effects, pin])


@pytest.mark.parametrize("name", ["chain", "planar", "kinova", "panda", "anymal"])
def test_steps_of_robots_with_loops_are_those_of_the_law(name: str) -> None:
    for seed in range(2):
        require_same_steps(in_loop(name, seed), 0.002, 60)


def test_bodies_in_one_loop_are_one_island() -> None:
    """Two balls on a plane, each with a link of a chain that a pin closes between them."""
    robot = free_bodies("a", "b")
    q = np.array([0.0, 0, 0.1, 0, 0, 0, 1, 0.3, 0, 0.1, 0, 0, 0, 1])
    pin = E.PointLoop("a", "b", point_a=(0.15, 0.0, 0.05), point_b=(-0.15, 0.0, 0.05))
    v = np.array([0.3, 0.2, -0.5, 0, 0, 0, 0.3, 0.2, -0.5, 0, 0, 0])
    require_same_steps(grounded(robot, q, v, pin, friction=0.4, restitution=0.2, shapes=spheres(*"ab")), 0.004, 120)


@pytest.mark.parametrize(
    "name", ["box-stack", "grasp", "can-on-table", "arm-pushes-box", "quadruped-stands", "dominoes", "marble-run"]
)
def test_bundled_scenes_have_the_same_run(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = tl.load_scene(name)

    def run() -> tl.Trajectory:
        return stepped(scene, 0.25, 0.005, samples=40)

    assert stepper_of(scene).native is not None
    ours = run()
    monkeypatch.setattr(stepping, "take_steps", lambda *_: None)
    theirs = run()
    assert_near(ours.q, theirs.q, 1e-9)
    assert_near(ours.v, theirs.v, 1e-7)
    assert ours.contact_record["solvers"] == theirs.contact_record["solvers"]
    assert_near(ours.contact_record["overlap"], theirs.contact_record["overlap"], 1e-9)


def test_a_step_at_rest_has_its_overlap() -> None:
    """All steps behind it are the same: NumPy would look for the overlap at each sample."""
    stepper = stepper_of(tl.load_scene("box-stack"))
    plan = plan_steps(stepper.equations, np.array([0.0, 1.0]), 0.01, 0)
    q, v, memory = stepper.begin
    found = take_steps(stepper.native, stepper.bodies, plan, range(100), q, v, memory)
    last = found[len(found) - 1]
    assert last.memory.rest is not None
    assert_near(last.overlap, stepper.overlap(last.q)[0], 1e-15)


def test_what_the_library_does_not_take_is_taken_by_numpy(monkeypatch: pytest.MonkeyPatch) -> None:
    assert stepper_of(thrown("balls", 0, 0.5)).native is not None
    monkeypatch.setattr(compiled, "library", lambda: None)
    assert stepper_of(thrown("balls", 0, 0.5)).native is None
