"""Slips of contacts and impulses of impacts by pair, located and stepped: closed forms, and the balance of momentum."""

import math
from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.effects.bodies import G, above, ball, ball_over_ball, grounded, planar, sliders_in_a_row, spheres
from tests.near import assert_near
from tests.refusals import refusal
from tests.urdf_text import link

E = tl.effects
BLOCK = {"body": (E.Box((1.0, 0.3, 0.2)),)}
SPHERE = spheres("ball")
WAYS = pytest.mark.parametrize("way", [{"contact": "located"}, {"contact": "stepped", "step": 0.007, "verify": False}],
                               ids=["located", "stepped"])  # fmt: skip


@WAYS
def test_the_slip_of_a_block_is_that_of_its_closed_form(way: dict[str, object]) -> None:
    """v0 - mu g t, then none; friction is against it."""
    mu, v0 = 0.3, 2.0
    run = tl.simulate(
        grounded(planar(), [0, 0.1, 0], [v0, 0, 0], friction=mu, shapes=BLOCK), 1.0, samples_per_second=20, **way
    )
    forces = run.contact_forces
    slips = forces.slips["body - ground"]
    assert slips.shape == run.contacts["body - ground"][0].shape
    assert slips[1:, :, 0] == pytest.approx(np.tile(np.fmax(v0 - mu * G * run.t[1:, None], 0.0), (1, slips.shape[1])))
    assert not slips[:, :, 1:].any()
    assert (forces["body - ground"][1:, 0] * slips[1:, 0, 0] <= 1e-9).all()
    assert forces.impulses == {}


@pytest.mark.parametrize("pair", [("ball", "base"), ("base", "ball")])
@WAYS
def test_a_slip_is_that_of_the_first_body_on_the_second(way: dict[str, object], pair: tuple[str, str]) -> None:
    """A ball that spins on a fixed one, without friction: c = +-(1 - n n^T) (v - r w x n)."""
    effects = [E.Gravity(), E.Contact((pair,))]
    scene = tl.Scene(ball_over_ball(), [0.0, 0, 1.1, 0, 0, 0, 1], [0.5, 0, 0, 1, 2, 3], effects)
    run = tl.simulate(scene, 0.1, samples_per_second=100, **way)
    name, sign = " - ".join(pair), 1.0 if pair[0] == "ball" else -1.0
    slips, forces = run.contact_forces.slips[name][1:, 0], run.contact_forces[name][1:]
    for c, force, q, v in zip(slips, forces, run.q[1:], run.v[1:], strict=True):
        n, turn = q[:3] / np.linalg.norm(q[:3]), run.robot.frame_pose(q, "ball")[0]
        whole = turn @ v[:3] - 0.1 * np.cross(turn @ v[3:], n)
        assert_near(c, sign * (whole - n * (n @ whole)), 5e-3 if "step" in way else 1e-9)
        assert sign * force @ n > 9.0
        assert abs(c @ force) < 1e-9


@WAYS
def test_the_impulses_of_a_ball_that_bounces(way: dict[str, object]) -> None:
    """m (1 + e) v at each bounce, when it bounces."""
    e, height, mass = 0.5, 0.5, 2.0
    run = tl.simulate(grounded(ball(), above(0.1 + height), restitution=e, shapes=SPHERE), 0.75,
                      samples_per_second=20, **way)  # fmt: skip
    found, fall = run.contact_forces.impulses["ball - ground"], math.sqrt(2 * height / G)
    assert_near(found.t, [fall, fall * (1 + 2 * e)], 1e-6)
    assert_near(found.p[:, 2], mass * (1 + e) * G * fall * np.array([1.0, e]), 1e-6)
    assert run.contact_forces.on("ball").shape == (len(run.t), 3)  # though it presses at no sample
    assert run.contact_forces.keys() == run.contact_forces.slips.keys() == run.contact_forces.impulses.keys()
    assert_near(found.p[:, :2], 0.0, 1e-12)


def test_the_cradle_passes_one_impulse_through_every_pair() -> None:
    """At the times of its impacts, M v / l^2 of pendulums of length l with M about their hinges that meet at v."""
    scene = tl.load_scene("newtons-cradle")
    run = tl.simulate(scene, 1.2, samples_per_second=20, verify=False)
    impacts = [event for event in run.events if event.kind == "impact"]
    speeds = np.array([float(event.detail.split()[1]) for event in impacts])
    mass = run.robot.mass_matrix(run.q[0])[0, 0] / np.linalg.norm(run.robot.model.inertias[1].lever) ** 2
    impulses = run.contact_forces.impulses
    assert len(impulses) == 4
    for one in impulses.values():
        assert one.t == pytest.approx([event.t for event in impacts])
        assert np.linalg.norm(one.p, axis=1) == pytest.approx(mass * speeds, rel=1e-5)


@WAYS
def test_what_touches_passes_an_impact_on(way: dict[str, object]) -> None:
    """Three of 1 kg without restitution go on together at v / 3: the pairs have 2/3 and 1/3 of m v."""
    shapes = spheres(*(f"b{k}" for k in range(3)))
    contact = E.Contact((("b0", "b1"), ("b1", "b2")), shapes=shapes)
    run = tl.simulate(tl.Scene(sliders_in_a_row(1.0, 1.0, 1.0), [0.0, 0.5, 0.7], [1.0, 0.0, 0.0], [contact]), 0.5,
                      samples_per_second=10, **way)  # fmt: skip
    impulses = run.contact_forces.impulses
    assert {pair: pytest.approx(one.p[:, 0], abs=1e-9) for pair, one in impulses.items()} == {
        "b0 - b1": [-2 / 3], "b1 - b2": [-1 / 3]}  # fmt: skip
    assert_near(impulses["b1 - b2"].t, [0.3], 0.007)


@WAYS
def test_forces_and_impulses_change_the_momentum(way: dict[str, object]) -> None:
    """m (v(t) - v(0)) = integral (F + m g) dt + sum p, of a block that falls and slides to rest."""
    mu, v0, height, dt = 0.3, 2.0, 0.2, 1e-3
    scene = grounded(planar(), [0, 0.1 + height, 0], [v0, 0, 0], friction=mu, shapes=BLOCK)
    run = tl.simulate(scene, 1.0, samples_per_second=1 / dt, **{**way, **({"step": dt} if "step" in way else {})})
    force, (times, p) = run.contact_forces["body - ground"], run.contact_forces.impulses["body - ground"]
    hit = math.sqrt(2 * height / G)
    assert_near(times, [hit], dt)
    assert p[0] == pytest.approx([-mu * G * hit, 0.0, G * hit], rel=5e-3 if "step" in way else 1e-9)
    both = np.cumsum(dt * force, axis=0)  # stepped: with the impulses
    if "step" not in way:
        both += np.where(run.t[:, None] >= times[0], p[0], 0.0)
    change = np.column_stack([run.v[:, 0] - v0, 0.0 * run.t, run.v[:, 1] + G * run.t])
    assert_near(both, change, 2 * G * dt)


def test_a_saved_run_has_forces_and_neither_slips_nor_impulses(tmp_path: Path) -> None:
    scene = grounded(planar(), [0, 0.1, 0], [1, 0, 0], friction=0.3, shapes=BLOCK)
    run = tl.simulate(scene, 0.1, samples_per_second=20)
    forces = tl.Trajectory.load(run.save(tmp_path / "run.npz"), run.robot).contact_forces
    assert np.array_equal(forces["body - ground"], run.contact_forces["body - ground"])
    for name in ("slips", "impulses"):
        with refusal(tl.errors.SceneError, code="no-equations"):
            getattr(forces, name)


def test_a_body_whose_name_has_the_sign_of_pairs() -> None:
    """It rests with its weight on the ground."""
    text = f'<robot name="r">{link("a - b", 2.0, 0.008)}</robot>'
    run = tl.simulate(grounded(tl.load_robot(text, root="free"), above(0.1), shapes={"a - b": SPHERE["ball"]}), 0.1)
    for body, sign in (("a - b", 1.0), ("ground", -1.0)):
        assert run.contact_forces.on(body)[-1] == pytest.approx([0, 0, sign * 2.0 * G])
