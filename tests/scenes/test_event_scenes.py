"""The bundled scenes with contact, bounces and dry friction: each shows what is known to be true."""

import functools
from typing import Any

import numpy as np
import pytest

import twolink as tl
from twolink.scenes import bundled_scenes

G = 9.81


@functools.cache
def run_of(name: str, **options: Any) -> tl.Trajectory:
    return tl.simulate(tl.load_scene(name), **options)


def turns(run: tl.Trajectory, link: str) -> np.ndarray:
    """The rotations of a link at the samples (n, 3, 3)."""
    return run.robot.frame_pose(run.q, link)[0]


@pytest.mark.slow
def test_in_newtons_cradle_the_last_ball_leaves_with_the_speed_of_the_first() -> None:
    run = run_of("newtons-cradle", accuracy=1e-8)
    hit = next(event.t for event in run.events if event.kind == "impact")
    before, after = (run.at(hit + late)[1] for late in (-1e-9, 1e-9))
    np.testing.assert_allclose(after, [0, 0, 0, 0, before[0]], atol=1e-6)
    assert np.ptp(run.energy) < 1e-8
    k = 0.2 * 0.5 * G / (0.2 * (0.5**2 + 0.4 * 0.05**2))  # of a compound pendulum of 0.5 rad
    first = np.pi / 2 / np.sqrt(k) * (1 + 0.25 / 16 + 11 * 0.5**4 / 3072 + 173 * 0.5**6 / 737280)
    assert hit == pytest.approx(first, abs=1e-6)


@pytest.mark.slow
def test_the_can_stops_where_friction_says() -> None:
    run = run_of("can-on-table", accuracy=1e-8)
    assert [event.t for event in run.events] == pytest.approx([0.8 / (0.3 * G)], abs=1e-8)
    np.testing.assert_allclose(run.q[-1], [0.64 / (0.6 * G), 0, 0.8075, 0, 0, 0, 1], atol=1e-8)


@pytest.mark.slow
def test_the_coin_whirls_about_a_centre_that_stays() -> None:
    run = run_of("spinning-coin", accuracy=1e-6)
    assert np.abs(run.q[:, :3] - run.q[0, :3]).max() < 1e-6
    axis = turns(run, "coin")[:, :, 2]
    np.testing.assert_allclose(axis[:, 2], np.cos(np.radians(25)), atol=1e-6)
    m, r, h = 0.0085, 0.012875, 0.0011
    a, c, (sin, cos) = m * (3 * r * r + 4 * h * h) / 12, m * r * r / 2, (f(np.radians(25)) for f in (np.sin, np.cos))
    rate = np.sqrt(m * G * (r * cos - h * sin) / (sin * (a * cos - c * h * sin / r)))
    np.testing.assert_allclose(np.unwrap(np.arctan2(axis[:, 1], axis[:, 0])), rate * run.t, atol=1e-4)
    np.testing.assert_allclose(run.contact_forces["coin - ground"], np.tile([0, 0, m * G], (len(run.t), 1)), atol=1e-5)


@pytest.mark.slow
def test_the_rattleback_reverses_and_the_other_way_it_does_not() -> None:
    scene = tl.load_scene("rattleback")
    other = scene.with_start(scene.q, -scene.v)
    for one, ends in ((run_of("rattleback"), 5.0), (tl.simulate(other, 4.0), 5.0)):
        spin = np.einsum("nij,nj->ni", turns(one, "rattleback"), one.v[:, 3:])[:, 2]
        assert spin[-1] == pytest.approx(ends, abs=0.05)
        assert np.ptp(one.energy) < 1e-9
    assert spin.min() > 4.9


def test_the_tippe_top_turns_over() -> None:
    assert turns(run_of("tippe-top"), "top")[-1, 2, 2] < -0.999


@pytest.mark.slow
def test_the_arm_pushes_with_the_force_that_moves_the_box() -> None:
    run = run_of("arm-pushes-box")
    joint = next(joint for joint in run.robot.joints if joint.name == "box")
    turned = turns(run, "box")
    velocity = np.einsum("nij,nj->ni", turned, run.v[:, joint.v][:, :3])
    slides = velocity[:, 0] > 1e-3
    assert 0.2 < slides.mean() < 0.9
    spin = run.v[:, joint.v][:, 3:]
    rate = np.einsum(
        "nij,nj->ni", turned, run.acceleration[:, joint.v][:, :3] + np.cross(spin, run.v[:, joint.v][:, :3])
    )
    forces = run.contact_forces
    rubbed = sum(force for pair, force in forces.items() if pair.endswith("- ground"))
    push = -forces["forearm - box"]
    np.testing.assert_allclose((push + rubbed)[slides], 0.5 * rate[slides] + [0, 0, 0.5 * G], atol=1e-5)
    np.testing.assert_allclose(np.hypot(*rubbed[slides, :2].T), 0.2 * rubbed[slides, 2], rtol=1e-3)


def test_each_box_of_a_stack_carries_those_above() -> None:
    run = run_of("box-stack", step=0.01)
    assert np.abs(run.q - run.q[0]).max() < 1e-9
    forces = {pair: force[-1] for pair, force in run.contact_forces.items()}
    for k in range(1, 4):
        np.testing.assert_allclose(forces[f"box_{k} - box_{k + 1}"], [0, 0, -0.5 * G * (4 - k)], atol=1e-8)
    np.testing.assert_allclose(forces["box_1 - ground"], [0, 0, 2 * G], atol=1e-8)


@pytest.mark.slow
def test_the_gripper_lifts_the_box_without_slip() -> None:
    run = run_of("grasp")
    joints = {joint.name: joint for joint in run.robot.joints}
    hand, box = run.q[:, joints["lift"].q.start], run.q[:, joints["box"].q][:, 2]
    held = run.t > 0.4
    assert np.ptp((box - hand)[held]) < 1e-4
    assert box[-1] > 0.1
    left = run.contact_forces["left_finger - box"][held]
    np.testing.assert_allclose(left[:, 0], -10.0, atol=0.05)
    assert np.all(np.hypot(left[:, 1], left[:, 2]) < 0.6 * 10.05)


@pytest.mark.slow
def test_dominoes_fall_in_their_order_and_lose_energy() -> None:
    """A step adds energy of third order in the angle that it turns by, 6 rad/s h at most (docs/how/contact.md)."""
    run = run_of("dominoes", step=0.002)
    uprights = np.stack([turns(run, f"domino_{k}")[:, 2, 2] for k in range(1, 7)], axis=1)
    fallen = np.argmax(uprights < 0.8, axis=0)
    assert np.all(np.diff(fallen) > 0)
    assert np.all(np.diff(run.energy) < (6.0 * 0.002) ** 3 * np.ptp(run.energy))


@pytest.mark.slow
def test_the_balls_of_a_pile_do_not_overlap_and_lose_energy() -> None:
    run = run_of("sphere-pile", step=0.004, verify=False)
    balls = [joint for joint in run.robot.joints if joint.name.startswith("ball")]
    centres = np.stack([run.q[:, joint.q][:, :3] for joint in balls], axis=1)
    apart = np.linalg.norm(centres[:, :, None] - centres[:, None], axis=-1) + np.eye(len(balls))
    assert apart.min() > 0.06 - 1e-6
    assert centres[..., 2].min() > 0.03 - 1e-6
    assert run.contact_record["overlap"] < 1e-6
    assert run.energy.max() < run.energy[0] + 1e-9
    assert run.energy[-1] < 0.8 * run.energy[0]


@pytest.mark.slow
def test_the_forces_on_the_feet_change_the_momentum() -> None:
    """sum F h = m g T + p(T) - p(0), with each step sampled: the forces of a step are its impulses over h.

    Of joints that turn M changes within the step of the impact, which leaves p an error of first order in h.
    """
    h = 0.002
    run = run_of("quadruped-stands", step=h, samples_per_second=1 / h)
    pressed = sum(force[1:, 2].sum() for force in run.contact_forces.values())
    before, after = run.robot.momentum(run.q[[0, -1]], run.v[[0, -1]])[:, 2]
    assert pressed * h == pytest.approx(run.robot.mass * G * run.t[-1] + after - before, rel=5e-5)
    feet = {f"{leg}_FOOT - ground" for leg in ("FL", "FR", "HL", "HR")}
    assert {pair for pair, force in run.contact_forces.items() if force[-1].any()} == feet


@pytest.mark.slow
def test_a_quadruped_trots_on_its_diagonals() -> None:
    """Over whole strides the ground carries the weight, by the balance of momentum too; each diagonal does its half."""
    h, stride = 1e-3, 1 / 3
    run = run_of("quadruped-trots", step=h, samples_per_second=1 / h, verify=False)
    weight, late = run.robot.mass * G, run.t > run.t[-1] - 3 * stride
    feet = {pair[:2]: force[:, 2] for pair, force in run.contact_forces.items() if "FOOT" in pair}
    assert len(feet) == len(run.contact_forces) == 4
    forward, upright = run.q[:, 0], turns(run, "base_link")[:, 2, 2]
    assert forward[-1] > 0.5
    assert upright.min() > 0.95
    pressed = sum(force[1:].sum() for force in feet.values()) * h
    before, after = run.robot.momentum(run.q[[0, -1]], run.v[[0, -1]])[:, 2]
    assert pressed == pytest.approx(weight * run.t[-1] + after - before, rel=1e-3)
    for diagonal in (("FL", "HR"), ("FR", "HL")):
        share = sum(feet[foot][late].mean() for foot in diagonal) / weight
        assert share == pytest.approx(0.5, abs=0.05)
    both = [(feet[one][late] > 0) | (feet[other][late] > 0) for one, other in (("FL", "HR"), ("FR", "HL"))]
    assert np.mean(both[0] & both[1]) < 0.25


def test_the_marble_runs_down_its_channel_and_gains_no_energy() -> None:
    run = run_of("marble-run", step=1e-3, verify=False, samples_per_second=20.0)
    assert np.diff(run.energy).max() < 1e-6
    assert (np.diff(run.q[:, 0]) > 0.0).all()
    assert np.abs(run.q[:, 1]).max() < 0.2
    assert [piece.name for piece in run.scene.visual_model().geometryObjects][-1] == "field"


@pytest.mark.some(2)
@pytest.mark.parametrize("name", ["bouncing-ball", "pendulum-friction", "pitch", "bowl"])
def test_they_run_as_they_are(name: str) -> None:
    assert name in bundled_scenes()
    scene = tl.load_scene(name)
    assert scene.title
    run = tl.simulate(scene)
    assert run.error.max() <= 1e-6
    assert run.events
    assert scene.robot.visual_model().ngeoms > 1


def test_friction_takes_its_moment_times_the_way() -> None:
    """m g l (cos b - cos a) = c (a + b) in each half swing; it ends where |m g l sin| <= s, and not before."""
    scene = tl.load_scene("pendulum-friction")
    run = tl.simulate(scene, accuracy=1e-9, samples_per_second=1000)
    moment, c, s = 1.0 * G * 0.5, 0.4, 0.7
    (stuck,) = (event.t for event in run.events if event.kind == "stick")
    ends = [1.2]
    while abs(moment * np.sin(ends[-1])) > s:
        a, (low, high) = abs(ends[-1]), (0.0, abs(ends[-1]))
        for _ in range(60):
            b = 0.5 * (low + high)
            low, high = (b, high) if moment * (np.cos(b) - np.cos(a)) > c * (a + b) else (low, b)
        ends.append(-np.sign(ends[-1]) * low)
    assert len(ends) == 7
    assert run.q[-1, 0] == pytest.approx(ends[-1], abs=2e-9)
    turns = [run.t[0], *(event.t for event in run.events)]
    for t, angle in zip(turns, ends, strict=True):
        near = int(np.argmin(np.abs(run.t - t)))  # within 0.5 ms of the turn: 1/2 a t^2 off it
        assert run.q[near, 0] == pytest.approx(angle, abs=3e-6)
    after = run.t > stuck
    assert after.any()
    assert np.ptp(run.q[after]) == 0.0
    assert not run.v[after].any()
    way = 2 * sum(abs(angle) for angle in ends) - abs(ends[0]) - abs(ends[-1])
    assert run.energy[0] - run.energy[-1] == pytest.approx(c * way, abs=1e-8)
