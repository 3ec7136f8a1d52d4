"""Arrows for forces over pictures that are cast by rays, as the viewer draws them: bodies do not hide them."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twolink.show.raycasting import Camera
from twolink.show.surfaces import Floats
from twolink.show.viewer_data import Contacts, sample_before

CONTACT_COLOUR, FORCE_COLOUR = (194, 37, 92), (28, 126, 214)  # as overlays.js has them
OPACITY = 0.85
LONGEST = 0.22  # of the motion's extent, the strongest force
TYPICAL = 2.0  # times the force that nine of ten stay below is shown as long at most: blows last one sample
FINE = 3  # an arrow is drawn so many times larger, and reduced
HEAD, DOT, SHAFT = 0.028, 0.009, 0.005  # of the picture's height: length, radius, width
Image = NDArray[np.uint8]


class _Group(NamedTuple):
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
                self._groups.append(_Group(colour, points[rows], newtons[rows], _strongest(newtons)))

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
