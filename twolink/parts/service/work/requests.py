"""Requests about scenes and for jobs: their bodies, most of which are calls of the package's functions.

The fields, types, defaults and texts of such a body are those of the function's signature and docstring.
"""

import hashlib
import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import msgspec
from numpy.typing import ArrayLike

import twolink as tl
from twolink.dynamics import Robot
from twolink.dynamics.arguments import Positive
from twolink.dynamics.queries import Numbers
from twolink.io.docstrings import texts_of
from twolink.io.fingerprints import code_key, files_digest, versions
from twolink.parts.service.problems import Refusal, decode_body, decode_unique
from twolink.robots.catalogue import our_urdfs
from twolink.scenes import Scene
from twolink.scenes.file_format import SceneFile

NOT_SENT = ("progress", "patience")  # the service has limits of its own
_Robot = Annotated[str, msgspec.Meta(extra_json_schema={"format": "robot"})]
_SENT = {Scene: str | SceneFile, Robot: _Robot}  # a scene by name or in full; a robot by id
_TIMES = Annotated[tuple[float, ...], msgspec.Meta(min_length=1)] | None
_ARRAY = frozenset(get_args(ArrayLike))


def body_of_call(
    function: Callable[..., Any], name: str, without: Sequence[str] = (), tag: str | None = None, **more: Any
) -> type[msgspec.Struct]:
    """The JSON body of a call: a frozen struct, which takes no other fields.

    without: parameters that are not sent. tag: the value of the field `operation`, by which bodies are told apart.
    more: types of fields in place of those of the signature, or (type, default) of others, by name.
    """
    hints, texts = get_type_hints(function, include_extras=True), texts_of(function)
    fields: list[tuple[Any, ...]] = []
    for parameter in inspect.signature(function).parameters.values():
        if parameter.name in (*NOT_SENT, *without):
            continue
        own = _TIMES if parameter.name == "t_eval" else more.pop(parameter.name, None)
        kind = own or json_type(hints[parameter.name])
        text = texts.get(parameter.name)
        kind = Annotated[kind, msgspec.Meta(description=text)] if text else kind
        default = () if parameter.default is parameter.empty else (parameter.default,)
        fields.append((parameter.name, kind, *default))
    fields += [(field, *given) for field, given in more.items()]
    told = {} if tag is None else {"tag_field": "operation", "tag": tag}
    return msgspec.defstruct(name, fields, frozen=True, kw_only=True, forbid_unknown_fields=True, module=__name__,
                             namespace={"__doc__": f"As `tl.{function.__name__}`."}, **told)  # type: ignore[arg-type]  # fmt: skip


def arguments_of(request: Any, *without: str) -> dict[str, Any]:
    """The arguments of the call by name, without what is the service's own."""
    return {name: getattr(request, name) for name in request.__struct_fields__ if name not in ("wait", *without)}


def sent_as(function: Callable[..., Any], kind: type) -> list[str]:
    """The parameters that may be scenes, or robots, and come as names, ids or contents."""
    hints = get_type_hints(function)
    return [name for name, hint in hints.items() if name != "return" and kind in _parts(hint)]


def words(known: Sequence[str]) -> Any:
    """The type of a text that is one of these."""
    return Literal.__getitem__(tuple(known))


def json_type(hint: Any) -> Any:
    """The type in JSON of what a function takes, without functions and paths.

    Raises TypeError where nothing is left to send.
    """
    parts = _parts(hint)
    if ours := next((kind for kind in _SENT if kind in parts), None):
        return _SENT[ours]
    found: list[Any] = []
    if set(parts) >= _ARRAY:
        found, parts = [float, Numbers], tuple(part for part in parts if part not in _ARRAY)
    for part in parts:
        origin, inner = get_origin(part), get_args(part)
        if origin is Mapping:
            found.append(dict[str, json_type(inner[1])])  # type: ignore[misc]
        elif origin is Sequence:
            found.append(tuple[json_type(inner[0]), ...])  # type: ignore[misc]
        elif origin in (Annotated, Literal, tuple) or part in (float, int, str, bool, NoneType):
            found.append(part)
    return Union[tuple(found)]  # noqa: UP007  # of as many as there are


def _parts(hint: Any) -> tuple[Any, ...]:
    return get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)


WAIT = (Annotated[float, msgspec.Meta(ge=0, le=30, description="Seconds to wait, before a job's state is sent.")], 2.0)
LATER = (WAIT[0], 0.0)
CONTACT = Literal["located", "stepped"] | None
SIMULATOR = Annotated[
    Literal["twolink", "mujoco", "drake", "scipy"],
    msgspec.Meta(description="The simulator whose run it is; others run at their default setting, as in `compare`."),
]
SIMULATORS = ("mujoco", "drake")  # whose runs are kept, too; the first one reads MJCF
CSV = Annotated[str, msgspec.Meta(description="The text of a CSV file, as `twolink identify` takes it.")]
COLUMNS = Annotated[dict[str, Numbers], msgspec.Meta(extra_json_schema={"format": "columns"})]
"""Of measurements: t, q.JOINT, v.JOINT; or whole arrays t, q, v."""


class SceneRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """scene: the name of a bundled scene, or a scene file's content, its robot by id."""

    scene: str | SceneFile


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


@cache
def explain_request() -> Any:
    """The body of a request as `tl.explain`; where the accuracy is left out, it is that of `tl.simulate`."""
    return body_of_call(tl.explain, "ExplainRequest", contact=CONTACT)


@cache
def preview_request() -> Any:
    """The body of a request for a run without an error bar. frames: of the links' poses."""
    frames = (Annotated[int, msgspec.Meta(ge=2, le=3600)], 300)
    without = ("verify", "tolerance", "step")
    return body_of_call(tl.simulate, "PreviewRequest", without, contact=CONTACT, frames=frames)


@cache
def linearization_request() -> Any:
    """The body of a request as `tl.linearize`."""
    one = list[float] | None
    return body_of_call(tl.linearize, "LinearizationRequest", q=one, v=one, t=float, tau=one)


def _simulation() -> Any:
    return body_of_call(tl.simulate, "SimulationRequest", contact=CONTACT, simulator=(SIMULATOR, "twolink"), wait=WAIT)


def _study() -> Any:
    few = msgspec.Meta(max_length=50)
    return body_of_call(tl.accuracy_study, "StudyRequest", wait=LATER,
                        methods=Annotated[tuple[str, ...], few] | None,
                        tolerances=Annotated[tuple[Positive, ...], few] | None,
                        repeats=Annotated[int, msgspec.Meta(ge=1, le=50)],
                        budget=Annotated[float, msgspec.Meta(gt=0, le=60)])  # fmt: skip


def _sensitivity() -> Any:
    named = Annotated[tuple[str, ...], msgspec.Meta(min_length=1, max_length=50)]
    return body_of_call(tl.sensitivities, "SensitivityRequest", wrt=named, wait=WAIT)


def _identification() -> Any:
    from twolink.parts.identification.regression import METHODS

    measured = ("t", "q", "v", "tau", "a", "validate", "joint_model")
    return body_of_call(tl.identify, "IdentificationRequest", measured, data=(CSV,), wait=WAIT, method=words(METHODS),
                        confidence=Annotated[float, msgspec.Meta(gt=0, lt=1)])  # fmt: skip


def _sweep() -> Any:
    from twolink.parts.sweeps.design import DESIGNS
    from twolink.parts.sweeps.outputs import OUTPUTS

    varied = dict[str, list[float | bool | str] | dict[str, list[float]]]
    return body_of_call(tl.sweep, "SweepRequest", ("out", "executor", "workers", "chunk"), wait=LATER,
                        vary=Annotated[varied, msgspec.Meta(min_length=1)], design=words(DESIGNS),
                        count=Annotated[int, msgspec.Meta(ge=1)] | None, seed=Annotated[int, msgspec.Meta(ge=0)],
                        outputs=Annotated[tuple[words(OUTPUTS), ...], msgspec.Meta(max_length=50)])  # type: ignore[misc]  # fmt: skip


OPERATIONS: dict[str, dict[str, Any]] = {
    "compare_models": {},
    "energy_book": {"without": ("run",)},
    "equilibria": {},
    "fit": {"measurements": COLUMNS},
    "gradient": {"without": ("slopes",)},
    "judge": {"trajectory": COLUMNS},
    "lqr": {},
    "optimize": {"without": ("constraints", "out")},
    "periodic_motion": {},
    "simulate_many": {"contact": CONTACT, "without": ("t_eval", "samples_per_second")},  # samples are not in its record
    "step_table": {"without": ("log",)},
    "trapezoidal_motion": {},
}
"""Functions of `twolink` that are one kind of job: what of their signatures is left out or has a type of its own."""


@cache
def operation_requests() -> dict[str, Any]:
    """The bodies of requests for operations, by the names of their functions."""
    return {name: body_of_call(getattr(tl, name), f"{name.title().replace('_', '')}Request", tag=name, wait=WAIT,
                               **changed) for name, changed in OPERATIONS.items()}  # fmt: skip


def _operation() -> Any:
    return Union[tuple(operation_requests().values())]  # noqa: UP007  # of as many as there are


class _Named(msgspec.Struct):
    operation: Any = ""


@dataclass(frozen=True)
class JobKind:
    """A kind of job: its path below /v1, the worker's task that does it, what it is for, and what makes its request."""

    path: str
    task: str
    summary: str
    make: Callable[[], Any]

    @cached_property
    def request(self) -> Any:
        """The type of its request, made when it is first needed: its function's module takes time to import."""
        return self.make()


JOB_KINDS = {
    "simulation": JobKind("simulations", "simulate", "Simulate a scene", _simulation),
    "study": JobKind("studies", "study", "Study what accuracy costs", _study),
    "sensitivity": JobKind("sensitivities", "sense", "Derivatives of a simulated motion", _sensitivity),
    "identification": JobKind("identifications", "identify", "Parameters from measurements", _identification),
    "sweep": JobKind("sweeps", "sweep", "Run a scene many times", _sweep),
    "operation": JobKind("operations", "operate", "Call another function of the package", _operation),
}


class JobRequest(msgspec.Struct, frozen=True):
    """A request for a job as the service keeps it. content: its JSON without `wait`.

    key: the id of the job, which depends on the content alone and on what computes its result (`version_key`).
    """

    key: str
    wait: float
    content: bytes


@cache
def version_key() -> str:
    """A digest of what computes results: our code, scenes and robots, and the versions of libraries and simulators."""
    return f"{code_key()}{files_digest(our_urdfs().glob('*.urdf'))}{versions(SIMULATORS)}"


def prepare(*, kind: str, body: bytes, ids: str = "") -> JobRequest:
    """Check the body of a request for a job. ids: what sets an owner's ids apart. Raises as `decode_unique`."""
    asked = JOB_KINDS[kind].request
    if kind == "operation":  # what is wrong is told by the fields of that one
        asked = operation_requests().get(str(decode_body(body, _Named).operation), asked)
    request = decode_unique(body, asked)
    fields = msgspec.to_builtins(request)
    del fields["wait"]
    content = msgspec.json.encode(fields)  # in the order that was given: samples are drawn in that of `vary`
    digest = hashlib.sha256((version_key() + ids).encode() + content).hexdigest()
    return JobRequest(f"{kind}-{digest[:20]}", request.wait, content)


def job_request(kind: str, content: bytes) -> Any:
    """The request of a job, of its content."""
    return msgspec.json.decode(content, type=JOB_KINDS[kind].request)


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
