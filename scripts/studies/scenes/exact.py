"""Random scenes whose exact motions are known, by kinds, for the study of error bars.

smooth    random trees of 2 or 3 joints, some with a floating base; "auto" or a named method
joints    continuous and planar joints: pendulums that swing and that turn over, free bodies, random pairs of joints
unstable  pendulums beside upright, double pendulums upside down
toppling  the same by every method by name, and bodies that begin to turn over
long      pendulums and oscillators for 500 to 4,000 s
loops     a pendulum, or a double one, whose weights slide on gantries that loops close
events    balls that bounce, stops, dry friction
limit     any of these at an accuracy near the best that double precision reaches
worlds    eight worlds of a pendulum, an arm or a random tree, or beside upright, by `simulate_many`
between   smooth and event scenes with few samples, whose states are asked for between them

Truths: closed forms (elliptic functions in 60 digits, parabolas, half cosines) where there are any; else Taylor series
of 19 digits, of a tree without loops. Scenes of the same block share their robots, so that there is less to compile.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import mpmath as mp
import numpy as np

import twolink as tl
from scripts.studies.scenes import robots as made
from scripts.studies.scenes.motions import between_stops, bouncing_ball, elastic_ball, stick_slip
from twolink import effects as fx
from twolink.hard import truths
from twolink.hard.truths import extended_reference

BLOCK = 60  # scenes that share robots: six of each kind
AUTO = 2 / 3  # the share of smooth scenes for method "auto"
# The finest accuracy asked of a method: beyond, it takes minutes, and says nothing new.
FINEST = {
    "taylor": -11, "dop853": -11, "rk45": -9, "rk23": -6, "esdirk43": -6, "suzuki4": -5, "rk4": -6,
    "implicit-midpoint": -3.5, "midpoint": -4, "semi-implicit-euler": -3, "scipy-dop853": -9, "scipy-lsoda": -7,
    "scipy-rk45": -8, "scipy-radau": -6,
}  # fmt: skip
WORLDS = 8
Truth = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Configurations (n, nq) at times (n,), and their own error (n,), rad or m."""


@dataclass(frozen=True)
class Case:
    """A scene to simulate, and its truth.

    limit: the accuracy is this many times the best that is reached. samples: how many; 0: as the study has them.
    """

    what: str
    scene: tl.Scene
    duration: float
    truth: Truth
    accuracy: float = 1e-6
    method: str = "auto"
    limit: float = 0.0
    samples: int = 0


@dataclass(frozen=True)
class Worlds:
    """Starts q (n, nq), v (n, nv) to simulate at once."""

    what: str
    scene: tl.Scene
    q: np.ndarray
    v: np.ndarray
    duration: float
    accuracy: float


def smooth(shared: np.random.Generator, random: np.random.Generator) -> Case:
    tree, name = made.random_scene(shared, {2: 0.6, 3: 0.4}, floating=0.1)
    scene = _elsewhere(tree, random)
    method = "auto" if random.random() < AUTO else str(random.choice(list(FINEST)))
    one = Case(name, scene, made.uniform(random, 1, 8), partial(extended_reference, scene), method=method)
    return replace(one, accuracy=_accuracy(random, FINEST.get(method, -11)))


def joints(shared: np.random.Generator, random: np.random.Generator) -> Case:
    kind = int(random.integers(4))
    if kind == 0:
        one = free_body(random)
    elif kind == 1:
        one = whirling(random)
    elif kind == 2:
        one = swinging(random, "continuous", made.uniform(random, 5, 60))
    else:
        tree, name = made.random_scene(shared, {2: 1.0}, floating=0.0, kinds={"continuous": 0.8, "prismatic": 0.2})
        scene = _elsewhere(tree, random)
        one = Case(name, scene, made.uniform(random, 2, 20), partial(extended_reference, scene))
    return _asked(one, random, -11)


def unstable(shared: np.random.Generator, random: np.random.Generator) -> Case:
    if random.random() < 0.5:
        g, mass, com, inertia = made.constants(random)
        w0 = made.frequency(g, mass, com, inertia)
        start = float(10 ** random.uniform(-12, -2))
        duration = min(20.0, float((math.log(1 / start) + random.uniform(-1, 4)) / w0))
        robot = made.pendulum("revolute", mass, com, inertia)  # com is above the joint
        one = Case("toppling", tl.Scene(robot, [start], effects=[made.gravity(g)]), duration,
                   _closed(truths.toppling(start, w0)))  # fmt: skip
    else:
        g, *rods = (made.constants(shared) for _ in range(3))
        robot = made.double_pendulum([rod[1:] for rod in rods])
        q = [math.pi, 0.0] + 10 ** random.uniform(-9, -2) * random.uniform(-1, 1, 2)
        scene = tl.Scene(robot, q, effects=[made.gravity(g[0])])
        # Beside an equilibrium two solutions of 19 digits may round alike, and agree though both are wrong.
        truth = partial(extended_reference, scene, quad=True)
        one = Case("inverted double", scene, made.uniform(random, 2, 8), truth)
    return _asked(one, random, -11)


def toppling(shared: np.random.Generator, random: np.random.Generator) -> Case:
    """Starts beside a saddle, by every method by name."""
    one = unstable(shared, random)
    method = str(random.choice([*FINEST, "auto"]))
    if "pendulum" not in one.what and one.what != "toppling" and FINEST.get(method, -11) > -6:
        method = "rk45"  # a double pendulum would take fixed steps for minutes
    return replace(one, method=method, accuracy=_accuracy(random, max(FINEST.get(method, -11), -9)))


def long(shared: np.random.Generator, random: np.random.Generator) -> Case:
    del shared
    duration = made.uniform(random, 500, 4000)
    if random.random() < 0.25:
        mass, stiffness, start = (float(random.integers(8, 32)) / 16 for _ in range(3))
        robot = made.slider(mass)
        scene = tl.Scene(robot, [start], effects=[fx.JointSpring({"joint": stiffness})])
        one = Case("oscillator", scene, duration, _closed(truths.oscillation(start, mp.sqrt(mp.mpf(stiffness) / mass))))
    else:
        one = swinging(random, str(random.choice(["revolute", "continuous"])), duration)
    return _asked(one, random, -8, ("auto", "auto", "dop853"))


def loops(shared: np.random.Generator, random: np.random.Generator) -> Case:
    duration = made.uniform(random, 1, 10)
    return _asked(gantry(shared, random, 1 + int(random.integers(2)), duration), random, -10)


def events(shared: np.random.Generator, random: np.random.Generator) -> Case:
    del shared
    kind = int(random.integers(4))
    motion = (elastic_ball, bouncing_ball, between_stops, stick_slip)[kind](random)
    return _asked(_of(motion), random, -10)


def limit(shared: np.random.Generator, random: np.random.Generator) -> Case:
    kind = int(random.integers(5))
    if kind == 0:
        rods = [made.constants(shared)[1:] for _ in range(2)]
        q, v = random.uniform(-3, 3, 2), random.uniform(-3, 3, 2)
        scene = tl.Scene(made.double_pendulum(rods), q, v, [made.gravity(9.75)])
        one = Case("double pendulum", scene, made.uniform(random, 5, 30), partial(extended_reference, scene))
    elif kind == 1:
        one = swinging(random, str(random.choice(["revolute", "continuous"])), made.uniform(random, 100, 2000))
    elif kind == 2:
        one = _of(elastic_ball(random))
    elif kind == 3:
        one = gantry(shared, random, 1, made.uniform(random, 1, 10))
    else:
        scene = _elsewhere(made.random_scene(shared, {2: 1.0}, floating=0.0)[0], random)
        one = Case("tree", scene, made.uniform(random, 2, 10), partial(extended_reference, scene))
    method = str(random.choice(["auto", "dop853"]))
    return replace(one, method=method, limit=made.uniform(random, 1.02, 3.0))


def between(shared: np.random.Generator, random: np.random.Generator) -> Case:
    """A few samples: the states between them are asked for."""
    one = (smooth, joints, events)[int(random.integers(3))](shared, random)
    return replace(one, samples=int(random.integers(1, 20)), accuracy=max(one.accuracy, 1e-10))


def worlds(shared: np.random.Generator, random: np.random.Generator) -> Worlds:
    kind = int(shared.integers(4))
    if kind == 3:
        g, mass, com, inertia = made.constants(shared)
        scene = tl.Scene(made.pendulum("revolute", mass, com, inertia), effects=[made.gravity(g)])
        starts = 10 ** random.uniform(-10, -3, (WORLDS, 1))
        return Worlds("beside upright", scene, starts, np.zeros((WORLDS, 1)), made.uniform(random, 2, 8),
                      _accuracy(random, -9))  # fmt: skip
    if kind == 0:
        g, *rod = made.constants(shared)
        scene = tl.Scene(made.pendulum(str(shared.choice(["revolute", "continuous"])), *rod), effects=[made.gravity(g)])
    elif kind == 1:
        scene = tl.load_scene("arm-swing")
    else:
        scene = made.random_scene(shared, {2: 1.0}, floating=0.0)[0]
    starts = [_elsewhere(scene, random) for _ in range(WORLDS)]
    q, v = (np.array([getattr(start, name) for start in starts]) for name in "qv")
    return Worlds(scene.robot.name, scene, q, v, made.uniform(random, 1, 20), _accuracy(random, -12))


def swinging(random: np.random.Generator, kind: str, duration: float) -> Case:
    """A pendulum released at rest: Jacobi's elliptic functions."""
    g, mass, com, inertia = made.constants(random)
    start = made.uniform(random, 0.1, 3.0)
    robot = made.pendulum(kind, mass, -com, inertia)
    exact = truths.swing(start, made.frequency(g, mass, com, inertia))
    if kind == "continuous":
        scene = tl.Scene(robot, [math.cos(start), math.sin(start)], effects=[made.gravity(g)])
        return Case("pendulum, continuous", scene, duration, _closed(exact, turns=True))
    return Case("pendulum", tl.Scene(robot, [start], effects=[made.gravity(g)]), duration, _closed(exact))


def whirling(random: np.random.Generator) -> Case:
    """A pendulum that starts upright and keeps turning."""
    g, mass, com, inertia = made.constants(random)
    rate = made.uniform(random, 1, 6)
    robot = made.pendulum("continuous", mass, com, inertia)
    exact = truths.whirl(rate, made.frequency(g, mass, com, inertia), (1.0,))
    scene = tl.Scene(robot, [1.0, 0.0], [rate], effects=[made.gravity(g)])
    # `whirl` counts pi / 2 minus the angle from upright.
    return Case("whirling", scene, made.uniform(random, 5, 60), _closed(lambda t: math.pi / 2 - exact(t), turns=True))


def free_body(random: np.random.Generator) -> Case:
    """A body on a planar joint that turns evenly, while its centre of mass moves on a parabola."""
    x, y = (float(k) / 16 for k in random.integers(-8, 9, 2))
    robot = made.robot_of(made.body("body", 1.0, 0.25, "planar", com=f"{x} {y} 0"))
    vx, vy, rate = (float(k) / 16 for k in random.integers(-32, 33, 3))
    g = float(random.integers(0, 3)) * 2.5

    def exact(t: np.ndarray) -> np.ndarray:
        t = t.astype(np.longdouble)
        c, s = np.cos(rate * t), np.sin(rate * t)
        centre_x, centre_y = x + (vx - rate * y) * t, y + (vy + rate * x) * t - g * t * t / 2
        return np.stack([centre_x - (c * x - s * y), centre_y - (s * x + c * y), c, s], axis=1)

    scene = tl.Scene(robot, v=[vx, vy, rate], effects=[fx.Gravity((0.0, -g, 0.0))] if g else [])
    return Case("free plate", scene, made.uniform(random, 1, 30), _closed(exact))


def gantry(shared: np.random.Generator, random: np.random.Generator, rods: int, duration: float) -> Case:
    """Rods that hang from each other; at each one's end a loop holds a weight that slides along x and z."""
    g = float(shared.integers(150, 165)) / 16
    chain = [made.constants(shared)[1:] for _ in range(rods)]
    weights = [float(k) / 16 for k in shared.integers(4, 32, rods)]
    q0 = random.uniform(-1.2, 1.2, rods)
    tree = made.double_pendulum(chain, weights)
    plain = tl.Scene(tree, q0, effects=[made.gravity(g)])
    text, closing = made.rods_text(chain), []
    for k, weight in enumerate(weights, 1):
        text += made.body(f"rail{k}", 0.0, 0.0, "prismatic", f"x{k}", axis="1 0 0")
        text += made.body(f"weight{k}", weight, 0.0625, "prismatic", f"z{k}", parent=f"rail{k}")
        closing.append(fx.PointLoop(f"rod{k}", f"weight{k}", point_a=(0.0, 0.0, -1.0)))

    def everything(angles: np.ndarray) -> np.ndarray:
        absolute = np.cumsum(angles, axis=1)
        x, z = -np.cumsum(np.sin(absolute), axis=1), -np.cumsum(np.cos(absolute), axis=1)
        return np.concatenate([angles, np.stack([x, z], axis=2).reshape(len(angles), -1)], axis=1)

    robot = made.robot_of(text)
    start, count = {joint.name: joint.q.start for joint in robot.joints}, range(1, rods + 1)
    places = [start[f"{kind}{k}"] for kinds in (["joint"], "xz") for k in count for kind in kinds]
    q = np.empty(robot.nq)
    q[places] = everything(q0[None])[0]
    scene = tl.Scene(robot, q, effects=[made.gravity(g), *closing])
    if rods == 1:
        mass, com, inertia = chain[0]
        square = mp.mpf(g) * (mass * com + weights[0]) / (inertia + mp.mpf(mass) * com**2 + weights[0])
        angle = _closed(truths.swing(float(q0[0]), mp.sqrt(square)))
    else:
        angle = partial(extended_reference, plain)

    def truth(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        angles, doubt = angle(t)
        out = np.empty((len(t), robot.nq), angles.dtype)
        out[:, places] = everything(angles)
        return out, 2 * rods * doubt + 4e-16

    return Case(f"gantry, {rods} rods", scene, duration, truth)


def _closed(exact: Callable[[np.ndarray], np.ndarray], *, turns: bool = False) -> Truth:
    """A truth in closed form, exact but for its last digit. turns: of an angle, as (cos, sin)."""

    def truth(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        q = exact(t)
        doubt = np.abs(q).max(axis=1).astype(float) * np.finfo(float).eps
        return (np.concatenate([np.cos(q), np.sin(q)], axis=1) if turns else q), doubt

    return truth


def _of(motion: made.Case) -> Case:
    return Case(motion.what, motion.scene, motion.duration, _closed(motion.truth))


def _elsewhere(scene: tl.Scene, random: np.random.Generator) -> tl.Scene:
    """The scene from another random state."""
    robot, lively = scene.robot, random.uniform(0.0, 3.0)
    q = robot.integrate(robot.neutral, random.uniform(-1.5, 1.5, robot.nv))
    return tl.Scene(robot, q, random.uniform(-1, 1, robot.nv) * lively, effects=scene.effects)


def _accuracy(random: np.random.Generator, finest: float) -> float:
    return float(10 ** random.uniform(finest, -3))


def _asked(one: Case, random: np.random.Generator, finest: float, methods: tuple[str, ...] = ("auto",)) -> Case:
    return replace(one, accuracy=_accuracy(random, finest), method=str(random.choice(methods)))


MAKERS = (smooth, joints, unstable, toppling, long, loops, events, limit, worlds, between)
KINDS = tuple(make.__name__ for make in MAKERS)


def case(number: int, seed: int) -> Case | Worlds:
    """The scene of this number, of kind KINDS[number % 10]."""
    shared = np.random.default_rng([seed, number // BLOCK, number % len(KINDS)])
    return MAKERS[number % len(KINDS)](shared, np.random.default_rng([seed, 1_000_000 + number]))
