"""/v1/scenes: list, show, validate and explain."""

import functools
from typing import Any

from litestar import MediaType, Request, Response, get, post
from litestar.params import FromPath

from twolink.integrate.methods import methods
from twolink.scenes import bundled_scenes, scenes
from twolink.scenes.file import bundled_content
from twolink.scenes.file_format import scene_schema
from twolink.service.components import Shared
from twolink.service.problems import Refusal


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


@post("/v1/scenes/validate", tags=["scenes"], summary="Check a scene", status_code=200)
async def validate(request: Request[Any, Any, Any], service: Shared) -> Response[bytes]:
    """The scene as it is understood: robot, q, v, effects with all their fields. A problem says what is wrong."""
    return Response(await service.read("validate", body=await request.body()), media_type=MediaType.JSON)


@post("/v1/scenes/explain", tags=["scenes"], summary="What a scene costs", status_code=200)
async def explain(request: Request[Any, Any, Any], service: Shared) -> Response[bytes]:
    """Its operations by effect, the formulation, the method and why, and the seconds a run will take."""
    content = await service.read("explain", body=await request.body(), quotas=service.settings.quotas)
    return Response(content, media_type=MediaType.JSON)


@post("/v1/scenes/quantities", tags=["scenes"], summary="What can be varied in a scene", status_code=200)
async def quantities(request: Request[Any, Any, Any], service: Shared) -> Response[bytes]:
    """By name: initial states, physical constants, numbers of effects; each with kind, unit and the scene's own value.

    Sensitivities and sweeps take these names.
    """
    return Response(await service.read("quantities", body=await request.body()), media_type=MediaType.JSON)


@post("/v1/scenes/linearize", tags=["scenes"], summary="A scene's equations near a state", status_code=200)
async def linearize(request: Request[Any, Any, Any], service: Shared) -> Response[bytes]:
    """dx/dt = A x + B u about the state: A, B, names, the bound on their entries' error, eigenvalues, stability."""
    return Response(await service.read("linearize", body=await request.body()), media_type=MediaType.JSON)


HANDLERS = [list_scenes, show_scene, schema, list_methods, validate, explain, quantities, linearize]
