"""Where the camera stands to see the whole motion of a robot."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from twolink.errors import ShowError
from twolink.show.meshcat_scene import Piece
from twolink.show.meshcat_shapes import Floats

FIELD_OF_VIEW = 32.0  # degrees, vertical; narrow, so that parallel rods look parallel
MARGIN = 1.15  # empty space round the motion
_SAMPLES = 300  # configurations that decide on the view, at most
_SLANTED, _FROM_ABOVE = (0.75, -1.0, 0.5), (0.0, -1e-3, 1.0)  # directions towards the camera


@dataclass(frozen=True, slots=True)
class View:
    """Where the camera looks from, and to: the centre of the motion."""

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
    given = _plane_direction(points) if towards is None else _given(towards)
    direction = np.array(_SLANTED) / np.linalg.norm(_SLANTED) if given is None else given
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
    """The same for the points (n, k, 8, 3) that a motion goes through."""
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
