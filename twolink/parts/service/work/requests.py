"""The bodies of requests: of dynamics queries, as arguments with their answers; about scenes; and for jobs."""

import functools
import hashlib
import math
from collections import ChainMap
from typing import Annotated, Any, Literal, NamedTuple

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from twolink.algorithms.functions import Shape
from twolink.dynamics import Robot, queries
from twolink.dynamics.queries import OPTIONS, Numbers, Query
from twolink.dynamics.robot_record import link_poses
from twolink.errors import QueryError
from twolink.io.fingerprints import code_key, files_digest
from twolink.parts.service.problems import Refusal, decode_unique, require_unique_keys
from twolink.parts.service.settings import Quotas
from twolink.robots.catalogue import our_urdfs
from twolink.scenes.file_format import SceneFile

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
    decoded = _decoder(query).decode(body)
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
    size = numbers * (_JSON_NUMBER if is_json else 8)
    if count > quotas.states or size > quotas.answer_mb * 2**20:
        raise Refusal(413, f"{count} states are too many at once", where="q", remedy="send smaller batches")


def answer_query(robot: Robot, query: Query, arguments: dict[str, Any], count: int) -> dict[str, Any]:
    """The answer for so many states by the names of its results. Raises QueryError.

    Up to STATES_IN_LOOP of them are answered by Pinocchio, in the event loop and in a worker process alike: tracing a
    program takes longer than the loop may wait, and the same batch has the same bits.
    """
    options = {name: arguments.pop(name) for name in query.options if name in arguments}
    return query.answer(robot, arguments, "pinocchio" if count <= STATES_IN_LOOP else None, **options)


Positive = Annotated[float, msgspec.Meta(gt=0)]
Wait = Annotated[float, msgspec.Meta(ge=0, le=30)]


class SceneRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """scene: the name of a bundled scene, or a scene file's content, its robot by id."""

    scene: str | SceneFile


class RunRequest(SceneRequest, frozen=True, forbid_unknown_fields=True):
    """duration: simulated seconds (the scene's own when left out). t_eval, samples_per_second: as of `tl.simulate`."""

    duration: Positive | None = None
    t_eval: Annotated[list[float], msgspec.Meta(min_length=1)] | None = None
    samples_per_second: Positive = 200.0

    def samples(self, seconds: float) -> float:
        """The number of samples of a run of so many seconds."""
        return seconds * self.samples_per_second if self.t_eval is None else len(self.t_eval)


class ExplainRequest(RunRequest, frozen=True, forbid_unknown_fields=True):
    """As `tl.explain`: accuracy in rad or m. None: 1e-6, and of contacts that are stepped what the patience allows."""

    accuracy: Positive | None = None
    method: str = "auto"
    contact: Literal["located", "stepped"] | None = None


class SimulationRequest(ExplainRequest, frozen=True, forbid_unknown_fields=True):
    """As `tl.simulate`. wait: seconds to wait for the answer, before a job's state is sent instead.

    simulator: whose run it is; another one's is made at its default setting, as by `twolink compare`.
    """

    verify: bool = True
    simulator: Literal["twolink", "mujoco", "drake", "scipy"] = "twolink"
    precision: Literal["auto", "double", "extended", "quad"] = "auto"
    tolerance: Positive | None = None
    step: Positive | None = None
    wait: Wait = 2.0


class PreviewRequest(ExplainRequest, frozen=True, forbid_unknown_fields=True):
    """A run without an error bar. frames: of the links' poses."""

    precision: Literal["auto", "double", "extended", "quad"] = "auto"
    frames: Annotated[int, msgspec.Meta(ge=2, le=3600)] = 300


class LiveRequest(SceneRequest, frozen=True, forbid_unknown_fields=True):
    """A live simulation. accuracy: as of `tl.Simulation`. frames_per_second: of frames and of torques."""

    accuracy: Positive = 1e-4
    frames_per_second: Annotated[float, msgspec.Meta(ge=1, le=120)] = 30.0


Near = Annotated[float, msgspec.Meta(ge=-1e4, le=1e4)]  # m


class Drag(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A point of a link, along its axes, is drawn to a point of the world, m."""

    link: str
    point: tuple[Near, Near, Near]
    to: tuple[Near, Near, Near]


class LiveWords(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Commands that act from the next frame on. tau: torques (nv), N m and N. end: the simulation ends."""

    tau: list[float] | None = None
    drag: Drag | None = None
    end: bool = False


class LinearizationRequest(SceneRequest, frozen=True, forbid_unknown_fields=True):
    """As `tl.linearize`: the state, the scene's own where it is left out."""

    q: list[float] | None = None
    v: list[float] | None = None


class SensitivityRequest(RunRequest, kw_only=True, frozen=True, forbid_unknown_fields=True):
    """As `tl.sensitivities`. wait: as of simulations."""

    wrt: Annotated[list[str], msgspec.Meta(min_length=1, max_length=50)]
    accuracy: Positive = 1e-6
    samples_per_second: Positive = 50.0
    wait: Wait = 2.0


class IdentificationRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """As `tl.identify`. robot: an id. data: the text of a CSV file, as `twolink identify` takes it. wait: as above."""

    robot: str
    data: str
    parameters: Annotated[list[str], msgspec.Meta(max_length=500)] | None = None
    method: Literal["weighted", "ordinary", "robust", "total"] = "weighted"
    confidence: Annotated[float, msgspec.Meta(gt=0, lt=1)] = 0.95
    wait: Wait = 2.0


class StudyRequest(RunRequest, frozen=True, forbid_unknown_fields=True):
    """As `tl.accuracy_study`. wait: as of simulations."""

    methods: Annotated[list[str], msgspec.Meta(max_length=50)] | None = None
    tolerances: Annotated[list[Positive], msgspec.Meta(max_length=50)] | None = None
    samples_per_second: Positive = 50.0
    repeats: Annotated[int, msgspec.Meta(ge=1, le=50)] = 7
    budget: Annotated[float, msgspec.Meta(gt=0, le=60)] = 1.0
    wait: Wait = 0.0


class SweepRequest(RunRequest, kw_only=True, frozen=True, forbid_unknown_fields=True):
    """As `tl.sweep`. wait: as of simulations.

    vary: by name values, or {"range": [first, last, count]}; of samples {"uniform": [low, high]} or {"normal": [mean,
    standard deviation]}. outputs: final, samples, events, energy, cost.
    """

    vary: Annotated[dict[str, list[float | bool | str] | dict[str, list[float]]], msgspec.Meta(min_length=1)]
    accuracy: Positive = 1e-6
    design: Literal["grid", "list", "random", "sobol", "latin-hypercube"] = "grid"
    count: Annotated[int, msgspec.Meta(ge=1)] | None = None
    seed: Annotated[int, msgspec.Meta(ge=0)] = 0
    outputs: Annotated[tuple[str, ...], msgspec.Meta(max_length=50)] = ("final",)
    verify: bool = True
    wait: Wait = 0.0

    def samples(self, seconds: float) -> float:
        """The number of samples of a run of so many seconds that are kept."""
        return super().samples(seconds) if "samples" in self.outputs else 0.0


Request = SimulationRequest | StudyRequest | SensitivityRequest | IdentificationRequest | SweepRequest


class JobKind(NamedTuple):
    """A kind of job: its path below /v1, its request, the worker's task that does it, and what it is for."""

    path: str
    request: type[Request]
    task: str
    summary: str


JOB_KINDS = {
    "simulation": JobKind("simulations", SimulationRequest, "simulate", "Simulate a scene"),
    "study": JobKind("studies", StudyRequest, "study", "Study what accuracy costs"),
    "sensitivity": JobKind("sensitivities", SensitivityRequest, "sense", "Derivatives of a simulated motion"),
    "identification": JobKind("identifications", IdentificationRequest, "identify", "Parameters from measurements"),
    "sweep": JobKind("sweeps", SweepRequest, "sweep", "Run a scene many times"),
}


class JobRequest(msgspec.Struct, frozen=True):
    """A request for a job as the service keeps it. content: its JSON without `wait`, fields in order.

    key: the id of the job, which depends on the content alone and on what computes its result (`version_key`).
    """

    key: str
    wait: float
    content: bytes


@functools.cache
def version_key() -> str:
    """A digest of what computes results: our code, scenes and robots, and the versions of libraries."""
    return code_key() + files_digest(our_urdfs().glob("*.urdf"))


def prepare(*, kind: str, body: bytes, ids: str = "") -> JobRequest:
    """Check the body of a request for a job. ids: what sets an owner's ids apart. Raises as `decode_unique`."""
    request = decode_unique(body, JOB_KINDS[kind].request)
    fields = msgspec.to_builtins(request)
    del fields["wait"]
    content = msgspec.json.encode(fields, order="sorted")
    digest = hashlib.sha256((version_key() + ids).encode() + content).hexdigest()
    return JobRequest(f"{kind}-{digest[:20]}", request.wait, content)


# Of what earlier versions keep. A field that comes to mean something else gets another name.
RENAMED = {"samples": "samples_per_second"}


def upgraded(kind: str, content: bytes) -> bytes:
    """A kept request as this version takes it, which may be of an earlier one.

    Raises
    ------
    Refusal
        422, code "other-version": it has what this version does not take.
    """
    fields, refused = msgspec.json.decode(content), ""
    for one in (fields, {RENAMED.get(name, name): value for name, value in fields.items()}):
        try:
            msgspec.convert(one, JOB_KINDS[kind].request)
            return msgspec.json.encode(one)
        except msgspec.ValidationError as error:
            refused = refused or str(error)
    raise Refusal(422, f"it was sent to another version of twolink: {refused}", code="other-version", where="request",
                  remedy="send it again, with the fields of this version")  # fmt: skip
