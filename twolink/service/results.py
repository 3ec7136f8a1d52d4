"""Results of jobs in other formats, made on demand by a worker process and kept beside the result."""

import asyncio
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

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
}
MAX_POINTS = 20_000


async def result_file(service: Service, kind: str, key: str, name: str, task: str = "export", **arguments: Any) -> Path:
    """The file of that name beside a job's result, made by the task if it is not there.

    Raises Refusal unless the job is done.
    """
    service.jobs.require_done(kind, key)
    path = service.store.result_folder(key) / name
    await service.make(path, task, **arguments)
    service.store.measure(key)
    return path


async def samples_json(service: Service, key: str, points: int) -> bytes:
    """A simulation's samples as {"columns": {name: [numbers]}}, thinned to at most so many points, ends included."""
    service.jobs.require_done("simulation", key)
    return await asyncio.to_thread(_samples, service.store.result_folder(key) / SAMPLES, points)


def _samples(path: Path, points: int) -> bytes:
    columns, _ = read_table(path)
    count = len(columns["t"])
    kept = np.unique(np.linspace(0, count - 1, min(points, count)).round().astype(int))
    thinned = {name: values[kept].tolist() for name, values in columns.items()}
    return msgspec.json.encode({"samples": count, "points": len(kept), "columns": thinned})
