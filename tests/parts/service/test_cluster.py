"""Sweeps of the service on a Dask cluster: same bits, and a lost scheduler is a problem after which they go on."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.parts.service.serving import TOP, serving
from tests.parts.service.test_jobs import ended
from tests.parts.service.test_sweeps import begun, marks
from tests.parts.service.urdfs import pendulum

pytest.importorskip("distributed")
CLUSTER = """
import sys
from distributed import LocalCluster
if __name__ == "__main__":
    cluster = LocalCluster(n_workers=1, threads_per_worker=1, processes=False, protocol="tcp", dashboard_address=None,
                           scheduler_port=int(sys.argv[1]))
    print(cluster.scheduler_address, flush=True)
    sys.stdin.read()
"""


@contextlib.contextmanager
def cluster(port: int = 0) -> Iterator[str]:
    """A Dask cluster of one worker, by its address. It is killed at the end."""
    environment = {**os.environ, "PYTHONPATH": str(TOP)}
    command = [sys.executable, "-c", CLUSTER, str(port)]
    with subprocess.Popen(command, cwd=TOP, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                          stderr=subprocess.DEVNULL, text=True, start_new_session=True) as process:  # fmt: skip
        assert process.stdout is not None
        try:
            yield process.stdout.readline().strip()
        finally:
            os.killpg(process.pid, signal.SIGKILL)


@pytest.mark.slow
def test_sweeps_are_sent_to_a_cluster_and_go_on_after_it_was_lost(tmp_path: Path) -> None:
    first = contextlib.ExitStack()
    address = first.enter_context(cluster())
    with first, serving(tmp_path / "data", "--dask", address) as served, served.client() as http:
        scene = tl.Scene(tl.load_robot(pendulum()), q=[0.4], effects=[tl.effects.Gravity()], duration=0.5)
        vary = {"q.hinge": [0.1, 0.2, 0.3]}
        there = tl.connect(served.url).sweep(scene, vary=vary, out=tmp_path / "there.zarr")
        here = tl.sweep(scene, vary=vary, out=tmp_path / "here.zarr", executor=ThreadPoolExecutor(1))
        for name in ("q", "v", "error", "status"):
            assert np.array_equal(there[name], here[name]), name
        path = begun(http)
        first.close()
        lost = ended(http, path)
        assert (lost["state"], lost["problem"]["code"]) == ("failed", "cluster-lost")
        assert f"{address} cannot be reached" in served.log
        assert "Traceback" not in served.log
        before = marks(tmp_path / "data")
        assert before
        with cluster(int(address.rpartition(":")[2])):
            http.post(f"{path}/run")
            job = ended(http, path)
        assert (job["state"], job["result"]["done"]) == ("done", 6400)
        after = marks(tmp_path / "data")
        assert {file: after[file] for file in before} == before
        assert len(after) > len(before)
