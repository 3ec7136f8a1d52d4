"""URDF text to a small tree of elements with line numbers, within limits and without entities.

Expat is driven directly: the standard tree builders drop line numbers, and none of them refuses a DOCTYPE.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from xml.parsers import expat
from xml.sax.saxutils import escape, quoteattr

from twolink.errors import RobotError

MAX_BYTES = 32 * 2**20
MAX_ELEMENTS = 400_000
MAX_NESTING = 64


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
        """The element as XML text (text is not kept: URDF has none)."""
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
        line = self.parser.CurrentLineNumber
        if self.count > MAX_ELEMENTS or len(self.stack) >= MAX_NESTING:
            limit = f"{MAX_ELEMENTS} elements" if self.count > MAX_ELEMENTS else f"{MAX_NESTING} nested elements"
            raise RobotError(f"more than {limit}", where=f"{self.source}:{line}", remedy="no URDF needs that many")
        element = Element(tag, attributes, line)
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
        raise RobotError(
            "a DOCTYPE declaration is refused (entities can read files or fill the memory)",
            where=f"{self.source}:{self.parser.CurrentLineNumber}",
            remedy="remove the <!DOCTYPE ...> and write the values out",
        )


def parse_xml(data: bytes, source: str, encoding: str | None = None) -> Element:
    """Parse XML bytes. `source` is the name used in errors; `encoding` overrules the one that the XML declares.

    Raises RobotError when the data is too large, not XML, has a DOCTYPE, or is nested absurdly.
    """
    if len(data) > MAX_BYTES:
        raise RobotError(
            f"{len(data)} bytes, the limit is {MAX_BYTES}",
            where=source,
            remedy="keep meshes in files of their own",
        )
    builder = _Builder(source, encoding)
    try:
        builder.parser.Parse(data, True)
    except expat.ExpatError as error:
        detail = expat.ErrorString(error.code)
        raise RobotError(
            f"not XML: {detail}", where=f"{source}:{error.lineno}", remedy="check that line, or pass a URDF"
        ) from None
    except (LookupError, ValueError) as error:
        raise RobotError(f"not XML: {error}", where=source, remedy="save the file as UTF-8") from None
    if builder.root is None:
        raise RobotError("not XML: no element", where=source, remedy="pass a URDF")
    return builder.root
