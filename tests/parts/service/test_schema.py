"""The API's description: answers are as it says, whatever is asked, and a client is made of it without a complaint."""

import importlib
import json
import os
import re
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import httpx
import pytest
import schemathesis
from hypothesis import HealthCheck, Phase, given, settings
from schemathesis.checks import content_type_conformance, response_schema_conformance, status_code_conformance

from tests.parts.service.serving import TOP, Served
from twolink.parts.service.work.query_requests import QUERIES
from twolink.parts.service.work.requests import JOB_KINDS

RUNS = pytest.mark.parametrize("count", [3, pytest.param(60, marks=pytest.mark.slow)])
GENERATOR = Path(sys.prefix, "generator", "bin", "openapi-python-client")  # made by scripts/test
CONFIG = TOP / "docs/operating/openapi-python-client.yaml"
JOBS = tuple(f"/v1/{kind.path}" for kind in JOB_KINDS.values())
LONGEST = 60.0  # s: a request


def _is_no_fault(_: Any, answer: Any, __: Any) -> None:
    if answer.status_code == 500:
        raise AssertionError("the service has failed: 500")


CHECKS = [_is_no_fault, status_code_conformance, content_type_conformance, response_schema_conformance]


def explore(served: Served, cases: int, failures: Counter[str]) -> int:
    """Ask so many times for each operation, and count what is wrong by operation. Returns the number of requests."""
    schema = schemathesis.openapi.from_url(f"{served.url}/openapi.json")
    operations = (each.ok() for each in schema.get_all_operations())
    asked = [one for one in operations if not one.path.endswith("/events")]  # streams, read elsewhere
    return sum(_ask(one, cases, failures) for one in asked)


def _ask(operation: Any, cases: int, failures: Counter[str]) -> int:
    asked = 0

    @settings(max_examples=cases, deadline=None, database=None, derandomize=True, phases=[Phase.generate],
              suppress_health_check=list(HealthCheck))  # fmt: skip
    @given(case=operation.as_strategy())
    def ask(case: Any) -> None:
        nonlocal asked
        asked += 1
        if operation.path in JOBS and isinstance(case.body, dict):
            case.body["wait"] = 0
        try:
            case.call_and_validate(checks=CHECKS, timeout=LONGEST)
        except (Exception, BaseExceptionGroup) as error:  # what the checks have found, and timeouts
            said = (" ".join(str(one).split())[:300] for one in getattr(error, "exceptions", (error,)))
            failures[f"{operation.label}: {'; '.join(said)}"] += 1

    ask()
    return asked


@pytest.mark.slow
@RUNS
@pytest.mark.filterwarnings("ignore")
def test_answers_are_as_described_and_none_is_a_fault(served: Served, count: int) -> None:
    failures: Counter[str] = Counter()
    assert explore(served, count, failures) > 70 * min(count, 2)
    assert not failures, failures
    assert served.process.poll() is None


def test_every_operation_says_what_it_answers(http: Served) -> None:
    text = http.get("/openapi.json").text
    document = json.loads(text)
    assert document["openapi"].startswith("3.1")
    queries = {f"/v1/robots/{{robot}}/{name}" for name in QUERIES}
    others = {"/v1/robots", "/v1/scenes/explain", "/v1/simulations/{job}/events", "/v1/studies/{job}/figure"}
    assert queries | others <= document["paths"].keys()
    assert all("post" in document["paths"][path] for path in queries)
    assert set(re.findall(r'"#/components/schemas/([^"]+)"', text)) <= document["components"]["schemas"].keys()
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            answers = operation["responses"]
            assert {"4XX", "5XX"} <= set(answers), path
            assert "application/problem+json" in answers["4XX"]["content"]
            for status, answer in answers.items():
                for media, content in answer.get("content", {"": {"schema": {"$ref": ""}}}).items():
                    assert content["schema"], (method, path, status, media)
    begun = document["paths"]["/v1/simulations"]["post"]["responses"]
    assert set(begun) == {"200", "202", "4XX", "5XX"}
    assert begun["202"]["content"]["application/json"]["schema"] == {"$ref": "#/components/schemas/SimulationJob"}
    events = document["paths"]["/v1/sweeps/{job}/events"]["get"]["responses"]["200"]
    assert list(events["content"]) == ["text/event-stream"]
    assert '"items":false' not in text


@pytest.mark.slow
def test_all_fields_of_an_explanation_are_described(http: Served) -> None:
    described = http.ask("/openapi.json")["components"]["schemas"]["ExplainedScene"]["properties"]
    assert http.ask("/v1/scenes/explain", {"scene": "arm-swing"}).keys() == described.keys()


def test_answers_of_jobs_are_as_described(http: Served) -> None:
    """Those that take longer than made-up requests run."""
    jsonschema: Any = importlib.import_module("jsonschema")
    document = http.ask("/openapi.json")
    scene = {"scene": "arm-swing", "duration": 0.5}

    def check(path: str, answer: httpx.Response) -> Any:
        operation = document["paths"][path][answer.request.method.lower()]
        schema = operation["responses"][str(answer.status_code)]["content"]["application/json"]["schema"]
        jsonschema.Draft202012Validator({**schema, "components": document["components"]}).validate(answer.json())
        return answer.json()

    key = check("/v1/simulations", http.post("/v1/simulations", json={**scene, "wait": 30}))["id"]
    for part in ("result", "motion"):
        check(f"/v1/simulations/{{job}}/{part}", http.get(f"/v1/simulations/{key}/{part}"))
    sweep = {**scene, "vary": {"q.elbow": [0.0, 0.1]}, "wait": 30}
    key = check("/v1/sweeps", http.post("/v1/sweeps", json=sweep))["id"]
    check("/v1/sweeps/{job}/runs/{number}", http.get(f"/v1/sweeps/{key}/runs/1"))
    for what in ("validate", "explain", "quantities", "linearize"):
        check(f"/v1/scenes/{what}", http.post(f"/v1/scenes/{what}", json={"scene": "arm-swing"}))
    for robot in ("two_link", http.ask("/v1/robots", {"source": "panda"})["id"]):
        check("/v1/robots/{robot}", http.get(f"/v1/robots/{robot}"))
    for path in ("/v1/robots", "/v1/scenes", "/v1/methods", "/v1/queries", "/v1/simulations", "/health", "/ready"):
        check(path, http.get(path))


@pytest.mark.skipif(not GENERATOR.exists(), reason="openapi-python-client is not installed")
def test_a_client_is_generated_and_used(served: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    command = [str(GENERATOR), "generate", "--url", f"{served.url}/openapi.json", "--config", str(CONFIG)]
    command += ["--meta", "none", "--output-path", str(tmp_path / "made"), "--fail-on-warning"]
    place = {**os.environ, "PATH": f"{GENERATOR.parent}:{os.defpath}"}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=place)
    assert done.returncode == 0, done.stdout
    assert "WARNING" not in done.stdout + done.stderr
    monkeypatch.syspath_prepend(str(tmp_path))
    for name in [name for name in sys.modules if name.split(".")[0] == "made"]:
        monkeypatch.delitem(sys.modules, name)

    def part(name: str) -> Any:
        return importlib.import_module(f"made.{name}")

    with part("client").Client(base_url=served.url, timeout=httpx.Timeout(120.0)) as client:
        bias = part("models.bias").Bias(q=[0.0, 0.0])
        answer = part("api.queries.bias").sync(robot="two_link", client=client, body=bias)
        with served.client() as http:
            assert answer.to_dict() == http.ask("/v1/robots/two_link/bias", {"q": [0.0, 0.0]})
        request = part("models.simulation_request").SimulationRequest(scene="arm-swing", duration=0.5, wait=30.0)
        job = part("api.simulations.v1_simulations_begin").sync(client=client, body=request)
        assert (job.kind, job.state, job.result["robot"]) == ("simulation", "done", "two_link")
        again = part("api.simulations.v1_simulations_job_show_job").sync(job.id, client=client)
        assert again.request.duration == 0.5
        problem = part("api.robots.v1_robots_inspect_robot").sync("nobody", client=client)
        assert (type(problem).__name__, problem.code) == ("Problem", "not-found")


ASK = """
import type { components, paths } from "./made";

type Asked = paths["/v1/simulations"]["post"]["requestBody"]["content"]["application/json"];
type Job = components["schemas"]["SimulationJob"];
const base = process.argv[2];
const post = async <T>(path: keyof paths, body: unknown): Promise<T> => {
  const headers = { "content-type": "application/json" };
  return (await (await fetch(base + path, { method: "POST", headers, body: JSON.stringify(body) })).json()) as T;
};
const asked: Asked = { scene: "arm-swing", duration: 0.5, wait: 30 };
const job = await post<Job>("/v1/simulations", asked);
const wrong = await post<components["schemas"]["Problem"]>("/v1/simulations", { scene: "nothing" });
const state: "queued" | "running" | "done" | "failed" | "cancelled" | "interrupted" = job.state;
console.log(state, job.request?.duration, wrong.status);
export {};
"""
OPTIONAL = ("--default-non-nullable", "false")  # what has a default may be left out
TOOLS = [shutil.which(name) for name in ("openapi-typescript", "tsc", "node")]


@pytest.mark.slow
@pytest.mark.skipif(None in TOOLS, reason="openapi-typescript, tsc or node is not installed")
def test_types_for_typescript_are_generated_and_used(served: Served, tmp_path: Path) -> None:
    generator, compiler, node = TOOLS

    def run(*command: str | None) -> str:
        done = subprocess.run([*map(str, command)], capture_output=True, text=True, cwd=tmp_path, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout + done.stderr

    assert "warn" not in run(generator, f"{served.url}/openapi.json", "--output", "made.d.ts", *OPTIONAL).lower()
    (tmp_path / "ask.ts").write_text(ASK)
    (tmp_path / "node.d.ts").write_text("declare const process: { argv: string[] };")
    (tmp_path / "package.json").write_text('{"type": "module"}')
    options = "--strict --target es2022 --module es2022 --moduleResolution bundler --lib es2022,dom"
    run(compiler, *options.split(), "--outDir", "out", "ask.ts", "node.d.ts", "made.d.ts")
    assert run(node, "out/ask.js", served.url).split() == ["done", "0.5", "422"]
