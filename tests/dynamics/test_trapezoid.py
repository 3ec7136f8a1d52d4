"""Motions from rest to rest: their limits, their ends, and the work that their torques do."""

import numpy as np
import pytest

import twolink as tl

END = [1.0, -0.5]


@pytest.mark.parametrize("speed", [0.3, 50.0], ids=["trapezoid", "triangle"])
def test_a_joint_is_at_its_limit_and_none_beyond(speed: float) -> None:
    robot = tl.load_robot("two_link")
    motion = tl.trapezoidal_motion(robot, [0.0, 0.0], END, speed=speed, acceleration=[2.0, 0.5],
                                   samples_per_second=1e3)  # fmt: skip
    assert f"{len(motion.t)} samples of q (2)" in str(motion)
    assert np.abs(motion.a).max(axis=0) == pytest.approx([1.0, 0.5])  # the elbow, on half the way, is at its own
    assert motion.q[-1] == pytest.approx(END, abs=1e-12)
    assert motion.v[[0, -1]] == pytest.approx(np.zeros((2, 2)), abs=1e-12)
    if speed < 1.0:
        assert np.abs(motion.v).max() == pytest.approx(speed)
        assert motion.t[-1] == pytest.approx(1.0 / speed + speed / 1.0)
    else:
        assert motion.t[-1] == pytest.approx(2.0)


@pytest.mark.parametrize("speed", [50.0, 2.0, 1.0], ids=["triangle", "no time of coasting", "coasts"])
@pytest.mark.parametrize("acceleration", [4.0, 1.0 / 0.3**2], ids=["peak at 0.5 s", "peak at 0.3 s"])
def test_a_sample_at_a_jump_has_the_acceleration_after_it(speed: float, acceleration: float) -> None:
    """That is the one by which the speed goes on to the next sample, where no jump is between them."""
    robot = tl.load_robot("two_link")
    motion = tl.trapezoidal_motion(robot, [0.0, 0.0], [1.0, 0.0], speed=speed, acceleration=acceleration,
                                   samples_per_second=1000)  # fmt: skip
    gained = np.diff(motion.v[:, 0]) / np.diff(motion.t)
    between = np.any(np.abs(gained[:, None] / acceleration - [-1.0, 0.0, 1.0]) < 1e-6, axis=1)
    assert motion.a[:-1, 0][between] == pytest.approx(gained[between], abs=1e-6)
    assert between.sum() >= len(gained) - 2
    assert speed < 50.0 or np.abs(motion.a[:, 0]) == pytest.approx(acceleration)


@pytest.mark.parametrize(("name", "root"), [("two_link", "fixed"), ("solo12", "free")])
def test_the_work_of_the_torques_is_the_energy_gained(name: str, root: str) -> None:
    """Also of a floating base that turns: tau v integrates to the energy at every sample of the constant speed."""
    robot = tl.load_robot(name, root=root)
    start, end = robot.random_state(2, seed=5)[0]
    motion = tl.trapezoidal_motion(robot, start, end, speed=1.0, acceleration=3.0, samples_per_second=4000)
    power = np.sum(robot.inverse_dynamics(motion.q, motion.v, motion.a) * motion.v, axis=1)
    done = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]) * np.diff(motion.t))])
    energy = np.sum(robot.energy(motion.q, motion.v), axis=0)
    assert done == pytest.approx(energy - energy[0], abs=1e-2 * np.ptp(energy))
    assert done[-1] == pytest.approx(energy[-1] - energy[0], abs=2e-4 * np.ptp(energy))


def test_a_joint_that_turns_without_end_takes_the_shorter_way() -> None:
    """To 270 degrees it turns by 90 degrees the other way round, in pi/2 + 1/4 s at 1 rad/s and 4 rad/s^2."""
    robot = tl.load_robot("double_pendulum_continuous")
    to = robot.by_joint("q", {"joint1": "270 deg"})
    motion = tl.trapezoidal_motion(robot, robot.neutral, to, speed=1.0, acceleration=4.0)
    assert motion.v[:, 0].min() == pytest.approx(-1.0)
    assert motion.t[-1] == pytest.approx(np.pi / 2 + 0.25)


@pytest.mark.parametrize(("given", "words"), [
    ({"to": [0.0, 0.0]}, "where the motion begins"),
    ({"acceleration": 0.0}, "acceleration.*positive"),
    ({"speed": [1.0, 2.0, 3.0]}, "or 2"),
    ({"speed": 1e-9}, "more than 1e.07 samples"),
])  # fmt: skip
def test_what_is_no_motion_is_refused(given: dict[str, object], words: str) -> None:
    robot = tl.load_robot("two_link")
    whole = {"to": np.ones(robot.nq), "speed": 1.0, "acceleration": 1.0} | given
    with pytest.raises(tl.errors.QueryError, match=words):
        tl.trapezoidal_motion(robot, np.zeros(robot.nq), **whole)


def test_a_speed_that_no_one_gives_is_refused() -> None:
    robot = tl.load_robot("tippe_top", root="free")
    q, to = robot.random_state(2)[0]
    with pytest.raises(tl.errors.QueryError, match=r"speed.*robot's file has none"):
        tl.trapezoidal_motion(robot, q, to, acceleration=1.0)
