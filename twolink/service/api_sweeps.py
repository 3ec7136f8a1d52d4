"""/v1/sweeps: the results of sweeps; how they are begun, watched and ended is in `api_jobs`."""

import hashlib
from typing import Annotated, Literal

from litestar import MediaType, Response, get
from litestar.params import FromPath, FromQuery, QueryParameter
from litestar.response import File

from twolink.service.api_jobs import FIGURE_POLICY
from twolink.service.components import Shared
from twolink.service.results import MEDIA, result_bytes, result_file

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
        await service.jobs.view("sweep", job)
        folder, quotas = str(service.store.result_folder(job)), service.settings.quotas
        content = await service.read("sweep_columns", folder=folder, names=variable or [], quotas=quotas)
        return Response(content, media_type=MediaType.JSON)
    file = await result_file(service, "sweep", job, f"result.{form}", _TASK, variable="", turns=False)
    return File(file, filename=f"{job}.{'zarr.zip' if form == 'zip' else form}", media_type=MEDIA[form])


@get("/v1/sweeps/{job:str}/figure", tags=_TAGS, summary="A sweep's figure")
async def figure(
    service: Shared,
    job: FromPath[str],
    form: Annotated[Literal["svg", "png"], QueryParameter(name="format")] = "svg",
    variable: FromQuery[str] = "",
    turns: FromQuery[bool] = False,
) -> Response[bytes]:
    """A column over one quantity, as a curve with error bars, or over two, as a heat map.

    turns: draw whole turns of an angle, and leave out those that the error bar does not decide.
    """
    name = hashlib.sha256(f"{turns} {variable}".encode()).hexdigest()[:16]
    content = await result_bytes(service, "sweep", job, f"{name}.{form}", _TASK, variable=variable, turns=turns)
    return Response(content, media_type=MEDIA[form], headers={"Content-Security-Policy": FIGURE_POLICY})


@get("/v1/sweeps/{job:str}/runs/{number:int}", tags=_TAGS, summary="One run of a sweep")
async def run(service: Shared, job: FromPath[str], number: FromPath[int]) -> Response[bytes]:
    """{"run", "values", "simulation"}: what varied in this run, and the body by which /v1/simulations computes it.

    number: the run's place in the columns of the result.
    """
    body = await service.jobs.request("sweep", job)
    return Response(await service.read("sweep_run", body=body, number=number), media_type=MediaType.JSON)


HANDLERS = [result, figure, run]
