"""Checks of what is no URDF: an SRDF beside its URDF, and the unit of angles in an MJCF as it is written."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from twolink.errors import RobotError
from twolink.io.text import parse_number, read_bytes
from twolink.linting.findings import Defect, defect
from twolink.linting.reading import Reading, of_error
from twolink.robots.catalogue import Source
from twolink.robots.xml import MAX_BYTES, Element, parse_xml

_TURNS, _NARROW = 4 * math.pi + 0.1, 2 * math.pi + 0.1  # rad; degrees, of all hinges of a model
_FEW = 3  # hinges


def ranges(reading: Reading) -> Iterator[Defect]:
    """Ranges of hinges in the other unit than <compiler angle> says."""
    if reading.raw.tag != "mujoco":
        return
    compilers = [one.attributes.get("angle", "") for one in reading.raw.all("compiler")]
    if any(True for _ in _all(reading.raw, "include")) or "" in compilers:
        return  # what is included may say it
    radians = "radian" in compilers
    found = [(joint, width) for joint in _all(reading.raw, "joint")
             if joint.attributes.get("type", "hinge") == "hinge" and (width := _largest(joint)) > 0]  # fmt: skip
    narrow = not radians and len(found) >= _FEW and max(width for _, width in found) < _NARROW
    for joint, width in found:
        if narrow or (radians and width > _TURNS):
            meant = "radians" if narrow else "degrees"
            yield defect("range-unit", joint.attributes.get("name", ""), joint.line,
                         f'range="{joint.attributes["range"]}" in {"radians" if radians else "degrees"}',
                         f'likely in {meant}: <compiler angle="{meant[:-1]}"/>')  # fmt: skip


def _all(element: Element, tag: str) -> Iterator[Element]:
    for child in element.children:
        if child.tag == tag:
            yield child
        yield from _all(child, tag)


def _largest(joint: Element) -> float:
    try:
        return float(np.abs(np.array(joint.attributes.get("range", "0").split(), dtype=float)).max())
    except ValueError:
        return 0.0


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
