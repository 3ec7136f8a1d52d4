"""Attempts in the native library: many in one call are single calls, alone as in a batch, and end with the arrival."""

import numpy as np
import pytest

import twolink as tl
from tests.integrate.problems import arm, attempted, box
from twolink.integrate.motion.scene_equations import equations_of
from twolink.integrate.steps.methods import METHODS
from twolink.integrate.steps.perturbation import Perturbation, step_disturbances
from twolink.integrate.steps.programs import programs_of
from twolink.integrate.steps.step_control import initial_state
from twolink.integrate.steps.step_formulas import NumericSteps
from twolink.integrate.steps.step_map import StepMap, step_map

NAMES = ("dop853", "rk45", "rk4", "semi-implicit-euler", "esdirk43", "implicit-midpoint")
LOOK = 8


def started(steps: StepMap, worlds: int, end: float = 100.0) -> np.ndarray:
    """A state array of worlds beside the start, with settings of their own."""
    x = np.repeat(steps.equations.start[:, None], worlds, axis=1)
    x[-1] += np.linspace(0.0, 0.3, worlds)
    setting = 1e-7 * np.arange(1, worlds + 1) if steps.method.adaptive else np.inf
    return initial_state(x, 0.0, 2e-3, end, setting, resolution=1e6)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("scene", [arm(), box()], ids=["arm", "box"])
def test_many_attempts_are_single_ones(scene: tl.Scene, name: str) -> None:
    steps = step_map(equations_of(scene), METHODS[name])
    state = started(steps, 11)
    states = np.empty((41, *state.shape))
    states[0] = state
    assert steps.attempts(states, 40, LOOK) == 40
    for k in range(40):
        np.testing.assert_array_equal(attempted(steps, states[k]), states[k + 1])


@pytest.mark.parametrize("name", NAMES)
def test_a_world_has_the_same_bits_alone_and_in_any_batch(name: str) -> None:
    steps = step_map(equations_of(arm()), METHODS[name])
    state, made = started(steps, 23), 20
    states = np.empty((made + 1, *state.shape))
    states[0] = state
    steps.attempts(states, made, LOOK)
    for chosen in ([4], [0, 7], [22, 3, 9, 1], list(range(9)), list(range(5, 22))):
        some = np.empty((made + 1, len(state), len(chosen)))
        some[0] = state[:, chosen]
        steps.attempts(some, made, LOOK)
        np.testing.assert_array_equal(some, states[:, :, chosen])


def test_attempts_end_when_all_have_arrived_or_half_have() -> None:
    steps = step_map(equations_of(arm()), METHODS["rk4"])
    state = started(steps, 6, end=0.02)  # ten steps
    states = np.empty((101, *state.shape))
    states[0] = state
    assert steps.attempts(states, 100, LOOK) == 10
    assert (states[10, steps.rows.time] == 0.02).all()
    states[0, steps.rows.end, :4] = 0.01  # four of six arrive after five
    assert steps.attempts(states, 100, LOOK) == LOOK
    np.testing.assert_array_equal(states[LOOK, :, :4], states[5, :, :4])


def test_disturbances_are_those_of_numpy() -> None:
    """Of random size below rounding, from the table's row that the attempts choose, and none of a world that is not."""
    equations = equations_of(box())
    steps = step_map(equations, METHODS["dop853"])
    state = started(steps, 5)
    every = (Perturbation(), *(Perturbation(1.0, 1e-9, i) for i in range(4)))
    disturbed = step_disturbances(every, state, equations)
    found, moving = attempted(steps, state, disturbed), equations.moving
    state[:moving] += disturbed.added(np.zeros(5, dtype=int), state[:moving])
    expected = attempted(steps, state)
    np.testing.assert_array_equal(found[:, 0], expected[:, 0])
    np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-15)
    assert (np.abs(found[:moving, 1:] - found[:moving, :1]).max(axis=0) > 0.0).all()


@pytest.mark.parametrize("name", ["rk23", "rk45", "esdirk43", "rk4"])
def test_columns_of_the_embedded_formula_lack_the_error_estimate(name: str) -> None:
    """As NumPy says; the others have the bits that they have without them. A method without estimates has no such."""
    equations = equations_of(arm())
    steps, moving = step_map(equations, METHODS[name]), equations.moving
    state = started(steps, 4)
    every = (Perturbation(), Perturbation(embedded=True), Perturbation(), Perturbation(embedded=True))
    disturbances = step_disturbances(every, state, equations)
    found, alone = attempted(steps, state, disturbances), attempted(steps, state)
    np.testing.assert_array_equal(found[:, ::2], alone[:, ::2])
    apart = np.abs(found[:moving, 1::2] - alone[:moving, 1::2]).max(axis=0)
    if name == "rk4":
        assert not apart.any()
        return
    columns = programs_of(equations).columns
    by_numpy = StepMap(equations, METHODS[name], NumericSteps(equations, METHODS[name], columns), columns)
    lower = attempted(by_numpy, state, disturbances)
    np.testing.assert_allclose(found[:moving], lower[:moving], rtol=1e-13, atol=1e-15)
    assert (apart > 0.0).all()
