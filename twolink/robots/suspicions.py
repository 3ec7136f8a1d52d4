"""Suspicious numbers of a robot that can be loaded: units, masses and inertias out of all proportion.

Each statement has the value, the reason and the remedy. The thresholds are far beyond the published robots: of the
catalogue's, no limit but a symmetric power of ten (which stands for "none") is beyond 10 rad, no link has more than 8
times the mass of all links before it, and no radius of gyration is more than 1.6 times the size of its robot.
"""

import math
from collections.abc import Iterator

import numpy as np
import pinocchio as pin

from twolink.robots.load_report import Finding
from twolink.robots.tree import Tree
from twolink.robots.urdf import UrdfJoint, UrdfLink
from twolink.robots.xml import Element

_ROUNDED = 0.1  # rad: of turns that a file rounds
_REACH = 4 * math.pi + _ROUNDED  # rad: joints that turn twice to either side are no surprise
_FAR = 1000.0  # rad: so many mean that there is no limit
_LENGTH = 100.0  # m
HEAVY = 20.0  # times the mass of what carries it
_WIDE = 3.0  # radius of gyration in sizes of the robot
Suspicion = tuple[str, str, str]  # the rule, the link or joint, the statement
_SMALL = 0.05  # m: robots whose joints are nearer to each other have no size to compare with


def suspicious(tree: Tree, model: pin.Model) -> list[Finding]:
    """The statements of a load report of the kind "suspicious". model: of the whole tree, before joints are locked."""
    statements: dict[tuple[str, str], list[str]] = {}
    for rule, name, what in (*_lengths(tree), *_angles(tree), *_limits(tree), *_inertias(tree, model)):
        statements.setdefault((rule, what), []).append(name)
    missing = ("no mass, though they move, are visible and have no <inertial>: their inertia is missing; give them "
               'one, or <mass value="0"/> where that is meant')  # fmt: skip
    bodies = _without_inertial(tree, model).values()
    statements[("no-inertial", missing)] = [link.name for links in bodies for link in links if _has_shape(link)]
    return [Finding("suspicious", what, tuple(names), rule) for (rule, what), names in statements.items() if names]


def between_joints(tree: Tree, model: pin.Model) -> list[Finding]:
    """The statement on links that carry moving links and have neither <inertial> nor shape.

    Most are meant: they join the joints of a compound one, such as slides along x, y and z.
    """
    carriers = set(model.parents)
    names = tuple(links[0].name for j, links in _without_inertial(tree, model).items()
                  if j in carriers and not any(map(_has_shape, links)))  # fmt: skip
    what = "no <inertial> and no shape: taken as massless, as a link between joints; give what is a body an <inertial>"
    return [Finding("assumed", what, names, "no-inertial")] if names else []


def too_heavy(mass: float, carried_by: float) -> str:
    """A statement on a mass [kg] suspiciously large for those that carry it; "" if it is not."""
    if not mass > HEAVY * carried_by > 0:
        return ""
    grams = " (in grams it would be " + f"{mass / 1000:g} kg)" if mass >= 100 else ""
    return f"a mass of {mass:g} kg, {mass / carried_by:.0f} times the {carried_by:.3g} kg that carry it{grams}; give kg"


def _without_inertial(tree: Tree, model: pin.Model) -> dict[int, list[UrdfLink]]:
    """By the index of the joint that moves it, the links of each body without any <inertial>."""
    return {j: links for j, links in _bodies(tree, model).items() if not any(link.has_inertial for link in links)}


def _has_shape(link: UrdfLink) -> bool:
    return bool(link.element.first("visual") or link.element.first("collision"))


def _bodies(tree: Tree, model: pin.Model) -> dict[int, list[UrdfLink]]:
    """By the index of the joint that moves it, each body's links."""
    bodies: dict[int, list[UrdfLink]] = {}
    for frame in model.frames:
        if frame.type == pin.FrameType.BODY and frame.parentJoint > 0 and frame.name in tree.links:
            bodies.setdefault(frame.parentJoint, []).append(tree.links[frame.name])
    return bodies


def _origins(tree: Tree) -> Iterator[tuple[str, Element]]:
    """The origins of joints and of inertias, each with the joint or link it belongs to."""
    owners = [*((joint.name, joint.element) for joint in tree.joints),
              *((link.name, link.element.first("inertial")) for link in tree.links.values())]  # fmt: skip
    for name, element in owners:
        origin = None if element is None else element.first("origin")
        if origin is not None:
            yield name, origin


def _numbers(origin: Element, key: str) -> list[float]:
    return [float(part) for part in origin.attributes.get(key, "0 0 0").split()]


def _lengths(tree: Tree) -> Iterator[Suspicion]:
    """Lengths in millimetres."""
    for name, origin in _origins(tree):
        length = math.hypot(*_numbers(origin, "xyz"))
        if length > _LENGTH:
            what = f"an <origin> {length:.4g} m away: is it in millimetres? give m, {length / 1000:.4g}"
            yield "length-unit", name, what
    for joint in tree.moving:
        if joint.type == "prismatic" and _beyond(joint, _LENGTH):
            yield "length-unit", joint.name, f"limits {_shown(joint.limits)} m: are they in millimetres? give m"


def _angles(tree: Tree) -> Iterator[Suspicion]:
    """Angles of origins in degrees."""
    for name, origin in _origins(tree):
        angles = _numbers(origin, "rpy")
        if max(map(abs, angles)) > 2 * math.pi + _ROUNDED:
            radians = " ".join(f"{math.radians(angle):.6g}" for angle in angles)
            what = f'rpy="{origin.attributes["rpy"]}" rad is more than a turn: is it in degrees? give "{radians}"'
            yield "angle-unit", name, what


def _limits(tree: Tree) -> Iterator[Suspicion]:
    """Limits of angles in degrees."""
    for joint in tree.moving:
        if joint.type == "revolute" and joint.limits is not None and _beyond(joint, _REACH):
            lower, upper = joint.limits
            if max(abs(lower), abs(upper)) < _FAR:
                what = f"limits {_shown(joint.limits)} rad, {(upper - lower) / (2 * math.pi):.3g} turns: are they in "
                radians = f'lower="{math.radians(lower):.6g}" upper="{math.radians(upper):.6g}"'
                what += f'degrees? give {radians}, or type="continuous" where it may turn on'
                yield "angle-unit", joint.name, what


def _beyond(joint: UrdfJoint, reach: float) -> bool:
    """True if a joint's limits are wider, and no symmetric power of ten, by which files say that there are none."""
    lower, upper = joint.limits or (0.0, 0.0)
    far = max(abs(lower), abs(upper))
    return far > reach and not (lower == -upper and math.log10(far).is_integer())


def _shown(limits: tuple[float, float] | None) -> str:
    return "({:g}, {:g})".format(*(limits or (0.0, 0.0)))


def _inertias(tree: Tree, model: pin.Model) -> Iterator[Suspicion]:
    """Bodies much heavier than all that carry them, and inertias much wider than the robot."""
    before, reach, size = np.zeros(model.njoints), np.zeros(model.njoints), 0.0
    for j in range(1, model.njoints):
        parent = model.parents[j]
        before[j] = before[parent] + model.inertias[parent].mass
        reach[j] = reach[parent] + float(np.linalg.norm(model.jointPlacements[j].translation))
    size = float(reach.max())
    for j, links in _bodies(tree, model).items():
        heaviest = max(links, key=lambda link: link.mass)
        if what := too_heavy(model.inertias[j].mass, float(before[j])):
            yield "heavy", heaviest.name, what
        for link in links:
            wide = math.sqrt(max(float(np.trace(link.inertia)), 0.0) / (2 * link.mass)) if link.mass > 0 else 0.0
            if size > _SMALL and wide > _WIDE * size:
                spread = f"an inertia as of {link.mass:g} kg spread over {wide:.3g} m, the joints are within"
                what = f"{spread} {size:.3g} m: is it in kg mm^2? give kg m^2 about the centre of mass"
                yield "inertia-unit", link.name, what
