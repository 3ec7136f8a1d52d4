"""Bodies that touch: a fast body that hits a small one, a coin that rolls on its rim, an arch of blocks."""

import functools
import itertools
import math

import numpy as np

from twolink import effects as fx
from twolink.dynamics import load_robot
from twolink.hard import truths
from twolink.scenes import Scene

GRAVITY = 9.81
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


EXACT = {"bullet": _bullet, "coin": _coin, "arch": lambda t: np.tile(arch().q, (len(t), 1))}
SCENES = {"bullet": bullet, "coin": coin, "arch": arch}
ERRORS = {name: truths.configuration_error(exact) for name, exact in EXACT.items()}
