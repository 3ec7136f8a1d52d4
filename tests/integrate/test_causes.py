"""Failures name the joints that cause them, and long trial steps of SciPy's explicit methods are no failures."""

import re

import numpy as np
import pytest

import twolink as tl
from tests.integrate.test_stiffness import DAMPING, SPEED, wheel_and_cart
from twolink.errors import AccuracyError

E = tl.effects
LINK = """<link name="{0}"><inertial><mass value="{1}"/>
<inertia ixx="{2}" iyy="{2}" izz="{2}" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """<joint name="{0}" type="continuous"><parent link="{1}"/><child link="{2}"/><axis xyz="{3}"/></joint>"""
ANGLES = """<robot name="ball joint"><link name="base"/><link name="one"/><link name="two"/>{}{}{}{}</robot>""".format(
    LINK.format("body", 1.0, 0.1), JOINT.format("yaw", "base", "one", "0 0 1"),
    JOINT.format("pitch", "one", "two", "0 1 0"), JOINT.format("roll", "two", "body", "1 0 0"))  # fmt: skip


def gimbal(pitch: float, **options: object) -> tl.Scene:
    """A body on three axes that cross, without masses between them: at a pitch of 90 deg two axes are one."""
    robot = tl.load_robot(re.sub('type="continuous"', 'type="revolute"', ANGLES).replace(
        "</joint>", '<limit lower="-9" upper="9" effort="1" velocity="1"/></joint>'))  # fmt: skip
    return tl.Scene(robot, [0.3, pitch, -0.2], **options)


@pytest.mark.parametrize("method", ["dop853", "esdirk43"])
def test_gimbal_lock_is_named(method: str) -> None:
    """Pushed against its damping into the position where yaw and roll turn about one axis."""
    damping = E.JointDamping({"yaw": 0.1, "pitch": 0.1, "roll": 0.1})
    scene = gimbal(1.4, v=[1.0, 2.0, -1.0], effects=[damping])
    with pytest.raises(AccuracyError, match="joints 'yaw', 'roll' can move without moving a mass") as caught:
        tl.simulate(scene, 2.0, method=method, verify=False)
    assert caught.value.data["t"] < 0.2
    assert "armature" in str(caught.value)


def test_a_start_in_gimbal_lock_is_named() -> None:
    with pytest.raises(AccuracyError, match="joints 'yaw', 'roll' can move without moving a mass"):
        tl.simulate(gimbal(np.pi / 2, v=[1.0, 0.0, 0.0]), 1.0, method="dop853")


def test_a_load_that_is_not_finite_is_named() -> None:
    spring = E.SpringBetween("rail", "cart", stiffness=30.0, rest_length=1.0)
    scene = tl.Scene(wheel_and_cart().robot, [0.0, 0.0], [0.0, 1.0], effects=[spring])
    with pytest.raises(AccuracyError, match="load of effects on joint"):
        tl.simulate(scene, 1.0, method="dop853")


def test_a_trial_step_that_overflows_is_shortened() -> None:
    """w = w0 exp(-d t / I): in stages of a long step the speed grows beyond all numbers."""
    scene = wheel_and_cart(1e-6)
    run = tl.simulate(scene, 1e-3, method="scipy-dop853")
    rate = DAMPING / 1e-6
    exact = SPEED / rate * -np.expm1(-rate * run.t)
    assert (np.abs(run.q[:, 1] - exact) <= run.error).all()
