"""The dynamics queries over HTTP: one state or a batch, JSON or npz.

This is the path that must be quick, so it is plain ASGI: bytes in, msgspec, NumPy, bytes out.
"""

from __future__ import annotations

import asyncio
import math
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import msgspec
import numpy as np

from twolink.dynamics import Robot
from twolink.dynamics.named_queries import QUERIES as OWN
from twolink.dynamics.named_queries import answer_query
from twolink.dynamics.robot_record import link_names
from twolink.errors import QueryError
from twolink.service import npz
from twolink.service.http_io import JSON, UNTOLD, accepts, header, media_type, read_body
from twolink.service.kinematics import derivatives, frame_poses
from twolink.service.metrics import Metrics
from twolink.service.problems import Refusal
from twolink.service.robot_pool import RobotPool
from twolink.service.settings import Settings

Numbers = list[float | list[float]]
QUERIES: dict[str, tuple[str, ...]] = {
    **{name: query.arguments for name, query in OWN.items()},
    "kinematics": ("q",),
    "derivatives": ("q", "v", "tau", "a"),
}
PREFIX = "/v1/robots/"
_WITH_WRENCHES = ("forward-dynamics", "inverse-dynamics")
_IN_LOOP = 4000  # bytes of a body that is answered at once; larger ones go to a thread
_THREADS = 2
_AS_JSON = 32  # bytes of a number on its way to JSON: an object, a place in a list
_ONE_STATE: set[tuple[int, ...]] = {()}


def body_of(what: str) -> type[msgspec.Struct]:
    """The JSON body of a query: q, and what else it takes, zero when left out. Lists of lists are batches."""
    fields: list[Any] = [("q", Numbers)]
    fields += [(name, Numbers | None, None) for name in QUERIES[what] if name != "q"]
    kinds = {"f_ext": dict[str, Numbers]}
    fields += [(name, kinds.get(name, str) | None, None) for name in (OWN[what].options if what in OWN else ())]
    if what == "kinematics":
        fields.append(("frames", list[str] | None, None))
    name = "".join(part.title() for part in what.split("-"))
    return msgspec.defstruct(name, fields, forbid_unknown_fields=True, frozen=True, module=__name__)


_DECODERS = {what: msgspec.json.Decoder(body_of(what)) for what in QUERIES}
_encode = msgspec.json.Encoder().encode
_JSON_HEADERS = [(b"content-type", JSON.encode())]
_NPZ_HEADERS = [(b"content-type", npz.MEDIA_TYPE.encode())]


class Queries:
    """Answers POST /v1/robots/{id}/{query}."""

    def __init__(self, settings: Settings, robots: RobotPool, metrics: Metrics) -> None:
        self._quotas, self._robots, self._metrics = settings.quotas, robots, metrics
        self._threads = ThreadPoolExecutor(_THREADS, "twolink-query")

    async def answer(self, scope: Any, receive: Any, key: str, what: str) -> tuple[int, list[Any], bytes]:
        """Status, headers and body. Raises what is wrong with the request."""
        body = await read_body(scope, receive, self._quotas.body_mb * 2**20)
        robot = self._robots.loaded(key) or await self._robots.get(key)
        given = media_type(header(scope, b"content-type"))
        given = JSON if given in UNTOLD else given
        if given not in (JSON, npz.MEDIA_TYPE, "application/zip"):
            remedy = f"send {JSON} or {npz.MEDIA_TYPE}"
            raise Refusal(415, f"{given[:80]!r} is not understood", where="header: Content-Type", remedy=remedy)
        reply = accepts(scope, (JSON, npz.MEDIA_TYPE), default=JSON if given == JSON else npz.MEDIA_TYPE)
        if given == JSON and reply == JSON and len(body) < _IN_LOOP:
            return 200, _JSON_HEADERS, self._answer(robot, what, body, given, reply)
        loop = asyncio.get_running_loop()
        content = await loop.run_in_executor(self._threads, self._answer, robot, what, body, given, reply)
        return 200, _JSON_HEADERS if reply == JSON else _NPZ_HEADERS, content

    def _answer(self, robot: Robot, what: str, body: bytes, given: str, reply: str) -> bytes:
        if given == JSON:
            arguments = _from_json(what, body)
        else:
            arguments = _from_npz(what, npz.read_npz(body, int(self._quotas.upload_mb * 2**20)))
        self._metrics.states.inc(self._check_size(robot, what, arguments, _AS_JSON if reply == JSON else 8))
        result = self._ask(robot, what, arguments)
        if reply == JSON:
            plain = {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in result.items()}
            return _encode(plain)
        return npz.write_npz({name: np.asarray(value) for name, value in result.items()})

    def _ask(self, robot: Robot, what: str, arguments: dict[str, Any]) -> dict[str, Any]:
        if what == "kinematics":
            frames = arguments.get("frames")
            return {"frames": frames or link_names(robot), "poses": frame_poses(robot, arguments["q"], frames)}
        if what == "derivatives":
            return derivatives(robot, arguments)
        options = {name: arguments.pop(name, None) for name in OWN[what].options}
        return answer_query(robot, what, arguments, **options)

    def _check_size(self, robot: Robot, what: str, arguments: dict[str, Any], number: int) -> int:
        """The number of states. Raises Refusal when they, or the answer at `number` bytes each, are too much."""
        if "q" not in arguments:
            raise Refusal(400, "q is not given", where="q", remedy=f"give the {robot.nq} numbers of a configuration")
        point = next((name for name, v in arguments.items() if isinstance(v, np.ndarray) and v.ndim == 0), None)
        if point is not None:
            raise Refusal(400, "expected an array, got one number", where=point, remedy="give shape (..., n)")
        wrenches = arguments["f_ext"].values() if "f_ext" in arguments else ()
        shapes = {v.shape[:-1] for v in (*arguments.values(), *wrenches) if isinstance(v, np.ndarray)}
        try:
            count = 1 if shapes == _ONE_STATE else math.prod(np.broadcast_shapes(*shapes))
        except ValueError:
            return 0  # the query says what does not fit
        frames = len(arguments.get("frames") or ()) or robot.model.nframes
        others = {"kinematics": 7 * frames, "derivatives": 3 * robot.nv**2}
        shape = OWN[what].shape if what in OWN else (others[what],)
        numbers = count * math.prod(robot.nv if n == "nv" else n for n in shape)
        if count > self._quotas.states or numbers * number > self._quotas.answer_mb * 2**20:
            raise Refusal(413, f"{count} states are too many at once", where="q", remedy="send smaller batches")
        return count


def _from_json(what: str, body: bytes) -> dict[str, Any]:
    decoded = _DECODERS[what].decode(body)
    arguments: dict[str, Any] = {}
    for name in decoded.__struct_fields__:
        value = getattr(decoded, name)
        if value is None:
            continue
        if name == "f_ext":
            arguments[name] = {frame: _array(f"f_ext.{frame}", wrench) for frame, wrench in value.items()}
        else:
            arguments[name] = value if name in ("method", "frames", "frame", "axes") else _array(name, value)
    return arguments


def _array(name: str, value: Numbers) -> np.ndarray:
    try:
        return np.array(value, dtype=np.float64)
    except ValueError:
        what = "expected numbers, or lists of numbers of one length"
        raise QueryError(what, where=name, remedy="give a state, or a list of states") from None


def _from_npz(what: str, arrays: dict[str, np.ndarray]) -> dict[str, Any]:
    """Arguments from arrays of their names; wrenches are named f_ext.FRAME."""
    arguments: dict[str, Any] = {}
    for name, value in arrays.items():
        if name.startswith("f_ext.") and what in _WITH_WRENCHES:
            arguments.setdefault("f_ext", {})[name.removeprefix("f_ext.")] = value
        elif name in QUERIES[what]:
            arguments[name] = value
        else:
            raise QueryError(f"{what} takes no {name[:80]!r}", where=name[:80],
                             remedy=f"it takes {', '.join(QUERIES[what])}")  # fmt: skip
    return arguments
