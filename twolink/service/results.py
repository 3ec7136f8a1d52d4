"""Results of jobs in other formats, made on demand by a worker process and kept beside the result."""

import asyncio
import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from twolink.errors import TwolinkError
from twolink.io.tables import read_table
from twolink.service.components import Service
from twolink.service.scene_tasks import SAMPLES

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


async def result_file(service: Service, kind: str, key: str, name: str, task: str = "export", **arguments: Any) -> Path:
    """The file of that name beside a job's result, made by a task if it is not there.

    Raises Refusal unless the job is done.
    """
    await service.jobs.require_done(kind, key)
    path = service.store.result_folder(key) / name
    with _removed_meanwhile(service, kind, key):
        await service.make(path, task, **arguments)
    await service.store.run(service.store.measure, key, service.settings.quotas.disk_mb * 2**20)
    return path


async def result_bytes(service: Service, kind: str, key: str, name: str, *task: str, **arguments: Any) -> bytes:
    """The content of such a file. Raises Refusal unless the job is done."""
    path = await result_file(service, kind, key, name, *task, **arguments)
    with _removed_meanwhile(service, kind, key):
        return await asyncio.to_thread(path.read_bytes)


async def samples_json(service: Service, key: str, points: int) -> bytes:
    """A simulation's samples as {"columns": {name: [numbers]}}, thinned to at most so many points, ends included."""
    await service.jobs.require_done("simulation", key)
    with _removed_meanwhile(service, "simulation", key):
        return await asyncio.to_thread(_samples, service.store.result_folder(key) / SAMPLES, points)


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
    columns, _ = read_table(path)
    count = len(columns["t"])
    kept = np.unique(np.linspace(0, count - 1, min(points, count)).round().astype(int))
    thinned = {name: values[kept].tolist() for name, values in columns.items() if values.ndim == 1}
    return msgspec.json.encode({"samples": count, "points": len(kept), "columns": thinned})
