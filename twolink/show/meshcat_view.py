"""How a motion is shown: its instants, and a camera, light and floor that suit all the robot sweeps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from twolink.errors import ShowError
from twolink.show.meshcat_scene import Node, set_object, set_pose, set_property
from twolink.show.meshcat_shapes import Floats, Json, buffer_geometry, mesh

Side = Literal["auto", "side", "iso", "front", "top"]

FIELD_OF_VIEW = 32.0  # degrees, vertical; narrow, so that parallel rods look parallel
MARGIN = 1.15
_DIRECTIONS = {
    "side": (0.0, -1.0, 0.0),
    "iso": (0.75, -1.0, 0.5),
    "front": (1.0, 0.0, 0.0),
    "top": (0.0, -1e-3, 1.0),
}
_CAMERA = "/Cameras/default/rotated/<object>"


@dataclass(frozen=True, slots=True)
class View:
    """Where to look from. The scene is moved so that `centre` is at meshcat's origin."""

    centre: Floats  # (3,) m
    direction: Floats  # (3,) unit, from the centre to the camera
    seen: Floats  # (m, 3) m: all that is swept, from the centre: to the right, up, and towards the camera
    floor: float  # m, height of the grid
    cell: float  # m, spacing of the grid

    def distance(self, aspect: float) -> float:
        """Distance (m) from which the whole motion fits a picture `aspect` times as wide as high."""
        slope = np.tan(np.radians(FIELD_OF_VIEW) / 2) / MARGIN
        right, up, near = np.abs(self.seen[:, 0]), np.abs(self.seen[:, 1]), self.seen[:, 2]
        return float(np.max(near + np.maximum(up, right / aspect) / slope))


def check_motion(model: Any, t: ArrayLike, q: ArrayLike, speed: float) -> tuple[Floats, Floats]:
    """t as (n,) s and q as (n, nq), checked: finite, of one length, time increasing. Raises ShowError."""
    times, configurations = np.atleast_1d(np.asarray(t, float)), np.atleast_2d(np.asarray(q, float))
    if configurations.shape != (*times.shape, model.nq) or not len(times):
        expected = f"(n,) and (n, {model.nq}), n >= 1"
        what = f"t is {times.shape} and q is {configurations.shape}, expected {expected}"
        raise ShowError(what, where="playback", remedy="give one configuration an instant")
    for name, values in (("t", times), ("q", configurations)):
        if not np.all(np.isfinite(values)):
            row = int(np.argwhere(~np.isfinite(values))[0][0])
            remedy = "show the part before it" if row else "nothing before it can be shown"
            raise ShowError(f"{name} is not finite at sample {row}", where="playback", remedy=remedy)
    if np.any(np.diff(times) <= 0.0):
        row = int(np.argmax(np.diff(times) <= 0.0)) + 1
        what = f"t does not increase at sample {row} ({times[row - 1]:g} s, then {times[row]:g} s)"
        raise ShowError(what, where="playback", remedy="sort the samples and drop repeated instants")
    if not (np.isfinite(speed) and speed > 0.0):
        what = f"speed is {speed}, expected a number above 0"
        raise ShowError(what, where="playback", remedy="1 is true speed")
    return times, configurations


def resample(model: Any, t: Floats, q: Floats, at: Floats) -> Floats:
    """Configurations (len(at), nq) at the times `at` (s), interpolated on the manifold."""
    left = np.clip(np.searchsorted(t, at, side="right") - 1, 0, max(len(t) - 2, 0))
    if len(t) == 1:
        return np.repeat(q, len(at), axis=0)
    part = np.clip((at - t[left]) / (t[left + 1] - t[left]), 0.0, 1.0)
    # Normalised, because quaternions read back from a rounded file are no longer quite of unit length.
    unit = [pin.normalize(model, row) for row in q]
    steps = zip(left, part, strict=True)
    return np.array([pin.interpolate(model, unit[i], unit[i + 1], u) for i, u in steps])


def look_at(nodes: Sequence[Node], placed: Floats, side: Side = "auto") -> View:
    """The view of a whole motion: placed is (n, len(nodes), 7) as from `meshcat_scene.poses`.

    "auto" looks square at the plane of the motion when there is one, else from the front right and above.
    """
    if side not in ("auto", *_DIRECTIONS):
        remedy = f"known: auto, {', '.join(_DIRECTIONS)}"
        raise ShowError(f"no view is named {side!r}", where="playback", remedy=remedy)
    points = _swept(nodes, placed[:: max(1, len(placed) // 300)])  # (n, k, 8, 3)
    normal = _plane(points)
    direction = np.array(_DIRECTIONS["iso" if side == "auto" else side])
    if side == "auto" and normal is not None:
        direction = _facing(normal)
    direction /= np.linalg.norm(direction)
    right = np.cross([0.0, 0.0, 1.0], direction)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(direction, right), direction])
    seen = points.reshape(-1, 3) @ axes.T
    middle = (seen.min(axis=0) + seen.max(axis=0)) / 2
    bottom, size = float(points[..., 2].min()), max(float(np.max(np.abs(seen - middle)[:, :2])), 1e-3)
    falls = np.ptp(points[..., 2].min(axis=(1, 2))) > 1e-6  # then leave some air below the lowest point
    floor = bottom - (0.04 * size if falls else 0.0)
    cells = 10.0 ** np.floor(np.log10(size / 2.5)) * np.array([1.0, 2.0, 5.0])
    return View(axes.T @ middle, direction, seen - middle, floor, float(cells[cells <= size / 2.5][-1]))


def stage(view: View, aspect: float) -> list[Json]:
    """The commands that set camera, light, background and floor, for a picture of that aspect."""
    distance = view.distance(aspect)
    up, left = np.array([0.0, 0.0, 1.0]), np.cross(view.direction, [0.0, 0.0, 1.0])
    key = view.direction + 0.9 * up + 0.5 * left
    commands = [set_property(f"/Lights/{name}", "visible", False) for name in _UNUSED_LIGHTS]
    commands += [set_property(path, "visible", False) for path in ("/Grid", "/Axes")]
    commands += [
        set_property("/Background", "top_color", [1.0, 1.0, 1.0]),
        set_property("/Background", "bottom_color", [0.88, 0.91, 0.94]),
        set_property("/Lights/AmbientLight/<object>", "intensity", 0.55),
        set_property("/Lights/FillLight/<object>", "intensity", 0.5),
        set_property("/Lights/FillLight/<object>", "position", (10 * key).tolist()),
        set_object("/floor", _grid(view)),
        *(set_pose(path, np.array([*-view.centre, 0.0, 0.0, 0.0, 1.0])) for path in ("/robot", "/floor")),
        set_property(_CAMERA, "fov", FIELD_OF_VIEW),
        set_property(_CAMERA, "near", distance / 100),
        set_property(_CAMERA, "far", distance * 100),
        set_property(_CAMERA, "position", to_three(distance * view.direction)),
    ]
    return commands


_UNUSED_LIGHTS = ("SpotLight", "PointLightNegativeX", "PointLightPositiveX")


def to_three(vector: Floats) -> list[float]:
    """A vector with z up as one with y up, which is how meshcat's camera counts."""
    return [float(vector[0]), float(vector[2]), float(-vector[1])]


def _swept(nodes: Sequence[Node], placed: Floats) -> Floats:
    """The corners of the nodes' boxes in the world: (n, k, 8, 3) m."""
    u, w = placed[:, :, None, 3:6], placed[:, :, None, 6:]
    corners = np.stack([node.corners for node in nodes])[None]
    spun = np.cross(u, corners)
    return placed[:, :, None, :3] + corners + 2.0 * (w * spun + np.cross(u, spun))


def _plane(points: Floats) -> Floats | None:
    """The unit normal of the plane in which everything moves, or None."""
    steps = (points - points[:1]).reshape(-1, 3)
    _, sizes, axes = np.linalg.svd(steps.T @ steps)  # squares of the singular values of the steps
    if sizes[1] > 1e-6 * sizes[0] > 0.0 and sizes[2] < 1e-8 * sizes[0]:
        return np.asarray(axes[2])
    return None


def _facing(normal: Floats) -> Floats:
    """The side of a plane from which x points right (y, in a plane across x); or from above."""
    if abs(normal[2]) > 0.99:
        return np.array(_DIRECTIONS["top"])
    right = np.cross([0.0, 0.0, 1.0], normal)
    leading = right[0] if abs(right[0]) > 1e-6 else right[1]
    return np.asarray(normal if leading > 0 else -normal)


def _grid(view: View) -> Json:
    """A square grid round the motion, its lines at round coordinates, fine enough to give a sense of size."""
    reach = view.cell * np.ceil(2.0 * float(np.max(np.abs(view.seen))) / view.cell)
    middle = view.cell * np.round(view.centre[:2] / view.cell)
    lines = np.arange(-reach, reach + view.cell / 2, view.cell)
    edge = np.full_like(lines, reach)
    along = np.stack([np.stack([lines, -edge], -1), np.stack([lines, edge], -1)], axis=1).reshape(-1, 2)
    flat = np.concatenate([along, along[:, ::-1]]) + middle
    vertices = np.column_stack([flat, np.full(len(flat), view.floor)])
    material = {"type": "LineBasicMaterial", "color": 0xC3CAD2}
    return mesh(buffer_geometry(vertices), material, "twolink-floor", kind="LineSegments")
