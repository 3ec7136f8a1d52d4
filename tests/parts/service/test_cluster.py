"""Sweeps of the service on a Dask cluster: same bits, and a lost scheduler is a problem after which they go on."""

import contextlib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.parts.service.serving import serving
from tests.parts.service.test_jobs import ended
from tests.parts.service.test_sweeps import begun, marks
from tests.parts.service.urdfs import pendulum
from tests.parts.sweeps.dask_cluster import dask_cluster

pytest.importorskip("distributed")
ONE = "n_workers=1, processes=False, protocol='tcp', scheduler_port={}"


@pytest.mark.slow
def test_sweeps_are_sent_to_a_cluster_and_go_on_after_it_was_lost(tmp_path: Path) -> None:
    first = contextlib.ExitStack()
    _, address = first.enter_context(dask_cluster(tmp_path, ONE.format(0)))
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
        with dask_cluster(tmp_path, ONE.format(address.rpartition(":")[2])):
            http.post(f"{path}/run")
            job = ended(http, path)
        assert (job["state"], job["result"]["done"]) == ("done", 6400)
        after = marks(tmp_path / "data")
        assert {file: after[file] for file in before} == before
        assert len(after) > len(before)
