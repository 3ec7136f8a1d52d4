"""Networks in ONNX files, as functions of NumPy's arrays in double precision.

A file is a list of operations on named arrays. Rows are independent inputs: one call answers for all of them. The file
means float32, whose answers are steps of 1e-7; in double the same network is smooth, which an error bar calls for.
"""

import hashlib
import importlib.util
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from twolink.errors import CertificationError, SceneError, import_extra
from twolink.io.files import may_be_read

Array = np.ndarray[Any, np.dtype[Any]]
AGREEMENT, QUESTIONS, SEED = 1e-4, 64, 0  # relative, of float32, with onnxruntime; random inputs, and their seed


class _Node(NamedTuple):
    kind: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    given: Mapping[str, Any]


def _sigmoid(x: Array) -> Array:
    return 0.5 + 0.5 * np.tanh(0.5 * x)


def _elu(x: Array, alpha: float = 1.0) -> Array:
    return np.where(x > 0.0, x, alpha * np.expm1(np.minimum(x, 0.0)))


def _gemm(a: Array, b: Array, c: Any = 0.0, **given: Any) -> Array:
    left, right = a.T if given.get("transA") else a, b.T if given.get("transB") else b
    return np.asarray(given.get("alpha", 1.0) * (left @ right) + given.get("beta", 1.0) * c)


def _reshaped(x: Array, shape: Array, *, allowzero: int = 0) -> Array:
    wanted = [x.shape[i] if n == 0 and not allowzero else int(n) for i, n in enumerate(shape)]
    if wanted and wanted[0] == 1 and len(x) > 1:  # a file of one row, asked for many
        wanted[0] = len(x)
    return x.reshape(wanted)


def _sliced(x: Array, starts: Array, ends: Array, axes: Any = None, steps: Any = None) -> Array:
    for k, axis in enumerate(range(len(starts)) if axes is None else np.ravel(axes)):
        chosen = slice(int(starts[k]), int(ends[k]), None if steps is None else int(steps[k]))
        x = x[(slice(None),) * (int(axis) % x.ndim) + (chosen,)]
    return x


def _by_gates(x: Array, w: Array, r: Array, b: Any, h: Any, c: Any, step: Callable[..., Any]) -> tuple[Array, ...]:
    """Outputs (time, 1, n, hidden) and last states (1, n, hidden) of a cell, one direction, from x (time, n, size)."""
    size, rows = r.shape[-1], x.shape[1]
    bias = np.zeros(2 * w.shape[1]) if b is None else b[0]
    h, c = (np.zeros((rows, size)) if one is None else one[0] for one in (h, c))
    out = []
    for at in x:
        h, c = step(at @ w[0].T, h @ r[0].T, *np.split(bias, 2), h, c)
        out.append(h)
    return np.stack(out)[:, None], h[None], c[None]


def _lstm(x: Array, w: Array, r: Array, b: Any = None, _: Any = None, *kept: Any) -> tuple[Array, ...]:
    def step(from_x: Array, from_h: Array, wb: Array, rb: Array, _: Array, c: Array) -> tuple[Array, Array]:
        i, o, f, new = np.split(from_x + from_h + wb + rb, 4, axis=-1)
        c = _sigmoid(f) * c + _sigmoid(i) * np.tanh(new)
        return _sigmoid(o) * np.tanh(c), c

    h, c = kept or (None, None)
    return _by_gates(x, w, r, b, h, c, step)


def _gru(x: Array, w: Array, r: Array, b: Any = None, _: Any = None, h: Any = None, *,
         linear_before_reset: int = 0) -> tuple[Array, ...]:  # fmt: skip
    def step(from_x: Array, from_h: Array, wb: Array, rb: Array, h: Array, c: Array) -> tuple[Array, Array]:
        (xz, xr, xn), (hz, hr, hn), (bz, br, bn) = (np.split(one, 3, axis=-1) for one in (from_x + wb, from_h, rb))
        z, reset = _sigmoid(xz + hz + bz), _sigmoid(xr + hr + br)
        inner = reset * (hn + bn) if linear_before_reset else (reset * h) @ r[0][2 * r.shape[-1] :].T + bn
        return (1.0 - z) * np.tanh(xn + inner) + z * h, c

    return _by_gates(x, w, r, b, h, None, step)[:2]


_OPERATIONS: dict[str, Callable[..., Any]] = {
    "Gemm": _gemm, "MatMul": np.matmul, "Add": np.add, "Sub": np.subtract, "Mul": np.multiply, "Div": np.divide,
    "Relu": lambda x: np.maximum(x, 0.0), "Elu": _elu, "Tanh": np.tanh, "Sigmoid": _sigmoid,
    "LeakyRelu": lambda x, alpha=0.01: np.where(x > 0.0, x, alpha * x), "Softplus": lambda x: np.logaddexp(x, 0.0),
    "Selu": lambda x, alpha=1.6732632423543772, gamma=1.0507009873554805: gamma * _elu(x, alpha),
    "Identity": lambda x: x, "Clip": lambda x, low=None, high=None, min=None, max=None: np.clip(
        x, min if low is None else low, max if high is None else high),
    "Concat": lambda *x, axis: np.concatenate(x, axis), "Constant": lambda **given: next(iter(given.values())),
    "Flatten": lambda x, axis=1: x.reshape(int(np.prod(x.shape[:axis])), -1), "Reshape": _reshaped, "Slice": _sliced,
    "Gather": lambda x, k, axis=0: np.take(x, k.astype(int), axis), "Transpose": lambda x, perm=None: x.transpose(perm),
    "Squeeze": lambda x, k=None, axes=None: x.squeeze(tuple(np.ravel(axes if k is None else k).astype(int))),
    "Unsqueeze": lambda x, k=None, axes=None: np.expand_dims(x, tuple(np.ravel(axes if k is None else k).astype(int))),
    "LSTM": _lstm, "GRU": _gru,
}  # fmt: skip
# Attributes with these values change nothing; others would, and are refused.
_PLAIN = {"direction": "forward", "layout": 0}


class Network(NamedTuple):
    """A network: (x, memory) -> (y, memory), of rows x (n, inputs).

    inputs, outputs: how many. memory: the shapes of what a recurrent one keeps, with 1 in place of the rows, and their
    axes.
    """

    nodes: tuple[_Node, ...]
    constants: Mapping[str, Array]
    names: tuple[tuple[str, ...], tuple[str, ...]]
    inputs: int
    outputs: int
    memory: tuple[tuple[tuple[int, ...], int], ...]

    def __call__(self, x: Array, memory: Sequence[Array] = ()) -> tuple[Array, tuple[Array, ...]]:
        """The outputs (n, outputs) of rows (n, inputs), and what it keeps."""
        kept = [np.moveaxis(one, 0, axis) for one, (_, axis) in zip(memory, self.memory, strict=True)]
        known: dict[str, Any] = {**self.constants, **dict(zip(self.names[0], (x, *kept), strict=True)), "": None}
        for node in self.nodes:
            made = _OPERATIONS[node.kind](*(known[name] for name in node.inputs), **node.given)
            known.update(zip(node.outputs, made if isinstance(made, tuple) else (made,), strict=False))
        y, *kept = (known[name] for name in self.names[1])
        return np.asarray(y).reshape(len(x), -1), tuple(
            np.moveaxis(one, axis, 0) for one, (_, axis) in zip(kept, self.memory, strict=True))  # fmt: skip

    def start(self, rows: int) -> tuple[Array, ...]:
        """The start of what it keeps: zeros, in rows."""
        return tuple(np.zeros((rows, *shape[:axis], *shape[axis + 1 :])) for shape, axis in self.memory)


def file_digest(path: Path | str) -> str:
    """The SHA-256 of a file."""
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


def read_network(path: Path | str, content: str = "") -> Network:
    """Read a network from an ONNX file. content: its SHA-256, where it must not be another one.

    Its first input and output are the rows; further ones are what it keeps, in the same order. Where onnxruntime is
    installed, its answers to random inputs are compared.

    Raises
    ------
    SceneError
        There is no such network, or it has operations that are not known (code "network").
    CertificationError
        onnxruntime gives other answers.
    MissingExtraError
        onnx is not installed.
    """
    onnx, path = import_extra("onnx", "onnx"), Path(path)
    if not may_be_read(path):
        raise SceneError("this file may not be read", where=str(path), code="network")
    if content and path.is_file() and (found := file_digest(path)) != content:
        raise SceneError(f"it is another network: its SHA-256 is {found:.12} and not {content:.12}", where=str(path),
                         remedy="give the file that was meant, or leave `content` out", code="network")  # fmt: skip
    try:
        model = onnx.load(str(path))
    except Exception as error:  # of protobuf any
        raise SceneError(f"there is no network: {error}", where=str(path), remedy="export the policy to ONNX",
                         code="network") from error  # fmt: skip
    graph, array = model.graph, onnx.numpy_helper.to_array
    nodes = tuple(_Node(one.op_type, tuple(one.input), tuple(one.output), _given(one, onnx)) for one in graph.node)
    if unknown := sorted({one.kind for one in nodes} - {*_OPERATIONS}) + _refused(nodes):
        raise SceneError(f"operations that are not known: {', '.join(unknown)}", where=str(path), code="network",
                         remedy=f"one of {', '.join(_OPERATIONS)}")  # fmt: skip
    constants = {one.name: _double(array(one)) for one in graph.initializer}
    ins = {one.name: _shape(one) for one in graph.input if one.name not in constants}
    outs = {one.name: _shape(one) for one in graph.output}
    if len(ins) != len(outs) or not ins or max(ins[next(iter(ins))][-1:], default=0) < 1:
        raise SceneError(f"a network with the inputs {ins} and outputs {outs}", where=str(path), code="network",
                         remedy="one input (n, size), then what it keeps, and the same of the outputs")  # fmt: skip
    (_, first), *kept = ins.items()
    memory = tuple((shape, max(0, len(shape) - 2)) for _, shape in kept)
    network = Network(nodes, constants, (tuple(ins), tuple(outs)), first[-1], 0, memory)
    try:
        y, _ = network(np.zeros((1, first[-1])), network.start(1))
    except Exception as error:  # of NumPy any
        raise SceneError(f"the network gives no answer: {error}", where=str(path), code="network") from error
    network = network._replace(outputs=y.shape[1])
    if importlib.util.find_spec("onnxruntime") is not None:
        _certify(network, path)
    return network


def _certify(network: Network, path: Path) -> None:
    """Require onnxruntime's answers to random inputs, row by row. Raises CertificationError."""
    session = import_extra("onnxruntime", "onnx").InferenceSession(str(path), providers=["CPUExecutionProvider"])
    x, kept = np.random.default_rng(SEED).standard_normal((QUESTIONS, network.inputs)), network.start(1)
    for row in x:
        given = {name: one if name == network.names[0][0] else np.moveaxis(one, 0, axis) for name, one, axis in zip(
            network.names[0], (row[None], *kept), (0, *(axis for _, axis in network.memory)), strict=True)}  # fmt: skip
        theirs = session.run(list(network.names[1]), {name: one.astype(np.float32) for name, one in given.items()})
        ours, kept = network(row[None], kept)
        for one, other in zip((ours, *kept), theirs, strict=True):
            if not np.abs(one - other.reshape(one.shape)).max() <= AGREEMENT * (1.0 + np.abs(other).max()):
                raise CertificationError(f"onnxruntime gives {other.ravel()[:3]} for {one.ravel()[:3]}",
                                         where=str(path), remedy="report it, with the file")  # fmt: skip


def _given(node: Any, onnx: Any) -> dict[str, Any]:
    """The attributes of a node that its operation needs."""
    found = {}
    for attribute in node.attribute:
        name, one = attribute.name, onnx.helper.get_attribute_value(attribute)
        one = one.decode() if isinstance(one, bytes) else one
        if name != "hidden_size" and (name not in _PLAIN or _PLAIN[name] != one):
            found[name] = _double(onnx.numpy_helper.to_array(one)) if hasattr(one, "raw_data") else one
    return found


def _refused(nodes: Sequence[_Node]) -> list[str]:
    """Attributes that ask for what is not known."""
    return sorted({f"{one.kind} with {name}" for one in nodes for name in one.given
                   if name in {**_PLAIN, "activations": 0, "clip": 0, "input_forget": 0}})  # fmt: skip


def _double(x: Array) -> Array:
    return x.astype(float) if x.dtype.kind == "f" else x


def _shape(value: Any) -> tuple[int, ...]:
    """The shape of an input or output, with 1 where it has a name."""
    return tuple(int(one.dim_value) or 1 for one in value.type.tensor_type.shape.dim)
