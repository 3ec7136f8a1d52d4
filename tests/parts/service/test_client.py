"""tl.connect: a robot of a service gives the answers and the errors of a local one."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import twolink as tl
from tests.parts.service.urdfs import pendulum
from tests.robots.test_mimic import chain, mimic
from twolink.errors import QueryError, RobotError, SceneError, TwolinkError
from twolink.parts.service.client import Client
from twolink.parts.service.problems import Refusal

RNG = np.random.default_rng(2)


@pytest.mark.parametrize("batch", [(), (5,), (2, 3)])
def test_answers_are_those_of_a_local_robot(client: Client, batch: tuple[int, ...]) -> None:
    here, there = tl.load_robot("ur5"), client.robot("ur5")
    assert (there.nq, there.nv, there.joint_names) == (here.nq, here.nv, here.joint_names)
    assert there.link_poses(here.neutral)["tool0"].shape == (7,)
    q, v, x = RNG.uniform(-1, 1, (3, *batch, here.nv))
    push = {"tool0": RNG.uniform(-1, 1, (*batch, 6))}
    asked: list[tuple[Any, ...]] = [
        ("forward_dynamics", q, v, x), ("forward_dynamics", q, v, x, push), ("inverse_dynamics", q, v, x),
        ("mass_matrix", q), ("bias", q, v), ("coriolis", q, v), ("gravity_torque", q), ("energy", q, v),
        ("centre_of_mass", q), ("momentum", q, v), ("forward_dynamics_derivatives", q, v, x),
        ("inverse_dynamics_derivatives", q, v, x),
    ]  # fmt: skip
    if len(batch) < 2:  # a frame is asked for by JSON, which has one list of states
        asked += [("frame_pose", q, "tool0"), ("frame_velocity", q, v, "tool0")]
        asked.append(("frame_jacobian", q, "tool0", "local"))
    for name, *arguments in asked:
        expected, got = getattr(here, name)(*arguments), getattr(there, name)(*arguments)
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
    with pytest.raises(RobotError, match="negative"):
        client.upload(pendulum().replace('value="2"', 'value="-2"'))
    with pytest.raises(SceneError, match="duration"):
        client.simulate("arm-swing", duration=1e9)
    with pytest.raises(TwolinkError, match="twolink serve"):
        tl.connect("http://127.0.0.1:1").robots()
    with pytest.raises(TwolinkError, match="not an address"):
        tl.connect("ftp://x")


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
