"""lqr: Riccati's equation, the closed loop, robots with fewer motors than joints, files, weights that do not fit."""

import numpy as np
import pytest

import twolink as tl
from tests.refusals import refusal
from tests.simulation.test_sensitivities import FREE
from twolink.errors import SceneError

E = tl.effects
ARM = tl.load_robot("two_link")
UP = [np.pi / 2, 0.0]


def upright(inputs: list[str] | None = None, effort: dict[str, float] | None = None) -> tuple[tl.Scene, tl.Scene]:
    """The arm upright without and with a regulator."""
    scene = tl.Scene(ARM, UP, effects=[E.Gravity(), E.JointDamping({"elbow": 0.1})])
    regulator = tl.lqr(scene, [10.0, 10.0, 1.0, 1.0], 0.1, inputs=inputs, effort=effort)
    return scene, scene.with_effects([*scene.effects, regulator])


@pytest.mark.parametrize("inputs", [None, ["elbow"], ["shoulder"]])
def test_gains_solve_riccatis_equation(inputs: list[str] | None) -> None:
    """P from K by B^T P = R K is not unique; the cost of the closed loop is: P of Lyapunov's equation gives K again."""
    from scipy.linalg import solve_continuous_lyapunov

    scene, closed = upright(inputs)
    a, b, _ = tl.linearize(scene, inputs=inputs)
    gain = np.array(list(closed.effects[-1].gain.values()))
    loop = a - b @ gain
    np.testing.assert_allclose(tl.linearize(closed).A, loop, atol=1e-11 * np.abs(loop).max())
    assert tl.linearize(closed).stability == "asymptotically stable"
    weight = np.diag([10.0, 10.0, 1.0, 1.0])
    p = solve_continuous_lyapunov(loop.T, -(weight + 0.1 * gain.T @ gain))
    np.testing.assert_allclose(b.T @ p / 0.1, gain, rtol=1e-7)


@pytest.mark.parametrize("inputs", [None, ["elbow"]])
def test_the_arm_returns_to_upright(inputs: list[str] | None) -> None:
    """From a degree off by the full equations, as fast as the slowest eigenvalue says."""
    _, closed = upright(inputs)
    run = tl.simulate(tl.Scene(closed.base, [UP[0] + 0.02, -0.012], effects=closed.effects), 4.0)
    off = np.abs(run.q - UP).max(axis=1)
    slowest = tl.linearize(closed).eigenvalues[0].real
    assert off[-1] < 1e-4
    assert off[-1] <= off[len(off) // 2] * np.exp(0.8 * slowest * 2.0) + 1e-6


def test_effort_is_limited() -> None:
    _, closed = upright(effort={"shoulder": 8.0, "elbow": 8.0})
    run = tl.simulate(tl.Scene(closed.base, [UP[0] + 0.3, 0.0], effects=closed.effects), 1.0)
    tau = run.tau[:, 0]
    assert np.abs(tau).max() == pytest.approx(8.0)


def test_limits_below_what_holds_it_are_refused() -> None:
    """Gravity asks for |g(q)| at rest; limits just above it hold it."""
    scene = tl.Scene(ARM, [0.4, 0.9], effects=[E.Gravity()])
    needed = np.abs(scene.robot.gravity_torque(scene.q))
    with refusal(SceneError, code="not-equilibrium", match="elbow.*limit"):
        tl.lqr(scene, 1.0, 1.0, effort={"elbow": 0.99 * needed[1]})
    regulator = tl.lqr(scene, 1.0, 1.0, effort={"shoulder": 1.01 * needed[0], "elbow": 1.01 * needed[1]})
    run = tl.simulate(scene.with_effects([*scene.effects, regulator]), 1.0)
    assert np.abs(run.q[-1] - scene.q).max() < 1e-6
    with refusal(SceneError, match="wrist"):
        tl.lqr(scene, 1.0, 1.0, effort={"wrist": 99.0})


def test_a_regulated_scene_is_saved_and_loaded(tmp_path) -> None:
    _, closed = upright(["elbow"], {"elbow": 30.0})
    again = tl.load_scene(closed.save(tmp_path / "held.toml"))
    assert again.effects == closed.effects
    np.testing.assert_array_equal(tl.linearize(again).A, tl.linearize(closed).A)


def test_a_configuration_off_balance_is_held_by_torques() -> None:
    """Fully actuated, any configuration can be held: tau0 is the gravity torque. One motor alone cannot."""
    scene = tl.Scene(ARM, [0.4, 0.9], effects=[E.Gravity()])
    regulator = tl.lqr(scene, 1.0, [1.0, 2.0])
    expected = scene.robot.gravity_torque(scene.q)
    np.testing.assert_allclose(list(regulator.torque.values()), expected, rtol=1e-12)
    closed = tl.Scene(ARM, [0.5, 0.7], effects=[*scene.effects, regulator])
    assert np.abs(tl.simulate(closed, 15.0).q[-1] - scene.q).max() < 1e-4
    with refusal(SceneError, code="not-equilibrium"):
        tl.lqr(scene, 1.0, 1.0, inputs=["elbow"])


def test_a_wheel_and_a_floating_body_are_linearized_as_the_formula_says() -> None:
    """The feedback's derivative at its target is -K, for a quaternion, a position and a continuous joint."""
    robot = tl.load_robot(FREE, root="free")
    q = robot.random_state(1, seed=3)[0][0]
    gain = np.random.default_rng(0).uniform(-5, 5, 14)
    scene = tl.Scene(robot, q)
    closed = scene.with_effects([E.StateFeedback({"hinge": tuple(gain.tolist())}, tuple(q.tolist()))])
    a, b, _ = tl.linearize(scene)
    np.testing.assert_allclose(tl.linearize(closed).A, a - np.outer(b, gain), atol=1e-11)


def test_what_cannot_be_regulated_is_named() -> None:
    with refusal(SceneError, code="not-stabilizable"):
        tl.lqr(tl.Scene(ARM), 1.0, 1.0, inputs=["elbow"])
    with refusal(SceneError, code="not-detectable"):
        tl.lqr(tl.Scene(ARM, UP, effects=[E.Gravity()]), [0.0, 0.0, 0.0, 0.0], 1.0)
    load = E.Payload("forearm", 2.0, (0.3, 0.0, 0.0))
    for effect in (E.Torque({"elbow": E.Sine(1.0, 1.0)}), E.Release(load, at=0.1),
                   E.Engage(E.Torque({"elbow": 1.0}), at=0.1)):  # fmt: skip
        with refusal(SceneError, code="depends-on-time"):
            tl.lqr(tl.Scene(ARM, UP, effects=[E.Gravity(), effect]), 1.0, 1.0)


@pytest.mark.parametrize(("Q", "R", "argument"), [
    ([1.0, 2.0], 1.0, "Q"), (np.arange(16.0).reshape(4, 4), 1.0, "Q"), (-1.0, 1.0, "Q"), ("much", 1.0, "Q"),
    (1.0, 0.0, "R"), (1.0, [1.0, np.nan], "R"),
])  # fmt: skip
def test_weights_that_do_not_fit(Q: object, R: object, argument: str) -> None:
    with pytest.raises(SceneError) as caught:
        tl.lqr(tl.Scene(ARM, UP, effects=[E.Gravity()]), Q, R)
    assert (caught.value.code, caught.value.argument) == ("weights", argument)
