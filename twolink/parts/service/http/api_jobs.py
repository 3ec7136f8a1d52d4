"""/v1/simulations, studies, sensitivities, identifications, sweeps: run, watch, cancel, and take the results.

Results in other formats are made on demand by a worker process, and kept beside the result.
"""

import asyncio
import contextlib
import hashlib
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from litestar import MediaType, Response, delete, get, post
from litestar.params import FromPath, FromQuery, PathParameter, QueryParameter
from litestar.response import File, Stream

from twolink.errors import TwolinkError
from twolink.io.tables import read_table
from twolink.parts.service.http.components import Limit, Service, Shared
from twolink.parts.service.http.messages import Asked
from twolink.parts.service.store.store import ACTIVE, LISTED
from twolink.parts.service.work.requests import JOB_KINDS
from twolink.parts.service.work.scene_tasks import SAMPLES, thinned

MEDIA = {
    "json": "application/json",
    "csv": "text/csv",
    "parquet": "application/vnd.apache.parquet",
    "npz": "application/x-npz",
    "svg": "image/svg+xml",
    "png": "image/png",
    "html": "text/html",
    "zip": "application/zip",
}
MAX_POINTS = 20_000
Points = Annotated[int, QueryParameter(ge=2, le=MAX_POINTS)]
Frames = Annotated[int, QueryParameter(ge=2, le=3600)]
FigureForm = Annotated[Literal["svg", "png"], QueryParameter(name="format")]
# The playback brings its scripts with it; it is shut off from the service it came from.
PLAYBACK_POLICY = (
    "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval' blob:; "
    "style-src 'unsafe-inline'; img-src data: blob:; font-src data:; connect-src data: blob:; worker-src blob:"
)
FIGURE_POLICY = "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:"  # SVG carries its own styles


async def result_file(service: Service, kind: str, key: str, name: str, task: str = "export", **arguments: Any) -> Path:
    """The file of that name beside a job's result, made by a task if it is not there.

    Raises Refusal unless the job is done.
    """
    await service.jobs.require_done(kind, key)
    path = service.store.result_folder(key) / name
    with _removed_meanwhile(service, kind, key):
        await service.make(path, task, **arguments)
    await service.store.run(service.store.measure, key)
    return path


async def _shown(
    service: Service, kind: str, key: str, name: str, policy: str, *task: str, **arguments: Any
) -> Response[bytes]:
    """Such a file as a document with a policy of its own."""
    path = await result_file(service, kind, key, name, *task, **arguments)
    with _removed_meanwhile(service, kind, key):
        content = await asyncio.to_thread(path.read_bytes)
    return Response(content, media_type=MEDIA[path.suffix[1:]], headers={"Content-Security-Policy": policy})


@contextlib.contextmanager
def _removed_meanwhile(service: Service, kind: str, key: str) -> Iterator[None]:
    """Turn the failure to read a file into that of a job that was removed (404)."""
    try:
        yield
    except (FileNotFoundError, TwolinkError) as error:
        if getattr(error, "code", "not-readable") != "not-readable":
            raise
        raise service.jobs.removed(kind, key) from None


def _samples(path: Path, points: int) -> bytes:
    """A simulation's samples as {"columns": {name: [numbers]}}, thinned to at most so many points, ends included."""
    columns, _ = read_table(path)
    kept = thinned(columns, points)
    content = {name: values.tolist() for name, values in kept.items()}
    return msgspec.json.encode({"samples": len(columns["t"]), "points": len(kept["t"]), "columns": content})


def _shared(path: str, kind: str, summary: str) -> list[Any]:
    """The handlers that all kinds of jobs have."""
    tags = [path]

    @post(f"/v1/{path}", tags=tags, summary=summary, status_code=200)
    async def begin(request: Asked, service: Shared) -> Response[dict[str, Any]]:
        """200 with the job and its result when it is done within `wait` seconds, else 202 with the job.

        The same request is answered from the store.
        """
        asked = await service.prepare(kind, await request.body())
        view = await service.jobs.submit(kind, asked)
        status = 202 if view["state"] in ACTIVE else 200
        return Response(view, status_code=status, headers={"Location": f"/v1/{path}/{view['id']}"})

    @get(f"/v1/{path}", tags=tags, summary=f"List {path}")
    async def list_jobs(
        service: Shared, limit: Limit = LISTED, before: FromQuery[float | None] = None
    ) -> list[dict[str, Any]]:
        """The newest jobs without their results, and without requests of more than 16 kB.

        At most `limit` jobs, those `created` before the time `before`: the last one's `created` asks for the next page.
        """
        return await service.jobs.all(kind, math.inf if before is None else before, limit)

    @get(f"/v1/{path}/{{job:str}}", tags=tags, summary=f"A {kind}'s state and result")
    async def show_job(service: Shared, job: FromPath[str]) -> dict[str, Any]:
        """state: queued, running, done, failed, cancelled or interrupted."""
        return await service.jobs.view(kind, job)

    @get(f"/v1/{path}/{{job:str}}/events", tags=tags, summary=f"A {kind}'s progress as server-sent events")
    async def events(service: Shared, job: FromPath[str]) -> Stream:
        """Events `progress` and at last `end`, each with the job as JSON, without request and result."""
        await service.jobs.view(kind, job)
        headers = {"Cache-Control": "no-store"}
        return Stream(service.jobs.events(kind, job), media_type="text/event-stream", headers=headers)

    @post(f"/v1/{path}/{{job:str}}/cancel", tags=tags, summary=f"Cancel a {kind}", status_code=202)
    async def cancel(service: Shared, job: FromPath[str]) -> dict[str, Any]:
        """End a job that waits or runs. A job that has ended does not change."""
        return await service.jobs.cancel(kind, job)

    @post(f"/v1/{path}/{{job:str}}/run", tags=tags, summary=f"Run a {kind} again", status_code=202)
    async def run_again(service: Shared, job: FromPath[str]) -> dict[str, Any]:
        """Run a job again that failed, was cancelled or was interrupted. Others do not change."""
        return await service.jobs.again(kind, job)

    @delete(f"/v1/{path}/{{job:str}}", tags=tags, summary=f"Delete a {kind} and its result", status_code=204)
    async def remove(service: Shared, job: FromPath[str]) -> None:
        """Delete a job; a running one is cancelled first."""
        await service.jobs.remove(kind, job)

    return [begin, list_jobs, show_job, events, cancel, run_again, remove]


def _results(path: str, kind: str) -> list[Any]:
    """The handlers of results, for simulations and for studies."""
    tags = [path]

    @get(f"/v1/{path}/{{job:str}}/figure", tags=tags, summary=f"A {kind}'s figure")
    async def figure(service: Shared, job: FromPath[str], form: FigureForm = "svg") -> Response[bytes]:
        """As `plot` draws it: q, v, energy and error bar over time; or seconds over error, by method."""
        return await _shown(service, kind, job, f"figure.{form}", FIGURE_POLICY)

    @get(f"/v1/{path}/{{job:str}}/result", tags=tags, summary=f"A {kind}'s result")
    async def result(
        service: Shared,
        job: FromPath[str],
        form: Annotated[Literal["json", "csv", "parquet", "npz"], QueryParameter(name="format")] = "json",
        points: Points = MAX_POINTS,
    ) -> Response[bytes] | File:
        """A simulation's samples: columns t, q.JOINT, v.JOINT, energy, error; JSON is thinned to at most `points`.

        A study: all of it as JSON, its rows in the other formats.
        """
        if form == "json" and kind == "simulation":
            await service.jobs.require_done(kind, job)
            with _removed_meanwhile(service, kind, job):
                content = await asyncio.to_thread(_samples, service.store.result_folder(job) / SAMPLES, points)
            return Response(content, media_type=MediaType.JSON)
        file = await result_file(service, kind, job, f"result.{form}")
        return File(file, filename=f"{job}.{form}", media_type=MEDIA[form])

    return [figure, result]


@get("/v1/simulations/{job:str}/motion", tags=["simulations"], summary="Where the links are over time")
async def motion(service: Shared, job: FromPath[str], frames: Frames = 600) -> Response[bytes]:
    """{"t": [s], "links": [name], "poses": [[[x, y, z, qx, qy, qz, qw], ...a link], ...a frame]}.

    With "centre_of_mass": [[x, y, z], ...a frame], "direction": from a motion in a plane to the camera, else null, and
    "contacts": [{"pair", "points" [m], "forces" [N]}], three numbers a frame, NaN where the pair is apart. Between the
    run's samples the motion is a cubic by their velocities; it is a straight line across events, and all along where
    contacts are stepped, nothing is verified, or the run is another simulator's.
    """
    await service.jobs.require_done("simulation", job)
    return await service.answer("motion", folder=str(service.store.result_folder(job)), frames=frames)


@get("/v1/simulations/{job:str}/playback", tags=["simulations"], summary="A page that plays the motion")
async def playback(service: Shared, job: FromPath[str]) -> Response[bytes]:
    """One HTML file that needs no network."""
    return await _shown(service, "simulation", job, "playback.html", PLAYBACK_POLICY)


_TAGS = ["sweeps"]
_TASK = "export_sweep"


@get("/v1/sweeps/{job:str}/result", tags=_TAGS, summary="A sweep's results")
async def result(
    service: Shared,
    job: FromPath[str],
    form: Annotated[Literal["json", "csv", "parquet", "zip"], QueryParameter(name="format")] = "json",
    variable: FromQuery[list[str] | None] = None,
) -> Response[bytes] | File:
    """JSON, also of a sweep that is not done: dims, shape, what varied, and columns in C order; NaN is null.

    `variable`, repeatable, chooses columns: end.q.JOINT, end.v.JOINT, error, status (a place in `statuses`), reason,
    and others by what was asked for. csv and parquet: a row a run. zip: the store, for Zarr's ZipStore.
    """
    if form == "json":
        await service.jobs.bring(await service.jobs.job("sweep", job, whole=False))
        folder = str(service.store.result_folder(job))
        return await service.answer("sweep_columns", folder=folder, names=variable or [])
    file = await result_file(service, "sweep", job, f"result.{form}", _TASK, variable="", turns=False)
    return File(file, filename=f"{job}.{'zarr.zip' if form == 'zip' else form}", media_type=MEDIA[form])


@get("/v1/sweeps/{job:str}/figure", tags=_TAGS, summary="A sweep's figure")
async def figure(
    service: Shared, job: FromPath[str], form: FigureForm = "svg", variable: FromQuery[str] = "",
    turns: FromQuery[bool] = False,
) -> Response[bytes]:  # fmt: skip
    """A column over one quantity, as a curve with error bars, or over two, as a heat map.

    turns: draw whole turns of an angle, and leave out those that the error bar does not decide.
    """
    name = f"{hashlib.sha256(f'{turns} {variable}'.encode()).hexdigest()[:16]}.{form}"
    return await _shown(service, "sweep", job, name, FIGURE_POLICY, _TASK, variable=variable, turns=turns)


@get("/v1/sweeps/{job:str}/runs/{number:int}", tags=_TAGS, summary="One run of a sweep")
async def run(
    service: Shared, job: FromPath[str], number: Annotated[int, PathParameter(ge=0, le=10**9)]
) -> Response[bytes]:
    """{"run", "values", "simulation"}: what varied in this run, and the body by which /v1/simulations computes it.

    number: the run's place in the columns of the result.
    """
    return await service.answer("sweep_run", body=await service.jobs.request("sweep", job), number=number)


OF_KINDS = [*_results("simulations", "simulation"), *_results("studies", "study")]
for _kind, _about in JOB_KINDS.items():
    OF_KINDS += _shared(_about.path, _kind, _about.summary)
