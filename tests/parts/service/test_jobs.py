"""Simulations and studies: answered at once or as jobs, watched, cancelled, stored, and taken in every format."""

import io
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import twolink as tl
from tests.parts.service.serving import Served, serving

SWING = {"scene": "arm-swing", "duration": 1.0, "accuracy": 1e-8, "wait": 30}
# Slow, as it has very many steps of a fixed size.
SLOW = {"scene": "arm-swing", "duration": 1000.0, "samples_per_second": 1, "method": "rk4", "step": 1e-4, "wait": 0}


def events(http: Served, path: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """The events of a job, as they come, until it ends."""
    with http.stream("GET", f"{path}/events") as answer:
        assert answer.headers["content-type"].startswith("text/event-stream")
        name = ""
        for line in answer.iter_lines():
            if line.startswith("event: "):
                name = line.removeprefix("event: ")
            elif line.startswith("data: "):
                yield name, json.loads(line.removeprefix("data: "))


def ended(http: Served, path: str) -> dict[str, Any]:
    """The job at its end."""
    assert [name for name, _ in events(http, path)][-1] == "end"
    return http.ask(path)


def started(http: Served, path: str) -> None:
    """Wait until a worker has reported progress of the job."""
    assert any((job["progress"] or {}).get("fraction", 0) > 0 for _, job in events(http, path))


@pytest.fixture(scope="module")
def swing(served: Served) -> dict[str, Any]:
    return served.ask("/v1/simulations", SWING, 200)


def test_a_short_simulation_is_answered_at_once(swing: dict[str, Any]) -> None:
    run = tl.simulate(tl.load_scene("arm-swing"), 1.0, accuracy=1e-8)
    assert swing["state"] == "done"
    assert swing["result"]["error"] <= 1e-8
    np.testing.assert_allclose(swing["result"]["q"], run.q[-1], atol=2e-8)
    assert swing["result"]["samples"] == 201


@pytest.mark.parametrize(
    ("name", "value"), [("step", 1e-4), ("tolerance", 1e-9), ("contact", "stepped"), ("t_eval", [0.5])]
)
def test_settings_of_ours_are_refused_for_another_simulator(http: Served, name: str, value: object) -> None:
    assert http.ask("/v1/simulations", {**SWING, "simulator": "scipy", name: value}, 422)["where"] == name


def test_the_same_request_is_answered_from_the_store(http: Served, swing: dict[str, Any]) -> None:
    assert http.ask("/v1/simulations", {**SWING, "wait": 0}, 200)["created"] == swing["created"]
    other = http.ask("/v1/simulations", {**SWING, "duration": 0.5})
    assert other["id"] != swing["id"]
    assert {swing["id"], other["id"]} <= {job["id"] for job in http.ask("/v1/simulations")}


def test_results_in_every_format(http: Served, swing: dict[str, Any], tmp_path: Path) -> None:
    path = f"/v1/simulations/{swing['id']}"
    run = tl.simulate(tl.load_scene("arm-swing"), 1.0, accuracy=1e-8)
    table = http.ask(f"{path}/result")
    joints = [f"{letter}.{joint}" for letter in ("q", "v", "tau") for joint in ("shoulder", "elbow")]
    assert list(table["columns"]) == ["t", *joints, "energy", "error"]
    np.testing.assert_allclose(table["columns"]["q.elbow"], run.q[:, 1], atol=2e-8)
    thin = http.ask(f"{path}/result?points=11")
    assert (thin["points"], thin["columns"]["t"][0], thin["columns"]["t"][-1]) == (11, 0.0, 1.0)
    for form in ("csv", "parquet", "npz"):
        file = tmp_path / f"run.{form}"
        file.write_bytes(http.ask(f"{path}/result?format={form}").content)
        loaded = tl.Trajectory.load(file, tl.load_scene("arm-swing").robot)
        np.testing.assert_allclose(loaded.q, run.q, atol=2e-8)
    figure, played = http.get(f"{path}/figure?format=svg"), http.get(f"{path}/playback")
    assert "<svg" in figure.text
    assert "style=" in figure.text
    assert "style-src 'unsafe-inline'" in figure.headers["content-security-policy"]  # which it needs
    assert played.headers["content-type"].startswith("text/html")
    for answer in (figure, played):
        assert answer.headers["content-security-policy"].startswith("sandbox")
        assert "default-src 'none'" in answer.headers["content-security-policy"]


def test_motion_says_where_the_links_are(http: Served, swing: dict[str, Any]) -> None:
    moved = http.ask(f"/v1/simulations/{swing['id']}/motion?frames=11")
    assert np.shape(moved["poses"]) == (11, len(moved["links"]), 7)
    last = http.ask("/v1/robots/two_link/kinematics", {"q": swing["result"]["q"]})
    np.testing.assert_allclose(moved["poses"][-1], last["poses"], atol=1e-6)
    coarse = http.ask("/v1/simulations", {**SWING, "samples_per_second": 20})
    few = http.ask(f"/v1/simulations/{coarse['id']}/motion?frames=61")
    run = tl.simulate(tl.load_scene("arm-swing"), 1.0)
    for k, link in enumerate(few["links"]):  # between the samples too: straight lines are 9e-3 m off
        there = run.robot.frame_pose(run.at(few["t"])[0], link)[1]
        np.testing.assert_allclose(np.array(few["poses"])[:, k, :3], there, atol=2e-4)


@pytest.mark.slow
def test_stepped_contacts_answer_with_an_estimate_where_no_accuracy_is_asked_for(http: Served) -> None:
    job = ended(http, http.begin({"scene": "dominoes", "duration": 0.3}))
    assert (job["state"], job["result"]["bound"], job["result"]["accuracy"]) == ("done", "estimated", None)
    assert 1e-6 < job["result"]["error"] < 0.1  # 1e-6 would be refused


def test_explain_counts_operations_and_seconds(http: Served) -> None:
    explained = http.ask("/v1/scenes/explain", {"scene": "arm-swing", "accuracy": 1e-9})
    assert explained["operations"] == tl.explain(tl.load_scene("arm-swing"), accuracy=1e-9).operations
    assert explained["expected_seconds"] > 0


def test_a_long_simulation_is_a_job_with_progress_that_can_be_cancelled(http: Served) -> None:
    answer = http.post("/v1/simulations", json=SLOW)
    assert answer.status_code == 202
    path = answer.headers["location"]
    http.ask(f"{path}/result", status=409)
    started(http, path)
    http.ask(f"{path}/cancel", {}, 202)
    seen = list(events(http, path))
    assert seen[-1][0] == "end"
    assert seen[-1][1]["state"] == "cancelled"
    assert http.ask(f"{path}/run", {})["state"] in ("queued", "running")
    http.delete(path).raise_for_status()
    http.ask(path, status=404)


def test_deleting_a_job_ends_its_streams(http: Served) -> None:
    path = http.begin({**SLOW, "duration": 1001.0})
    names = []
    for name, job in events(http, path):
        names.append((name, job["state"]))
        if job["state"] == "running":
            http.delete(path).raise_for_status()
    assert names[-1] in (("end", "deleted"), ("end", "cancelled"))
    assert "Traceback" not in http.log


@pytest.mark.slow
def test_the_progress_of_a_job_rises_to_its_end(http: Served) -> None:
    asked = {"scene": "arm-swing", "duration": 40.0, "samples_per_second": 1, "method": "rk4", "step": 1e-4, "wait": 0}
    path = http.begin(asked)
    seen = list(events(http, path))
    fractions = [job["progress"]["fraction"] for _, job in seen if job["progress"]]
    assert fractions == sorted(fractions)
    assert [name for name, _ in seen[:-1]] == ["progress"] * (len(seen) - 1)
    assert (seen[-1][0], seen[-1][1]["state"], fractions[-1]) == ("end", "done", 1.0)


@pytest.mark.slow
def test_a_study_has_rows_tables_and_a_figure(http: Served) -> None:
    asked = {"scene": "arm-swing", "duration": 0.5, "methods": ["rk4", "dop853"], "tolerances": [1e-3, 1e-6],
             "repeats": 1, "wait": 30}  # fmt: skip
    path = http.begin(asked, "/v1/studies")
    assert {row["method"] for row in ended(http, path)["result"]["rows"]} == {"rk4", "dop853"}
    assert http.get(f"{path}/result?format=csv").text.startswith("method,")
    assert len(np.load(io.BytesIO(http.get(f"{path}/result?format=npz").content))["error"]) == 4
    assert "<svg" in http.get(f"{path}/figure").text


@pytest.mark.parametrize(("body", "status", "where"), [
    ({"scene": "arm-swin"}, 422, ""),
    ({"scene": "../../etc/passwd"}, 422, "scene"),
    ({"scene": "x.toml"}, 422, "scene"),
    ({"scene": {"robot": "/etc/passwd"}}, 422, "scene"),
    ({"scene": {"robot": "u-../../../etc"}}, 422, "scene"),
    ({"scene": {"robot": "two_link", "effects": [{"type": "gravit"}]}}, 422, "scene.effects[0]"),
    ({"scene": {"robot": "two_link", "q": {"elbw": 1}}}, 422, "scene.q"),
    ({"scene": {"robot": "two_link", "effects": [{"type": "torque", "torque": {"elbow": {
        "kind": "sampled", "file": "/etc/passwd"}}}]}}, 422, "scene.effects"),
    ({"scene": "arm-swing", "accuracy": -1}, 400, "accuracy"),
    ({"scene": "arm-swing", "accuracy": 1e-30, "precision": "double"}, 422, "t = "),
    ({"scene": "arm-swing", "duration": 1e9}, 422, "duration"),
    ({"scene": "arm-swing", "samples_per_second": 1e9}, 422, "samples_per_second"),
    ({"scene": "arm-swing", "method": "magic"}, 422, "method"),
    ({"scene": "arm-swing", "wait": 1e9}, 400, "wait"),
])  # fmt: skip
def test_problems_of_simulations(http: Served, body: dict[str, Any], status: int, where: str) -> None:
    assert http.ask("/v1/simulations", {"wait": 30, **body}, status)["where"].startswith(where)


@pytest.mark.slow
def test_quotas_limit_results_queue_and_time(tmp_path: Path) -> None:
    quotas = ["jobs=1", "queue=1", "job_seconds=6", "disk_mb=0.05", "result_mb=0.03", "answer_mb=0.05"]
    with serving(tmp_path / "data", *(x for q in quotas for x in ("--quota", q))) as http:
        asked = [{**SWING, "duration": 1.0 + k / 100, "wait": 10} for k in range(6)]  # about 15 kB each
        keys = [http.ask("/v1/simulations", one)["id"] for one in asked]
        assert http.ask("/health")["bytes"] <= 0.05 * 2**20
        http.ask(f"/v1/simulations/{keys[0]}", status=404)  # the oldest went
        assert http.ask(f"/v1/simulations/{keys[-1]}")["state"] == "done"
        last = f"/v1/simulations/{keys[-1]}"
        for path in (f"{last}/playback", f"{last}/motion?frames=3600", "/v1/robots/double_pendulum/visuals"):
            http.ask(path, status=413)
        for count in (2, 3, 4):
            http.ask(f"{last}/motion?frames={count}")
        kept = {path.name for path in (tmp_path / "data").rglob("*") if path.is_file()}
        assert {name for name in kept if not name.startswith("twolink.sqlite")} == {"result.npz", "robot.pickle"}
        assert "0.03 MB" in http.ask("/v1/simulations", {**SWING, "samples_per_second": 5000}, 422)["detail"]
        slow = [http.post("/v1/simulations", json={**SLOW, "duration": 3000.0 + k}) for k in range(3)]
        assert [answer.status_code for answer in slow] == [202, 202, 429]
        failed = ended(http, slow[0].headers["location"])
        assert "6 s of computing" in failed["problem"]["detail"]
