"""Four-bar linkages side by side and below each other."""

import math

import twolink as tl
from tests.urdf_text import joint, link, robot_of
from twolink.effects import Effect, Gravity, PointLoop

G = 9.81
DOWN = Gravity((0.0, -G, 0.0))


def rod(name: str, mass: float = 1.0, length: float = 1.0) -> str:
    """A thin uniform rod along x."""
    moment = mass * length**2 / 12
    return link(name, mass, (0.0, moment, moment), f"{length / 2!r} 0 0")


def hinge(name: str, parent: str, child: str, x: float) -> str:
    return joint(name, "revolute", parent, child, more=f'<origin xyz="{x!r} 0 0"/>')


def row_of_four_bars(number: int, angle: float = math.pi / 2, speed: float = -1.0) -> tl.Scene:
    """Four-bars side by side (IFToMM benchmark A02), with 2 number + 1 degrees of freedom of which one is left.

    All links are of 1 m and 1 kg, neighbours share the one between them; angle and speed are those of the vertical ones
    at the start, rad from the x axis, and rad/s.
    """
    parts = [rod(f"link_{k}") + hinge(f"j{k}", "ground", f"link_{k}", float(k)) for k in range(number + 1)]
    parts += [rod(f"top_{k}") + hinge(f"t{k}", f"link_{k}", f"top_{k}", 1.0) for k in range(number)]
    loops = [PointLoop(f"top_{k}", f"link_{k + 1}", (1.0, 0.0, 0.0), (1.0, 0.0, 0.0)) for k in range(number)]
    robot = tl.load_robot(robot_of(*parts))
    signs = [1.0 if name.startswith("j") else -1.0 for name in robot.joint_names]
    return tl.Scene(robot, [angle * sign for sign in signs], [speed * sign for sign in signs], [DOWN, *loops])


def pendulum_of_row(number: int, angle: float, speed: float) -> tl.Scene:
    """The pendulum that moves as the vertical links of such a row, without loops.

    Of number + 1 turning rods and as many as `number` that only translate, on their ends: I = (number + 1) / 3 + number
    and m r = (number + 1) / 2 + number.
    """
    mass = 2.0 * number + 1.0
    arm = ((number + 1) / 2 + number) / mass
    across = (number + 1) / 3 + number - mass * arm**2
    robot = tl.load_robot(robot_of(link("rod", mass, across, f"{arm!r} 0 0"), hinge("j", "ground", "rod", 0.0)))
    return tl.Scene(robot, [angle], [speed], [DOWN])


def hanging_four_bars(number: int, right_length: float) -> tl.Scene:
    """Four-bars below each other, with 3 number degrees of freedom of which `number` are left.

    Each hangs by two links on the bar that joins the ends of the two above. With other right ones than of 1 m the bars
    do not keep level, and the start is closed by the loops.
    """
    parts, loops, above, start = list[str](), list[Effect](), "ground", dict[str, float]()
    for k in range(number):
        left, right, bar = f"left_{k}", f"right_{k}", f"bar_{k}"
        parts += [rod(left), rod(right, length=right_length), rod(bar), hinge(f"l{k}", above, left, 0.0),
                  hinge(f"r{k}", above, right, 1.0), hinge(f"b{k}", left, bar, 1.0)]  # fmt: skip
        start |= {f"l{k}": -1.0, f"r{k}": -1.0, f"b{k}": 1.0}
        loops.append(PointLoop(bar, right, (1.0, 0.0, 0.0), (right_length, 0.0, 0.0)))
        above = bar
    return tl.Scene(tl.load_robot(robot_of(*parts)), start, effects=[DOWN, *loops])
