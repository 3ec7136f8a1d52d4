"""Answers about a robot over HTTP: linearization, sensitivities, identification, as they are in Python."""

import csv
import io

import httpx
import numpy as np
import pytest

import twolink as tl
from twolink.errors import QueryError, SceneError
from twolink.parts.service.client import Client


@pytest.mark.slow
def test_quantities_are_what_can_be_varied_with_the_values_of_the_scene(http: httpx.Client) -> None:
    scene = {**http.get("/v1/scenes/arm-human").json(), "q": {"shoulder": 0.3}, "v": {"elbow": 0.5}}
    rows = {row["name"]: row for row in http.post("/v1/scenes/quantities", json={"scene": scene}).json()}
    robot = tl.load_robot("arm")
    masses = dict(zip(robot.parameter_names, robot.parameter_values, strict=True))
    assert rows["q.shoulder"] == {**rows["q.shoulder"], "kind": "q", "unit": "rad", "value": 0.3}
    assert (rows["v.elbow"]["unit"], rows["v.elbow"]["value"]) == ("rad/s", 0.5)
    assert rows["forearm.mass"]["value"] == pytest.approx(masses["forearm.mass"], rel=1e-15)
    assert rows["effects.1.damping.elbow"]["value"] == scene["effects"][1]["damping"]["elbow"]
    wrong = http.post("/v1/scenes/quantities", json={"scene": {**scene, "q": {"elbo": 1.0}}})
    assert (wrong.status_code, wrong.json()["type"]) == (422, "urn:twolink:scene-error")


def test_linearize_is_that_of_python(client: Client) -> None:
    scene = tl.load_scene("arm-swing")
    answer, here = client.linearize(scene, q=[np.pi / 2, 0.0]), tl.linearize(scene, [np.pi / 2, 0.0])
    np.testing.assert_allclose(answer["A"], here.A, atol=1e-11)
    np.testing.assert_allclose(answer["B"], here.B, atol=1e-11)
    assert (answer["names"], answer["stability"], answer["controllable"]) == (list(here.names), "saddle", 4)


def test_sensitivities_are_those_of_python(client: Client) -> None:
    scene, names = tl.load_scene("arm-swing"), ["q.elbow", "forearm.mass"]
    answer = client.sensitivities(scene, 1.0, wrt=names, samples_per_second=20)
    here = tl.sensitivities(scene, wrt=names, duration=1.0, samples_per_second=20)
    np.testing.assert_array_equal(answer["t"], here.run.t)
    for name in names:
        both = here.error[name][-1] + answer["sensitivities"][name]["error"][-1]
        assert np.abs(np.array(answer["sensitivities"][name]["q"]) - here.q[name]).max() <= both
    with pytest.raises(SceneError, match="forearm"):
        client.sensitivities(scene, wrt=["forarm.mass"])


def test_identification_finds_the_masses_of_a_csv(client: Client) -> None:
    robot, t = tl.load_robot("arm"), np.linspace(0.0, 4.0, 400)
    w = np.array([1.7, 2.9])
    q, v, a = np.sin(np.outer(t, w)), w * np.cos(np.outer(t, w)), -(w**2) * np.sin(np.outer(t, w))
    tau = robot.inverse_dynamics(q, v, a) + np.random.default_rng(0).normal(0, 1e-3, q.shape)
    text = io.StringIO()
    rows = csv.writer(text)
    rows.writerow(["t", *(f"{name}{i}" for name in ("q", "v", "a", "tau") for i in (0, 1))])
    rows.writerows(np.column_stack([t, q, v, a, tau]).tolist())
    answer = client.identify("arm", text.getvalue(), parameters=["forearm.mass"])
    (found,) = answer["found"]
    true = dict(zip(robot.parameter_names, robot.parameter_values, strict=True))["forearm.mass"]
    assert found["low"] < true < found["high"]
    assert found["high"] - found["low"] < 0.01
    with pytest.raises(QueryError, match="is missing; there are t, q0, q1"):
        client.identify("arm", "t,q0,q1\n0,0,0\n1,1,1\n")
