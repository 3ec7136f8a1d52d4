"""Base parameters: rank and null space are those of Pinocchio's regressor; the words say what the numbers do."""

import numpy as np
import pinocchio as pin
import pytest

import twolink as tl
from tests.parts.identification.motions import FINGERS
from tests.urdf_text import joint, link
from tests.urdf_text import robot_of as robot_text
from twolink.errors import QueryError
from twolink.identification import base_parameters
from twolink.parts.identification.base_parameters import select

ROBOTS = {
    "two_link": ({}, 6),
    "arm": ({}, 6),
    "ur5": ({}, 36),  # Khalil and Dombre 2002: 36 for six revolute joints whose first is vertical
    "panda": ({"lock": FINGERS}, 43),  # Gaz et al. 2019: 43
    "anymal": ({"root": "free"}, None),
}


@pytest.mark.parametrize("name", ROBOTS)
def test_rank_and_null_space_are_those_of_pinocchios_regressor(name: str) -> None:
    options, rank = ROBOTS[name]
    robot = tl.load_robot(name, **options)
    base = base_parameters(robot)
    q, v = robot.random_state(80, seed=7)
    a = np.random.default_rng(8).uniform(-3, 3, v.shape)
    stacked = np.vstack([
        np.reshape(pin.computeJointTorqueRegressor(robot.model, robot.data, *state), (robot.nv, -1))
        for state in zip(q, v, a, strict=True)
    ])  # fmt: skip
    singular = np.linalg.svd(stacked, compute_uv=False)
    here = len(base.matrix)
    assert here == (rank or here)
    np.testing.assert_array_equal(base.matrix[:, base.members], np.eye(here))
    assert base.null_space.shape == (len(base.names), len(base.names) - here)
    assert np.abs(stacked @ base.null_space).max() < 1e-12 * singular[0]
    scale = np.linalg.norm(stacked, axis=0)
    scaled = stacked[:, scale > 1e-12 * scale.max()] / scale[scale > 1e-12 * scale.max()]
    assert int(np.sum(np.linalg.svd(scaled, compute_uv=False) > 1e-8)) == here


def test_words_of_the_two_link_arm() -> None:
    """In a vertical plane a mass at the elbow acts as a first moment and an inertia of the upper arm, l = 1 m."""
    base = base_parameters(tl.load_robot("two_link"))
    assert base.combinations == (
        "upper_arm.first_moment.x + forearm.mass", "upper_arm.first_moment.z",
        "upper_arm.origin_inertia.yy + forearm.mass",
        "forearm.first_moment.x", "forearm.first_moment.z", "forearm.origin_inertia.yy",
    )  # fmt: skip
    assert "upper_arm.mass: no torque depends on it" in base.not_identifiable()
    assert "only the sum upper_arm.first_moment.x + forearm.mass" in base.not_identifiable()


def test_masses_that_move_together_are_told_only_as_a_sum() -> None:
    """Two slides along one line: the inner mass moves alone, and a third is carried without moving on its own."""
    parts = link("cart"), link("slide"), joint("x", "prismatic", "ground", "cart", "1 0 0")
    for axis in ("0 1 0", "1 0 0"):
        text = robot_text(*parts, joint("z", "prismatic", "cart", "slide", axis))
        assert base_parameters(tl.load_robot(text), ["*.mass"]).combinations == ("cart.mass", "slide.mass")
    held = joint("z", "prismatic", "cart", "slide", "1 0 0", more='<mimic joint="x" multiplier="0"/>')
    robot = tl.load_robot(robot_text(*parts, held), mimic=True)
    assert base_parameters(robot, ["*.mass"]).not_identifiable() == ("only the sum cart.mass + slide.mass",)


def test_a_mass_alone_keeps_centre_and_inertia_of_its_link() -> None:
    """It is then what `compiled(parameters=...)` calls by this name: dtau/dm at fixed centre and inertia about it."""
    robot = tl.load_robot("two_link")
    q, v = robot.random_state(5)

    def add(model: pin.Model) -> None:
        body = model.inertias[1]
        model.inertias[1] = pin.Inertia(body.mass + 1, body.lever, body.inertia)

    heavier = robot.changed(add)
    column = robot.regressor(q, v, v) @ select(robot, ["upper_arm.mass"]).columns
    difference = heavier.inverse_dynamics(q, v, v) - robot.inverse_dynamics(q, v, v)
    np.testing.assert_allclose(column[..., 0], difference, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("names", "part"), [
    (["forarm.mass"], "did you mean 'forearm.mass'"),
    (["forearm.com.x"], "look for forearm.mass and forearm.first_moment"),
    (["forearm.inertia.yy"], "look for forearm.origin_inertia"),
    ("forearm.mass", "expected a list of names"), ([], "expected a list of names"),
])  # fmt: skip
def test_unknown_parameters_are_refused_with_the_nearest(names: list[str], part: str) -> None:
    with pytest.raises(QueryError, match=part) as caught:
        base_parameters(tl.load_robot("two_link"), names)
    assert caught.value.argument == "parameters"
