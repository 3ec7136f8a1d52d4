"""The regressor: Pinocchio's own columns, linear in the parameters, with armature and friction; mimic joints too."""

import numpy as np
import pinocchio as pin
import pytest

import twolink as tl
from tests.dynamics.robots import of_every_kind, urdf
from tests.dynamics.states import close, states
from twolink.errors import QueryError

ROBOTS = of_every_kind()


@pytest.mark.parametrize("name", ROBOTS)
def test_columns_of_the_bodies_are_pinocchios(name: str) -> None:
    robot = ROBOTS[name]
    q, v, a = states(robot, 3)
    ours = robot.regressor(q, v, a)
    bodies = 10 * (robot.model.njoints - 1)
    assert ours.shape == (3, robot.nv, len(robot.parameter_names))
    for row, state in zip(ours, zip(q, v, a, strict=True), strict=True):
        theirs = pin.computeJointTorqueRegressor(robot.model, robot.data, *state)
        close(row[:, :bodies], np.reshape(theirs, (robot.nv, bodies)))


def test_friction_brakes_the_motion() -> None:
    robot = ROBOTS["two_link"]
    q, v, a = np.zeros(2), np.array([-2.0, 0.0]), np.zeros(2)
    columns = dict(zip(robot.parameter_names, robot.regressor(q, v, a).T, strict=True))
    close(columns["shoulder.damping"], np.array([-2.0, 0.0]))
    close(columns["shoulder.friction"], np.array([-1.0, 0.0]))
    close(columns["elbow.friction"], np.zeros(2))


def test_coupled_joints_have_the_columns_of_the_free_robot_along_the_coupling() -> None:
    """tau = G^T tau_free for q_free = G q + c, so Y = G^T Y_free, body by body."""
    mimic = '<mimic joint="j_a" multiplier="2" offset="0.3"/>'
    text = urdf(("base", "a", "revolute", "0.6 0 0.8", ""), ("a", "b", "revolute", "0.6 0 0.8", mimic))
    coupled, free = tl.load_robot(text, mimic=True), tl.load_robot(text)
    q, v, a = np.array([[0.4], [-1.3], [0.7]])
    G = np.array([[1.0], [2.0]])
    theirs = G.T @ free.regressor(G @ q + [0.0, 0.3], G @ v, G @ a)
    close(coupled.regressor(q, v, a)[:, :20], theirs[:, :20])
    close(coupled.regressor(q, v, a) @ coupled.parameter_values, coupled.inverse_dynamics(q, v, a))
    assert coupled.parameter_names[20:] == ("j_a.armature", "j_a.damping", "j_a.friction")


def test_names_are_one_for_each_column_and_shared_with_run_time_parameters() -> None:
    robot = ROBOTS["panda"]
    names = robot.parameter_names
    assert len(set(names)) == len(names) == robot.parameter_values.size
    assert dict(zip(names, robot.parameter_values, strict=True))["panda_link1.mass"] == robot.model.inertias[1].mass
    robot.compiled([name for name in names if name.endswith((".mass", ".armature", ".damping"))])


def test_batches_are_their_single_states_and_bad_states_are_refused() -> None:
    robot = ROBOTS["two_link"]
    q, v, a = states(robot, 4)
    whole = robot.regressor(*(x.reshape(2, 2, -1) for x in (q, v, a)))
    assert np.array_equal(whole[1, 0], robot.regressor(q[2], v[2], a[2]))
    with pytest.raises(QueryError, match="v: expected finite numbers"):
        robot.regressor(q[0], [np.nan, 0.0], a[0])
