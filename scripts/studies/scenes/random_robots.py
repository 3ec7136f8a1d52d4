"""Random robots and scenes for studies: chains and trees of rigid bodies as URDF text."""

import numpy as np

import twolink as tl

# The probability of each number of joints: compiling takes longer for more of them.
SIZES = {2: 0.3, 3: 0.3, 4: 0.25, 5: 0.07, 6: 0.05, 7: 0.03}
KINDS = {"revolute": 0.55, "continuous": 0.25, "prismatic": 0.2}
FLOATING = 0.15  # the share of robots with a floating base, which have 1 or 2 joints in addition
GRAVITY = 0.8

LIMIT = '<limit lower="-1e6" upper="1e6" effort="1e6" velocity="1e6"/>'


def random_scene(
    random: np.random.Generator,
    sizes: dict[int, float] | None = None,
    floating: float = FLOATING,
    kinds: dict[str, float] | None = None,
) -> tuple[tl.Scene, str]:
    """A scene, and its robot in words.

    sizes, kinds: the probability of each number of joints, and of each kind. floating: that of a floating base.
    """
    sizes = SIZES if sizes is None else sizes
    base = bool(random.random() < floating)
    joints = int(random.integers(1, 3)) if base else int(random.choice(list(sizes), p=list(sizes.values())))
    text, chosen = random_urdf(random, joints, base=base, kinds=kinds or KINDS)
    robot = tl.load_robot(text, root="free" if base else "fixed")
    lively = random.uniform(0.0, 3.0)
    q = robot.neutral + 0.0
    for joint in robot.joints:
        if joint.kind == "vector":
            q[joint.q] = random.uniform(-1.5, 1.5)
        elif joint.kind == "cos-sin":
            angle = random.uniform(-np.pi, np.pi)
            q[joint.q] = [np.cos(angle), np.sin(angle)]
    v = random.uniform(-1, 1, robot.nv) * lively
    effects = [tl.effects.Gravity()] if random.random() < GRAVITY else []
    name = ("float " if base else "") + "".join(kind[0] for kind in chosen)
    return tl.Scene(robot, q, v, effects=effects), name + ("" if effects else " no gravity")


def random_urdf(
    random: np.random.Generator, joints: int, *, base: bool, kinds: dict[str, float]
) -> tuple[str, list[str]]:
    """The text of a URDF with this number of joints, and their kinds. base: whether the first link has a mass."""
    text = _link(random, "link0") if base else '<link name="link0"/>'
    chosen: list[str] = []
    for i in range(1, joints + 1):
        chosen.append(str(random.choice(list(kinds), p=list(kinds.values()))))
        parent = i - 1 if random.random() < 0.7 else int(random.integers(0, i))
        text += f"""{_link(random, f"link{i}")}<joint name="joint{i}" type="{chosen[-1]}">
<parent link="link{parent}"/><child link="link{i}"/><origin xyz="{_numbers(random.uniform(-0.5, 0.5, 3))}"
rpy="{_numbers(_angles(random))}"/><axis xyz="{_axis(random)}"/>{LIMIT if chosen[-1] != "continuous" else ""}</joint>"""
    return f'<robot name="random">{text}</robot>', chosen


def _link(random: np.random.Generator, name: str) -> str:
    """A solid box, so that the inertia is that of a real body."""
    a, b, c = random.uniform(0.05, 0.5, 3)
    mass = random.uniform(0.3, 3.0)
    ixx, iyy, izz = mass / 12 * np.array([b * b + c * c, a * a + c * c, a * a + b * b])
    return f"""<link name="{name}"><inertial><origin xyz="{_numbers(random.uniform(-0.4, 0.4, 3))}"
rpy="{_numbers(_angles(random))}"/><mass value="{mass:.6f}"/>
<inertia ixx="{ixx:.9f}" iyy="{iyy:.9f}" izz="{izz:.9f}" ixy="0" ixz="0" iyz="0"/></inertial></link>"""


def _axis(random: np.random.Generator) -> str:
    if random.random() < 0.6:
        return ("1 0 0", "0 1 0", "0 0 1", "0 -1 0")[int(random.integers(4))]
    axis = random.normal(size=3)
    return _numbers(axis / np.linalg.norm(axis), 9)


def _angles(random: np.random.Generator) -> np.ndarray:
    return np.zeros(3) if random.random() < 0.4 else random.uniform(-np.pi, np.pi, 3)


def _numbers(values: np.ndarray, digits: int = 6) -> str:
    return " ".join(f"{value:.{digits}f}" for value in values)
