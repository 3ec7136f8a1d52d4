"""What bounces too low to follow comes to rest at once: stops, contacts, and several that are coupled."""

import functools
import itertools

import numpy as np
import pytest

import twolink as tl
from tests.effects.bodies import kinds

E = tl.effects
LINK = ('<link name="{n}"><inertial><origin xyz="0 0 {c}"/><mass value="{m}"/><inertia ixx="{i}" iyy="{i}" izz="{i}" '
        'ixy="0" ixz="0" iyz="0"/></inertial></link>')  # fmt: skip
JOINT = ('<joint name="{n}" type="{k}"><origin xyz="0 0 {z}"/><parent link="{p}"/><child link="{c}"/><axis xyz="{a}"/>'
         '<limit lower="-9" upper="9" effort="99" velocity="99"/></joint>')  # fmt: skip


@functools.cache
def hand() -> tl.Robot:
    """A cart of 2 kg along x with two fingers, 1 kg and 0.5 kg, that slide along x on it."""
    joints = [("cart", "world", 2.0), ("left", "cart_link", 1.0), ("right", "cart_link", 0.5)]
    text = "".join(
        LINK.format(n=f"{n}_link", c=0, m=m, i=1.0)
        + JOINT.format(n=n, k="prismatic", z=0, p=p, c=f"{n}_link", a="1 0 0")
        for n, p, m in joints
    )
    return tl.load_robot(f'<robot name="hand"><link name="world"/>{text}</robot>')


def pressed(restitution: float) -> tl.Scene:
    """Forces press both fingers towards each other against stops: each impact throws the other one off."""
    stops = E.JointStops({"left": (-1.0, 0.1), "right": (-0.1, 1.0)}, restitution=restitution)
    return tl.Scene(hand(), [0.0, 0.0, 0.2], [0.3, 0.5, 0.0],
                    [E.Torque({"left": 5.0, "right": -3.0}), stops])  # fmt: skip


@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_fingers_that_throw_each_other_off_come_to_rest(restitution: float) -> None:
    """Only internal forces act: the momentum stays, and at the end all three move as one."""
    run = tl.simulate(pressed(restitution), 6.0)
    assert run.q[-1, 1:].tolist() == [0.1, -0.1]
    assert run.v[-1] == pytest.approx([1.55 / 3.5, 0.0, 0.0], abs=1e-6)
    moments = run.q @ [3.5, 1.0, 0.5]
    assert np.abs(moments - moments[0] - 1.55 * run.t).max() < 3e-6
    assert len(run.events) < (40 if not restitution else 400)


@pytest.mark.slow
def test_an_arm_whose_tip_slides_rests_at_its_stop() -> None:
    """Tip and stop hold the arm more than once: two rows for one joint. Small steps agree that it stays there."""
    stop = 0.5072309610463079
    text = (LINK.format(n="l0", c=-0.151, m=0.7244, i=0.0055) + LINK.format(n="l1", c=-0.2038, m=1.6564, i=0.0229)
            + JOINT.format(n="j0", k="revolute", z=1, p="world", c="l0", a="0 1 0")
            + JOINT.format(n="j1", k="revolute", z=-0.3119, p="l0", c="l1", a="0 1 0"))  # fmt: skip
    ball = E.Sphere(0.0458, point=(0.0, 0.0, -0.4076))
    floor = E.Contact((("l1", E.Plane(height=0.38856)),), friction=0.3, shapes={"l1": (ball,)})
    effects = [E.Gravity(), floor, E.JointStops({"j1": (0.147, stop)}, restitution=0.5)]
    scene = tl.Scene(tl.load_robot(f'<robot name="arm"><link name="world"/>{text}</robot>'), [0.662, 0.3273],
                     [-2.0, 1.6446], effects)  # fmt: skip
    run = tl.simulate(scene, 0.75)
    assert run.q[-1, 1] == stop
    assert np.abs(run.v[-1]).max() == 0.0
    assert "roll" in kinds(run)
    small = tl.simulate(scene, 0.75, contact="stepped", step=2e-3, verify=False)
    assert run.q[-1] == pytest.approx(small.q[-1], abs=5e-3)


def test_a_joint_that_hardly_leaves_its_stop_stays() -> None:
    """A speed of 1e-10 lifts it by less than numbers show: it is at rest, and nothing is hit without end."""
    robot = tl.load_robot(
        '<robot name="one"><link name="world"/>'
        + LINK.format(n="a", c=0, m=1.0, i=1.0)
        + JOINT.format(n="x", k="prismatic", z=0, p="world", c="a", a="1 0 0")
        + "</robot>"
    )
    for restitution in (0.0, 0.5, 1.0):
        stops = E.JointStops({"x": (0.0, 5.0)}, restitution=restitution)
        run = tl.simulate(tl.Scene(robot, [0.0], [1e-10], [E.Torque({"x": -9.0}), stops]), 1.0)
        assert run.q[-1, 0] == 0.0
        assert len(run.events) <= 2


@functools.cache
def chain() -> tl.Robot:
    """Three rods that hang from each other, with axes that alternate."""
    axes = ("0 1 0", "1 0 0", "0 1 0")
    names = itertools.pairwise(["world", "a", "b", "c"])
    text = "".join(LINK.format(n=c, c=-0.2, m=1.0, i=0.02)
                   + JOINT.format(n=f"j{c}", k="revolute", z=-0.4 * (c != "a"), p=p, c=c, a=axis)
                   for (p, c), axis in zip(names, axes, strict=True))  # fmt: skip
    return tl.load_robot(f'<robot name="chain"><link name="world"/>{text}</robot>')


@pytest.mark.some(1)
@pytest.mark.parametrize("restitution", [0.0, 0.6])
def test_energy_of_an_arm_in_its_stops_with_friction_balances(restitution: float) -> None:
    """Stops on all joints near the start, dry friction and damping: what is stored, lost and dissipated adds up."""
    names = ["ja", "jb", "jc"]
    effects = [E.Gravity(), E.JointDamping(dict.fromkeys(names, 0.05)), E.DryFriction(dict.fromkeys(names, 0.1)),
               E.JointStops(dict.fromkeys(names, (-0.3, 0.25)), restitution=restitution)]  # fmt: skip
    scene = tl.Scene(chain(), [0.1, 0.2, -0.2], [2.0, -1.0, 3.0], effects)
    run = tl.simulate(scene, 1.5, accuracy=1e-8)
    assert len(run.events) > 10
    book = tl.energy_book(scene, run)
    assert np.abs(book.residual).max() < 1e-6
    assert (np.diff(run.energy) < 1e-7).all()
