"""Camera, lights and grid that suit the whole motion of a robot."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from twolink.errors import ShowError
from twolink.show.meshcat_scene import Node, Piece, set_object, set_pose, set_property
from twolink.show.meshcat_shapes import Floats, Json, attribute, mesh

FIELD_OF_VIEW = 32.0  # degrees, vertical; narrow, so that parallel rods look parallel
MARGIN = 1.15  # empty space round the motion
_SAMPLES = 300  # configurations that decide on the view, at most
_ASPECT = 1.6  # width to height of a window of unknown size
_SLANTED, _FROM_ABOVE = (0.75, -1.0, 0.5), (0.0, -1e-3, 1.0)  # directions towards the camera
_CAMERA = "/Cameras/default/rotated/<object>"


@dataclass(frozen=True, slots=True)
class View:
    """Where the camera looks from. The scene is moved so that `centre` is at meshcat's origin."""

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


def look_at(nodes: Sequence[Piece], placed: Floats, towards: ArrayLike | None = None) -> View:
    """The view of a motion: square at its plane when there is one, else from the front right and above.

    Parameters
    ----------
    nodes : sequence of Piece
        The bodies.
    placed : array (n, len(nodes), 7)
        Their poses along the motion, as from `meshcat_scene.poses`.
    towards : array_like (3,), optional
        The direction from the bodies to the camera, in place of that.
    """
    points = _reached(nodes, placed[:: max(1, len(placed) // _SAMPLES)])
    direction = _direction(points) if towards is None else _given(towards)
    axes = picture_axes(direction)
    seen = points.reshape(-1, 3) @ axes.T
    middle = (seen.min(axis=0) + seen.max(axis=0)) / 2
    size = max(float(np.max(np.abs(seen - middle)[:, :2])), 1e-3)
    lowest = points[..., 2].min(axis=(1, 2))
    floor = lowest.min() - (0.04 * size if np.ptp(lowest) > 1e-6 else 0.0)  # a gap below what goes up and down
    cells = 10.0 ** np.floor(np.log10(size / 2.5)) * np.array([1.0, 2.0, 5.0])
    return View(axes.T @ middle, direction, seen - middle, float(floor), float(cells[cells <= size / 2.5][-1]))


def picture_axes(direction: Floats) -> Floats:
    """The unit vectors (3, 3) to the right, up, and towards a camera in that direction (3,)."""
    right = np.cross([0.0, 0.0, 1.0], direction)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(direction, right), direction])


def opening_commands(nodes: Sequence[Node], placed: Floats, view: View) -> list[Json]:
    """The commands that draw the bodies in the motion's first pose, with camera, lights, background and grid."""
    distance = view.distance(_ASPECT)
    up, left = np.array([0.0, 0.0, 1.0]), np.cross(view.direction, [0.0, 0.0, 1.0])
    key_light = view.direction + 0.9 * up + 0.5 * left
    hidden = ("/Lights/SpotLight", "/Lights/PointLightNegativeX", "/Lights/PointLightPositiveX", "/Axes", "/Grid")
    return [
        *(set_object(node.path, node.object) for node in nodes),
        *(set_pose(node.path, pose) for node, pose in zip(nodes, placed[0], strict=True)),
        set_object("/floor", _grid(view)),
        *(set_pose(path, np.array([*-view.centre, 0.0, 0.0, 0.0, 1.0])) for path in ("/robot", "/floor")),
        *(set_property(path, "visible", False) for path in hidden),
        set_property("/Background", "top_color", [1.0, 1.0, 1.0]),
        set_property("/Background", "bottom_color", [0.88, 0.91, 0.94]),
        set_property("/Lights/AmbientLight/<object>", "intensity", 0.55),
        set_property("/Lights/FillLight/<object>", "intensity", 0.5),
        set_property("/Lights/FillLight/<object>", "position", (10 * key_light).tolist()),
        set_property(_CAMERA, "fov", FIELD_OF_VIEW),
        set_property(_CAMERA, "near", distance / 100),
        set_property(_CAMERA, "far", distance * 100),
        set_property(_CAMERA, "position", to_three(distance * view.direction)),
    ]


def _grid(view: View) -> Json:
    """A square grid below the motion, its lines at round coordinates. It ends in front of the camera."""
    reach = view.cell * np.ceil(2.0 * float(np.max(np.abs(view.seen))) / view.cell)
    middle = view.cell * np.round(view.centre[:2] / view.cell)
    x, y = np.meshgrid(np.arange(-reach, reach + view.cell / 2, view.cell), [-reach, reach], indexing="ij")
    ends = np.column_stack([x.ravel(), y.ravel()])
    corners = np.concatenate([ends, ends[:, ::-1]]) + middle
    position = attribute(np.column_stack([corners, np.full(len(corners), view.floor)]))
    geometry = {"type": "BufferGeometry", "data": {"attributes": {"position": position}}}
    return mesh(geometry, [{"type": "LineBasicMaterial", "color": 0xC3CAD2}], "twolink-floor", kind="LineSegments")


def to_three(vector: Floats) -> list[float]:
    """A vector with z up as one with y up, which is how meshcat's camera counts."""
    return [float(vector[0]), float(vector[2]), float(-vector[1])]


def _given(towards: ArrayLike) -> Floats:
    """A direction as a unit vector, not quite along z, where up would have no place in the picture."""
    direction = np.asarray(towards, float)
    if direction.shape != (3,) or not np.isfinite(direction).all() or not direction.any():
        what = f"direction is {towards!r}, expected three numbers that are not all 0"
        raise ShowError(what, where="camera", remedy="such as (0, -1, 0.3): from the front, a little above")
    unit = direction / np.linalg.norm(direction)
    unit[1] -= 1e-3 * (abs(unit[2]) > 1.0 - 1e-9)
    return np.asarray(unit / np.linalg.norm(unit))


def _reached(nodes: Sequence[Piece], placed: Floats) -> Floats:
    """The corners of the nodes' boxes in the world: (n, k, 8, 3) m."""
    u, w = placed[:, :, None, 3:6], placed[:, :, None, 6:]
    corners = np.stack([node.corners for node in nodes])[None]
    turned = np.cross(u, corners)
    return placed[:, :, None, :3] + corners + 2.0 * (w * turned + np.cross(u, turned))


def _direction(points: Floats) -> Floats:
    """The unit direction towards the camera for a motion through these points (n, k, 8, 3)."""
    steps = (points - points[:1]).reshape(-1, 3)
    _, sizes, axes = np.linalg.svd(steps.T @ steps)  # squares of the singular values of the steps
    if not (sizes[1] > 1e-6 * sizes[0] > 0.0 and sizes[2] < 1e-8 * sizes[0]):
        direction = np.array(_SLANTED)  # the motion has no plane
    elif abs(axes[2, 2]) > 0.99:
        direction = np.array(_FROM_ABOVE)
    else:  # the side of the plane from which x points right, or y where the plane is across x
        right = np.cross([0.0, 0.0, 1.0], axes[2])
        direction = axes[2] * (1.0 if (right[0] if abs(right[0]) > 1e-6 else right[1]) > 0 else -1.0)
    return np.asarray(direction / np.linalg.norm(direction))
