"""Kernels: a function traced over a robot's constants and compiled by heyoka, and calling it on batches.

All checks of the values are compiled into the kernel as one more output, the guard: a number that is finite if and
only if all inputs and outputs are finite, all angles are within the reach of `sin_cos`, and quaternions and (cos, sin)
pairs have length 1. A batch whose guard is not finite is answered by Pinocchio, after a check of each value.
"""

import functools
import itertools
import math
import os
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
from twolink.algorithms.sincos import LIMIT
from twolink.algorithms.tape import Tape
from twolink.dynamics.arguments import UNIT_TOLERANCE
from twolink.dynamics.threads import do_all, is_forked_child, is_shared, thread_count
from twolink.errors import QueryError
from twolink.robots.joint_layout import joint_layouts

CHUNK_BYTES = 2**22  # of a chunk's inputs and outputs: threads that share smaller ones wait for the interpreter
WIDE_CHUNK_BYTES = 2**20  # of a function of more than STREAMS numbers, whose rows of states fill the cache sooner
KEPT_BYTES = 2**25  # of buffers
STREAMS = 48  # rows of a large batch that a core can follow at once: with more of them, chunks are faster
LANES = 16  # chunks are multiples of it, as of every vector length that is compiled
THREADS_FROM = 1_000_000  # operations in a call from which heyoka's threads pay (scripts/benchmarks/queries.py)
SHARED_FROM = 4_000_000  # operations in a batch from which threads that share its chunks pay
SINE = 20  # operations of our sine or cosine
SMALL = 200  # operations of a kernel that is small

_local = threading.local()
_threads_lock = threading.Lock()
_import_lock = threading.Lock()


def heyoka() -> Any:
    """The heyoka module, or None where it is not installed (there are wheels for Linux only) or TWOLINK_HEYOKA is 0."""
    with _import_lock:
        return _imported()


@functools.cache
def _imported() -> Any:
    """heyoka, imported without what nothing here uses.

    It imports SymPy where it can, for conversions: more than half of its import time. It keeps a database of compiled
    code in the user's cache folder, up to 20 GB, which each process checks from end to end before it compiles anything,
    and up to 2 GB of code in memory after its functions are gone. Our own cache has what is compiled here.
    TWOLINK_OPT_LEVEL (0 to 3) is its level of optimization: code of level 0 compiles sooner and runs slower.
    """
    if os.environ.get("TWOLINK_HEYOKA") == "0":
        return None
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
    if level := os.environ.get("TWOLINK_OPT_LEVEL"):
        if level not in {"0", "1", "2", "3"}:
            raise QueryError(f"{level[:40]!r} is no level", where="TWOLINK_OPT_LEVEL", remedy="set it to 0, 1, 2 or 3")
        for name in ("cfunc", "taylor_adaptive", "taylor_adaptive_batch"):
            setattr(module, name, functools.partial(getattr(module, name), opt_level=int(level)))
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

        Where the memory of all arguments holds one state a column (transposed views), so does the result's. A function
        of few numbers then takes the arguments as they are; otherwise they go through buffers that stay in the cache.
        """
        count, entries = len(arguments[0]), math.prod(self.shape)
        columns, begun = [a.T for a in arguments], 0
        if all(_is_columns(a) for a in arguments):
            out = np.empty((entries + 1, count))
            result = out[:-1]
            if self._width <= STREAMS:
                pars = {"pars": _stacked(columns)} if len(columns) > 1 else {}
                self.cfunc(columns[0], outputs=out, batch_parallel=pays_threads(count, self.work), **pars)
                if not math.isfinite(out[-1].sum()):
                    return None
                begun = count - count % LANES  # heyoka's scalar code, which may round differently, answers the rest
        else:
            result = np.empty((count, entries)).T
        if not self._in_chunks([x[:, begun:] for x in columns], result[:, begun:]):
            return None
        return result.T if len(self.shape) == 1 else result.T.reshape(count, *self.shape)

    @property
    def _width(self) -> int:
        """Numbers a state that the compiled function reads and writes, the guard included."""
        return sum(self.sizes) + math.prod(self.shape) + 1

    def _in_chunks(self, columns: Sequence[np.ndarray], result: np.ndarray) -> bool:
        """Write the results of columns of states; threads share the chunks. Returns whether the guard is finite."""
        count = result.shape[1]
        alone = count * self.work < SHARED_FROM or is_forked_child() or is_shared()
        threads = 1 if alone else thread_count()
        size = CHUNK_BYTES if self._width <= STREAMS else WIDE_CHUNK_BYTES
        parts = max(1, -(-count * 8 * self._width // (size * threads))) * threads
        # An odd number of vectors: rows a multiple of 4 KiB apart would compete for the same place in the cache.
        length = (-(-count // (parts * LANES)) | 1) * LANES
        finite = [True]

        def evaluate(start: int) -> None:
            part = slice(start, start + length)
            if finite[0] and not self._chunk([x[:, part] for x in columns], result[:, part]):
                finite[0] = False

        do_all(range(0, count, length), evaluate, threads)
        return finite[0]

    def _chunk(self, columns: Sequence[np.ndarray], result: np.ndarray) -> bool:
        """Write the results of one chunk; returns whether the guard is finite."""
        entries, count = result.shape
        width = -(-count // LANES) * LANES
        first, parameters, out = _buffers((self.sizes[0], sum(self.sizes[1:]), entries + 1), width)
        first[:, :count] = columns[0]
        row = 0
        for values in columns[1:]:
            parameters[row : row + len(values), :count] = values
            row += len(values)
        for inputs in (first, parameters):
            inputs[:, count:] = inputs[:, count - 1 : count]  # the last state fills up the last vector
        pars = {"pars": parameters} if row else {}
        self.cfunc(first, outputs=out, batch_parallel=False, **pars)
        if not math.isfinite(out[-1].sum()):
            return False
        if entries < count // 64:
            for k in range(entries):  # a row at a time: up to four times faster than a transposed copy
                result[k] = out[k, :count]
        else:
            result[:] = out[:-1, :count]
        return True


def _stacked(columns: Sequence[np.ndarray]) -> np.ndarray:
    """All but the first of the arrays (size, n) one under the other; one that is not the first's memory stays there."""
    first, *others = columns
    if len(others) == 1 and not np.may_share_memory(first, others[0]):
        return others[0]
    out = _buffers((sum(len(a) for a in others),), first.shape[1])[0]
    return np.concatenate(others, out=out)


def _buffers(rows: Sequence[int], count: int) -> list[np.ndarray]:
    """Arrays of so many rows of `count` numbers, in memory that this thread keeps from call to call.

    It is kept up to KEPT_BYTES: new memory costs as much as copying.
    """
    total = sum(rows) * count
    memory: np.ndarray | None = getattr(_local, "memory", None)
    if memory is None or len(memory) < total:
        memory = np.empty(total)
        if memory.nbytes <= KEPT_BYTES:
            _local.memory = memory
    ends = itertools.accumulate(n * count for n in rows)
    return [memory[end - n * count : end].reshape(n, count) for n, end in zip(rows, ends, strict=True)]


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
    variant = min(range(len(counts)), key=lambda i: _work(counts[i]) + counts[i].get("*", 0))
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
    # large kernel would run out of registers (scripts/benchmarks/queries.py).
    options = {"batch_size": 2 * module.recommended_simd_size()} if _work(counts[variant]) <= SMALL else {}
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
