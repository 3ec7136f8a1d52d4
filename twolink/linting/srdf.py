"""Checks of an SRDF beside its URDF."""

from __future__ import annotations

from collections.abc import Iterator

from twolink.errors import RobotError
from twolink.io.text import parse_number, read_bytes
from twolink.linting.findings import Defect, defect
from twolink.linting.reading import of_error
from twolink.robots.catalogue import Source
from twolink.robots.xml import MAX_BYTES, Element, parse_xml


def srdf_defects(source: Source) -> Iterator[Defect]:
    """The defects of an SRDF. Names are compared with the URDF of its name, beside it or in ../urdf or ../robots."""
    try:
        root = parse_xml(source.data, source.label)
    except RobotError as error:
        yield of_error(error, "xml")
        return
    known = _names(source)
    seen: set[frozenset[str]] = set()
    for element in root.children:
        pair = [element.attributes.get(key, "") for key in ("link1", "link2")]
        if element.tag == "disable_collisions":
            if frozenset(pair) in seen or pair[0] == pair[1]:
                what = f"the pair {pair[0]!r}, {pair[1]!r} stands twice, or is one link"
                yield defect("srdf", pair[0], element.line, what, "leave it out")
            seen.add(frozenset(pair))
            yield from _unknown(element, "link", pair, known)
        for part in element.children:
            if part.tag in ("joint", "link"):
                yield from _unknown(part, part.tag, [part.attributes.get("name", "")], known)
            if element.tag == "group_state" and not _are_numbers(part.attributes.get("value", "")):
                yield defect("srdf", part.attributes.get("name", ""), part.line,
                             f'value="{part.attributes.get("value", "")}" is no number', "give rad or m")  # fmt: skip


def _names(source: Source) -> dict[str, set[str]]:
    """The names of links and joints of the URDF; none where it is not found."""
    if source.path is None:
        return {}
    folders = (source.path.parent, *(source.path.parent.parent / name for name in ("urdf", "robots")))
    found = next((file for folder in folders if (file := folder / f"{source.path.stem}.urdf").is_file()), None)
    if found is None:
        return {}
    root = parse_xml(read_bytes(found, RobotError, MAX_BYTES), found.name)
    return {tag: {each.attributes.get("name", "") for each in root.all(tag)} for tag in ("link", "joint")}


def _unknown(element: Element, tag: str, names: list[str], known: dict[str, set[str]]) -> Iterator[Defect]:
    for name in names:
        if known and name not in known[tag]:
            yield defect("srdf", name, element.line, f"the URDF has no {tag} {name!r}", "correct the name")


def _are_numbers(text: str) -> bool:
    try:
        return bool([parse_number(part) for part in text.split()])
    except ValueError:
        return False
