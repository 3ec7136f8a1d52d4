"""What an operator needs: start options that are refused, a log with request ids, readiness, metrics, a clean end."""

import asyncio
import contextlib
import json
import logging
import os
import resource
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import httpx
import pytest
import uvicorn

from tests.command import call, call_process, one_line
from tests.parts.service.serving import Served, pendulum, serving, wait_until
from tests.parts.service.test_jobs import SLOW, SWING, ended
from tests.parts.service.test_restart import assert_gone
from tests.parts.service.test_store import add_done, opened
from twolink.parts.service.logs import AccessLog, Answered, configure
from twolink.parts.service.work.sharing import KeyedLocks

BIAS = "/v1/robots/two_link/bias"
REFUSED = {
    "empty token": (["--token", ""], "token: a token is empty"),
    "blank token": (["--token", " "], "token: a token is empty"),
    "token with a space": (["--token", "a b"], "token: a token is empty, or has spaces"),
    "token with letters beyond ASCII": (["--token", "ä"], "token: a token is empty, or has spaces"),
    "empty host": (["--host", ""], "host: '' is not the name of a host"),
    "host with a port": (["--host", "127.0.0.1:80"], "a port is given with --port"),
    "address of a host": (["--host", "http://localhost"], "is not the name of a host"),
    "name with a port": (["--allow-host", "lab.example:80"], "--allow-host: 'lab.example:80'"),
    "origin with a path": (["--allow-origin", "https://lab.example/"], "--allow-origin: 'https://lab.example/'"),
    "origin without scheme": (["--allow-origin", "lab.example"], "--allow-origin: 'lab.example'"),
    "port": (["--port", "65536"], "--port"),
    "data": (["--data", ""], "data: expected a folder"),
    "infinity": (["--quota", "upload_mb=inf"], "quota: upload_mb: Expected"),
    "nan": (["--quota", "disk_mb=nan"], "quota: disk_mb: Expected"),
    "negative": (["--quota", "jobs=-1"], "quota: jobs: Expected"),
    "twice": (["--quota", "jobs=1", "--quota", "jobs=2"], "quota: jobs is given twice"),
    "no room for a result": (["--quota", "disk_mb=200"], "disk_mb = 200 is less than result_mb = 256"),
    "log": (["--log", "xml"], "--log"),
}


@pytest.fixture
def no_start(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(uvicorn.Server, "run", lambda *_, **__: pytest.fail("it started"))


@pytest.mark.usefixtures("no_start")
def test_settings_that_are_none_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "settings.toml"
    cases = ("hots = 1", "'hots' is unknown"), ("host =", "settings.toml"), ('host = "a b"', "--host: 'a b'")
    for text, part in cases:
        file.write_text(text)
        one_line(call("serve", "--data", str(tmp_path / "data"), "--settings", str(file)), 1, part)
    for name, value, part in (("SERVE_QUOTA", "jobs=-1", "quota: jobs: Expected"), ("TOKEN", "", "a token is empty")):
        with monkeypatch.context() as patch:
            patch.setenv(f"TWOLINK_{name}", value)
            one_line(call("serve", "--data", str(tmp_path / "data")), 1, part)


@pytest.mark.parametrize("case", REFUSED)
@pytest.mark.usefixtures("no_start")
def test_start_options_that_make_no_sense_are_refused(case: str, tmp_path: Path) -> None:
    options, part = REFUSED[case]
    one_line(call("serve", "--data", str(tmp_path / "data"), *options), 2, part)
    assert not (tmp_path / "data").exists()


@pytest.mark.slow
def test_a_smaller_quota_deletes_results_only_when_told_to(tmp_path: Path) -> None:
    keys = [f"simulation-{k:020x}" for k in range(3)]
    with opened(tmp_path / "data") as store:
        for key in keys:
            add_done(store, key, 100_000)
    options = ["--data", str(tmp_path / "data"), "--quota", "disk_mb=0.15", "--quota", "result_mb=0.1"]
    one_line(call_process("serve", *options), 1, "--delete-results")
    assert len(list((tmp_path / "data" / "results").iterdir())) == 3
    with serving(tmp_path / "data", *options[2:], "--delete-results") as http:
        assert [job["id"] for job in http.ask("/v1/simulations")] == [keys[-1]]
        assert "2 jobs and 0 robots were deleted" in http.log


@pytest.mark.slow
def test_every_answer_has_an_id_by_which_the_log_names_it(tmp_path: Path) -> None:
    with serving(tmp_path / "data", "--log", "json", "--token", "secret") as served:
        with served.client(headers={"Authorization": "Bearer secret"}) as http:
            answers = [
                http.post(BIAS, json={"q": [0, 0]}), http.get("/v1/robots/nosuch?a=1"), http.get("/"),
                http.post("/v1/simulations", json=SWING), http.head("/health"),
                http.get("/health", headers={"X-Request-Id": "from-a.proxy_1"}),
                http.get("/health", headers={"X-Request-Id": "forged\\n line"}),
            ]  # fmt: skip
            refused = httpx.get(f"{served.url}/v1/robots")
        ids = [answer.headers["x-request-id"] for answer in (*answers, refused)]
        assert len(set(ids)) == len(ids)
        assert ids[5] == "from-a.proxy_1"
        assert "forged" not in ids[6]
        assert answers[1].json()["request_id"] == ids[1]
        assert refused.json()["request_id"] == ids[-1]
    lines = {line["request_id"]: line for line in map(json.loads, served.log.splitlines())}
    assert [lines[key]["status"] for key in ids] == [200, 400, 200, 200, 200, 200, 200, 401]
    assert [lines[key]["method"] for key in ids[:5]] == ["POST", "GET", "GET", "POST", "HEAD"]
    assert lines[ids[0]]["path"] == BIAS
    assert lines[ids[0]]["bytes"] == len(answers[0].content)
    assert lines[ids[3]]["seconds"] > 0
    assert "secret" not in served.log


def written(form: Any, path: bytes, count: int = 1, most: int = 10) -> str:
    """What the access log writes about some requests."""
    with tempfile.TemporaryFile() as file:
        log = AccessLog(form, file.fileno(), most)
        for _ in range(count):
            log.note(Answered(0.0, "id", "127.0.0.1", "GET", path, 200, 10, 0.001))
        log.close()
        file.seek(0)
        return file.read().decode()


def test_a_log_that_nobody_reads_loses_lines_and_says_so(caplog: pytest.LogCaptureFixture) -> None:
    line = "1970-01-01T00:00:00.000Z 127.0.0.1 - GET /health 200 10 bytes 1.0 ms id"
    assert written("text", b"/health", 3).splitlines() == [line] * 3
    assert written("off", b"/health", 3) == ""
    assert written("json", b"/health", 20).count("\n") == 10
    assert "10 lines of the access log were dropped" in caplog.text


def test_a_line_of_the_log_is_one_line_whatever_it_is_about(capsys: pytest.CaptureFixture[str]) -> None:
    root, before = logging.getLogger(), logging.getLogger().handlers[:]
    try:
        configure("json")
        try:
            raise ValueError("two\nlines")
        except ValueError:
            logging.getLogger("twolink.service").exception("it failed")
    finally:
        root.handlers[:] = before
    (line,) = capsys.readouterr().err.splitlines()
    entry = json.loads(line)
    assert (entry["level"], entry["message"].splitlines()[0]) == ("error", "it failed")
    assert entry["message"].endswith("two\nlines")
    for form in ("text", "json"):
        line = written(form, b"/a\r\n2026 forged \xff" + b"x" * 10_000).removesuffix("\n")
        assert line.isprintable()
        assert len(line) < 1000


@pytest.mark.slow
def test_a_service_ends_though_nobody_reads_its_log() -> None:
    code = """
import os
from twolink.parts.service.logs import AccessLog, Answered
reads, writes = os.pipe()
log = AccessLog("text", writes)
for _ in range(5000):
    log.note(Answered(0.0, "id", "127.0.0.1", "GET", b"/health"))
log.close()
print("closed", len(os.read(reads, 2**20)) > 4096)
"""
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert ended.stdout.split() == ["closed", "True"]


def test_no_lock_outlives_its_use() -> None:
    async def work() -> None:
        locks = KeyedLocks()
        for key in range(100):
            with contextlib.suppress(ValueError):
                async with locks(str(key)):
                    raise ValueError
        assert not locks._locks

    asyncio.run(work())


@pytest.mark.slow
def test_a_disk_that_fails_is_a_clear_state_that_passes(tmp_path: Path) -> None:
    """The service's process may write no more bytes, and then again: as if its disk were full for a time."""
    with serving(tmp_path / "data", "--log", "off") as http:
        assert http.ask("/ready")["status"] == "ready"
        done = http.ask("/v1/simulations", SWING)
        resource.prlimit(http.process.pid, resource.RLIMIT_FSIZE, (0, resource.RLIM_INFINITY))
        wait_until(lambda: http.get("/ready").status_code == 503)
        for path, body in (("/ready", None), ("/v1/simulations", {**SWING, "duration": 0.7})):
            problem = http.ask(path, body, 503)
            assert (problem["code"], problem["retry_after"] > 0) == ("storage-failed", True)
            assert str(tmp_path) not in str(problem)
        http.ask("/health")
        http.ask(BIAS, {"q": [0, 0]})
        resource.prlimit(http.process.pid, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY,) * 2)
        wait_until(lambda: http.get("/ready").status_code == 200)
        assert http.ask(f"/v1/simulations/{done['id']}")["result"] == done["result"]
        assert http.ask("/v1/simulations", {**SWING, "duration": 0.7})["state"] == "done"


def refused_at_the_end(served: Served, ask: Callable[[Served], httpx.Response], measured: str) -> None:
    """Ask, and have the service end when its metrics say that it is at it: who waits is told."""
    with ThreadPoolExecutor(1) as thread:
        waiting = thread.submit(ask, served)
        wait_until(lambda: measured in served.get("/metrics").text)
        served.process.send_signal(signal.SIGTERM)
        answer = waiting.result(120)
    served.process.wait(120)
    assert (answer.status_code, answer.json()["code"]) == (503, "ending")
    assert answer.headers["retry-after"]
    assert "Traceback" not in served.log


@pytest.mark.slow
def test_sigterm_tells_who_waits_and_leaves_the_job_to_the_next_start(tmp_path: Path) -> None:
    job = {**SLOW, "duration": 40.0, "wait": 30}
    with serving(tmp_path / "data") as served:
        refused_at_the_end(served, lambda http: http.post("/v1/simulations", json=job), "twolink_jobs_running 1.0")
    with serving(tmp_path / "data") as http:
        (key,) = (job["id"] for job in http.ask("/v1/simulations"))
        assert ended(http, f"/v1/simulations/{key}")["state"] == "done"


@pytest.mark.slow
def test_sigterm_waits_for_no_worker_that_hangs(tmp_path: Path) -> None:
    def upload(http: Served) -> httpx.Response:
        return http.post("/v1/robots?root=free", content=pendulum())

    with serving(tmp_path / "data") as http:
        http.ask("/v1/robots", pendulum())
        stopped = http.workers()
        for process in stopped:
            os.kill(process, signal.SIGSTOP)
        refused_at_the_end(http, upload, "twolink_requests_under_way 2.0")
    assert_gone(stopped)


def test_head_answers_as_get_without_a_body(http: Served) -> None:
    for path in ("/", "/health", "/v1/robots", "/v1/scenes/arm-swing"):
        head, get = http.head(path), http.get(path)
        assert (head.status_code, head.content) == (200, b"")
        assert head.headers["content-length"] == get.headers["content-length"]
    assert http.head("/nowhere").status_code == 404


@pytest.mark.parametrize(("path", "body", "key"), [
    (BIAS, '{"q": [0, 0], "q": [1, 1]}', "q"), (BIAS, '{"q": [0, 0], "v": null, "v": [1, 1]}', "v"),
    (BIAS, '{"q": [0, 0], "\\u0071": [1, 1]}', "q"),
    ("/v1/scenes/validate", '{"scene": "a", "scene": "arm-swing"}', "scene"),
    ("/v1/scenes/validate", '{"scene": {"robot": "arm", "title": "\\u0022", "q": {"elbow": 1, "elbow": 2}}}', "elbow"),
    ("/v1/simulations", '{"scene": "arm-swing", "accuracy": 1e-3, "accuracy": 1e-6}', "accuracy"),
    ("/v1/robots", '{"source": "arm", "root": "free", "root": "fixed"}', "root"),
    ("/v1/robots/two_link/inverse-dynamics",
     '{"q": [0, 0], "f_ext": {"tip": [0, 0, 0, 0, 0, 0], "tip": [1, 0, 0, 0, 0, 0]}}', "tip"),
])  # fmt: skip
def test_a_key_that_is_given_twice_is_refused(http: Served, path: str, body: str, key: str) -> None:
    assert http.ask(path, body, 400)["detail"] == f"the key '{key}' is given twice"


@pytest.mark.parametrize(("query", "status", "part"), [
    ("root=fixed&root=free", 400, "root is given twice"), ("lock=hinge:1&lock=hinge:2", 400, "'hinge' is given twice"),
    ("roott=free", 422, "'roott' is unknown"),
])  # fmt: skip
def test_an_option_of_an_upload_is_not_dropped(http: Served, query: str, status: int, part: str) -> None:
    assert part in http.ask(f"/v1/robots?{query}", pendulum(), status)["detail"]


def test_keys_that_look_alike_are_none(http: Served) -> None:
    sent = '{"q": [0, 0], "v": null, "frame\\u0073": ["hand", "hand"]}'
    http.ask("/v1/robots/arm/kinematics", sent.replace('"v": null, ', ""))
    scene = '{"scene": {"robot": "arm", "title": "a \\"q\\" \\u0022q\\u0022", "q": {"elbow": 1}, "v": {"elbow": 1}}}'
    assert http.ask("/v1/scenes/validate", scene)["title"] == 'a "q" "q"'


def test_a_wrong_parameter_is_named_by_its_place(http: Served) -> None:
    key = http.ask("/v1/simulations", SWING)["id"]
    assert http.ask(f"/v1/simulations/{key}/motion?frames=0", status=400)["where"] == "query: frames"
    assert http.ask("/v1/simulations?limit=0", status=400)["where"] == "query: limit"
