"""What the dynamics queries over HTTP mean: bodies as arguments, their size, and the answers. It knows no HTTP."""

import functools
import math
from typing import Any

import msgspec
import numpy as np

from twolink.dynamics import Robot, named_queries
from twolink.dynamics.named_queries import NamedQuery
from twolink.errors import QueryError
from twolink.service.json_keys import require_unique_keys
from twolink.service.kinematics import link_poses
from twolink.service.problems import Refusal
from twolink.service.settings import Quotas

Numbers = list[float | list[float]]
QUERIES: dict[str, NamedQuery] = {
    **named_queries.QUERIES,
    "kinematics": NamedQuery(
        "poses (..., n, 7) of the links, or of frames: position [m], quaternion (x y z w)",
        ("q",), ("frames", "poses"), (7,), ("frames",)),
    "derivatives": NamedQuery(
        "da_dq, da_dv, da_dtau; or with a instead of tau dtau_dq, dtau_dv, dtau_da: (..., nv, nv)",
        ("q", "v", "tau", "a"), ("da_dq", "da_dv", "da_dtau"), (3, "nv", "nv")),
}  # fmt: skip
_OPTIONS: dict[str, Any] = {
    "f_ext": dict[str, Numbers], "method": str, "frame": str, "axes": str, "frames": list[str],
}  # fmt: skip
_JSON_NUMBER = 32  # bytes of memory for a number on its way to JSON: an object, and a place in a list
_SINGLE_STATE: set[tuple[int, ...]] = {()}


def body_of(what: str) -> type[msgspec.Struct]:
    """The JSON body of a query: q, and what else it takes, zero when left out. Lists of lists are batches."""
    query = QUERIES[what]
    optional = {**dict.fromkeys(query.arguments[1:], Numbers), **{name: _OPTIONS[name] for name in query.options}}
    fields: list[Any] = [("q", Numbers), *((name, kind | None, None) for name, kind in optional.items())]
    name = what.title().replace("-", "")
    return msgspec.defstruct(name, fields, forbid_unknown_fields=True, frozen=True, module=__name__)


_DECODERS = {what: msgspec.json.Decoder(body_of(what)) for what in QUERIES}


def arguments_from_json(what: str, body: bytes) -> dict[str, Any]:
    """The arguments in a JSON body, as arrays."""
    decoded = _DECODERS[what].decode(body)
    arguments: dict[str, Any] = {}
    strings = 0
    for name in decoded.__struct_fields__:
        value = getattr(decoded, name)
        if value is None:
            continue
        strings += 1
        if name not in _OPTIONS:
            arguments[name] = _array(name, value)
            continue
        strings += 1 if isinstance(value, str) else len(value)
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


def arguments_from_npz(what: str, arrays: dict[str, np.ndarray]) -> dict[str, Any]:
    """The arguments in arrays of their names; wrenches are named f_ext.FRAME."""
    query, arguments = QUERIES[what], dict[str, Any]()
    for name, value in arrays.items():
        if name.startswith("f_ext.") and "f_ext" in query.options:
            arguments.setdefault("f_ext", {})[name.removeprefix("f_ext.")] = value
        elif name in query.arguments:
            arguments[name] = value
        else:
            remedy = f"it takes {', '.join(query.arguments)}"
            raise QueryError(f"{what} takes no {name[:80]!r}", argument=name[:80], remedy=remedy)
    return arguments


def count_of(robot: Robot, what: str, arguments: dict[str, Any]) -> tuple[int, int]:
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
    numbers = _numbers_each(what, robot.nv)
    if what == "kinematics":
        frames = arguments.get("frames")
        numbers *= robot.model.nframes if frames is None else len(frames)
    return count, count * numbers


@functools.cache
def _numbers_each(what: str, nv: int) -> int:
    """How many numbers the answer has for each state, or each frame of a state."""
    return math.prod(nv if size == "nv" else size for size in QUERIES[what].shape)


def require_size(count: int, numbers: int, quotas: Quotas, is_json: bool) -> None:
    """Raise Refusal (413) when the states are too many, or their answer would be too large."""
    size = numbers * (_JSON_NUMBER if is_json else 8)
    if count > quotas.states or size > quotas.answer_mb * 2**20:
        raise Refusal(413, f"{count} states are too many at once", where="q", remedy="send smaller batches")


def answer_query(robot: Robot, what: str, arguments: dict[str, Any]) -> dict[str, Any]:
    """The answer by the names of its results. Raises QueryError."""
    if what == "kinematics":
        frames = arguments.get("frames")
        return {
            "frames": list(robot.frame_names) if frames is None else frames,
            "poses": link_poses(robot, arguments["q"], frames),
        }
    if what == "derivatives":
        what = f"{'inverse' if 'a' in arguments and 'tau' not in arguments else 'forward'}-dynamics-derivatives"
    options = {name: arguments.pop(name) for name in QUERIES[what].options if name in arguments}
    return named_queries.answer_query(robot, what, arguments, **options)
