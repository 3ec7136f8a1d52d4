"""Sweeps as jobs: as of the library, watched, stopped, resumed, looked into, refused, and sent to a Dask cluster."""

import contextlib
import io
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import twolink as tl
from tests.parts.service.serving import Served, pendulum, serving
from tests.parts.service.test_jobs import ended, events
from tests.parts.sweeps.dask_cluster import dask_cluster
from twolink.errors import SceneError, TwolinkError

pytest.importorskip("zarr")
GRID = {"q.elbow": [-0.4, 0.1, 0.5], "forearm.mass": [1.0, -1.0]}
# Some seconds of computing, in 32 blocks.
LONG = {
    "scene": "arm-swing", "duration": 10.0,
    "vary": {"q.elbow": {"range": [-0.3, 0.3, 64]}, "forearm.mass": {"range": [1.0, 1.2, 100]}},
}  # fmt: skip


@pytest.fixture(scope="module")
def store(served: Served, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The results of a sweep by the service."""
    out = tmp_path_factory.mktemp("sweep") / "x.zarr"
    return tl.connect(served.url).sweep("arm-swing", vary=GRID, out=out, duration=1.0, outputs=["final", "cost"])


@pytest.fixture(scope="module")
def job(served: Served, store: Any) -> str:
    """Its path."""
    assert store is not None
    return next(f"/v1/sweeps/{job['id']}" for job in served.ask("/v1/sweeps") if job["state"] == "done")


def test_a_run_of_a_stepped_sweep_is_simulated_alone_as_in_the_sweep(http: Served) -> None:
    vary = {"v.domino_1.0": [0.0, 0.1]}
    path = http.begin({"scene": "dominoes", "duration": 0.05, "vary": vary}, "/v1/sweeps")
    assert ended(http, path)["result"]["done"] == 2
    columns = http.ask(f"{path}/result")["columns"]
    for number, end in enumerate(columns["end.q.domino_1.0"]["values"]):
        alone = http.ask(f"{path}/runs/{number}")["simulation"]
        run = ended(http, http.begin({**alone, "t_eval": [0, 0.05]}))
        assert run["result"]["q"][0] == end


def test_results_are_those_of_the_library(store: Any, tmp_path: Path) -> None:
    scene = tl.load_scene("arm-swing")
    here = tl.sweep(scene, vary=GRID, out=tmp_path / "x.zarr", duration=1.0, outputs=["final", "cost"],
                    executor=ThreadPoolExecutor(1))  # fmt: skip
    there = store.transpose(*here.q.dims[:-1], ...)
    for name in ("status", "reason"):
        assert np.array_equal(there[name], here[name]), name
    done = np.isfinite(here.error.values)
    assert np.array_equal(np.isfinite(there.error.values), done)
    # Each of the two takes compiled steps when they are ready: the numbers agree within their bars, not to the bit.
    apart = np.abs(there.q.transpose(*here.q.dims).values - here.q.values).max(axis=-1)
    assert (apart <= there.error.values + here.error.values)[done].all()
    with pytest.raises(TwolinkError, match="it exists"):
        tl.connect("http://127.0.0.1:1").sweep("arm-swing", vary=GRID, out=tmp_path / "x.zarr")


@pytest.mark.slow
def test_results_as_json_and_tables(http: Served, store: Any, job: str) -> None:
    record = http.ask(job)["result"]
    assert (record["runs"], record["done"], record["failed"]) == (6, 3, 3)
    found = http.ask(f"{job}/result")
    assert (found["dims"], found["shape"]) == (record["dims"], record["shape"])
    assert found["varied"]["q.elbow"] == {
        "units": "rad", "long_name": "configuration of joint elbow at the start", "values": GRID["q.elbow"]
    }  # fmt: skip
    expected = store.q.sel(q_name="elbow").transpose(*found["dims"]).values.ravel()
    values = np.array(found["columns"]["end.q.elbow"]["values"], dtype=float)
    np.testing.assert_array_equal(values, expected)
    assert [found["statuses"][i] for i in found["columns"]["status"]["values"]].count("failed") == 3
    assert set(found["columns"]) == set(record["columns"])
    few = http.ask(f"{job}/result?variable=error&variable=reason")
    assert list(few["columns"]) == ["error", "reason"]
    assert http.ask(f"{job}/result?variable=eror", status=422)["remedy"] == "did you mean 'error'?"
    for form, read in (("csv", pd.read_csv), ("parquet", pd.read_parquet)):
        rows = read(io.BytesIO(http.get(f"{job}/result?format={form}").content))
        np.testing.assert_allclose(rows["end.q.elbow"], expected, rtol=1e-15)
    one, two = (http.get(f"{job}/figure?variable=end.q.elbow&turns={turns}").text for turns in ("true", "false"))
    assert "turns" in one
    assert "turns" not in two


def test_one_run_of_a_sweep_can_be_seen(http: Served, job: str) -> None:
    table = http.ask(f"{job}/result")
    number = next(i for i, status in enumerate(table["columns"]["status"]["values"]) if status == 1)
    run = http.ask(f"{job}/runs/{number}")
    assert run["values"]["forearm.mass"] == 1.0
    answer = http.ask("/v1/simulations", {**run["simulation"], "wait": 30})
    both = answer["result"]["error"] + table["columns"]["error"]["values"][number]
    assert abs(answer["result"]["q"][1] - table["columns"]["end.q.elbow"]["values"][number]) <= both
    assert "-1" in http.ask(f"{job}/runs/{table['columns']['status']['values'].index(3)}", status=422)["detail"]
    assert http.ask(f"{job}/runs/6", status=422)["remedy"] == "0 to 5"


@pytest.mark.slow
def test_effects_accuracies_and_uploaded_robots_vary(http: Served, tmp_path: Path) -> None:
    scene = tl.Scene(tl.load_robot(pendulum()), q=[0.4], duration=0.5,
                     effects=[tl.effects.Gravity(), tl.effects.JointDamping(damping={"hinge": 0.5})])  # fmt: skip
    vary = {"effects.1": [True, False], "effects.1.damping.hinge": [0.5, 1.0], "accuracy": [1e-3, 1e-6]}
    data = tl.connect(http.url).sweep(scene, vary=vary, out=tmp_path / "x.zarr")
    assert (data.status == 1).all()
    free = data.q.sel({"effects.1": False, "accuracy": 1e-6}).values
    assert np.ptp(free) == 0.0
    job = max(http.ask("/v1/sweeps"), key=lambda job: job["created"])["id"]
    table = http.ask(f"/v1/sweeps/{job}/result")
    for number in (0, 5):
        run = http.ask(f"/v1/sweeps/{job}/runs/{number}")
        answer = http.ask("/v1/simulations", {**run["simulation"], "wait": 30})["result"]
        assert run["simulation"]["accuracy"] == run["values"]["accuracy"]
        distance = abs(answer["q"][0] - table["columns"]["end.q.hinge"]["values"][number])
        assert distance <= answer["error"] + table["columns"]["error"]["values"][number]


def begun(http: Served) -> str:
    """The path of a long sweep, of which something is done."""
    path = http.begin(LONG, "/v1/sweeps")
    assert any((job["progress"] or {}).get("done", 0) > 0 for _, job in events(http, path))
    return path


def marks(folder: Path) -> dict[Path, int]:
    """When each finished block was marked."""
    return {file: file.stat().st_mtime_ns for file in folder.rglob("status/c/*/*") if file.suffix != ".partial"}


@pytest.mark.slow
def test_a_sweep_goes_on_after_it_was_cancelled_and_the_service_killed(tmp_path: Path) -> None:
    folder = tmp_path / "data"
    with serving(folder) as http:
        path = begun(http)
        http.post(f"{path}/cancel")
        assert ended(http, path)["state"] == "cancelled"
        before = marks(folder)
        statuses = http.ask(f"{path}/result?variable=status")["columns"]["status"]["values"]
        assert 0 < statuses.count(1) < len(statuses)
        http.post(f"{path}/run")
        assert any((job["progress"] or {}).get("done", 0) > statuses.count(1) for _, job in events(http, path))
        http.kill()
    assert {file: at for file, at in marks(folder).items() if file in before} == before
    with serving(folder) as http:
        assert http.ask(path)["state"] == "interrupted"
        assert http.ask("/health")["bytes"] > 10_000
        before = marks(folder)
        http.post(f"{path}/run")
        job = ended(http, path)
        assert (job["state"], job["result"]["done"]) == ("done", 6400)
        after = marks(folder)
        assert {file: after[file] for file in before} == before
        assert len(after) > len(before)


@pytest.mark.parametrize(("body", "status", "part"), [
    ({"vary": {"q.elbow": {"range": [0, 1, 1e6]}, "q.shoulder": {"range": [0, 1, 1e6]}}}, 422,
     "1,000,000,000,000 runs"),
    ({"vary": {"q.elbow": {"uniform": [0, 1]}}, "design": "sobol", "count": 10**15}, 422, "runs are too many"),
    ({"vary": {"q.elbow": {"range": [0, 1, 1e300]}}}, 422, "runs are too many"),
    ({"vary": {"q.elbow": {"range": [0, 1, 900000]}}, "outputs": ["samples"]}, 422, "256 MB"),
    ({"vary": {"q.elbow": {"range": [0, 1, 1e9]}, "q.shoulder": {"range": [0, 1, -1]}}}, 422, "runs are too many"),
    ({"vary": {"q.elbow": {"range": [0, 1, 0.5]}}}, 422, "number of values"),
    ({"vary": {"q.elbow": {"range": [0, 1]}}}, 422, "3 numbers"),
    ({"vary": {"q.elbow": {"rnge": [0, 1, 2]}}}, 422, "range"),
    ({"vary": {"q.elbw": [0.0]}}, 422, "q.elbw"),
    ({"vary": {"effects.7": [True]}}, 422, "effects.7"),
    ({"vary": {"robot": ["/etc/passwd"]}, "outputs": ["cost"]}, 422, "catalogue"),
    ({"vary": {"q.elbow": [0.0]}, "outputs": ["os:abort"]}, 400, "known: cost, energy"),
    ({"vary": {"q.elbow": [0.0]}, "duration": 1e9}, 422, "too long"),
    ({"vary": {}}, 400, "length"),
    ({"vary": {"q.elbow": "all"}}, 400, "vary"),
    ({"vary": {"q.elbow": [0.0]}, "design": "all"}, 400, "design"),
    ({"vary": {"q.elbow": [0.0]}, "design": "gird"}, 400, "did you mean 'grid'?"),
    ({"vary": {"q.elbow": [0.0]}, "outputs": ["final"] * 51}, 400, "length"),
])  # fmt: skip
def test_refusals(http: Served, body: dict[str, Any], status: int, part: str) -> None:
    problem = str(http.ask("/v1/sweeps", {"scene": "arm-swing", "wait": 30, **body}, status))
    assert part in problem
    assert "/results/" not in problem


def test_nan_and_infinity_are_no_json(http: Served) -> None:
    for number in ("NaN", "Infinity", "1e999"):
        body = f'{{"scene": "arm-swing", "vary": {{"q.elbow": {{"range": [0, {number}, 3]}}}}}}'
        http.ask("/v1/sweeps", body, 400)


def test_a_failed_sweep_raises_what_the_library_raises(served: Served, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"did you mean 'q\.elbow'"):
        tl.connect(served.url).sweep("arm-swing", vary={"q.elbw": [0.0]}, out=tmp_path / "x.zarr")
    assert not list(tmp_path.iterdir())


ONE = "n_workers=1, processes=False, protocol='tcp', scheduler_port={}"


@pytest.mark.slow
def test_sweeps_are_sent_to_a_cluster_and_go_on_after_it_was_lost(tmp_path: Path) -> None:
    first = contextlib.ExitStack()
    _, address = first.enter_context(dask_cluster(tmp_path, ONE.format(0)))
    with first, serving(tmp_path / "data", "--dask", address) as http:
        scene = tl.Scene(tl.load_robot(pendulum()), q=[0.4], effects=[tl.effects.Gravity()], duration=0.5)
        vary = {"q.hinge": [0.1, 0.2, 0.3]}
        there = tl.connect(http.url).sweep(scene, vary=vary, out=tmp_path / "there.zarr")
        here = tl.sweep(scene, vary=vary, out=tmp_path / "here.zarr", executor=ThreadPoolExecutor(1))
        for name in ("q", "v", "error", "status"):
            assert np.array_equal(there[name], here[name]), name
        path = begun(http)
        first.close()
        lost = ended(http, path)
        assert (lost["state"], lost["problem"]["code"]) == ("failed", "cluster-lost")
        assert f"{address} cannot be reached" in http.log
        assert "Traceback" not in http.log
        before = marks(tmp_path / "data")
        assert before
        with dask_cluster(tmp_path, ONE.format(address.rpartition(":")[2])):
            http.post(f"{path}/run")
            job = ended(http, path)
        assert (job["state"], job["result"]["done"]) == ("done", 6400)
        after = marks(tmp_path / "data")
        assert {file: after[file] for file in before} == before
        assert len(after) > len(before)


def test_samples_are_drawn_in_the_order_that_was_given(served: Served, tmp_path: Path) -> None:
    asked = {"vary": {"v.shoulder": {"uniform": [0.0, 1.0]}, "q.elbow": {"normal": [0.0, 1.0]}}, "design": "random",
             "count": 4, "seed": 3, "duration": 0.1}  # fmt: skip
    there = tl.connect(served.url).sweep("arm-swing", out=tmp_path / "x.zarr", **asked)
    here = tl.sweep(tl.load_scene("arm-swing"), out=tmp_path / "y.zarr", executor=ThreadPoolExecutor(1), **asked)
    for name in asked["vary"]:
        assert np.array_equal(there[name], here[name]), name
    np.testing.assert_allclose(there.q, here.q, atol=1e-6)
