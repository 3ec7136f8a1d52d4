"""From elements to a kinematic tree: unique names, one root, no cycle, not too deep; and the URDF that Pinocchio reads.

Pinocchio's parser drops what it cannot read (an inertia with a blank in a number, say), at most with a message on
stderr. It gets only numbers that `Reader` has read and written again.
"""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter

from twolink.errors import RobotError, nearest
from twolink.robots.urdf import UrdfJoint, UrdfLink, read_joint, read_link
from twolink.robots.xml import URDF_ELEMENTS, Element, Foreign, Reader, foreign_content

# Pinocchio recurses over the tree while reading: 5,000 chained links overflow an 8 MiB stack and end the process.
MAX_JOINTS = 5_000
MAX_DEPTH = 1_000
VERSIONS = {"1.0": (1, 0), "1.1": (1, 1), "1.2": (1, 2)}
LEAVE_OUT = 'xacro="ignore" (--xacro ignore) leaves such elements out'
_NOT_DYNAMICS = ("visual", "collision", "material")
_SIDES = {"left": "right", "l": "r", "fl": "fr", "rl": "rr", "hl": "hr", "lf": "rf", "lh": "rh", "bl": "br", "lr": "rr"}


@dataclass(frozen=True)
class Tree:
    """A URDF whose structure is sound: `joints` in an order that meets every parent before its children."""

    name: str
    element: Element
    links: dict[str, UrdfLink]
    joints: tuple[UrdfJoint, ...]
    root: str
    foreign: Foreign

    @property
    def moving(self) -> tuple[UrdfJoint, ...]:
        """The joints that move."""
        return tuple(j for j in self.joints if j.type != "fixed")


def read_tree(element: Element, source: str, foreign: str = "refuse", xacro: str = "expand") -> Tree:
    """The tree in a <robot> element.

    Parameters
    ----------
    element : Element
        The element. The quaternions of its origins are replaced by angles, and its version by one that Pinocchio reads;
        elements of xacro are taken out.
    source : str
        The name of the file for errors.
    foreign : {"refuse", "report"}
        Refuse names that are unknown, or count them in the tree's `foreign`.
    xacro : {"expand", "ignore"}
        Refuse elements of xacro, which should have been expanded, or count them in the tree's `foreign` too.

    Raises
    ------
    RobotError
        Code "urdf"; it names the link or joint at fault.
    """
    _require_robot(element, source)
    if xacro == "expand":
        _require_expanded(element, source)
    left_out = _without_xacro(element)
    version = _version(element, source)
    element.attributes["version"] = "1.2" if version == (1, 2) else "1.1"  # 1.1 differs from 1.0 in shapes only
    reader = Reader(source, version)
    other = foreign_content(reader, element, foreign == "report")
    other.xacro.update(left_out)
    links = [read_link(reader, e) for e in element.all("link")]
    if not links:
        raise _error("it has no <link>", source, "a robot needs at least one link")
    elements = element.all("joint")
    if len(elements) > MAX_JOINTS:
        raise _error(f"{len(elements)} joints, the limit is {MAX_JOINTS}", source, "load a smaller robot")
    joints = [read_joint(reader, e) for e in elements]
    _require_unique(links)
    _require_unique(joints)
    by_name = {link.name: link for link in links}
    for joint in joints:
        for role, name in (("parent", joint.parent), ("child", joint.child)):
            if name not in by_name:
                remedy = 'add <link name="world"/>' if name == "world" else nearest(name, by_name)
                raise _error(f"{role} link {name!r} does not exist", joint.where, remedy)
    return joined_tree(element, by_name, joints, source, other)


def joined_tree(element: Element, links: dict[str, UrdfLink], joints: list[UrdfJoint], source: str, other: Foreign,
                ) -> Tree:  # fmt: skip
    """The tree that joints make of links. Raises RobotError (code "urdf") where it is none."""
    ordered = _ordered(links, joints, source)
    root = ordered[0].parent if ordered else next(iter(links))
    return Tree(element.attributes.get("name", ""), element, links, ordered, root, other)


def _error(what: str, where: str, remedy: str) -> RobotError:
    return RobotError(what, where=where, remedy=remedy, code="urdf")


def _require_robot(root: Element, source: str) -> None:
    """Require a <robot>."""
    if root.tag != "robot":
        hint = ", it is a web page" if root.tag == "html" else ""
        raise _error(f"the top element is <{root.tag}>, expected <robot>{hint}", f"{source}:{root.line}", "pass a URDF")


def _require_expanded(root: Element, source: str) -> None:
    """Require a robot without xacro."""
    element = xacro_element(root)
    if element is not None:
        what = f"<{element.tag}> is xacro, a macro language that has to be expanded first"
        remedy = "load it as a file, with pip install 'twolink[xacro]'; or expand it: xacro FILE > robot.urdf"
        remedy += f"; of a finished URDF, {LEAVE_OUT}"
        raise _error(what, f"{source}:{element.line}", remedy)


def xacro_element(root: Element) -> Element | None:
    """The first element of a robot that holds xacro."""
    stack = [root]
    while stack:
        element = stack.pop()
        values = element.attributes.items()
        if element.tag.startswith("xacro:") or any("${" in v or "$(" in v for k, v in values if k != "name"):
            return element
        # Gazebo's and the controllers' blocks hold $(...) of their own; they are ignored as a whole.
        tags = ("link", "joint")
        stack += [c for c in element.children if element is not root or c.tag in tags or c.tag.startswith("xacro:")]
    return None


def _without_xacro(element: Element) -> Counter[str]:
    """Take the elements of xacro out of an element; what they were, and which links and joints they held."""
    found: Counter[str] = Counter()
    for child in element.children:
        if child.tag.startswith("xacro:"):
            found[f"<{child.tag}>"] += 1
            found.update(f"<{held.tag}> in <{child.tag}>" for held in child.children if held.tag in ("link", "joint"))
        else:
            found += _without_xacro(child)
    element.children = [child for child in element.children if not child.tag.startswith("xacro:")]
    return found


def _version(robot: Element, source: str) -> tuple[int, int]:
    """The version of the format, (1, 0) where the file does not say."""
    text = robot.attributes.get("version", "1.0")
    if text not in VERSIONS:
        what = f'<robot version="{text[:20]}">: known are {", ".join(VERSIONS)}'
        raise _error(what, f"{source}:{robot.line}", "write the version of the URDF format, or leave it out")
    return VERSIONS[text]


def _require_unique(items: Sequence[UrdfLink] | Sequence[UrdfJoint]) -> None:
    """Require that no two links, or joints, have the same name."""
    for name, count in Counter(item.name for item in items).items():
        if count > 1:
            second = [item for item in items if item.name == name][1]
            raise _error(f"the name is used {count} times", second.where, "rename one of them")


def _ordered(links: dict[str, UrdfLink], joints: list[UrdfJoint], source: str) -> tuple[UrdfJoint, ...]:
    """The joints of a tree with one root, every parent before its children."""
    carriers: dict[str, UrdfJoint] = {}
    for joint in joints:
        other = carriers.setdefault(joint.child, joint)
        if other is not joint:
            what = f"link {joint.child!r} is already the child of joint {other.name!r}"
            remedy = "a URDF is a tree: give the link one parent, and close loops elsewhere"
            raise _error(what, joint.where, remedy)
    try:
        order = list(TopologicalSorter({joint.child: [joint.parent] for joint in joints}).static_order())
    except CycleError as error:
        cycle = " <- ".join(map(repr, error.args[1][:8]))
        raise _error(f"the joints form a cycle: {cycle}", source, "remove one of them") from None
    roots = [name for name in links if name not in carriers]
    if len(roots) > 1:
        what = f"{len(roots)} root links: {', '.join(map(repr, roots[:5]))}"
        raise _error(what, source, "connect them with joints, or remove all but one")
    ordered = [carriers[link] for link in order if link in carriers]
    depth = {roots[0]: 0}
    for joint in ordered:
        depth[joint.child] = depth[joint.parent] + 1
        if depth[joint.child] > MAX_DEPTH:
            what = f"more than {MAX_DEPTH} joints lie between it and the root"
            raise _error(what, f"link {joint.child!r}", "load a shorter chain")
    return tuple(ordered)


def canonical(tree: Tree) -> str:
    """The tree as URDF text: links with their inertias, and joints, in the order of the file."""
    named = tree.element.attributes | {"name": tree.name or "robot"}
    return _reduced(Element("robot", named, 0, tree.element.children)).to_xml()


def _reduced(element: Element) -> Element:
    """The element with the attributes and children that dynamics needs; of repeated children, the first."""
    entry = URDF_ELEMENTS[element.tag]
    out = Element(element.tag, {k: v for k, v in element.attributes.items() if k in (entry.attributes or ())}, 0)
    if out.attributes.get("type") == "spherical":  # which Pinocchio's parser has not
        out.attributes["type"] = "floating"
    for tag in entry.children or ():
        children = [] if tag in _NOT_DYNAMICS else element.all(tag)
        out.children += map(_reduced, children if URDF_ELEMENTS[tag].repeatable else children[:1])
    return out


def other_side(name: str) -> str:
    """The name of the right link or joint that a left one has; "" of one that has no side."""
    words = re.split("(left|Left|LEFT)", name)  # also within one: "frontleft_hip"
    parts = [part for word in words for part in re.findall(r"[a-z]+|[A-Z]+(?![a-z])|[A-Z][a-z]*|[^a-zA-Z]+", word)]
    for k, part in enumerate(parts):
        other = _SIDES.get(part.lower(), "")
        if other:
            parts[k] = other if part.islower() else other.upper() if part.isupper() else other.capitalize()
            return "".join(parts)
    return ""
