"""Failures become problem+json and become failures again, with class, code, argument and data."""

import contextlib
from typing import Any

import msgspec
import numpy as np
import pytest

import twolink as tl
from tests.parts.service.serving import Served
from twolink.errors import AccuracyError, QueryError, RobotError, TwolinkError
from twolink.parts.service.problems import Problem, Refusal, answer_of, error_from, problem_of

LIMIT: dict[str, Any] = {"code": "accuracy-limit", "argument": "accuracy", "trusted_until": 1.5, "precision": "quad"}


@pytest.mark.parametrize("error", [
    TwolinkError("what"), RobotError("no mass", where="URDF text:3", remedy="give one"), AccuracyError("no", **LIMIT),
    QueryError("shape", argument="q", size=np.float64(3.0)), Refusal(404, "no such robot", where="path: robot"),
    Refusal(429, "too many", retry_after=2.0), Refusal(422, "too slow", code="too-slow"),
])  # fmt: skip
def test_a_failure_survives_http(error: TwolinkError) -> None:
    status, headers, body = answer_of(error)
    got = error_from(msgspec.json.decode(body, type=Problem))
    assert (type(got), str(got), got.code, got.argument) == (type(error), str(error), error.code, error.argument)
    assert got.data == error.data
    assert problem_of(got) == problem_of(error)
    assert dict(headers)[b"content-type"] == b"application/problem+json"
    assert status == problem_of(error).status


def test_a_value_of_any_length_is_not_sent_back() -> None:
    problem = problem_of(QueryError(f"{'x' * 10**6} is unknown", argument="q" * 10**6, remedy="r" * 10**6))
    assert len(msgspec.json.encode(problem)) < 10_000
    assert problem.detail.endswith(" ...")


def test_unexpected_failures_tell_no_details(caplog: pytest.LogCaptureFixture) -> None:
    problem = problem_of(KeyError("secret"))
    assert (problem.status, problem.type) == (500, "urn:twolink:internal-error")
    assert b"secret" not in msgspec.json.encode(problem)
    assert "secret" in caplog.text


def test_an_accuracy_out_of_reach_has_the_trusted_time(http: Served) -> None:
    asked = {"scene": "arm-swing", "duration": 1.0, "accuracy": 1e-15, "precision": "double", "wait": 30}
    problem = http.ask("/v1/simulations", asked, 422)
    assert problem["code"] == "accuracy-limit"
    assert 0 <= problem["data"]["trusted_until"] < 1.0
    client = tl.connect(http.url)
    with contextlib.closing(client), pytest.raises(AccuracyError) as caught:
        client.simulate("arm-swing", 1.0, accuracy=1e-15, precision="double")
    assert (caught.value.code, caught.value.data["tried"]) == ("accuracy-limit", problem["data"]["tried"])
    # Optimized code, which follows a scene's first code, rounds differently.
    assert caught.value.data["trusted_until"] == pytest.approx(problem["data"]["trusted_until"], rel=0.3)


@pytest.mark.parametrize("effect", [
    {"type": "joint-damping", "damping": {"nose": 1}}, {"type": "gravit"}, {"type": "gravity", "field": "down"},
])  # fmt: skip
def test_a_wrong_effect_is_named_by_its_index(http: Served, effect: dict[str, Any]) -> None:
    scene = {"robot": "two_link", "effects": [{"type": "joint-damping", "damping": {"elbow": 1}}, effect]}
    problem = http.ask("/v1/scenes/validate", {"scene": scene}, 422)
    assert problem["data"]["effect"] == 1
    assert problem["where"].startswith("scene.effects[1]")


@pytest.mark.parametrize("value", [10**20, -(10**20), 10**400], ids=["1e20", "-1e20", "1e400"])
def test_an_integer_beyond_64_bits_is_a_number_as_any_other(http: Served, value: int) -> None:
    effects = [{"type": "joint-damping", "damping": {"elbow": value}}]
    asked = "/v1/scenes/validate", {"scene": {"robot": "two_link", "effects": effects}}
    if value == 10**20:
        assert http.ask(*asked)["effects"][0]["damping"] == {"elbow": 1e20}
    else:
        assert http.ask(*asked, 422)["where"].startswith("scene.effects[0].damping")


def test_events_of_a_run_are_records(http: Served) -> None:
    job = http.ask("/v1/simulations", {"scene": "bouncing-ball", "duration": 1.0, "wait": 30})
    assert job["state"] == "done"
    run = tl.simulate(tl.load_scene("bouncing-ball"), 1.0)
    assert [event["kind"] for event in job["result"]["events"]] == [event.kind for event in run.events]
    assert job["result"]["events"][0]["t"] == pytest.approx(run.events[0].t, abs=1e-5)
    assert set(job["result"]["events"][0]) == {"t", "kind", "what", "detail", "energy", "effect", "direction"}
