"""Robots of these tests."""

import pytest


@pytest.fixture(scope="session")
def pendulum_urdf() -> str:
    """A point mass of 2 kg at 0.5 m, hinged."""
    return """<robot name="pendulum"><link name="base"/><link name="bob"><inertial><origin xyz="0 0 -0.5"/>
<mass value="2"/><inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="revolute"><parent link="base"/><child link="bob"/><axis xyz="0 1 0"/>
<limit lower="-99" upper="99" effort="99" velocity="99"/></joint></robot>"""
