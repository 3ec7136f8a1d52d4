"""A network from an ONNX file as the controller of the paper's arm, at 50 Hz, with an error bar.

The file is made here by behaviour cloning: a network of two layers imitates a computed-torque law, its last layer
fitted by least squares on states that the law was asked at.
"""

from pathlib import Path

import numpy as np

import twolink as tl

fx = tl.effects
TARGET, KP, KD, HIDDEN = np.array([0.4, -0.2]), 25.0, 8.0, 256
REACH, SPEED, SAMPLES = 1.5, 3.0, 8000  # rad and rad/s, around what the network will see


def expert(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """The torques (n, 2) of M(q) (kp (target - q) - kd v) + h(q, v), for states (n, 2)."""
    return tl.load_robot("two_link").inverse_dynamics(q, v, KP * (TARGET - q) - KD * v)


def states(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """q and v (n, 2) to learn from, or to judge by."""
    random = np.random.default_rng(seed)
    return random.uniform(-REACH, REACH, (SAMPLES, 2)), random.uniform(-SPEED, SPEED, (SAMPLES, 2))


def train(seed: int = 0) -> dict[str, np.ndarray]:
    """The weights and biases w0, b0, w1, b1 of the clone."""
    random, (q, v) = np.random.default_rng(seed), states(seed + 1)
    w, b = random.normal(size=(HIDDEN, 4)) / [REACH, REACH, SPEED, SPEED], random.uniform(-2.0, 2.0, HIDDEN)
    hidden = np.append(np.tanh(np.hstack([q, v]) @ w.T + b), np.ones((len(q), 1)), axis=1)
    ridge = 1e-2 * np.eye(HIDDEN + 1)  # large weights would make it rough
    last = np.linalg.solve(hidden.T @ hidden + ridge, hidden.T @ expert(q, v)).T
    return {"w0": w, "b0": b, "w1": last[:, :-1], "b1": last[:, -1]}


def missed(weights: dict[str, np.ndarray], seed: int = 99) -> float:
    """The clone's mean square error over the torques' variance, at states that it has not seen."""
    q, v = states(seed)
    answers = np.tanh(np.hstack([q, v]) @ weights["w0"].T + weights["b0"]) @ weights["w1"].T + weights["b1"]
    return float(((answers - expert(q, v)) ** 2).mean() / expert(q, v).var(axis=0).mean())


def write_network(path: Path, seed: int = 0) -> Path:
    """Train, and write (q, v) -> torques as an ONNX file."""
    from onnx import TensorProto, helper, numpy_helper, save

    nodes = [helper.make_node("Gemm", ["obs", "w0", "b0"], ["sum"], transB=1), helper.make_node("Tanh", ["sum"], ["h"]),
             helper.make_node("Gemm", ["h", "w1", "b1"], ["actions"], transB=1)]  # fmt: skip
    shapes = [
        helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, n]) for name, n in (("obs", 4), ("actions", 2))
    ]
    weights = [numpy_helper.from_array(x.astype(np.float32), name) for name, x in train(seed).items()]
    graph = helper.make_graph(nodes, "policy", shapes[:1], shapes[1:], weights)
    save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9), str(path))
    return path


def scene(path: Path, delay: float = 0.0, bits: int = 0) -> tl.Scene:
    """The arm from rest, straight out, under the network. bits: of an encoder at 200 Hz; 0: none."""
    seen, sensors = "joint_pos", []
    if bits:
        encoder = fx.Encoder(("shoulder", "elbow"), name="encoder", period=0.005, quantum=2 * np.pi / 2**bits)
        seen, sensors = "encoder", [encoder]
    policy = fx.Policy(str(path), period=0.02, inputs=(seen, "joint_vel"), delay=delay)
    return tl.Scene(tl.load_robot("two_link"), effects=[fx.Gravity(), *sensors, policy], duration=3.0,
                    title="A network's torques")  # fmt: skip


def trusted(run: tl.Trajectory, bar: float) -> float:
    """The time until which the error bar is below `bar`, rad."""
    over = np.flatnonzero(run.error > bar)
    return float(run.t[over[0] - 1] if len(over) else run.t[-1])


if __name__ == "__main__":
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        run = tl.simulate(scene(write_network(Path(folder) / "policy.onnx")))
        print(run)
        print("error bar at the end:", run.error[-1], "rad")
