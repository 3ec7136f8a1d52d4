"""URDF text to a tree of elements with line numbers, within limits and without entities. Names that are not URDF's:
those of other programs are counted, unknown ones are refused, or counted where that is asked for.

Expat is driven directly: the standard tree builders drop line numbers, and none of them refuses a DOCTYPE.

An unknown name may be a typing error, such as <mass valeu="2"/>, or say something about the motion that is not
understood. Either would give wrong dynamics without a message. The blocks of other programs stand beside a URDF that is
complete without them; the load report names what in them changes the motion there.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat
from xml.sax.saxutils import escape, quoteattr

import msgspec

from twolink.errors import RobotError, nearest
from twolink.io.text import parse_number

MAX_BYTES = 32 * 2**20
MAX_ELEMENTS = 400_000
MAX_NESTING = 64

Vector = tuple[float, ...]
# Elements of blocks such as <gazebo> or <transmission> that change the motion in the program that reads them.
_CHANGES_MOTION = {
    "damping", "dampingFactor", "friction", "implicitSpringDamper", "springStiffness", "springReference", "stopKp",
    "stopKd", "mu", "mu1", "mu2", "kp", "kd", "turnGravityOff", "gravity", "kinematic", "static", "mechanicalReduction",
    "mechanical_reduction", "rotor_inertia", "gear_ratio", "inertia_scaling", "lateral_friction", "rolling_friction",
    "spinning_friction", "stiffness", "restitution", "traits",
}  # fmt: skip


@dataclass(slots=True)
class Element:
    """One XML element: its tag, attributes, the line it starts on (0: it stands in no file) and its children."""

    tag: str
    attributes: dict[str, str]
    line: int
    children: list[Element] = field(default_factory=list)
    has_text: bool = False

    def all(self, tag: str) -> list[Element]:
        """The children with this tag, in order."""
        return [child for child in self.children if child.tag == tag]

    def first(self, tag: str) -> Element | None:
        """The first child with this tag, or None."""
        return next((child for child in self.children if child.tag == tag), None)

    def inside(self) -> Iterator[Element]:
        """All elements in this one, depth first."""
        for child in self.children:
            yield child
            yield from child.inside()

    def to_xml(self) -> str:
        """The element as XML text, without the text between elements (URDF has none)."""
        attributes = "".join(f" {escape(k)}={quoteattr(v)}" for k, v in self.attributes.items())
        if not self.children:
            return f"<{self.tag}{attributes}/>"
        return f"<{self.tag}{attributes}>{''.join(c.to_xml() for c in self.children)}</{self.tag}>"


class _Builder:
    """Collects expat's events into Elements, and stops at the limits."""

    def __init__(self, source: str, encoding: str | None) -> None:
        self.source = source
        self.root: Element | None = None
        self.stack: list[Element] = []
        self.count = 0
        self.parser = expat.ParserCreate(encoding)
        self.parser.StartElementHandler = self.start
        self.parser.EndElementHandler = self.end
        self.parser.CharacterDataHandler = self.text
        self.parser.StartDoctypeDeclHandler = self.doctype

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        self.count += 1
        if self.count > MAX_ELEMENTS:
            raise self.error(f"more than {MAX_ELEMENTS} elements", "no URDF needs that many")
        if len(self.stack) >= MAX_NESTING:
            raise self.error(f"more than {MAX_NESTING} nested elements", "no URDF needs that many")
        element = Element(tag, attributes, self.parser.CurrentLineNumber)
        if self.stack:
            self.stack[-1].children.append(element)
        else:
            self.root = element
        self.stack.append(element)

    def text(self, data: str) -> None:
        if self.stack and not data.isspace():
            self.stack[-1].has_text = True

    def end(self, _tag: str) -> None:
        self.stack.pop()

    def doctype(self, *_: object) -> None:
        what = "a DOCTYPE declaration is refused (entities can read files or fill the memory)"
        raise self.error(what, "remove the <!DOCTYPE ...> and write the values out")

    def error(self, what: str, remedy: str) -> RobotError:
        return RobotError(what, where=f"{self.source}:{self.parser.CurrentLineNumber}", remedy=remedy, code="xml")


def parse_xml(data: bytes, source: str, encoding: str | None = None) -> Element:
    """The root element of XML bytes.

    Parameters
    ----------
    data : bytes
        At most MAX_BYTES.
    source : str
        The name of the text for errors.
    encoding : str, optional
        Overrules the encoding that the XML declares.

    Raises
    ------
    RobotError
        Code "xml": the data is too large, not XML, has a DOCTYPE, or is nested too deep.
    """
    if len(data) > MAX_BYTES:
        what, remedy = f"{len(data)} bytes, the limit is {MAX_BYTES}", "keep meshes in files of their own"
        raise RobotError(what, where=source, remedy=remedy, code="xml")
    builder = _Builder(source, encoding)
    try:
        builder.parser.Parse(data, True)
    except expat.ExpatError as error:
        what, remedy = f"not XML: {expat.ErrorString(error.code)}", "check that line, or pass a URDF"
        raise RobotError(what, where=f"{source}:{error.lineno}", remedy=remedy, code="xml") from None
    except (LookupError, ValueError) as error:
        raise RobotError(f"not XML: {error}", where=source, remedy="save the file as UTF-8", code="xml") from None
    if builder.root is None:
        raise RobotError("not XML: no element", where=source, remedy="pass a URDF", code="xml")
    return builder.root


@dataclass(frozen=True)
class Reader:
    """Reads names and numbers from elements; errors name the file, line, link or joint, and attribute.

    version: of the URDF format; versions 1.1 and 1.2 give some attributes a meaning. lines: whether the source has the
    elements on their lines.
    """

    source: str
    version: tuple[int, int] = (1, 0)
    lines: bool = True

    def where(self, element: Element, owner: str = "") -> str:
        """The place of an element, for errors. `owner` is the link or joint it belongs to."""
        line = f":{element.line}" if self.lines and element.line else ""
        return self.source + line + (f", {owner}" if owner else "")

    def error(self, element: Element, owner: str, what: str, remedy: str) -> RobotError:
        """An error at an element."""
        return RobotError(what, where=self.where(element, owner), remedy=remedy, code="urdf")

    def name(self, element: Element) -> str:
        """The name of a link or joint."""
        value = element.attributes.get("name", "")
        if not value.strip():
            raise self.error(element, "", f"<{element.tag}> has no name", 'add name="..."')
        return value

    def numbers(self, element: Element, key: str, owner: str, count: int, default: Vector | None = None) -> Vector:
        """`count` finite numbers from one attribute, or the default where the attribute is absent.

        The attribute is written again with the numbers in their shortest exact form, which every parser reads.
        """
        text = element.attributes.get(key)
        if text is None:
            if default is None:
                raise self.error(element, owner, f"<{element.tag}> has no {key}", f'add {key}="..."')
            return default
        shown = f'<{element.tag} {key}="{text[:60]}">'
        parts = text.split()
        if len(parts) != count:
            what = f"{shown}: expected {count} number{'s' if count > 1 else ''}, got {len(parts)}"
            raise self.error(element, owner, what, "write numbers with a decimal point, separated by blanks")
        values = []
        for part in parts:
            try:
                values.append(parse_number(part))
            except ValueError:
                comma = "; decimals take a point, not a comma" if "," in part else ""
                what = f"{shown}: {part!r} is not a number"
                raise self.error(element, owner, what, f"write a number{comma}") from None
            if not math.isfinite(values[-1]):
                what = f"{shown}: {values[-1]} is not finite"
                raise self.error(element, owner, what, "give a finite number")
        element.attributes[key] = " ".join(map(repr, values))
        return tuple(values)

    def number(self, element: Element, key: str, owner: str, default: float | None = None) -> float:
        """One finite number from an attribute."""
        return self.numbers(element, key, owner, 1, None if default is None else (default,))[0]


class UrdfElement(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One kind of element: what it may hold, and whether it may stand more than once in its parent.

    attributes, children: None for an element that is not looked into. foreign_attributes, foreign_children: those of
    other programs, which are reported and not applied.
    """

    attributes: tuple[str, ...] | None = None
    children: tuple[str, ...] | None = None
    foreign_attributes: tuple[str, ...] = ()
    foreign_children: tuple[str, ...] = ()
    repeatable: bool = False


_FILE = Path(__file__).parent / "urdf_elements.toml"
URDF_ELEMENTS: dict[str, UrdfElement] = msgspec.toml.decode(_FILE.read_bytes(), type=dict[str, UrdfElement])


@dataclass(frozen=True)
class Foreign:
    """Contents of a URDF for other programs, with counts.

    elements: by tag. attributes: as "D= in <dynamics>". motion: elements that change the motion in their program, as
    "mu1 in <gazebo>". text: text between elements, as "in <link>". unknown: names of no known program, as
    "rpy= in <axis>"; they are refused unless `lenient`. xacro: what was left out unexpanded. refused: errors, where
    they are collected and not raised.
    """

    lenient: bool = False

    elements: Counter[str] = field(default_factory=Counter)
    attributes: Counter[str] = field(default_factory=Counter)
    motion: Counter[str] = field(default_factory=Counter)
    text: Counter[str] = field(default_factory=Counter)
    unknown: Counter[str] = field(default_factory=Counter)
    xacro: Counter[str] = field(default_factory=Counter)
    refused: list[RobotError] | None = None

    def refuse(self, error: RobotError) -> None:
        """Raise an error, or collect it."""
        if self.refused is None:
            raise error
        self.refused.append(error)


def foreign_content(
    reader: Reader, robot: Element, lenient: bool = False, refused: list[RobotError] | None = None
) -> Foreign:
    """Contents of a <robot> for other programs. lenient: unknown names are counted, not refused. refused: a list that
    takes the errors.

    Raises
    ------
    RobotError
        A URDF element has an attribute or a child that is neither URDF's nor a known program's, has a child twice that
        counts once, or has text in place of attributes.
    """
    found = Foreign(lenient, refused=refused)
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
            _unknown(reader, element, owner, (f"{key}=", key, tag), entry.attributes, found)
    if element.has_text:
        if not element.attributes and not children:
            what = f"<{tag}> has text in place of attributes"
            found.refuse(reader.error(element, owner, what, f"known: {', '.join(entry.attributes)}"))
        found.text[f"in <{tag}>"] += 1
    seen: set[str] = set()
    for child in element.children:
        if child.tag in children:
            if child.tag in seen and not URDF_ELEMENTS[child.tag].repeatable:
                found.refuse(reader.error(child, owner, f"<{child.tag}> stands twice in <{tag}>", "remove one"))
            seen.add(child.tag)
            _look(reader, child, owner, found)
        elif child.tag in entry.foreign_children or _is_prefixed(child.tag) or _moves_nothing(reader, child, owner):
            found.elements[child.tag] += 1
            _count_motion(child, tag, found)
        else:
            _unknown(reader, child, owner, (f"<{child.tag}>", child.tag, tag), children, found)


def _unknown(
    reader: Reader, place: Element, owner: str, names: tuple[str, str, str], known: tuple[str, ...], found: Foreign
) -> None:
    """Refuse or count a name; `names` are it as shown, it, and the tag that holds it."""
    shown, name, tag = names
    if not found.lenient:
        remedy = f"{nearest(name.lower(), known)} (Else remove it, give it its program's prefix, or load with "
        found.refuse(reader.error(place, owner, f"{shown} is unknown in <{tag}>", f'{remedy}foreign="report")'))
    found.unknown[f"{shown} in <{tag}>"] += 1


def _is_prefixed(tag: str) -> bool:
    """True if a tag has the prefix of another program, and is not its form of a URDF element, as <drake:joint> is."""
    prefix, _, name = tag.rpartition(":")
    return bool(prefix) and URDF_ELEMENTS.get(name) is None


def _moves_nothing(reader: Reader, element: Element, owner: str) -> bool:
    """True if this is an <origin> without effect, which some exporters write into each link, or such <joint_properties>
    (the old name of <dynamics>), which onshape-to-robot writes into each joint.
    """
    keys = {"origin": ("xyz", "rpy"), "joint_properties": ("damping", "friction")}.get(element.tag)
    if keys is None or element.attributes.keys() - set(keys):
        return False
    zeros = (0.0,) * (3 if element.tag == "origin" else 1)
    return all(reader.numbers(element, key, owner, len(zeros), zeros) == zeros for key in keys)


def _count_motion(element: Element, holder: str, found: Foreign) -> None:
    """Count an element of another program, which stands in `holder`, and those in it, where they change the motion."""
    for part in _parts(element):
        name = part.tag.rpartition(":")[2]
        if name in _CHANGES_MOTION:
            found.motion[f"{name} in <{holder if part is element else element.tag}>"] += 1


def _parts(element: Element) -> Iterator[Element]:
    """An element and all in it but what stands in plugins, which are programs of their own."""
    yield element
    if element.tag.rpartition(":")[2] != "plugin":
        for child in element.children:
            yield from _parts(child)
