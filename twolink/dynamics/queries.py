"""Dynamics queries, each declared once. The service, its page, its client and the command line are made from `QUERIES`.

`@query` makes a method of `Robot` a query: its signature has the arguments and the options, its docstring the summary,
and the decorator the results with their shapes and units, and Pinocchio's algorithm for one state.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from inspect import Parameter, Signature, getdoc, signature
from typing import Any, Literal, TypeVar, get_args, get_origin

import numpy as np

from twolink.algorithms.functions import Shape
from twolink.errors import QueryError, require_known

Array = np.ndarray[Any, np.dtype[np.float64]]
F = TypeVar("F", bound=Callable[..., Any])
Numbers = list[float | list[float]]
Results = Mapping[str, tuple[tuple[int | Literal["nv", "frames"], ...], str]]

ARGUMENTS = {
    "q": "Configuration, rad or m",
    "v": "Velocity, rad/s or m/s",
    "tau": "Torque or force, N m or N",
    "a": "Acceleration, rad/s^2 or m/s^2",
}
OPTIONS: dict[str, tuple[Any, str]] = {
    "f_ext": (dict[str, Numbers], "Wrenches by frame, along its axes: force N, torque N m"),
    "frame": (str, "A link's frame"),
    "frames": (list[str], "Frames of links"),
    "axes": (str, "Axes of spatial vectors"),
    "method": (str, "Algorithm"),
    "losses": (bool, "Add the joint damping and friction of the robot's file; at v = 0 friction is 0"),
}
"""What options are as JSON, and what they mean."""


@dataclass(frozen=True, eq=False)
class Query:
    """A dynamics query.

    name: "mass-matrix"; method: "mass_matrix", of Robot and RemoteRobot; "" where there is none. function: of
    (robot, *arguments, **options). results: (shape for one state, unit) by name.

    Raises TypeError for a function with another parameter than ARGUMENTS and OPTIONS.
    """

    name: str
    method: str
    function: Callable[..., Any]
    results: Results

    def __post_init__(self) -> None:
        for name in self.signature.parameters:
            if name not in ARGUMENTS and name not in OPTIONS:
                raise TypeError(f"{self.name}: {name!r} is not one of ARGUMENTS and OPTIONS")

    @cached_property
    def signature(self) -> Signature:
        """The query's signature, without the robot and the engine."""
        whole = signature(self.function, eval_str=True)
        return whole.replace(parameters=[p for p in list(whole.parameters.values())[1:] if p.name != "engine"])

    @cached_property
    def arguments(self) -> tuple[str, ...]:
        """The names of the arrays of states, q first."""
        return tuple(name for name in self.signature.parameters if name in ARGUMENTS)

    @cached_property
    def _required(self) -> tuple[str, ...]:
        return tuple(x for x in self.arguments if self.signature.parameters[x].default is Parameter.empty)

    @cached_property
    def options(self) -> dict[str, tuple[Any, ...]]:
        """The options: their names, and what can be chosen, where that is fixed."""
        given = {p.name: p.annotation for p in self.signature.parameters.values() if p.name in OPTIONS}
        return {name: (False, True) if kind is bool else get_args(kind) if get_origin(kind) is Literal else ()
                for name, kind in given.items()}  # fmt: skip

    @property
    def summary(self) -> str:
        """The first line of the docstring."""
        return (getdoc(self.function) or "").partition("\n")[0]

    def numbers(self, nv: int, frames: int = 1) -> int:
        """The count of numbers that answer the query for one state."""
        sizes = {"nv": nv, "frames": frames}
        shapes = (shape for shape, _ in self.results.values())
        return sum(math.prod(n if isinstance(n, int) else sizes[n] for n in shape) for shape in shapes)

    def answer(
        self, robot: Any, arguments: Mapping[str, Any], engine: str | None = None, **options: Any
    ) -> dict[str, Any]:
        """The answer by the names of the results; see `answer_query`. engine: of the queries that have a choice."""
        chosen = {name: value for name, value in options.items() if value is not None}
        for name in arguments:
            if name not in self.arguments:
                remedy = f"it takes {', '.join(self.arguments)}"
                raise QueryError(f"{self.name} takes no {name}", argument=name, remedy=remedy)
        for name in chosen:
            if name not in self.options:
                raise QueryError(f"{self.name} takes no {name}", argument=name, remedy="leave it out")
        if "q" not in arguments:
            raise QueryError("it is not given", argument="q", remedy=f"give the {robot.nq} numbers of a configuration")
        if "frame" in self.options and "frame" not in chosen:
            remedy = f"one of {', '.join(robot.frame_names[:12])}, ..."
            raise QueryError("it is not given", argument="frame", code="missing-option", remedy=remedy)
        left_out = [name for name in self._required if name not in arguments]
        zero = dict.fromkeys(left_out, np.zeros(robot.nv)) if left_out else {}
        if engine is not None and "engine" in signature(self.function).parameters:
            chosen["engine"] = engine
        answer = self.function(robot, **zero, **arguments, **chosen)
        if isinstance(answer, dict):
            return answer
        return dict(zip(self.results, answer if len(self.results) > 1 else (answer,), strict=True))

    def to_dict(self) -> dict[str, Any]:
        """The declaration as plain data."""
        return {
            "name": self.name,
            "method": self.method,
            "summary": self.summary,
            "arguments": {name: ARGUMENTS[name] for name in self.arguments},
            "options": {name: {"about": OPTIONS[name][1], "choices": of} for name, of in self.options.items()},
            "results": {name: {"shape": shape, "unit": unit} for name, (shape, unit) in self.results.items()},
        }


@dataclass(frozen=True)
class Algorithm:
    """Pinocchio's algorithm of a query.

    arguments: their names. shape: of the array for one state, all results in one. one: from (model, data, *arguments),
    for a frame from (index, model, data, *arguments). parallel: for columns of states. join: makes the answer from
    those for the robot's trees. mimic: the algorithm for mimic joints, or the remedy where there is none. anywhere:
    True if the algorithm works in the world's axes, and the answer does not depend on where the base is.
    """

    arguments: tuple[str, ...]
    shape: tuple[Any, ...]
    one: Callable[..., Array]
    parallel: Callable[..., None] | None = None
    join: Callable[[list[Array]], Array] | None = None
    mimic: Callable[..., Array] | str | None = None
    anywhere: bool = False


QUERIES: dict[str, Query] = {}
ALGORITHMS: dict[str, Algorithm] = {}
"""By the name of Robot's method, with the axes where there is a choice: "frame_jacobian_local"."""


def query(
    results: Mapping[str, tuple[Shape, str]],
    one: Callable[..., Array] | Mapping[str, Callable[..., Array]] | None = None,
    *,
    parallel: Callable[..., None] | None = None,
    join: Callable[[list[Array]], Array] | None = None,
    mimic: Callable[..., Array] | str | None = None,
    anywhere: bool = False,
) -> Callable[[F], F]:
    """Declare a method of Robot as a query.

    Parameters
    ----------
    results : mapping of str to (shape, unit)
        The results: their names, shapes for one state, and units.
    one, parallel, join, mimic, anywhere
        Pinocchio's algorithm, see `Algorithm`; several by the option `axes`, or none where the method asks others.
    """

    def declare(method: F) -> F:
        name = method.__name__
        declared = QUERIES[name.replace("_", "-")] = Query(name.replace("_", "-"), name, method, results)
        shape = _whole(*(shape for shape, _ in results.values()))
        variants = {f"{name}_{axes}": each for axes, each in one.items()} if isinstance(one, Mapping) else {name: one}
        for key, each in variants.items():
            if each is not None:
                ALGORITHMS[key] = Algorithm(declared.arguments, shape, each, parallel, join, mimic, anywhere)
        return method

    return declare


def _whole(*shapes: Shape) -> Shape:
    """The shape of results in one array: stacked if they are alike, else flat."""
    if len(shapes) == 1:
        return shapes[0]
    if len(set(shapes)) == 1:
        return (len(shapes), *shapes[0])
    return (sum(math.prod(n for n in shape if n != "nv") for shape in shapes),)


def answer_query(robot: Any, what: str, arguments: Mapping[str, Any], **options: Any) -> dict[str, Any]:
    """The answer to a query by name, by the names of its results.

    Parameters
    ----------
    robot : Robot
        The robot that is asked.
    what : str
        One of QUERIES.
    arguments : mapping of str to array_like
        q, and others that are zero when they are left out.
    **options
        Options of the query, such as frame="tip"; None stands for one that is left out.

    Raises
    ------
    QueryError
        For an unknown query, an argument or option that the query does not take, or one that is missing.
    """
    require_known(what, QUERIES, QueryError, where="query", argument="what")
    return QUERIES[what].answer(robot, arguments, **options)
