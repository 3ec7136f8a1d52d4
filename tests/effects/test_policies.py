"""Policies: networks from ONNX files against onnxruntime, and loops with them against the same law in Python."""

import itertools
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import twolink as tl
from tests.near import assert_near
from twolink.errors import SceneError
from twolink.io import networks
from twolink.io.networks import read_network
from twolink.loop.laws import Measured

onnx = pytest.importorskip("onnx")
fx = tl.effects
SIZES = 6, 32, 16, 2
# Operations on shapes and truth values, steps, and those that take more than one input here.
WITHOUT_SLOPE = {
    "And", "Constant", "ConstantOfShape", "Conv", "Equal", "Expand", "Floor", "GRU", "Gather", "Greater",
    "GreaterOrEqual", "LSTM", "Less", "LessOrEqual", "Not", "Or", "Range", "Reshape", "Shape", "Sign", "Slice", "Tile",
    "Unsqueeze", "Where",
}  # fmt: skip


def written(path: Path, nodes: list[Any], weights: dict[str, Any], ins: dict[str, Any], outs: dict[str, Any],
            opset: int = 17) -> Path:  # fmt: skip
    """A file of nodes (kind, inputs, outputs, attributes)."""
    h, number = onnx.helper, onnx.TensorProto.FLOAT
    shapes = [[h.make_tensor_value_info(name, number, shape) for name, shape in one.items()] for one in (ins, outs)]
    made = [h.make_node(kind, a.split(), b.split(), **given) for kind, a, b, given in nodes]
    arrays = [onnx.numpy_helper.from_array(np.asarray(x, dtype=np.int64 if np.asarray(x).dtype.kind == "i" else
                                                      np.float32), name) for name, x in weights.items()]  # fmt: skip
    graph = h.make_graph(made, "policy", *shapes, arrays)
    onnx.save(h.make_model(graph, opset_imports=[h.make_opsetid("", opset)], ir_version=10), str(path))
    return path


def mlp(path: Path, sizes: tuple[int, ...] = SIZES, kind: str = "Elu", gain: float = 1.0, **given: Any) -> Path:
    """A multilayer perceptron behind a normalisation, its answers within 2."""
    rng, size = np.random.default_rng(0), sizes[0]
    nodes: list[Any] = [("Sub", "obs mean", "o1", {}), ("Div", "o1 std", "o2", {}), ("Clip", "o2 low high", "x0", {})]
    weights: dict[str, Any] = {
        "mean": rng.normal(size=size) * 0.1,
        "std": rng.uniform(1, 2, size),
        "low": -5.0,
        "high": 5.0,
    }
    for k, (a, b) in enumerate(itertools.pairwise(sizes)):
        weights |= {f"w{k}": gain * rng.normal(size=(b, a)) / np.sqrt(a), f"b{k}": 0.1 * rng.normal(size=b)}
        nodes += [("Gemm", f"x{k} w{k} b{k}", f"h{k}", {"transB": 1}), (kind, f"h{k}", f"x{k + 1}", given)]
    nodes[-1] = ("Tanh", f"h{len(sizes) - 2}", "actions", {})
    return written(path, nodes, weights, {"obs": [1, size]}, {"actions": [1, sizes[-1]]})


def cell(path: Path, kind: str) -> Path:
    """A recurrent network."""
    rng, gates, hidden = np.random.default_rng(1), {"LSTM": 4, "GRU": 3}[kind], 8
    kept = {"h": [1, 1, hidden]} | ({"c": [1, 1, hidden]} if kind == "LSTM" else {})
    weights = {
        "w": 0.5 * rng.normal(size=(1, gates * hidden, 6)),
        "b": rng.normal(size=(1, 2 * gates * hidden)),
        "r": 0.5 * rng.normal(size=(1, gates * hidden, hidden)),
        "out": rng.normal(size=(hidden, 2)),
        "k": [0],
    }
    after, options = {f"{k}2": kept[k] for k in kept}, {"linear_before_reset": 1} if kind == "GRU" else {}
    nodes = [("Unsqueeze", "obs k", "x", {}),
             (kind, " ".join(["x w r b NONE", *kept]), " ".join(["y", *after]), {"hidden_size": hidden, **options}),
             ("Squeeze", "h2 k", "last", {}), ("MatMul", "last out", "actions", {})]  # fmt: skip
    file = written(path, nodes, weights, {"obs": [1, 6], **kept}, {"actions": [1, 2], **after})
    model = onnx.load(str(file))
    for node in model.graph.node:
        node.input[:] = ["" if one == "NONE" else one for one in node.input]
    onnx.save(model, str(file))
    return file


def test_answers_are_those_of_onnxruntime(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("onnxruntime")
    asked, certify = [], networks._certify
    monkeypatch.setattr(networks, "_certify", lambda network, path: asked.append(certify(network, path)))
    kinds = {"Relu": {}, "Elu": {"alpha": 0.7}, "Tanh": {}, "Sigmoid": {}, "LeakyRelu": {"alpha": 0.2}, "Softplus": {},
             "Selu": {}, "Celu": {}, "Erf": {}, "HardSwish": {}, "Softsign": {}, "LogSoftmax": {}}  # fmt: skip
    for kind, given in kinds.items():
        read_network(mlp(tmp_path / "one.onnx", kind=kind, **given))
    for kind in ("LSTM", "GRU"):
        read_network(cell(tmp_path / "one.onnx", kind))
    assert len(asked) == 14
    wrong = read_network(mlp(tmp_path / "one.onnx"))
    wrong.constants["b0"][0] += 0.01
    with pytest.raises(tl.errors.CertificationError):
        certify(wrong, tmp_path / "one.onnx")


@pytest.mark.parametrize("kind", ["mlp", "LSTM", "GRU"])
def test_rows_are_answered_as_alone(tmp_path: Path, kind: str) -> None:
    network = read_network(mlp(tmp_path / "one.onnx") if kind == "mlp" else cell(tmp_path / "one.onnx", kind))
    x = np.random.default_rng(2).normal(size=(5, 4, 6))
    together, alone = network.start(4), [network.start(1) for _ in range(4)]
    for at in x:
        y, together = network(at, together)
        for i in range(4):
            one, alone[i] = network(at[i : i + 1], alone[i])
            assert_near(one[0], y[i], 1e-14)


@pytest.mark.parametrize("kind", sorted({*networks._OPERATIONS, *networks._OF_ONNX}))
def test_operations_are_computed_in_double(tmp_path: Path, kind: str) -> None:
    """The slope over 1e-9, in which float32 has no step or a jump, is that over 1e-4."""
    weights: dict[str, Any] = {"two": [[0.7, 1.3]], "ones": [1.0, 2.0], "square": [[0.3, -0.7], [0.4, 0.9]]}
    inputs, given = {
        **dict.fromkeys(("Add", "Sub", "Mul", "Div", "Pow", "Max", "Min", "Mean", "Sum", "PRelu"), ("x two", {})),
        **dict.fromkeys(("Gemm", "MatMul"), ("x square", {})), "LayerNormalization": ("x ones", {}),
        "BatchNormalization": ("x ones ones ones ones", {}), "Concat": ("x x", {"axis": 1}),
        "Cast": ("x", {"to": onnx.TensorProto.FLOAT}), "Split": ("x", {"axis": 1, "num_outputs": 2}),
    }.get(kind, ("x", {}))  # fmt: skip
    nodes = [("Abs", "obs", "x", {}), (kind, inputs, "actions rest" if kind == "Split" else "actions", given)]
    file = written(tmp_path / "one.onnx", nodes, weights, {"obs": [1, 2]}, {"actions": [1, 1 + (kind != "Split")]},
                   opset=24 if kind == "Swish" else 20)  # fmt: skip
    try:
        network = read_network(file)
    except SceneError:
        assert kind in WITHOUT_SLOPE
        return
    if kind in WITHOUT_SLOPE:
        return
    x, along = np.array([[0.6180339, 1.4142136]]), np.array([[0.7, -0.4]])
    fine, wide = ((network(x + h * along)[0] - network(x - h * along)[0]) / (2.0 * h) for h in (1e-9, 1e-4))
    assert_near(fine, wide, 1e-6)
    assert np.abs(wide).max() > 1e-5


def test_a_file_of_one_row_is_asked_for_each(tmp_path: Path) -> None:
    """A sum over all numbers, and a shape that is written into the file."""
    nodes = [("Reshape", "obs flat", "x", {}), ("ReduceSum", "x", "sum", {}), ("Mul", "obs sum", "actions", {}),
             ("Neg", "actions", "value", {})]  # fmt: skip
    file = written(tmp_path / "one.onnx", nodes, {"flat": [2]}, {"obs": [1, 2]}, {"actions": [1, 2], "value": [1, 2]})
    network, x = read_network(file), np.random.default_rng(3).normal(size=(4, 2))
    assert not network.together
    np.testing.assert_allclose(network(x)[0], x * x.sum(axis=1, keepdims=True))  # the critic's value is not asked for
    assert read_network(mlp(tmp_path / "two.onnx")).together


def test_the_angle_of_a_continuous_joint_is_that_of_a_revolute_one(tmp_path: Path) -> None:
    """tau = -3 q - v, by a network, of one pendulum that a URDF has with both types of joint."""
    file = written(tmp_path / "pd.onnx", [("MatMul", "x w", "y", {})], {"w": [[-3.0], [-1.0]]}, {"x": [1, 2]},
                   {"y": [1, 1]})  # fmt: skip
    text = """<robot name="p"><link name="w"/><link name="a"><inertial><origin xyz="0.3 0 0"/><mass value="1"/>
      <inertia ixx=".01" iyy=".02" izz=".03" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="axle" type="{}">
      <parent link="w"/><child link="a"/><axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="9" velocity="9"/>
      </joint></robot>"""
    runs = [tl.simulate(tl.Scene(tl.load_robot(text.format(kind)), q={"axle": 2.0}, duration=1.0,
                                 effects=[fx.Gravity(), fx.Policy(str(file), period=0.02)]))
            for kind in ("revolute", "continuous")]  # fmt: skip
    revolute, continuous = runs[0].q[:, 0], np.arctan2(runs[1].q[:, 1], runs[1].q[:, 0])
    np.testing.assert_allclose([run.tau[0, 0] for run in runs], -6.0)
    assert_near(continuous, revolute, 1e-5)
    assert np.ptp(revolute) > 1.0
    with pytest.raises(SceneError, match="kp: joint 'axle' is continuous"):  # its first coordinate is no angle
        tl.Scene(tl.load_robot(text.format("continuous")), effects=[fx.Policy(str(file), 0.02, kp={"axle": 10.0})])


def arm(policy: Any, **fields: Any) -> tl.Scene:
    damping = fx.JointDamping({"shoulder": 0.5, "elbow": 0.5})
    return tl.Scene(
        tl.load_robot("two_link"), q=[0.3, 0.2], effects=[fx.Gravity(), damping, *policy], duration=1.0, **fields
    )


@pytest.mark.parametrize(
    "gains", [{}, {"kp": {"shoulder": 40.0, "elbow": 20.0}, "kd": {"shoulder": 4.0, "elbow": 2.0}}]
)
@pytest.mark.parametrize("delay", [0.0, 0.007])
def test_a_policy_is_the_law_that_it_says(tmp_path: Path, gains: Any, delay: float) -> None:
    file = mlp(tmp_path / "one.onnx", sizes=(8, 32, 2))
    inputs = (fx.Observed("joint_pos", offset=(0.1, 0.0), scale=2.0, history=2), "last_action",
              fx.Observed("command", values=(0.3, -0.3)))  # fmt: skip
    policy = fx.Policy(str(file), 0.02, inputs, scale=(5.0, 2.0), offset=0.1, delay=delay, **gains)
    network = read_network(file)

    def law(_: float, y: Any, state: Any) -> Any:
        now = 2.0 * (y.q - [0.1, 0.0])
        last, before = state if state is not None else (np.zeros(2), now)
        action = network(np.concatenate([before, now, last, [0.3, -0.3]])[None])[0][0]
        return 0.1 + np.array([5.0, 2.0]) * action, (action, now)

    def inner(rate: int) -> Any:
        def sampled(t: float, y: Any, state: Any) -> Any:
            k, held, own = state
            if k % (rate // 50) == 0:
                held, own = law(t, y, own)
            return held * [40.0, 20.0] - [40.0, 20.0] * y.q - [4.0, 2.0] * y.v, (k + 1, held, own)

        return sampled

    run = tl.simulate(arm([policy]))
    assert run.error[-1] < 1e-6
    if not gains:
        meant = tl.simulate(arm([fx.Controller(law, 0.02, delay=delay)])).q
        assert_near(run.q, meant, 1e-7)
    elif not delay:  # the limit of PD control of ever higher rates, to positions of the same network
        coarse, fine = (tl.simulate(arm([fx.Controller(inner(rate), 1.0 / rate, state=(0, None, None))]),
                                    verify=False).q for rate in (2000, 4000))  # fmt: skip
        assert_near(run.q, 2.0 * fine - coarse, 1e-5)


@pytest.mark.parametrize("late", [{"delay": 0.05}, {"start": 0.05}])
def test_positions_are_the_offset_until_the_first_answer_acts(tmp_path: Path, late: dict[str, float]) -> None:
    gains = {"kp": {"shoulder": 40.0, "elbow": 20.0}, "kd": {"shoulder": 4.0, "elbow": 2.0}}
    policy = fx.Policy(str(mlp(tmp_path / "one.onnx", (4, 8, 2))), 0.02, offset=(0.3, 0.2), **gains, **late)
    held = fx.JointPD({"shoulder": 0.3, "elbow": 0.2}, **gains)
    run, meant = (tl.simulate(arm([one]), 0.05, accuracy=1e-9) for one in (policy, held))
    assert_near(run.q, meant.q, 1e-9)
    assert tl.explain(arm([policy])).shares[-1].operations > 0


@pytest.mark.parametrize("kind", ["Relu", "Softsign"])
def test_a_run_with_a_policy_can_be_pickled(tmp_path: Path, kind: str) -> None:
    """Of networks of functions without a name here, and of onnx."""
    run = tl.simulate(arm([fx.Policy(str(mlp(tmp_path / "one.onnx", (4, 8, 2), kind)), 0.02)]), 0.1)
    again = pickle.loads(pickle.dumps(run))
    np.testing.assert_array_equal(again.at(0.05)[0], run.at(0.05)[0])
    tl.energy_book(run.scene, again)


def test_a_policy_reads_an_encoder_and_stands_beside_events(tmp_path: Path) -> None:
    encoder = fx.Encoder(("shoulder", "elbow"), period=0.01, quantum=1e-5)
    policy = fx.Policy(str(mlp(tmp_path / "one.onnx", (4, 16, 2))), 0.02, ("encoder", "joint_vel"), scale=4.0)
    stops = fx.JointStops({"shoulder": (-0.4, 0.5)}, restitution=0.3)
    run = tl.simulate(arm([encoder, policy, stops]))
    assert {event.kind for event in run.events} & {"impact"}
    assert np.isfinite(run.error[-1])


def test_a_quadruped_walks_on_its_observations(tmp_path: Path) -> None:
    robot = tl.load_robot("solo12", root="free")
    file = mlp(tmp_path / "one.onnx", (48, 128, 64, 12), gain=0.5)
    inputs = (fx.Observed("base_lin_vel", scale=2.0), fx.Observed("base_ang_vel", scale=0.25), "projected_gravity",
              fx.Observed("command", values=(0.5, 0.0, 0.0)), "joint_pos", fx.Observed("joint_vel", scale=0.05),
              "last_action")  # fmt: skip
    joints = tuple(one.name for one in robot.joints[1:])
    policy = fx.Policy(str(file), 0.02, inputs, joints, scale=0.25, kp=dict.fromkeys(joints, 3.0),
                       kd=dict.fromkeys(joints, 0.1))  # fmt: skip
    q = robot.neutral.copy()
    q[3:7] = np.array([0.1, -0.2, 0.3, 0.9]) / np.linalg.norm([0.1, -0.2, 0.3, 0.9])
    law, seen, v = policy.sampled.on(robot).update, list[Any](), np.arange(18.0)

    class Seeing:
        start = law.network.start

        def __call__(self, x: Any, kept: Any) -> Any:
            seen.append(x)
            return np.zeros((1, 12)), kept

    law.network = Seeing()
    law(0.0, Measured(q=q[None], v=v[None]), None)
    down = robot.frame_pose(q, "base_link")[0].T @ [0.0, 0.0, -1.0]
    assert_near(seen[0][0, 6:9], down, 1e-15)
    np.testing.assert_array_equal(seen[0][0, :6], np.concatenate([2.0 * v[:3], 0.25 * v[3:6]]))
    run = tl.simulate(tl.Scene(robot, q, effects=[fx.Gravity(), policy], duration=0.3))
    assert run.error[-1] < 1e-6
    turn = pin.Quaternion(*np.array([0.8, 0.3, -0.4, 0.33]) / np.linalg.norm([0.8, 0.3, -0.4, 0.33]))
    tilted = q.copy()  # all of the world is turned about the origin, gravity too
    tilted[:3], tilted[3:7] = turn.matrix() @ q[:3], (turn * pin.Quaternion(q[3:7])).coeffs()
    gravity = fx.Gravity(tuple(turn.matrix() @ [0.0, 0.0, -9.81]))
    other = tl.simulate(tl.Scene(robot, tilted, effects=[gravity, policy], duration=0.3))
    assert_near(other.q[-1, 7:], run.q[-1, 7:], 1e-7)
    assert_near(other.v[-1], run.v[-1], 1e-5)


def test_a_policy_observes_the_base_that_carries_its_joints(tmp_path: Path) -> None:
    """The entries of an object whose name comes before that of the base's joint are the first ones of q and v."""
    alone = tl.load_robot("anymal", root="free")
    joints = tuple(one.name for one in alone.joints[1:])
    copy = [("Gemm", "obs w", "actions", {"transB": 1})]
    file = written(tmp_path / "one.onnx", copy, {"w": np.eye(12, 9)}, {"obs": [1, 9]}, {"actions": [1, 12]})
    policy = fx.Policy(str(file), 0.02, ("base_lin_vel", "base_ang_vel", "projected_gravity"), joints)
    start = np.array([0.0, 0.0, 1.0, *pin.Quaternion(pin.rpy.rpyToMatrix(0.3, 0.2, 0.1)).coeffs()])
    moving = np.arange(1.0, 7.0)
    scene = tl.Scene(alone, {"root_joint": start}, {"root_joint": moving}, [fx.Gravity(), policy], 0.01)
    beside = scene.with_object("ball", (3.0, 0.0, 0.5))
    assert beside.base.joint_names[0] == "ball"
    tau = tl.simulate(beside).tau[0, 12:21]
    assert_near(tau[:6], moving, 1e-12)
    assert_near(tau[6:], -pin.rpy.rpyToMatrix(0.3, 0.2, 0.1)[2], 1e-12)
    arm_beside = tl.Scene(tl.load_robot("two_link")).with_object("ball", (3.0, 0.0, 0.5))
    with pytest.raises(SceneError, match="base is fixed"):  # the ball's is no base of the arm
        arm_beside.with_effects([fx.Policy(str(mlp(tmp_path / "two.onnx", (3, 8, 2))), 0.02, ("base_lin_vel",),
                                           ("shoulder", "elbow"))])  # fmt: skip


@pytest.mark.parametrize(("fields", "words"), [
    ({"inputs": ("joint_pos",)}, "6 inputs, here are 2"), ({"outputs": ("elbow",)}, "inputs, here are"),
    ({"scale": (1.0, 2.0, 3.0)}, "expected 2 numbers, got 3"), ({"kp": {"knee": 1.0}}, "knee"),
    ({"inputs": ("joint_pos", "joint_vel", "lastaction")}, "lastaction"),
    ({"inputs": ("joint_pos", "joint_vel", "base_lin_vel")}, "base is fixed"), ({"period": 0.0}, "above 0 s"),
    ({"kp": {"shoulder": 1.0}}, "no kp for joint 'elbow'"), ({"kd": {"elbow": 1.0}}, "no kp for joint 'shoulder'"),
    ({"content": "0" * 64}, "another network"), ({"clip": (1.0, -1.0)}, "low < high"), ({"clip": (1.0,)}, "low < high"),
    ({"inputs": (fx.Observed("joint_pos", clip=(2.0, 1.0)), "joint_vel", "last_action")}, r"inputs\[0\].clip"),
])  # fmt: skip
def test_what_does_not_fit_is_refused_by_name(tmp_path: Path, fields: Any, words: str) -> None:
    given = {"period": 0.02, "inputs": ("joint_pos", "joint_vel", "last_action")} | fields
    with pytest.raises(SceneError, match=words):
        arm([fx.Policy(str(mlp(tmp_path / "one.onnx")), **given)])


def test_the_content_of_a_file_is_that_of_its_weights_too(tmp_path: Path) -> None:
    """PyTorch puts them beside it: the file is the same after more training."""
    file = mlp(tmp_path / "one.onnx", (4, 8, 2))
    onnx.save(onnx.load(str(file)), str(file), save_as_external_data=True, location="weights", size_threshold=0)
    policy = fx.Policy(str(file), 0.02).pinned()
    arm([policy])
    weights = bytearray((tmp_path / "weights").read_bytes())
    weights[0] ^= 1
    (tmp_path / "weights").write_bytes(weights)
    with pytest.raises(SceneError, match="another network"):
        arm([fx.Policy(str(file), 0.02, content=policy.content)])


def test_networks_that_are_not_known_are_refused_by_operator(tmp_path: Path) -> None:
    nodes = [("RandomNormalLike", "obs", "x", {}), ("Hardmax", "x", "actions", {})]
    file = written(tmp_path / "one.onnx", nodes, {}, {"obs": [1, 2]}, {"actions": [1, 2]})
    with pytest.raises(SceneError, match="operations that are not known: Hardmax, RandomNormalLike"):
        read_network(file)
    (tmp_path / "two.onnx").write_bytes(b"no network")
    with pytest.raises(SceneError, match="there is no network"):
        read_network(tmp_path / "two.onnx")
