"""Results of jobs in other formats, made on demand by a worker process and kept beside the result."""

from __future__ import annotations

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
MOST_POINTS = 20_000


async def result_file(service: Service, kind: str, key: str, name: str) -> Path:
    """The file of that name beside a job's result, made if it is not there. Raises Refusal unless the job is done."""
    request = service.jobs.request(kind, key)
    folder = service.store.result_folder(key)
    await _made(service, key, folder / name, "export", kind=kind, request=request, folder=str(folder), name=name)
    return folder / name


async def motion_file(service: Service, key: str, frames: int) -> Path:
    """Where the links are in `frames` pictures of a simulation, as a JSON file."""
    request = service.jobs.request("simulation", key)
    folder, name = service.store.result_folder(key), f"motion-{frames}.json"
    await _made(service, key, folder / name, "motion", request=request, folder=str(folder), name=name, frames=frames)
    return folder / name


async def _made(service: Service, key: str, path: Path, task: str, **arguments: Any) -> None:
    async with service.once(str(path)):
        if not path.exists():
            await service.read(task, patience=3.0, **arguments)
            service.store.measure(key)


async def samples_json(service: Service, key: str, points: int) -> bytes:
    """A simulation's samples as {"columns": {name: [numbers]}}, thinned to at most so many points, ends included."""
    service.jobs.request("simulation", key)
    return await asyncio.to_thread(_samples, service.store.result_folder(key) / SAMPLES, points)


def _samples(path: Path, points: int) -> bytes:
    columns, _ = read_table(path)
    count = len(columns["t"])
    kept = np.unique(np.linspace(0, count - 1, min(points, count)).round().astype(int))
    thinned = {name: values[kept].tolist() for name, values in columns.items()}
    return msgspec.json.encode({"samples": count, "points": len(kept), "columns": thinned})
