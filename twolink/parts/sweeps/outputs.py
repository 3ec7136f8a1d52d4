"""Outputs that are kept of every run, as the variables of the store."""

import importlib
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from twolink.errors import SceneError, nearest, shown
from twolink.simulation.sampling import with_ends
from twolink.simulation.trajectory import Trajectory
from twolink.simulation.trajectory_tables import UNITS, coordinate_names

PENDING, DONE, INACCURATE, FAILED, ABANDONED = range(5)
STATUS = ("pending", "done", "inaccurate", "failed", "abandoned")  # by number
OUTPUTS = ("final", "samples", "events", "energy", "cost")
TEXT = "str"


@dataclass(frozen=True)
class OutputVariable:
    """A variable of the store: its dimensions and sizes behind those of the runs, its type and attributes."""

    name: str
    description: str
    units: str = ""
    kind: str = "f8"
    dims: tuple[str, ...] = ()
    shape: tuple[int, ...] = ()

    @property
    def fill(self) -> Any:
        """The value of a run that has none."""
        return "" if self.kind == TEXT else np.nan if self.kind == "f8" else 0

    def empty(self, runs: int) -> np.ndarray:
        """Values (runs, ...) that are all missing."""
        return np.full((runs, *self.shape), self.fill, dtype=object if self.kind == TEXT else self.kind)


@dataclass(frozen=True)
class Request:
    """The request to every run.

    duration, s; accuracy, rad or m, where it does not vary, None as in `simulate`; outputs: of OUTPUTS, or
    "module:function"; t_eval: times of the samples, s; verify: whether there are error bars.
    """

    duration: float
    accuracy: float | None
    outputs: tuple[str, ...]
    t_eval: tuple[float, ...]
    verify: bool

    @property
    def functions(self) -> tuple[str, ...]:
        """The outputs that are functions of the run."""
        return tuple(name for name in self.outputs if name not in OUTPUTS)

    @property
    def times(self) -> np.ndarray:
        """The times of the samples, 0 and the end, s."""
        return with_ends(np.array(self.t_eval), self.duration)


def check_outputs(outputs: Sequence[str]) -> tuple[str, ...]:
    """The outputs, each once; functions can be imported. Raises SceneError, code "unknown-output"."""
    names = tuple(dict.fromkeys([outputs] if isinstance(outputs, str) else outputs))
    for name in names:
        if ":" in str(name):
            function_of(name)
        elif name not in OUTPUTS:
            what, best = f"there is no output {shown(name)}", nearest(str(name), OUTPUTS)
            raise SceneError(what, argument="outputs", code="unknown-output",
                             remedy=f"{best} (a function of the run is module:function)")  # fmt: skip
    return names


def check_names(names: Sequence[str]) -> None:
    """Require that the store's arrays have names of their own. Raises SceneError, code "unknown-output"."""
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise SceneError(f"two arrays of the store would be called {twice[0]!r}", argument="outputs",
                         code="unknown-output", remedy="rename the function of the run")  # fmt: skip


def column_of(function: str) -> str:
    """The variable's name for "module:function"."""
    return function.rpartition(":")[2]


def function_of(name: str) -> Callable[[Trajectory], float]:
    """The function that "module:function" names. Raises SceneError, code "unknown-output"."""
    module, _, attribute = name.partition(":")
    try:
        found = getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError, ValueError) as error:
        raise SceneError(f"{name!r} cannot be imported: {error}", argument="outputs", code="unknown-output",
                         remedy="give module:function of a module that workers can import") from None  # fmt: skip
    if not callable(found):
        raise SceneError(f"{name!r} is no function", argument="outputs", code="unknown-output",
                         remedy="give module:function")  # fmt: skip
    return found  # type: ignore[no-any-return]


def variables(robot: Any, request: Request) -> list[OutputVariable]:
    """The variables for what is asked for; `status` is the last one, and is written last."""
    states, count = (("q", "configuration", robot.nq), ("v", "velocity", robot.nv)), len(request.t_eval)
    found = [
        OutputVariable(
            "error", "bound on the global error of q at the end, or of stepped contacts an estimate", UNITS["error"]
        )
    ]
    if "final" in request.outputs:
        found += [OutputVariable("t", "time of the end, or of the event that ended the run", "s"),
                  *(OutputVariable(letter, f"{what} at the end", UNITS[letter], "f8", (f"{letter}_name",), (size,))
                    for letter, what, size in states)]  # fmt: skip
    if "samples" in request.outputs:
        found += [OutputVariable(f"{letter}_samples", f"{what} at the samples", UNITS[letter], "f8",
                                 ("time", f"{letter}_name"), (count, size))
                  for letter, what, size in states]  # fmt: skip
    if "energy" in request.outputs:
        found.append(OutputVariable("energy", "kinetic and potential energy at the end", "J"))
    if "events" in request.outputs:
        found += [OutputVariable("event_count", "number of events", "1", "i4"),
                  OutputVariable("events", "events as JSON: t [s], kind, what, detail", "", TEXT)]  # fmt: skip
    if "cost" in request.outputs:
        found += [OutputVariable("steps", "steps of the solution", "1", "i8"),
                  OutputVariable("seconds", "time of solving, error bar included; the mean of a batch",
                                 "s")]  # fmt: skip
    found += [OutputVariable(column_of(name), f"what {name} gives for the run") for name in request.functions]
    return [*found, OutputVariable("reason", "why a run is not done", "", TEXT),
            OutputVariable("status", ", ".join(f"{i} {name}" for i, name in enumerate(STATUS)), "", "i1")]  # fmt: skip


def coordinates(robot: Any, request: Request) -> dict[str, np.ndarray]:
    """The coordinates of the variables' own dimensions."""
    found: dict[str, np.ndarray] = {}
    if {"final", "samples"} & set(request.outputs):
        found |= {f"{letter}_name": np.array(coordinate_names(robot, letter), dtype=object) for letter in "qv"}
    if "samples" in request.outputs:
        found["time"] = np.array(request.t_eval)
    return found
