"""The URDF that Pinocchio reads: the checked elements that dynamics needs, and no others.

Pinocchio's parser drops what it cannot read (an inertia with a blank in a number, say), at most with a message on
stderr. It gets only numbers that `Reader` has read and written again.
"""

from twolink.robots.tree import Tree
from twolink.robots.urdf_elements import URDF_ELEMENTS
from twolink.robots.xml import Element

_NOT_DYNAMICS = ("visual", "collision", "material")


def canonical(tree: Tree) -> str:
    """The tree as URDF text: links with their inertias, and joints, in the order of the file."""
    named = tree.element.attributes | {"name": tree.name or "robot"}
    return _reduced(Element("robot", named, 0, tree.element.children)).to_xml()


def _reduced(element: Element) -> Element:
    """The element with the attributes and children that dynamics needs; of repeated children, the first."""
    entry = URDF_ELEMENTS[element.tag]
    out = Element(element.tag, {k: v for k, v in element.attributes.items() if k in (entry.attributes or ())}, 0)
    for tag in entry.children or ():
        children = [] if tag in _NOT_DYNAMICS else element.all(tag)
        out.children += map(_reduced, children if URDF_ELEMENTS[tag].repeatable else children[:1])
    return out
