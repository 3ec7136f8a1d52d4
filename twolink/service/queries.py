"""The dynamics queries over HTTP: one state or a batch, JSON or npz.

This path must be quick, so it is plain ASGI: bytes in, msgspec, NumPy, bytes out.
"""

import asyncio
import contextvars
import functools
import math
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import msgspec
import numpy as np

from twolink.dynamics import Robot, named_queries
from twolink.dynamics.named_queries import NamedQuery
from twolink.errors import QueryError
from twolink.service import npz
from twolink.service.admission import hold
from twolink.service.http_io import JSON, UNSPECIFIED, body_limit, header, media_type, read_body
from twolink.service.json_keys import require_unique_keys
from twolink.service.kinematics import link_poses
from twolink.service.metrics import Metrics
from twolink.service.problems import Refusal
from twolink.service.robot_pool import RobotPool
from twolink.service.settings import Settings
from twolink.service.turns import Turns

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
PREFIX = "/v1/robots/"
_OPTIONS: dict[str, Any] = {
    "f_ext": dict[str, Numbers], "method": str, "frame": str, "axes": str, "frames": list[str],
}  # fmt: skip
_IN_LOOP = 4000  # bytes of a body that is answered in the event loop; larger ones go to a thread
_THREADS = 2
_JSON_LIST = 96  # bytes of memory of a list read from JSON, without its numbers
_JSON_NUMBER = 32  # bytes of memory for a number on its way to JSON: an object, and a place in a list
_SINGLE_STATE: set[tuple[int, ...]] = {()}
_HEADERS = {media: [(b"content-type", media.encode())] for media in (JSON, npz.MEDIA_TYPE)}


def body_of(what: str) -> type[msgspec.Struct]:
    """The JSON body of a query: q, and what else it takes, zero when left out. Lists of lists are batches."""
    query = QUERIES[what]
    optional = {**dict.fromkeys(query.arguments[1:], Numbers), **{name: _OPTIONS[name] for name in query.options}}
    fields: list[Any] = [("q", Numbers), *((name, kind | None, None) for name, kind in optional.items())]
    name = what.title().replace("-", "")
    return msgspec.defstruct(name, fields, forbid_unknown_fields=True, frozen=True, module=__name__)


_DECODERS = {what: msgspec.json.Decoder(body_of(what)) for what in QUERIES}


class Queries:
    """Answers POST /v1/robots/{id}/{query}."""

    def __init__(self, settings: Settings, robots: RobotPool, metrics: Metrics) -> None:
        self._quotas, self._robots, self._metrics = settings.quotas, robots, metrics
        self._threads = ThreadPoolExecutor(_THREADS, "twolink-query")
        self._turns = Turns(_THREADS, settings.quotas.waiting)

    async def answer(self, scope: Any, receive: Any, key: str, what: str) -> tuple[int, list[Any], bytes]:
        """Status, headers and body. Raises Refusal or QueryError."""
        sent = media_type(header(scope, b"content-type"))
        sent = JSON if sent in UNSPECIFIED else sent
        if sent not in (JSON, npz.MEDIA_TYPE, "application/zip"):
            remedy = f"send {JSON} or {npz.MEDIA_TYPE}"
            raise Refusal(415, f"{sent[:80]!r} is not understood", where="header: Content-Type", remedy=remedy)
        body = await read_body(scope, receive, body_limit(sent, self._quotas))
        robot = self._robots.loaded(key) or await self._robots.get(key)
        same, other = (JSON, npz.MEDIA_TYPE) if sent == JSON else (npz.MEDIA_TYPE, JSON)
        accept = header(scope, b"accept")
        reply = other if other.encode() in accept and same.encode() not in accept else same
        if sent == JSON and reply == JSON and len(body) < _IN_LOOP:
            return 200, _HEADERS[JSON], self._answer(robot, what, body, sent, reply)
        loop = asyncio.get_running_loop()
        async with self._turns.turn():
            task = (self._answer, robot, what, body, sent, reply)
            content = await loop.run_in_executor(self._threads, contextvars.copy_context().run, *task)
        return 200, _HEADERS[reply], content

    def _answer(self, robot: Robot, what: str, body: bytes, sent: str, reply: str) -> bytes:
        reserve = hold().add
        if sent == JSON:
            if len(body) >= _IN_LOOP:
                reserve(_JSON_NUMBER * body.count(b",") + _JSON_LIST * body.count(b"["))
            arguments = _from_json(what, body)
        else:
            arguments = _from_npz(what, npz.read_npz(body, int(self._quotas.upload_mb * 2**20), reserve))
        number_bytes = _JSON_NUMBER if reply == JSON else 8
        count, size = self._check_size(robot, what, arguments, number_bytes)
        reserve(2 * size)
        self._metrics.states.inc(count)
        result = _ask(robot, what, arguments)
        if reply == JSON:
            return msgspec.json.encode(result, enc_hook=np.ndarray.tolist)
        return npz.write_npz({name: np.asarray(value) for name, value in result.items()})

    def _check_size(self, robot: Robot, what: str, arguments: dict[str, Any], number_bytes: int) -> tuple[int, int]:
        """The number of states, and the bytes of the answer. Raises Refusal when either is too large."""
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
            return 0, 0  # the query says what does not fit
        numbers = _numbers_each(what, robot.nv)
        if what == "kinematics":
            frames = arguments.get("frames")
            numbers *= robot.model.nframes if frames is None else len(frames)
        quotas, size = self._quotas, count * numbers * number_bytes
        if count > quotas.states or size > quotas.answer_mb * 2**20:
            raise Refusal(413, f"{count} states are too many at once", where="q", remedy="send smaller batches")
        return count, size


@functools.cache
def _numbers_each(what: str, nv: int) -> int:
    """How many numbers the answer has for each state, or each frame of a state."""
    return math.prod(nv if size == "nv" else size for size in QUERIES[what].shape)


def _ask(robot: Robot, what: str, arguments: dict[str, Any]) -> dict[str, Any]:
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


def _from_json(what: str, body: bytes) -> dict[str, Any]:
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


def _from_npz(what: str, arrays: dict[str, np.ndarray]) -> dict[str, Any]:
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
