"""A robot of a service: the queries of Robot, asked over HTTP, big batches in parts."""

import io
import math
import zipfile
from collections.abc import Callable, Mapping
from typing import Any
from urllib.parse import quote

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from twolink.dynamics import arguments as checked
from twolink.dynamics.queries import QUERIES, Query
from twolink.errors import QueryError
from twolink.parts.service.problems import JSON, Refusal, encode
from twolink.parts.service.store.archives import NPZ, write_npz
from twolink.parts.service.transport import Transport
from twolink.parts.service.work.query_requests import KINEMATICS

Array = np.ndarray[Any, np.dtype[np.float64]]
_PART = 16 * 2**20  # bytes of a request or an answer: what the service takes from several clients at once
_JSON_NUMBER = 25  # bytes of a number as text
_NOT_AN_ANSWER = (  # what reading another one raises
    LookupError, ValueError, TypeError, AttributeError, OSError, EOFError, zipfile.BadZipFile, msgspec.MsgspecError,
)  # fmt: skip


class _Joint(msgspec.Struct):
    name: str


class _Description(msgspec.Struct):
    """Fields that are read of the service's description of a robot."""

    id: str
    name: str
    nq: int
    nv: int
    mass: float
    report: dict[str, Any]
    joints: list[_Joint]
    links: list[str]
    neutral: list[float]


class RemoteRobot:
    """A robot of a service, with the queries of Robot that are declared: the same arguments, shapes, units and errors.

    Single states go as JSON, batches as arrays. A batch that is larger than the service takes at once goes in parts.

    Attributes
    ----------
    id : str
        What the service calls the robot.
    name, nq, nv, mass, joint_names, neutral, report
        As of Robot; the report as plain data.
    description : dict
        All that the service says of the robot.
    """

    def __init__(self, transport: Transport, description: dict[str, Any]) -> None:
        try:
            known = msgspec.convert(description, _Description)
        except msgspec.ValidationError as error:
            raise transport.not_twolink("/v1/robots", str(error)) from None
        self.description = description
        self.id, self.name, self.nq, self.nv = known.id, known.name, known.nq, known.nv
        self.mass, self.report = known.mass, known.report
        self.joint_names: tuple[str, ...] = tuple(joint.name for joint in known.joints)
        self._links, self._neutral = known.links, known.neutral
        self._transport = transport
        self._most: dict[str, int] = {}  # states that the service takes at once, by query, where it refused more

    @property
    def neutral(self) -> Array:
        """The neutral configuration (nq,)."""
        return np.array(self._neutral)

    def __getattr__(self, name: str) -> Callable[..., Any]:
        """A query of Robot."""
        query = QUERIES.get(name.replace("_", "-"))
        if query is None or query.method != name:
            known = ", ".join(one for one in dir(self) if not one.startswith("_"))
            what = f"a robot of a service has no {name!r}, it has {known}; tl.load_robot gives one with all methods"
            raise AttributeError(what, name=name, obj=self)

        def ask(*arguments: Any, **options: Any) -> Any:
            answers = self._ask(query, query.signature.bind(*arguments, **options).arguments)
            return answers if len(query.results) > 1 else answers[0]

        ask.__name__, ask.__doc__ = name, query.function.__doc__
        ask.__signature__ = query.signature  # type: ignore[attr-defined]
        return ask

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *(query.method for query in QUERIES.values())]

    def link_poses(self, q: ArrayLike) -> dict[str, Array]:
        """Poses of the links, by name: position [m] and quaternion (x y z w), (..., 7) each."""
        poses = self._ask(KINEMATICS, {"q": q})[0]
        return {name: poses[..., i, :] for i, name in enumerate(self._links)}

    def _ask(self, query: Query, given: Mapping[str, Any]) -> tuple[Array, ...]:
        """The arrays that answer a query with these arguments and options."""
        arrays = {
            name: checked.array(name, value, self.nq if name == "q" else self.nv)
            for name, value in given.items() if name in query.arguments
        }  # fmt: skip
        f_ext = given.get("f_ext")
        if f_ext is not None and not isinstance(f_ext, Mapping):
            what = f"expected wrenches by frame, got a {type(f_ext).__name__}"
            raise QueryError(what, argument="f_ext", remedy='such as {"tool0": [0, 0, 1, 0, 0, 0]}')
        arrays |= {f"f_ext.{frame}": checked.array(f"f_ext[{frame!r}]", w, 6) for frame, w in (f_ext or {}).items()}
        defaults = query.signature.parameters
        chosen = {
            name: given[name] for name in query.options
            if name != "f_ext" and name in given and given[name] != defaults[name].default
        }  # fmt: skip
        try:
            batch = np.broadcast_shapes(*(array.shape[:-1] for array in arrays.values()))
        except ValueError:
            batch = ()  # they do not fit, which the service says
        if chosen and not math.prod(batch):  # lists of no states have no shape: that of one state is asked for
            one = {name: np.zeros(a.shape[-1]) if name != "q" else self.neutral for name, a in arrays.items()}
            return tuple(np.empty((*batch, *found.shape)) for found in self._send(query, one, chosen, ()))
        in_lists = len(batch) < 2 or not chosen  # JSON has one list of states
        if in_lists and math.prod(batch) <= self._largest(query, arrays, chosen):
            try:
                return self._send(query, arrays, chosen, batch)
            except Refusal as refusal:
                self._note_refusal(query, math.prod(batch), refusal)
        return self._in_parts(query, arrays, chosen, batch)

    def _in_parts(
        self, query: Query, arrays: dict[str, Array], chosen: Mapping[str, Any], batch: tuple[int, ...]
    ) -> tuple[Array, ...]:
        """The answers to a batch in parts of about the same size: the service chooses its engine by the size."""
        count, done, parts = math.prod(batch), 0, []
        rows = {name: np.broadcast_to(a, (*batch, a.shape[-1])).reshape(count, -1) for name, a in arrays.items()}
        while done < count:
            left = count - done
            size = math.ceil(left / math.ceil(left / self._largest(query, arrays, chosen)))
            try:
                parts.append(
                    self._send(query, {name: a[done : done + size] for name, a in rows.items()}, chosen, (size,))
                )
                done += size
            except Refusal as refusal:
                self._note_refusal(query, size, refusal)
        return tuple(np.concatenate(part).reshape(*batch, *part[0].shape[1:]) for part in zip(*parts, strict=True))

    def _note_refusal(self, query: Query, count: int, refusal: Refusal) -> None:
        """Remember that `count` states are too many at once. Raises any other refusal."""
        if refusal.status != 413 or count < 2:
            raise refusal
        self._most[query.name] = count // 2

    def _largest(self, query: Query, arrays: Mapping[str, Array], chosen: Mapping[str, Any]) -> int:
        """The number of states to send at once."""
        numbers = query.numbers(self.nv, len(self._links))
        sent = sum(array.shape[-1] for array in arrays.values())
        by_size: int = _PART // (max(numbers, sent, 1) * (_JSON_NUMBER if chosen else 8))
        return max(1, min(by_size, self._most.get(query.name, by_size)))

    def _send(
        self, query: Query, arrays: Mapping[str, Array], chosen: Mapping[str, Any], batch: tuple[int, ...]
    ) -> tuple[Array, ...]:
        """The answer to one request. npz has no place for options, so requests with options are JSON."""
        path = f"/v1/robots/{quote(self.id, safe='')}/{query.name}"
        if not chosen and any(array.ndim > 1 for array in arrays.values()):
            content, media = write_npz(arrays), NPZ
        else:
            body: dict[str, Any] = {**chosen}
            for name, array in arrays.items():
                head, _, frame = name.partition(".")
                if frame:
                    body.setdefault(head, {})[frame] = array
                else:
                    body[name] = array
            content, media = encode(body), JSON
        kind, answer = self._transport.request("POST", path, content, media, media, repeatable=True)
        try:
            if kind != media:
                raise ValueError(f"it is {kind}")
            values = dict(np.load(io.BytesIO(answer))) if media == NPZ else msgspec.json.decode(answer)
            found = tuple(np.asarray(values[name], float) for name in query.results)
            numbers = math.prod(batch) * query.numbers(self.nv, len(self._links))
            if sum(value.size for value in found) != numbers or any(v.shape[: len(batch)] != batch for v in found):
                raise ValueError(f"expected {numbers} numbers for a batch {batch}")
        except _NOT_AN_ANSWER as error:
            raise self._transport.not_twolink(path, str(error)) from None
        return found

    def __repr__(self) -> str:
        return f"<RemoteRobot {self.name!r}: nq={self.nq}, nv={self.nv}, {self.mass:.4g} kg, at {self._transport.url}>"
