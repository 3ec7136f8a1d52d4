"""Chains of four-bar linkages, as many as are asked for: URDF text and scene."""

import math

from twolink.dynamics import load_robot
from twolink.effects import Effect, Gravity, PointLoop
from twolink.scenes import Scene

G = 9.81


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
