"""A robot's visual geometry as meshcat (three.js) objects, and where its pieces are at each configuration.

The objects are the plain dictionaries of the three.js JSON format that meshcat's viewer reads, so neither
meshcat nor its server is imported here. What cannot be drawn (its file is gone) is named, never fatal.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import pinocchio as pin

from twolink.show.mesh_files import SUFFIXES, file_object
from twolink.show.meshcat_shapes import SHAPES, Floats, Json, buffer_geometry, mesh, phong, triangles

# The viewer keeps its nodes in JavaScript objects, where these keys exist from the start and pass for nodes.
_RESERVED = {"constructor", "hasOwnProperty", "isPrototypeOf", "propertyIsEnumerable", "toLocaleString"}
_RESERVED |= {"toString", "valueOf"}


@dataclass(frozen=True, slots=True)
class Node:
    """One piece of geometry that can be drawn."""

    name: str  # Pinocchio's name for it
    index: int  # its place in GeometryModel.geometryObjects
    path: str  # its place in meshcat's tree: "/robot/<name>"
    object: Json  # three.js JSON; the node is placed by a transform of its own
    corners: Floats  # (8, 3) m, its bounding box in its own frame


def scene_nodes(visuals: Any) -> tuple[list[Node], list[str]]:
    """What can be drawn of the pin.GeometryModel `visuals`, and the names of the pieces that cannot."""
    nodes: list[Node] = []
    skipped: list[str] = []
    taken: set[str] = set()
    for index, item in enumerate(visuals.geometryObjects):
        drawn = _draw(item, f"twolink-{index}")
        corners = _corners(item)
        if drawn is None or corners is None:
            skipped.append(item.name)
            continue
        path = _path(item.name, taken)
        nodes.append(Node(item.name, index, path, drawn, corners))
    return nodes, skipped


def poses(model: Any, visuals: Any, q: Floats, nodes: Sequence[Node]) -> Floats:
    """Where the nodes are: (n, len(nodes), 7), position (m) and unit quaternion (x y z w) in the world frame.

    q is (n, nq). Quaternions keep their sign from one configuration to the next: q and -q are the same
    rotation, but a viewer that interpolates between them would spin the body all the way round.
    """
    data, placed = model.createData(), pin.GeometryData(visuals)  # private: a pin.Data belongs to one thread
    result = np.empty((len(q), len(nodes), 7))
    for i, configuration in enumerate(q):
        pin.updateGeometryPlacements(model, data, visuals, placed, configuration)
        for k, node in enumerate(nodes):
            result[i, k] = pin.SE3ToXYZQUAT(placed.oMg[node.index])
    turns = result[..., 3:]
    flips = np.where((turns[1:] * turns[:-1]).sum(axis=-1) < 0.0, -1.0, 1.0)
    turns[1:] *= np.cumprod(flips, axis=0)[..., None]
    return result


def set_object(path: str, drawn: Json) -> Json:
    """The command that puts an object into the viewer's tree."""
    return {"type": "set_object", "path": path, "object": drawn}


def set_pose(path: str, pose: Floats) -> Json:
    """The command that places a node: pose is (7,), position (m) and quaternion (x y z w)."""
    matrix = pin.XYZQUATToSE3(np.asarray(pose, float)).homogeneous
    return {"type": "set_transform", "path": path, "matrix": matrix.T.ravel().tolist()}


def set_property(path: str, key: str, value: object) -> Json:
    """The command that sets a property of a node."""
    return {"type": "set_property", "path": path, "property": key, "value": value}


def _draw(item: Any, uuid: str) -> Json | None:
    """The three.js object of one pin.GeometryObject, or None when there is no way to draw it."""
    rgba = np.asarray(item.meshColor, float)
    if Path(item.meshPath).suffix.lower() in SUFFIXES:
        file_colours, scale = not item.overrideMaterial, np.diag([*np.asarray(item.meshScale, float), 1.0])
        drawn = file_object(Path(item.meshPath), file_colours=file_colours, rgba=rgba, uuid=uuid, scale=scale)
        if drawn is not None:
            return drawn
    material = phong(rgba)
    kind = type(item.geometry).__name__
    if kind in SHAPES:
        geometry, matrix = SHAPES[kind](item.geometry)
        return mesh(geometry, material, uuid, matrix)
    faces = triangles(item.geometry)
    if faces is None:
        return None
    # No scale here: whoever read the mesh has applied it already.
    return mesh(buffer_geometry(*faces), {**material, "flatShading": True}, uuid)


def _corners(item: Any) -> Floats | None:
    item.geometry.computeLocalAABB()
    low, high = np.asarray(item.geometry.aabb_local.min_), np.asarray(item.geometry.aabb_local.max_)
    sides = np.stack([low, high])
    if not np.all(np.isfinite(sides)) or np.any(np.abs(sides) > 1e6):  # empty or unbounded
        return None
    return np.array([[sides[i, 0], sides[j, 1], sides[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])


def _path(name: str, taken: set[str]) -> str:
    """A path of its own for a geometry name; "/" separates levels there, so it is escaped."""
    safe = quote(name, safe=" ") or "unnamed"
    if safe in _RESERVED or re.fullmatch(r"__\w+__", safe):
        safe = f"~{safe}"
    number = 1
    while (path := f"/robot/{safe}" if number == 1 else f"/robot/{safe} ({number})") in taken:
        number += 1
    taken.add(path)
    return path
