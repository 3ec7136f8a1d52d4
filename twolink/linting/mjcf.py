"""Checks of an MJCF as it is written: the unit of its angles."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from twolink.linting.findings import Defect, defect
from twolink.linting.reading import Reading
from twolink.robots.xml import Element

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
