"""Names in a URDF that are not URDF's: those of other programs are counted, unknown ones are refused.

An unknown name may be a typing error, such as <mass valeu="2"/>, or say something about the motion that is not
understood. Either would give wrong dynamics without a message. The blocks of other programs stand beside a URDF that is
complete without them; the load report names what in them changes the motion there.
"""

from collections import Counter
from dataclasses import dataclass, field

from twolink.errors import nearest
from twolink.robots.urdf_elements import URDF_ELEMENTS
from twolink.robots.xml import Element, Reader

# Elements of blocks such as <gazebo> or <transmission> that change the motion in the program that reads them.
_CHANGES_MOTION = {
    "damping", "dampingFactor", "friction", "implicitSpringDamper", "springStiffness", "springReference", "stopKp",
    "stopKd", "mu", "mu1", "mu2", "kp", "kd", "turnGravityOff", "gravity", "kinematic", "static", "mechanicalReduction",
    "mechanical_reduction", "rotor_inertia", "gear_ratio", "inertia_scaling", "lateral_friction", "rolling_friction",
    "spinning_friction", "stiffness", "restitution",
}  # fmt: skip


@dataclass(frozen=True)
class Foreign:
    """What a URDF holds of other programs, with counts.

    elements: by tag. attributes: as "D= in <dynamics>". motion: elements that change the motion in their program, as
    "mu1 in <gazebo>". text: text between elements, as "in <link>".
    """

    elements: Counter[str] = field(default_factory=Counter)
    attributes: Counter[str] = field(default_factory=Counter)
    motion: Counter[str] = field(default_factory=Counter)
    text: Counter[str] = field(default_factory=Counter)


def foreign_content(reader: Reader, robot: Element) -> Foreign:
    """What a <robot> holds of other programs.

    Raises
    ------
    RobotError
        A URDF element has an attribute or a child that is neither URDF's nor a known program's, has a child twice that
        counts once, or has text in place of attributes.
    """
    found = Foreign()
    _look(reader, robot, "", found)
    return found


def _look(reader: Reader, element: Element, owner: str, found: Foreign) -> None:
    """Count and check the names in one element of URDF, and in those below it. owner: its link or joint, for errors."""
    tag, entry = element.tag, URDF_ELEMENTS[element.tag]
    if entry.attributes is None:
        return
    children = entry.children or ()
    if tag in ("link", "joint"):
        owner = f"{tag} {element.attributes.get('name', '')!r}"
    for key in element.attributes:
        if key in entry.attributes or key.partition(":")[0] == "xmlns":
            continue
        if key in entry.foreign_attributes or ":" in key:
            found.attributes[f"{key}= in <{tag}>"] += 1
        else:
            raise reader.error(element, owner, f"{key}= is unknown in <{tag}>", _remedy(key, entry.attributes))
    if element.has_text:
        if not element.attributes and not children:
            what = f"<{tag}> has text in place of attributes"
            raise reader.error(element, owner, what, f"known: {', '.join(entry.attributes)}")
        found.text[f"in <{tag}>"] += 1
    seen: set[str] = set()
    for child in element.children:
        if child.tag in children:
            if child.tag in seen and not URDF_ELEMENTS[child.tag].repeatable:
                raise reader.error(child, owner, f"<{child.tag}> stands twice in <{tag}>", "remove one")
            seen.add(child.tag)
            _look(reader, child, owner, found)
        elif child.tag in entry.foreign_children or _is_prefixed(child.tag) or _moves_nothing(reader, child, owner):
            found.elements[child.tag] += 1
            _count_motion(child, child.tag, found)
        else:
            raise reader.error(child, owner, f"<{child.tag}> is unknown in <{tag}>", _remedy(child.tag, children))


def _remedy(name: str, known: tuple[str, ...]) -> str:
    """What to do about an unknown name."""
    return f"{nearest(name.lower(), known)} (Else remove it, or give it its program's prefix)"


def _is_prefixed(tag: str) -> bool:
    """Whether a tag has the prefix of another program, and is not its form of a URDF element, as <drake:joint> is."""
    prefix, _, name = tag.rpartition(":")
    return bool(prefix) and URDF_ELEMENTS.get(name) is None


def _moves_nothing(reader: Reader, element: Element, owner: str) -> bool:
    """Whether this is an <origin> without effect. Some exporters write one into each link."""
    zeros, keys = (0.0, 0.0, 0.0), ("xyz", "rpy")
    if element.tag != "origin" or element.attributes.keys() - set(keys):
        return False
    return all(reader.numbers(element, key, owner, 3, zeros) == zeros for key in keys)


def _count_motion(element: Element, block: str, found: Foreign) -> None:
    """Count the elements of another program's block that change the motion there; plugins are programs of their own."""
    for child in element.children:
        name = child.tag.rpartition(":")[2]
        if name in _CHANGES_MOTION:
            found.motion[f"{name} in <{block}>"] += 1
        if name != "plugin":
            _count_motion(child, block, found)
