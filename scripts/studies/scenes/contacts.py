"""Random scenes with contacts, by kinds, for the study of silent wrong numbers.

billiard, spin, incline: with exact motions, see `motions`. Without:
tumble    a block, capsule, cylinder or convex body that falls on the ground
edges     a ball that falls on a fixed box, cylinder, capsule or ball
arm       an arm of 2 or 3 joints that hits a table, or itself; every other one has stops and dry friction
bodies    two free bodies over the ground, which meet
mixed     two free bodies of any shapes over the ground, which meet
and of boxes and convex meshes that touch each other at corners, sides and edges:
slab      a hull that tumbles on a large one, whose truth is the run on a plane in its place
ledge     a hull that falls on the edges of a fixed one of its size, with friction or without, turned in any way
hulls     two free hulls that meet, in free flight or in free fall
plate     a plate that slides over the edge of a table, straight or at a slant
"""

import itertools
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin

import twolink as tl
from scripts.studies.scenes import robots as made
from scripts.studies.scenes.motions import billiard, incline, spin
from scripts.studies.scenes.robots import Case, Moments, Truth, direction, law, reach, turn, uniform
from twolink import effects as fx
from twolink.robots.collisions import AnyShape

FINER = 1e-3  # of the accuracy: that of a truth which is a run


def of_box(a: float, b: float, c: float) -> Moments:
    """The moments of inertia per kg of a box of half the edges a, b and c."""
    return (b * b + c * c) / 3, (a * a + c * c) / 3, (a * a + b * b) / 3


def a_shape(random: np.random.Generator, kinds: tuple[str, ...]) -> tuple[AnyShape, Moments]:
    """A shape, and the moments of inertia per kg of a body that it bounds."""
    a, b, c = (uniform(random, 0.05, 0.25) for _ in range(3))
    box = of_box(a, b, c)
    match str(random.choice(kinds)):
        case "sphere":
            return fx.Sphere(a), (0.4 * a * a,) * 3
        case "box":
            return fx.Box((2 * a, 2 * b, 2 * c)), box
        case "capsule":
            return fx.Capsule(a, 2 * b), (a * a / 4 + (b + a) ** 2 / 3,) * 2 + (a * a / 2,)
        case "cylinder":
            return fx.Cylinder(a, 2 * b), (a * a / 4 + b * b / 3,) * 2 + (a * a / 2,)
        case "convex":
            cloud = np.round(random.uniform(-1, 1, (7, 3)) * (a, b, c), 4).tolist()
            return fx.Convex(tuple((x, y, z) for x, y, z in cloud)), box
    return fx.Sphere(a, (b, 0.0, 0.0)), (0.4 * a * a, 0.4 * a * a + b * b, 0.4 * a * a + b * b)


def tumble(random: np.random.Generator) -> Case:
    shape, moments = a_shape(random, ("box", "capsule", "cylinder", "convex", "sphere off centre"))
    mass, numbers = uniform(random, 0.3, 3.0), law(random)
    robot = made.free_robot(("body", mass, made.times(mass, moments)))
    flat, low = False, reach(shape)
    if isinstance(shape, fx.Box) and random.random() < 0.25:
        flat, low = True, float(shape.size[2]) / 2
    high = low + uniform(random, 0.0, 0.3)
    v = random.uniform(-1, 1, 6) * (1, 1, 1, 6, 6, 6) * (0 if flat and random.random() < 0.5 else 1)
    contact = fx.Contact(("ground",), **numbers, shapes={"body": (shape,)})
    q = [0, 0, high, *((0, 0, 0, 1) if flat else turn(random))]
    scene = tl.Scene(robot, q, v, [made.gravity(9.75), contact])
    what = f"{type(shape).__name__.lower()}{' flat' if flat else ''}, {numbers}"
    return Case(what, scene, uniform(random, 0.3, 1.0), made.accuracy_of(random, -8))


def edges(random: np.random.Generator) -> Case:
    shape, _ = a_shape(random, ("box", "capsule", "cylinder", "sphere"))
    radius, mass, numbers = uniform(random, 0.01, 0.2), uniform(random, 0.3, 3.0), law(random)
    robot = made.free_robot(("ball", mass, (0.4 * mass * radius**2,) * 3), base=True)
    contact = fx.Contact((("ball", "base"),), **numbers, shapes={"base": (shape,), "ball": (fx.Sphere(radius),)})
    side = random.uniform(-1, 1, 2) * (reach(shape) * 0.4)
    high = reach(shape) + radius + uniform(random, 0.0, 0.4)
    v = [*random.uniform(-0.3, 0.3, 2), random.uniform(-3, 0), *random.uniform(-9, 9, 3)]
    scene = tl.Scene(robot, [*side, high, *turn(random)], v, [made.gravity(9.75), contact])
    return Case(f"ball on {type(shape).__name__.lower()}, {numbers}", scene, uniform(random, 0.3, 1.0),
                made.accuracy_of(random, -8))  # fmt: skip


def arm(random: np.random.Generator) -> Case:
    """Links of spheres and capsules on hinges, over a table; the last one's end and the others may hit it."""
    count, planar = int(random.integers(2, 4)), random.random() < 0.5
    text, shapes, before = "", {}, 0.0
    for k in range(count):
        length, radius = uniform(random, 0.25, 0.5), uniform(random, 0.03, 0.06)
        mass = uniform(random, 0.3, 3.0)
        axis = "0 1 0" if planar else " ".join(map(repr, map(float, direction(random))))
        moments = mass * length**2 / 9, mass * length**2 / 9, mass * radius**2
        text += made.body(f"l{k}", mass, moments, "revolute", f"j{k}",
                     parent=f"l{k - 1}" if k else "world", com=f"0 0 {-length / 2}", at=f"0 0 {-before}",
                     axis=axis)  # fmt: skip
        kind = str(random.choice(["sphere", "capsule", "box"]))
        middle, end = (0.0, 0.0, -length / 2), (0.0, 0.0, -length)
        shapes[f"l{k}"] = ({"sphere": fx.Sphere(radius, end), "capsule": fx.Capsule(radius, length, middle),
                            "box": fx.Box((radius, 2 * radius, 2 * radius), end)}[kind],)  # fmt: skip
        before = length + 0.02
    robot = made.robot_of(text)
    q, v = random.uniform(0.5, 1.6, count) * random.choice([-1, 1]), random.uniform(-3, 3, count)
    high = min(-uniform(random, 0.1, 0.7), lowest(robot, q, shapes) - 0.02)
    table = fx.Plane(height=high)
    pairs: list = [(f"l{k}", table) for k in range(count)]
    if count == 3 and all(not isinstance(shape[0], fx.Box) for shape in (shapes["l0"], shapes["l2"])):
        pairs.append(("l0", "l2"))
    numbers = law(random)
    damping = [fx.JointDamping({"j0": uniform(random, 0.0, 1.0)})] if random.random() < 0.5 else []
    effects = [made.gravity(9.75), *damping, fx.Contact(tuple(pairs), **numbers, shapes=shapes)]
    what = f"{count} joints{', planar' if planar else ''}, {numbers}"
    return Case(what, tl.Scene(robot, q, v, effects), uniform(random, 0.3, 1.2), made.accuracy_of(random, -8))


def lowest(robot: tl.Robot, q: np.ndarray, shapes: dict) -> float:
    """Below every shape."""
    places = [robot.frame_pose(robot.normalize(q), name) for name in shapes]
    return min(float((p + r @ np.array(shape.point))[2]) - reach(shape)
               for (r, p), (shape,) in zip(places, shapes.values(), strict=True))  # fmt: skip


def jointed(scene: tl.Scene, random: np.random.Generator) -> tl.Scene:
    """The scene of an arm with stops and dry friction in its joints."""
    stops = {f"j{k}": (x - uniform(random, 0.2, 1.0), x + uniform(random, 0.2, 1.0)) for k, x in enumerate(scene.q)}
    friction = {name: uniform(random, 0.05, 0.5) for name in stops}
    joints = [fx.JointStops(stops, float(random.choice([0.0, 0.5]))), fx.DryFriction(friction)]
    return scene.with_effects([*scene.effects, *joints])


def two_bodies(random: np.random.Generator, draw: Callable[[], tuple[AnyShape, Moments]]) -> tuple[tl.Robot, Any]:
    """Two free bodies, and their shapes."""
    parts: list[tuple[str, float, Moments]] = []
    shapes = dict[str, tuple[AnyShape, ...]]()
    for name in "ab":
        shape, moments = draw()
        mass, shapes[name] = uniform(random, 0.3, 3.0), (shape,)
        parts.append((name, mass, made.times(mass, moments)))
    return made.free_robot(*parts), shapes


def bodies(random: np.random.Generator, kinds: tuple[str, ...] = ("sphere", "capsule", "sphere off centre")) -> Case:
    numbers = law(random)
    robot, shapes = two_bodies(random, lambda: a_shape(random, kinds))
    apart = reach(shapes["a"][0]) + reach(shapes["b"][0]) + uniform(random, 0.01, 0.5)
    line = direction(random) * apart
    high = 1.5 * apart
    speed = -line / apart * uniform(random, 0.5, 8.0)
    q = [0, 0, high, *turn(random), line[0], line[1], line[2] + high, *turn(random)]
    v = np.concatenate([np.zeros(3), random.uniform(-5, 5, 3), np.zeros(3), random.uniform(-5, 5, 3)])
    v[6:9] = pin.Quaternion(np.array(q[10:14])).matrix().T @ speed
    contact = fx.Contact(("self", "ground"), **numbers, shapes=shapes)
    kinds = " and ".join(type(shape[0]).__name__.lower() for shape in shapes.values())
    scene = tl.Scene(robot, q, v, [made.gravity(9.75), contact] if random.random() < 0.7 else [contact])
    return Case(f"{kinds}, {numbers}", scene, uniform(random, 0.3, 1.0), made.accuracy_of(random, -8))


def mixed(random: np.random.Generator) -> Case:
    return bodies(random, ("sphere", "box", "capsule", "cylinder", "convex"))


def a_hull(random: np.random.Generator, most: float = 0.25) -> tuple[AnyShape, Moments]:
    """A hull, and the moments of inertia per kg of a body that it bounds."""
    a, b, c = (uniform(random, 0.2 * most, most) for _ in range(3))
    match str(random.choice(["box", "box", "cube", "mesh box", "octahedron", "tetrahedron", "stone"])):
        case "box":
            shape: AnyShape = fx.Box((2 * a, 2 * b, 2 * c))
        case "cube":
            b = c = a
            shape = fx.Box((2 * a, 2 * a, 2 * a))
        case "mesh box":
            shape = meshed((a, b, c))
        case "octahedron":
            shape = fx.Convex(tuple(tuple(s * size * (k == i) for k in range(3))
                                    for i, size in enumerate((a, b, c)) for s in (1.0, -1.0)))  # fmt: skip
        case "tetrahedron":
            corners = (1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)
            shape = fx.Convex(tuple((x * a, y * b, z * c) for x, y, z in corners))
        case _:
            cloud = np.round(random.uniform(-1, 1, (7, 3)) * (a, b, c), 4)
            shape = fx.Convex(tuple(map(tuple, (cloud - cloud.mean(axis=0)).tolist())))
    return shape, of_box(a, b, c)


def meshed(half: Moments, point: Moments = (0.0, 0.0, 0.0), rpy: Moments = (0.0, 0.0, 0.0)) -> fx.Convex:
    """A box as a mesh."""
    return fx.Convex(tuple(itertools.product(*((-x, x) for x in half))), point, rpy)


def on_plane(scene: tl.Scene, duration: float, accuracy: float) -> Truth:
    """The motion with a plane z = 0 in place of the ground's hull."""

    def truth(t: np.ndarray) -> np.ndarray:
        run = tl.simulate(scene, duration, accuracy=max(1e-11, FINER * accuracy), contact="located")
        return run.at(t)[0][:, :3]

    return truth


def slab(random: np.random.Generator) -> Case:
    shape, moments = a_hull(random)
    mass, numbers = uniform(random, 0.3, 3.0), law(random)
    half, rpy = (9.0, 9.0, 1.0), (0.0, 0.0, uniform(random, 0.0, 3.0))
    mesh = random.random() < 0.5
    floor = meshed(half, (0.0, 0.0, -1.0), rpy) if mesh else fx.Box((18.0, 18.0, 2.0), (0.0, 0.0, -1.0), rpy)
    robot = made.free_robot(("body", mass, made.times(mass, moments)), base=True)
    flat = isinstance(shape, fx.Box) and random.random() < 0.3
    low = shape.size[2] / 2 if flat else reach(shape)
    q = [0, 0, low + uniform(random, 0.0, 0.3), *((0, 0, 0, 1) if flat else turn(random))]
    v = random.uniform(-1, 1, 6) * (1, 1, 1, 6, 6, 6) * (0 if flat and random.random() < 0.5 else 1)
    duration, accuracy = uniform(random, 0.2, 0.5), made.accuracy_of(random, -8)
    pair = ("body", "base") if random.random() < 0.5 else ("base", "body")
    scenes = [tl.Scene(robot, q, v, [made.gravity(9.75), fx.Contact((pair,), **numbers, shapes=shapes)])
              for pair, shapes in ((pair, {"body": (shape,), "base": (floor,)}),
                                   (("body", fx.Plane()), {"body": (shape,)}))]  # fmt: skip
    what = f"{_kind(shape)}{' flat' if flat else ''} on a {'mesh' if mesh else 'box'}, {numbers}"
    return Case(what, scenes[0], duration, accuracy, on_plane(scenes[1], duration, accuracy), "located")


def ledge(random: np.random.Generator) -> Case:
    shape, moments = a_hull(random, 0.15)
    fixed, _ = a_hull(random, 0.25)
    mass, numbers = uniform(random, 0.3, 3.0), law(random)
    way = str(random.choice(["upright", "on edge", "any"], p=[0.25, 0.25, 0.5]))
    rpy = {"upright": (0.0, 0.0, 0.0), "on edge": (math.pi / 4, 0.0, 0.0)}.get(
        way, tuple(map(float, random.uniform(-2, 2, 3))))  # fmt: skip
    fixed = type(fixed)(fixed.size if isinstance(fixed, fx.Box) else fixed.vertices, (0.0, 0.0, 0.0), rpy)  # type: ignore
    robot = made.free_robot(("body", mass, made.times(mass, moments)), base=True)
    side = random.uniform(-1, 1, 2) * 0.6 * reach(fixed)
    high = reach(fixed) + reach(shape) + uniform(random, 0.0, 0.2)
    own = [(0, 0, 0, 1), (0, math.sin(math.pi / 8), 0, math.cos(math.pi / 8)), turn(random)][random.integers(3)]
    v = random.uniform(-1, 1, 6) * (0.5, 0.5, 1, 5, 5, 5) * (0 if random.random() < 0.3 else 1)
    contact = fx.Contact((("body", "base"),), **numbers, shapes={"body": (shape,), "base": (fixed,)})
    scene = tl.Scene(robot, [*side, high, *own], v, [made.gravity(9.75), contact])
    what = f"{_kind(shape)} on {_kind(fixed)} {way}, {numbers}"
    return Case(what, scene, uniform(random, 0.3, 0.7), made.accuracy_of(random, -8), way="located")


def hulls(random: np.random.Generator) -> Case:
    numbers = law(random)
    robot, shapes = two_bodies(random, lambda: a_hull(random))
    apart = sum(reach(shape) for (shape,) in shapes.values()) + uniform(random, 0.01, 0.3)
    line = direction(random) * apart
    own = [list(turn(random)) if random.random() < 0.7 else [0, 0, 0, 1] for _ in "ab"]
    q = [0, 0, 0, *own[0], *line, *own[1]]
    spin = random.uniform(-5, 5, (2, 3)) * (random.random() < 0.7)
    speed = -line / apart * uniform(random, 0.5, 8.0)
    v = np.concatenate([np.zeros(3), spin[0], pin.Quaternion(np.array(own[1], float)).matrix().T @ speed, spin[1]])
    contact = fx.Contact(("self",), **numbers, shapes=shapes)
    scene = tl.Scene(robot, q, v, [made.gravity(9.75), contact] if random.random() < 0.3 else [contact])
    what = f"{' and '.join(_kind(shape) for (shape,) in shapes.values())}, {numbers}"
    return Case(what, scene, uniform(random, 0.3, 0.7), made.accuracy_of(random, -8), way="located")


def plate(random: np.random.Generator) -> Case:
    a, b, c = (uniform(random, low, high) for low, high in ((0.1, 0.25), (0.05, 0.2), (0.01, 0.08)))
    mass, numbers = uniform(random, 0.3, 3.0), law(random)
    slant = float(random.choice([0.0, uniform(random, -1.5, 1.5)]))
    robot = made.free_robot(("body", mass, made.times(mass, of_box(a, b, c))), base=True)
    shape = meshed((a, b, c)) if random.random() < 0.3 else fx.Box((2 * a, 2 * b, 2 * c))
    table = fx.Box((1.0, 1.0, 0.4), (-0.5, 0.0, -0.2))
    way = uniform(random, -0.4, 0.4)
    speed = uniform(random, 0.3, 1.5)
    world = speed * np.array([math.cos(way), math.sin(way), 0.0])
    own = [0.0, 0.0, math.sin(slant / 2), math.cos(slant / 2)]
    v = [*(pin.Quaternion(np.array(own)).matrix().T @ world), 0, 0, 0]
    contact = fx.Contact((("body", "base"),), **numbers, shapes={"body": (shape,), "base": (table,)})
    q = [-uniform(random, 0.02, 0.3), uniform(random, -0.4, 0.4), c, *own]
    scene = tl.Scene(robot, q, v, [made.gravity(9.75), contact])
    return Case(f"{_kind(shape)} slant {slant:.2f}, {numbers}", scene, uniform(random, 0.3, 0.6),
                made.accuracy_of(random, -8), way="located")  # fmt: skip


def _kind(shape: AnyShape) -> str:
    return "box" if isinstance(shape, fx.Box) else f"mesh of {len(shape.vertices)}"


MAKERS = (billiard, spin, incline, tumble, edges, arm, bodies, mixed, slab, ledge, hulls, plate)
KINDS = tuple(make.__name__ for make in MAKERS)


def case(number: int, seed: int) -> Case:
    """The scene of this number, of kind KINDS[number % len(KINDS)]."""
    make = MAKERS[number % len(MAKERS)]
    one = make(np.random.default_rng([seed, number]))
    if make is arm and number // len(MAKERS) % 2:
        return replace(one, scene=jointed(one.scene, np.random.default_rng([seed, number, 2])))
    return one
