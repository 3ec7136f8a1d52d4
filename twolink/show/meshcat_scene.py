"""A robot's visual geometry as three.js objects, and their poses.

Objects are dictionaries in three.js's JSON format, which meshcat's viewer reads; meshcat itself is not imported.
Pieces that cannot be drawn, for want of their file, are named.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pinocchio as pin

from twolink.errors import ShowError
from twolink.show.mesh_files import SUFFIXES, file_object
from twolink.show.meshcat_shapes import SHAPES, Floats, Json, mesh, phong, triangle_geometry, triangles


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
    object: Json  # three.js JSON; copies of one mesh share it
    corners: Floats  # (8, 3) m, its bounding box in its own frame


def scene_nodes(visuals: Any) -> tuple[list[Node], list[str]]:
    """The pieces of the pin.GeometryModel `visuals` that can be drawn, and the names of those that cannot."""
    nodes: list[Node] = []
    skipped: list[str] = []
    made: dict[object, Json | None] = {}
    for index, item in enumerate(visuals.geometryObjects):
        corners, same = _corners(item), _look(item) or index
        if same not in made:
            made[same] = _draw(item, f"twolink-{index}")
        drawn = made[same]
        if drawn is None or corners is None:
            skipped.append(item.name)
            continue
        nodes.append(Node(item.name, index, drawn, corners))
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


def _look(item: Any) -> tuple[object, ...]:
    """What decides on the object of a mesh; () for a shape."""
    numbers = np.concatenate([item.meshScale, item.meshColor]).tolist()
    return (item.meshPath, item.overrideMaterial, *numbers) if Path(item.meshPath).suffix.lower() in SUFFIXES else ()


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
