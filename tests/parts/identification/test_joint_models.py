"""Joint models, errors of the setup, and model errors: each is put into exact motions, and found or said."""

import numpy as np
import pytest

import twolink as tl
from tests.parts.identification.motions import motion, noisy
from twolink.errors import QueryError
from twolink.identification import Identification, identify

ARM = tl.load_robot("arm")
T, Q, V, A = motion(ARM, 600, 1, 10)
CLEAN = ARM.inverse_dynamics(Q, V, A)
SLOW = np.sign(V) * np.exp(-((V / 0.1) ** 2))
BENT = np.array([0.0, 0.1])
TILT = np.tan(np.radians(5))


def found_in(tau: np.ndarray, **options: object) -> Identification:
    """The identification from torques with noise."""
    return identify(ARM, T, Q, V, noisy(tau, 0.02), a=A, **options)


def holds(found: Identification, **truth: float) -> None:
    """Each value is within one and a half half-widths of the truth, and so narrow that this says something."""
    for name, value in truth.items():
        name = name.replace("__", ".")
        half = found.half_width[found.combinations.index(name)]
        assert abs(found.values[name] - value) < 1.5 * half, name
        assert half < 0.1 * max(abs(value), 0.1), name


def test_the_words_of_each_joint_are_found_and_predicted() -> None:
    tau = CLEAN + [0.7, 0] + V * [0.2, 0.3] + 0.5 * np.sign(V) * [0, 1] + 0.4 * SLOW * [0, 1]
    model = {"shoulder": "viscous+offset", "elbow": ["viscous+coulomb", "stribeck:0.1"]}
    found = found_in(tau, joint_model=model)
    holds(found, shoulder__offset=0.7, shoulder__damping=0.2)
    holds(found, elbow__damping=0.3, elbow__friction=0.5, elbow__stribeck=0.4)
    assert "elbow.offset" not in found.values
    np.testing.assert_allclose(found.predict(Q, V, A), tau, rtol=0, atol=0.03)
    assert found.model_errors == ()


def test_auto_takes_what_the_data_ask_for() -> None:
    tau = CLEAN + 0.3 * V * [1, 1] + 0.5 * np.sign(V) * [0, 1] + [0.7, 0]
    found = found_in(tau, joint_model="auto")
    assert {"elbow.friction", "elbow.damping", "shoulder.damping", "shoulder.offset"} <= set(found.values)
    assert not {"elbow.offset", "elbow.stribeck", "elbow.armature"} & set(found.parameters)
    assert found.joint_models is not None
    none, *_, chosen = found.joint_models.rows
    assert all(b < 0.3 * a for a, b in zip(none[1:], chosen[1:], strict=True))


def test_nothing_is_left_to_try_where_all_is_looked_for() -> None:
    found = identify(ARM, T, Q, None, noisy(CLEAN, 0.02), joint_model="viscous+coulomb+rotor+offset+stribeck", find=())
    assert {error.name.rpartition(".")[2] for error in found.model_errors} <= {"zero", "motor_constant", "delay"}


def test_an_asymmetry_and_an_offset_are_told_as_one() -> None:
    found = found_in(CLEAN + 0.3 * np.abs(np.sign(V)), joint_model="asymmetric+offset")
    assert any("elbow.offset" in text and "elbow.asymmetry" in text for text in found.not_identifiable)


def test_own_columns_and_motors_that_move_several_joints() -> None:
    def wave(q: np.ndarray, _v: np.ndarray, _a: np.ndarray) -> np.ndarray:
        return np.sin(10 * q)

    holds(found_in(CLEAN + 0.1 * np.sin(10 * Q), joint_model=[wave]), wave=0.1)
    matrix = np.array([[1.0, 0.0], [1.0, 1.0]])
    inverse = np.linalg.inv(matrix)
    tau = CLEAN + (np.sign(V @ inverse.T) * [0.5, 0.3]) @ inverse
    found = found_in(tau, joint_model="coulomb", coupling=matrix)
    holds(found, shoulder__motor_friction=0.5, elbow__motor_friction=0.3)
    alone = found_in(tau, joint_model="coulomb")
    assert np.all(found.noise < 0.25 * alone.noise.max())


@pytest.mark.parametrize(("option", "wrong", "part"), [
    ("joint_model", "viscos", "did you mean 'viscous'"), ("joint_model", {"elbw": "viscous"}, "'elbow'"),
    ("joint_model", "stribeck:-1", "expected a velocity"), ("joint_model", 3, "expected words"),
    ("find", ["dealy"], "did you mean 'delay'"), ("find", 5, "find: expected texts, got 5"),
])  # fmt: skip
def test_models_and_parts_of_the_setup_that_do_not_exist_are_refused(option: str, wrong: object, part: str) -> None:
    with pytest.raises(QueryError, match=part):
        identify(ARM, T, Q, V, CLEAN, a=A, **{option: wrong})


@pytest.mark.slow
def test_a_delay_is_found_from_positions_alone() -> None:
    holds(identify(ARM, T, Q, None, noisy(ERRORS["delay"], 0.02), find=["delay"]), delay=0.05)


def test_a_delay_that_shows_is_found_unasked_and_said() -> None:
    found = found_in(ERRORS["delay"])
    holds(found, delay=0.05)
    assert "ms late" in str(found)
    assert found_in(CLEAN).setup.names == ()


def test_the_direction_of_gravity_is_found_where_it_shows_more_parameters() -> None:
    """Vertical gravity says nothing of the links at the first joint of a UR5; tilted gravity does."""
    robot = tl.load_robot("ur5")
    t, q, v, a = motion(robot, 400, 1, 10)
    tilted = robot.with_gravity(9.81 * np.array([np.sin(np.radians(5)), 0, -np.cos(np.radians(5))]))
    tau = noisy(tilted.inverse_dynamics(q, v, a), 0.02)
    found = identify(robot, t, q, v, tau, a=a, find=["gravity"])
    assert found.setup.values == pytest.approx([TILT, 0.0], abs=2e-3)
    np.testing.assert_allclose(found.found.gravity, tilted.gravity, atol=0.02)
    assert not any(error.moved > 3 for error in found.model_errors)


def test_a_zero_that_shows_is_found_and_one_that_a_lever_hides_is_named() -> None:
    tau = noisy(ARM.inverse_dynamics(Q + BENT, V, A), 0.02)
    shown = identify(ARM, T, Q, V, tau, ["forearm.mass", "forearm.first_moment.z"], a=A, find=["elbow.zero"])
    holds(shown, elbow__zero=0.1)
    np.testing.assert_allclose(shown.predict(Q, V, A), ARM.inverse_dynamics(Q + BENT, V, A), atol=0.01)
    hidden = identify(ARM, T, Q, V, tau, a=A, find=["elbow.zero"])
    assert any("forearm.first_moment.x" in text and "elbow.zero" in text for text in hidden.not_identifiable)


def test_motor_constants_show_beside_what_is_known_and_else_their_ratio() -> None:
    current = noisy(CLEAN, 0.02) / [0.5, 20.0]
    known = identify(ARM, T, Q, V, current, ["forearm.mass"], a=A, find=["motor_constant"])
    holds(known, shoulder__motor_constant=0.5, elbow__motor_constant=20.0)
    free = identify(ARM, T, Q, V, current, a=A, find=["motor_constant"])
    assert free.setup.values[0] / free.setup.values[1] == pytest.approx(0.5 / 20, rel=0.01)
    assert any("motor_constant" in text for text in free.not_identifiable)


ERRORS = {
    "elbow.offset": CLEAN + 5 * BENT,
    "gravity.tilt_x": ARM.with_gravity(9.81 * np.array([TILT, 0, -1])).inverse_dynamics(Q, V, A),
    "shoulder.zero": ARM.inverse_dynamics(Q + BENT[::-1], V, A),
    "delay": np.stack([np.interp(T - 0.05, T, tau) for tau in CLEAN.T], axis=1),
}


@pytest.mark.parametrize("name", ERRORS)
def test_what_the_model_lacks_is_said_and_never_called_consistent(name: str) -> None:
    found = found_in(ERRORS[name], find=(), joint_model="none")
    assert name in [error.name for error in found.model_errors[:2]]
    assert found.consistency.consistent == all(error.moved < 3 for error in found.model_errors)
    values = dict(zip(ARM.parameter_names, ARM.parameter_values, strict=True))
    truth = found.matrix @ [values[name] for name in found.parameters]
    wrong = np.abs(found.estimate - truth) / np.sqrt(np.diag(found.covariance))
    assert wrong.max() < 4 or not found.consistency.consistent


@pytest.mark.slow
def test_a_model_without_error_is_hardly_ever_accused() -> None:
    accused = [bool(identify(ARM, T, Q, V, noisy(CLEAN, 0.02, seed), a=A).model_errors) for seed in range(40)]
    assert sum(accused) <= 1
