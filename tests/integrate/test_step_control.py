"""The step control: last steps, first steps, and how the step size follows the error."""

import numpy as np
import pytest

from tests.integrate.problems import arm, attempted, rods
from twolink.integrate.core.smooth import solve_smooth
from twolink.integrate.motion.scene_equations import equations_of
from twolink.integrate.steps.methods import METHODS
from twolink.integrate.steps.step_control import FIRST_SQUARE, SAFETY, control_rows, initial_state
from twolink.integrate.steps.step_map import step_map
from twolink.integrate.steps.stepping import start_state

ROWS = control_rows(4)


def attempt(h: float, end: float, tolerance: float, longest: float = np.inf, portable: bool = True) -> np.ndarray:
    """The state array (rows,) of the arm after one attempt of dop853."""
    steps = step_map(equations_of(arm()), METHODS["dop853"], portable=portable)
    return attempted(steps, initial_state(steps.equations.start[:, None], 0.0, h, end, tolerance, longest))[:, 0]


@pytest.mark.parametrize("h", [0.051, 0.06, 0.099])
def test_two_equal_steps_replace_a_step_and_a_short_one(h: float) -> None:
    assert attempt(h, 0.1, 1e9)[ROWS.time] == 0.05


def test_a_step_that_ends_just_before_the_end_goes_to_the_end() -> None:
    assert attempt(0.1 * (1 - 1e-9), 0.1, 1e9)[ROWS.time] == 0.1


def test_no_step_is_longer_than_the_longest() -> None:
    assert attempt(0.01, 10.0, 1.0, longest=0.012)[ROWS.step] == 0.012 < attempt(0.01, 10.0, 1.0)[ROWS.step]


def test_the_step_size_after_an_accepted_step_is_the_pi_controllers() -> None:
    """h_new = h 0.9 e^(-0.7/p) e_previous^(0.4/p); at twice the tolerance e^2, which goes as h^16, is a fourth."""
    h, tolerance = 0.2, 1e-4
    once, twice = attempt(h, 10.0, tolerance), attempt(h, 10.0, 2 * tolerance)
    assert once[ROWS.accepted] == twice[ROWS.accepted] == 1
    for out in (once, twice):
        factor = SAFETY * out[ROWS.previous] ** (-0.35 / 8) * FIRST_SQUARE ** (0.2 / 8)
        assert out[ROWS.step] == pytest.approx(h * factor)
    assert once[ROWS.previous] == pytest.approx(4 * twice[ROWS.previous], rel=1e-3)


@pytest.mark.parametrize("portable", [True, False])
def test_a_step_that_its_end_cuts_does_not_make_the_next_ones_shorter(portable: bool) -> None:
    """The first is a 50th of what was planned: the controller alone would make the next one 6 times as long at most."""
    assert attempt(0.05, 0.001, 1e-6, portable=portable)[ROWS.step] >= 0.05
    uncut = attempt(0.001, 1.0, 1e-6, portable=portable)[ROWS.step]
    assert 0.001 < uncut <= 0.006


def test_the_step_size_after_a_rejected_step_has_no_memory() -> None:
    out = attempt(0.5, 10.0, 1e-7)
    assert out[ROWS.rejected] == 1
    assert out[ROWS.time] == 0
    assert 0.2 * 0.5 <= out[ROWS.step] < SAFETY * 0.5


def test_what_a_state_cannot_resolve_is_no_error() -> None:
    """A tolerance below rounding, at velocities of 1e3: without rounding admitted, the step size would collapse."""
    steps = step_map(equations_of(rods(v=[1e3, -1e3])), METHODS["dop853"])
    assert solve_smooth(steps.equations, steps.method, np.array([0.0, 0.01]), 1e-17).t[-1] == 0.01


def test_two_tolerances_take_different_first_steps_however_short_the_duration() -> None:
    """Equal steps would make two solutions equal, and their distance no error bar."""
    equations = equations_of(arm())
    steps = step_map(equations, METHODS["dop853"])
    x, rows = equations.start[:, None], control_rows(4)
    for duration in (1e-6, 1.0):
        first = [start_state(steps, x, 0.0, duration, t)[0][rows.step, 0] for t in (1e-6, 1e-6 / 30)]
        assert first[1] < 0.8 * first[0]
