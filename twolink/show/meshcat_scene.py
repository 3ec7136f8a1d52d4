"""A robot's visual geometry as meshcat (three.js) objects, their poses, and meshcat's commands.

Objects are dictionaries in three.js's JSON format, which meshcat's viewer reads; meshcat itself is not imported.
Pieces that cannot be drawn, for want of their file, are named.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import quote

import numpy as np
import pinocchio as pin

from twolink.errors import ShowError
from twolink.show.mesh_files import SUFFIXES, file_object
from twolink.show.meshcat_shapes import SHAPES, Floats, Json, mesh, phong, triangle_geometry, triangles

# The viewer keeps its nodes in JavaScript objects, in which these keys exist from the start.
_RESERVED = re.compile(
    "constructor|hasOwnProperty|isPrototypeOf|propertyIsEnumerable|toLocaleString|toString|valueOf|__.*__"
)


class Piece(Protocol):
    """What has a pose and a size: a node of the viewer, or a surface."""

    @property
    def index(self) -> int: ...
    @property
    def corners(self) -> Floats: ...


@dataclass(frozen=True, slots=True)
class Node:
    """One piece of geometry that can be drawn."""

    name: str  # Pinocchio's name of the piece
    index: int  # its place in GeometryModel.geometryObjects
    path: str  # its place in meshcat's tree: "/robot/<name>"
    object: Json  # three.js JSON; a command places the node
    corners: Floats  # (8, 3) m, its bounding box in its own frame


def scene_nodes(visuals: Any) -> tuple[list[Node], list[str]]:
    """The pieces of the pin.GeometryModel `visuals` that can be drawn, and the names of those that cannot."""
    nodes: list[Node] = []
    skipped: list[str] = []
    taken: set[str] = set()
    for index, item in enumerate(visuals.geometryObjects):
        drawn = _draw(item, f"twolink-{index}")
        corners = _corners(item)
        if drawn is None or corners is None:
            skipped.append(item.name)
            continue
        nodes.append(Node(item.name, index, _path(item.name, taken), drawn, corners))
    return nodes, skipped


def require_pieces(
    pieces: Sequence[Piece], skipped: list[str], on_skipped: Callable[[list[str]], None] | None, where: str
) -> None:
    """Tell which pieces cannot be drawn. Raises ShowError (code "nothing-to-draw") when none can."""
    if skipped and on_skipped is not None:
        on_skipped(skipped)
    if not pieces:
        remedy = "give its links <visual> elements"
        raise ShowError("the robot has nothing to draw", where=where, remedy=remedy, code="nothing-to-draw")


def poses(model: Any, visuals: Any, q: Floats, nodes: Sequence[Piece]) -> Floats:
    """The poses of the nodes in the world frame.

    Parameters
    ----------
    model, visuals : pin.Model, pin.GeometryModel
        The robot.
    q : array (n, nq)
        Configurations.
    nodes : sequence of Piece
        The pieces.

    Returns
    -------
    array (n, len(nodes), 7)
        Position (m) and unit quaternion (x y z w). The sign of a quaternion does not jump from one configuration to
        the next: q and -q are one rotation, but a viewer that interpolates between them turns the body all the way
        round.
    """
    data, placed = model.createData(), pin.GeometryData(visuals)  # not shared: a pin.Data belongs to one thread
    result = np.empty((len(q), len(nodes), 7))
    for i, configuration in enumerate(q):
        pin.updateGeometryPlacements(model, data, visuals, placed, configuration)
        for k, node in enumerate(nodes):
            result[i, k] = pin.SE3ToXYZQUAT(placed.oMg[node.index])
    quaternions = result[..., 3:]
    flips = np.where((quaternions[1:] * quaternions[:-1]).sum(axis=-1) < 0.0, -1.0, 1.0)
    quaternions[1:] *= np.cumprod(flips, axis=0)[..., None]
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
    """The three.js object of one pin.GeometryObject; None when there is no way to draw it."""
    rgba = np.asarray(item.meshColor, float)
    if Path(item.meshPath).suffix.lower() in SUFFIXES:
        file_colours, scale = not item.overrideMaterial, np.diag([*np.asarray(item.meshScale, float), 1.0])
        drawn = file_object(Path(item.meshPath), file_colours=file_colours, rgba=rgba, uuid=uuid, scale=scale)
        if drawn is not None:
            return drawn
    kind = type(item.geometry).__name__
    if kind in SHAPES:
        geometry, matrix = SHAPES[kind](item.geometry)
        return mesh(geometry, [phong(rgba)], uuid, matrix)
    faces = triangles(item.geometry)
    if faces is None:
        return None
    # Without item.meshScale: the reader of the mesh has applied it.
    return mesh(triangle_geometry(*faces), [{**phong(rgba), "flatShading": True}], uuid)


def _corners(item: Any) -> Floats | None:
    """The corners (8, 3) of the box round a piece; None when the piece is empty or has no bounds."""
    item.geometry.computeLocalAABB()
    box = item.geometry.aabb_local
    sides = np.stack([box.min_, box.max_])
    if not np.all(np.isfinite(sides)) or np.any(np.abs(sides) > 1e6):
        return None
    return box_corners(*sides)


def box_corners(low: Floats, high: Floats) -> Floats:
    """The corners (8, 3) of the box from the corner `low` to `high`, (3,) each."""
    sides = np.stack([low, high])
    return np.array([sides[[i, j, k], [0, 1, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])


def _path(name: str, taken: set[str]) -> str:
    """A path for a piece that no other has; "/" separates levels there, so it is escaped."""
    safe = quote(name, safe=" ") or "unnamed"
    path = f"/robot/~{safe}" if _RESERVED.fullmatch(safe) else f"/robot/{safe}"
    number = 1
    while path in taken:
        number += 1
        path = f"/robot/{safe} ({number})"
    taken.add(path)
    return path
