"""Pictures of a robot by casting rays, with shadows, and arrows for forces over them: no display, no browser and no
OpenGL is needed.

Embree finds what a ray hits (embreex, which yourdfpy brings). It is loaded when a picture is made.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from twolink.errors import ShowError
from twolink.show.meshcat_scene import FIELD_OF_VIEW, View, picture_axes
from twolink.show.surfaces import Floats, TriangleMesh
from twolink.show.viewer_data import Contacts, sample_before

AMBIENT, DIFFUSE, SHINE = 0.5, 0.5, 0.12  # shares of light
SHININESS = 30.0
SHADOW = 0.82  # of the floor's brightness
TOP, BOTTOM = np.array([1.0, 1.0, 1.0]), np.array([0.88, 0.91, 0.94])  # of the background
LINE = np.array([0.76, 0.79, 0.82])  # of the floor's grid
CLEAR = 2e-6  # of the distance from the camera: a few of the last digits of a single
EDGE = 0.03  # a difference between neighbours from which a pixel is cast again
OFFSETS = np.array([(-0.33, -0.11), (0.11, -0.33), (0.33, 0.11), (-0.11, 0.33)])  # pixels: a turned square
CONTACT_COLOUR, FORCE_COLOUR = (194, 37, 92), (28, 126, 214)  # as overlays.js has them
OPACITY = 0.85
LONGEST = 0.22  # of the motion's extent, the strongest force
TYPICAL = 2.0  # times the force that nine of ten stay below is shown as long at most: blows last one sample
FINE = 3  # an arrow is drawn so many times larger, and reduced
HEAD, DOT, SHAFT = 0.028, 0.009, 0.005  # of the picture's height: length, radius, width
Image = NDArray[np.uint8]


class Camera:
    """Rays through the pixels of a picture.

    Parameters
    ----------
    view : View
        Where it looks from.
    size : (width, height)
        Pixels.
    """

    def __init__(self, view: View, size: tuple[int, int]) -> None:
        self.view, self.size = view, size
        width, height = size
        self.axes = picture_axes(view.direction)
        self.position = view.centre + view.distance(width / height) * view.direction
        self.pixel = 2.0 * np.tan(np.radians(FIELD_OF_VIEW) / 2) / height
        towards = view.direction + np.array([0.0, 0.0, 0.9]) - 0.5 * self.axes[0]
        self.light = towards / np.linalg.norm(towards)

    def rays(self, pixels: Floats) -> Floats:
        """Unit directions (n, 3) through points (n, 2) of the picture: columns and rows from its upper left."""
        width, height = self.size
        x = (pixels[:, 0] + 0.5 - width / 2) * self.pixel
        y = (height / 2 - pixels[:, 1] - 0.5) * self.pixel
        right, up, back = self.axes
        directions = x[:, None] * right + y[:, None] * up - back
        return np.asarray(directions / np.sqrt(1.0 + x * x + y * y)[:, None])

    def place(self, points: Floats) -> Floats:
        """Positions of points (n, 3), m, in the picture: columns and rows (n, 2) from its upper left."""
        width, height = self.size
        x, y, back = ((points - self.position) @ self.axes.T).T
        return np.column_stack([width / 2 - 0.5 - x / back / self.pixel, height / 2 - 0.5 + y / back / self.pixel])


class Ground(NamedTuple):
    """The background of n rays that meet no body, and the m of them that meet the floor."""

    colours: Floats  # (n, 3)
    rows: NDArray[np.intp]  # (m,)
    points: NDArray[np.float32]  # (m, 3) m, from the camera's target, just above the floor
    fade: Floats  # (m,) 1 near the robot, 0 far away


class Picture:
    """Pictures of a robot in any configuration.

    Parameters
    ----------
    model, visuals : pin.Model, pin.GeometryModel
        The robot.
    drawn : sequence of TriangleMesh
        What to draw.
    camera : Camera
        From where.
    """

    def __init__(self, model: Any, visuals: Any, drawn: Sequence[TriangleMesh], camera: Camera) -> None:
        self._new_scene, self._new_mesh = _embree()
        self._model, self._visuals, self._camera = model, visuals, camera
        self._data, self._placed = model.createData(), pin.GeometryData(visuals)
        self._drawn = drawn
        self._colours = np.concatenate([surface.colours for surface in drawn])
        columns, rows = np.meshgrid(*(np.arange(side, dtype=float) for side in camera.size))
        self._pixels = np.column_stack([columns.ravel(), rows.ravel()])
        self._rays = camera.rays(self._pixels)
        self._ground = self._smooth_ground()

    def of(self, q: Floats) -> NDArray[np.uint8]:
        """The picture (height, width, 3) of configuration q (nq,)."""
        pin.updateGeometryPlacements(self._model, self._data, self._visuals, self._placed, q)
        corners, normals = [], []
        for surface in self._drawn:
            pose = self._placed.oMg[surface.index]
            corners.append(surface.triangles @ pose.rotation.T + pose.translation)
            normals.append(surface.normals @ pose.rotation.T)
        return self._cast(np.concatenate(corners), np.concatenate(normals))

    def _cast(self, corners: Floats, normals: Floats) -> NDArray[np.uint8]:
        """Every pixel once, and four times where a body or a shadow has an edge."""
        scene = self._new_scene()
        # Relative to the camera's target: Embree's numbers have seven digits.
        triangles = (corners - self._camera.view.centre).astype(np.float32)
        mesh = self._new_mesh(scene, triangles)
        width, height = self._camera.size
        colours, touched = self._shade(scene, self._ground, self._rays, normals)
        edges = _edges(colours.reshape(height, width, 3), touched.reshape(height, width))
        again = (self._pixels[edges][:, None] + OFFSETS).reshape(-1, 2)
        if len(again):
            rays = self._camera.rays(again)
            several, _ = self._shade(scene, self._seen_empty(again, rays), rays, normals)
            colours[edges] = several.reshape(-1, len(OFFSETS), 3).mean(axis=1)
        del mesh  # Embree's scene refers to it
        return np.asarray(np.round(255.0 * np.clip(colours, 0.0, 1.0)), np.uint8).reshape(height, width, 3)

    def _smooth_ground(self) -> Ground:
        """The background of the pixels, where there is no body: it is the same in all pictures."""
        width, height = self._camera.size
        ground = self._seen_empty(self._pixels, self._rays)
        edges = _edges(ground.colours.reshape(height, width, 3), np.ones((height, width), bool))
        again = (self._pixels[edges][:, None] + OFFSETS).reshape(-1, 2)
        several = self._seen_empty(again, self._camera.rays(again)).colours
        ground.colours[edges] = several.reshape(-1, len(OFFSETS), 3).mean(axis=1)
        return ground

    def _shade(self, scene: Any, ground: Ground, rays: Floats, normals: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        """Colours (n, 3) seen along rays (n, 3), and whether a body or its shadow is (n,). ground: without them."""
        camera = self._camera
        start = camera.position - camera.view.centre
        hits = scene.run(_singles(np.broadcast_to(start, rays.shape)), _singles(rays), query="INTERSECT", output=1)
        colours, body = ground.colours.copy(), hits["primID"] >= 0
        free = ~body[ground.rows]
        shaded = np.flatnonzero(free)[self._in_shadow(scene, ground.points[free])]
        colours[ground.rows[shaded]] *= 1.0 - (1.0 - SHADOW) * ground.fade[shaded, None]
        touched = body.copy()
        touched[ground.rows[shaded]] = True
        if not body.any():
            return colours, touched
        triangle, weights = hits["primID"][body], np.column_stack([hits["u"], hits["v"]])[body]
        weights = np.column_stack([1.0 - weights.sum(axis=1), weights])
        normal, own = (np.einsum("nk,nkd->nd", weights, of[triangle]) for of in (normals, self._colours))
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
        towards = -rays[body]
        normal *= np.sign(
            (normal * towards).sum(axis=1, keepdims=True) + 1e-12
        )  # published meshes have faces inside out
        points = start + hits["tfar"][body, None] * rays[body]
        lit = np.maximum(normal @ camera.light, 0.0)
        clear = CLEAR * hits["tfar"][body, None] * normal  # off the surface, which else would shade itself
        lit *= ~self._in_shadow(scene, points + clear)
        half = towards + camera.light
        half /= np.linalg.norm(half, axis=1, keepdims=True)
        shine = SHINE * (lit > 0.0) * np.maximum((normal * half).sum(axis=1), 0.0) ** SHININESS
        # A light at the camera shapes what is in shadow.
        ambient = AMBIENT * (0.65 + 0.35 * np.maximum((normal * towards).sum(axis=1), 0.0))
        colours[body] = own * (ambient + DIFFUSE * lit)[:, None] + shine[:, None]
        return colours, touched

    def _seen_empty(self, pixels: Floats, rays: Floats) -> Ground:
        """The background and the floor with its grid, seen through points (n, 2) of the picture along rays (n, 3)."""
        camera, view = self._camera, self._camera.view
        share = np.clip(pixels[:, 1:] / camera.size[1], 0.0, 1.0)
        colours: Floats = TOP + (BOTTOM - TOP) * share
        start = camera.position - view.centre
        height = camera.position[2] - view.floor
        rows = np.flatnonzero((rays[:, 2] < -1e-6) & (height > 0.0))
        down = rays[rows]
        distance = height / -down[:, 2]
        points = start + distance[:, None] * down
        place = (points + view.centre)[:, :2]
        reach = 2.0 * float(np.max(np.abs(view.seen)))
        fade = np.clip(1.5 - np.linalg.norm(points[:, :2], axis=1) / reach, 0.0, 1.0)
        # What a pixel covers of the floor along x and y, so that a line is about a pixel wide in any direction.
        right, up, _ = camera.axes
        covered = np.abs(right[:2]) + np.abs(up[:2] - down[:, :2] * (up[2] / down[:, 2:]))
        covered *= camera.pixel * distance[:, None]
        away = np.abs(place - view.cell * np.round(place / view.cell))
        line = np.clip(1.2 - away / (0.8 * covered + 1e-12), 0.0, 1.0).max(axis=1, initial=0.0) * fade
        colours[rows] = colours[rows] * (1.0 - line[:, None]) + LINE * line[:, None]
        return Ground(colours, rows, _singles(points + np.array([0.0, 0.0, 1e-5 * reach])), fade)

    def _in_shadow(self, scene: Any, points: Floats) -> NDArray[np.bool_]:
        """True for each of the points (n, 3) that a body hides from the light."""
        light = np.broadcast_to(self._camera.light, points.shape)
        return np.asarray(scene.run(_singles(points), _singles(light), query="OCCLUDED") >= 0)


def _edges(image: Floats, touched: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Mask (n,) of a picture's pixels (height, width, 3) that differ from a neighbour, one of the two being touched."""
    edges = np.zeros(touched.shape, bool)
    for axis in (0, 1):
        ahead, behind = (np.s_[1:], np.s_[:-1]) if axis == 0 else (np.s_[:, 1:], np.s_[:, :-1])
        differ = (touched[ahead] | touched[behind]) & (np.abs(image[ahead] - image[behind]).max(axis=2) > EDGE)
        edges[ahead] |= differ
        edges[behind] |= differ
    return edges.ravel()


def _singles(values: Floats) -> NDArray[np.float32]:
    return np.ascontiguousarray(values, dtype=np.float32)


def _embree() -> tuple[Any, Any]:
    """Embree's classes of scenes and of meshes in them."""
    try:
        from embreex import mesh_construction, rtcore_scene
    except ImportError:
        remedy = "pip install embreex (there is none for this kind of machine if that fails); .playback() needs none"
        raise ShowError("embreex is not installed", where="video", remedy=remedy, code="embree-missing") from None
    return rtcore_scene.EmbreeScene, mesh_construction.TriangleMesh


class _ArrowGroup(NamedTuple):
    """Arrows of one colour in each of n pictures: k points and forces, NaN where there is none."""

    colour: tuple[int, int, int]
    points: Floats  # (n, k, 3) m
    forces: Floats  # (n, k, 3) N
    strongest: float  # N, as long as an arrow gets


class Arrows:
    """Arrows in the pictures of a motion.

    Parameters
    ----------
    camera : Camera
        That of the pictures.
    t : array (n,)
        Times of the forces, s.
    shown : array (m,)
        Times of the pictures, s. A picture shows the forces of the last sample before it.
    contacts, forces : mapping of names to (points, forces), (n, k, 3) each
        In m and N, NaN where none acts.
    """

    def __init__(self, camera: Camera, t: Floats, shown: Floats, contacts: Contacts, forces: Contacts) -> None:
        self._camera = camera
        rows = sample_before(t, shown)
        self._longest = LONGEST * 2.0 * float(np.abs(camera.view.seen[:, :2]).max())
        self._groups = []
        for acting, colour in ((contacts, CONTACT_COLOUR), (forces, FORCE_COLOUR)):
            if acting:
                points, newtons = (np.concatenate(both, axis=1) for both in zip(*acting.values(), strict=True))
                self._groups.append(_ArrowGroup(colour, points[rows], newtons[rows], _strongest(newtons)))

    def over(self, image: Image, k: int) -> Image:
        """Picture k (height, width, 3) with its arrows."""
        for group in self._groups:
            there = np.isfinite(group.points[k]).all(axis=1)
            if there.any():
                start, force = group.points[k][there], group.forces[k][there]
                size = np.maximum(np.linalg.norm(force, axis=1, keepdims=True), group.strongest)
                ends = start, start + self._longest * force / size
                image = self._blended(image, group.colour, *(self._camera.place(end) for end in ends))
        return image

    def _blended(self, image: Image, colour: Sequence[int], starts: Floats, ends: Floats) -> Image:
        from PIL import Image as Pillow
        from PIL import ImageDraw

        height, width = image.shape[:2]
        large = Pillow.new("L", (FINE * width, FINE * height))
        draw, unit = ImageDraw.Draw(large), FINE * height
        for start, end in zip(FINE * (starts + 0.5), FINE * (ends + 0.5), strict=True):
            draw.ellipse([*(start - DOT * unit), *(start + DOT * unit)], fill=255)
            length = float(np.linalg.norm(end - start))
            if length < DOT * unit:
                continue
            along = (end - start) / length
            neck = end - HEAD * unit * along
            across = DOT * unit * np.array([-along[1], along[0]])
            draw.line([*start, *neck], fill=255, width=max(FINE, round(SHAFT * unit)))
            draw.polygon([tuple(corner) for corner in (end, neck + across, neck - across)], fill=255)
        share = OPACITY / 255.0 * np.asarray(large.reduce(FINE))[..., None]
        return np.asarray(np.round(image * (1.0 - share) + np.array(colour) * share), np.uint8)


def _strongest(forces: Floats) -> float:
    """The force [N] of the longest arrow, from forces (n, k, 3)."""
    sizes = np.linalg.norm(forces, axis=2)
    sizes = sizes[sizes > 0.0]
    return min(float(sizes.max()), TYPICAL * float(np.quantile(sizes, 0.9))) if sizes.size else 1.0
