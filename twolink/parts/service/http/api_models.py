"""/v1/queries, /v1/robots, /v1/scenes: list, show, upload, draw, check and delete."""

import asyncio
import functools
import gzip
import hashlib
import math
from typing import Any

import msgspec
from litestar import MediaType, Response, delete, get, post
from litestar.datastructures import MultiDict
from litestar.handlers import HTTPRouteHandler
from litestar.params import FromPath, FromQuery

from twolink.dynamics.robot_record import robot_record
from twolink.errors import TwolinkError, require_known
from twolink.integrate.steps.methods import methods
from twolink.parts.service.http.components import Limit, Service, Shared, catalogue
from twolink.parts.service.http.messages import (
    OCTETS,
    OWN_QUERY,
    UNSPECIFIED,
    XML,
    ZIP,
    Asked,
    accepts_gzip,
    body_limit,
    media_type,
    too_large,
)
from twolink.parts.service.problems import JSON, Refusal, decode_body, decode_unique, problem_of
from twolink.parts.service.settings import Quotas
from twolink.parts.service.store.store import LISTED
from twolink.parts.service.work.query_requests import QUERIES
from twolink.parts.service.work.requests import version_key
from twolink.parts.service.work.robot_tasks import ReceivedRobot, RobotOptions
from twolink.parts.service.work.sharing import require_owner, this_request
from twolink.robots.catalogue import catalogue_entry
from twolink.scenes import bundled_scenes, scenes
from twolink.scenes.file import bundled_content
from twolink.scenes.file_format import scene_schema

# The part of a robot's description that a list shows.
_Shown = msgspec.defstruct("_Shown", [(name, Any, msgspec.UNSET) for name in (
    "id", "name", "origin", "nq", "nv", "mass", "root", "source", "lock")])  # fmt: skip
OPTIONS_BYTES = 2**16  # of a body in JSON, without the text of a robot
_Undecoded = msgspec.defstruct(
    "_Undecoded",
    [(name, msgspec.Raw, msgspec.Raw()) for name in RobotOptions.__struct_fields__],
    forbid_unknown_fields=True,
)
_PARAMETERS = ("root", "mimic", "unphysical", "foreign", "urdf", "gravity", "lock")  # of uploads whose body is not JSON


@get("/v1/robots", tags=["robots"], summary="List robots")
async def list_robots(
    service: Shared, limit: Limit = LISTED, before: FromQuery[float | None] = None
) -> list[dict[str, Any]]:
    """The robots of the catalogue, whose names are their ids, and the newest that the token's owner has uploaded.

    At most `limit` of these, `created` before the time `before`: the last one's `created` asks for the next page.
    """
    rows = await service.store.run(
        service.store.robots, math.inf if before is None else before, limit, this_request().sees
    )
    uploaded = await asyncio.to_thread(_listed, rows)
    return [*({"name": name, **_about(name)} for name in catalogue()), *uploaded]


def _listed(rows: list[tuple[str, float, str]]) -> list[dict[str, Any]]:
    """Views of uploaded robots in a list. The rest of a description, which may have megabytes, is not decoded."""
    return [{"owner": owner, "created": created, **msgspec.to_builtins(msgspec.json.decode(text, type=_Shown))}
            for owner, created, text in rows]  # fmt: skip


@functools.cache
def _about(name: str) -> dict[str, Any]:
    """A robot of the catalogue, without loading it."""
    entry = catalogue_entry(name)
    return {"id": name, "origin": "catalogue", "from": entry.origin, "usual_root": entry.usual_root}


@get("/v1/queries", tags=["queries"], summary="List the dynamics queries")
async def list_queries() -> list[dict[str, Any]]:
    """Arguments and answers of each query, with shapes and units; POST /v1/robots/{robot}/{query} asks one."""
    return [query.to_dict() for query in QUERIES.values()]


@get("/v1/robots/{robot:str}", tags=["robots"], summary="Inspect a robot")
async def inspect_robot(service: Shared, robot: FromPath[str]) -> dict[str, Any]:
    """Sizes, joints with limits, links, and the report: what is suspicious, read, ignored, repaired and assumed."""
    uploaded = await service.store.run(service.store.robot, robot)
    if uploaded is not None:
        return uploaded
    loaded = await service.robots.get(robot)
    return {**_about(robot), "root": "fixed", **robot_record(loaded)}


@post("/v1/robots", tags=["robots"], summary="Upload a robot", status_code=201, opt={OWN_QUERY: True})
async def upload_robot(request: Asked, service: Shared) -> Response[dict[str, Any]]:
    """Load a URDF (application/xml), a zip of one with its meshes (application/zip), or JSON that says either.

    The query string has the options of bodies that are not JSON: root, mimic, unphysical, foreign, urdf, gravity as
    "0,0,-9.81", lock as "elbow:0.5" (repeatable). The answer is as of GET /v1/robots/{robot}, with the robot's id,
    which comes from its content: the same upload has the same id (200 instead of 201).
    """
    body, media = await request.body(), media_type(request.headers.get("content-type", "").encode())
    media = _sniffed(body) if media in (*UNSPECIFIED, OCTETS) else media
    if media == JSON:
        this_request().add(2 * len(body))  # its text, decoded and encoded again
    parts = (body, media, request.query_params, service.quotas, service.ids_of(this_request().owner))
    key, kind, options, content = await asyncio.to_thread(_upload, *parts)  # to hash 100 MB takes 0.1 s
    async with service.locks(key):
        kept = await service.store.run(service.store.robot, key)
        if kept is not None:
            return Response(kept, status_code=200)
        return Response(await _receive(service, key, kind, options, content), status_code=201)


def _upload(
    body: bytes, media: str, query: MultiDict[str], quotas: Quotas, ids: str
) -> tuple[str, str, RobotOptions, bytes]:
    """The id of an upload, what it is, how to load it, and its content. ids: as `Service.ids_of`."""
    limit = body_limit(media, quotas)
    if len(body) > limit:
        raise too_large(limit)
    if media == JSON:
        kind, options, content = _from_json(body)
    elif media in XML or media in ZIP:
        kind, content = "zip" if media in ZIP else "urdf", body
        options = _options(query)
    else:
        remedy = "send application/xml, application/zip or application/json"
        raise Refusal(415, f"{media[:80]!r} is not understood", where="header: Content-Type", remedy=remedy)
    digest = hashlib.sha256(ids.encode() + msgspec.json.encode(options, order="sorted") + kind.encode())
    digest.update(content)
    return f"u-{digest.hexdigest()[:20]}", kind, options, content


def _sniffed(body: bytes) -> str:
    """The media type, where the client does not name it."""
    if body.startswith(b"PK"):
        return ZIP[0]
    return XML[0] if body[:1000].removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"<") else JSON


def _from_json(body: bytes) -> tuple[str, RobotOptions, bytes]:
    """Read an upload: its kind ("source" or "urdf"), the options to load it, and its content.

    Decoded, a number takes up to 16 times its bytes: without the text, a body has at most OPTIONS_BYTES, counted before
    it is decoded.
    """
    undecoded: Any = decode_body(body, _Undecoded)
    options = len(body) - len(bytes(undecoded.text))
    if options > OPTIONS_BYTES:
        raise Refusal(413, f"the options have {options} bytes, the limit is {OPTIONS_BYTES}", where="body",
                      remedy="lock each joint once, with as many numbers as its configuration has")  # fmt: skip
    upload = decode_unique(body, RobotOptions)
    if bool(upload.source) == bool(upload.text):
        raise Refusal(400, "expected source or text", where="body", remedy='such as {"source": "panda"}')
    kind = "source" if upload.source else "urdf"
    return kind, msgspec.structs.replace(upload, text=""), upload.text.encode()


def _options(query: MultiDict[str]) -> RobotOptions:
    """The options in a query string. Raises Refusal where one is unknown, or is given twice."""
    names = [name if name != "lock" else f"lock {value.rpartition(':')[0]!r}" for name, value in query.multi_items()]
    for name in names:
        if names.count(name) > 1:
            raise Refusal(400, f"{name[:80]} is given twice", where="query", remedy="give it once")
    for name in query:
        require_known(name, _PARAMETERS, TwolinkError, where="query")
    plain: dict[str, Any] = {name: query[name] for name in _PARAMETERS[:5] if name in query}
    if "gravity" in query:
        plain["gravity"] = query["gravity"].split(",")
    if "lock" in query:
        pairs = (text.rpartition(":") for text in query.getall("lock"))
        plain["lock"] = {name: [part for part in value.split(",") if part] for name, _, value in pairs}
    return msgspec.convert(plain, RobotOptions, strict=False)


async def _receive(service: Service, key: str, kind: str, options: RobotOptions, content: bytes) -> dict[str, Any]:
    """Have a worker load an upload, and keep it once that has gone well."""
    quotas, store = service.quotas, service.store
    owner, (count, _) = this_request().owner, await store.run(store.robot_use)
    if count >= quotas.uploads:
        raise Refusal(429, f"{quotas.uploads} robots are kept already", where="request", remedy="delete some")

    async def reserve(count: Any) -> dict[str, Any]:
        try:
            await store.run(store.accounts.reserve, key, owner, max(0, int(count)))
        except Refusal as refusal:
            return msgspec.structs.asdict(problem_of(refusal))
        return {}

    await store.run(store.accounts.reserve, key, owner, len(content))
    staged = await store.run(store.stage, key, content)
    try:
        answer = await service.read("receive", on_question=reserve, folder=str(staged), kind=kind, options=options)
        loaded = msgspec.convert(answer, ReceivedRobot)
        about = {"id": key, "origin": "uploaded", **msgspec.to_builtins(options), "root": options.root}
        description = {**about, **loaded.description}
        await asyncio.to_thread(store.copies.keep, key)
        await store.run(store.add_robot, key, staged, description, owner)
    finally:
        await store.run(store.unstage, staged)
    service.robots.put(key, loaded.robot)
    return {**description, "owner": owner}


@get("/v1/robots/{robot:str}/visuals", tags=["robots"], summary="What a robot looks like")
async def visuals(request: Asked, service: Shared, robot: FromPath[str]) -> Response[bytes]:
    """Shapes by link, as three.js objects in JSON; see `kinematics` for where the links are."""
    await service.robots.require(robot)
    store = service.store
    path = store.visuals(f"{version_key()[:20]}-{robot}.json.gz")
    await service.make(path, "draw", key=robot)
    content = await asyncio.to_thread(path.read_bytes)
    await store.run(store.drop_drawings, store.most)
    if accepts_gzip(request.scope):
        return Response(content, media_type=MediaType.JSON, headers={"Content-Encoding": "gzip"})
    return Response(await asyncio.to_thread(gzip.decompress, content), media_type=MediaType.JSON)


@get("/v1/robots/{robot:str}/scene", tags=["robots"], summary="A scene with all that the robot's file says")
async def robot_scene(service: Shared, robot: FromPath[str]) -> Response[bytes]:
    """A scene's content, which simulations take: gravity, damping, friction and stops as the file gives them.

    It starts off equilibrium, at rest, and has the ground under a free base; as `tl.scene_of`.
    """
    await service.robots.require(robot)
    return await service.answer("robot_scene", key=robot)


@delete("/v1/robots/{robot:str}", tags=["robots"], summary="Delete an uploaded robot", status_code=204)
async def delete_robot(service: Shared, robot: FromPath[str]) -> None:
    """Delete an uploaded robot. The results computed with it stay."""
    if robot in catalogue():
        raise Refusal(409, "robots of the catalogue stay", where="path: robot", remedy="delete uploaded ones")
    await service.robots.require(robot)
    kept = await service.store.run(service.store.robot, robot)
    require_owner("" if kept is None else kept["owner"], "robot")
    await service.store.run(service.store.remove_robot, robot)
    service.robots.forget(robot)


@get("/v1/scenes", tags=["scenes"], summary="List the bundled scenes")
async def list_scenes() -> list[dict[str, Any]]:
    """Each with its id, title, robot, duration [s] and effects."""
    return [{"id": row.pop("name"), **row} for row in scenes()]


@get("/v1/scenes/{scene:str}", tags=["scenes"], summary="A bundled scene's content")
async def show_scene(scene: FromPath[str]) -> dict[str, Any]:
    """The content of its scene file, which simulations take as their scene."""
    if scene not in bundled_scenes():
        raise Refusal(404, f"there is no scene {scene[:80]!r}", where="path: scene", remedy="GET /v1/scenes lists them")
    return bundled_content(scene)


@get("/v1/scene-schema", tags=["scenes"], summary="The JSON Schema of scenes")
async def schema() -> dict[str, Any]:
    """The schema of scene files, with all effects and their fields."""
    return _schema()


_schema = functools.cache(scene_schema)


@get("/v1/methods", tags=["scenes"], summary="The methods that simulate")
async def list_methods() -> list[dict[str, Any]]:
    """Name, order, kind, whether it chooses its steps, what it is good for, and its source."""
    return methods().to_records()


def _of_scene(path: str, summary: str, about: str, task: str = "") -> HTTPRouteHandler:
    """The handler of what a worker's task of that name says about a scene."""

    async def handler(request: Asked, service: Shared) -> Response[bytes]:
        return await service.answer(task or path, body=await request.body())

    handler.__name__, handler.__doc__ = task or path, about
    return post(f"/v1/scenes/{path}", tags=["scenes"], summary=summary, status_code=200)(handler)


validate = _of_scene("validate", "Check a scene", """\
The scene as it is understood: robot, q, v, effects with all their fields, poses of the links at the start.

A problem says what is wrong.""")  # fmt: skip
scene_visuals = _of_scene("visuals", "What a scene looks like", "Shapes by link as for robots, of the scene's robot "
                          "with the objects beside it.", task="scene_visuals")  # fmt: skip
explain = _of_scene("explain", "What a scene costs", "Its operations by effect, the formulation, the method and why, "
                    "and the seconds a run will take.")  # fmt: skip
preview = _of_scene("preview", "A quick look at a run", "A run without an error bar, which is kept nowhere: {result, "
                    "columns, motion}, as simulations have them.")  # fmt: skip
quantities = _of_scene("quantities", "What can be varied in a scene", """\
By name: initial states, physical constants, numbers of effects; each with kind, unit and the scene's own value.

Sensitivities and sweeps take these names.""")  # fmt: skip
linearize = _of_scene("linearize", "A scene's equations near a state", "dx/dt = A x + B u about the state: A, B, "
                      "names, the bound on their entries' error, eigenvalues, stability.")  # fmt: skip
