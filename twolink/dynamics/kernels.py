"""Kernels: a function traced over a robot's constants and compiled by heyoka, and calling it on batches.

All checks of the values are compiled into the kernel as one more output, the guard: a number that is finite if and
only if all inputs and outputs are finite, all angles are within the reach of `sin_cos`, and quaternions and (cos, sin)
pairs have length 1. A batch whose guard is not finite is answered by Pinocchio, after a check of each value.
"""

import functools
import itertools
import math
import sys
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from twolink.algorithms.functions import Function
from twolink.algorithms.mechanism import mechanism
from twolink.algorithms.namespaces import Expressions
from twolink.algorithms.operation_count import Tape
from twolink.algorithms.sincos import LIMIT
from twolink.dynamics.arguments import UNIT_TOLERANCE
from twolink.dynamics.threads import is_forked_child, is_shared, thread_count
from twolink.robots.joint_layout import joint_layouts

CHUNK_BYTES = 2**21  # of inputs and outputs together: they stay in the cache
CHUNK_WORK = 6_000_000  # operations of a chunk at least: smaller chunks spend their time in calls
STACK_BYTES = 2**25
LANES = 8  # chunks are multiples of it, as of every vector length that heyoka takes
THREADS_FROM = 1_000_000  # operations in a call from which threads pay (scripts/bench_queries.py)
SINE = 20  # operations of our sine or cosine
SMALL = 200  # operations of a kernel that is small

_local = threading.local()
_threads_lock = threading.Lock()
_import_lock = threading.Lock()


def heyoka() -> Any:
    """The heyoka module, or None where it is not installed (there are wheels for Linux only)."""
    with _import_lock:
        return _imported()


@functools.cache
def _imported() -> Any:
    """heyoka, imported without what nothing here uses.

    It imports SymPy where it can, for conversions: more than half of its import time. It keeps a database of compiled
    code in the user's cache folder, up to 20 GB, which each process checks from end to end before it compiles anything,
    and up to 2 GB of code in memory after its functions are gone. Our own cache has what is compiled here.
    """
    hidden = "sympy" not in sys.modules
    if hidden:
        sys.modules["sympy"] = None  # type: ignore[assignment]  # makes its import fail
    try:
        import heyoka as module
    except ImportError:
        return None
    finally:
        if hidden:
            del sys.modules["sympy"]
    module.llvm_state.set_diskcache_enabled(False)
    module.llvm_state.set_memcache_limit(0)
    return module


@dataclass(frozen=True)
class Kernel:
    """A compiled function. `cfunc` takes the first argument as its variables, the others as its parameters.

    sizes: entries of each argument, run-time parameters last, one each. operations: counted before compiling.
    """

    name: str
    shape: tuple[int, ...]
    sizes: tuple[int, ...]
    cfunc: Any
    operations: dict[str, int]

    @property
    def work(self) -> int:
        """Floating-point operations a state."""
        return _work(self.operations)

    def __call__(self, arguments: Sequence[np.ndarray]) -> np.ndarray | None:
        """The results (n, *shape) for arguments (n, size) each; None when the guard is not finite.

        Arrays whose memory holds one state a column (transposed views) are taken as they are, and the result is such
        a view; others go through cache-sized buffers.
        """
        if not len(arguments[0]):
            return np.empty((0, *self.shape))
        if all(_is_columns(a) for a in arguments):
            return self._columns([a.T for a in arguments])
        return self._rows(arguments)

    def _columns(self, arguments: Sequence[np.ndarray]) -> np.ndarray | None:
        """Arguments (size, n) whole: heyoka's threads share the call."""
        count, entries = arguments[0].shape[1], math.prod(self.shape)
        out = np.empty((entries + 1, count))
        pars = {"pars": _stacked(arguments[1:])} if len(arguments) > 1 else {}
        self.cfunc(arguments[0], outputs=out, batch_parallel=pays_threads(count, self.work), **pars)
        if not math.isfinite(out[-1].sum()):
            return None
        odd = count % LANES
        if odd:  # heyoka answers an incomplete vector by scalar code, which may round differently
            tail = self._rows([np.ascontiguousarray(a[:, -odd:].T) for a in arguments])
            if tail is None:
                return None
            out[:-1, -odd:] = tail.reshape(odd, entries).T
        return out[:-1].T.reshape(count, *self.shape) if len(self.shape) != 1 else out[:-1].T

    def _rows(self, arguments: Sequence[np.ndarray]) -> np.ndarray | None:
        """Arguments (n, size) through buffers that hold one state a column, a chunk at a time."""
        count, entries = len(arguments[0]), math.prod(self.shape)
        width = sum(self.sizes) + entries + 1
        chunk = max(512, CHUNK_BYTES // (8 * width), CHUNK_WORK // max(1, self.work)) // LANES * LANES
        result = np.empty((count, entries))
        for start in range(0, count, chunk):
            if not self._chunk(arguments, result, start, min(start + chunk, count)):
                return None
        return result.reshape(count, *self.shape)

    def _chunk(self, arguments: Sequence[np.ndarray], result: np.ndarray, start: int, stop: int) -> bool:
        """Write the states from start to stop into the result; returns whether the guard is finite."""
        entries, count = result.shape[1], stop - start
        first, parameters, out = self._buffers(-(-count // LANES) * LANES, entries)
        first[:, :count] = arguments[0][start:stop].T
        first[:, count:] = arguments[0][stop - 1, :, None]  # the last state fills up the last vector
        row = 0
        for values, size in zip(arguments[1:], self.sizes[1:], strict=True):
            parameters[row : row + size, :count] = values[start:stop].T
            parameters[row : row + size, count:] = values[stop - 1, :, None]
            row += size
        pars = {"pars": parameters} if row else {}
        self.cfunc(first, outputs=out, batch_parallel=pays_threads(count, self.work), **pars)
        if not math.isfinite(out[-1].sum()):
            return False
        if entries < 5:
            for k in range(entries):  # a column at a time: four times faster than a transposed copy of so few
                result[start:stop, k] = out[k, :count]
        else:
            result[start:stop] = out[:-1, :count].T
        return True

    def _buffers(self, count: int, entries: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """This thread's buffers for `count` states, kept from call to call."""
        rows = (self.sizes[0], sum(self.sizes[1:]), entries + 1)
        key = (count, *rows)
        if getattr(_local, "key", None) != key:
            _local.key, _local.buffers = key, tuple(np.empty((n, count)) for n in rows)
        buffers: tuple[np.ndarray, np.ndarray, np.ndarray] = _local.buffers
        return buffers


def _stacked(arrays: Sequence[np.ndarray]) -> np.ndarray:
    """Arrays (size, n) one under the other, in this thread's buffer; one alone is taken as it is.

    The buffer is kept from call to call up to STACK_BYTES: new memory costs as much as copying.
    """
    if len(arrays) == 1:
        return arrays[0]
    shape = (sum(len(a) for a in arrays), arrays[0].shape[1])
    buffer: np.ndarray | None = getattr(_local, "stack", None)
    if buffer is None or buffer.shape != shape:
        buffer = np.empty(shape)
        if buffer.nbytes <= STACK_BYTES:
            _local.stack = buffer
    return np.concatenate(arrays, out=buffer)


def _work(operations: Mapping[str, int]) -> int:
    return sum(n * (SINE if what in ("sin", "cos") else 1) for what, n in operations.items())


def _is_columns(a: np.ndarray) -> bool:
    return a.ndim == 2 and a.flags.f_contiguous and not (a.flags.c_contiguous and a.shape[1] > 1)


def pays_threads(count: int, work: int) -> bool:
    """Whether a call with `count` states of `work` operations each is large enough for heyoka's threads.

    If so, heyoka is kept to TWOLINK_THREADS.
    """
    if count * work < THREADS_FROM or is_forked_child() or is_shared():
        return False
    threads, module = thread_count(), heyoka()
    if module.get_nthreads() != threads:
        with _threads_lock:
            module.set_nthreads(threads)
    return threads > 1


def count_operations(model: pin.Model, function: Function, parameters: Sequence[str] = ()) -> list[dict[str, int]]:
    """The operations of each of the function's variants, by kind."""
    counts = []
    for trace in function.variants:
        tape = Tape()
        arguments: dict[str, Any] = {name: [tape.variable() for _ in range(size)] for name, size in function.arguments}
        mech = mechanism(model, {name: tape.variable() for name in parameters})
        counts.append(tape.count(trace(mech, arguments, tape)))
    return counts


def build(model: pin.Model, function: Function, parameters: Sequence[str] = ()) -> Kernel:
    """Trace the function's cheapest variant over the model's constants, and compile it.

    parameters: physical constants kept as run-time inputs (names: `mechanism.parameter_names`).
    """
    module = heyoka()
    counts = count_operations(model, function, parameters)
    variant = min(range(len(counts)), key=lambda i: sum(counts[i].values()))
    first, *others = function.arguments
    variables = [module.expression(f"x{i}") for i in range(first[1])]
    index = itertools.count()
    arguments: dict[str, Sequence[Any]] = {first[0]: variables}
    arguments.update({name: [module.par[next(index)] for _ in range(size)] for name, size in others})
    constants = {name: module.par[next(index)] for name in parameters}
    traced = Expressions(module, own_sine=True)
    entries = function.variants[variant](mechanism(model, constants), dict(arguments), traced)
    outputs = [traced.lift(e) for e in entries]
    inputs = [x for values in arguments.values() for x in values] + list(constants.values())
    outputs.append(_guard(module, model, inputs, outputs, list(traced.reach.values()), variables))
    # The instructions of a small kernel wait for each other's results: two vectors at a time use the waiting time. A
    # large kernel would run out of registers (scripts/bench_queries.py).
    options = {"batch_size": LANES} if _work(counts[variant]) <= SMALL else {}
    compiled = module.cfunc(outputs, vars=variables, **options)
    sizes = (*(size for _, size in function.arguments), *(1 for _ in parameters))
    return Kernel(function.name, function.shape, sizes, compiled, counts[variant])


def _guard(module: Any, model: pin.Model, inputs: list[Any], outputs: list[Any], reach: list[Any], q: list[Any]) -> Any:
    """The guard: the sum of all inputs and outputs, or NaN where a condition fails."""
    total = module.sum([*inputs, *outputs])
    conditions = [(module.sum(reach), LIMIT**2)] if reach else []
    for joint in joint_layouts(model):
        if joint.unit is not None:
            defect = module.sum([x * x for x in q[joint.unit]]) - 1.0
            conditions.append((defect * defect, (2 * UNIT_TOLERANCE) ** 2))
    nan = module.expression(math.nan)
    for value, limit in conditions:
        total = module.select(module.gt(value, module.expression(limit)), nan, total)
    return total
