"""A robot's visual geometry as three.js objects, their poses, and where the camera stands to see the whole motion.

Objects are dictionaries in three.js's JSON format, which meshcat's viewer reads; meshcat itself is not imported.
Pieces that cannot be drawn, for want of their file, are named.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from twolink.errors import ShowError
from twolink.io.mesh_files import SUFFIXES
from twolink.show.meshcat_shapes import (
    SHAPES,
    Floats,
    Json,
    materials_object,
    mesh,
    mesh_parts,
    parts_object,
    phong,
    triangle_geometry,
    triangles,
)

FIELD_OF_VIEW = 32.0  # degrees, vertical; narrow, so that parallel rods look parallel
MARGIN = 1.15  # empty space round the motion
_SAMPLES = 300  # configurations that decide on the view, at most
_SLANTED, _FROM_ABOVE = (0.75, -1.0, 0.5), (0.0, -1e-3, 1.0)  # directions towards the camera


class PosedPiece(Protocol):
    """An object with a pose and a size: a node of the viewer, or a surface."""

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
            made[same] = _draw(visuals, item, f"twolink-{index}")
        drawn = made[same]
        if drawn is None or corners is None:
            skipped.append(item.name)
            continue
        nodes.append(Node(item.name, index, drawn, corners))
    return nodes, skipped


def require_pieces(
    pieces: Sequence[PosedPiece], skipped: list[str], on_skipped: Callable[[list[str]], None] | None, where: str
) -> None:
    """Tell which pieces cannot be drawn. Raises ShowError (code "nothing-to-draw") when none can."""
    if skipped and on_skipped is not None:
        on_skipped(skipped)
    if not pieces:
        remedy = "give its links <visual> elements, or package_dirs= where the meshes of these are not found"
        raise ShowError("the robot has nothing to draw", where=where, remedy=remedy, code="nothing-to-draw")


def poses(model: Any, visuals: Any, q: Floats, nodes: Sequence[PosedPiece]) -> Floats:
    """The poses of the nodes in the world frame.

    Parameters
    ----------
    model, visuals : pin.Model, pin.GeometryModel
        The robot.
    q : array (n, nq)
        Configurations.
    nodes : sequence of PosedPiece
        The pieces.

    Returns
    -------
    array (n, len(nodes), 7)
        Position (m) and unit quaternion (x y z w).
    """
    data, placed = model.createData(), pin.GeometryData(visuals)  # not shared: a pin.Data belongs to one thread
    result = np.empty((len(q), len(nodes), 7))
    for i, configuration in enumerate(q):
        pin.updateGeometryPlacements(model, data, visuals, placed, configuration)
        for k, node in enumerate(nodes):
            result[i, k] = pin.SE3ToXYZQUAT(placed.oMg[node.index])
    return result


def _look(item: Any) -> tuple[object, ...]:
    """The fields that decide on the object of a mesh; () for a shape."""
    numbers = np.concatenate([item.meshScale, item.meshColor]).tolist()
    return (item.meshPath, item.overrideMaterial, *numbers) if Path(item.meshPath).suffix.lower() in SUFFIXES else ()


def _draw(visuals: Any, item: Any, uuid: str) -> Json | None:
    """The three.js object of one pin.GeometryObject; None when there is no way to draw it."""
    rgba, path = np.asarray(item.meshColor, float), Path(item.meshPath)
    file_colours, scale = not item.overrideMaterial, np.diag([*np.asarray(item.meshScale, float), 1.0])
    drawn = materials_object(path, uuid, scale) if file_colours and path.suffix.lower() == ".obj" else None
    if drawn is not None:
        return drawn
    if parts := mesh_parts(visuals, item):
        return parts_object(parts, path.parent, file_colours=file_colours, rgba=rgba, uuid=uuid, scale=scale)
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


@dataclass(frozen=True, slots=True)
class View:
    """The view of the camera: its direction, and its target, the centre of the motion."""

    centre: Floats  # (3,) m
    direction: Floats  # (3,) unit, from the centre to the camera
    seen: Floats  # (m, 3) m: all points that bodies reach, from the centre: right, up, towards the camera
    floor: float  # m, height of the grid
    cell: float  # m, spacing of the grid

    def distance(self, aspect: float) -> float:
        """Distance (m) from which the whole motion fits a picture `aspect` times as wide as high."""
        slope = np.tan(np.radians(FIELD_OF_VIEW) / 2) / MARGIN
        right, up, near = np.abs(self.seen[:, 0]), np.abs(self.seen[:, 1]), self.seen[:, 2]
        return float(np.max(near + np.maximum(up, right / aspect) / slope))


def look_at(
    nodes: Sequence[PosedPiece], placed: Floats, towards: ArrayLike | None = None, *, touches: bool = False
) -> View:
    """The view of a motion: square at its plane when there is one, else from the front right and above.

    Parameters
    ----------
    nodes : sequence of PosedPiece
        The bodies.
    placed : array (n, len(nodes), 7)
        Their poses along the motion, as from `meshcat_scene.poses`.
    towards : array_like (3,), optional
        The direction from the bodies to the camera, in place of that.
    touches : bool
        Bodies touch the floor: there is no gap between it and the lowest point, as there is below others that move.
    """
    points = _reached(nodes, placed[:: max(1, len(placed) // _SAMPLES)])
    given = _plane_direction(points) if towards is None else _given(towards)
    direction = np.array(_SLANTED) / np.linalg.norm(_SLANTED) if given is None else given
    axes = picture_axes(direction)
    seen = points.reshape(-1, 3) @ axes.T
    middle = (seen.min(axis=0) + seen.max(axis=0)) / 2
    size = max(float(np.max(np.abs(seen - middle)[:, :2])), 1e-3)
    lowest = points[..., 2].min(axis=(1, 2))
    floor = lowest.min() - (0.04 * size if np.ptp(lowest) > 1e-6 and not touches else 0.0)
    cells = 10.0 ** np.floor(np.log10(size / 2.5)) * np.array([1.0, 2.0, 5.0])
    return View(axes.T @ middle, direction, seen - middle, float(floor), float(cells[cells <= size / 2.5][-1]))


def picture_axes(direction: Floats) -> Floats:
    """The unit vectors (3, 3) to the right, up, and towards a camera in that direction (3,)."""
    right = np.cross([0.0, 0.0, 1.0], direction)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(direction, right), direction])


def _given(towards: ArrayLike) -> Floats:
    """A direction as a unit vector, not quite along z, where up would have no place in the picture."""
    try:
        direction = np.asarray(towards, float)
    except (TypeError, ValueError):
        direction = np.empty(0)
    if direction.shape != (3,) or not np.isfinite(direction).all() or not direction.any():
        what = f"direction is {towards!r}, expected three numbers that are not all 0"
        raise ShowError(what, where="camera", remedy="such as (0, -1, 0.3): from the front, a little above")
    unit = direction / np.linalg.norm(direction)
    unit[1] -= 1e-3 * (abs(unit[2]) > 1.0 - 1e-9)
    return np.asarray(unit / np.linalg.norm(unit))


def _reached(nodes: Sequence[PosedPiece], placed: Floats) -> Floats:
    """The corners of the nodes' boxes in the world: (n, k, 8, 3) m."""
    return _moved(np.stack([node.corners for node in nodes]), placed)


def _moved(points: Floats, placed: Floats) -> Floats:
    """Points (m, 3), or (k, m, 3), of k bodies where their poses (n, k, 7) put them: (n, k, m, 3) m."""
    u, w = placed[:, :, None, 3:6], placed[:, :, None, 6:]
    turned = np.cross(u, points)
    return placed[:, :, None, :3] + points + 2.0 * (w * turned + np.cross(u, turned))


def plane_direction(placed: Floats) -> list[float] | None:
    """The unit direction from bodies that move in one plane to the camera; None where they do not.

    placed (n, k, 7): the poses of the bodies along the motion, position (m) and quaternion (x y z w).
    """
    if not placed.size:
        return None
    some = placed[:: max(1, len(placed) // _SAMPLES)]
    reach = float(np.ptp(some[..., :3])) or 1.0
    points = reach * np.concatenate([np.zeros((1, 3)), np.eye(3)])  # of each body; any that are not in a line do
    direction = _plane_direction(_moved(points, some))
    return None if direction is None else direction.tolist()


def _plane_direction(points: Floats) -> Floats | None:
    """The direction of `plane_direction`, of the points (n, k, 8, 3) that a motion goes through."""
    steps = (points - points[:1]).reshape(-1, 3)
    _, sizes, axes = np.linalg.svd(steps.T @ steps)  # squares of the singular values of the steps
    if not (sizes[1] > 1e-6 * sizes[0] > 0.0 and sizes[2] < 1e-8 * sizes[0]):
        return None
    if abs(axes[2, 2]) > 0.99:
        direction = np.array(_FROM_ABOVE)
    else:  # the side of the plane from which x points right, or y where the plane is across x
        right = np.cross([0.0, 0.0, 1.0], axes[2])
        direction = axes[2] * (1.0 if (right[0] if abs(right[0]) > 1e-6 else right[1]) > 0 else -1.0)
    return np.asarray(direction / np.linalg.norm(direction))
