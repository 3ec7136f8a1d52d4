"""Pinocchio's algorithms over batches: rows of states in, rows of answers out.

Each function takes C-ordered rows (n, nq), (n, nv) and a data of the calling thread. It does no checks: those are
in `arguments`. abaInParallel and rneaInParallel take one state a column, which C-ordered rows are, transposed.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np
import pinocchio as pin

from twolink.dynamics.forks import is_forked_child
from twolink.dynamics.threads import thread_count
from twolink.dynamics.wrench import Applied, joint_forces

# Below this many states starting the threads costs more than it saves (scripts/bench_queries.py measures it).
PARALLEL_FROM = 64

_local = threading.local()


def _pool(model: pin.Model, threads: int) -> pin.ModelPool:
    """This thread's pool for the model: a pool serves one caller at a time."""
    pools: dict[tuple[int, int], tuple[pin.Model, pin.ModelPool]] = _local.__dict__.setdefault("pools", {})
    key = (id(model), threads)
    if key not in pools or pools[key][0] is not model:
        if len(pools) >= 8:
            pools.clear()
        pools[key] = (model, pin.ModelPool(model, threads))
    return pools[key][1]


def aba(model: pin.Model, data: pin.Data, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """a (n, nv) by the articulated-body algorithm."""
    return _parallel(pin.abaInParallel, pin.aba, model, data, q, v, tau)


def rnea(model: pin.Model, data: pin.Data, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    """tau (n, nv) by the recursive Newton-Euler algorithm."""
    return _parallel(pin.rneaInParallel, pin.rnea, model, data, q, v, a)


def crba(model: pin.Model, _data: pin.Data, q: np.ndarray) -> np.ndarray:
    """M(q) of one state where joints may mimic others: on such models Pinocchio 4.1 adds to what the data held."""
    return np.asarray(pin.crba(model, model.createData(), q))


def _parallel(
    many: Callable[..., None],
    one: Callable[..., np.ndarray],
    model: pin.Model,
    data: pin.Data,
    q: np.ndarray,
    v: np.ndarray,
    third: np.ndarray,
) -> np.ndarray:
    threads = thread_count()
    if len(q) >= PARALLEL_FROM and not is_forked_child():
        out = np.empty((model.nv, len(q)), order="F")
        many(threads, _pool(model, threads), q.T, v.T, third.T, out)
        return out.T
    return each(lambda i: one(model, data, q[i], v[i], third[i]), len(q), (model.nv,))


def each(answer: Callable[[int], np.ndarray], count: int, shape: tuple[int, ...]) -> np.ndarray:
    """answer(0), ..., answer(count - 1), stacked: (count, *shape)."""
    out = np.empty((count, *shape))
    for i in range(count):
        out[i] = answer(i)
    return out


def with_wrenches(
    algorithm: Callable[..., np.ndarray],
    model: pin.Model,
    data: pin.Data,
    q: np.ndarray,
    v: np.ndarray,
    third: np.ndarray,
    applied: list[Applied],
) -> np.ndarray:
    """aba or rnea with external wrenches whose values are rows (n, 6)."""

    def answer(i: int) -> np.ndarray:
        wrenches = [Applied(w.joint, w.placement, w.value[i], w.axes) for w in applied]
        return algorithm(model, data, q[i], v[i], third[i], joint_forces(model, data, q[i], wrenches))

    return each(answer, len(q), (model.nv,))
