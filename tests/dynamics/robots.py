"""Robots with every kind of joint, as the tests of the queries and of the recursions use them."""

import functools

import numpy as np
import pinocchio as pin

import twolink as tl

_LINK = """<link name="{}"><inertial><origin xyz="0.1 -0.2 0.3" rpy="0.3 0.1 -0.5"/><mass value="{}"/>
<inertia ixx="0.2" ixy="0.01" ixz="-0.02" iyy="0.25" iyz="0.03" izz="0.3"/></inertial></link>"""
_JOINT = """<joint name="j_{1}" type="{2}"><parent link="{0}"/><child link="{1}"/>
<origin xyz="0.3 0.1 -0.2" rpy="0.4 -0.3 0.2"/><axis xyz="{3}"/>
<limit lower="-2" upper="2" effort="9" velocity="9"/>{4}</joint>"""
Joint = tuple[str, str, str, str, str]  # parent link, child link, type, axis, further elements


def urdf(*joints: Joint) -> str:
    """URDF text of a tree of links."""
    links = "".join(_LINK.format(child, n + 1.5) for n, (_, child, *_) in enumerate(joints))
    return f'<robot name="made"><link name="base"/>{links}{"".join(_JOINT.format(*j) for j in joints)}</robot>'


ODD_JOINTS = urdf(
    ("base", "a", "planar", "0 0 1", ""),
    ("a", "b", "prismatic", "0.6 0 0.8", ""),
    ("b", "c", "floating", "0 0 1", ""),
    ("c", "d", "continuous", "0.6 -0.8 0", ""),
    ("c", "e", "prismatic", "0 -1 0", ""),
    ("e", "f", "revolute", "1 2 3", '<dynamics damping="0.7" friction="0"/>'),
    ("a", "g", "continuous", "0 0 1", ""),
)
FOLLOWERS = urdf(
    ("base", "a", "revolute", "0 0.6 0.8", ""),
    ("a", "b", "revolute", "1 0 0", '<mimic joint="j_a" multiplier="-2" offset="0.3"/>'),
    ("b", "c", "prismatic", "0 1 0", ""),
    ("a", "d", "prismatic", "0.6 0 -0.8", '<mimic joint="j_c" multiplier="0.5"/>'),
    ("d", "e", "continuous", "0 0 1", ""),
    ("e", "f", "continuous", "0 1 0", '<mimic joint="j_e" multiplier="3" offset="-0.2"/>'),
)
_PLANAR = urdf(
    ("base", "a", "planar", "0 0 1", ""), ("a", "b", "continuous", "0 1 0", ""), ("b", "c", "prismatic", "1 0 0", "")
)
_CHAIN = urdf(*(("base" if not n else f"l{n}", f"l{n + 1}", "continuous", axis, "")
                for n, axis in enumerate(("0 1 0", "1 0 0", "0 0 1") * 2)))  # fmt: skip


def balls() -> pin.Model:
    """A tree with two ball joints, added depth first."""
    model = pin.Model()
    place = pin.SE3(pin.rpy.rpyToMatrix(0.2, 0.5, -0.4), np.array([0.2, -0.3, 0.5]))
    kinds = (pin.JointModelSpherical(), pin.JointModelRY(), pin.JointModelSpherical(), pin.JointModelPX())
    for n, (parent, kind) in enumerate(zip((0, 1, 2, 1), kinds, strict=True)):
        added = model.addJoint(parent, kind, place, f"j{n}")
        body = pin.Inertia(1.0 + n, np.array([0.1, 0.2, -0.1 * n]), np.diag([0.3, 0.4, 0.35]))
        model.appendBodyToJoint(added, body, pin.SE3.Identity())
    model.armature = np.linspace(0.1, 0.4, model.nv)
    return model


def spherical() -> tl.Robot:
    """The tree with ball joints as a robot; no URDF can say so."""
    model, like = balls(), tl.load_robot("two_link")
    for joint in range(1, model.njoints):
        model.addBodyFrame(f"b{joint}", joint, pin.SE3(pin.rpy.rpyToMatrix(0.3, 0.1, 0), np.full(3, 0.1)), 0)
    model.lowerPositionLimit, model.upperPositionLimit = np.full(model.nq, -1.5), np.full(model.nq, 1.5)
    return tl.Robot("spherical", model, like.report, like.visuals)


MIMICS = ({"continuous"}, {"revolute"}, {"prismatic"}, {"revolute", "prismatic"})  # which kinds follow one another


def above(joints: list[Joint], link: str) -> list[Joint]:
    """The joints between a link and the base."""
    own = [j for j in joints if j[1] == link]
    return own + above(joints, own[0][0]) if own else []


def random_robot(rng: np.random.Generator) -> tl.Robot:
    """A tree of up to seven links with rotors on its joints; axes are skew, or along the coordinates, also negative."""
    joints: list[Joint] = []
    for n in range(rng.integers(1, 8)):
        kind = str(rng.choice(["revolute", "revolute", "continuous", "prismatic", "planar", "floating"]))
        axis = rng.normal(size=3) if rng.random() < 0.5 else rng.choice([-1, 1]) * np.eye(3)[rng.integers(3)]
        axis = np.eye(3)[2] if kind == "planar" else axis / np.linalg.norm(axis)
        parent = str(rng.choice(["base", *(j[1] for j in joints)]))
        leaders = [j for j in above(joints, parent) if {kind, j[2]} in MIMICS and not j[4]]
        follows = ""
        if leaders and rng.random() < 0.5:
            leader = leaders[rng.integers(len(leaders))]
            follows = f'<mimic joint="j_{leader[1]}" multiplier="{rng.uniform(-2, 2)}" offset="{rng.uniform(-1, 1)}"/>'
        joints.append((parent, f"l{n}", kind, " ".join(map(str, axis)), follows))
    robot = tl.load_robot(urdf(*joints), mimic=bool(rng.random() < 0.7))
    turning = [j.name for j in robot.joints if j.v.stop - j.v.start == 1 and j.kind != "mimic"]
    rotors = {name: float(10 ** rng.uniform(-2, 1)) for name in turning}
    return tl.Scene(robot, effects=[tl.effects.Gravity(), tl.effects.Rotor(rotors)]).robot if rotors else robot


@functools.cache
def of_every_kind() -> dict[str, tl.Robot]:
    """Revolute, continuous, planar, prismatic, spherical and free joints; a chain and a humanoid."""
    return {
        "two_link": tl.load_robot("two_link"),
        "chain": tl.load_robot(_CHAIN),
        "planar": tl.load_robot(_PLANAR),
        "spherical": spherical(),
        "panda": tl.load_robot("panda"),
        "kinova": tl.load_robot("kinova"),
        "anymal": tl.load_robot("anymal", root="free"),
        "talos": tl.load_robot("talos", root="free"),
    }
