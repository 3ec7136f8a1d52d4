"""Environments of Gymnasium: its own checks, the motion of tl.simulate, and worlds in a batch as one by one."""

import warnings

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import twolink as tl
from twolink.gym import Environment, VectorEnvironment
from twolink.simulation.stepwise import State

SWING = tl.load_scene("arm-swing")


def reward(state: State, action: np.ndarray) -> float:
    return float(np.cos(state.q[0]) - 1e-3 * (action @ action))


def around(random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    return random.uniform(-1, 1, 2), random.uniform(-1, 1, 2)


def test_gymnasiums_checks_pass() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of spaces without bounds
        check_env(Environment(SWING, reward, start=around), skip_render_check=True)


def test_an_episode_is_the_motion_under_held_torques() -> None:
    env, sim = Environment(SWING, reward, period=0.05, limit=3.0, accuracy=1e-8), tl.Simulation(SWING, accuracy=1e-10)
    env.reset(seed=1)
    for k in range(200):
        action = np.array([np.sin(k), 5.0])  # beyond its limit
        seen, got, terminated, truncated, info = env.step(action)
        state = sim.step(0.05, [np.sin(k), 3.0])
        assert np.abs(seen - np.concatenate([state.q, state.v])).max() < 1e-5
        assert got == pytest.approx(reward(state, np.array([np.sin(k), 3.0])), abs=1e-5)
        assert (terminated, truncated) == (False, k == 199)
    assert info["t"] == pytest.approx(10.0)


def test_worlds_in_a_batch_are_those_one_by_one_and_begin_again() -> None:
    short = tl.Scene(SWING.base, SWING.q, SWING.v, SWING.effects, duration=0.2)
    worlds = VectorEnvironment(short, reward, 3, period=0.05, start=around, limit=2.0)
    first, _ = worlds.reset(seed=5)
    assert len(np.unique(first[:, 0])) == 3
    singles = [tl.Simulation(short) for _ in range(3)]
    for sim, seen in zip(singles, first, strict=True):
        sim.set_state(seen[:2], seen[2:])
    actions = np.random.default_rng(0).uniform(-2, 2, (4, 3, 2))
    for k, action in enumerate(actions):
        seen, rewards, terminated, truncated, _ = worlds.step(action)
        states = [sim.step(0.05, tau) for sim, tau in zip(singles, action, strict=True)]
        assert np.abs(seen[:, :2] - [state.q for state in states]).max() < 1e-6
        assert rewards == pytest.approx([reward(s, a) for s, a in zip(states, action, strict=True)], abs=1e-6)
        assert not terminated.any()
        assert truncated.all() == (k == 3)
    again, rewards, _, truncated, _ = worlds.step(actions[0])
    assert np.abs(again - first).min() > 1e-3  # another start
    assert not truncated.any()
    assert (rewards == 0.0).all()


def test_a_world_that_ends_early_says_so() -> None:
    env = Environment(SWING, reward, terminated=lambda state: state.q[0] < -1.0)
    env.reset(seed=0)
    assert any(env.step(np.zeros(2))[2] for _ in range(100))


def test_a_scene_with_events_is_refused() -> None:
    with pytest.raises(tl.errors.SceneError, match="events"):
        Environment(tl.load_scene("bouncing-ball"), reward)
