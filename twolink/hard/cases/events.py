"""Cases with events: dry friction, stops, infinitely many bounces; bodies that touch, slide and roll."""

import functools
import itertools
import math

import numpy as np

from twolink import effects as fx
from twolink.dynamics import load_robot
from twolink.errors import AccuracyError
from twolink.hard import truths
from twolink.hard.case import FOLDER, ErrorCheck
from twolink.scenes import Scene
from twolink.simulation.scene_run import simulate

GRAVITY = 9.81


def _stiction(t: np.ndarray) -> np.ndarray:
    """Half cosines about F/k on either side, each shorter by 2 F/k, until the spring is weaker than the friction."""
    w, reach = 10.0, 0.47 / 100.0
    half = math.pi / w
    last = math.ceil((1.0 - reach) / (2 * reach) - 1e-12)  # the half after which |x| <= F/k
    n = np.minimum(np.floor(t / half), last)
    amplitude, sign, moves = 1.0 - 2 * reach * n, (-1.0) ** n, n < last
    moving = (amplitude - reach) * np.cos(w * (t - n * half))
    return (sign * np.where(moves, reach + moving, amplitude))[:, None]


def _grazing(*, hit: bool) -> truths.ExactMotion:
    """cos t; after each hit of the stop at -1 + 1e-10 with restitution 0.5 a slightly smaller, shifted cosine."""
    stop, restitution = -1.0 + (1e-10 if hit else -1e-10), 0.5

    def exact(t: np.ndarray) -> np.ndarray:
        amplitude, phase, start = 1.0, 0.0, 0.0
        out = np.cos(t)
        while hit and amplitude > -stop and start < t[-1]:
            angle = math.pi - math.acos(-stop / amplitude)  # of the cosine where it falls to the stop
            wait = (angle - phase) % (2 * math.pi)
            start += wait if wait > 1e-9 else wait + 2 * math.pi
            speed = restitution * math.sqrt(amplitude**2 - stop**2)
            amplitude, phase = math.hypot(stop, speed), math.atan2(-speed, stop)
            out = np.where(t >= start, amplitude * np.cos(t - start + phase), out)
        return np.asarray(out)[:, None]

    return exact


def _bounces(t: np.ndarray) -> np.ndarray:
    """Parabolas, each half as fast as the one before; 0 after the last."""
    restitution, first = 0.5, math.sqrt(2 / GRAVITY)
    out = np.where(t <= first, 1.0 - GRAVITY * t**2 / 2, 0.0)
    start, speed = first, restitution * GRAVITY * first
    while speed > 1e-15:
        s = t - start
        out = np.where((s > 0) & (s <= 2 * speed / GRAVITY), speed * s - GRAVITY * s**2 / 2, out)
        start, speed = start + 2 * speed / GRAVITY, restitution * speed
    return out[:, None]


def _two_stops(t: np.ndarray) -> np.ndarray:
    """cos 2t between -0.5 and 1, reflected without loss: periodic with 2 pi / 3."""
    s = np.mod(t, 2 * math.pi / 3)
    return np.repeat(np.cos(2 * np.minimum(s, 2 * math.pi / 3 - s))[:, None], 2, axis=1)


def _to_and_fro(t: np.ndarray) -> np.ndarray:
    """1.7 m/s between -1 and 1 m, from 0 on: a triangle of 4 m."""
    way = np.mod(1.7 * t + 1.0, 4.0)
    return (np.minimum(way, 4.0 - way) - 1.0)[:, None]


def _slide(t: np.ndarray) -> np.ndarray:
    """3 m/s, decelerated by mu g = 3.924 m/s^2 until it rests."""
    s = np.minimum(t, 3.0 / 3.924)
    return np.asarray(3.0 * s - 3.924 * s**2 / 2)[:, None]


def _slip_to_roll(t: np.ndarray) -> np.ndarray:
    """Slides with -mu g and spins up with 5 mu g / 2 R until 2 v0 / (7 mu g), then rolls; as a pose."""
    v0, mu, radius = 2.0, 0.2, 0.1085
    inertia = 0.0329623 / (7.0 * radius**2)  # over m R^2: 0.4 up to the digits of the file
    end = v0 / (mu * GRAVITY * (1.0 + 1.0 / inertia))
    s, after = np.minimum(t, end), np.maximum(t - end, 0.0)
    speed = v0 - mu * GRAVITY * end
    x = v0 * s - mu * GRAVITY * s**2 / 2 + speed * after
    angle = (mu * GRAVITY / (inertia * radius)) * s**2 / 2 + speed / radius * after
    zero = np.zeros_like(t)
    return np.stack([x, zero, zero + radius, zero, np.sin(angle / 2), zero, np.cos(angle / 2)], axis=1)


def painleve(mu: float) -> Scene:
    """A rod at 60 degrees whose lower end slides on the ground towards the side it leans to."""
    robot = load_robot(FOLDER / "rod.urdf")
    lean = math.pi / 3
    q = [0.0, 0.5 * math.sin(lean), lean]
    contact = fx.PlaneContact("rod", point=(-0.5, 0.0, 0.0), friction=mu)
    return Scene(robot, q, [-1.0, 0.0, 0.0], [fx.Gravity(), contact], 0.2)


_ROBOT = """<robot name="{name}"><link name="ground"/>{bodies}</robot>"""
_BODY = """<link name="{name}"><inertial><mass value="{mass}"/>
<inertia ixx="{i[0]}" iyy="{i[1]}" izz="{i[2]}" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="{name}_joint" type="{joint}"><parent link="ground"/><child link="{name}"/><axis xyz="1 0 0"/>
<limit lower="-1e3" upper="1e3" effort="1" velocity="1e3"/></joint>"""

SPEED, FAR, RADIUS = 400.0, 21.0, 0.1  # of the bullet; to the centre of what it hits; of both


def bullet() -> Scene:
    """A ball of 1 kg hits one of 2 kg along x, without restitution."""
    bodies = "".join(_BODY.format(name=name, mass=mass, i=(1.0, 1.0, 1.0), joint="prismatic")
                     for name, mass in (("bullet", 1.0), ("target", 2.0)))  # fmt: skip
    shapes = {name: (fx.Sphere(RADIUS),) for name in ("bullet", "target")}
    contact = fx.Contact((("bullet", "target"),), shapes=shapes)
    robot = load_robot(_ROBOT.format(name="bullet", bodies=bodies))
    return Scene(robot, [0.0, FAR], [SPEED, 0.0], [contact], 0.2)


def _bullet(t: np.ndarray) -> np.ndarray:
    """After (FAR - 2 r) / v both move on with v / 3."""
    late = np.maximum(t - (FAR - 2 * RADIUS) / SPEED, 0.0)
    return np.stack([SPEED * (t - late) + SPEED / 3 * late, FAR + SPEED / 3 * late], axis=1)


MASS, RIM, HALF, LEAN = 0.5, 0.1, 0.004, 1.1  # of the coin: kg, m, half its thickness, and its axis from vertical
ACROSS, ALONG = MASS * (RIM**2 / 4 + HALF**2 / 3), MASS * RIM**2 / 2  # moments of inertia
UP = np.array([0.0, 0.0, 1.0])
AXIS = np.array([math.sin(LEAN), 0.0, math.cos(LEAN)])
TURNING = 9.0 * UP - 2.0 * AXIS


def coin() -> Scene:
    """A coin that rolls on the rim of its lower side, with friction enough."""
    body = _BODY.format(name="coin", mass=MASS, i=(ACROSS, ACROSS, ALONG), joint="floating")
    r = _touching(AXIS, np.cross(TURNING, AXIS))[0]
    c, s = math.cos(LEAN), math.sin(LEAN)
    turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    contact = fx.Contact((("coin", "ground"),), friction=2.0, shapes={"coin": (fx.Cylinder(RIM, 2 * HALF),)})
    q = [*-r, 0.0, math.sin(LEAN / 2), 0.0, math.cos(LEAN / 2)]
    v = [*turn.T @ -np.cross(TURNING, r), *turn.T @ TURNING]
    return Scene(load_robot(_ROBOT.format(name="coin", bodies=body)), q, v, [fx.Gravity(), contact], 1.0)


def _touching(axis: np.ndarray, change: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """r from the centre to the point that touches, and its derivative, of the axis u and of u'."""
    down, turned = UP - axis[2] * axis, -change[2] * axis - axis[2] * change
    size = np.linalg.norm(down)
    m = down / size
    return -HALF * axis - RIM * m, -HALF * change - RIM * (turned - m * (m @ turned)) / size


def _rolling(_: float, y: np.ndarray) -> np.ndarray:
    """u' = w x u,  L' = r x m (a + g),  x' = -w x r:  the rate of (u, w, x), and of an angle about the axis."""
    u, w = y[:3], y[3:6]
    change = np.cross(w, u)
    r, dr = _touching(u, change)
    left = ACROSS * np.eye(3) + (ALONG - ACROSS) * np.outer(u, u) + MASS * (r @ r * np.eye(3) - np.outer(r, r))
    right = -(ALONG - ACROSS) * (w @ u) * change + MASS * np.cross(r, GRAVITY * UP - np.cross(w, dr))
    quaternion = y[9:13]
    vector, scalar = quaternion[:3], quaternion[3]
    turned = 0.5 * np.concatenate([scalar * w + np.cross(w, vector), [-w @ vector]])
    return np.concatenate([change, np.linalg.solve(left, right), -np.cross(w, r), turned])


@functools.cache
def _coin_solution() -> object:
    from scipy.integrate import solve_ivp

    r = _touching(AXIS, np.cross(TURNING, AXIS))[0]
    start = [*AXIS, *TURNING, *-r, 0.0, math.sin(LEAN / 2), 0.0, math.cos(LEAN / 2)]
    return solve_ivp(
        _rolling, (0.0, 1.0), start, "DOP853", dense_output=True, rtol=3e-14, atol=1e-14, max_step=1e-3
    ).sol


def _coin(t: np.ndarray) -> np.ndarray:
    """The pose from the equations of rolling."""
    return np.asarray(_coin_solution()(t)[6:].T)  # type: ignore[operator]


BLOCKS, THICK, DEEP = 7, 1.02 * 0.0957041, 0.3  # of the arch: thickness and depth, m; its mean radius is 1 m


def arch() -> Scene:
    """Blocks of a semicircular arch on the ground, 2 % thicker than the static theorem asks for."""
    rays = [np.array([math.cos(k * math.pi / BLOCKS), math.sin(k * math.pi / BLOCKS)]) for k in range(BLOCKS + 1)]
    bodies, shapes, q = "", {}, list[float]()
    for k in range(BLOCKS):
        sides = np.array([(1.0 + side * THICK / 2) * ray for ray in rays[k : k + 2] for side in (-1.0, 1.0)])
        middle = _centroid(sides[[0, 1, 3, 2]])
        corners = [(float(x), y, float(z)) for x, z in sides - middle for y in (-DEEP / 2, DEEP / 2)]
        shapes[f"b{k}"] = (fx.Convex(tuple(corners)),)
        bodies += _BODY.format(name=f"b{k}", mass=1.0, i=(0.05, 0.05, 0.05), joint="floating")
        q += [float(middle[0]), 0.0, float(middle[1]), 0.0, 0.0, 0.0, 1.0]
    joints = [*itertools.pairwise(shapes), ("b0", "ground"), (f"b{BLOCKS - 1}", "ground")]
    contact = fx.Contact(tuple(joints), 1.0, shapes=shapes)
    return Scene(
        load_robot(_ROBOT.format(name="arch", bodies=bodies)), q, effects=[fx.Gravity(), contact], duration=1.0
    )


def _centroid(polygon: np.ndarray) -> np.ndarray:
    """Of a polygon (n, 2)."""
    x, z = polygon.T
    cross = x * np.roll(z, -1) - np.roll(x, -1) * z
    return np.asarray(((polygon + np.roll(polygon, -1, axis=0)) * cross[:, None]).sum(axis=0) / (3 * cross.sum()))


SIDE, WALL, TURNED = 0.071, 3, 1e-7  # of the packed boxes: their side, m, how many are side by side, and by what, rad


def packed() -> Scene:
    """A wall of equal boxes whose faces all but touch, each turned about the vertical by less than can be seen."""
    turns = TURNED * np.random.default_rng(5).uniform(-1.0, 1.0, (WALL, WALL))
    places = list(itertools.product(range(WALL), range(WALL)))
    names = {place: "p{}{}".format(*place) for place in places}
    bodies = "".join(_BODY.format(name=name, mass=0.3, i=(2.5e-4,) * 3, joint="floating") for name in names.values())
    q = [x for i, k in places
         for x in (i * SIDE * (1.0 + TURNED), 0.0, (k + 0.5) * SIDE,
                   0.0, 0.0, math.sin(turns[i, k] / 2), math.cos(turns[i, k] / 2))]  # fmt: skip
    pairs = [(names[i, k], names[i + di, k + dk]) for i, k in places for di, dk in ((1, 0), (0, 1))
             if (i + di, k + dk) in names]  # fmt: skip
    shapes = dict.fromkeys(names.values(), (fx.Box((SIDE, SIDE, SIDE)),))
    contact = fx.Contact((*pairs, *((names[i, 0], "ground") for i in range(WALL))), 0.5, shapes=shapes)
    robot = load_robot(_ROBOT.format(name="packed", bodies=bodies))
    return Scene(robot, q, effects=[fx.Gravity(), contact], duration=1.0)


EXACT = {
    "elastic-stops": _to_and_fro,
    "stiction-reversals": _stiction,
    "grazing-hit": _grazing(hit=True),
    "grazing-miss": _grazing(hit=False),
    "zeno-bounces": _bounces,
    "two-stops-at-once": _two_stops,
    "slide-to-rest": _slide,
    "slip-to-roll": _slip_to_roll,
    "bullet": _bullet,
    "coin": _coin,
    "arch": lambda t: np.tile(arch().q, (len(t), 1)),
    "packed-boxes": lambda t: np.tile(packed().q, (len(t), 1)),
}
SCENES = {"bullet": bullet, "coin": coin, "arch": arch, "packed-boxes": packed}
ERRORS = {name: truths.configuration_error(exact) for name, exact in EXACT.items()}
CHECKS = {
    "painleve": {
        "mu = 2, 60 degrees": ErrorCheck(lambda: simulate(painleve(2.0)), AccuracyError, "no motion"),
        "mu = 0.5, 60 degrees": ErrorCheck(lambda: simulate(painleve(0.5), accuracy=1e-6), None),
    }
}
