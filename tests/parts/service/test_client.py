"""tl.connect: robots, scenes and measurements of a service have the answers and the errors of local ones."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.parts.service.serving import Served, pendulum
from tests.robots.test_mimic import chain, mimic
from twolink.dynamics.queries import QUERIES
from twolink.errors import QueryError, RobotError, SceneError
from twolink.parts.service.client import Client
from twolink.parts.service.problems import Refusal

RNG = np.random.default_rng(2)


@pytest.mark.parametrize("batch", [(), (5,), (2, 3), (0,), (2, 0)])
def test_answers_are_those_of_a_local_robot(client: Client, batch: tuple[int, ...]) -> None:
    here, there = tl.load_robot("ur5"), client.robot("ur5")
    assert (there.nq, there.nv, there.joint_names) == (here.nq, here.nv, here.joint_names)
    assert there.link_poses(here.neutral)["tool0"].shape == (7,)
    q, v, x = RNG.uniform(-1, 1, (3, *batch, here.nv))
    push = {"tool0": RNG.uniform(-1, 1, (*batch, 6))}
    given = {"q": q, "v": v, "tau": x, "a": x, "f_ext": push, "frame": "tool0", "axes": "local"}
    for query in QUERIES.values():
        arguments = {name: given[name] for name in (*query.arguments, *query.options) if name in given}
        expected, got = getattr(here, query.method)(**arguments), getattr(there, query.method)(**arguments)
        for one, other in zip(got, expected, strict=True) if isinstance(expected, tuple) else [(got, expected)]:
            np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)
            assert np.shape(one) == np.shape(other)


def test_errors_are_those_of_a_local_robot(client: Client) -> None:
    robot = client.robot("two_link")
    with pytest.raises(QueryError, match=r"expected shape \(..., 2\)"):
        robot.bias([0, 0, 0], [0, 0])
    with pytest.raises(QueryError, match="expected real numbers"):
        robot.bias(["a", "b"], [0, 0])
    with pytest.raises(Refusal, match="did you mean 'two_link'") as caught:
        client.robot("two_lnk")
    assert caught.value.status == 404
    with pytest.raises(RobotError, match=r"URDF text:3.*-2\.0 kg is negative"):
        client.upload(pendulum().replace('value="2"', 'value="-2"'))
    with pytest.raises(SceneError, match="duration"):
        client.simulate("arm-swing", duration=1e9)


def test_a_robot_of_a_service_says_what_it_has_not(client: Client) -> None:
    robot = client.robot("two_link")
    for name in ("by_joint", "inverse_kinematics", "compiled"):
        with pytest.raises(AttributeError, match=f"has no '{name}', it has .*link_poses, .*tl.load_robot"):
            getattr(robot, name)


def test_robots_with_mimic_joints_are_answered_whatever_the_number_of_states(client: Client) -> None:
    text = chain(("revolute", ""), ("revolute", ""), ("revolute", mimic("j1", 2.0, 0.3)))
    here, there = tl.load_robot(text, mimic=True), client.upload(text, mimic=True)
    q, v, tau = RNG.uniform(-1, 1, (3, 501, 2))
    for states in ((q[0], v[0], tau[0]), (q[:500], v[:500], tau[:500]), (q, v, tau)):
        np.testing.assert_allclose(there.forward_dynamics(*states), here.forward_dynamics(*states), rtol=1e-9)
        with pytest.raises(QueryError, match='"aba" cannot follow mimic joints'):
            there.forward_dynamics(*states, method="aba")


def test_a_file_is_uploaded_as_load_robot_reads_it(client: Client, tmp_path: Path) -> None:
    path = tmp_path / "pendulum.urdf"
    path.write_text(pendulum())
    assert client.upload(path).id == client.upload(str(path)).id == client.upload(pendulum()).id
    with pytest.raises(RobotError, match=r"missing\.urdf: cannot be read"):
        client.upload(tmp_path / "missing.urdf")


def test_a_simulation_is_that_of_a_local_one(client: Client) -> None:
    run = client.simulate("arm-swing", np.float64(1.0), accuracy=np.float64(1e-8))
    np.testing.assert_allclose(run.q, tl.simulate(tl.load_scene("arm-swing"), 1.0, accuracy=1e-8).q, atol=2e-8)
    scene = tl.Scene(tl.load_robot(pendulum()), q=[0.4], effects=[tl.effects.Gravity()], duration=0.5)
    np.testing.assert_allclose(client.simulate(scene).q[-1], tl.simulate(scene).q[-1], atol=3e-6)


def test_the_way_of_contacts_can_be_asked_for(client: Client) -> None:
    robot = tl.load_robot("two_link")
    law = tl.effects.Contact((("forearm", "ground"),), shapes={"forearm": (tl.effects.Sphere(0.01),)})
    scene = tl.Scene(robot, [0.3, 0.2], effects=[law], duration=0.05)
    here = tl.simulate(scene, contact="stepped", step=0.01)
    there = client.simulate(scene, contact="stepped", step=0.01)
    assert there.bound == here.bound == "estimated"
    np.testing.assert_allclose(there.q, here.q, rtol=0, atol=1e-12)


def test_many_threads_share_a_client(client: Client) -> None:
    robot = client.robot("two_link")
    with ThreadPoolExecutor(8) as pool:
        answers = list(pool.map(lambda x: robot.bias([x, 0.0], [1.0, 1.0]), np.linspace(0, 1, 100)))
    here = tl.load_robot("two_link")
    np.testing.assert_allclose(answers, [here.bias([x, 0.0], [1.0, 1.0]) for x in np.linspace(0, 1, 100)], rtol=1e-12)


@pytest.mark.slow
def test_quantities_are_what_can_be_varied_with_the_values_of_the_scene(http: Served) -> None:
    scene = {**http.ask("/v1/scenes/arm-human"), "q": {"shoulder": 0.3}, "v": {"elbow": 0.5}}
    rows = {row["name"]: row for row in http.ask("/v1/scenes/quantities", {"scene": scene})}
    robot = tl.load_robot("arm")
    masses = dict(zip(robot.parameter_names, robot.parameter_values, strict=True))
    assert rows["q.shoulder"] == {**rows["q.shoulder"], "kind": "q", "unit": "rad", "value": 0.3}
    assert (rows["v.elbow"]["unit"], rows["v.elbow"]["value"]) == ("rad/s", 0.5)
    assert rows["forearm.mass"]["value"] == pytest.approx(masses["forearm.mass"], rel=1e-15)
    assert rows["effects.1.damping.elbow"]["value"] == scene["effects"][1]["damping"]["elbow"]
    wrong = http.ask("/v1/scenes/quantities", {"scene": {**scene, "q": {"elbo": 1.0}}}, 422)
    assert wrong["type"] == "urn:twolink:scene-error"


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


def measured(robot: tl.Robot, count: int, noise: float) -> str:
    """Measurements of a robot of two joints, as CSV. noise: of the torques, N m."""
    t, w = np.linspace(0.0, 4.0, count), np.array([1.7, 2.9])
    q, v, a = np.sin(np.outer(t, w)), w * np.cos(np.outer(t, w)), -(w**2) * np.sin(np.outer(t, w))
    tau = robot.inverse_dynamics(q, v, a) + np.random.default_rng(0).normal(0, noise, q.shape)
    names = ",".join(["t", *(f"{name}{i}" for name in ("q", "v", "a", "tau") for i in (0, 1))])
    return "\n".join([names, *(",".join(map(repr, row)) for row in np.column_stack([t, q, v, a, tau]).tolist())])


def test_identification_finds_the_masses_of_a_csv(client: Client) -> None:
    robot = tl.load_robot("arm")
    answer = client.identify("arm", measured(robot, 400, 1e-3), parameters=["forearm.mass"])
    (found,) = answer["found"]
    true = dict(zip(robot.parameter_names, robot.parameter_values, strict=True))["forearm.mass"]
    assert found["low"] < true < found["high"]
    assert found["high"] - found["low"] < 0.01
    with pytest.raises(QueryError, match="is missing; there are t, q0, q1"):
        client.identify("arm", "t,q0,q1\n0,0,0\n1,1,1\n")
