"""Structures that stand or fall by friction and by their shape: an arch, and a grasp."""

import functools
import math
from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog

import twolink as tl
from tests.effects.bodies import G, free_bodies, free_body, stepped
from tests.near import assert_near

E = tl.effects
BLOCKS, DEEP = 7, 0.3
HEYMAN = 0.1075  # the least thickness of a semicircular arch of many blocks over its mean radius (Heyman 1969)


def corners(thickness: float, blocks: int = BLOCKS) -> np.ndarray:
    """The joints of a semicircular arch of mean radius 1 on the ground: (blocks + 1, 2 within and without, x and z)."""
    angles = np.linspace(0.0, math.pi, blocks + 1)
    rays = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return np.stack([(1.0 - thickness / 2) * rays, (1.0 + thickness / 2) * rays], axis=1)


def centroid(polygon: np.ndarray) -> np.ndarray:
    """Of a polygon (n, 2)."""
    x, z = polygon.T
    cross = x * np.roll(z, -1) - np.roll(x, -1) * z
    return np.asarray(((polygon + np.roll(polygon, -1, axis=0)) * cross[:, None]).sum(axis=0) / (3 * cross.sum()))


def block(joints: np.ndarray, k: int) -> np.ndarray:
    """The corners (4, 2) of a block, counterclockwise."""
    return np.array([joints[k, 0], joints[k, 1], joints[k + 1, 1], joints[k + 1, 0]])


def can_stand(thickness: float, friction: float, blocks: int = BLOCKS) -> bool:
    """Whether forces at the joints' edges within friction's cone balance the weights: the static theorem, exact."""
    joints, count = corners(thickness, blocks), blocks + 1
    balance, weights = np.zeros((3 * blocks, 3 * count)), np.zeros(3 * blocks)
    for j, (inner, outer) in enumerate(joints):
        along = (outer - inner) / np.linalg.norm(outer - inner)
        normal = np.array([-along[1], along[0]])  # on the block behind the joint
        acting = [(normal, inner), (normal, outer), (along, inner)]
        for k, sign in ((j, 1.0), (j - 1, -1.0)):
            if 0 <= k < blocks:
                centre = centroid(block(joints, k))
                for i, (force, point) in enumerate(acting):
                    (x, z), moment = point - centre, 3 * k + 2
                    balance[3 * k : moment, 3 * j + i] = sign * force
                    balance[moment, 3 * j + i] = sign * (x * force[1] - z * force[0])
    weights[1::3] = G
    cone = np.zeros((2 * count, 3 * count))
    for j in range(count):
        cone[2 * j : 2 * j + 2, 3 * j : 3 * j + 3] = [[-friction, -friction, 1.0], [-friction, -friction, -1.0]]
    bounds = [(0, None), (0, None), (None, None)] * count
    return bool(linprog(np.zeros(3 * count), cone, np.zeros(2 * count), balance, weights, bounds).success)


@functools.cache
def least(friction: float | None, blocks: int = BLOCKS) -> float:
    """The least thickness of an arch that can stand without slip; with None the least friction of a thick one."""
    low, high = 1e-3, 0.9
    while high - low > 1e-6:
        middle = 0.5 * (low + high)
        stands = can_stand(0.4, middle) if friction is None else can_stand(middle, friction, blocks)
        low, high = (low, middle) if stands else (middle, high)
    return high


def moved(thickness: float, friction: float) -> float:
    """How far an arch that starts at rest moves in 0.2 s, m."""
    joints, shapes, q = corners(thickness), {}, []
    for k in range(BLOCKS):
        polygon = block(joints, k)
        centre = centroid(polygon)
        sides = [(x, y, z) for x, z in polygon - centre for y in (-DEEP / 2, DEEP / 2)]
        shapes[f"b{k}"] = (E.Convex(tuple(sides)),)
        q += [centre[0], 0.0, centre[1], 0.0, 0.0, 0.0, 1.0]
    pairs = (("b0", "ground"), *((f"b{k}", f"b{k + 1}") for k in range(BLOCKS - 1)), (f"b{BLOCKS - 1}", "ground"))
    scene = tl.Scene(free_bodies(*shapes, inertia=0.05), q,
                     effects=[E.Gravity(), E.Contact(pairs, friction, shapes=shapes)])  # fmt: skip
    run = stepped(scene, 0.2, 0.02, samples=10)
    return float(np.abs(run.q - run.q[0]).max())


def test_many_thin_blocks_have_heymans_least_thickness() -> None:
    """What the next tests hold the simulation against is the known bound."""
    assert_near(least(10.0, blocks=100), HEYMAN, 5e-4)


@pytest.mark.parametrize(("share", "stands"), [(1.02, True), (0.98, False)])
def test_an_arch_stands_as_thick_as_the_static_theorem_asks_for(share: float, stands: bool) -> None:
    assert (moved(share * least(10.0), 1.0) < 1e-9) == stands


@pytest.mark.parametrize(("share", "stands"), [(1.02, True), (0.98, False)])
def test_a_thick_arch_stands_with_as_much_friction_as_it_needs(share: float, stands: bool) -> None:
    assert (moved(0.4, share * least(None)) < 1e-9) == stands


PADS = {"panda_leftfinger": (E.Box((0.0175, 0.0152, 0.0185), (0.0, 0.0076, 0.04525)),),
        "panda_rightfinger": (E.Box((0.0175, 0.0152, 0.0185), (0.0, -0.0076, 0.04525)),)}  # fmt: skip
EDGE, MASS, GRIP, LIFT, END = 0.04, 0.2, 10.0, 0.2, 0.3  # m, kg, N, m/s, s
ARM = (0.0, -math.pi / 4, 0.0, -3 * math.pi / 4, 0.0, math.pi / 2, math.pi / 4)


def panda_with_cube() -> tuple[tl.Robot, np.ndarray]:
    """A Panda whose hand points down, with a cube between its fingers, and the configuration."""
    text = tl.load_robot("panda").visuals.text
    cube = free_body("cube", MASS, MASS * EDGE**2 / 6, "panda_link0")
    robot = tl.load_robot(text.replace("</robot>", cube + "</robot>"))
    q = robot.neutral
    for joint in robot.joints:
        if joint.name.startswith("panda"):
            q[joint.q] = EDGE / 2 if "finger" in joint.name else ARM[int(joint.name[-1]) - 1]
    _, place = robot.frame_pose(q, "panda_leftfinger")
    free = next(joint for joint in robot.joints if joint.name == "cube_joint")
    q[free.q] = [place[0], 0.0, place[2] - 0.04525, 0.0, 0.0, 0.0, 1.0]
    return robot, q


def test_a_panda_grasps_a_cube_and_lifts_it() -> None:
    """Friction of its fingers alone carries the cube: their forces are its weight and what accelerates it."""
    robot, q = panda_with_cube()
    driven = [joint for joint in robot.joints if joint.name.startswith("panda")]
    arm = [joint for joint in driven if "finger" not in joint.name]
    mass = np.diag(robot.mass_matrix(q))
    up = np.linalg.pinv(robot.frame_jacobian(q, "panda_hand")[:, [j.v.start for j in arm]])[:, 2]
    target: dict[str, Any] = {j.name: E.Polynomial((float(q[j.q][0]), LIFT * rate))
                              for j, rate in zip(arm, up.tolist(), strict=True)}  # fmt: skip
    target |= {j.name: EDGE / 2 for j in driven if j not in arm}
    kp = {j.name: 0.0 if j not in arm else 400.0 * float(mass[j.v][0]) for j in driven}
    kd = {j.name: 40.0 * float(mass[j.v][0]) for j in driven}
    grip = {j.name: -GRIP for j in driven if j not in arm}
    top = float(q[next(j for j in robot.joints if j.name == "cube_joint").q][2])
    pairs = (("cube", "panda_leftfinger"), ("cube", "panda_rightfinger"), ("cube", E.Plane(height=top - EDGE / 2)))
    contact = E.Contact(pairs, 0.8, shapes={**PADS, "cube": (E.Box((EDGE,) * 3),)})
    effects = [E.Gravity(), E.GravityCompensation(tuple(kp)), E.JointPD(target, kp, kd, grip), contact]
    run = stepped(tl.Scene(robot, q, effects=effects), END, 0.01)
    finger = [robot.frame_pose(x, "panda_leftfinger") for x in run.q]
    cube = [robot.frame_pose(x, "cube") for x in run.q]
    held = np.array([r.T @ (c - p) for (r, p), (_, c) in zip(finger, cube, strict=True)])
    assert cube[-1][1][2] - cube[0][1][2] > 0.6 * LIFT * END
    assert_near(held, held[0], 1e-5)
    forces = run.contact_forces
    total = forces["cube - panda_leftfinger"] + forces["cube - panda_rightfinger"]
    free = next(joint for joint in robot.joints if joint.name == "cube_joint")
    speed = np.array([r @ v for (r, _), v in zip(cube, run.v[:, free.v.start : free.v.start + 3], strict=True)])
    steady = run.t > 0.2
    gained = MASS * (speed[-1] - speed[steady][0]) / (run.t[-1] - run.t[steady][0])
    assert_near(total[steady][1:].mean(axis=0), gained + MASS * np.array([0.0, 0.0, G]), 0.02 * MASS * G)
    assert np.abs(forces["cube - panda_leftfinger"][steady, 1]) == pytest.approx(GRIP, rel=0.05)
