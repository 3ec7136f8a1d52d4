"""The API's description, OpenAPI 3.1: Litestar's, with the types of all bodies and answers, and with the queries."""

import functools
from typing import Any, get_type_hints

import msgspec
from litestar import Litestar

import twolink as tl
from twolink.parts.service.http import answers
from twolink.parts.service.http.api_jobs import MEDIA
from twolink.parts.service.http.components import PREFIX
from twolink.parts.service.problems import JSON, MEDIA_TYPE, Problem
from twolink.parts.service.store.archives import NPZ
from twolink.parts.service.work import metrics, requests
from twolink.parts.service.work.query_requests import QUERIES, body_of
from twolink.parts.service.work.requests import JOB_KINDS
from twolink.parts.service.work.robot_tasks import RobotOptions

Json = dict[str, Any]
_TEXT: Json = {"schema": {"type": "string"}}
_BINARY: Json = {"schema": {"type": "string", "format": "binary"}}
_NAMED = "by which the service's log names the request: up to 64 letters, digits, '.', '_' and '-'"
_REQUEST_ID: Json = {"name": "X-Request-Id", "in": "header", "required": False, **_TEXT, "description": _NAMED}
_NUMBERS: Json = {"anyOf": [{"type": "number"}, {"type": "array", "items": {}}]}
_ANSWERS: dict[str, Any] = {  # in JSON, by method and path
    "get /v1/queries": list[answers.QueryAbout],
    "get /v1/robots": list[answers.ListedRobot],
    "post /v1/robots": answers.RobotAbout,
    "get /v1/robots/{robot}": answers.RobotAbout,
    "get /v1/robots/{robot}/visuals": answers.Object,
    "get /v1/robots/{robot}/scene": answers.Object,
    "get /v1/scenes": list[answers.ListedScene],
    "get /v1/scenes/{scene}": answers.Object,
    "get /v1/scene-schema": answers.Object,
    "get /v1/methods": list[answers.MethodAbout],
    "post /v1/scenes/validate": answers.UnderstoodScene,
    "post /v1/scenes/visuals": answers.Object,
    "post /v1/scenes/preview": answers.Preview,
    "post /v1/scenes/quantities": list[answers.QuantityAbout],
    "post /v1/scenes/linearize": answers.Linearized,
    "get /v1/simulations/{job}/motion": answers.MotionAnswer,
    "get /v1/simulations/{job}/result": answers.Samples,
    "get /v1/studies/{job}/result": answers.Object,
    "get /v1/sweeps/{job}/result": answers.SweepColumns,
    "get /v1/sweeps/{job}/runs/{number}": answers.SweepRun,
    "get /health": answers.Health,
    "get /ready": answers.Ready,
    "get /openapi.json": answers.Object,
}
_FORMS = {  # others, by the end of the path
    "simulations/{job}/result": ("csv", "parquet", "npz"),
    "studies/{job}/result": ("csv", "parquet", "npz"),
    "sweeps/{job}/result": ("csv", "parquet", "zip"),
    "/figure": ("svg", "png"),
    "/playback": ("html",),
}
_MORE = {"post /v1/robots": ("200", "201"), **{f"post /v1/{kind.path}": ("200", "202") for kind in JOB_KINDS.values()}}
_ABOUT = (
    "q is a configuration (nq numbers), v a velocity, a an acceleration, tau joint torques (nv numbers each), zero "
    "when left out. A list of them is a batch: the answer has the same leading axes. SI units, radians, Pinocchio's "
    "layout. In application/x-npz arrays go by their names, wrenches as f_ext.FRAME; npz is answered by npz unless "
    "Accept says otherwise. The same request has the same answer to the last bit."
)


def _bodies() -> dict[str, Any]:
    """The types of bodies by path, of the functions' signatures."""
    return {
        "/v1/scenes/validate": requests.SceneRequest,
        "/v1/scenes/visuals": requests.SceneRequest,
        "/v1/scenes/quantities": requests.SceneRequest,
        "/v1/scenes/explain": requests.explain_request(),
        "/v1/scenes/preview": requests.preview_request(),
        "/v1/scenes/linearize": requests.linearization_request(),
        **{f"/v1/{kind.path}": kind.request for kind in JOB_KINDS.values()},
    }


def _explained() -> Any:
    """The type of an explanation as it is answered: its fields and its text."""
    kind = get_type_hints(tl.explain)["return"]
    return msgspec.defstruct("ExplainedScene", [*get_type_hints(kind).items(), ("text", str)])


def _jobs() -> dict[str, Any]:
    """The types of what is answered about jobs, by method and path."""
    found: dict[str, Any] = {}
    for kind, about in JOB_KINDS.items():
        request = [("request", about.request | None)]  # lists leave out long ones
        job: Any = msgspec.defstruct(f"{kind.title()}Job", request, bases=(answers.Job,), kw_only=True)
        path = f"/v1/{about.path}"
        found |= {f"get {path}": list[job], f"post {path}": job, f"get {path}/{{job}}": job}
        found |= {f"post {path}/{{job}}/{verb}": job for verb in ("cancel", "run")}
    return found


@functools.lru_cache(maxsize=1)
def openapi_document(app: Litestar) -> Json:
    """The document of an application. It takes a second at first, as it imports the functions."""
    document = app.openapi_schema.to_schema()
    asked: Json = {what: body_of(query) for what, query in QUERIES.items()}
    bodies, answered = _bodies(), _ANSWERS | _jobs() | {"post /v1/scenes/explain": _explained()}
    types = [*asked.values(), *bodies.values(), *answered.values(), Problem, RobotOptions]
    schemas, components = msgspec.json.schema_components(types, ref_template="#/components/schemas/{name}")
    document.setdefault("components", {}).setdefault("schemas", {}).update(components)
    following = iter(schemas)
    asked, bodies, answered = (dict(zip(some, following, strict=False)) for some in (asked, bodies, answered))
    for path, body in bodies.items():
        document["paths"][path]["post"]["requestBody"] = {"required": True, "content": {JSON: {"schema": body}}}
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            _add_answers(f"{method} {path}", operation, answered)
    for what, body in asked.items():
        document["paths"][f"{PREFIX}{{robot}}/{what}"] = {"post": _query(what, body)}
    _describe_uploads(document["paths"]["/v1/robots"]["post"], components["RobotOptions"])
    document["components"]["securitySchemes"] = {"token": {"type": "http", "scheme": "bearer"}}
    document["security"] = [{}, {"token": []}]
    for operations in document["paths"].values():
        for operation in operations.values():
            _add_problems(operation)
    plain: Json = _without_tuples(document)
    return plain


def _add_answers(name: str, operation: Json, answered: dict[str, Json]) -> None:
    """Say what is answered, in which media types; of streams of events, that they are such."""
    content: Json = {JSON: {"schema": answered[name]}} if name in answered else {}
    for end, forms in _FORMS.items():
        if name.endswith(end):
            content |= {MEDIA[form]: _TEXT if form in ("csv", "svg", "html") else _BINARY for form in forms}
    if name.endswith("/events"):
        content = {"text/event-stream": _TEXT}
    if name == "get /metrics":
        content = {metrics.MEDIA_TYPE.partition(";")[0]: _TEXT}
    first = next(iter(operation["responses"].values()))
    for status in _MORE.get(name, ()):
        operation["responses"].setdefault(status, {"description": first["description"]})
    for status, answer in operation["responses"].items():
        if status[0] == "2" and status != "204":
            answer["content"] = content


def _query(what: str, body: Json) -> Json:
    robot = "a robot's id: a name of the catalogue, or of an upload"
    results: Json = {
        name: {"description": f"({', '.join(map(str, shape))}) for one state, {unit}", **_NUMBERS}
        for name, (shape, unit) in QUERIES[what].results.items()
    }
    schema = {"schema": {"type": "object", "properties": results, "title": f"{what}-answer"}}
    answer = {"description": "The answer, by name", "content": {JSON: schema, NPZ: _BINARY}}
    return {
        "tags": ["queries"],
        "operationId": what.replace("-", "_"),
        "summary": QUERIES[what].summary,
        "description": _ABOUT,
        "parameters": [{"name": "robot", "in": "path", "required": True, **_TEXT, "description": robot}, _REQUEST_ID],
        "requestBody": {"required": True, "content": {JSON: {"schema": body}, NPZ: _BINARY}},
        "responses": {"200": answer},
    }


def _describe_uploads(operation: Json, options: Json) -> None:
    """The bodies of uploads, and the options in the query string of those that are not JSON."""
    upload = {"schema": {"$ref": "#/components/schemas/RobotOptions"}}
    operation["requestBody"] = {
        "required": True,
        "content": {JSON: upload, "application/xml": _TEXT, "application/zip": _BINARY},
    }
    plain = {name: options["properties"][name] for name in ("root", "mimic", "unphysical", "foreign", "urdf")}
    texts = {"gravity": {"type": "string"}, "lock": {"type": "array", "items": {"type": "string"}}}
    operation["parameters"] = [
        {"name": name, "in": "query", "required": False, "schema": schema} for name, schema in (plain | texts).items()
    ]


def _add_problems(operation: Json) -> None:
    """Every operation may be refused or fail; what Litestar says of its own refusals is replaced."""
    content = {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}}
    refused = {"description": "What is wrong with the request, where, and what to do", "content": content}
    failed = {"description": "What the service cannot do now, and when to ask again", "content": content}
    answers = {status: answer for status, answer in operation["responses"].items() if status[0] not in "45"}
    operation["responses"] = {**answers, "4XX": refused, "5XX": failed}


def _without_tuples(value: Any) -> Any:
    """Lists of a fixed length have items of one schema here, as tools that make clients know no others."""
    if isinstance(value, list):
        return [_without_tuples(item) for item in value]
    if not isinstance(value, dict):
        return value
    if value.get("items") is False and value.get("prefixItems"):
        value = {**value, "items": value["prefixItems"][0]}
    return {name: _without_tuples(item) for name, item in value.items() if name != "prefixItems"}
