"""What stepped piles owe to physics: momentum at each step, no overlap, no energy from nowhere."""

import functools
import itertools

import numpy as np
import pinocchio as pin
import pytest

import twolink as tl
from tests.effects.bodies import G, ball, bouncing, free_bodies, grounded, spheres, stepped
from tests.near import assert_near

E = tl.effects
H, NAMES = 0.004, tuple("abcdef")
SHAPES = {"balls": E.Sphere(0.1), "boxes": E.Box((0.2, 0.15, 0.1)), "plates": E.Box((0.2, 0.15, 0.02))}


# Of restitution and friction, every value of each with every shape; the other pairs at night.
PAIRS = [(0.0, 0.0), (0.2, 0.4), (0.8, 0.4)]
OTHERS = [pair for pair in itertools.product((0.0, 0.2, 0.8), (0.0, 0.4)) if pair not in PAIRS]


@functools.cache
def falling(shape: str, restitution: float, friction: float) -> tl.Trajectory:
    """Six bodies of 1 kg that fall on each other and on the ground, each step sampled."""
    robot, random = free_bodies(*NAMES), np.random.default_rng(0)
    turns = random.normal(size=(6, 4))
    places = np.column_stack([random.uniform(-0.1, 0.1, (6, 2)), 0.15 + 0.25 * np.arange(6)])
    q = np.hstack([places, turns / np.linalg.norm(turns, axis=1)[:, None]]).ravel()
    contact = E.Contact(("self", "ground"), friction, restitution, shapes=dict.fromkeys(NAMES, (SHAPES[shape],)))
    scene = tl.Scene(robot, q, 0.3 * random.normal(size=robot.nv), [E.Gravity(), contact])
    return stepped(scene, 0.8, H, samples=1 / H)


@pytest.mark.parametrize(("restitution", "friction"),
                         [*PAIRS, *(pytest.param(*pair, marks=pytest.mark.slow) for pair in OTHERS)])  # fmt: skip
@pytest.mark.parametrize("shape", SHAPES)
def test_forces_change_the_momentum_of_each_body_in_each_step(shape: str, restitution: float, friction: float) -> None:
    """m (v+ - v) = h (sum F + m g), to rounding, also where a step was taken as two halves; and energy only falls."""
    run = falling(shape, restitution, friction)
    forces = run.contact_forces
    momentum = np.array([[run.robot.frame_pose(q, name)[0] @ v[6 * k :][:3] for k, name in enumerate(NAMES)]
                         for q, v in zip(run.q, run.v, strict=True)])  # fmt: skip
    pressed = np.stack([forces.on(name) for name in NAMES], axis=1)
    assert_near(forces.on("ground"), -pressed.sum(axis=1), 1e-9)
    assert_near(np.diff(momentum, axis=0), H * (pressed[1:] - [0.0, 0.0, G]), 1e-12)
    assert np.diff(run.energy).max() < 1e-6 * run.energy[0]
    assert run.contact_record["overlap"] < (1e-9 if shape == "balls" else 1e-4)


def test_some_of_these_steps_are_taken_as_halves() -> None:
    record = falling("plates", 0.2, 0.4).contact_record
    assert record["halved"] > 0


@pytest.mark.parametrize("way", ["located", "stepped"])
def test_what_approaches_below_the_threshold_does_not_bounce(way: str) -> None:
    """Of bounces at sqrt(2 g z), e times that, ... those up to 1.2 m/s have none after them."""
    e, height, threshold = 0.5, 0.5, 1.2
    start = [0, 0, 0.1 + height, 0, 0, 0, 1]
    scene = grounded(ball(), start, restitution=e, threshold=threshold, shapes=spheres("ball"))
    run = tl.simulate(scene, 1.5, contact=way, samples_per_second=100, **({"step": 0.005} if way == "stepped" else {}))
    hits = np.sqrt(2 * height / G) * np.array([1.0, 1.0 + 2 * e])  # the second at e sqrt(2 g z) = 1.57 m/s, then 0.78
    last = hits[1] + 2 * e * e * np.sqrt(2 * height / G)
    whole = np.where(run.t < last, bouncing(run.t, height, e), 0.0)
    assert_near(run.q[:, 2] - 0.1, whole, 1e-6)
    assert whole[(run.t > hits[1]) & (run.t < last)].max() > 0.02
    assert bouncing(run.t, height, e)[run.t > last].max() > 0.005


@pytest.mark.parametrize(("step", "off"), [(4e-3, 3e-3), (2e-3, 5e-4)])
def test_a_floor_without_friction_leaves_the_angular_momentum_about_the_vertical(step: float, off: float) -> None:
    """All forces are vertical, whose moment about the vertical through the centre of mass is 0; L = R I omega."""
    world = tl.Scene(tl.load_robot("world"), effects=[E.Gravity()], duration=0.8)
    scene = world.with_object(E.Box((0.25, 0.12, 0.18)), (0, 0, 0.35, 0.3, 0.5, 0.1, 0.8), mass=1.0)
    contact = E.Contact(("ground",), friction=0.0, restitution=0.3)
    scene = tl.Scene(scene.robot, scene.robot.normalize(scene.q), [0.5, 0.2, 0, 3, -2, 4], [*scene.effects, contact])
    run = stepped(scene, 0.8, step, samples=50)
    inertia = np.diag([0.12**2 + 0.18**2, 0.25**2 + 0.18**2, 0.25**2 + 0.12**2]) / 12
    turns = [pin.Quaternion(q[3:7]).toRotationMatrix() for q in run.q]
    momentum = np.array([turn @ inertia @ v[3:] for turn, v in zip(turns, run.v, strict=True)])
    assert np.abs(momentum[:, :2] - momentum[0, :2]).max() > 0.3 * np.linalg.norm(momentum[0])  # it tumbles
    assert_near(momentum[:, 2], momentum[0, 2], off * np.linalg.norm(momentum[0]))
