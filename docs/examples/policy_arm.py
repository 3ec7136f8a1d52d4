"""A network from an ONNX file as the controller of the paper's arm, at 50 Hz, with an error bar.

The file is made here: a network of two layers that imitates a PD law, fitted by least squares on its last layer.
"""

from pathlib import Path

import numpy as np

import twolink as tl

fx = tl.effects
TARGET, KP, KD, HIDDEN = np.array([0.4, -0.2]), 25.0, 6.0, 64


def write_network(path: Path, seed: int = 0) -> Path:
    """Write (q, v, last action) -> torques as an ONNX file."""
    from onnx import TensorProto, helper, numpy_helper, save

    rng = np.random.default_rng(seed)
    x = rng.uniform(-2.0, 2.0, (4000, 6))
    meant = KP * (TARGET - x[:, :2]) - KD * x[:, 2:4]
    w, b = rng.normal(size=(HIDDEN, 6)) * [1, 1, 1, 1, 0, 0], rng.normal(size=HIDDEN)
    features = np.append(np.tanh(x @ w.T + b), np.ones((len(x), 1)), axis=1)
    last = np.linalg.lstsq(features, meant, rcond=None)[0].T
    numbers = {"w0": w, "b0": b, "w1": last[:, :-1], "b1": last[:, -1]}
    nodes = [helper.make_node("Gemm", ["obs", "w0", "b0"], ["sum"], transB=1), helper.make_node("Tanh", ["sum"], ["h"]),
             helper.make_node("Gemm", ["h", "w1", "b1"], ["actions"], transB=1)]  # fmt: skip
    shapes = [
        helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, n]) for name, n in (("obs", 6), ("actions", 2))
    ]
    weights = [numpy_helper.from_array(x.astype(np.float32), name) for name, x in numbers.items()]
    graph = helper.make_graph(nodes, "policy", shapes[:1], shapes[1:], weights)
    save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9), str(path))
    return path


def scene(path: Path, delay: float = 0.0) -> tl.Scene:
    """The arm from rest, straight out, under the network."""
    policy = fx.Policy(str(path), period=0.02, inputs=("joint_pos", "joint_vel", "last_action"), delay=delay)
    return tl.Scene(
        tl.load_robot("two_link"), effects=[fx.Gravity(), policy], duration=3.0, title="A network's torques"
    )


if __name__ == "__main__":
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        run = tl.simulate(scene(write_network(Path(folder) / "policy.onnx")))
        print(run)
        print("error bar at the end:", run.error[-1], "rad")
