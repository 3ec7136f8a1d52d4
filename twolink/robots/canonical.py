"""The URDF that Pinocchio reads: the checked values, written again.

Pinocchio's parser drops what it cannot read (an inertia with a blank in a number, say), at most with a message on
stderr. It gets numbers in their shortest exact form, unit axes, and nothing that dynamics do not need.
"""

from __future__ import annotations

import math

from twolink.robots.tree import Tree
from twolink.robots.urdf import UrdfJoint, UrdfLink
from twolink.robots.xml import Element

_MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def canonical(tree: Tree) -> str:
    """The tree as URDF text: links with their inertias, joints in the order of the file."""
    links = [_link(link) for link in tree.links.values()]
    order = {id(element): n for n, element in enumerate(tree.element.children)}
    joints = [_joint(joint) for joint in sorted(tree.joints, key=lambda j: order[id(j.element)])]
    return _make("robot", {"name": tree.name or "robot"}, *links, *joints).to_xml()


def _make(tag: str, attributes: dict[str, str], *children: Element) -> Element:
    return Element(tag, attributes, 0, list(children))


def _text(*values: float) -> str:
    """Numbers in their shortest exact form."""
    return " ".join(repr(float(v)) for v in values)


def _origin(owner: Element) -> list[Element]:
    """The <origin> with the angles of the file: a matrix made from them and back would be rounded."""
    origin = owner.first("origin")
    if origin is None:
        return []
    return [_make("origin", {k: " ".join(v.split()) for k, v in origin.attributes.items() if k in ("xyz", "rpy")})]


def _link(link: UrdfLink) -> Element:
    inertial = link.element.first("inertial")
    inertia = None if inertial is None else inertial.first("inertia")
    if inertial is None or inertia is None:
        return _make("link", {"name": link.name})
    moments = {name: _text(float(inertia.attributes[name])) for name in _MOMENTS}
    parts = [*_origin(inertial), _make("mass", {"value": _text(link.mass)}), _make("inertia", moments)]
    return _make("link", {"name": link.name}, _make("inertial", {}, *parts))


def _joint(joint: UrdfJoint) -> Element:
    parts = [_make("parent", {"link": joint.parent}), _make("child", {"link": joint.child}), *_origin(joint.element)]
    if joint.axis is not None:
        length = math.hypot(*joint.axis)
        parts.append(_make("axis", {"xyz": _text(*(x / length for x in joint.axis))}))
    limit = joint.element.first("limit")
    if limit is not None:
        lower, upper = joint.limits or (0.0, 0.0)
        other = {key: limit.attributes[key].strip() for key in ("effort", "velocity")}
        parts.append(_make("limit", {"lower": _text(lower), "upper": _text(upper), **other}))
    if joint.damping or joint.friction:
        parts.append(_make("dynamics", {"damping": _text(joint.damping), "friction": _text(joint.friction)}))
    mimic = joint.element.first("mimic")
    if mimic is not None and joint.mimic:
        numbers = {key: value.strip() for key, value in mimic.attributes.items() if key in ("multiplier", "offset")}
        parts.append(_make("mimic", {"joint": joint.mimic, **numbers}))
    return _make("joint", {"name": joint.name, "type": joint.type}, *parts)
