"""A run of a sweep that ends its worker process: it is given up after three tries, and the others are done."""

import asyncio
import json
import shutil
from pathlib import Path
from typing import Any

import pytest

import twolink as tl
from tests.parts.service import poison_tasks
from tests.parts.service.test_store import jobs_of, opened
from tests.parts.service.working import working
from twolink.errors import TwolinkError
from twolink.parts.service.problems import Refusal
from twolink.parts.service.settings import Quotas
from twolink.parts.service.store.data_folder import PARTS
from twolink.parts.service.work.requests import prepare
from twolink.parts.service.work.sharing import NO_TASK, SweepThreads
from twolink.parts.service.work.sweep_tasks import STORE, sweep_columns
from twolink.parts.sweeps import engines, runs
from twolink.parts.sweeps.sweeping import open_sweep

pytest.importorskip("zarr")
ELBOWS = [0.1, poison_tasks.POISON, 0.7]


@pytest.mark.slow
@pytest.mark.anyio
async def test_the_service_gives_a_run_up_that_ends_its_workers(tmp_path: Path) -> None:
    deaths: list[int] = []
    more = {"on_death": lambda: deaths.append(1), "writable": [tmp_path / part for part in PARTS]}
    body = {"scene": "arm-swing", "duration": 0.01, "vary": {"q.elbow": ELBOWS}}
    with opened(tmp_path) as store:
        async with working(tasks=poison_tasks.__name__, **more) as workers:
            jobs = jobs_of(store, workers.run)
            key = (await jobs.submit("sweep", prepare(kind="sweep", body=json.dumps(body).encode())))["id"]
            while (job := await jobs.view("sweep", key))["state"] in ("queued", "running"):
                await asyncio.sleep(0.1)
            await jobs.close()
    assert job["state"] == "done"
    assert json.loads(bytes(job["result"]))["abandoned"] == 1
    folder = str(next((tmp_path / "results").iterdir()))
    columns = json.loads(sweep_columns(folder=folder, names=["status"], quotas=Quotas()))["columns"]
    assert columns["status"]["values"] == [1, 4, 1]
    assert len(deaths) == 5  # three of all runs together, one of two, one of the run itself


class Death(TwolinkError):
    """In place of the process."""


def test_the_next_process_knows_of_what_the_last_one_died(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def compute(task: Any) -> Any:
        if poison_tasks.POISON in task.values["q.elbow"]:
            shutil.copy(tmp_path / "deaths.json", tmp_path / "at death")
            raise Death("a crash")
        return runs.compute(task)

    monkeypatch.setattr(engines, "compute", compute)
    scene, out, deaths = tl.load_scene("arm-swing"), tmp_path / STORE, 0
    while True:
        try:
            with SweepThreads(tmp_path, died=deaths > 0) as threads:
                tl.sweep(scene, vary={"q.elbow": ELBOWS}, out=out, duration=0.01, executor=threads)
            break
        except Death:
            deaths += 1
            (tmp_path / "at death").replace(tmp_path / "deaths.json")
    data = open_sweep(out)
    assert deaths == 5
    assert data.status.values.tolist() == [1, 4, 1]
    assert "given up after 3 tries: WorkerDied" in str(data.reason.values[1])
    with pytest.raises(Refusal) as caught:  # what died between the runs is tried no further
        SweepThreads(tmp_path, died=True)
    assert caught.value.code == NO_TASK
