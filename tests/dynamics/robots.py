"""Robots with every kind of joint, as the tests of the queries use them."""

import functools

import numpy as np
import pinocchio as pin

import twolink as tl

INERTIAL = (
    '<inertial><origin xyz="0.1 0.05 0.2"/><mass value="1.5"/>'
    '<inertia ixx="0.02" iyy="0.03" izz="0.025" ixy="0.001" ixz="0" iyz="0.002"/></inertial>'
)


def _link(name: str) -> str:
    return f'<link name="{name}">{INERTIAL}</link>'


def _joint(name: str, kind: str, parent: str, child: str, axis: str) -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0.3 -0.1 0.2" rpy="0.3 0.5 -0.2"/><axis xyz="{axis}"/>'
        '<limit lower="-2" upper="2" effort="9" velocity="9"/></joint>'
    )


def planar() -> tl.Robot:
    """A planar base that carries a continuous and a prismatic joint."""
    joints = _joint("base", "planar", "world", "a", "0 0 1") + _joint("turn", "continuous", "a", "b", "0 1 0")
    joints += _joint("slide", "prismatic", "b", "c", "1 0 0")
    return tl.load_robot(f'<robot name="planar"><link name="world"/>{"".join(map(_link, "abc"))}{joints}</robot>')


def chain(n: int = 6) -> tl.Robot:
    """A chain of continuous joints about changing axes."""
    links = "".join(_link(f"l{i}") for i in range(1, n + 1))
    axes = ("0 0 1", "0 1 0", "1 0 0")
    joints = "".join(_joint(f"j{i}", "continuous", f"l{i - 1}", f"l{i}", axes[i % 3]) for i in range(1, n + 1))
    return tl.load_robot(f'<robot name="chain"><link name="l0"/>{links}{joints}</robot>')


def spherical() -> tl.Robot:
    """A ball joint that carries a revolute joint; no URDF can say so."""
    model = pin.Model()
    body = pin.Inertia(1.5, np.array([0.1, 0.05, 0.2]), np.diag([0.02, 0.03, 0.025]))
    ball = model.addJoint(0, pin.JointModelSpherical(), pin.SE3.Random(), "ball")
    hinge = model.addJoint(ball, pin.JointModelRY(), pin.SE3(np.eye(3), np.array([0.2, 0.1, 0.4])), "hinge")
    for joint, name in ((ball, "upper"), (hinge, "lower")):
        model.appendBodyToJoint(joint, body, pin.SE3.Identity())
        model.addBodyFrame(name, joint, pin.SE3.Identity(), 0)
    model.lowerPositionLimit, model.upperPositionLimit = np.full(5, -1.5), np.full(5, 1.5)
    like = tl.load_robot("two_link")
    return tl.Robot("spherical", model, like.report, like.visuals)


@functools.cache
def of_every_kind() -> dict[str, tl.Robot]:
    """Revolute, continuous, planar, prismatic, spherical and free joints; a chain and a humanoid."""
    return {
        "two_link": tl.load_robot("two_link"),
        "chain": chain(),
        "planar": planar(),
        "spherical": spherical(),
        "panda": tl.load_robot("panda"),
        "kinova": tl.load_robot("kinova"),
        "anymal": tl.load_robot("anymal", root="free"),
        "talos": tl.load_robot("talos", root="free"),
    }
