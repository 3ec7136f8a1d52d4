"""Over random scenes: a run has the same bits alone, as any column, in every width, and from the first run on."""

from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.hard.random_scenes import random_effects, random_robot, random_state
from twolink.errors import TwolinkError
from twolink.integrate.motion.scene_equations import equations_of
from twolink.integrate.steps.methods import METHODS
from twolink.integrate.steps.step_control import initial_state
from twolink.integrate.steps.step_map import step_map
from twolink.native import programs

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
