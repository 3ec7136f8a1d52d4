"""Robots as MJCF: read back by MuJoCo and by us, they are the same."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

import twolink as tl
from tests.robots.test_mjcf import ASSETS, EVERYTHING, LOOPS
from twolink.errors import RobotError
from twolink.parts.exchange.mjcf_text import mjcf_text

LOOP = LOOPS.format('<weld body1="c" body2="b" anchor=".1 0 .3"/><connect body1="c" body2="a" anchor="1 0 0"/>'
                    '<joint joint1="p" joint2="q" polycoef=".1 .5 0 0 0"/>')  # fmt: skip
SOURCES = {"ur5": "ur5", "panda": "panda", "everything": EVERYTHING, "loops": LOOP, "ant": ASSETS / "ant.xml"}


@pytest.mark.parametrize("name", SOURCES)
def test_what_is_read_back_is_equal(name: str, tmp_path: Path) -> None:
    robot = tl.load_robot(SOURCES[name])
    found = tl.compare_models(robot, robot.export_mjcf(tmp_path / "out.xml"))
    assert [str(d) for d in found.differences if d.what != "velocity limit"] == []
    assert max(found.dynamics.values()) < 1e-12
    assert len(found.joints) == len(robot.joints)


def test_mujoco_reads_the_same_mass_matrix() -> None:
    robot = tl.load_robot("ur5")
    model = mujoco.MjModel.from_xml_string(mjcf_text(robot))
    data, full = mujoco.MjData(model), np.zeros((6, 6))
    data.qpos[:] = np.linspace(-1, 1, 6)
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, full, data.qM) if hasattr(data, "qM") else mujoco.mj_fullM(model, data, full)
    np.testing.assert_allclose(full, robot.mass_matrix(data.qpos), atol=1e-12)


@pytest.mark.parametrize(("old", "new", "what"), [
    ('stiffness="3.0"', 'stiffness="4.0"', "joint-spring"), ('armature="0.4"', 'armature="0.5"', "armature"),
    ('gravcomp="0.7"', 'gravcomp="0.6"', "gravity-compensation"), ('damping="0.1"', "", "damping"),
    ("<site name=\"b0\" pos=\"0.1", "<site name=\"b0\" pos=\"0.2", "weld-loop"),
    ("polycoef=\"0.", "polycoef=\"1.", "mimic"),
])  # fmt: skip
def test_a_change_is_found(old: str, new: str, what: str) -> None:
    robot = tl.load_robot(LOOP if what in ("weld-loop", "mimic") else EVERYTHING)
    text = mjcf_text(robot)
    assert old in text
    assert what in {d.what for d in tl.compare_models(robot, text.replace(old, new, 1)).differences}


def test_a_joint_that_follows_a_locked_one_is_no_difference() -> None:
    assert tl.compare_models(*(tl.load_robot(LOOP, lock={"q": 0.1}) for _ in range(2))).equal


def test_damping_of_a_free_body_and_couplings_are_written(tmp_path: Path) -> None:
    """MuJoCo's free joint has the damping; a URDF has a coupling as <mimic>."""
    text = """<mujoco><worldbody><body name="b"><joint name="j" type="free" damping="0.7"/><geom size=".1"/></body>
    </worldbody></mujoco>"""
    robot = tl.load_robot(text)
    assert robot.model.damping.tolist() == [0.7] * 6
    written = mjcf_text(robot)
    assert tl.load_robot(written).model.damping.tolist() == [0.7] * 6
    assert mujoco.MjModel.from_xml_string(written).dof_damping.tolist() == [0.7] * 6
    coupled = tl.load_robot(LOOP)
    again = tl.load_robot(coupled.export_urdf(tmp_path / "r.urdf"))
    whats = {d.what for d in tl.compare_models(coupled, again).differences}
    assert "weld-loop" in whats
    assert "mimic" not in whats


def test_a_limit_on_one_side_holds_in_mujoco_too() -> None:
    """A slider without gravity comes to its end one way, and moves on the other."""
    robot = tl.load_robot("""<robot name="s"><link name="a"/><link name="b"><inertial><mass value="2"/>
        <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="s" type="prismatic">
        <parent link="a"/><child link="b"/><limit lower="-.5" upper="1e31" effort="9" velocity="3"/></joint></robot>""",
        gravity=(0, 0, 0))  # fmt: skip
    written = mjcf_text(robot)
    (again,) = tl.load_robot(written).joints
    assert (again.lower, again.upper) == ((-0.5,), (np.inf,))
    model = mujoco.MjModel.from_xml_string(written)
    ends = []
    for speed in (3.0, -3.0):
        data = mujoco.MjData(model)
        data.qvel[:] = speed
        mujoco.mj_step(model, data, round(2.0 / model.opt.timestep))
        ends.append(float(data.qpos[0]))
    assert ends[0] == pytest.approx(6.0)
    assert ends[1] > -0.6


def test_gravity_compensation_has_the_number_of_the_file() -> None:
    """The force is multiplied and divided by mass and gravity again, and rounds on the way."""
    text = """<mujoco><option gravity="{} {} -9.81"/><worldbody><body name="a" gravcomp="{}"><joint axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0 0 {}" size=".03"/></body></worldbody></mujoco>"""
    rng = np.random.default_rng(7)
    for share in [*np.linspace(0.05, 1, 20).round(2), 1.25, 0.333333]:
        x, y, length = rng.uniform(-3, 3, 3)
        robot = tl.load_robot(text.format(x, y, share, length), gravity=(0, 0, -1.62) if share < 0.5 else None)
        assert f'gravcomp="{float(share)!r}"' in mjcf_text(robot)


def test_what_an_mjcf_cannot_hold_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RobotError, match=r"upper_arm.*thin rods"):
        tl.load_robot("two_link").export_mjcf(tmp_path / "out.xml")
