"""The OpenAPI 3.1 document: Litestar's, with the queries (which are plain ASGI) and the problems added."""

import functools
from typing import Any

import msgspec
from litestar import Litestar

from twolink.service import npz
from twolink.service.http_io import JSON
from twolink.service.job_requests import (
    ExplainRequest,
    IdentificationRequest,
    LinearizationRequest,
    SceneRequest,
    SensitivityRequest,
    SimulationRequest,
    StudyRequest,
    SweepRequest,
)
from twolink.service.problems import MEDIA_TYPE, Problem
from twolink.service.queries import PREFIX
from twolink.service.query_answers import QUERIES, body_of
from twolink.service.robot_tasks import RobotOptions

Json = dict[str, Any]
_TEXT = {"type": "string"}
_BINARY = {"schema": {"type": "string", "format": "binary"}}
_BODIES = {
    "/v1/scenes/validate": SceneRequest,
    "/v1/scenes/explain": ExplainRequest,
    "/v1/scenes/linearize": LinearizationRequest,
    "/v1/simulations": SimulationRequest,
    "/v1/studies": StudyRequest,
    "/v1/sensitivities": SensitivityRequest,
    "/v1/identifications": IdentificationRequest,
    "/v1/sweeps": SweepRequest,
}
_ABOUT = (
    "q is a configuration (nq numbers), v a velocity, a an acceleration, tau joint torques (nv numbers each), zero "
    "when left out. A list of them is a batch: the answer has the same leading axes. SI units, radians, Pinocchio's "
    "layout. In application/x-npz arrays go by their names, wrenches as f_ext.FRAME; npz is answered by npz unless "
    "Accept says otherwise. The same request has the same answer to the last bit."
)


@functools.lru_cache(maxsize=1)
def openapi_document(app: Litestar) -> Json:
    """The document of an application."""
    document = app.openapi_schema.to_schema()
    bodies, components = msgspec.json.schema_components(
        [*(body_of(query) for query in QUERIES.values()), *_BODIES.values(), Problem, RobotOptions],
        ref_template="#/components/schemas/{name}",
    )
    document.setdefault("components", {}).setdefault("schemas", {}).update(components)
    for what, body in zip(QUERIES, bodies, strict=False):
        document["paths"][f"{PREFIX}{{robot}}/{what}"] = {"post": _query(what, body)}
    for path, body in zip(_BODIES, bodies[len(QUERIES) :], strict=False):
        document["paths"][path]["post"]["requestBody"] = {"required": True, "content": {JSON: {"schema": body}}}
    upload = {"schema": {"$ref": "#/components/schemas/RobotOptions"}}
    content = {JSON: upload, "application/xml": {"schema": _TEXT}, "application/zip": _BINARY}
    document["paths"]["/v1/robots"]["post"]["requestBody"] = {"required": True, "content": content}
    document["components"]["securitySchemes"] = {"token": {"type": "http", "scheme": "bearer"}}
    document["security"] = [{}, {"token": []}]
    for operations in document["paths"].values():
        for operation in operations.values():
            _add_problems(operation)
    return document


def _query(what: str, body: Json) -> Json:
    robot = "a robot's id: a name of the catalogue, or of an upload"
    results = {
        name: {"description": f"({', '.join(map(str, shape))}) for one state, {unit}"}
        for name, (shape, unit) in QUERIES[what].results.items()
    }
    schema = {"schema": {"type": "object", "properties": results}}
    answer = {"description": "The answer, by name", "content": {JSON: schema, npz.MEDIA_TYPE: _BINARY}}
    return {
        "tags": ["queries"],
        "operationId": what.replace("-", "_"),
        "summary": QUERIES[what].summary,
        "description": _ABOUT,
        "parameters": [{"name": "robot", "in": "path", "required": True, "schema": _TEXT, "description": robot}],
        "requestBody": {"required": True, "content": {JSON: {"schema": body}, npz.MEDIA_TYPE: _BINARY}},
        "responses": {"200": answer},
    }


def _add_problems(operation: Json) -> None:
    """Every operation may be refused; what Litestar says of its own refusals is replaced."""
    content = {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}}
    refused = {"description": "What is wrong with the request, where, and what to do", "content": content}
    answers = {status: answer for status, answer in operation["responses"].items() if status[0] not in "45"}
    operation["responses"] = {**answers, "4XX": refused}
