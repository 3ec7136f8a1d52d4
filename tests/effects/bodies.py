"""Small robots for the tests of events, and a piecewise closed form for bounces."""

from __future__ import annotations

import functools

import numpy as np

import twolink as tl

LIMIT = '<limit lower="-100" upper="100" effort="3" velocity="99"/>'
G = 9.81


def _inertial(mass: float, inertia: float) -> str:
    return (f'<inertial><mass value="{mass}"/><inertia ixx="{inertia}" iyy="{inertia}" izz="{inertia}" ixy="0" '
            f'ixz="0" iyz="0"/></inertial>')  # fmt: skip


def _joint(name: str, kind: str, parent: str, child: str, axis: str) -> str:
    return (f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><axis xyz="{axis}"/>'
            f"{LIMIT}</joint>")  # fmt: skip


def _sliders(**masses: float) -> str:
    return "".join(f'<link name="{n}_link">{_inertial(m, 1.0)}</link>'
                   f"{_joint(n, 'prismatic', 'ground', f'{n}_link', '1 0 0')}" for n, m in masses.items())  # fmt: skip


@functools.cache
def slider() -> tl.Robot:
    """1 kg along x; its effort is limited to 3 N."""
    return tl.load_robot(f'<robot name="slider"><link name="ground"/>{_sliders(x=1.0)}</robot>')


@functools.cache
def sliders(one: float = 1.0, two: float = 2.0) -> tl.Robot:
    """Masses side by side along x, kg: the joints one and two."""
    return tl.load_robot(f'<robot name="sliders"><link name="ground"/>{_sliders(one=one, two=two)}</robot>')


@functools.cache
def planar(inertia: float = 0.1) -> tl.Robot:
    """1 kg in the plane of x and z: x, z and th about -y, of the link body."""
    return tl.load_robot(
        f'<robot name="planar"><link name="ground"/><link name="a"/><link name="b"/><link name="body">'
        f"{_inertial(1.0, inertia)}</link>{_joint('x', 'prismatic', 'ground', 'a', '1 0 0')}"
        f"{_joint('z', 'prismatic', 'a', 'b', '0 0 1')}{_joint('th', 'revolute', 'b', 'body', '0 -1 0')}</robot>"
    )


@functools.cache
def ball() -> tl.Robot:
    """A free homogeneous ball of 2 kg and 0.1 m."""
    return tl.load_robot(f'<robot name="ball"><link name="ball">{_inertial(2.0, 0.008)}</link></robot>', root="free")


@functools.cache
def free_bodies(*names: str) -> tl.Robot:
    """Free bodies of 1 kg and 0.1 kg m^2."""
    bodies = "".join(f'<link name="{n}">{_inertial(1.0, 0.1)}</link><joint name="{n}_joint" type="floating">'
                     f'<parent link="ground"/><child link="{n}"/></joint>' for n in names)  # fmt: skip
    return tl.load_robot(f'<robot name="bodies"><link name="ground"/>{bodies}</robot>')


@functools.cache
def sliders_in_a_row(*masses: float) -> tl.Robot:
    """Links b0, b1, ... of these masses, side by side along x."""
    return tl.load_robot('<robot name="row"><link name="ground"/>'
                         + "".join(f'<link name="b{k}">{_inertial(m, 1.0)}</link>'
                                   + _joint(f"j{k}", "prismatic", "ground", f"b{k}", "1 0 0")
                                   for k, m in enumerate(masses)) + "</robot>")  # fmt: skip


@functools.cache
def ball_over_ball() -> tl.Robot:
    """A free ball of 0.1 m, and one of 1 m that is fixed in the ground."""
    shapes = {"base": 1.0, "ball": 0.1}
    base, body = (f'<collision><geometry><sphere radius="{r}"/></geometry></collision>' for r in shapes.values())
    return tl.load_robot(f'<robot name="balls"><link name="base">{base}</link><link name="ball">{_inertial(2.0, 0.008)}'
                         f'{body}</link><joint name="free" type="floating"><parent link="base"/><child link="ball"/>'
                         f"</joint></robot>")  # fmt: skip


def bouncing(t: np.ndarray, height: float, e: float) -> np.ndarray:
    """The height of a point that falls from rest and bounces, v -> -e v, in closed form."""
    fall = np.sqrt(2 * height / G)
    out = np.where(t < fall, height - 0.5 * G * t**2, 0.0)
    start, speed = fall, e * G * fall
    while speed > 1e-12 * G * fall and start < t[-1]:
        flight = 2 * speed / G
        inside = (t >= start) & (t < start + flight)
        out[inside] = speed * (t[inside] - start) - 0.5 * G * (t[inside] - start) ** 2
        start, speed = start + flight, e * speed
    return out


def kinds(run: tl.Trajectory) -> list[str]:
    """The kinds of a run's events, in order."""
    return [event.kind for event in run.events]


def times(run: tl.Trajectory, kind: str) -> np.ndarray:
    """The times of the events of one kind."""
    return np.array([event.t for event in run.events if event.kind == kind])
