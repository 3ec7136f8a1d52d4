"""Environments of Gymnasium: its own checks, the motion of tl.simulate, and worlds in a batch as one by one."""

from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import (
    ClipAction,
    FlattenObservation,
    NormalizeObservation,
    RecordEpisodeStatistics,
    RescaleAction,
)
from gymnasium.wrappers import vector as of_vectors

import twolink as tl
from docs.examples import learn_swing_up
from scripts.tasks import FEET, on_feet
from twolink import effects as fx
from twolink.errors import AccuracyError, SceneError, TwolinkError
from twolink.gym import Environment, VectorEnvironment
from twolink.simulation.stepwise import State

SWING = tl.load_scene("arm-swing")
SHORT = tl.Scene(SWING.base, SWING.q, SWING.v, SWING.effects, duration=0.2)

UNBOUNDED = pytest.mark.filterwarnings("ignore::UserWarning")  # of spaces without bounds


def reward(state: State, action: np.ndarray) -> float:
    return float(np.cos(state.q[0]) - 1e-3 * (action @ action))


def around(random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    return random.uniform(-1, 1, 2), random.uniform(-1, 1, 2)


@UNBOUNDED
def test_gymnasiums_checks_pass() -> None:
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


def test_a_world_that_ends_early_says_so() -> None:
    env = Environment(SWING, reward, terminated=lambda state: state.q[0] < -1.0)
    env.reset(seed=0)
    assert any(env.step(np.zeros(2))[2] for _ in range(100))


def test_an_event_that_ends_the_motion_is_terminal() -> None:
    fallen = fx.Watch("fallen", when=fx.JointReaches("shoulder", -0.5), stop=True)
    scene = SWING.with_effects([*SWING.effects, fallen])
    env, end = Environment(scene, reward, period=0.05), tl.simulate(scene).t[-1]
    for _ in range(2):
        env.reset(seed=0)
        ends = [env.step(np.zeros(2)) for _ in range(int(end / 0.05) + 1)]
        assert [one[2] for one in ends] == [False] * (len(ends) - 1) + [True]
        assert ends[-1][4]["t"] == pytest.approx(end, abs=1e-5)
        assert ends[-1][0][0] == pytest.approx(-0.5, abs=1e-6)


def test_a_free_base_has_the_limits_of_joints_without_effort() -> None:
    robot = tl.load_robot("go1", root="free")
    env = Environment(tl.Scene(robot, effects=[fx.Gravity()]), reward)
    np.testing.assert_array_equal(env.action_space.high[:6], 1.0)
    assert (np.abs(env.action_space.sample()) <= env.action_space.high).all()


def test_joints_of_a_file_that_limits_no_effort_have_actions_of_1(tmp_path: Path) -> None:
    text = """<robot name="rod"><link name="w"/><link name="a"><inertial><mass value="1"/>
        <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="j" type="continuous"><parent link="w"/><child link="a"/></joint></robot>"""
    robot = tl.load_robot(text)
    for one in (robot, tl.load_robot(robot.export_urdf(tmp_path / "rod.urdf"))):
        np.testing.assert_array_equal(Environment(tl.Scene(one), reward).action_space.high, 1.0)


def test_events_are_located_in_one_environment_and_refused_in_a_batch() -> None:
    ball = tl.load_scene("bouncing-ball")
    env = Environment(ball, reward, period=0.6)
    env.reset(seed=0)
    env.step(np.zeros(1))
    assert env.simulation.events[0].t == pytest.approx(np.sqrt(2.0 / 9.80665), rel=1e-3)
    with pytest.raises(SceneError, match="events"):
        VectorEnvironment(ball, reward, 2)


def test_seeds_and_options_of_worlds_are_those_of_single_environments() -> None:
    worlds, env = VectorEnvironment(SWING, reward, 2, start=around), Environment(SWING, reward, start=around)
    for seeds in (7, [7, 8]):
        seen, _ = worlds.reset(seed=seeds)
        np.testing.assert_array_equal(seen, [env.reset(seed=7)[0], env.reset(seed=8)[0]])
    seen, _ = worlds.reset(options={"q": [0.1, 0.2], "v": [0.0, 0.3]})
    np.testing.assert_array_equal(seen, [[0.1, 0.2, 0.0, 0.3]] * 2)


def test_worlds_begin_with_the_states_of_effects() -> None:
    scene = tl.load_scene("stick-slip")
    seen = lambda at: np.concatenate([at.q, at.v, list(at.z.values())])  # noqa: E731
    worlds, env = (made(scene, lambda *_: 0.0, **more, observe=seen)
                   for made, more in ((VectorEnvironment, {"num_envs": 2}), (Environment, {})))  # fmt: skip
    first, _ = env.reset(seed=0)
    np.testing.assert_array_equal(worlds.reset(seed=0)[0][0], first)
    assert worlds.single_observation_space.shape == first.shape


@pytest.mark.parametrize(("wrong", "part"), [
    ({"limit": 0.0}, "limit"), ({"limit": [1.0, -1.0]}, "limit"), ({"limit": [1.0]}, "limit"),
    ({"period": 0.0}, "period"),
])  # fmt: skip
def test_wrong_numbers_are_refused(wrong: dict, part: str) -> None:
    with pytest.raises(TwolinkError) as caught:
        Environment(SWING, reward, **wrong)
    assert part in str(caught.value) or caught.value.argument == part


def test_unknown_options_and_seeds_that_do_not_fit_are_refused() -> None:
    with pytest.raises(SceneError, match="unknown option 'p'"):
        Environment(SWING, reward).reset(options={"p": 1})
    with pytest.raises(SceneError, match="3 seeds for 2 worlds"):
        VectorEnvironment(SWING, reward, 2).reset(seed=[1, 2, 3])
    worlds = VectorEnvironment(SWING, reward, 2)
    worlds.reset(seed=[1, None])
    with pytest.raises(SceneError, match=r"expected shape \(2, 2\), got \(2,\)"):
        worlds.step(np.zeros(2))
    with pytest.raises(SceneError, match=r"expected shape \(2,\), got \(3,\)"):
        Environment(SWING, reward).step(np.zeros(3))


@pytest.mark.parametrize("accuracy", [1e-6, 1e-9])
def test_worlds_are_those_of_gymnasiums_own_vector_environment(accuracy: float) -> None:
    """Spaces, episodes, rewards and new episodes; Gymnasium 1.4 has no checker of vector environments of its own."""
    task = {"period": 0.05, "start": around, "limit": 2.0, "accuracy": accuracy}
    worlds = VectorEnvironment(SHORT, reward, 3, **task)
    sync = SyncVectorEnv([lambda: Environment(SHORT, reward, **task)] * 3)
    assert worlds.metadata["autoreset_mode"] == sync.metadata["autoreset_mode"] == AutoresetMode.NEXT_STEP
    for name in ("observation_space", "action_space", "single_observation_space", "single_action_space"):
        assert getattr(worlds, name) == getattr(sync, name)
    seen = [worlds.reset(seed=3)[0]]
    np.testing.assert_array_equal(seen[0], sync.reset(seed=3)[0])
    worlds.action_space.seed(0)
    for k in range(10):  # with two new episodes
        action = worlds.action_space.sample()
        ours, theirs = worlds.step(action)[:4], sync.step(action)[:4]
        assert worlds.observation_space.contains(ours[0])
        for one, other in zip(ours, theirs, strict=True):
            assert (one.shape, one.dtype) == (other.shape, other.dtype)
            np.testing.assert_allclose(one, other, atol=max(1e-8, accuracy))
        assert (ours[1] == 0.0).all() == (k in (4, 9))
        assert ours[3].all() == (k in (3, 8))
        seen.append(ours[0])
    assert len(np.unique(seen[0][:, 0])) == 3
    assert np.abs(seen[5] - seen[0]).min() > 1e-3  # another start


def test_gymnasiums_wrappers_of_vectors_work() -> None:
    worlds = of_vectors.RecordEpisodeStatistics(VectorEnvironment(SHORT, lambda *_: 1.0, 2, period=0.05))
    worlds.reset(seed=0)
    infos = [worlds.step(worlds.action_space.sample())[4] for _ in range(4)]
    assert infos[-1]["episode"]["r"] == pytest.approx([4.0, 4.0])
    assert infos[-1]["episode"]["l"].tolist() == [4, 4]


def test_a_start_that_comes_again_has_the_same_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is restored, and not prepared again."""
    env, actions = Environment(SWING, reward, limit=2.0), np.random.default_rng(0).uniform(-2, 2, (20, 2))

    def episode(**given: object) -> list[np.ndarray]:
        first, _ = env.reset(seed=0, options=given)
        return [first, *(env.step(action)[0] for action in actions)]

    fresh, again, other = episode(), episode(), episode(q=[0.1, 0.2])
    np.testing.assert_array_equal(again, fresh)
    assert np.abs(other[0] - fresh[0]).max() > 0.05
    np.testing.assert_array_equal(episode(), fresh)
    monkeypatch.setattr(env.simulation, "set_state", lambda *_, **__: pytest.fail("it was prepared again"))
    np.testing.assert_array_equal(episode(), fresh)


def test_a_controller_begins_anew_with_each_episode(monkeypatch: pytest.MonkeyPatch) -> None:
    """It may remember what no save has: a start is always prepared again."""
    law = fx.Controller(lambda _, y, state: (-y.v, state), 0.05)
    env = Environment(SWING.with_effects([*SWING.effects, law]), reward, limit=2.0)
    prepared: list[float] = []
    again = env.simulation.set_state
    monkeypatch.setattr(env.simulation, "set_state", lambda *a, t: (prepared.append(t), again(*a, t=t)))
    for _ in range(3):
        env.reset(seed=0)
    assert prepared == [0.0] * 3


@UNBOUNDED
def test_a_quadruped_stands_in_stepped_contact() -> None:
    robot, q, _, contact = on_feet("solo12")
    scene = tl.Scene(robot, q, effects=[fx.Gravity(), contact], duration=0.2)
    env = Environment(scene, lambda state, _: float(state.q[2]), contact="stepped", limit=1.0)
    check_env(env, skip_render_check=True)
    env.reset(seed=0)
    ends = [env.step(np.zeros(robot.nv)) for _ in range(10)]
    assert [end[3] for end in ends] == [False] * 9 + [True]
    feet = [name for name in robot.frame_names if name.endswith("FOOT")]
    lowest = min(robot.frame_pose(env.simulation.state.q, foot)[1][2] for foot in feet)
    assert lowest == pytest.approx(FEET["solo12"], abs=1e-3)  # the ground holds them, 1 cm below where they began


def test_the_wrappers_of_cleanrl_see_episodes_end_and_begin_in_one_step() -> None:

    def make() -> gymnasium.Env:
        env = RecordEpisodeStatistics(FlattenObservation(Environment(SHORT, lambda *_: 1.0, period=0.05)))
        return NormalizeObservation(ClipAction(env))

    envs = SyncVectorEnv([make] * 2, autoreset_mode=AutoresetMode.SAME_STEP)
    envs.reset(seed=0)
    for _ in range(2):
        steps = [envs.step(envs.action_space.sample()) for _ in range(4)]
        assert [step[3].all() for step in steps] == [False, False, False, True]
        assert steps[-1][4]["final_info"]["episode"]["r"] == pytest.approx([4.0, 4.0])


def test_stable_baselines_learns_in_an_environment() -> None:
    baselines = pytest.importorskip("stable_baselines3", reason="Stable-Baselines3 is no extra of twolink")
    env = RescaleAction(Environment(SHORT, reward, period=0.05, start=around, limit=2.0), -1.0, 1.0)
    model = baselines.PPO("MlpPolicy", env, n_steps=64, batch_size=64, device="cpu", seed=0).learn(128)
    action, _ = model.predict(env.reset(seed=0)[0])
    assert model.num_timesteps == 128
    assert np.abs(action).max() <= 1.0


@pytest.mark.slow
def test_swinging_up_is_learned() -> None:
    """From starts that no learning has seen: the pendulum hangs before, and stands most of the time after."""
    before, after = (learn_swing_up.judged(one) for one in (np.zeros(5), learn_swing_up.learn()))
    assert before.max() < -0.5
    assert after.mean() > 0.1
    assert (after > before + 0.5).all()


@pytest.mark.parametrize("accuracy", [0.0, -1.0, np.nan, "x"])
def test_an_accuracy_that_cannot_be_is_refused_of_one_world_and_of_many(accuracy: object) -> None:
    for make in (lambda **given: Environment(SWING, reward, **given),
                 lambda **given: VectorEnvironment(SWING, reward, 2, **given)):  # fmt: skip
        with pytest.raises(AccuracyError, match="accuracy: expected a number above 0"):
            make(accuracy=accuracy)


@pytest.mark.parametrize("worlds", [0, -1, 2.5])
def test_a_number_of_worlds_that_cannot_be_is_refused(worlds: float) -> None:
    with pytest.raises(SceneError, match="num_envs"):
        VectorEnvironment(SWING, reward, worlds)
