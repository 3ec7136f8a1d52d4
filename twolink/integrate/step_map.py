"""The step map: a method on a scene's equations as one function state -> state, for any number of worlds.

    state  (size + ROWS + parameters, n): x, then t, h, the error remembered, steps accepted and rejected, where to
           stop, the tolerance; then the run-time parameters

The portable map runs on Pinocchio's rates, the compiled one is a single heyoka function of the same text; they are
compared before the compiled one is first used. A map called with the tolerance inf and an end within a step takes
exactly that part of the step: that is how samples and events are found, at the order of the method.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from twolink.dynamics import cache
from twolink.dynamics.kernels import heyoka, pays_threads
from twolink.integrate import step_control as control
from twolink.integrate.equations import Equations
from twolink.integrate.methods import Method
from twolink.integrate.state import Array
from twolink.integrate.step_building import certify, compiled_map, portable_map

LANES = 8  # batches are padded to whole vectors, so that every world gets the same bits wherever it stands
KEPT = 64  # maps kept in this process
SHARES = (0.5, 0.382, 0.618, 0.3, 0.71, 0.2, 0.83, 0.11, 0.92)  # of the way to a sample, for a step of its own
Map = Callable[[Array, Array], None]


class StepMap:
    """A method on equations. Calling it writes the next states into `out`.

    compiled: whether it is heyoka's. compile_seconds: what compiling or loading took, 0 where it was at hand.
    """

    def __init__(self, equations: Equations, method: Method, call: Map, compiled: bool, compile_seconds: float) -> None:
        self.equations = equations
        self.method = method
        self.compiled = compiled
        self.compile_seconds = compile_seconds
        self._call = call

    def __call__(self, state: Array, out: Array) -> None:
        """One attempted step of each world."""
        self._call(state, out)

    def initial(
        self, x: Array, t: Any, h: Any, end: Any, tolerance: Any, parameters: Any = None, longest: float = np.inf
    ) -> Array:
        """The state array of worlds x (size, n) at time t with first steps h, to stop at `end`.

        longest: no step is longer, of those that an adaptive method chooses.
        """
        size = len(x)
        state = np.zeros((size + control.ROWS + len(self.equations.parameters), x.shape[1]))
        state[:size] = x
        state[size + control.TIME] = t
        state[size + control.STEP] = state[size + control.GOOD] = h
        state[size + control.BEFORE] = control.FIRST_ERROR
        state[size + control.END] = end
        state[size + control.TOLERANCE] = tolerance
        state[size + control.LONGEST] = longest
        if parameters is not None:
            state[size + control.ROWS :] = parameters
        return state

    def partial(self, x: Array, start: Array, end: Array, parameters: Any = None) -> Array:
        """States (size, n) at the times `end` (n,), each by one step from x (size, n) at `start` (n,).

        By two steps where one meets a singular instant, at which it gives no number.
        """
        out, arrived = self._one(x, start, end, parameters)
        for share in SHARES:
            late = ~arrived
            if not late.any():
                break
            begin, stop, own = start[late], end[late], None if parameters is None else parameters[:, late]
            middle = begin + share * (stop - begin)
            halfway, first = self._one(x[:, late], begin, middle, own)
            out[:, late], second = self._one(halfway, middle, stop, own)
            arrived[late] = first & second
        out[:, ~arrived] = np.nan
        return out

    def _one(self, x: Array, start: Array, end: Array, parameters: Any) -> tuple[Array, Array]:
        """One step each, and whether it arrived."""
        count = x.shape[1]
        state = self.initial(x, start, np.inf, end, np.inf, parameters)
        if self.compiled and count % LANES:
            state = np.concatenate([state, np.repeat(state[:, -1:], -count % LANES, axis=1)], axis=1)
        state = np.ascontiguousarray(state)
        out = np.empty_like(state)
        self(state, out)
        clock = out[len(x) + control.TIME, :count]
        return out[: len(x), :count].copy(), np.asarray((clock >= end) & np.isfinite(out[: len(x), :count]).all(axis=0))


def step_map(equations: Equations, method: Method, *, portable: bool = False) -> StepMap:
    """The step map of a method, compiled where heyoka is installed; kept for the life of the process.

    Raises CertificationError when the compiled map disagrees with Pinocchio's.
    """
    if portable or heyoka() is None:
        return StepMap(equations, method, portable_map(equations, method), False, 0.0)
    name = equations.key("step", method.name)
    with _lock:
        found = _kept.get(name)
        if found is None:
            start = time.perf_counter()
            found = _kept[name] = _load(name) or _build(name, equations, method)
            seconds = time.perf_counter() - start
            while len(_kept) > KEPT:
                del _kept[next(iter(_kept))]
        else:
            seconds = 0.0
    return StepMap(equations, method, _caller(found, equations, method), True, seconds)


_kept: dict[str, Any] = {}
_lock = threading.Lock()


def _load(name: str) -> Any:
    content = cache.load(name)
    return content if isinstance(content, heyoka().cfunc_dbl) else None


def _build(name: str, equations: Equations, method: Method) -> Any:
    compiled = compiled_map(equations, method)
    certify(equations, method, step_map(equations, method, portable=True), StepMap(
        equations, method, _caller(compiled, equations, method), True, 0.0))  # fmt: skip
    cache.store(name, compiled)
    return compiled


def _caller(cfunc: Any, equations: Equations, method: Method) -> Map:
    work = equations.operations * method.evaluations

    def call(state: Array, out: Array) -> None:
        if pays_threads(state.shape[1], work):
            cfunc(state, out, batch_parallel=True)
        else:  # naming the option takes 0.5 µs, a quarter of a small step
            cfunc(state, out)

    return call
