"""The URDF with what was found: it loads as the robot that was found, and keeps the rest of the file."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import twolink as tl
from tests.parts.identification.motions import FINGERS, motion, noisy
from tests.refusals import refusal
from tests.urdf_text import joint, link, robot_of
from twolink.errors import RobotError
from twolink.identification import identify, write_urdf


def test_it_loads_as_the_robot_that_was_found_and_says_what_was(tmp_path: Path) -> None:
    robot = tl.load_robot("arm")
    t, q, v, a = motion(robot, 200)
    tau = noisy(robot.inverse_dynamics(q, v, a) + 0.3 * v + 0.1 * a, 0.05)
    found = identify(robot, t, q, v, tau, ["forearm.*", "*.damping", "*.armature"], a=a)
    path = write_urdf(found, "arm", str(tmp_path / "found.urdf"))
    again = tl.load_robot(path)
    bodies = slice(0, 20)
    np.testing.assert_allclose(again.parameter_values[bodies], found.found.parameter_values[bodies], rtol=0, atol=1e-12)
    np.testing.assert_allclose(again.model.damping, found.found.model.damping, rtol=0, atol=1e-12)
    np.testing.assert_allclose(again.model.armature, found.found.model.armature, rtol=0, atol=1e-12)
    text = path.read_text()
    low, high = found.intervals["forearm.mass"]
    mass = f"forearm.mass = {found.values['forearm.mass']:.6g}, 95 % within {low:.6g} and {high:.6g}"
    assert f"<!-- found: {mass}" in text
    assert "found: elbow.armature = " in text
    assert "kept near its value: forearm.first_moment.y, forearm.origin_inertia.xx" in text
    original = (Path(__file__).parents[3] / "urdf" / "arm.urdf").read_text()
    assert text.partition("<robot")[0] == original.partition("<robot")[0]  # the comments at its head


@pytest.mark.parametrize("own", ["", '<dynamics damping="0.5" armature="0.05"/>'])
def test_the_armature_that_was_found_is_in_the_file(own: str, tmp_path: Path) -> None:
    """A disc of 2 kg m^2 and a rotor of 0.25 turn by the torque 2.25 q'': the file had kept 0.05."""
    text = robot_of(link("disc", moment=2.0), joint("axle", "revolute", "ground", "disc", more=own))
    robot = tl.load_robot(text)
    q = np.linspace(-1.0, 1.0, 50)[:, None]
    a = np.sin(9 * q)
    tau = 2.25 * a
    found = identify(robot, np.arange(50) * 0.01, q, 0 * q, tau, ["axle.armature"], a=a)
    path = write_urdf(found, text, tmp_path / "found.urdf")
    again = tl.load_robot(path)
    np.testing.assert_allclose(again.inverse_dynamics(q, 0 * q, a), tau, rtol=0, atol=1e-9)
    assert again.model.damping[0] == robot.model.damping[0]
    assert pin.buildModelFromUrdf(str(path)).nv == 1  # the parser that other programs have takes it


PANDA = tl.load_robot("panda", lock=FINGERS)
T, Q, V, A = motion(PANDA, 60)


def test_links_that_are_fixed_to_a_link_keep_their_own_values(tmp_path: Path) -> None:
    """The body of the last link contains the hand: the link gets what the hand leaves."""
    heavier = PANDA.regressor(Q, V, A) @ (PANDA.parameter_values + 0.1 * np.eye(91)[60])
    found = identify(PANDA, T, Q, V, heavier, ["panda_link7.mass", "panda_link7.first_moment.*"], a=A)
    again = tl.load_robot(write_urdf(found, "panda", tmp_path / "found.urdf"), lock=FINGERS)
    wanted = found.found.parameter_values
    assert wanted[60] - PANDA.parameter_values[60] == pytest.approx(0.1, abs=1e-4)
    np.testing.assert_allclose(again.parameter_values, wanted, rtol=0, atol=1e-12)


def test_a_link_for_which_no_body_is_left_takes_the_mass_of_links_that_are_fixed_to_it(tmp_path: Path) -> None:
    """The flange and the hand together are lighter than the hand of the file: other programs would refuse the rest."""
    lighter = PANDA.parameter_values.copy()
    lighter[60:70] *= 0.5
    names = [f"panda_link7.{kind}" for kind in ("mass", "first_moment.*", "origin_inertia.*")]
    found = identify(PANDA, T, Q, V, PANDA.regressor(Q, V, A) @ lighter, names, a=A)
    path = write_urdf(found, "panda", tmp_path / "found.urdf")
    again = tl.load_robot(path, lock=FINGERS)
    np.testing.assert_allclose(again.parameter_values, found.found.parameter_values, rtol=0, atol=1e-12)
    assert "its mass is in panda_link7, to which it is fixed" in path.read_text("utf-8")
    assert {one.rule for one in tl.lint(path).defects} & {"impossible-inertia", "zero-mass"} == set()


def test_another_robots_source_is_refused() -> None:
    robot = tl.load_robot("arm")
    t, q, v, a = motion(robot, 60)
    found = identify(robot, t, q, v, robot.inverse_dynamics(q, v, a), ["forearm.mass"], a=a)
    with refusal(RobotError, code="other-robot", match="has no link 'forearm'"):
        write_urdf(found, "panda", Path("never.urdf"))
