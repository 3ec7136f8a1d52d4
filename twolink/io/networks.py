"""Networks in ONNX files, as functions of NumPy's arrays in double precision.

A file is a list of operations on named arrays. Rows are independent inputs: one call answers for all of them. The file
means float32, whose answers are steps of 1e-7; in double the same network is smooth, which an error bar calls for.
Operations that ticks call most are here; others are onnx's own in NumPy.
"""

import functools
import hashlib
import importlib.util
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from twolink.errors import CertificationError, SceneError, TwolinkError, import_extra
from twolink.io.files import may_be_read

Array = np.ndarray[Any, np.dtype[Any]]
AGREEMENT, QUESTIONS, SEED = 1e-4, 64, 0  # relative, of float32, with onnxruntime; random inputs, and their seed


class _Node(NamedTuple):
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    run: Callable[..., Any]


def _sigmoid(x: Array) -> Array:
    return 0.5 + 0.5 * np.tanh(0.5 * x)


def _elu(x: Array, alpha: float = 1.0) -> Array:
    return np.where(x > 0.0, x, alpha * np.expm1(np.minimum(x, 0.0)))


def _gemm(a: Array, b: Array, c: Any = 0.0, **given: Any) -> Array:
    left, right = a.T if given.get("transA") else a, b.T if given.get("transB") else b
    return np.asarray(given.get("alpha", 1.0) * (left @ right) + given.get("beta", 1.0) * c)


def _erf(x: Array) -> Array:
    from scipy.special import erf  # onnx's own is of float32

    return np.asarray(erf(x))


def _gelu(x: Array, approximate: str = "none") -> Array:
    inner = np.tanh(np.sqrt(2.0 / np.pi) * (x + 0.044715 * x**3)) if approximate == "tanh" else _erf(x / np.sqrt(2.0))
    return np.asarray(0.5 * x * (1.0 + inner))


def _div(a: Array, b: Array) -> Array:
    return a / b if a.dtype.kind == "f" else np.trunc(a / b).astype(a.dtype)  # of shapes


def _cast(x: Array, to: int, **_: Any) -> Array:
    wanted = np.dtype(import_extra("onnx", "onnx").helper.tensor_dtype_to_np_dtype(to))
    return x.astype(wanted if wanted.kind in "biu" else float)


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
    "Gemm": _gemm, "MatMul": np.matmul, "Add": np.add, "Sub": np.subtract, "Mul": np.multiply, "Div": _div,
    "Relu": lambda x: np.maximum(x, 0.0), "Elu": _elu, "Tanh": np.tanh, "Sigmoid": _sigmoid,
    "Softplus": lambda x: np.logaddexp(x, 0.0), "Clip": lambda x, low=None, high=None, min=None, max=None: np.clip(
        x, min if low is None else low, max if high is None else high),
    "Concat": lambda *x, axis: np.concatenate(x, axis), "Cast": _cast, "Erf": _erf, "Gelu": _gelu,
    "LSTM": _lstm, "GRU": _gru,
}  # fmt: skip
# Of the others those that onnx computes in double, and that have no chance in them.
_OF_ONNX = {
    "Abs", "And", "BatchNormalization", "Celu", "Constant", "ConstantOfShape", "Conv", "Cos", "Equal", "Exp",
    "Expand", "Flatten", "Floor", "Gather", "Greater", "GreaterOrEqual", "HardSigmoid", "HardSwish",
    "Identity", "LayerNormalization", "LeakyRelu", "Less", "LessOrEqual", "Log", "LogSoftmax", "Max", "Mean", "Min",
    "Mish", "Neg", "Not", "Or", "PRelu", "Pow", "Range", "Reciprocal", "ReduceL2", "ReduceMax", "ReduceMean",
    "ReduceMin", "ReduceSum", "Reshape", "Selu", "Shape", "Sign", "Sin", "Slice", "Softmax", "Softsign", "Split",
    "Sqrt", "Squeeze", "Sum", "Swish", "Tile", "Transpose", "Unsqueeze", "Where",
}  # fmt: skip
# Attributes of cells with these values change nothing; others would, and are refused.
_PLAIN = {"direction": "forward", "layout": 0, "input_forget": 0}


class Network(NamedTuple):
    """A network: (x, memory) -> (y, memory), of rows x (n, inputs).

    inputs, outputs: how many. memory: the shapes of what a recurrent one keeps, with 1 in place of the rows, and their
    axes. together: whether it answers rows at once as alone; files of one row may not, and are asked for each.
    """

    nodes: tuple[_Node, ...]
    constants: Mapping[str, Array]
    names: tuple[tuple[str, ...], tuple[str, ...]]
    inputs: int
    outputs: int
    memory: tuple[tuple[tuple[int, ...], int], ...]
    together: bool = True

    def __call__(self, x: Array, memory: Sequence[Array] = ()) -> tuple[Array, tuple[Array, ...]]:
        """The outputs (n, outputs) of rows (n, inputs), and what it keeps."""
        if not self.together and len(x) > 1:
            each = [self(x[i : i + 1], [one[i : i + 1] for one in memory]) for i in range(len(x))]
            after = zip(*(rows for _, rows in each), strict=True)
            return np.concatenate([y for y, _ in each]), tuple(np.concatenate(rows) for rows in after)
        kept = [np.moveaxis(one, 0, axis) for one, (_, axis) in zip(memory, self.memory, strict=True)]
        known: dict[str, Any] = {**self.constants, **dict(zip(self.names[0], (x, *kept), strict=True)), "": None}
        for node in self.nodes:
            made = node.run(*(known[name] for name in node.inputs))
            known.update(zip(node.outputs, made if isinstance(made, tuple) else (made,), strict=False))
        y, *kept = (known[name] for name in self.names[1])
        return np.asarray(y).reshape(len(x), -1), tuple(
            np.moveaxis(one, axis, 0) for one, (_, axis) in zip(kept, self.memory, strict=True))  # fmt: skip

    def start(self, rows: int) -> tuple[Array, ...]:
        """The start of what it keeps: zeros, in rows."""
        return tuple(np.zeros((rows, *shape[:axis], *shape[axis + 1 :])) for shape, axis in self.memory)


def file_digest(path: Path | str) -> str:
    """The SHA-256 of a file, with those of weights that it names."""
    graph = import_extra("onnx", "onnx").load(str(path), load_external_data=False).graph
    named = {entry.value for one in graph.initializer for entry in one.external_data if entry.key == "location"}
    files = [Path(path), *(Path(path).parent / name for name in sorted(named))]
    return hashlib.sha256(b"".join(one.read_bytes() for one in files)).hexdigest()


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
    onnx, path, where = import_extra("onnx", "onnx"), Path(path), str(path)
    if not may_be_read(path):
        raise SceneError("this file may not be read", where=where, code="network")
    try:
        model = onnx.load(where)
    except Exception as error:  # of protobuf any
        raise SceneError(f"there is no network: {error}", where=where, remedy="export the policy to ONNX",
                         code="network") from error  # fmt: skip
    if content and (found := file_digest(path)) != content:
        raise SceneError(f"it is another network: its SHA-256 is {found:.12} and not {content:.12}", where=where,
                         remedy="give the file that was meant, or leave `content` out", code="network")  # fmt: skip
    graph = model.graph
    constants = {one.name: _double(onnx.numpy_helper.to_array(one)) for one in graph.initializer}
    ins = {one.name: _shape(one) for one in graph.input if one.name not in constants}
    outs = {one.name: _shape(one) for one in graph.output}
    if len(ins) == 1:  # a critic's value is not asked for
        outs = dict([*outs.items()][:1])
    if len(ins) != len(outs) or not ins or max(ins[next(iter(ins))][-1:], default=0) < 1:
        raise SceneError(f"a network with the inputs {ins} and outputs {outs}", where=where, code="network",
                         remedy="one input (n, size), then what it keeps, and the same of the outputs")  # fmt: skip
    (_, first), *kept = ins.items()
    memory = tuple((shape, max(0, len(shape) - 2)) for _, shape in kept)
    try:
        nodes = _folded(_nodes(model, onnx, outs, where), constants)
        network = Network(nodes, constants, (tuple(ins), tuple(outs)), first[-1], 0, memory)
        y, _ = network(np.random.default_rng(SEED).normal(size=(1, first[-1])), network.start(1))
        network = network._replace(outputs=y.shape[1], together=_answers_together(network))
        if importlib.util.find_spec("onnxruntime") is not None:
            _certify(network, path)
    except TwolinkError:
        raise
    except Exception as error:  # of NumPy and onnx any
        raise SceneError(f"the network gives no answer: {error}", where=where, code="network") from error
    return network


def _nodes(model: Any, onnx: Any, outs: Collection[str], where: str) -> list[_Node]:
    """The operations that the outputs need. Raises SceneError for those that are not known."""
    needed, found = set(outs), list[int]()
    for k, one in reversed([*enumerate(model.graph.node)]):
        if needed & set(one.output):
            needed |= set(one.input)
            found.insert(0, k)
    used = [model.graph.node[k] for k in found]
    kinds = {f"{one.domain}.{one.op_type}".removeprefix("ai.onnx.").removeprefix(".") for one in used}
    refused = {name for one in used for name in _refused(one, onnx)}
    if unknown := sorted(kinds - {*_OPERATIONS} - _OF_ONNX) + sorted(refused):
        raise SceneError(f"operations that are not known: {', '.join(unknown)}", where=where, code="network",
                         remedy=f"one of {', '.join(sorted([*_OPERATIONS, *_OF_ONNX]))}")  # fmt: skip
    theirs: Sequence[Any] = ()
    if kinds - {*_OPERATIONS}:
        theirs = import_extra("onnx.reference", "onnx").ReferenceEvaluator(model).rt_nodes_
    runs = [functools.partial(_OPERATIONS[one.op_type], **_given(one, onnx)) if one.op_type in _OPERATIONS
            else functools.partial(_in_double, theirs[k].run) for k, one in zip(found, used, strict=True)]  # fmt: skip
    return [_Node(tuple(one.input), tuple(one.output), run) for one, run in zip(used, runs, strict=True)]


def _in_double(run: Callable[..., Any], *given: Any) -> tuple[Array, ...]:
    """The results of an operation of onnx."""
    return tuple(_double(np.asarray(one)) for one in run(*given))


def _folded(nodes: Sequence[_Node], constants: dict[str, Array]) -> tuple[_Node, ...]:
    """The operations on what is no constant; the results of the others become constants."""
    left = []
    for node in nodes:
        if all(name in constants for name in node.inputs if name):
            made = node.run(*(constants.get(name) for name in node.inputs))
            constants.update(zip(node.outputs, made if isinstance(made, tuple) else (made,), strict=False))
        else:
            left.append(node)
    return tuple(left)


def _answers_together(network: Network) -> bool:
    """True if rows that are asked at once have the answers that they have alone."""
    random = np.random.default_rng(SEED)
    x, *kept = (random.normal(size=size) for size in ((3, network.inputs), *(one.shape for one in network.start(3))))
    y, after = network._replace(together=False)(x, kept)
    try:
        found, left = network(x, kept)
    except ValueError:  # of shapes
        return False
    return all(np.allclose(one, other, rtol=1e-9, atol=1e-9)
               for one, other in zip((y, *after), (found, *left), strict=True))  # fmt: skip


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
    found = {one.name: onnx.helper.get_attribute_value(one) for one in node.attribute if one.name != "hidden_size"}
    found = {name: one.decode() if isinstance(one, bytes) else one for name, one in found.items()}
    return {name: one for name, one in found.items() if name not in _PLAIN or _PLAIN[name] != one}


def _refused(node: Any, onnx: Any) -> list[str]:
    """Attributes of a cell that ask for what is not known."""
    if node.op_type not in ("LSTM", "GRU"):
        return []
    return [f"{node.op_type} with {name}" for name in _given(node, onnx) if name in {*_PLAIN, "activations", "clip"}]


def _double(x: Array) -> Array:
    return x.astype(float) if x.dtype.kind == "f" else x


def _shape(value: Any) -> tuple[int, ...]:
    """The shape of an input or output, with 1 where it has a name."""
    return tuple(int(one.dim_value) or 1 for one in value.type.tensor_type.shape.dim)
