"""to_dict of a run: the summary of a run that the command line and the service share."""

import json

import twolink as tl
from twolink.integrate.solution import Event


def test_a_record_says_what_the_run_says_and_is_json() -> None:
    run = tl.simulate(tl.load_scene("bouncing-ball"), 1.0)
    record = run.to_dict()
    assert json.loads(json.dumps(record, allow_nan=False)) == record
    assert (record["robot"], record["joints"]) == (run.robot.name, list(run.robot.joint_names))
    assert (record["duration"], record["samples"]) == (1.0, len(run.t))
    assert (record["q"], record["v"]) == (run.q[-1].tolist(), run.v[-1].tolist())
    assert record["error"] == run.error.max()
    assert run.events
    assert [Event(**event) for event in record["events"]] == list(run.events)


def test_a_run_that_is_not_verified_has_no_error() -> None:
    record = tl.simulate(tl.load_scene("arm-swing"), 0.1, verify=False).to_dict()
    assert record["error"] is None
    assert "q_precise" not in record


def test_higher_precision_is_written_as_text() -> None:
    run = tl.simulate(tl.load_scene("arm-swing"), 0.1, accuracy=1e-20, precision="quad")
    record = run.to_dict()
    assert [float(x) for x in record["q_precise"] + record["v_precise"]] == record["q"] + record["v"]
    assert all(len(digits.lstrip("-0.")) >= 30 for digits in record["q_precise"])
