"""Random scenes of all that steps with contacts know, some of it in each."""

import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np

import twolink as tl
from scripts.studies.scenes import robots as made
from scripts.studies.scenes.contacts import a_hull, a_shape, lowest
from scripts.studies.scenes.robots import law, reach, turn, uniform
from twolink import effects as fx
from twolink.contact.solver import stepper_of
from twolink.errors import SceneError
from twolink.robots.collisions import AnyShape

TRIES = 60  # of places where bodies are apart
SHAPES = ("sphere", "box", "capsule", "cylinder", "convex", "sphere off centre")
KINDS = ("revolute", "continuous", "prismatic")
Shapes = dict[str, tuple[AnyShape, ...]]


def scene_of(seed: int, number: int) -> tl.Scene:
    """The scene of a number: up to three free bodies and an arm of up to three joints, over ground of some kind."""
    random = np.random.default_rng([seed, number])
    names, kinds = "abc"[: random.integers(1, 4)], [str(x) for x in random.choice(KINDS, size=random.integers(4))]
    text, shapes = "", Shapes()
    for name in names:
        shape, moments = a_hull(random) if random.random() < 0.3 else a_shape(random, SHAPES)
        mass, shapes[name] = uniform(random, 0.3, 3.0), (shape,)
        text += made.body(name, mass, made.times(mass, moments), "floating", f"{name}_joint")
    for k, kind in enumerate(kinds):
        radius, mass, at = uniform(random, 0.03, 0.06), uniform(random, 0.3, 3.0), (0.0, 0.0, -0.2)
        text += made.body(f"l{k}", mass, (0.04 * mass, 0.04 * mass, mass * radius**2), kind, f"j{k}",
                          parent=f"l{k - 1}" if k else "world", com="0 0 -0.15", at=f"0 0 {-0.3 if k else 0.0}",
                          axis=" ".join(map(repr, made.direction(random).tolist())))  # fmt: skip
        shapes[f"l{k}"] = ((fx.Sphere(radius, at), fx.Capsule(radius, 0.1, at), fx.Box((radius, 0.1, 0.1), at))
                           [random.integers(3)],)  # fmt: skip
    robot = made.robot_of(text)
    for _ in range(TRIES):
        q, v, low = _start(robot, names, kinds, shapes, random)
        single = {one.name: float(q[one.q.start]) for one in robot.joints if one.kind == "vector"}
        effects = [*_contacts(names, shapes, low, random), *_on_joints(single, kinds, random)]
        scene = tl.Scene(robot, q, v, [*effects, *_others(robot, q, names, random)])
        try:
            stepper_of(scene)
        except SceneError as error:
            if error.code != "overlap":
                raise
            continue
        return scene
    raise AssertionError(f"no place for the bodies of scene {number}")


def _start(
    robot: tl.Robot, names: str, kinds: list[str], shapes: Shapes, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, float]:
    """A state, and the height of the ground: the bodies are around and above the arm's lowest point."""
    q, v = robot.neutral + 0.0, random.uniform(-1.0, 1.0, robot.nv)
    free = {joint.name: joint for joint in robot.joints}
    for k, kind in enumerate(kinds):
        angle = random.uniform(-1.5, 1.5) * (0.2 if kind == "prismatic" else 1.0)
        q[free[f"j{k}"].q] = [np.cos(angle), np.sin(angle)] if kind == "continuous" else angle
    links = {name: one for name, one in shapes.items() if name not in names}
    low = min(-0.3, lowest(robot, q, links) if links else 0.0) - uniform(random, 0.001, 0.05)
    for name in names:
        high = low + reach(shapes[name][0]) + uniform(random, 0.001, 0.5)
        q[free[f"{name}_joint"].q] = [*random.uniform(-0.4, 0.4, 2), high, *turn(random)]
        v[free[f"{name}_joint"].v] *= (1.0, 1.0, 2.0, 4.0, 4.0, 4.0)
    return robot.normalize(q), v, low


def _contacts(names: str, shapes: Shapes, low: float, random: np.random.Generator) -> list[fx.Effect]:
    """One law of what touches, or one of the ground and one of bodies; some pairs do not touch."""
    slope = random.uniform(-0.2, 0.2, 2) * (random.random() < 0.5)
    cell, heights = random.uniform(0.06, 0.4, 2), random.choice([0.0, 0.02, 0.2]) * random.uniform(-1, 0, (17, 17))
    field = fx.HeightField(heights, tuple(cell.tolist()), (*(-8.2 * cell).tolist(), low))
    box = fx.Box((3.0, 3.0, 0.2), (0.0, 0.0, low - 0.1))
    ground: Any = (fx.Plane((*slope.tolist(), 1.0), low - 0.2 * float(np.abs(slope).sum())), field, "world")[
        random.integers(3)]  # fmt: skip
    shapes = {**shapes, "world": (box,)} if ground == "world" else shapes
    on_ground = tuple((name, ground) for name in shapes if name != "world")
    others = tuple((a, b) for a, b in itertools.combinations((name for name in shapes if name != "world"), 2)
                   if a in names)  # fmt: skip
    if others and random.random() < 0.5:
        return [fx.Contact(on_ground, **_law(random), shapes=shapes), fx.Contact(others, **_law(random), shapes=shapes)]
    left_out = others[:1] if random.random() < 0.3 else ()
    return [fx.Contact((*on_ground, *others), **_law(random), exclude=left_out, shapes=shapes)]


def _law(random: np.random.Generator) -> dict[str, float]:
    """Friction, that of what sticks, restitution and its threshold."""
    numbers = law(random)
    if numbers["friction"] and random.random() < 0.4:
        numbers["static"] = numbers["friction"] * uniform(random, 1.0, 2.0)
    return {**numbers, "threshold": float(random.choice([0.0, 0.3]))}


def _on_joints(q: dict[str, float], kinds: list[str], random: np.random.Generator) -> Iterator[fx.Effect]:
    """Dry friction and dampers of the arm's joints; stops, springs, drives and a gear where q is one."""
    every = [f"j{k}" for k, _ in enumerate(kinds)]
    if every and random.random() < 0.4:
        yield fx.DryFriction(dict.fromkeys(every, 0.3), dict.fromkeys(every, float(random.choice([0.3, 0.5]))))
    if every and random.random() < 0.4:
        yield fx.JointDamping({name: uniform(random, 0.1, 3.0) for name in every})
    if q and random.random() < 0.3:
        yield fx.JointSpring({name: uniform(random, 1.0, 9.0) for name in q})
    if q and random.random() < 0.3:
        yield fx.JointPD(dict.fromkeys(q, 0.3), dict.fromkeys(q, 30.0), dict.fromkeys(q, 5.0))
    if q and random.random() < 0.5:
        stops = {name: (x - uniform(random, 0.001, 0.1), x + uniform(random, 0.001, 0.1)) for name, x in q.items()}
        yield fx.JointStops(stops, float(random.choice([0.0, 0.5])))
    if len(q) > 1 and random.random() < 0.3:
        (joint, x), (other, y) = itertools.islice(q.items(), 2)
        yield fx.Coupling(joint, other, 0.7, x - 0.7 * y)


def _others(robot: tl.Robot, q: np.ndarray, names: str, random: np.random.Generator) -> Iterator[fx.Effect]:
    """Gravity, a push, and a point that two bodies share."""
    if random.random() < 0.9:
        yield made.gravity(9.75)
    if random.random() < 0.3:
        yield fx.FrameWrench("a", (0.5, 0.3, -2.0), point=(0.0, 0.1, 0.0))
    if len(names) > 1 and random.random() < 0.3:
        (r, x), (turned, y) = (robot.frame_pose(q, name) for name in "ab")
        points = (turn.T @ (0.5 * (x + y) - at) for turn, at in ((r, x), (turned, y)))
        yield fx.PointLoop("a", "b", *(tuple(point.tolist()) for point in points))
