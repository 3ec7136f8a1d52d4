"""The same scene gives the same bits: again, in a new process, alone, as any column, in a batch, with any threads."""

import hashlib
from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.command import printed_by
from tests.hard.random_scenes import random_effects, random_robot, random_state
from twolink.errors import TwolinkError
from twolink.integrate.motion.scene_equations import equations_of
from twolink.integrate.steps.methods import METHODS
from twolink.integrate.steps.step_control import initial_state
from twolink.integrate.steps.step_map import step_map
from twolink.native import programs

METHODS_OF_RUNS = ("auto", "dop853", "rk45", "taylor", "rk4", "esdirk43", "scipy-dop853")
OTHERS = [pytest.param(name, "auto", marks=pytest.mark.slow) for name in ("spinning-top", "four-bar", "panda-hold")]
_BATCH = """
import numpy as np, twolink as tl, hashlib
q = np.random.default_rng(4).uniform(-1, 1, (130, 2))
w = tl.simulate_many(tl.load_scene("arm-swing"), q=q, duration=1.0)
a = tl.load_robot("ur5").forward_dynamics(*np.random.default_rng(1).uniform(-1, 1, (3, 5000, 6)))
print(hashlib.sha256(w.q.tobytes() + w.v.tobytes() + w.error.tobytes() + a.tobytes()).hexdigest())
"""


def bits(run: tl.Trajectory) -> str:
    assert run.error is not None
    return hashlib.sha256(run.q.tobytes() + run.v.tobytes() + run.error.tobytes()).hexdigest()


@pytest.mark.parametrize(("name", "method"), [*(("arm-swing", method) for method in METHODS_OF_RUNS), *OTHERS])
def test_the_same_scene_twice(name: str, method: str) -> None:
    first, second = (bits(tl.simulate(tl.load_scene(name), 0.5, accuracy=1e-5, method=method)) for _ in range(2))
    assert first == second


@pytest.mark.slow
@pytest.mark.parametrize("method", ["taylor", "dop853"])
def test_the_first_run_of_a_new_process_without_kernels(method: str, tmp_path: Path) -> None:
    """Runs have the same bits from the first on, in every process."""
    code = f"""
import hashlib, twolink as tl
for _ in range(3):
    print(hashlib.sha256(tl.simulate(tl.load_scene("arm-swing"), 0.5, method={method!r}).q.tobytes()).hexdigest())
"""
    known = set()
    for number in range(2):
        known.update(printed_by(code, TWOLINK_CACHE=str(tmp_path / str(number))).split())
    assert len(known) == 1


@pytest.mark.slow
def test_threads_and_processes_do_not_change_bits() -> None:
    assert len({printed_by(_BATCH, TWOLINK_THREADS=threads) for threads in ("1", "2", "3")}) == 1


@pytest.mark.parametrize("verify", [False, True])
def test_a_world_is_the_same_in_a_batch_of_any_size(verify: bool) -> None:
    scene, q = tl.load_scene("arm-swing"), np.random.default_rng(4).uniform(-1, 1, (65, 2))
    whole = tl.simulate_many(scene, q=q, duration=1.0, verify=verify)
    for part in (slice(0, 1), slice(7, 8), slice(0, 3), slice(1, 9), slice(5, 21), slice(31, 65)):
        few = tl.simulate_many(scene, q=q[part], duration=1.0, verify=verify)
        assert np.array_equal(few.q, whole.q[part])
        assert np.array_equal(few.v, whole.v[part])
        if verify:
            assert np.array_equal(few.error, whole.error[part])


@pytest.mark.some(1)
@pytest.mark.parametrize("rate", [0, 20])
def test_worlds_of_a_scene_with_loops_are_the_same_in_any_batch(rate: int) -> None:
    scene = tl.load_scene("crankshaft")
    v = np.zeros((9, scene.robot.nv))
    whole = tl.simulate_many(scene, v=v, duration=0.3, samples_per_second=rate, verify=False)
    alone = tl.simulate_many(scene, v=v[:1], duration=0.3, samples_per_second=rate, verify=False)
    assert all(np.array_equal(whole.q[k], alone.q[0]) for k in range(9))


def test_queries_do_not_depend_on_the_size_of_the_batch() -> None:
    """Compiled batches of any size are the same bits; Pinocchio's single answers differ by rounding only."""
    robot = tl.load_robot("ur5")
    q, v, tau = np.random.default_rng(1).uniform(-1, 1, (3, 1000, 6))
    compiled = robot.compiled()
    whole = compiled.forward_dynamics(q, v, tau)
    for part in (slice(0, 1), slice(3, 12), slice(500, 517), slice(100, 1000)):
        assert np.array_equal(compiled.forward_dynamics(q[part], v[part], tau[part]), whole[part])
    single = np.array([robot.forward_dynamics(*row) for row in zip(q[:50], v[:50], tau[:50], strict=True)])
    np.testing.assert_allclose(single, whole[:50], rtol=0, atol=1e-9 * np.abs(whole[:50]).max())


SCENES, COLUMNS, DURATION = 200, 23, 0.2
PARTS = (slice(4, 5), slice(0, 2), slice(3, 7), slice(9, 18), slice(2, 21))  # widths 1, 4, 4, 8 and 8 with a rest


def scene_of(seed: int) -> tl.Scene:
    """A random robot with random effects."""
    random = np.random.default_rng(seed)
    robot = random_robot(random, max_joints=5)
    q, v = random_state(random, robot)
    return tl.Scene(robot, q, v, effects=random_effects(random, robot, q), duration=DURATION)


@pytest.mark.some(3)
@pytest.mark.parametrize("seed", range(SCENES))
def test_runs_and_their_columns(seed: int, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(programs, "_kept", {})
    monkeypatch.setenv("TWOLINK_CACHE", str(tmp_path))  # the first run traces, the second has its programs, the third
    try:
        first, later = (tl.simulate(scene_of(seed), accuracy=1e-5) for _ in range(2))
        monkeypatch.setattr(programs, "_kept", {})  # loads them
        loaded = tl.simulate(scene_of(seed), accuracy=1e-5)
    except TwolinkError as error:
        pytest.skip(f"the scene is refused: {error.code}")
    for other in (later, loaded):
        assert np.array_equal(first.q, other.q)
        assert np.array_equal(first.v, other.v)
        assert first.error is not None
        assert np.array_equal(first.error, other.error)
    scene = scene_of(seed)
    random = np.random.default_rng(seed)
    states = [random_state(random, scene.robot) for _ in range(COLUMNS)]
    for method in ("dop853", "esdirk43"):
        _columns(scene, states, method)


def _columns(scene: tl.Scene, states: list[tuple[np.ndarray, np.ndarray]], method: str) -> None:
    """Require that attempts of columns are those of any part of them."""
    steps = step_map(equations_of(scene), METHODS[method])
    x = np.repeat(steps.equations.start[:, None], len(states), axis=1)
    for k, (q, v) in enumerate(states):
        x[: len(q) + len(v), k] = np.concatenate([q, v])
    state = initial_state(x, 0.0, 1e-3, DURATION, 1e-6 * np.arange(1, len(states) + 1), resolution=1e6)
    made, whole = 8, np.empty((9, *state.shape))
    whole[0] = state
    steps.attempts(whole, made, made + 1)
    for part in PARTS:
        some = np.empty((made + 1, *state[:, part].shape))
        some[0] = state[:, part]
        steps.attempts(some, made, made + 1)
        assert np.array_equal(some, whole[:, :, part], equal_nan=True)
