"""Joint torques along a run are what inverse dynamics needs for its accelerations."""

import numpy as np
import pinocchio as pin
import pytest

import twolink as tl
from tests.effects.bodies import slider
from tests.effects.cases import E, robot
from twolink.integrate.joint_forces import accelerations_and_joint_torques
from twolink.integrate.motion.scene_equations import equations_of
from twolink.integrate.solver import solve
from twolink.integrate.steps.methods import METHODS

FRICTION = E.DryFriction({"shoulder": 2.0, "elbow": 1.0}, {"elbow": 3.0})
TABLE = E.Torque({"elbow": E.Sampled((0.0, 0.5, 2.0), (1.0, -2.0, 3.0))})


@pytest.mark.parametrize("effects", [[], [E.JointDamping({"elbow": 0.3})], [FRICTION], [FRICTION, TABLE]])
def test_torques_are_those_of_inverse_dynamics(effects: list) -> None:
    scene = tl.Scene(robot("arm"), [0.5, 0.3], effects=[E.Gravity(), *effects])
    solution = solve(equations_of(scene), METHODS["dop853"], np.linspace(0, 2, 41), 1e-9)
    model, data, first = scene.robot.model, scene.robot.model.createData(), 0
    for segment in solution.segments:
        equations, count = segment.equations, segment.samples
        part = slice(first, first + count)
        a, tau = accelerations_and_joint_torques(equations, solution.t[part], solution.x[:, part])
        assert a.shape == tau.shape == (2, count)
        for x, acceleration, torque in zip(solution.x[:, part].T, a.T, tau.T, strict=True):
            np.testing.assert_allclose(torque, pin.rnea(model, data, x[:2], x[2:], acceleration), atol=1e-10)
        first += count
    assert first == 41


def test_friction_that_holds_gives_the_torque_against_the_load() -> None:
    effects = [E.DryFriction({"x": 3.0}), E.Torque({"x": 2.0})]
    solution = solve(equations_of(tl.Scene(slider(), effects=effects)), METHODS["dop853"], np.array([0.0, 1.0]), 1e-9)
    equations = solution.segments[0].equations
    a, tau = accelerations_and_joint_torques(equations, solution.t, solution.x)
    assert not a.any()
    assert np.abs(tau).max() < 1e-12
