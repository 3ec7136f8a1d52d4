"""The dynamics queries over HTTP: one state or a batch, JSON or npz.

Small ones take microseconds and are answered in the event loop, so this path is plain ASGI: bytes in, msgspec, NumPy,
bytes out. All others are answered by computing processes, which also compile; the event loop never does.
"""

from typing import Any

import msgspec
import numpy as np

from twolink.dynamics import Robot
from twolink.service import npz
from twolink.service.http_io import JSON, UNSPECIFIED, body_limit, header, media_type, read_body, while_connected
from twolink.service.metrics import Metrics
from twolink.service.problems import Refusal
from twolink.service.query_answers import answer_query, arguments_from_json, count_of
from twolink.service.robot_pool import RobotPool
from twolink.service.settings import Settings
from twolink.service.worker_pool import Workers

PREFIX = "/v1/robots/"
IN_LOOP = 4000  # bytes of a body that is read in the event loop
STATES_IN_LOOP, _NUMBERS_IN_LOOP = 500, 4096  # of an answer that is computed there, in less than 3 ms
_HEADERS = {media: [(b"content-type", media.encode())] for media in (JSON, npz.MEDIA_TYPE)}


class Queries:
    """Answers POST /v1/robots/{id}/{query}."""

    def __init__(self, settings: Settings, robots: RobotPool, workers: Workers, metrics: Metrics) -> None:
        self._quotas, self._robots, self._workers, self._metrics = settings.quotas, robots, workers, metrics

    async def answer(self, scope: Any, receive: Any, key: str, what: str) -> tuple[int, list[Any], bytes]:
        """Status, headers and body. Raises Refusal or QueryError."""
        sent = media_type(header(scope, b"content-type"))
        sent = JSON if sent in UNSPECIFIED else sent
        if sent not in (JSON, npz.MEDIA_TYPE, "application/zip"):
            remedy = f"send {JSON} or {npz.MEDIA_TYPE}"
            raise Refusal(415, f"{sent[:80]!r} is not understood", where="header: Content-Type", remedy=remedy)
        body = await read_body(scope, receive, body_limit(sent, self._quotas))
        same, other = (JSON, npz.MEDIA_TYPE) if sent == JSON else (npz.MEDIA_TYPE, JSON)
        accept = header(scope, b"accept")
        reply = other if other.encode() in accept and same.encode() not in accept else same
        if sent == JSON and reply == JSON and len(body) < IN_LOOP:
            robot = self._robots.loaded(key) or await self._robots.get(key)
            answer = self._answer_if_small(robot, what, body)
            if answer is not None:
                return 200, _HEADERS[JSON], answer
        await self._robots.require(key)
        work = self._workers.exchange(
            "query", self._quotas.query_seconds, body, key=key, what=what, sent=sent, reply=reply,
            robots=self._robots.folder, quotas=self._quotas,
        )  # fmt: skip
        count, content = await while_connected(receive, work)
        self._metrics.states.inc(count)
        return 200, _HEADERS[reply], content

    def answer_now(self, scope: Any, body: bytes, key: str, what: str) -> bytes | None:
        """The answer in JSON to a few states in JSON, if the robot is loaded, else None. Raises as `answer`."""
        robot = self._robots.loaded(key)
        is_json = media_type(header(scope, b"content-type")) in (JSON, *UNSPECIFIED)
        if robot is None or not is_json or len(body) >= IN_LOOP or npz.MEDIA_TYPE.encode() in header(scope, b"accept"):
            return None
        return self._answer_if_small(robot, what, body)

    def _answer_if_small(self, robot: Robot, what: str, body: bytes) -> bytes | None:
        """The answer to a few states, else None. Their number is below that from which functions are compiled."""
        arguments = arguments_from_json(what, body)
        count, numbers = count_of(robot, what, arguments)
        if count > STATES_IN_LOOP or numbers > _NUMBERS_IN_LOOP:
            return None
        self._metrics.states.inc(count)
        return msgspec.json.encode(answer_query(robot, what, arguments), enc_hook=np.ndarray.tolist)
