"""The controllers of docs/examples, by what their theory says."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import twolink as tl
from docs.examples import delayed_pendulum, mpc, panda_cascade, pid_arm, policy_arm, policy_go1, state_machine
from twolink.io.networks import read_network


def bias(scene: tl.Scene, q: np.ndarray) -> np.ndarray:
    return scene.robot.bias(q, np.zeros(scene.robot.nv))


def test_pid_gives_the_arm_its_weight() -> None:
    """At rest the integral holds gravity; the seed of the noise decides about the rest."""
    scene = pid_arm.scene()
    run, other = (tl.simulate(one, 4.0, accuracy=1e-4) for one in (scene, pid_arm.scene(seed=8)))
    assert np.abs(run.q[-200:].mean(axis=0) - pid_arm.TARGET).max() < 0.015
    assert run.tau[-400:].mean(axis=0) == pytest.approx(bias(scene, pid_arm.TARGET), abs=0.3)
    assert run.error.max() < 1e-4 < np.abs(run.q - other.q).max()


@pytest.mark.some(2)
@pytest.mark.parametrize("share", [0.99, 1.01, 0.9, 1.1])
def test_the_pendulum_goes_unstable_at_the_delay_that_theory_says(share: float) -> None:
    """Tick by tick the motion is that of the exact linear map; it grows where an eigenvalue leaves the unit circle."""
    delay, start = share * delayed_pendulum.longest_delay(), 1e-4
    ticks = delayed_pendulum.PERIOD * np.arange(401)
    run = tl.simulate(delayed_pendulum.scene(delay, start), accuracy=1e-10, t_eval=ticks)
    forward = delayed_pendulum.step_map(delay)
    x = [start * np.eye(len(forward))[0]]
    for _ in ticks[1:]:
        x.append(forward @ x[-1])
    off = run.q[:, 0] - delayed_pendulum.TOP
    assert np.abs(off - np.array(x)[:, 0]).max() < 10 * np.abs(off).max() ** 3 + run.error.max()
    assert (delayed_pendulum.growth(delay) > 1.0) == (share > 1.0)
    early, late = (np.ptp(part) for part in np.array_split(off[60:], 2))
    assert (late > early) == (share > 1.0)


@pytest.mark.parametrize("share", [0.95, 1.3])
def test_the_run_says_that_the_pendulum_is_unstable(share: float) -> None:
    """With the rate of the exact map. That the torque is small beside its gain makes no tick ambiguous."""
    delay = share * delayed_pendulum.longest_delay()
    run = tl.simulate(delayed_pendulum.scene(delay, 1e-9), 12.0, accuracy=1e-4)
    assert [event.kind for event in run.events] == ["unstable-loop"] * (share > 1.0)
    for event in run.events:
        rate = np.log(delayed_pendulum.growth(delay)) / delayed_pendulum.PERIOD
        assert float(event.detail.split()[3]) == pytest.approx(rate, rel=0.1)


def test_the_state_machine_swings_up_and_catches() -> None:
    """Its motor is too weak to lift the pendulum at once: the energy grows until it is that of the top."""
    scene, robot = state_machine.scene(), state_machine.robot
    assert np.abs(bias(scene, np.zeros(1))).max() > 2 * state_machine.LIMIT
    run = tl.simulate(scene, accuracy=1e-4)
    assert np.abs(run.tau).max() <= state_machine.LIMIT * (1 + 1e-12)
    off = (run.q[:, 0] - state_machine.TOP + np.pi) % (2 * np.pi) - np.pi
    assert abs(off[-1]) < 1e-3
    first = np.flatnonzero(np.abs(off) < state_machine.CATCH)[0]
    energy = sum(robot.energy(run.q, run.v))
    assert energy[0] + 10 < energy[first] == pytest.approx(state_machine.level, abs=0.1)
    assert (np.abs(off[first:]) < state_machine.GIVE_UP).all()


def test_predictive_control_without_limits_is_the_linear_quadratic_regulator() -> None:
    free = mpc.Predictive(np.full(2, 1e6))
    a, b = mpc.model()
    gain = np.linalg.solve(mpc.R + b.T @ free.last @ b, b.T @ free.last @ a)
    for x in np.random.default_rng(0).normal(0, 0.1, (5, 4)):
        u, _ = free(0.0, SimpleNamespace(q=mpc.TOP + x[:2], v=x[2:]), None)
        assert u == pytest.approx(-gain @ x, abs=1e-9)


def test_predictive_control_keeps_to_its_limits() -> None:
    run = tl.simulate(mpc.scene(), accuracy=1e-4)
    assert np.abs(run.tau[:, 0]).max() == pytest.approx(mpc.LIMIT[0])
    assert (np.abs(run.tau) <= mpc.LIMIT * (1 + 1e-9)).all()
    assert np.abs(run.q[-1] - mpc.TOP).max() < 1e-6
    assert run.error.max() < 1e-4


def test_the_cascade_holds_the_elbow_by_the_current_that_its_weight_needs() -> None:
    scene, joint = panda_cascade.scene(), f"{panda_cascade.JOINT}.current"
    run = tl.simulate(scene, accuracy=1e-4, samples_per_second=8000)
    late = run.t > 1.8
    assert np.abs(run.q[late, 0] - panda_cascade.TARGET).max() < 2 * panda_cascade.QUANTUM
    change = (run.v[-1, 0] - run.v[late, 0][0]) / np.ptp(run.t[late])
    needed = bias(scene, run.q[-1])[0] + scene.robot.mass_matrix(run.q[-1])[0, 0] * change
    needed /= panda_cascade.RATIO * panda_cascade.K
    assert run.states[joint][late].mean() == pytest.approx(needed, abs=1e-3)
    assert np.abs(run.states[joint]).max() < 1.1 * panda_cascade.AMPERES
    assert np.abs(run.v).max() == pytest.approx(1.0, rel=0.1)  # the cascade's limit of the speed


def test_a_cloned_policy_is_trusted_as_long_as_another_method_says(tmp_path: Path) -> None:
    """Its loop is unstable between two steps of the encoder: the bar grows, and holds."""
    pytest.importorskip("onnx")
    assert policy_arm.missed(policy_arm.train()) < 1e-4
    scene = policy_arm.scene(policy_arm.write_network(tmp_path / "policy.onnx"), delay=0.06, bits=14)
    with pytest.raises(tl.errors.AccuracyError) as limit:
        tl.simulate(scene, 20.0)
    run = limit.value.run
    other = tl.simulate(scene, 20.0, method="dop853", tolerance=1e-13, t_eval=run.t, verify=False)
    off = np.abs(other.q - run.q).max(axis=1)
    assert (off <= run.error).all()
    assert off[-1] > 1e3 * off[run.t < 5.0].max()  # errors do grow
    assert 5.0 < policy_arm.trusted(run, 1e-6) < policy_arm.trusted(run, 1e-2) < 20.0


def test_a_network_of_the_public_policys_operations_drives_go1(tmp_path: Path) -> None:
    """One that ends in a Split, as the public file does."""
    onnx, runtime = pytest.importorskip("onnx"), pytest.importorskip("onnxruntime")
    random, h, joints = np.random.default_rng(0), onnx.helper, policy_go1.JOINTS
    w = onnx.numpy_helper.from_array(random.normal(0, 0.05, (48, 24)).astype(np.float32), "w")
    shapes = [h.make_tensor_value_info(name, onnx.TensorProto.FLOAT, [1, n]) for name, n in (("obs", 48), ("a", 12))]
    nodes = [h.make_node("MatMul", ["obs", "w"], ["x"]), h.make_node("Split", ["x"], ["mean", "rest"], axis=-1),
             h.make_node("Tanh", ["mean"], ["a"])]  # fmt: skip
    graph, path = h.make_graph(nodes, "policy", shapes[:1], shapes[1:], [w]), tmp_path / "go1.onnx"
    onnx.save(h.make_model(graph, opset_imports=[h.make_opsetid("", 11)], ir_version=7), str(path))
    session, network = runtime.InferenceSession(str(path)), read_network(path)
    for x in random.normal(size=(20, 1, 48)):
        np.testing.assert_allclose(network(x)[0], session.run(None, {"obs": x.astype(np.float32)})[0], atol=1e-5)
    scene = policy_go1.scene(path)
    run = tl.simulate(scene, 0.2, contact="stepped")
    places = [next(one.q.start for one in scene.robot.joints if one.name == joint) for joint in joints]
    assert run.q[0, places] == pytest.approx(policy_go1.HOME)
    assert min(scene.robot.frame_pose(run.q[-1], foot)[1][2] for foot in policy_go1.FEET) > policy_go1.RADIUS - 1e-3
    assert np.isfinite(run.error[-1])
