"""Bodies as three.js JSON, the dictionaries that meshcat's viewer reads: coal's primitives, and triangles."""

import base64
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Json = dict[str, Any]

_SEGMENTS = 48  # round bodies look round at full screen
_TYPES = {  # NumPy's, by JavaScript's class of typed array
    "Int8Array": "i1",
    "Int16Array": "<i2",
    "Uint16Array": "<u2",
    "Uint32Array": "<u4",
    "Float32Array": "<f4",
    "Float64Array": "<f8",
}
_ROUND = {"widthSegments": _SEGMENTS, "heightSegments": _SEGMENTS // 2}
_Y_TO_Z = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])  # three.js: along y


def packed(array: NDArray[Any], kind: str = "Float32Array") -> Json:
    """An array, row by row, as a typed array of that class: {"$array": the class, "base64": bytes, little-endian}."""
    raw = np.ascontiguousarray(array, dtype=_TYPES[kind]).tobytes()
    return {"$array": kind, "base64": base64.b64encode(raw).decode("ascii")}


def attribute(values: NDArray[Any], kind: str = "Float32Array") -> Json:
    """An attribute of a three.js geometry: one row of `values` (n, k) for each vertex."""
    return {"itemSize": values.shape[1], "type": kind, "array": packed(values, kind)}


def triangle_index(index: NDArray[np.integer]) -> Json:
    """The corners (3m,) of triangles by their numbers, which begin at 0 and are new one after the other.

    Stored is how far each is below the next new number, which compresses to a quarter.
    """
    new = np.maximum.accumulate(np.concatenate([[-1], index[:-1]])) + 1
    kind = "Uint16Array" if len(index) and index.max() < 2**16 else "Uint32Array"
    return {"itemSize": 1, "type": kind, "array": packed(new - index, kind) | {"below_new": True}}


def mesh(
    geometry: Json, materials: Sequence[Json], uuid: str, matrix: Floats | None = None, kind: str = "Mesh"
) -> Json:
    """A three.js object of one geometry, with one material, or with one for each group of the geometry.

    `matrix` (4, 4) places the object in its node; `kind` is three.js's class.
    """
    names = [f"{uuid}-material-{k}" for k in range(len(materials))]
    placement = np.eye(4) if matrix is None else matrix
    return {
        "metadata": {"version": 4.5, "type": "Object"},
        "geometries": [{"uuid": f"{uuid}-geometry", **geometry}],
        "materials": [{"uuid": name, **material} for name, material in zip(names, materials, strict=True)],
        "object": {
            "uuid": uuid,
            "type": kind,
            "geometry": f"{uuid}-geometry",
            "material": names if len(names) > 1 else names[0],
            "matrix": placement.T.ravel().tolist(),
        },
    }


def triangle_geometry(vertices: NDArray[Any], faces: NDArray[Any]) -> Json:
    """A three.js geometry of triangles: vertices (n, 3) m, faces (m, 3)."""
    index = attribute(faces.reshape(-1, 1), "Uint32Array")
    return {"type": "BufferGeometry", "data": {"attributes": {"position": attribute(vertices)}, "index": index}}


def phong(rgba: Floats) -> Json:
    """A shaded material of the colour (red, green, blue, alpha), each 0 to 1."""
    red, green, blue = (round(255 * float(c)) for c in np.clip(rgba[:3], 0.0, 1.0))
    alpha = float(np.clip(rgba[3], 0.0, 1.0))
    return {
        "type": "MeshPhongMaterial",
        "color": red << 16 | green << 8 | blue,
        "shininess": 20,
        "side": 2,  # both: many published meshes have faces turned inside out
        "opacity": alpha,
        "transparent": alpha < 1.0,
    }


def _sphere(radius: float) -> Json:
    return {"type": "SphereGeometry", "radius": radius, **_ROUND}


def _tube(top: float, bottom: float, height: float) -> tuple[Json, Floats]:
    geometry = {"type": "CylinderGeometry", "radiusTop": top, "radiusBottom": bottom, "height": height}
    return {**geometry, "radialSegments": _SEGMENTS}, _Y_TO_Z


def _box(half: Floats) -> Json:
    width, height, depth = (2.0 * float(side) for side in half)
    return {"type": "BoxGeometry", "width": width, "height": height, "depth": depth}


def _capsule(radius: float, half_length: float) -> Json:
    """A capsule along z as triangles: the viewer's three.js has none."""
    from trimesh.creation import capsule

    made = capsule(height=2.0 * half_length, radius=radius, count=(_SEGMENTS, _SEGMENTS))
    return triangle_geometry(made.vertices, made.faces)


# By the coal class's name: its three.js geometry, and the matrix that puts it as coal has it (along z).
SHAPES: dict[str, Callable[[Any], tuple[Json, Floats]]] = {
    "Box": lambda g: (_box(g.halfSide), np.eye(4)),
    "Sphere": lambda g: (_sphere(g.radius), np.eye(4)),
    "Ellipsoid": lambda g: (_sphere(1.0), np.diag([*np.asarray(g.radii), 1.0])),
    "Cylinder": lambda g: _tube(g.radius, g.radius, 2.0 * g.halfLength),
    "Cone": lambda g: _tube(0.0, g.radius, 2.0 * g.halfLength),
    "Capsule": lambda g: (_capsule(g.radius, g.halfLength), np.eye(4)),
}


def triangles(geometry: Any) -> tuple[Floats, NDArray[np.uint32]] | None:
    """Vertices (n, 3) and faces (m, 3) of a triangle mesh or a convex polyhedron, or None."""
    kind = type(geometry).__name__
    if kind.startswith("BVHModel"):
        vertices, count, face = geometry.vertices(), geometry.num_tris, geometry.tri_indices
    elif kind.startswith("Convex") and hasattr(geometry, "polygons"):
        vertices, count, face = geometry.points(), geometry.num_polygons, geometry.polygons
    else:
        return None
    faces = np.array([[int(f[0]), int(f[1]), int(f[2])] for f in map(face, range(count))], dtype=np.uint32)
    return (np.asarray(vertices, float), faces) if len(faces) else None
