"""When a batch goes to the compiled function: once compiling has paid or will, and from the size where it is faster."""

from __future__ import annotations

import threading
import time
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from twolink.dynamics.compiled import Compiled
from twolink.errors import CertificationError

SMALLEST = 8  # states below which Pinocchio's loop is never slower than one call of a compiled function
SIZES = (8, 16, 32, 64, 128, 256)
LOADING = 0.05  # seconds to read a kernel from the disk cache


class Choice:
    """Pinocchio or compiled, function by function, from what has been asked of this robot so far.

    A function is compiled once the batches asked for would have been answered faster with it, compiling included.
    Its smallest batch is then measured: both ways on the same states, sizes 8 to 256.
    """

    def __init__(self, compiled: Compiled) -> None:
        self.compiled = compiled
        self._asked: dict[str, int] = {}
        self._from: dict[str, float] = {}
        self._lock = threading.Lock()

    def compiled_pays(self, name: str, count: int, pinocchio: Callable[..., Any]) -> bool:
        """Whether to answer a batch of `count` states with the compiled function.

        pinocchio: the same query, answered by Pinocchio, for measuring.
        """
        smallest = self._from.get(name)
        if smallest is not None:
            return count >= smallest
        with self._lock:
            self._asked[name] = self._asked.get(name, 0) + count
            saved = self._asked[name] * self._seconds_a_state(name)
            if saved < LOADING or (saved < self._compile_seconds(name) and not self.compiled.is_ready(name)):
                return False
            if name not in self._from:
                self._from[name] = self._measured(name, pinocchio)
            return count >= self._from[name]

    def _seconds_a_state(self, name: str) -> float:
        """Roughly what Pinocchio takes for a state of a batch (scripts/bench_queries.py)."""
        parallel = name in ("forward_dynamics", "inverse_dynamics")
        return 2e-7 * self.compiled.robot.nv if parallel else 2e-6 + 1e-7 * self.compiled.robot.nv

    def _compile_seconds(self, name: str) -> float:
        """Roughly what tracing, compiling and certifying take (scripts/bench_queries.py)."""
        return 0.15 + (3e-3 if name == "forward_dynamics" else 1.5e-3) * self.compiled.robot.nv**2

    def _measured(self, name: str, pinocchio: Callable[..., Any]) -> float:
        """The smallest of SIZES from which the compiled function is faster; infinity when it cannot be used."""
        try:
            self.compiled.certificate(name)
        except CertificationError as error:
            warnings.warn(f"{error}", RuntimeWarning, stacklevel=4)
            return float("inf")
        robot = self.compiled.robot
        takes = {"mass_matrix": 0, "gravity_torque": 0, "bias": 1, "energy": 1}.get(name, 2)
        for size in SIZES:
            states = [np.tile(robot.neutral, (size, 1)), *(np.full((size, robot.nv), 0.1) for _ in range(takes))]
            if _fastest(getattr(self.compiled, name), states) < _fastest(pinocchio, states):
                return size
        return float(2 * SIZES[-1])


def _fastest(call: Callable[..., Any], states: list[np.ndarray]) -> float:
    times = []
    for _ in range(5):
        start = time.perf_counter()
        call(*states)
        times.append(time.perf_counter() - start)
    return min(times)
