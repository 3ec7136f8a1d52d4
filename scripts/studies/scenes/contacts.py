"""Random scenes with contacts, by kinds, for the study of silent wrong numbers.

billiard, spin, incline: with exact motions, see `contact_motions`. Without:
tumble    a block, capsule, cylinder or convex body that falls on the ground
edges     a ball that falls on a fixed box, cylinder, capsule or ball
arm       an arm of 2 or 3 joints that hits a table, or itself
bodies    two free bodies over the ground, which meet
slab, ledge, hulls, plate: boxes and meshes that touch each other, see `contact_hulls`.
"""

import numpy as np
import pinocchio as pin
from contact_hulls import hulls, ledge, plate, slab
from contact_motions import LINK, Case, accuracy_of, billiard, free_robot, incline, spin
from contact_random import direction, law, reach, times, turn
from honest_robots import JOINT, LIMIT, gravity, uniform

import twolink as tl
from twolink import effects as fx
from twolink.robots.shapes import AnyShape

KINDS = ("billiard", "spin", "incline", "tumble", "edges", "arm", "bodies", "slab", "ledge", "hulls", "plate")


def case(number: int, seed: int) -> Case:
    """The scene of this number, of kind KINDS[number % len(KINDS)]."""
    random = np.random.default_rng([seed, number])
    kind = KINDS[number % len(KINDS)]
    make = {"billiard": billiard, "spin": spin, "incline": incline, "tumble": tumble, "edges": edges, "arm": arm,
            "bodies": bodies, "slab": slab, "ledge": ledge, "hulls": hulls, "plate": plate}[kind]  # fmt: skip
    return make(random)


def a_shape(random: np.random.Generator, kinds: tuple[str, ...]) -> tuple[AnyShape, tuple[float, float, float]]:
    """A shape, and the moments of inertia per kg of a body that it bounds."""
    a, b, c = (uniform(random, 0.05, 0.25) for _ in range(3))
    box = (b * b + c * c) / 3, (a * a + c * c) / 3, (a * a + b * b) / 3
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
    robot = free_robot(("body", mass, times(mass, moments)))
    flat, low = False, reach(shape)
    if isinstance(shape, fx.Box) and random.random() < 0.25:
        flat, low = True, float(shape.size[2]) / 2
    high = low + uniform(random, 0.0, 0.3)
    v = random.uniform(-1, 1, 6) * (1, 1, 1, 6, 6, 6) * (0 if flat and random.random() < 0.5 else 1)
    contact = fx.Contact(("ground",), **numbers, shapes={"body": (shape,)})
    q = [0, 0, high, *((0, 0, 0, 1) if flat else turn(random))]
    scene = tl.Scene(robot, q, v, [gravity(9.75), contact])
    what = f"{type(shape).__name__.lower()}{' flat' if flat else ''}, {numbers}"
    return Case(what, scene, uniform(random, 0.3, 1.0), accuracy_of(random, -8))


def edges(random: np.random.Generator) -> Case:
    shape, _ = a_shape(random, ("box", "capsule", "cylinder", "sphere"))
    radius, mass, numbers = uniform(random, 0.01, 0.2), uniform(random, 0.3, 3.0), law(random)
    robot = free_robot(("ball", mass, (0.4 * mass * radius**2,) * 3), base=True)
    contact = fx.Contact((("ball", "base"),), **numbers, shapes={"base": (shape,), "ball": (fx.Sphere(radius),)})
    side = random.uniform(-1, 1, 2) * (reach(shape) * 0.4)
    high = reach(shape) + radius + uniform(random, 0.0, 0.4)
    v = [*random.uniform(-0.3, 0.3, 2), random.uniform(-3, 0), *random.uniform(-9, 9, 3)]
    scene = tl.Scene(robot, [*side, high, *turn(random)], v, [gravity(9.75), contact])
    return Case(f"ball on {type(shape).__name__.lower()}, {numbers}", scene, uniform(random, 0.3, 1.0),
                accuracy_of(random, -8))  # fmt: skip


def arm(random: np.random.Generator) -> Case:
    """Links of spheres and capsules on hinges, over a table; the last one's end and the others may hit it."""
    count, planar = int(random.integers(2, 4)), random.random() < 0.5
    text, shapes, before = '<link name="world"/>', {}, 0.0
    for k in range(count):
        length, radius = uniform(random, 0.25, 0.5), uniform(random, 0.03, 0.06)
        mass = uniform(random, 0.3, 3.0)
        text += LINK.format(name=f"l{k}", com=f"0 0 {-length / 2}", mass=mass,
                            i=(mass * length**2 / 9, mass * length**2 / 9, mass * radius**2))  # fmt: skip
        axis = "0 1 0" if planar else " ".join(map(repr, map(float, direction(random))))
        text += JOINT.format(name=f"j{k}", kind="revolute", parent=f"l{k - 1}" if k else "world", child=f"l{k}",
                             at=f"0 0 {-before}", axis=axis, limit=LIMIT)  # fmt: skip
        kind = str(random.choice(["sphere", "capsule", "box"]))
        middle, end = (0.0, 0.0, -length / 2), (0.0, 0.0, -length)
        shapes[f"l{k}"] = ({"sphere": fx.Sphere(radius, end), "capsule": fx.Capsule(radius, length, middle),
                            "box": fx.Box((radius, 2 * radius, 2 * radius), end)}[kind],)  # fmt: skip
        before = length + 0.02
    robot = tl.load_robot(f'<robot name="arm">{text}</robot>')
    q, v = random.uniform(0.5, 1.6, count) * random.choice([-1, 1]), random.uniform(-3, 3, count)
    high = min(-uniform(random, 0.1, 0.7), lowest(robot, q, shapes) - 0.02)
    table = fx.Plane(height=high)
    pairs: list = [(f"l{k}", table) for k in range(count)]
    if count == 3 and all(not isinstance(shape[0], fx.Box) for shape in (shapes["l0"], shapes["l2"])):
        pairs.append(("l0", "l2"))
    numbers = law(random)
    damping = [fx.JointDamping({"j0": uniform(random, 0.0, 1.0)})] if random.random() < 0.5 else []
    effects = [gravity(9.75), *damping, fx.Contact(tuple(pairs), **numbers, shapes=shapes)]
    what = f"{count} joints{', planar' if planar else ''}, {numbers}"
    return Case(what, tl.Scene(robot, q, v, effects), uniform(random, 0.3, 1.2), accuracy_of(random, -8))


def lowest(robot: tl.Robot, q: np.ndarray, shapes: dict) -> float:
    """Below every shape."""
    places = [robot.frame_pose(robot.normalize(q), name) for name in shapes]
    return min(float((p + r @ np.array(shape.point))[2]) - reach(shape)
               for (r, p), (shape,) in zip(places, shapes.values(), strict=True))  # fmt: skip


def bodies(random: np.random.Generator) -> Case:
    parts: list[tuple[str, float, tuple[float, float, float]]] = []
    shapes, numbers = dict[str, tuple[AnyShape, ...]](), law(random)
    for name in "ab":
        shape, moments = a_shape(random, ("sphere", "capsule", "sphere off centre"))
        mass = uniform(random, 0.3, 3.0)
        shapes[name] = (shape,)
        parts.append((name, mass, times(mass, moments)))
    robot = free_robot(*parts)
    apart = reach(shapes["a"][0]) + reach(shapes["b"][0]) + uniform(random, 0.01, 0.5)
    line = direction(random) * apart
    high = 1.5 * apart
    speed = -line / apart * uniform(random, 0.5, 8.0)
    q = [0, 0, high, *turn(random), line[0], line[1], line[2] + high, *turn(random)]
    v = np.concatenate([np.zeros(3), random.uniform(-5, 5, 3), np.zeros(3), random.uniform(-5, 5, 3)])
    v[6:9] = pin.Quaternion(np.array(q[10:14])).matrix().T @ speed
    contact = fx.Contact(("self", "ground"), **numbers, shapes=shapes)
    kinds = " and ".join(type(shape[0]).__name__.lower() for shape in shapes.values())
    scene = tl.Scene(robot, q, v, [gravity(9.75), contact] if random.random() < 0.7 else [contact])
    return Case(f"{kinds}, {numbers}", scene, uniform(random, 0.3, 1.0), accuracy_of(random, -8))
