"""Random robots and scenes for the property tests: trees of all joint types, with effects and loops."""

from typing import Any

import numpy as np
import pinocchio as pin

import twolink as tl
from twolink import effects as fx

LOOPED = 3  # degrees of freedom: the portable loops are slow beyond
KINDS = ("revolute", "continuous", "prismatic", "planar", "floating")
_LINK = """<link name="link{k}"><inertial><origin xyz="{com}" rpy="{rpy}"/><mass value="{mass!r}"/>
<inertia ixx="{ixx!r}" iyy="{iyy!r}" izz="{izz!r}" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
_JOINT = """<joint name="joint{k}" type="{kind}"><parent link="link{parent}"/><child link="link{k}"/>
<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>
<limit lower="-1e6" upper="1e6" effort="1e6" velocity="1e6"/></joint>"""


def text(values: Any) -> str:
    return " ".join(repr(float(x)) for x in values)


def random_urdf(random: np.random.Generator, joints: int, kinds: tuple[str, ...]) -> str:
    """A tree of boxes with masses over three decades."""
    parts = ['<link name="link0"><inertial><mass value="1"/>'
             '<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>']  # fmt: skip
    for k in range(1, joints + 1):
        mass, (a, b, c) = float(10 ** random.uniform(-1.5, 1.5)), random.uniform(0.05, 0.5, 3)
        moments = [mass / 12 * float(x) for x in (b * b + c * c, a * a + c * c, a * a + b * b)]
        parts.append(_LINK.format(k=k, com=text(random.uniform(-0.4, 0.4, 3)), rpy=text(random.uniform(-3, 3, 3)),
                                  mass=mass, ixx=moments[0], iyy=moments[1], izz=moments[2]))  # fmt: skip
        axis = random.normal(size=3) if random.random() < 0.5 else np.eye(3)[random.integers(3)]
        kind = str(random.choice(kinds))
        axis = np.array([0.0, 0.0, 1.0]) if kind == "planar" else axis / np.linalg.norm(axis)
        parts.append(_JOINT.format(k=k, kind=kind, parent=k - 1 if random.random() < 0.7 else int(random.integers(k)),
                                   xyz=text(random.uniform(-0.5, 0.5, 3)), rpy=text(random.uniform(-3, 3, 3)),
                                   axis=text(axis)))  # fmt: skip
    return f'<robot name="random">{"".join(parts)}</robot>'


def random_robot(random: np.random.Generator, max_joints: int = 6, kinds: tuple[str, ...] = KINDS) -> tl.Robot:
    """A robot of up to `max_joints` joints; a quarter of them floats."""
    root = "free" if random.random() < 0.25 else "fixed"
    return tl.load_robot(random_urdf(random, int(random.integers(1, max_joints + 1)), kinds), root=root)


def random_state(random: np.random.Generator, robot: tl.Robot, lively: float = 2.0) -> tuple[np.ndarray, np.ndarray]:
    """A state (q, v) with q within 1.5 rad of neutral."""
    q = pin.integrate(robot.model, np.array(robot.neutral), random.uniform(-1.5, 1.5, robot.nv))
    return pin.normalize(robot.model, q), random.uniform(-lively, lively, robot.nv)


def random_effects(random: np.random.Generator, robot: tl.Robot, q: np.ndarray) -> list[Any]:
    """Gravity in four of five scenes, and some of the smooth effects and loops, which are closed at q."""
    angles = [j.name for j in robot.joints if j.kind == "vector"]
    single = [j.name for j in robot.joints if j.v.stop - j.v.start == 1]
    links = [f"link{k}" for k in range(1, robot.model.njoints - (robot.joints[0].name == "root_joint"))]
    effects: list[Any] = [fx.Gravity()] if random.random() < 0.8 else []
    if angles:
        name = str(random.choice(angles))
        effects += [fx.JointSpring({name: 10.0}, {name: 0.3})] if random.random() < 0.4 else []
        effects += [fx.Torque({name: fx.Sampled((0.0, 0.01, 0.03), (1.0, -1.0, 2.0))})] if random.random() < 0.3 else []
    if single:
        name = str(random.choice(single))
        effects += [fx.JointDamping({name: 0.5})] if random.random() < 0.4 else []
        effects += [fx.Torque({name: fx.Sine(2.0, 7.0)})] if random.random() < 0.4 else []
        effects += [fx.SmoothFriction({name: 0.5}, 0.1)] if random.random() < 0.2 else []
    link = str(random.choice(links))
    effects += [fx.FrameWrench(link, (1.0, -2.0, 0.5), axes="frame")] if random.random() < 0.3 else []
    if random.random() < 0.3 and robot.nv <= LOOPED:
        effects.append(_loop(random, robot, q, link))
    return effects


def _loop(random: np.random.Generator, robot: tl.Robot, q: np.ndarray, link: str) -> Any:
    """A point of the link held where it is."""
    model, data = robot.model, robot.model.createData()
    pin.framesForwardKinematics(model, data, q)
    point = random.uniform(-0.3, 0.3, 3)
    here = data.oMf[model.getFrameId(link)].act(point)
    return fx.PointLoop(link, point_a=tuple(point.tolist()), point_b=tuple(here.tolist()))
