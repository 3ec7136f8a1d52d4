"""What there is to say about a URDF that is sound: parts ignored, repaired and assumed."""

from __future__ import annotations

import math
from collections import Counter

from twolink.errors import nearest
from twolink.robots.load_report import Finding
from twolink.robots.tree import Tree
from twolink.robots.xml import Element

_KNOWN = {
    "robot": {"link", "joint", "material"},
    "link": {"inertial", "visual", "collision"},
    "inertial": {"origin", "mass", "inertia"},
    "joint": {"origin", "parent", "child", "axis", "limit", "dynamics", "mimic"},
}
_ATTRIBUTES = {
    "robot": {"name", "version"},
    "link": {"name", "type"},
    "inertial": set(),
    "joint": {"name", "type"},
    "origin": {"xyz", "rpy"},
    "mass": {"value"},
    "inertia": {"ixx", "ixy", "ixz", "iyy", "iyz", "izz"},
    "parent": {"link"},
    "child": {"link"},
    "axis": {"xyz"},
    "limit": {"lower", "upper", "effort", "velocity"},
    "dynamics": {"damping", "friction"},
    "mimic": {"joint", "multiplier", "offset"},
}
_MANY = {"link", "joint", "material", "visual", "collision"}
# Elements of other programs that are common and rightly not dynamics.
_FOREIGN = {
    "transmission": "transmissions (rotor inertia and gearing are not modelled from them)",
    "gazebo": "<gazebo> blocks (their damping, friction and contact values too)",
    "ros2_control": "<ros2_control> blocks",
    "sensor": "sensors",
    "safety_controller": "safety controllers",
    "calibration": "calibrations",
    "contact": "contact coefficients",
    "contact_coefficients": "contact coefficients",
    "self_collision_checking": "self-collision marks",
}


def findings(tree: Tree, *, root: str, mimic: bool, reduced: bool) -> list[Finding]:
    """All findings about the URDF's content. `reduced`: some joints are locked."""
    found = [*_ignored(tree, mimic), *_foreign(tree), *_repaired(tree), *_assumed(tree, root)]
    if reduced:
        found.append(Finding("ignored", "friction, damping and limits of locked joints"))
    return found


def _ignored(tree: Tree, mimic: bool) -> list[Finding]:
    def named(what: str, names: list[str]) -> list[Finding]:
        return [Finding("ignored", what, tuple(names))] if names else []

    moving = tree.moving
    links = tree.links.values()
    return [
        *named(
            "joint damping (in robot.model.damping; forward and inverse dynamics do not apply it)",
            [j.name for j in moving if j.damping != 0],
        ),
        *named(
            "joint friction (in robot.model; forward and inverse dynamics do not apply it)",
            [j.name for j in moving if j.friction != 0],
        ),
        *named(
            "joint limits (in robot.model; forward and inverse dynamics do not enforce them)",
            [j.name for j in moving if j.limits is not None],
        ),
        *named(
            "mimic (these joints move on their own; mimic=True couples them)",
            [] if mimic else [j.name for j in moving if j.mimic is not None],
        ),
        *named(
            "mimic of a joint that does not exist",
            [j.name for j in moving if j.mimic is not None and j.mimic not in {k.name for k in tree.joints}],
        ),
        *named("collision shapes (there is no contact)", [k.name for k in links if k.element.first("collision")]),
    ]


def _foreign(tree: Tree) -> list[Finding]:
    """Elements, attributes and text that are not URDF's, or that a typing error has made so."""
    foreign: Counter[str] = Counter()
    odd: dict[str, list[str]] = {"unknown elements": [], "unknown attributes": [], "text": [], "repeated elements": []}

    def look(element: Element, level: str) -> None:
        allowed = _ATTRIBUTES.get(level)
        if allowed is not None:
            odd["unknown attributes"] += [
                f"{key}= in <{level}>, line {element.line} ({nearest(key, sorted(allowed))})"
                for key in element.attributes
                if key not in allowed and not key.startswith("xmlns")
            ]
            odd["text"] += [f"in <{level}>, line {element.line}"] if element.has_text else []
        seen: set[str] = set()
        for child in element.children:
            if child.tag in _FOREIGN:
                foreign[_FOREIGN[child.tag]] += 1
                continue
            if level in _KNOWN and child.tag not in _KNOWN[level]:
                hint = nearest(child.tag, sorted(_KNOWN[level]))
                odd["unknown elements"].append(f"<{child.tag}> in <{level}> ({hint})")
                continue
            if level in _KNOWN and child.tag in seen and child.tag not in _MANY:
                odd["repeated elements"].append(f"<{child.tag}> in <{level}>, line {child.line}: the first one counts")
            seen.add(child.tag)
            look(child, child.tag)

    look(tree.element, "robot")
    found = [Finding("ignored", f"{count} x {what}") for what, count in foreign.items()]
    return found + [Finding("ignored", what, tuple(dict.fromkeys(names))) for what, names in odd.items() if names]


def _repaired(tree: Tree) -> list[Finding]:
    skewed = [j.name for j in tree.moving if j.axis is not None and abs(math.hypot(*j.axis) - 1) > 1e-6]
    return [Finding("repaired", "axes that were not of length 1 are normalised", tuple(skewed))] if skewed else []


def _assumed(tree: Tree, root: str) -> list[Finding]:
    def named(what: str, names: list[str]) -> list[Finding]:
        return [Finding("assumed", what, tuple(names))] if names else []

    moving = tree.moving
    fixed = [j.child for j in tree.joints if j.type == "fixed"]
    base = tree.links[tree.root]
    bare = [k.name for k in tree.links.values() if not k.has_inertial]
    found = [
        *named("fixed joints: these links are merged into the body they are fixed to, and stay as frames", fixed),
        *named("links without <inertial> have no mass", bare),
        *named(
            "joints without <axis> turn or slide along x",
            [j.name for j in moving if j.axis is None and j.type != "floating"],
        ),
        *named(
            "limits without lower or upper: taken as 0",
            [j.name for j in moving if j.limits is not None and _half_limited(j.element)],
        ),
    ]
    if root == "fixed":
        carried = f", its {base.mass:g} kg do not move" if base.mass > 0 else ""
        found.append(Finding("assumed", f"link {tree.root!r} is fixed to the world{carried}"))
    else:
        found.append(Finding("assumed", f"link {tree.root!r} moves freely (joint 'root_joint')"))
    return found


def _half_limited(joint: Element) -> bool:
    limit = joint.first("limit")
    return limit is not None and not {"lower", "upper"} <= set(limit.attributes)
