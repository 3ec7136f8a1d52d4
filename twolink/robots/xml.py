"""URDF text to a tree of elements with line numbers, within limits and without entities; and typed reading of them.

Expat is driven directly: the standard tree builders drop line numbers, and none of them refuses a DOCTYPE.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from xml.parsers import expat
from xml.sax.saxutils import escape, quoteattr

from twolink.errors import RobotError
from twolink.io.text import parse_number

MAX_BYTES = 32 * 2**20
MAX_ELEMENTS = 400_000
MAX_NESTING = 64

Vector = tuple[float, ...]


@dataclass(slots=True)
class Element:
    """One XML element: its tag, attributes, the line it starts on and its children."""

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
        return self.source + (f":{element.line}" if self.lines else "") + (f", {owner}" if owner else "")

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
