"""The bodies of dynamics queries, as arguments, with their answers."""

import functools
import math
from collections import ChainMap
from typing import Any

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from twolink.algorithms.functions import Shape
from twolink.dynamics import Robot, queries
from twolink.dynamics.queries import OPTIONS, Numbers, Query
from twolink.dynamics.robot_record import link_poses
from twolink.errors import QueryError
from twolink.parts.service.problems import Refusal, misfit_refusal, require_unique_keys
from twolink.parts.service.settings import Quotas

_JSON_NUMBER = 32  # bytes of memory for a number on its way to JSON: an object, and a place in a list
STATES_IN_LOOP = 500  # that the service's own process answers
_numbers = functools.cache(Query.numbers)
_SINGLE_STATE: set[tuple[int, ...]] = {()}


def _kinematics(robot: Robot, q: ArrayLike, frames: list[str] | None = None) -> dict[str, Any]:
    """Poses (..., n, 7) of the links, or of frames, in the world: position [m], quaternion (x y z w)."""
    return {"frames": list(robot.frame_names) if frames is None else frames, "poses": link_poses(robot, q, frames)}


KINEMATICS = Query("kinematics", "link_poses", _kinematics, {"poses": (("frames", 7), "m, then 1")})


def _derivatives(
    robot: Robot, q: ArrayLike, v: ArrayLike, tau: ArrayLike | None = None, a: ArrayLike | None = None
) -> dict[str, np.ndarray]:
    """da_dq, da_dv, da_dtau; or with a instead of tau dtau_dq, dtau_dv, dtau_da: (..., nv, nv)."""
    what, given = "forward-dynamics-derivatives", {"q": q, "v": v, "tau": tau, "a": a}
    if tau is None and a is not None:
        what = "inverse-dynamics-derivatives"
    return QUERIES[what].answer(robot, {name: value for name, value in given.items() if value is not None})


_MATRIX: tuple[Shape, str] = (("nv", "nv"), "")
_OWN = {
    "kinematics": KINEMATICS,
    "derivatives": Query("derivatives", "", _derivatives, {"da_dq": _MATRIX, "da_dv": _MATRIX, "da_dtau": _MATRIX}),
}
QUERIES = ChainMap(_OWN, queries.QUERIES)


@functools.cache
def body_of(query: Query) -> type[msgspec.Struct]:
    """The JSON body of a query: q, and what else it takes, zero when left out. Lists of lists are batches."""
    optional = {**dict.fromkeys(query.arguments[1:], Numbers), **{name: OPTIONS[name][0] for name in query.options}}
    fields: list[Any] = [("q", Numbers), *((name, kind | None, None) for name, kind in optional.items())]
    name = query.name.title().replace("-", "")
    return msgspec.defstruct(name, fields, forbid_unknown_fields=True, frozen=True, module=__name__)


@functools.cache
def _decoder(query: Query) -> msgspec.json.Decoder[Any]:
    return msgspec.json.Decoder(body_of(query))


def arguments_from_json(query: Query, body: bytes) -> dict[str, Any]:
    """The arguments in a JSON body, as arrays."""
    try:
        decoded = _decoder(query).decode(body)
    except msgspec.ValidationError as error:
        raise misfit_refusal(error, body_of(query)) from None
    arguments: dict[str, Any] = {}
    strings = 0
    for name in decoded.__struct_fields__:
        value = getattr(decoded, name)
        if value is None:
            continue
        strings += 1
        if name not in OPTIONS:
            arguments[name] = _array(name, value)
            continue
        strings += 1 if isinstance(value, str) else 0 if isinstance(value, bool) else len(value)
        if name == "f_ext":
            value = {frame: _array(f"f_ext.{frame}", wrench) for frame, wrench in value.items()}
        arguments[name] = value
    require_unique_keys(body, strings)
    return arguments


def _array(name: str, value: Numbers) -> np.ndarray:
    try:
        return np.array(value, dtype=np.float64)
    except ValueError:
        what = "expected numbers, or lists of numbers of one length"
        raise QueryError(what, argument=name, remedy="give a state, or a list of states") from None


def arguments_from_npz(query: Query, arrays: dict[str, np.ndarray]) -> dict[str, Any]:
    """The arguments in arrays of their names; wrenches are named f_ext.FRAME."""
    arguments: dict[str, Any] = {}
    for name, value in arrays.items():
        if name.startswith("f_ext.") and "f_ext" in query.options:
            arguments.setdefault("f_ext", {})[name.removeprefix("f_ext.")] = value
        elif name in query.arguments:
            arguments[name] = value
        else:
            remedy = f"it takes {', '.join(query.arguments)}"
            raise QueryError(f"{query.name} takes no {name[:80]!r}", argument=name[:80], remedy=remedy)
    return arguments


def count_of(robot: Robot, query: Query, arguments: dict[str, Any]) -> tuple[int, int]:
    """The number of states, and of the numbers in the answer; 0 where leading axes do not fit, as the query says."""
    if "q" not in arguments:
        raise Refusal(400, "q is missing", where="q", remedy=f"send the {robot.nq} numbers of a configuration")
    arrays = {name: value for name, value in arguments.items() if isinstance(value, np.ndarray)}
    if "f_ext" in arguments:
        arrays |= arguments["f_ext"]
    for name, value in arrays.items():
        if value.ndim == 0:
            raise Refusal(400, "expected an array, got one number", where=name, remedy="give shape (..., n)")
    shapes = {value.shape[:-1] for value in arrays.values()}
    try:
        count = 1 if shapes == _SINGLE_STATE else math.prod(np.broadcast_shapes(*shapes))
    except ValueError:
        return 0, 0
    frames = arguments.get("frames")
    return count, count * _numbers(query, robot.nv, robot.model.nframes if frames is None else len(frames))


def require_size(count: int, numbers: int, quotas: Quotas, is_json: bool) -> None:
    """Raise Refusal (413) when the states are too many, or their answer would be too large."""
    size, room = numbers * (_JSON_NUMBER if is_json else 8), int(quotas.answer_mb * 2**20)
    if count > quotas.states or size > room:
        most = min(quotas.states, room * count // max(1, size))
        remedy = f"send up to {most} at once" if most else "ask for fewer frames"
        raise Refusal(413, f"{count} states are too many at once", where="q", remedy=remedy)


def answer_query(robot: Robot, query: Query, arguments: dict[str, Any], count: int) -> dict[str, Any]:
    """The answer for so many states by the names of its results. Raises QueryError.

    Up to STATES_IN_LOOP of them are answered by Pinocchio, in the event loop and in a worker process alike: tracing a
    program takes longer than the loop may wait, and the same batch has the same bits.
    """
    options = {name: arguments.pop(name) for name in query.options if name in arguments}
    return query.answer(robot, arguments, "pinocchio" if count <= STATES_IN_LOOP else None, **options)
