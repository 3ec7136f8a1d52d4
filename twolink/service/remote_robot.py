"""A robot of a service: the queries of Robot, asked over HTTP, big batches in parts."""

import io
import math
import zipfile
from collections.abc import Mapping
from typing import Any
from urllib.parse import quote

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from twolink.dynamics import arguments as checked
from twolink.dynamics.named_queries import QUERIES
from twolink.errors import QueryError
from twolink.service import npz
from twolink.service.problems import Refusal
from twolink.service.transport import JSON, Transport

Array = np.ndarray[Any, np.dtype[np.float64]]
Wrenches = Mapping[str, ArrayLike]
_PART = 16 * 2**20  # bytes of a request or an answer: what the service takes from several clients at once
_JSON_NUMBER = 25  # bytes of a number as text
_NOT_AN_ANSWER = (  # what reading another one raises
    LookupError, ValueError, TypeError, AttributeError, OSError, EOFError, zipfile.BadZipFile, msgspec.MsgspecError,
)  # fmt: skip
_POSE = 7  # numbers of a link's pose


class _Joint(msgspec.Struct):
    name: str


class _Description(msgspec.Struct):
    """What is read of the service's description of a robot."""

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
    """A robot of a service, with the queries of Robot: the same arguments, shapes, units and errors.

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

    def forward_dynamics(
        self, q: ArrayLike, v: ArrayLike, tau: ArrayLike, f_ext: Wrenches | None = None, method: str = "aba"
    ) -> Array:
        """Accelerations a (..., nv), M(q) a + h(q, v) = tau. f_ext: wrenches (..., 6) by frame, along its axes."""
        texts = {} if method == "aba" else {"method": method}
        return self._ask("forward-dynamics", f_ext, texts, q=q, v=v, tau=tau)[0]

    def inverse_dynamics(self, q: ArrayLike, v: ArrayLike, a: ArrayLike, f_ext: Wrenches | None = None) -> Array:
        """Torques (..., nv)."""
        return self._ask("inverse-dynamics", f_ext, q=q, v=v, a=a)[0]

    def mass_matrix(self, q: ArrayLike) -> Array:
        """The joint-space inertia matrix M (..., nv, nv)."""
        return self._ask("mass-matrix", q=q)[0]

    def bias(self, q: ArrayLike, v: ArrayLike) -> Array:
        """The torques h(q, v) (..., nv) that keep all accelerations zero."""
        return self._ask("bias", q=q, v=v)[0]

    def coriolis(self, q: ArrayLike, v: ArrayLike) -> Array:
        """A Coriolis matrix C (..., nv, nv)."""
        return self._ask("coriolis", q=q, v=v)[0]

    def gravity_torque(self, q: ArrayLike) -> Array:
        """The torques g (..., nv) that hold the robot at rest against gravity."""
        return self._ask("gravity-torque", q=q)[0]

    def energy(self, q: ArrayLike, v: ArrayLike) -> tuple[Array, ...]:
        """(kinetic, potential) energy, (...,) each, J."""
        return self._ask("energy", q=q, v=v)

    def centre_of_mass(self, q: ArrayLike) -> Array:
        """The centre of mass (..., 3), m, in the world."""
        return self._ask("centre-of-mass", q=q)[0]

    def momentum(self, q: ArrayLike, v: ArrayLike) -> Array:
        """Linear momentum, then angular momentum about the centre of mass, (..., 6), along the world's axes."""
        return self._ask("momentum", q=q, v=v)[0]

    def frame_pose(self, q: ArrayLike, frame: str) -> tuple[Array, ...]:
        """Rotation R (..., 3, 3) and origin p (..., 3) of a frame: x_world = R x_frame + p."""
        return self._ask("frame-pose", None, {"frame": frame}, q=q)

    def frame_velocity(self, q: ArrayLike, v: ArrayLike, frame: str, axes: str = "aligned") -> Array:
        """Velocity (..., 6) of a frame: linear, then angular, along the axes of the world or ("local") its own."""
        return self._ask("frame-velocity", None, {"frame": frame, "axes": axes}, q=q, v=v)[0]

    def frame_jacobian(self, q: ArrayLike, frame: str, axes: str = "aligned") -> Array:
        """The Jacobian J (..., 6, nv) of a frame: J v is its velocity."""
        return self._ask("frame-jacobian", None, {"frame": frame, "axes": axes}, q=q)[0]

    def forward_dynamics_derivatives(self, q: ArrayLike, v: ArrayLike, tau: ArrayLike) -> tuple[Array, ...]:
        """(da_dq, da_dv, da_dtau), (..., nv, nv) each, along tangent directions."""
        return self._ask("forward-dynamics-derivatives", q=q, v=v, tau=tau)

    def inverse_dynamics_derivatives(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> tuple[Array, ...]:
        """(dtau_dq, dtau_dv, dtau_da), (..., nv, nv) each, along tangent directions."""
        return self._ask("inverse-dynamics-derivatives", q=q, v=v, a=a)

    def link_poses(self, q: ArrayLike) -> dict[str, Array]:
        """Where the links are, by name: position [m] and quaternion (x y z w), (..., 7) each."""
        poses = self._ask("kinematics", q=q)[0]
        return {name: poses[..., i, :] for i, name in enumerate(self._links)}

    def _ask(
        self, what: str, f_ext: Wrenches | None = None, texts: Mapping[str, str] | None = None, **arguments: ArrayLike
    ) -> tuple[Array, ...]:
        """The arrays that answer a query by name."""
        sizes = {name: self.nq if name == "q" else self.nv for name in arguments}
        arrays = {name: checked.array(name, value, sizes[name]) for name, value in arguments.items()}
        if f_ext is not None and not isinstance(f_ext, Mapping):
            what = f"expected wrenches by frame, got a {type(f_ext).__name__}"
            raise QueryError(what, argument="f_ext", remedy='such as {"tool0": [0, 0, 1, 0, 0, 0]}')
        arrays |= {f"f_ext.{frame}": checked.array(f"f_ext[{frame!r}]", w, 6) for frame, w in (f_ext or {}).items()}
        try:
            batch = np.broadcast_shapes(*(array.shape[:-1] for array in arrays.values()))
        except ValueError:
            batch = ()  # they do not fit, which the service says
        if math.prod(batch) <= self._largest(what, arrays, texts):
            try:
                return self._send(what, arrays, texts, batch)
            except Refusal as refusal:
                self._note_refusal(what, math.prod(batch), refusal)
        return self._in_parts(what, arrays, texts, batch)

    def _in_parts(
        self, what: str, arrays: dict[str, Array], texts: Mapping[str, str] | None, batch: tuple[int, ...]
    ) -> tuple[Array, ...]:
        """The answers to a batch in parts of about the same size: the service chooses its engine by the size."""
        count, done, parts = math.prod(batch), 0, []
        rows = {name: np.broadcast_to(a, (*batch, a.shape[-1])).reshape(count, -1) for name, a in arrays.items()}
        while done < count:
            left = count - done
            size = math.ceil(left / math.ceil(left / self._largest(what, arrays, texts)))
            try:
                parts.append(
                    self._send(what, {name: a[done : done + size] for name, a in rows.items()}, texts, (size,))
                )
                done += size
            except Refusal as refusal:
                self._note_refusal(what, size, refusal)
        return tuple(np.concatenate(part).reshape(*batch, *part[0].shape[1:]) for part in zip(*parts, strict=True))

    def _note_refusal(self, what: str, count: int, refusal: Refusal) -> None:
        """Remember that `count` states are too many at once. Raises any other refusal."""
        if refusal.status != 413 or count < 2:
            raise refusal
        self._most[what] = count // 2

    def _largest(self, what: str, arrays: Mapping[str, Array], texts: Mapping[str, str] | None) -> int:
        """How many states to send at once."""
        numbers = self._numbers(what)
        sent = sum(array.shape[-1] for array in arrays.values())
        by_size: int = _PART // (max(numbers, sent, 1) * (_JSON_NUMBER if texts else 8))
        return max(1, min(by_size, self._most.get(what, by_size)))

    def _numbers(self, what: str) -> int:
        """How many numbers answer a query of one state."""
        shape = (_POSE, len(self._links)) if what == "kinematics" else QUERIES[what].shape
        return math.prod(self.nv if size == "nv" else size for size in shape)

    def _send(
        self, what: str, arrays: Mapping[str, Array], texts: Mapping[str, str] | None, batch: tuple[int, ...]
    ) -> tuple[Array, ...]:
        """The answer to one request. npz has no place for texts, so requests with texts are JSON."""
        path = f"/v1/robots/{quote(self.id, safe='')}/{what}"
        if not texts and any(array.ndim > 1 for array in arrays.values()):
            content, media = npz.write_npz(arrays), npz.MEDIA_TYPE
        else:
            body: dict[str, Any] = {**(texts or {})}
            for name, array in arrays.items():
                head, _, frame = name.partition(".")
                if frame:
                    body.setdefault(head, {})[frame] = array
                else:
                    body[name] = array
            content, media = msgspec.json.encode(body, enc_hook=np.ndarray.tolist), JSON
        kind, answer = self._transport.request("POST", path, content, media, media, repeatable=True)
        try:
            if kind != media:
                raise ValueError(f"it is {kind}")
            values = _arrays(answer) if media == npz.MEDIA_TYPE else msgspec.json.decode(answer)
            names = ("poses",) if what == "kinematics" else QUERIES[what].results
            found = tuple(np.asarray(values[name], float) for name in names)
            numbers = math.prod(batch) * self._numbers(what)
            if sum(value.size for value in found) != numbers or any(v.shape[: len(batch)] != batch for v in found):
                raise ValueError(f"expected {numbers} numbers for a batch {batch}")
        except _NOT_AN_ANSWER as error:
            raise self._transport.not_twolink(path, str(error)) from None
        return found

    def __repr__(self) -> str:
        return f"<RemoteRobot {self.name!r}: nq={self.nq}, nv={self.nv}, {self.mass:.4g} kg, at {self._transport.url}>"


def _arrays(content: bytes) -> dict[str, Array]:
    with np.load(io.BytesIO(content)) as loaded:
        return dict(loaded)
