"""Detents: breakaway at an exact instant, catching by an impulse, and the energy that it takes."""

import math

import numpy as np
import pytest

import twolink as tl
from tests.effects.bodies import kinds, slider, sliders, solved, times
from tests.effects.cases import E, robot
from tests.near import assert_near, assert_within


@pytest.mark.parametrize("accuracy", [1e-6, 1e-10])
def test_a_growing_torque_breaks_the_joint_loose_at_an_exact_instant(accuracy: float) -> None:
    """1 kg under t N in a notch of 2 N: at rest till t = 2, then x'' = t."""
    run = solved(slider(), [E.Detent("x", 2.0), E.Torque({"x": E.Polynomial((0.0, 1.0))})], 4.0, accuracy=accuracy)
    exact = np.where(run.t < 2, 0.0, (run.t**3 - 8) / 6 - 2 * (run.t - 2))
    assert_within(run.q[:, 0], exact, run.error)
    assert kinds(run) == ["breakaway"]
    assert_near(times(run, "breakaway"), [2.0], 1e-12)


@pytest.mark.parametrize(("load", "moves"), [(1.999, False), (2.0, False), (2.001, True), (-2.001, True)])
def test_only_a_torque_above_the_breakaway_torque_moves_the_joint(load: float, moves: bool) -> None:
    run = solved(slider(), [E.Detent("x", 2.0), E.Torque({"x": load})], 1.0)
    assert_near(run.q[-1, 0], load / 2 if moves else 0.0, 1e-9)


def test_a_slow_joint_is_caught_and_its_energy_is_lost() -> None:
    """1 kg on 4 N/m from 1 m passes the notch at pi / 4 s with 2 m/s."""
    run = solved(slider(), [E.JointSpring({"x": 4.0}), E.Detent("x", 1.0, speed=2.5)], 3.0, [1.0])
    exact = np.where(run.t < math.pi / 4, np.cos(2 * run.t), 0.0)
    assert_near(run.q[:, 0], exact, 1e-9)
    (event,) = run.events
    assert (event.kind, event.what, event.detail) == ("catch", "x", "at 2 m/s")
    assert_near(event.t, math.pi / 4, 1e-10)
    assert_near(event.energy, 2.0, 1e-8)


@pytest.mark.parametrize("speed", [0.0, 1.9])
def test_a_fast_joint_passes_without_an_event(speed: float) -> None:
    run = solved(slider(), [E.JointSpring({"x": 4.0}), E.Detent("x", 1.0, speed=speed)], 6.0, [1.0])
    assert_near(run.q[:, 0], np.cos(2 * run.t), 1e-9)
    assert not run.events


def test_a_joint_that_slows_down_is_caught_in_the_notch_that_it_passes_slowly() -> None:
    """Coulomb's friction 1 N brakes 1 kg from 3 m/s: v^2 = 9 - 2 x, below 1.5 m/s from x = 3.375 on."""
    effects = [E.DryFriction({"x": 1.0}), E.Detent("x", 5.0, positions=(0.0, 1.0, 2.0, 3.0, 4.0), speed=1.5)]
    run = solved(slider(), effects, 4.0, v=[3.0])
    assert run.q[-1, 0] == 4.0
    assert kinds(run) == ["catch"]
    assert_near(times(run, "catch"), [2.0], 1e-9)
    assert_near(run.events[0].energy, 0.5, 1e-8)


def test_a_caught_joint_that_is_pulled_too_hard_breaks_away_again() -> None:
    """Pulled by 3 N against 2 N, 1 kg comes back to the notch at 1 m/s, is stopped and starts again at once."""
    run = solved(slider(), [E.Torque({"x": 3.0}), E.Detent("x", 2.0, speed=2.0)], 1.0, [-1 / 6])
    hit = 1 / 3
    exact = np.where(run.t < hit, -1 / 6 + 1.5 * run.t**2, 1.5 * (run.t - hit) ** 2)
    assert_near(run.q[:, 0], exact, 1e-9)
    assert kinds(run) == ["catch"]
    assert_near(run.events[0].energy, 0.5, 1e-8)


def test_a_catch_keeps_the_momentum_of_coupled_joints_and_the_energy_balance_closes() -> None:
    effects = [E.Gravity(), E.JointDamping({"elbow": 0.1}), E.Detent("elbow", 40.0, speed=20.0)]
    scene = tl.Scene(robot("arm"), [0.2, 0.9], [0.0, -1.0], effects, duration=1.5)
    book = tl.energy_book(scene)
    (event,) = book.run.events
    assert event.kind == "catch"
    assert event.energy > 0.1
    assert_near(book.residual, 0.0, 1e-8 * (1.0 + np.ptp(book.stored)))
    after = book.run.t > event.t
    assert np.all(book.run.q[after, 1] == 0.0)
    # The impulse acts in the elbow alone: the momentum of the other coordinate, the shoulder, does not change.
    before = tl.simulate(scene.without(2), event.t, accuracy=1e-11)
    masses = [scene.robot.mass_matrix(q) for q in (before.q[-1], [before.q[-1, 0], 0.0])]
    momentum = (masses[0] @ before.v[-1])[0]
    stopped = momentum / masses[1][0, 0]
    lost = (before.v[-1] @ masses[0] @ before.v[-1] - masses[1][0, 0] * stopped**2) / 2
    assert event.energy == pytest.approx(lost, rel=1e-7)


def test_a_detent_beside_friction_holds_by_the_sum() -> None:
    effects = [E.DryFriction({"one": 1.0}), E.Detent("one", 2.0), E.Torque({"one": E.Polynomial((0.0, 1.0))})]
    run = solved(sliders(), effects, 4.0)
    assert_near(run.events[0].t, 3.0, 1e-12)
    late = np.fmax(run.t - 3, 0)
    assert_near(run.q[:, 0], late**3 / 6 + late**2, 1e-9)


def test_the_bundled_scene_holds_breaks_away_and_is_caught() -> None:
    """The pendulum is held at m g l sin(1) = 4.13 N m, breaks away at 5 N m, and ends in the lowest notch."""
    run = tl.simulate(tl.load_scene("detent"), accuracy=1e-8)
    assert kinds(run)[0] == "breakaway"
    assert kinds(run)[-1] == "catch"
    moment = 1.0 * 9.81 * 0.5 * math.sin(1.0)
    assert_near(run.events[0].t, (5.0 - moment) / 0.5, 1e-9)
    assert run.q[-1, 0] == 0.0
    assert run.error[-1] <= 1e-8


def test_one_joint_is_named() -> None:
    with pytest.raises(tl.errors.SceneError, match="expected the name of a joint"):
        tl.Scene(tl.load_robot("two_link"), effects=[tl.effects.Detent({"elbow": 1.0}, 2.0)])
