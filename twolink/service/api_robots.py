"""/v1/robots: list, inspect, upload, draw and delete."""

from __future__ import annotations

import functools
import hashlib
import shutil
import uuid
from typing import Annotated, Any

import msgspec
from litestar import MediaType, Request, Response, delete, get, post
from litestar.params import Parameter

from twolink._version import __version__
from twolink.dynamics.robot_record import robot_record
from twolink.robots.catalogue import catalogue_entry
from twolink.service.components import Service, Shared
from twolink.service.http_io import JSON, UNTOLD, media_type
from twolink.service.problems import Refusal
from twolink.service.robot_pool import catalogue
from twolink.service.robot_tasks import RobotOptions

_XML = ("application/xml", "text/xml", "application/urdf+xml")
_ZIP = ("application/zip", "application/x-zip-compressed")


class RobotUpload(RobotOptions, frozen=True, forbid_unknown_fields=True):
    """A robot to load, and how: text is a URDF; or source is a name of the catalogue."""

    text: str = ""


class UploadQuery(msgspec.Struct, frozen=True):
    """The options of an upload whose body is the URDF or zip itself; gravity as "0,0,-9.81", lock as "elbow:0.5"."""

    root: str | None = None
    mimic: str | None = None
    unphysical: str | None = None
    urdf: str | None = None
    gravity: str | None = None
    lock: list[str] | None = None


@get("/v1/robots", tags=["robots"], summary="List robots")
async def list_robots(service: Shared) -> list[dict[str, Any]]:
    """The robots of the catalogue, whose names are their ids, and those uploaded."""
    known = list(_known())
    shown = ("id", "name", "origin", "nq", "nv", "mass", "root")
    return known + [{key: robot[key] for key in shown} for robot in service.store.robots()]


@functools.cache
def _known() -> list[dict[str, Any]]:
    """The robots of the catalogue."""
    entries = [catalogue_entry(name) for name in catalogue()]
    return [
        {"id": e.name, "name": e.name, "origin": "catalogue", "from": e.origin, "usual_root": e.usual_root}
        for e in entries
    ]


@get("/v1/robots/{robot:str}", tags=["robots"], summary="Inspect a robot")
async def inspect_robot(service: Shared, robot: str) -> dict[str, Any]:
    """Sizes, joints with limits, links, and the load report: what was read, ignored, repaired and assumed."""
    uploaded = service.store.robot(robot)
    if uploaded is not None:
        return uploaded
    loaded = await service.robots.get(robot)
    entry = catalogue_entry(robot)
    about = {"id": robot, "origin": "catalogue", "from": entry.origin, "usual_root": entry.usual_root, "root": "fixed"}
    return {**about, **robot_record(loaded)}


@post("/v1/robots", tags=["robots"], summary="Upload a robot", status_code=201)
async def upload_robot(
    request: Request[Any, Any, Any],
    service: Shared,
    root: str | None = None,
    mimic: str | None = None,
    unphysical: str | None = None,
    urdf: str | None = None,
    gravity: str | None = None,
    lock: Annotated[list[str] | None, Parameter(query="lock")] = None,
) -> Response[dict[str, Any]]:
    """Load a URDF (application/xml), a zip of one with its meshes (application/zip), or JSON that says either.

    The answer is as of GET /v1/robots/{robot}, with the robot's id, which comes from its content: the same upload has
    the same id (200 instead of 201).
    """
    body = await request.body()
    kind = media_type(request.headers.get("content-type", "").encode())
    kind = _sniffed(body) if kind in (*UNTOLD, "application/octet-stream") else kind
    given = UploadQuery(root, mimic, unphysical, urdf, gravity, lock)
    what, options, content = _read(kind, body, given)
    digest = hashlib.sha256(msgspec.json.encode(options, order="sorted") + what.encode() + content).hexdigest()
    key = f"u-{digest[:20]}"
    async with service.locks(key):
        known = service.store.robot(key)
        if known is not None:
            return Response(known, status_code=200)
        return Response(await _receive(service, key, what, options, content), status_code=201)


async def _receive(service: Service, key: str, what: str, options: RobotOptions, content: bytes) -> dict[str, Any]:
    """Have a worker load it, and keep it once that has gone well."""
    quotas = service.settings.quotas
    if len(service.store.robots()) >= quotas.uploads:
        raise Refusal(429, f"{quotas.uploads} robots are kept already", where="request", remedy="delete some")
    service.store.shrink(quotas.disk_mb * 2**20 - len(content))
    if service.store.used_bytes() + len(content) > quotas.disk_mb * 2**20:
        raise Refusal(413, "the service's disk quota is used up", where="body", remedy="delete some robots")
    staged = service.store.folder / "staging" / uuid.uuid4().hex
    staged.mkdir(mode=0o700)
    try:
        (staged / "body").write_bytes(content)
        most = {"bytes": int(quotas.upload_mb * 2**20), "files": quotas.files, "nv": quotas.moving_joints}
        found = await service.read(
            "receive", folder=str(staged), kind=what, options=msgspec.to_builtins(options), most=most
        )
        about = {"id": key, "origin": "uploaded", **msgspec.to_builtins(options), "root": options.root}
        description = {**about, **found["description"]}
        service.store.add_robot(key, staged, description)
    finally:
        shutil.rmtree(staged, ignore_errors=True)
    service.robots.put(key, found["robot"])
    return description


def _read(kind: str, body: bytes, given: UploadQuery) -> tuple[str, RobotOptions, bytes]:
    """What was sent ("source", "urdf" or "zip"), how to load it, and its content."""
    if kind == JSON:
        upload = msgspec.json.decode(body, type=RobotUpload)
        if bool(upload.source) == bool(upload.text):
            raise Refusal(400, "expected source or text", where="body", remedy='such as {"source": "panda"}')
        fields = {name: getattr(upload, name) for name in RobotOptions.__struct_fields__}
        options = RobotOptions(**fields)
        return ("source", options, b"") if upload.source else ("urdf", options, upload.text.encode())
    if kind in _XML:
        return "urdf", _options(given), body
    if kind in _ZIP:
        return "zip", _options(given), body
    remedy = "send application/xml, application/zip or application/json"
    raise Refusal(415, f"{kind[:80]!r} is not understood", where="header: Content-Type", remedy=remedy)


def _sniffed(body: bytes) -> str:
    """The media type, where the client does not say it."""
    if body.startswith(b"PK"):
        return _ZIP[0]
    return _XML[0] if body.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"<") else JSON


def _options(given: UploadQuery) -> RobotOptions:
    plain: dict[str, Any] = {name: value for name, value in msgspec.structs.asdict(given).items() if value is not None}
    if given.gravity is not None:
        plain["gravity"] = given.gravity.split(",")
    if given.lock is not None:
        pairs = (text.rpartition(":") for text in given.lock)
        plain["lock"] = {name: [part for part in value.split(",") if part] for name, _, value in pairs}
    try:
        return msgspec.convert(plain, RobotOptions, strict=False)
    except msgspec.ValidationError as error:
        raise Refusal(400, str(error), where="query", remedy="see the API's description: /docs") from None


@get("/v1/robots/{robot:str}/visuals", tags=["robots"], summary="What a robot looks like")
async def visuals(service: Shared, robot: str) -> Response[bytes]:
    """Shapes by link, as three.js objects in JSON; see `kinematics` for where the links are."""
    service.robots.require(robot)
    target = service.store.folder / "results" / f"visuals-{__version__}-{robot}.json"
    if service.store.robot(robot) is not None:
        target = service.store.robot_folder(robot) / "visuals.json"
    async with service.locks(str(target)):
        if not target.exists():
            draft = target.with_suffix(".draft")
            await service.read("draw", key=robot, target=str(draft))
            draft.replace(target)
            service.store.measure_robot(robot)
    return Response(target.read_bytes(), media_type=MediaType.JSON)


@delete("/v1/robots/{robot:str}", tags=["robots"], summary="Delete an uploaded robot", status_code=204)
async def delete_robot(service: Shared, robot: str) -> None:
    """Results computed with it stay."""
    if robot in catalogue():
        raise Refusal(409, "robots of the catalogue stay", where="path: robot", remedy="delete uploaded ones")
    service.robots.require(robot)
    service.store.remove_robot(robot)
    service.robots.forget(robot)


HANDLERS = [list_robots, inspect_robot, upload_robot, visuals, delete_robot]
