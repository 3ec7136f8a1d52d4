"""Height fields: ground of triangles over a grid, and the points at which bodies touch it.

Each cell has two triangles, on either side of the diagonal from its lowest x and y. Corners and balls of a body touch
triangles, its edges touch ridges, and peaks touch its faces; of a cylinder, which has none of these, the rims, the side
and the ends do. Only the cells below a body are looked at. A point p with the normal n counts where the surface lies
below the plane across n there, n . (w - p) <= 0 of the corners w of all triangles at p. So inner edges of what is flat
or hollow do not stop what slides or rolls over them.
Source: Ericson, Real-Time Collision Detection, 2005, section 5.1.5.
"""

from __future__ import annotations

import functools
from typing import NamedTuple, cast

import msgspec
import numpy as np
import pinocchio as pin

from twolink.algorithms.namespaces import Array
from twolink.errors import SceneError
from twolink.geometry.hulls import Name
from twolink.robots.collisions import Length, Vector
from twolink.robots.meshes import triangle_mesh

SAME = 1e-9  # m: points that are one, and heights of what lies on the surface
LEVEL = 1e-6  # rad: what counts as flat
OUTWARD = ((-1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0))  # across the border of the grid
FARTHER = 4.0  # times as deep as the surface below a point: what is deeper lies on the far side of a ridge


class HeightField(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="height-field"):
    """Ground of given heights over a grid, fixed to the world: z = heights[i][k] at x = i dx, y = k dy from `point`.

    Between them lie triangles; beyond the grid there is nothing. Bodies touch it in steps.

    Parameters
    ----------
    heights : array_like (nx, ny)
        m, at least 2 along x and along y.
    cell : (float, float)
        dx and dy, m.
    point : (float, float, float)
        Where heights[0][0] is the height above, in the world, m.
    """

    heights: tuple[tuple[float, ...], ...]
    cell: tuple[Length, Length] = (1.0, 1.0)
    point: Vector = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        rows = self.heights.tolist() if isinstance(self.heights, np.ndarray) else self.heights
        if all(isinstance(row, (list, tuple)) for row in rows):
            msgspec.structs.force_setattr(self, "heights", tuple(map(tuple, rows)))

    def check(self, where: str) -> None:
        """Raises SceneError for what is no grid."""
        try:
            heights = np.array(self.heights, dtype=float)
        except (TypeError, ValueError):
            heights = np.empty(0)
        if heights.ndim != 2 or min(heights.shape) < 2 or not np.isfinite(heights).all():
            raise SceneError("expected at least 2 x 2 finite heights, in rows of one length", where=f"{where}.heights",
                             remedy="such as ((0.0, 0.0), (0.0, 0.1))")  # fmt: skip
        for name, size in (("cell", 2), ("point", 3)):
            values = np.array(getattr(self, name), dtype=float)
            if values.shape != (size,) or not np.isfinite(values).all() or (name == "cell" and values.min() <= 0.0):
                what = f"expected {size} finite numbers{' above 0' * (name == 'cell')}, got {values.tolist()}"
                raise SceneError(what, where=f"{where}.{name}", remedy="give them in m")

    def piece(self) -> pin.GeometryObject:
        """A piece to draw, fixed to the world."""
        corners = surface_of(self).triangles.reshape(-1, 3)
        shape = triangle_mesh(corners, np.arange(len(corners)).reshape(-1, 3))
        colour = np.array([0.62, 0.66, 0.58, 1.0])
        return pin.GeometryObject("field", 0, 0, pin.SE3.Identity(), shape, "", np.ones(3), True, colour)


class Spots(NamedTuple):
    """Ridges (n, 2, 3) and peaks (m, 3) of a surface, and their numbers. sides (n, 2, 3): the normals beside ridges."""

    ridges: Array
    sides: Array
    ridge_numbers: Array
    peaks: Array
    peak_numbers: Array


class FieldSurface:
    """The triangles of a height field in the world. heights (nx, ny): above the origin; cell, origin: of the grid.

    corners (nx, ny, 3). triangles (nx - 1, ny - 1, 2, 3, 3), normals (nx - 1, ny - 1, 2, 3). ridges (n, 2, 3): the ends
    of edges beside which both triangles lie lower, and of those of the border; ends (n, 2): their corners; bounds
    (2, n, 2): of each the least and the largest x and y. Peaks are the corners at which ridges end. The number of a
    ridge is 4 times its first corner's and 0 of a diagonal, 1 along x, 2 along y; that of a peak 4 times the corner's
    and 3. planes: above all of these.
    numbers, plane_of (nx - 1, ny - 1, 2): of each triangle its number, and that of the first triangle in its plane of
    those that hang together.
    """

    def __init__(self, field: HeightField) -> None:
        z = self.heights = np.array(field.heights, float)
        self.cell, self.origin = np.array(field.cell, float), np.array(field.point)
        grid = np.stack(np.meshgrid(*(np.arange(count) for count in z.shape), indexing="ij"), axis=2)
        x = self.corners = np.concatenate([grid * self.cell, z[..., None]], axis=2) + self.origin
        self.size, self.top = np.array(z.shape) - 1, float(x[..., 2].max())
        low, right, far, left = x[:-1, :-1], x[1:, :-1], x[1:, 1:], x[:-1, 1:]
        self.triangles = np.stack([np.stack([low, right, far], 2), np.stack([low, far, left], 2)], 2)
        across = np.cross(self.triangles[..., 1, :] - self.triangles[..., 0, :],
                          self.triangles[..., 2, :] - self.triangles[..., 0, :])  # fmt: skip
        n = self.normals = across / np.linalg.norm(across, axis=-1)[..., None]
        self._along = np.roll(self.triangles, -1, axis=-2) - self.triangles
        self._per_along = self._along / np.square(self._along).sum(axis=-1, keepdims=True)
        self._inward = np.cross(n[..., None, :], self._along)
        at = np.arange(z.size).reshape(z.shape)
        here = np.arange(n[..., 0].size).reshape(n.shape[:3])
        # Around all triangles those of the ground beyond, whose numbers come behind: they are upright.
        around = np.full((here.shape[0] + 2, here.shape[1] + 2, 2), here.size)
        around[1:-1, 1:-1], around[:, 0], around[:, -1] = here, here.size + 1, here.size + 2
        around[-1, 1:-1] = here.size + 3
        kinds = ((at[:-1, :-1], at[1:, 1:], here[:, :, 1], here[:, :, 0]),
                 (at[:-1], at[1:], around[1:-1, 1:, 0], around[1:-1, :-1, 1]),
                 (at[:, :-1], at[:, 1:], around[:-1, 1:-1, 0], around[1:, 1:-1, 1]))  # fmt: skip
        ends, beside = (np.concatenate([np.stack(kind[i : i + 2], axis=-1).reshape(-1, 2) for kind in kinds])
                        for i in (0, 2))  # fmt: skip
        left, right = (np.concatenate([n.reshape(-1, 3), OUTWARD])[one] for one in beside.T)
        self.numbers = here
        self.plane_of = _first_of_each(beside[np.abs(left - right).max(axis=1) < LEVEL], here.size).reshape(here.shape)
        numbers = np.concatenate([4 * kind[0].ravel() + k for k, kind in enumerate(kinds)])
        x = x.reshape(-1, 3)
        ways = x[ends[:, 1]] - x[ends[:, 0]]
        ways /= np.linalg.norm(ways, axis=1)[:, None]
        high = np.einsum("ni,ni->n", np.cross(left, right), ways) > LEVEL
        self.ends, self._numbers, self.ridges, self.planes = ends[high], numbers[high], x[ends[high]], 4 * z.size
        self._sides = np.stack([left, right], axis=1)[high]
        self.bounds = np.array([self.ridges.min(axis=1)[:, :2], self.ridges.max(axis=1)[:, :2]])

    @property
    def marks(self) -> Array:
        """Of each corner (nx, ny) the sum of 1, 2 and 4 where ridges begin, and 8 for a peak, as their numbers say."""
        found = np.zeros(self.planes, dtype=int)
        found[np.concatenate([self._numbers, 4 * self.ends.ravel() + 3])] = 1
        return np.asarray(found.reshape(*self.heights.shape, 4) @ (1, 2, 4, 8))

    def feature(self, name: Name) -> int:
        """The number of a point by its name: the number of the body's part, and of the ridge, peak or triangle."""
        part, spot = name
        return cast(int, part) * 2 * self.planes + cast(int, spot)

    def cells(self, low: Array, high: Array) -> tuple[slice, slice]:
        """The cells over a rectangle."""
        first = np.floor((low[:2] - self.origin[:2]) / self.cell).astype(int)
        last = np.floor((high[:2] - self.origin[:2]) / self.cell).astype(int) + 1
        (i, k), (m, n) = np.maximum(first, 0).tolist(), np.minimum(last, self.size).tolist()
        return slice(i, max(i, m)), slice(k, max(k, n))

    def spots_in(self, low: Array, high: Array) -> Spots:
        """The ridges whose rectangles reach into one, and the peaks at their ends."""
        beside = (self.bounds[0] <= high[:2]).all(axis=1) & (self.bounds[1] >= low[:2]).all(axis=1)
        peaks = np.unique(self.ends[beside])
        ridges = self.ridges[beside], self._sides[beside], self._numbers[beside]
        return Spots(*ridges, self.corners.reshape(-1, 3)[peaks], 4 * peaks + 3)

    def below(self, x: Array) -> tuple[Array, Array, int] | None:
        """A corner and the normal of the triangle below a point, and its plane; None beyond the grid."""
        i, k = (at := (x[:2] - self.origin[:2]) / self.cell).astype(int)
        if (at < 0.0).any() or (at > self.size).any():
            return None
        i, k = min(i, int(self.size[0]) - 1), min(k, int(self.size[1]) - 1)
        half = 0 if at[0] - i >= at[1] - k else 1
        return self.triangles[i, k, half, 0], self.normals[i, k, half], int(self.plane_of[i, k, half])

    def height(self, x: Array) -> float:
        """Height of a point above the plane of the triangle below it, m; inf beyond the grid."""
        below = self.below(x)
        return np.inf if below is None else float(below[1] @ (x - below[0]))

    def nearest(self, x: Array, cells: tuple[slice, slice]) -> Array:
        """The points (n, 3) of the triangles of cells that are nearest to a point."""
        a, along = self.triangles[cells].reshape(-1, 3, 3), self._along[cells].reshape(-1, 3, 3)
        away, inward = x - a, self._inward[cells].reshape(-1, 3, 3)
        share = np.einsum("nij,nij->ni", away, self._per_along[cells].reshape(-1, 3, 3))
        on_edges = a + np.minimum(np.maximum(share, 0.0), 1.0)[..., None] * along
        far = on_edges - x
        best = on_edges[np.arange(len(a)), np.einsum("nij,nij->ni", far, far).argmin(axis=1)]
        inside = (np.einsum("nij,nij->ni", inward, away) >= 0.0).all(axis=1)
        n = self.normals[cells].reshape(-1, 3)
        foot = x - np.einsum("ni,ni->n", n, away[:, 0])[:, None] * n
        return np.asarray(np.where(inside[:, None], foot, best))

    def supports(self, p: Array, n: Array) -> bool:
        """True if the triangles at a point of the surface lie below the plane across n."""
        cells = self.cells(p - SAME, p + SAME)
        off = self.nearest(p, cells) - p
        beside = np.einsum("ni,ni->n", off, off) <= SAME**2
        way = self.triangles[cells].reshape(-1, 3, 3)[beside].reshape(-1, 3) - p
        return bool((way @ n <= LEVEL * np.sqrt(np.einsum("ni,ni->n", way, way)) + SAME**2).all())


def _first_of_each(pairs: Array, count: int) -> Array:
    """Of each of so many things (count,) the first one that pairs (n, 2) connect it with."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    joined = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    _, label = connected_components(joined, directed=False)
    return np.asarray(np.unique(label, return_index=True)[1][label])


@functools.lru_cache(maxsize=16)
def surface_of(field: HeightField) -> FieldSurface:
    """The surface of a field."""
    return FieldSurface(field)
