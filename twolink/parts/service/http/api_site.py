"""Paths outside /v1: the page, the API's description (OpenAPI 3.1) and its docs, health and metrics.

The docs are the description as HTML, with no script and no outside address.
"""

import asyncio
import functools
import hashlib
import json
from html import escape
from pathlib import Path
from typing import Any

from litestar import MediaType, Response, get
from litestar.params import FromPath

from twolink._version import __version__
from twolink.parts.service.http.components import Shared
from twolink.parts.service.http.messages import PAGE_POLICY, Asked
from twolink.parts.service.http.openapi import openapi_document
from twolink.parts.service.problems import Refusal
from twolink.parts.service.work import metrics
from twolink.show.playback import VIEWER, viewer_script

Json = dict[str, Any]
_PAGE = Path(__file__).parents[1] / "page"
_MEDIA = {".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}
_HEADERS = {"Content-Security-Policy": PAGE_POLICY, "Cache-Control": "no-cache"}


def docs_page(document: Json) -> str:
    """The page of an OpenAPI document: operations grouped by their tags, then the schemas they refer to."""
    groups: dict[str, list[str]] = {}
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            head = f'<span class="method">{method.upper()}</span>{escape(path)}</code> {escape(operation["summary"])}'
            content = {name: operation[name] for name in ("parameters", "requestBody") if name in operation}
            details = _details(head, operation.get("description", ""), content)
            groups.setdefault(operation.get("tags", ["service"])[0], []).append(details)
    schemas = document["components"]["schemas"]
    groups["schemas"] = [_details(f"{escape(name)}</code>", "", schema) for name, schema in schemas.items()]
    listed = "".join(f"<h2>{escape(tag)}</h2>{''.join(parts)}" for tag, parts in groups.items())
    page = (_PAGE / "docs.html").read_text(encoding="utf-8")
    return page.replace("{about}", escape(document["info"]["description"])).replace("{operations}", listed)


def _details(head: str, text: str, content: Json) -> str:
    shown = f"<pre>{escape(json.dumps(content, indent=1))}</pre>" if content else ""
    return f"<details><summary><code>{head}</summary><p>{escape(text)}</p>{shown}</details>"


@get("/health", tags=["service"], summary="Whether the service answers")
async def health(service: Shared) -> dict[str, Any]:
    """Version, jobs that wait or run, bytes kept, and what keeps worker processes in. The disk is asked by /ready."""
    jobs = service.jobs.count("queued") + service.jobs.count("running")
    kept, sandbox = service.store.kept_bytes, service.protection
    return {"status": "ok", "version": __version__, "jobs": jobs, "bytes": kept, "sandbox": sandbox}


@get("/ready", tags=["service"], summary="Whether the service can do its work")
async def ready(service: Shared) -> dict[str, str]:
    """503 with the reason while it ends, its data folder cannot be written, or the disk has no room for a result."""
    await service.require_ready()
    return {"status": "ready", "version": __version__}


@get("/metrics", tags=["service"], summary="Counters in Prometheus's text format", media_type=MediaType.TEXT)
async def show_metrics(service: Shared) -> Response[bytes]:
    """Requests, states and jobs; what waits and for how long; memory, and how late the event loop is."""
    return Response(service.metrics.text(), media_type=metrics.MEDIA_TYPE)


@get("/openapi.json", tags=["service"], summary="This description")
async def openapi(request: Asked) -> dict[str, Any]:
    """The API as an OpenAPI 3.1 document."""
    return await asyncio.to_thread(openapi_document, request.app)


@get("/docs", include_in_schema=False)
async def docs(request: Asked) -> Response[str]:
    """The description for people; no outside address."""
    document = await asyncio.to_thread(openapi_document, request.app)
    return Response(docs_page(document), media_type=MediaType.HTML, headers=_HEADERS)


@get("/", include_in_schema=False)
async def index() -> Response[bytes]:
    """The page. It asks for its files below their digest, so that a browser asks once for each."""
    page, digest = await asyncio.to_thread(_files)
    content = page["index.html"].replace(b'"page/', b'"page/%s/' % digest.encode())
    return Response(content, media_type=_MEDIA[".html"], headers=_HEADERS)


@get("/page/{path:path}", include_in_schema=False)
async def page_file(path: FromPath[Path]) -> Response[bytes]:
    """The page's scripts, styles and pictures; no path of a request is ever opened."""
    page, digest = await asyncio.to_thread(_files)
    name = path.as_posix().lstrip("/").removeprefix(f"{digest}/")
    if name not in page:
        raise Refusal(404, f"there is no {name[:80]!r}", where="path", remedy="the page is at /")
    is_named = digest in path.parts
    headers = _HEADERS | ({"Cache-Control": "max-age=31536000, immutable"} if is_named else {})
    return Response(page[name], media_type=_MEDIA[Path(name).suffix], headers=headers)


@functools.cache
def _files() -> tuple[dict[str, bytes], str]:
    """The page's files, with the viewer's and meshcat's script, which has three.js; and their digest."""
    paths = {path.relative_to(_PAGE).as_posix(): path for path in _PAGE.rglob("*")}
    paths |= {f"viewer/{path.name}": path for path in VIEWER.iterdir()}
    page = {name: path.read_bytes() for name, path in sorted(paths.items()) if path.suffix in _MEDIA}
    page["meshcat.js"] = viewer_script().encode()
    return page, hashlib.blake2b(b"".join(page.values()), digest_size=8).hexdigest()
