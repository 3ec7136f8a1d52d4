"""Tasks of worker processes about sweeps: run them, read what is there, and write it in other formats."""

import asyncio
import math
import os
import sys
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from twolink.errors import SceneError, TwolinkError
from twolink.parts.service.problems import Refusal, encode, kept
from twolink.parts.service.settings import Quotas
from twolink.parts.service.store.archives import write_robot
from twolink.parts.service.store.data_folder import size_of
from twolink.parts.service.work.requests import job_request
from twolink.parts.service.work.scene_tasks import allowed, samples_of, scene_of, told
from twolink.parts.service.work.sharing import SweepThreads
from twolink.parts.service.work.worker import Report
from twolink.parts.sweeps.design import make_design, planned_runs
from twolink.parts.sweeps.outputs import STATUS
from twolink.parts.sweeps.results import column, column_names, plot_sweep, run_dims, sweep_status, write_sweep_table
from twolink.parts.sweeps.runs import run_scene
from twolink.parts.sweeps.sweeping import open_sweep
from twolink.parts.sweeps.sweeping import sweep as run_sweep
from twolink.robots.catalogue import catalogue_names
from twolink.scenes.file import bundled_content, scene_tables
from twolink.scenes.file_format import RobotEntry, scene_content

STORE = "sweep.zarr"  # in the folder of the job
_NUMBER_BYTES = 20  # of a number as JSON
_VARIABLE_BYTES = 8  # of a number in the store, at most


class _End:
    """An end of a pipe, with what asyncio asks of the sockets by which it wakes its loop."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        os.set_blocking(descriptor, False)

    def fileno(self) -> int:
        return self._descriptor

    def recv(self, size: int) -> bytes:
        return os.read(self._descriptor, size)

    def send(self, content: bytes) -> int:
        return os.write(self._descriptor, content)

    def close(self) -> None:
        os.close(self._descriptor)


class _PipeLoop(asyncio.SelectorEventLoop):
    def _make_self_pipe(self) -> None:
        self._ssock, self._csock = map(_End, os.pipe())
        self._internal_fds += 1  # type: ignore[attr-defined]
        self._add_reader(self._ssock.fileno(), self._read_from_self)  # type: ignore[attr-defined]


class _Policy(asyncio.DefaultEventLoopPolicy):
    def new_event_loop(self) -> asyncio.AbstractEventLoop:
        return _PipeLoop()


def use_pipes() -> None:
    """Have new event loops of this process use pipes in place of sockets, where there are pipes."""
    if sys.platform != "win32":
        asyncio.set_event_loop_policy(_Policy())


def pack_robot(*, body: bytes, robots: str) -> bytes:
    """The robot of a sweep, for `sweep` in a process that may use the network, and shall not read what was uploaded.

    body: the sweep's request. Empty for a bundled scene.
    """
    scene = job_request("sweep", body).scene
    return b"" if isinstance(scene, str) else write_robot(scene_of(scene, robots).base)


def sweep(
    *, body: bytes, robots: str, quotas: Quotas, folder: str, report: Report, robot: bytes = b"", cluster: str = "",
    died: bool = False,
) -> dict[str, Any]:  # fmt: skip
    """Run a sweep into the store in `folder`, or go on with it, and return its record.

    body: a request for a sweep. cluster: the address of a Dask scheduler; empty: runs are computed in this process.
    died: the process before this one died of it.
    """
    use_pipes()
    given = _allowed(job_request("sweep", body), robots, robot, quotas)
    path = Path(folder) / STORE
    with SweepThreads(Path(folder), died=died) as threads:
        try:
            data = run_sweep(**given, out=path, executor=cluster or threads, progress=told(report))
        except TwolinkError as error:
            if error.code == "cluster-lost":
                raise Refusal(503, "the cluster cannot be reached", code=error.code, where="service", retry_after=30,
                              remedy="run it again when it is back: what is done is kept") from None  # fmt: skip
            raise error.at("request") if folder in error.where else error from None
    if size_of(path) > quotas.result_mb * 2**20:
        raise _too_large(quotas)
    status, (dims, shape) = sweep_status(path).to_dict(), _dims(data)
    return {"title": given["scene"].title, "how": data.attrs["how"], "runs": status["total"], "dims": dims,
            "shape": shape, "columns": column_names(data), **{name: status[name] for name in STATUS[1:]}}  # fmt: skip


def _allowed(request: Any, robots: str, robot: bytes, quotas: Quotas) -> dict[str, Any]:
    """The arguments of the call, as `allowed`. Raises SceneError for what is too large, or is not read here."""
    runs = planned_runs(request.vary, request.design, request.count)
    if runs > quotas.runs:
        asked = f"{runs:,}" if runs < 1e18 else "more than 10^18"
        raise SceneError(f"{asked} runs are too many, the service takes up to {quotas.runs:,}", argument="vary",
                         code="too-large", remedy="ask for fewer values")  # fmt: skip
    named = request.vary.get("robot")
    for one in named if isinstance(named, list) else ():
        if one not in catalogue_names():  # a path would be read
            raise SceneError(f"{str(one)[:80]!r} is not in the catalogue", argument="vary", where="vary['robot']",
                             remedy="GET /v1/robots lists the names")  # fmt: skip
    given = allowed(request, robots, quotas, robot=robot)
    size = given["scene"].robot.nq + given["scene"].robot.nv
    numbers = 4 + size * (1 + samples_of(request, given["duration"]))
    if runs * numbers * _VARIABLE_BYTES > quotas.result_mb * 2**20:
        raise _too_large(quotas)
    return given


def _too_large(quotas: Quotas) -> SceneError:
    return SceneError(f"the results take more than {quotas.result_mb:g} MB", argument="vary", code="too-large",
                      remedy="ask for fewer runs, samples or outputs")  # fmt: skip


def _dims(data: Any) -> tuple[tuple[str, ...], tuple[int, ...]]:
    dims = run_dims(data)
    return dims, tuple(data.sizes[name] for name in dims)


def sweep_columns(*, folder: str, names: Sequence[str], quotas: Quotas) -> bytes:
    """Columns of a sweep, finished or not, as JSON. names: of them; none: all."""
    data = _opened(folder)
    dims, shape = _dims(data)
    chosen = list(names) or column_names(data)
    if math.prod(shape) * len(chosen) * _NUMBER_BYTES > quotas.answer_mb * 2**20:
        what = f"{len(chosen)} columns of {math.prod(shape):,} runs take more than {quotas.answer_mb:g} MB"
        raise Refusal(413, what, where="query: variable", remedy="ask for fewer columns, or for Parquet")
    varied = {str(name): _column(data[name]) for name in data.coords if set(data[name].dims) <= set(dims)}
    content = {"dims": dims, "shape": shape, "varied": varied, "statuses": STATUS,
               "columns": {name: _column(column(data, name)) for name in chosen}}  # fmt: skip
    return encode(content)


def _column(array: Any) -> dict[str, Any]:
    return {"units": array.attrs.get("units", ""), "long_name": array.attrs.get("long_name", ""),
            "values": array.values.ravel().tolist()}  # fmt: skip


def _opened(folder: str) -> Any:
    use_pipes()
    path = Path(folder) / STORE
    if not path.exists():
        raise Refusal(409, "no run is done yet", where="path: id", remedy="ask again in some seconds")
    with kept("the sweep", "delete it, and ask for it again"):
        return open_sweep(path)


def sweep_run(*, body: bytes, robots: str, number: int, quotas: Quotas) -> bytes:
    """The request to /v1/simulations that shows one run, as JSON. body: the sweep's request. Raises as `sweep`."""
    request = job_request("sweep", body)
    given = _allowed(request, robots, b"", quotas)
    scene, duration = given["scene"], given["duration"]
    design = make_design(scene, request.vary, request.design, request.count, request.seed)
    own, accuracy, values = run_scene(scene, design, request.accuracy, duration, number)
    tables = scene_tables(bundled_content(request.scene)) if isinstance(request.scene, str) else request.scene
    robot = RobotEntry(values["robot"]) if "robot" in values else tables.robot
    entry = RobotEntry(robot) if isinstance(robot, str) else robot
    content = scene_content(entry, own.base, own.q, own.v, own.effects, duration, scene.title, tables.objects)
    asked = {"scene": content, "duration": duration, "accuracy": accuracy, "verify": request.verify}
    return encode({"run": number, "values": values, "simulation": asked})


def export_sweep(*, path: str, variable: str, turns: bool) -> None:
    """Write a sweep in another format, beside it: a table, a zip of the store, or a figure, by the path's ending."""
    target = Path(path)
    data = _opened(str(target.parent))
    if target.suffix in (".svg", ".png"):
        plot_sweep(data, target, variable, turns=turns)
    elif target.suffix == ".zip":
        _zip(target.with_name(STORE), target)
    else:
        write_sweep_table(data, target)


def _zip(store: Path, target: Path) -> None:
    """The store as Zarr's ZipStore reads it. Its chunks are compressed already."""
    with zipfile.ZipFile(target, "w", zipfile.ZIP_STORED) as archive:
        for file in sorted(store.rglob("*")):
            if file.is_file() and file.suffix != ".partial":
                archive.write(file, file.relative_to(store).as_posix())


# Worker processes that send sweeps to a Dask cluster have this task only, and may use the network.
NETWORK = True
TASKS = {"sweep": sweep}
