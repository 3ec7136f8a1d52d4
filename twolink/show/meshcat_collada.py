"""Collada files (.dae) as triangles with their colours.

meshcat's viewer could read them itself, but it loses every part whose neighbours have more than one material
(half of a UR5), ignores the file's length unit, and the text is larger than the triangles.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any
from xml.etree.ElementTree import Element, ParseError, fromstring

import numpy as np
from numpy.typing import NDArray

_FACES = ("triangles", "polylist", "polygons")
_DEEPEST = 50  # nodes within nodes; more is a loop

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Part:
    """The triangles of one colour."""

    vertices: Floats  # (n, 3) m
    normals: Floats | None  # (n, 3) unit
    faces: NDArray[np.int64]  # (m, 3)
    rgba: tuple[float, float, float, float] | None  # None: the file gives no colour
    textured: bool  # a picture gives the colour


def read_collada(raw: bytes) -> list[Part] | None:
    """The parts of a Collada file, in metres and in the file's own axes, or None when it cannot be read."""
    try:
        root = fromstring(raw)
        for element in root.iter():
            element.tag = element.tag.rpartition("}")[2]  # the name space is but the version
        return _Reader(root).parts()
    except (ParseError, KeyError, ValueError, IndexError, TypeError, AttributeError, RecursionError):
        return None


class _Reader:
    def __init__(self, root: Element) -> None:
        self.root = root
        self.by_id = {name: element for element in root.iter() if (name := element.get("id"))}
        unit = root.find("asset/unit")
        self.unit = float(unit.get("meter", 1.0)) if unit is not None else 1.0

    def parts(self) -> list[Part]:
        start = self.root.find("scene/instance_visual_scene")
        scene = self._target(start.get("url")) if start is not None else self.root.find(".//visual_scene")
        if scene is None:
            raise ValueError("no scene")
        found: list[Part] = []
        for node in scene.findall("node"):
            found += self._node(node, np.diag([self.unit, self.unit, self.unit, 1.0]), 0)
        return found

    def _target(self, url: str | None) -> Element:
        return self.by_id[(url or "").lstrip("#")]

    def _node(self, node: Element, above: Floats, depth: int) -> Iterator[Part]:
        if depth > _DEEPEST:
            raise RecursionError("the nodes go round in a circle")
        here = above
        for child in node:
            if child.tag in ("matrix", "translate", "rotate", "scale"):
                here = here @ _transform(child.tag, np.array((child.text or "").split(), float))
        for child in node:
            if child.tag == "instance_geometry":
                yield from self._geometry(child, here)
            elif child.tag == "instance_node":
                yield from self._node(self._target(child.get("url")), here, depth + 1)
            elif child.tag == "node":
                yield from self._node(child, here, depth + 1)

    def _geometry(self, instance: Element, matrix: Floats) -> Iterator[Part]:
        symbols = {m.get("symbol"): m.get("target") for m in instance.iter("instance_material")}
        spin = np.linalg.inv(matrix[:3, :3])  # normals turn with the transposed inverse, here from the right
        for faces in self._target(instance.get("url")).findall("mesh/*"):
            if faces.tag not in _FACES:
                continue
            positions, normals, index = self._primitive(faces)
            if not len(index):
                continue
            rgba, textured = self._colour(symbols.get(faces.get("material")))
            placed = positions @ matrix[:3, :3].T + matrix[:3, 3]
            if normals is not None:
                normals = normals @ spin
                normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
            yield Part(placed, normals, index, rgba, textured)

    def _primitive(self, faces: Element) -> tuple[Floats, Floats | None, NDArray[np.int64]]:
        """Vertices, their normals, and triangles of one <triangles>, <polylist> or <polygons>."""
        offsets, sources = {}, {}
        stride = 1 + max(int(i.get("offset", 0)) for i in faces.findall("input"))
        for item in faces.findall("input"):
            # An input may be <vertices>, which has inputs of its own.
            for inner in self._target(item.get("source")).findall("input") or [item]:
                if inner.get("semantic") in ("POSITION", "NORMAL"):
                    offsets[inner.get("semantic")] = int(item.get("offset", 0))
                    sources[inner.get("semantic")] = self._numbers(inner.get("source"))
        lists = [np.array((p.text or "").split(), np.int64).reshape(-1, stride) for p in faces.findall("p")]
        corners = np.concatenate(lists) if lists else np.empty((0, stride), np.int64)
        counts = faces.find("vcount")
        if faces.tag == "polygons":
            sizes = np.array([len(p) for p in lists])
        elif faces.tag == "polylist" and counts is not None:
            sizes = np.array((counts.text or "").split(), np.int64)
        else:
            sizes = np.full(len(corners) // 3, 3)
        used = corners[:, [offsets[name] for name in sources]]
        pairs, place = np.unique(used, axis=0, return_inverse=True)
        columns = dict(zip(sources, pairs.T, strict=True))
        normals = sources["NORMAL"][columns["NORMAL"]] if "NORMAL" in sources else None
        triangles = place.reshape(-1)[_fans(sizes)]
        return sources["POSITION"][columns["POSITION"]], normals, triangles

    def _numbers(self, url: str | None) -> Floats:
        source = self._target(url)
        accessor = source.find("technique_common/accessor")
        stride = int(accessor.get("stride", 3)) if accessor is not None else 3
        array = source.find("float_array")
        values = np.array((array.text or "").split() if array is not None else [], float)
        return values.reshape(-1, stride)[:, :3]

    def _colour(self, target: str | None) -> tuple[Any, bool]:
        if target is None:
            return None, False
        link = self._target(target).find("instance_effect")
        effect = self._target(link.get("url")) if link is not None else None
        if effect is None:
            return None, False
        if effect.find(".//diffuse/texture") is not None:
            return None, True
        colour = effect.find(".//diffuse/color")
        if colour is None:
            return None, False
        red, green, blue = (float(c) for c in (colour.text or "").split()[:3])
        return (red, green, blue, 1.0), False


def _fans(sizes: NDArray[np.int64]) -> NDArray[np.int64]:
    """Triangles (m, 3) of polygons with that many corners each: fans from each polygon's first corner."""
    firsts = np.cumsum(sizes) - sizes
    if len(sizes) and np.all(sizes == 3):
        return firsts[:, None] + np.arange(3)
    fans = [(a, a + k, a + k + 1) for a, size in zip(firsts, sizes, strict=True) for k in range(1, size - 1)]
    return np.array(fans, np.int64).reshape(-1, 3)


def _transform(kind: str, numbers: Floats) -> Floats:
    matrix = np.eye(4)
    if kind == "matrix":
        return numbers.reshape(4, 4)
    if kind == "translate":
        matrix[:3, 3] = numbers
    elif kind == "scale":
        matrix[:3, :3] = np.diag(numbers)
    else:  # axis and angle in degrees: Rodrigues' formula
        axis, angle = numbers[:3] / np.linalg.norm(numbers[:3]), np.radians(numbers[3])
        cross = np.cross(np.eye(3), axis)
        matrix[:3, :3] += np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
    return matrix
