"""Closed loops: dead centres, bifurcations, redundant and nearly redundant ones, and chains of four-bar linkages."""

import functools
import math

import numpy as np

from twolink.dynamics import Robot, load_robot
from twolink.effects import Effect, Gravity, HingeLoop, PointLoop
from twolink.hard import truths
from twolink.hard.case import FOLDER, ErrorFunction, StateHistory
from twolink.scenes import Scene

G = 9.81


def four_bars(number: int) -> ErrorFunction:
    """Four-bars in a row move as one compound pendulum; q alternates between the angle of a vertical link and minus it.

    The links are 1 m and 1 kg each: number + 1 vertical ones, `number` horizontal ones.
    """
    inertia, pull = (number + 1) / 3 + number, (number + 1) / 2 + number
    factors = [(-1.0) ** k for k in range(2 * number + 1)]
    return truths.configuration_error(truths.whirl(1.0, math.sqrt(pull / inertia * G), factors))


def _crank(robot: Robot, track: StateHistory) -> np.ndarray:
    """The error of the crank's angle at the three times that the quadrature gives."""
    exact = truths.at_table_times([0.5, 1.0, 3.0], [[4.073130130354], [14.12789221775], [121.8862775082]])
    crank = next(j for j in robot.joints if j.name == "crank_joint").q
    return np.asarray(np.abs(track.q[:, crank] - exact(track.t))[:, 0])


def _tilted_hinge(tilt: float) -> Scene:
    """The single four-bar, closed by a hinge with a tilted axis [rad] instead of a point: three redundant rows."""
    robot = load_robot(str(FOLDER / "parallelogram.urdf"))
    loop = HingeLoop(a="coupler", b="right_link", axis_a=(0.0, 0.0, 1.0), axis_b=(tilt, 0.0, 1.0),
                     point_a=(1.0, 0.0, 0.0), point_b=(1.0, 0.0, 0.0))  # fmt: skip
    start, spin = [math.pi / 2, -math.pi / 2, math.pi / 2], [-1.0, 1.0, -1.0]
    return Scene(robot, start, spin, effects=[Gravity((0.0, -G, 0.0)), loop], duration=10.0)


SCENES = {
    "redundant-hinge": functools.partial(_tilted_hinge, 0.0),
    "misaligned-hinge": functools.partial(_tilted_hinge, 1e-8),
}
ERRORS = {
    "four-bar-singular": four_bars(2),
    **dict.fromkeys(("parallelogram", "redundant-hinge", "misaligned-hinge"), four_bars(1)),
    "dead-centres": _crank,
    "bricard": truths.energy_error(25.0),
}


def row_of_four_bars(number: int, angle: float = math.pi / 2, speed: float = -1.0, *, length: float = 1.0) -> Scene:
    """Four-bars side by side (IFToMM benchmark A02), with 2 number + 1 degrees of freedom of which one is left.

    Parameters
    ----------
    number : int
        Of four-bars. Neighbours share the link between them.
    angle, speed : float
        Of the vertical links at the start, rad from the x axis, and rad/s.
    length : float
        Of the links, m; all are uniform, thin and of 1 kg.
    """
    width = len(str(number))
    links, joints = [_BASE], list[str]()
    effects: list[Effect] = [Gravity((0.0, -G, 0.0))]
    for k in range(number + 1):
        links.append(_link(f"link_{k:0{width}}", length))
        joints.append(_joint(f"j{k:0{width}}", "base", f"link_{k:0{width}}", k * length))
    for k in range(number):
        one, other, top = f"link_{k:0{width}}", f"link_{k + 1:0{width}}", f"top_{k:0{width}}"
        links.append(_link(top, length))
        joints.append(_joint(f"t{k:0{width}}", one, top, length))
        effects.append(PointLoop(a=top, b=other, point_a=(length, 0.0, 0.0), point_b=(length, 0.0, 0.0)))
    robot = load_robot(_robot("row_of_four_bars", links, joints))
    signs = [1.0 if name.startswith("j") else -1.0 for name in robot.joint_names]
    start, turning = [angle * sign for sign in signs], [speed * sign for sign in signs]
    return Scene(robot, start, turning, effects=effects, title=f"A row of {number} four-bars")


def pendulum_of_row(number: int, angle: float = math.pi / 2, speed: float = -1.0) -> Scene:
    """The pendulum that moves as the vertical links of such a row of links of 1 m, without loops.

    Of number + 1 turning rods and as many as `number` that only translate, on their ends: I = (number + 1) / 3 + number
    and m r = (number + 1) / 2 + number.
    """
    mass = 2.0 * number + 1.0
    arm = ((number + 1) / 2 + number) / mass
    across = (number + 1) / 3 + number - mass * arm**2
    link = (f'<link name="rod"><inertial><origin xyz="{arm!r} 0 0"/><mass value="{mass!r}"/><inertia ixx="{across!r}" '
            f'iyy="{across!r}" izz="{across!r}" ixy="0" ixz="0" iyz="0"/></inertial></link>')  # fmt: skip
    robot = load_robot(_robot("pendulum", [_BASE, link], [_joint("j", "base", "rod", 0.0)]))
    return Scene(robot, [angle], [speed], effects=[Gravity((0.0, -G, 0.0))])


def hanging_four_bars(number: int, angle: float = -1.0, *, right_length: float = 1.0) -> Scene:
    """Four-bars below each other, with 3 number degrees of freedom of which `number` are left.

    Parameters
    ----------
    number : int
        Of four-bars. Each hangs by two links on the bar that joins the ends of the two above.
    angle : float
        Of these links at the start, rad from the x axis.
    right_length : float
        Of the right ones, m; with 1, as all others have, the bars keep level. The start is closed by the loops.
    """
    width = len(str(number))
    links, joints = [_BASE], list[str]()
    effects: list[Effect] = [Gravity((0.0, -G, 0.0))]
    above, start = "base", dict[str, float]()
    for k in range(number):
        left, right, bar = (f"{kind}_{k:0{width}}" for kind in ("left", "right", "bar"))
        links += [_link(left, 1.0), _link(right, right_length), _link(bar, 1.0)]
        joints += [_joint(f"l{k:0{width}}", above, left, 0.0), _joint(f"r{k:0{width}}", above, right, 1.0),
                   _joint(f"b{k:0{width}}", left, bar, 1.0)]  # fmt: skip
        start |= {f"l{k:0{width}}": angle, f"r{k:0{width}}": angle, f"b{k:0{width}}": -angle}
        effects.append(PointLoop(a=bar, b=right, point_a=(1.0, 0.0, 0.0),
                                 point_b=(right_length, 0.0, 0.0)))  # fmt: skip
        above = bar
    robot = load_robot(_robot("hanging_four_bars", links, joints))
    return Scene(robot, [start[name] for name in robot.joint_names], effects=effects,
                 title=f"{number} four-bars below each other")  # fmt: skip


_BASE = '<link name="base"/>'


def _link(name: str, length: float) -> str:
    """A thin uniform rod of 1 kg along x."""
    across = repr(length**2 / 12)
    return (f'<link name="{name}"><inertial><origin xyz="{length / 2!r} 0 0"/><mass value="1"/><inertia ixx="0" '
            f'iyy="{across}" izz="{across}" ixy="0" ixz="0" iyz="0"/></inertial></link>')  # fmt: skip


def _joint(name: str, parent: str, child: str, x: float) -> str:
    return (f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{x!r} 0 0"/><axis xyz="0 0 1"/>'
            '<limit lower="-1000" upper="1000" effort="1000" velocity="1000"/></joint>')  # fmt: skip


def _robot(name: str, links: list[str], joints: list[str]) -> str:
    return f'<robot name="{name}">{"".join((*links, *joints))}</robot>'
