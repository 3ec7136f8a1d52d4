"""The first steps of a scene: compiled in parts, until they have cost what compiling whole steps would.

Parts compile in a tenth of the time, and steps of them take ten to fifty times as long as whole compiled ones. The two
together cost at most twice what the better of them would have (the ski rental problem).
"""

from twolink.integrate.compile_time import parts_seconds, step_seconds
from twolink.integrate.equations import Equations
from twolink.integrate.methods import Method
from twolink.integrate.state import Array
from twolink.integrate.step_building import Map

QUICK = 0.5  # s: whole steps that compile in less are compiled at once
SHARE = 0.5  # of the time for whole steps, that parts may take
# s of an evaluation within a step, and of each world in it, rounded from `scripts/bench_first_answer.py --parts`
EVALUATION, WORLD = 2.5e-5, 6e-7
_spent: dict[str, float] = {}  # s, by the name of the steps, in this process


def pays(equations: Equations, method: Method, name: str) -> bool:
    """Whether steps in parts are the quicker way to an answer. name: of the whole steps."""
    whole = step_seconds(equations, method)
    return whole > max(QUICK, spent(name)) and parts_seconds(equations) < SHARE * whole


def rate_name(equations: Equations) -> str:
    """The name of the compiled rate, by which runs without it are counted."""
    return equations.key("rate", "whole")


def count(name: str, seconds: float) -> None:
    """Add what was spent on runs that code of this name would have shortened."""
    _spent[name] = _spent.get(name, 0.0) + seconds


def spent(name: str) -> float:
    """Seconds spent in this process on runs that code of this name would have shortened."""
    return _spent.get(name, 0.0)


class FirstSteps:
    """A step map in parts that counts what its steps cost, under the name of the whole steps."""

    def __init__(self, equations: Equations, method: Method, name: str, steps: Map) -> None:
        self._name, self._steps, self._evaluations = name, steps, method.evaluations
        self._limit = step_seconds(equations, method)

    def __call__(self, state: Array, out: Array) -> None:
        """One attempted step of each world."""
        count(self._name, self._evaluations * (EVALUATION + WORLD * state.shape[1]))
        self._steps(state, out)

    @property
    def used_up(self) -> bool:
        """Whether these steps have taken as long as compiling whole ones."""
        return spent(self._name) > self._limit
