"""Small robots for the tests of events, and a piecewise closed form for bounces."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import numpy as np

import twolink as tl
from tests.urdf_text import joint, link, robot_of

G = 9.81


def _slider(name: str, mass: float) -> str:
    return link(f"{name}_link", mass) + joint(name, "prismatic", "ground", f"{name}_link", "1 0 0", effort=3.0)


@functools.cache
def slider() -> tl.Robot:
    """1 kg along x; its effort is limited to 3 N."""
    return tl.load_robot(robot_of(_slider("x", 1.0)))


@functools.cache
def sliders(one: float = 1.0, two: float = 2.0) -> tl.Robot:
    """Masses side by side along x, kg: the joints one and two."""
    return tl.load_robot(robot_of(_slider("one", one), _slider("two", two)))


@functools.cache
def sliders_in_a_row(*masses: float) -> tl.Robot:
    """Links b0, b1, ... of these masses, side by side along x."""
    return tl.load_robot(robot_of(*(
        link(f"b{k}", mass) + joint(f"j{k}", "prismatic", "ground", f"b{k}", "1 0 0")
        for k, mass in enumerate(masses))))  # fmt: skip


@functools.cache
def planar(moment: float = 0.1) -> tl.Robot:
    """1 kg in the plane of x and z: x, z and th about -y, of the link body."""
    return tl.load_robot(robot_of(
        '<link name="a"/><link name="b"/>', link("body", 1.0, moment), joint("x", "prismatic", "ground", "a", "1 0 0"),
        joint("z", "prismatic", "a", "b", "0 0 1"), joint("th", "revolute", "b", "body", "0 -1 0")))  # fmt: skip


@functools.cache
def ball(mass: float = 2.0, moment: float | tuple[float, ...] = 0.008) -> tl.Robot:
    """A free body; without other numbers a homogeneous ball of 2 kg and 0.1 m."""
    return tl.load_robot(f'<robot name="ball">{link("ball", mass, moment)}</robot>', root="free")


def above(height: float) -> list[float]:
    """The configuration of a free body over the origin."""
    return [0, 0, height, 0, 0, 0, 1]


def free_body(name: str, mass: float, inertia: float, parent: str = "ground") -> str:
    """A free body, for a URDF."""
    return link(name, mass, inertia) + joint(f"{name}_joint", "floating", parent, name)


@functools.cache
def free_bodies(*names: str, mass: float = 1.0, inertia: float = 0.1) -> tl.Robot:
    """Free bodies."""
    return tl.load_robot(robot_of(*(free_body(name, mass, inertia) for name in names)))


@functools.cache
def ball_over_ball(moment: float | tuple[float, ...] = 0.008) -> tl.Robot:
    """A free ball of 0.1 m, and one of 1 m that is fixed in the ground."""
    shapes = {"base": 1.0, "ball": 0.1}
    base, body = (f'<collision><geometry><sphere radius="{r}"/></geometry></collision>' for r in shapes.values())
    return tl.load_robot(f'<robot name="balls"><link name="base">{base}</link>{link("ball", 2.0, moment, more=body)}'
                         f'{joint("free", "floating", "base", "ball")}</robot>')  # fmt: skip


def spheres(*names: str, radius: float = 0.1) -> dict[str, tuple[tl.effects.Sphere]]:
    """Shapes of a contact: links by name, each a sphere at its origin."""
    return dict.fromkeys(names, (tl.effects.Sphere(radius),))


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


def grounded(robot: tl.Robot, q: Any, v: Any = None, *others: tl.effects.Effect, **law: Any) -> tl.Scene:
    """A scene of bodies that fall on the ground. law: of the contact, and its shapes."""
    return tl.Scene(robot, q, v, [tl.effects.Gravity(), *others, tl.effects.Contact("ground", **law)])


def solved(
    robot: tl.Robot, effects: Sequence[tl.effects.Effect], duration: float, q: Any = None, v: Any = None,
    accuracy: float = 1e-9, **options: Any,
) -> tl.Trajectory:  # fmt: skip
    """The run of a robot with effects."""
    return tl.simulate(tl.Scene(robot, q, v, effects), duration, accuracy=accuracy, **options)


def stepped(scene: tl.Scene, duration: float, step: float, verify: bool = False, samples: float = 20) -> tl.Trajectory:
    """The run with stepped contacts, in steps of one size."""
    return tl.simulate(scene, duration, contact="stepped", step=step, verify=verify, samples_per_second=samples)


def kinds(run: tl.Trajectory) -> list[str]:
    """The kinds of a run's events, in order."""
    return [event.kind for event in run.events]


def times(run: tl.Trajectory, kind: str) -> np.ndarray:
    """The times of the events of one kind."""
    return np.array([event.t for event in run.events if event.kind == kind])
