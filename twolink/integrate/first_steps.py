"""The first steps of a scene: by code that compiles soon, until they have lost what compiling better code takes.

Whole compiled steps take a tenth to a fiftieth of the time of steps in parts, and ten times as long to compile. Where
that is too long, optimized parts are the better code. The two together cost at most twice what the better of them would
have (the ski rental problem).
"""

from twolink.integrate.compile_time import in_parts, parts_seconds, step_seconds
from twolink.integrate.equations import Equations
from twolink.integrate.methods import Method
from twolink.integrate.state import Array
from twolink.integrate.step_building import Map

QUICK = 0.5  # s: whole steps that compile in less are compiled at once
SHARE = 0.5  # of the time for whole steps, that parts may take
# s of an evaluation within a step, and of each world in it, rounded from `scripts.benchmarks.first_answers --parts`
EVALUATION, WORLD = 2.5e-5, 6e-7
LOSS = 2.5e-10  # s of an operation without optimization: in rates of 8,000 to 16,000, alone and in batches
_spent: dict[str, float] = {}  # s, by the name of the steps, in this process


def pays(equations: Equations, method: Method, name: str) -> bool:
    """Whether first steps are the quicker way to an answer. name: of the better code."""
    better = _better_seconds(equations, method)
    soon = in_parts(equations, method) or parts_seconds(equations) < SHARE * better
    return better > max(QUICK, spent(name)) and soon


def _better_seconds(equations: Equations, method: Method) -> float:
    """Seconds to compile the better code: whole steps, or optimized parts where those take too long."""
    return parts_seconds(equations) if in_parts(equations, method) else step_seconds(equations, method)


def count(name: str, seconds: float) -> None:
    """Add what was spent on runs that code of this name would have shortened."""
    _spent[name] = _spent.get(name, 0.0) + seconds


def spent(name: str) -> float:
    """Seconds spent in this process on runs that code of this name would have shortened."""
    return _spent.get(name, 0.0)


class FirstSteps:
    """A step map in parts that counts what its steps lose, under the name of the better code."""

    def __init__(self, equations: Equations, method: Method, name: str, steps: Map) -> None:
        self._name, self._steps, evaluations = name, steps, method.evaluations
        self._call, self._world = evaluations * EVALUATION, evaluations * WORLD
        if in_parts(equations, method):
            evaluations += 2 * equations.space.size * (method.kind == "implicit")  # those of the Jacobian
            self._call, self._world = 0.0, LOSS * evaluations * equations.operations
        self._limit = _better_seconds(equations, method)

    def __call__(self, state: Array, out: Array) -> None:
        """One attempted step of each world."""
        count(self._name, self._call + self._world * state.shape[1])
        self._steps(state, out)

    @property
    def used_up(self) -> bool:
        """Whether these steps have lost as much as compiling the better code takes."""
        return spent(self._name) > self._limit
