"""What stops a sweep: nothing finished is lost, nothing wrong is stored, and only the rest is computed again."""

import errno
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.parts.service.serving import wait_until
from tests.parts.sweeps.dask_cluster import TOP, dask_cluster
from tests.refusals import refusal
from twolink.errors import TwolinkError
from twolink.sweeps import open_sweep

pytest.importorskip("zarr")
ARM = tl.load_scene("arm-swing")
ELBOWS = [float(i) for i in range(8)]
FUNCTIONS = "tests.parts.sweeps.run_functions"
CLIENT = """
import sys, twolink as tl
tl.sweep(tl.load_scene("arm-swing"), 0.01, vary={{"q.elbow": {elbows}}}, out={out!r}, chunk=1, workers=2,
         outputs=["final", "{functions}:slow_start"], executor={executor!r})
"""


def swept(out: Path, function: str, **options):
    options = {"duration": 0.01, "chunk": 1, "workers": 2, **options}
    return tl.sweep(ARM, vary={"q.elbow": ELBOWS}, out=out, outputs=["final", f"{FUNCTIONS}:{function}"], **options)


@pytest.fixture
def log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[], list[float]]:
    """The runs that were computed so far, by the elbow's start."""
    path = tmp_path / "log"
    path.touch()
    monkeypatch.setenv("TWOLINK_TEST_LOG", str(path))
    return lambda: [float(line) for line in path.read_text().split()]


def at_the_second(act: Callable[[], object]) -> Callable[..., object]:
    """A report of progress that acts when it is called for the second time."""
    calls = iter([None, act])
    return lambda *_: (next(calls, None) or (lambda: None))()


def finished(out: Path) -> list[Path]:
    return [path for path in (out / "status" / "c").glob("*") if path.name.isdigit()]  # not one that is being written


def check_right(out: Path) -> np.ndarray:
    """What is marked as done is right. Returns what is done."""
    data = open_sweep(out)
    done = data.status.values == 1
    name = next(name for name in data.data_vars if name in ("start", "slow_start", "kills_once", "kills"))
    assert np.array_equal(data[name].values[done], np.array(ELBOWS)[done])
    assert np.isfinite(data.q.values[done]).all()
    return done


def client(out: Path, executor: str | None = None) -> subprocess.Popen[str]:
    code = CLIENT.format(elbows=ELBOWS, out=str(out), functions=FUNCTIONS, executor=executor)
    return subprocess.Popen([sys.executable, "-c", code], cwd=TOP, stderr=subprocess.PIPE, text=True)


def check_resumed(out: Path, log: Callable[[], list[float]], done: np.ndarray, function: str) -> None:
    """The rest, and only the rest, is computed."""
    before = len(log())
    swept(out, function, executor=ThreadPoolExecutor(1))
    assert sorted(log()[before:]) == [x for x, there in zip(ELBOWS, done, strict=True) if not there]
    assert check_right(out).all()


def children(pid: int) -> list[int]:
    return [int(text) for text in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


@pytest.mark.slow
def test_the_client_is_killed(tmp_path: Path, log: Callable[[], list[float]]) -> None:
    out = tmp_path / "x.zarr"
    with client(out) as process:
        wait_until(lambda: len(finished(out)) >= 2)
        workers = children(process.pid)
        process.kill()
    wait_until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in workers))
    time.sleep(0.2)
    done = check_right(out)
    assert 2 <= done.sum() < len(ELBOWS)
    check_resumed(out, log, done, "slow_start")


@pytest.mark.slow
def test_a_worker_is_killed_once(tmp_path: Path, log: Callable[[], list[float]]) -> None:
    swept(tmp_path / "x.zarr", "kills_once", chunk=3)
    assert check_right(tmp_path / "x.zarr").all()
    assert log().count(3.0) == 2


@pytest.mark.slow
@pytest.mark.parametrize(("function", "chunk"), [("kills", 1), ("lacks_memory", 4)])
def test_a_run_that_ends_its_workers_is_given_up_after_three_tries(
    function: str, chunk: int, tmp_path: Path, log: Callable[[], list[float]]
) -> None:
    data = swept(tmp_path / "x.zarr", function, workers=1, chunk=chunk)
    assert data.status.values.tolist() == [4 if elbow == 3.0 else 1 for elbow in ELBOWS]
    assert "given up after 3 tries" in str(data.reason.values[3])
    assert log().count(3.0) >= 3
    assert np.array_equal(data[function].values[:3], ELBOWS[:3])
    before = len(log())
    swept(tmp_path / "x.zarr", function, workers=1)
    assert len(log()) == before


@pytest.mark.parametrize("where", ["a file", "between data and mark"])
def test_the_disk_is_full(
    where: str, tmp_path: Path, log: Callable[[], list[float]], monkeypatch: pytest.MonkeyPatch
) -> None:
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)

    def full(*_: object) -> None:
        if where == "a file":
            resource.setrlimit(resource.RLIMIT_FSIZE, (8, limits[1]))
        else:
            monkeypatch.setattr(os, "fsync", no_room)

    def no_room(_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    out = tmp_path / "x.zarr"
    with ThreadPoolExecutor(1) as here:
        try:
            with pytest.raises(TwolinkError, match="what is done is kept") as caught:
                swept(out, "start", executor=here, progress=at_the_second(full))
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
            monkeypatch.undo()
    assert caught.value.code == "not-writable"
    monkeypatch.setenv("TWOLINK_TEST_LOG", str(tmp_path / "log"))
    done = check_right(out)
    assert done.sum() == 2
    check_resumed(out, log, done, "start")


@pytest.mark.slow
def test_a_cluster_replaces_its_workers_and_its_scheduler_is_killed(
    tmp_path: Path, log: Callable[[], list[float]]
) -> None:
    out = tmp_path / "z.zarr"
    with dask_cluster(tmp_path, "n_workers=2", TWOLINK_TEST_LOG=str(tmp_path / "log")) as (scheduler, address):
        data = swept(tmp_path / "x.zarr", "kills_once", executor=address)
        assert check_right(tmp_path / "x.zarr").all()
        other = swept(tmp_path / "y.zarr", "start", executor=ThreadPoolExecutor(1), chunk=3)
        assert np.array_equal(data.q, other.q)
        assert np.array_equal(data.error, other.error)
        with refusal(TwolinkError, code="cluster-lost", match="what is done is kept"):
            swept(out, "slow_start", executor=address, progress=at_the_second(scheduler.kill))
        done = check_right(out)
        assert 2 <= done.sum() < len(ELBOWS)
        time.sleep(0.5)  # until workers have ended what they had
    check_resumed(out, log, done, "slow_start")
