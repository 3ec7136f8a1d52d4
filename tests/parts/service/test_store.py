"""The data folder: only what the service wrote is deleted, quotas count all of it, and failures of the disk pass."""

import contextlib
import errno
import math
import sqlite3
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import msgspec
import pytest

from twolink.errors import TwolinkError
from twolink.parts.service.problems import problem_of
from twolink.parts.service.settings import Quotas, Settings
from twolink.parts.service.store.data_folder import DATABASE
from twolink.parts.service.store.store import Store
from twolink.parts.service.work.jobs import Jobs
from twolink.parts.service.work.metrics import Metrics
from twolink.parts.service.work.requests import prepare
from twolink.parts.service.work.sharing import Budget

KEYS = [f"simulation-{k:020x}" for k in range(4)]
ROBOT = "u-00000000000000000000"


def opened(folder: Path, **quotas: float) -> contextlib.closing[Store]:
    return contextlib.closing(Store(folder, Quotas(**quotas)))


def jobs_of(store: Store, run: Any, **quotas: float) -> Jobs:
    """Jobs that `run` computes, in place of worker processes."""
    settings = Settings(str(store.folder), quotas=Quotas(**quotas))
    return Jobs(settings, store, SimpleNamespace(run=run), Metrics(), Budget(store, math.inf))


def add_done(store: Store, key: str, size: int = 1000, request: Any = None, owner: str = "") -> None:
    store.new_job(key, "simulation", msgspec.json.encode(request or {"scene": "arm-swing"}), owner)
    (store.begin_job(key)[0] / "result.npz").write_bytes(bytes(size))
    store.end_job(key, state="done", ended=1.0, result={})


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("damage", [
    lambda path: path.write_bytes(b"no database at all" * 100),
    lambda path: path.write_bytes(path.read_bytes()[:4096] + bytes([255]) * (path.stat().st_size - 4096)),
    lambda path: path.write_bytes(path.read_bytes()[: path.stat().st_size // 2]),
])  # fmt: skip
def test_a_corrupt_database_is_set_aside_with_its_files(
    damage: Callable[[Path], int], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with opened(tmp_path) as store:
        for key in KEYS:
            add_done(store, key, request={"scene": "x" * 5000})
    damage(tmp_path / DATABASE)
    with opened(tmp_path) as store:
        assert store.jobs("simulation", math.inf, 10) == []
        add_done(store, KEYS[0])
    (kept,) = tmp_path.glob("set-aside-*")
    assert str(kept) in caplog.text
    assert {path.name for path in (kept / "results").iterdir()} == set(KEYS)
    assert (kept / DATABASE).exists()
    caplog.clear()
    with opened(tmp_path) as store:
        assert [job.id for job in store.jobs("simulation", math.inf, 10)] == [KEYS[0]]
    assert not caplog.text


@pytest.mark.parametrize("part", ["robots", "results", "visuals", "staging"])
def test_a_folder_of_somebody_else_is_refused_and_stays(part: str, tmp_path: Path) -> None:
    (tmp_path / part).mkdir()
    (tmp_path / part / "mine").write_text("precious")
    with pytest.raises(TwolinkError, match="not a data folder"):
        Store(tmp_path, Quotas())
    assert names(tmp_path) == {"mine"}


def test_a_start_deletes_what_a_killed_service_left_and_nothing_else(tmp_path: Path) -> None:
    with opened(tmp_path) as store:
        add_done(store, KEYS[0])
        add_done(store, KEYS[1])
    for part in ("robots", "results", "staging"):
        (tmp_path / part / "mine").mkdir()
        (tmp_path / part / "mine" / f"{part}.txt").write_text("precious")
    left = [tmp_path / "staging" / ROBOT, tmp_path / "robots" / ROBOT]
    left += [tmp_path / "results" / key for key in (KEYS[2], f"operation-{0:020x}")]
    for folder in left:
        folder.mkdir()
    (tmp_path / "results" / KEYS[1]).rename(tmp_path / "lost")
    with opened(tmp_path) as store:
        assert not any(folder.exists() for folder in left)
        assert [job.id for job in store.jobs("simulation", math.inf, 10)] == [KEYS[0]]
    assert {"robots.txt", "results.txt", "staging.txt", "result.npz"} <= names(tmp_path)


def test_requests_files_and_drawings_count_and_the_oldest_go_first(tmp_path: Path) -> None:
    with opened(tmp_path) as store:
        for key in KEYS[:3]:  # two bytes a letter
            store.new_job(key, "simulation", msgspec.json.encode({"scene": "é" * 50_000}))
            store.end_job(key, state="failed", ended=1.0)
        assert store.kept_bytes >= 300_000
        add_done(store, KEYS[3], 100_000)
        (store.result_folder(KEYS[3]) / "result.csv").write_bytes(bytes(70_000))
        store.visuals("panda.json").write_bytes(bytes(50_000))
    with opened(tmp_path, disk_mb=0.38, result_mb=0.38) as store:
        store.measure(KEYS[3])
        assert not store.visuals("panda.json").exists()
        assert [job.id for job in store.jobs("simulation", math.inf, 10)] == [KEYS[3], KEYS[2], KEYS[1]]
        assert store.shrink(0, keep=KEYS[3]) == 2
        assert 170_000 <= store.kept_bytes < 180_000


def test_an_owner_keeps_to_its_part_of_the_disk_with_exports_and_no_other_loses_by_it(tmp_path: Path) -> None:
    with opened(tmp_path, owner_disk_mb=0.1) as store:
        for key, owner in zip(KEYS, ("ann", "ann", "bob", ""), strict=True):
            add_done(store, key, 40_000, owner=owner)
        assert len(store.jobs("simulation", math.inf, 10)) == 4
        (store.result_folder(KEYS[1]) / "result.csv").write_bytes(bytes(40_000))
        store.measure(KEYS[1])
        assert {job.id for job in store.jobs("simulation", math.inf, 10)} == {*KEYS[1:]}


def test_a_disk_without_room_for_a_result_is_found(tmp_path: Path) -> None:
    with opened(tmp_path, disk_mb=1e9, result_mb=1e9) as store, pytest.raises(OSError, match="MB are free, a result"):
        store.check()


def test_lists_come_in_pages_without_large_requests(tmp_path: Path) -> None:
    with opened(tmp_path) as store:
        for key in KEYS:
            store.new_job(key, "simulation", b"x" * (100_000 if key == KEYS[1] else 10))
        first = store.jobs("simulation", math.inf, 3)
        assert [job.id for job in first] == KEYS[:0:-1]
        assert [job.id for job in store.jobs("simulation", first[-1].created, 3)] == KEYS[:1]
        assert [bytes(job.request) == b"null" for job in first] == [False, False, True]


def test_a_start_on_a_full_disk_is_refused_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with opened(tmp_path) as store:
        store.new_job(KEYS[0], "simulation", b"{}")
        store.begin_job(KEYS[0])
    with monkeypatch.context() as full:
        full.setattr(Store, "update_job", Mock(side_effect=sqlite3.OperationalError("database or disk is full")))
        with pytest.raises(TwolinkError, match="disk is full; check the folder and the disk"):
            Store(tmp_path, Quotas())
    with opened(tmp_path) as store:
        job = store.job(KEYS[0])
        assert job is not None
        assert (job.state, b"was killed" in bytes(job.problem)) == ("interrupted", True)


def set_limit(store: Store, pages: int) -> None:
    """Let the database grow to so many pages, as on a full disk."""
    store._execute(f"PRAGMA max_page_count = {pages}")


@pytest.mark.anyio
async def test_a_job_whose_end_finds_the_disk_full_is_stored_when_there_is_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("twolink.parts.service.work.jobs._RETRY", 0.01)
    request = prepare(kind="simulation", body=b'{"scene": "arm-swing", "wait": 0.3}')

    async def run(*_: Any, **__: Any) -> dict[str, Any]:
        set_limit(store, 1)  # SQLite takes the pages that there are
        return {"samples": "x" * 100_000}

    with opened(tmp_path) as store:
        jobs = jobs_of(store, run)
        view = await jobs.submit("simulation", request)
        assert view["state"] == "running"
        with pytest.raises(sqlite3.OperationalError) as caught:
            await jobs.submit("simulation", prepare(kind="simulation", body=b'{"scene": "%s"}' % (b"x" * 100_000)))
        problem = problem_of(caught.value)
        assert (problem.status, problem.code, problem.retry_after) == (503, "storage-failed", 30)
        set_limit(store, 10**6)
        assert (await jobs.submit("simulation", request))["state"] == "done"
        await jobs.close()
    assert "is full" in caplog.text


@pytest.mark.parametrize("error", [
    OSError(errno.ENOSPC, "No space left on device", "/secret/place"), sqlite3.OperationalError("disk I/O error"),
    TwolinkError("cannot be written: No space left on device", where="/secret/place", code="not-writable"),
])  # fmt: skip
def test_a_failing_disk_is_a_problem_of_the_service_without_its_paths(error: Exception) -> None:
    problem = problem_of(error)
    assert (problem.status, problem.code) == (503, "storage-failed")
    assert "secret" not in str(problem)


def test_only_sweeps_keep_the_files_of_what_is_not_done(tmp_path: Path) -> None:
    keys = {"sweep": "sweep-0", "simulation": KEYS[0]}
    with opened(tmp_path) as store:
        for state in ("queued", "cancelled", "failed", "interrupted"):
            for kind, key in keys.items():
                store.new_job(key, kind, b"{}")
                with (store.begin_job(key)[0] / "blocks").open("ab") as file:
                    file.write(bytes(1000))
                if state != "interrupted":
                    store.end_job(key, state=state)
    with opened(tmp_path) as store:  # the last ones were interrupted
        assert {job.state for job in map(store.job, keys.values()) if job} == {"interrupted"}
        assert [path.stat().st_size for path in tmp_path.rglob("blocks")] == [4000]
        assert store.result_folder("sweep-0").exists()
        assert store.job("sweep-0").bytes > 4000
        store.remove_job("sweep-0")
    assert not list(tmp_path.rglob("blocks"))
