"""Bodies as three.js JSON, the dictionaries that meshcat's viewer reads: coal's primitives, and mesh files with their
colours and pictures.

Mesh files are read here, but for .obj files with materials, which the viewer reads. A mesh file may come from a
stranger: only files in its own folder are opened on its behalf.
"""

import base64
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twolink.io.files import read_confined
from twolink.io.mesh_files import SUFFIXES, Part, read_collada, read_triangles
from twolink.robots.meshes import LARGEST

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
SMOOTH = 0.7  # rad: edges between triangles that turn by less look round
_WHITE = (  # a picture of one white pixel
    "data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mP8/5+hHgAHggJ/PchI7wAAAABJ"
    "RU5ErkJggg=="
)
_PICTURES = {".png": "image/png", ".jpg": "image/jpeg", ".jpeg": "image/jpeg"}
_LARGEST_PICTURE = _LARGEST_LIBRARY = 10_000_000  # bytes
_LIBRARY = re.compile(r"(?:^|[\r\n])[ \t]*mtllib[ \t]+([^\r\n]+)")
# The viewer gets these statements of a material file: plain ones, and pictures under names of our own, so that it asks
# for no other. _OPTION: what may stand before a picture's name.
_PLAIN = ("newmtl", "kd", "ka", "ks", "ke", "ns", "d", "tr", "illum")
_PICTURE_OF = ("map_kd", "map_ks", "map_ke", "map_d", "map_bump", "bump", "norm")
_OPTION = re.compile(r"-\w+|[-+.\d][-+.\deE]*|on|off")
_REPEAT = 1000  # three.js's number for a picture that repeats
_STEPS = 4096  # of a mesh's longest side: corners are drawn on such a grid
_UV_STEPS = 4096
_CORNER = np.dtype([("position", "<u2", 3), ("normal", "i1", 3), ("uv", "<f4", 2)])


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


def mesh(geometry: Json, materials: Sequence[Json], uuid: str, matrix: Floats | None = None) -> Json:
    """A three.js object of one geometry, with one material, or with one for each group of the geometry.

    `matrix` (4, 4) places the object in its node.
    """
    names = [f"{uuid}-material-{k}" for k in range(len(materials))]
    placement = np.eye(4) if matrix is None else matrix
    return {
        "metadata": {"version": 4.5, "type": "Object"},
        "geometries": [{"uuid": f"{uuid}-geometry", **geometry}],
        "materials": [{"uuid": name, **material} for name, material in zip(names, materials, strict=True)],
        "object": {
            "uuid": uuid,
            "type": "Mesh",
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


def shaded_triangles(vertices: Floats, faces: NDArray[np.integer]) -> tuple[Floats, Floats]:
    """The corners (m, 3, 3) of triangles, from vertices (n, 3) and faces (m, 3), and unit normals (m, 3, 3) there."""
    import trimesh  # 0.5 s: only where a mesh is drawn

    merged = trimesh.Trimesh(vertices, faces, process=True)
    shaded = trimesh.graph.smooth_shade(merged, angle=SMOOTH)
    corners, normals = (np.asarray(x)[shaded.faces] for x in (shaded.vertices, shaded.vertex_normals))
    return corners, normals


def mesh_parts(visuals: Any, item: Any) -> Sequence[Part]:
    """The parts of a piece's mesh file; none where it is missing or unreadable, or the piece has none.

    Collada files are read once, where the pin.GeometryModel has their parts from loading it.
    """
    read: dict[str, Sequence[Part]] = getattr(visuals, "parts", {})  # `robots.meshes.VisualModel` has them
    path = Path(item.meshPath)
    kind = path.suffix.lower()
    if item.meshPath in read or kind not in SUFFIXES:
        return read.get(item.meshPath, ())
    try:
        raw = read_confined(path.parent, path.name, LARGEST)
        return read_collada(raw) if kind == ".dae" else (plain_part(*read_triangles(raw, kind)),)
    except (OSError, ValueError):
        return ()


def plain_part(vertices: Floats, faces: NDArray[np.integer]) -> Part:
    """Triangles without a colour of their own."""
    corners, normals = shaded_triangles(vertices, faces)
    return Part(corners.reshape(-1, 3), normals.reshape(-1, 3), np.zeros((corners.size // 3, 2)), None, None)


def _picture(folder: Path, name: str) -> str:
    """A picture as a data URL; white when there is none, so that no page asks for it."""
    mime = _PICTURES.get(Path(name).suffix.lower())
    try:
        raw = read_confined(folder, name, _LARGEST_PICTURE) if mime else b""
    except OSError:
        raw = b""
    return f"data:{mime};base64,{base64.b64encode(raw).decode('ascii')}" if raw else _WHITE


def parts_object(
    parts: Sequence[Part], folder: Path, *, file_colours: bool, rgba: Floats, uuid: str, scale: Floats
) -> Json:
    """One object of all parts, each a group with its own material.

    Parameters
    ----------
    parts : sequence of Part
    folder : Path
        Where their pictures are.
    file_colours : bool
        Whether to use the colours that the file brings, and `rgba` only for parts without one.
    rgba : array (4,)
        The colour, 0 to 1.
    uuid : str
        The object's name, unlike any other in the scene.
    scale : array (4, 4)
        The transform from the file's coordinates into the node's.
    """
    pictures = sorted({part.picture for part in parts if part.picture}) if file_colours else []
    materials = []
    for part in parts:
        material = phong(np.array(part.rgba) if file_colours and part.rgba else rgba)
        if part.picture in pictures:
            material |= {"map": f"{uuid}-texture-{pictures.index(part.picture)}", "color": 0xFFFFFF}
        materials.append(material)
    geometry, metres = _on_a_grid(parts, bool(pictures))
    drawn = mesh(geometry, materials, uuid, scale @ metres)
    for k, name in enumerate(pictures):
        texture = {"uuid": f"{uuid}-texture-{k}", "image": f"{uuid}-image-{k}", "wrap": [_REPEAT, _REPEAT]}
        drawn.setdefault("textures", []).append(texture)
        drawn.setdefault("images", []).append({"uuid": f"{uuid}-image-{k}", "url": _picture(folder, name)})
    return drawn


def _on_a_grid(parts: Sequence[Part], textured: bool) -> tuple[Json, Floats]:
    """A geometry with one group a part, and the matrix (4, 4) from the numbers of its grid to metres.

    Corners are moved to a grid, by 1/8000 of the mesh's length at most. Those that are equal then are stored once, and
    triangles without area are left out. That makes a page a tenth as large, which is not seen.
    """
    position = np.concatenate([part.position for part in parts])
    low = position.min(axis=0)
    step = max(float(np.ptp(position, axis=0).max()), 1e-9) / _STEPS
    corners = np.zeros(len(position), _CORNER)
    corners["position"] = np.round((position - low) / step)
    corners["normal"] = np.round(127 * np.concatenate([part.normal for part in parts]))
    if textured:
        corners["uv"] = np.round(_UV_STEPS * np.concatenate([part.uv for part in parts])) / _UV_STEPS
    a, b, c = corners["position"].reshape(-1, 3, 3).transpose(1, 0, 2).astype(np.int64)
    solid = np.cross(b - a, c - a).any(axis=1)
    owner = np.repeat(np.arange(len(parts)), [len(part.position) // 3 for part in parts])[solid]
    distinct, first, index = np.unique(
        corners[np.repeat(solid, 3)].view(f"V{_CORNER.itemsize}").ravel(), return_index=True, return_inverse=True
    )
    order = np.argsort(first)  # as the triangles use them: so the index compresses well
    index = np.argsort(order)[index]
    columns = distinct[order].view(_CORNER)
    attributes = {
        "position": attribute(columns["position"], "Uint16Array"),
        "normal": {**attribute(columns["normal"], "Int8Array"), "normalized": True},
    }
    if textured:
        attributes["uv"] = attribute(columns["uv"])
    ends = 3 * np.searchsorted(owner, np.arange(len(parts)), side="right")
    starts = np.concatenate([[0], ends[:-1]])
    groups = [
        {"start": int(start), "count": int(end - start), "materialIndex": k}
        for k, (start, end) in enumerate(zip(starts, ends, strict=True))
    ]
    data = {"attributes": attributes, "index": triangle_index(index), "groups": groups}
    metres = np.diag([step, step, step, 1.0])
    metres[:3, 3] = low
    return {"type": "BufferGeometry", "data": data}, metres


def materials_object(path: Path, uuid: str, scale: Floats) -> Json | None:
    """An .obj file with the materials of a file beside it, which the viewer reads; None without such files."""
    try:
        text = read_confined(path.parent, path.name, LARGEST).decode("utf-8", errors="replace")
        library = _LIBRARY.search(text)
        raw = read_confined(path.parent, library[1].strip(), _LARGEST_LIBRARY) if library else b""
    except OSError:
        raw = b""
    if not raw:
        return None
    lines, pictures = [], dict[str, str]()
    for line in raw.decode("utf-8", errors="replace").splitlines():
        key, *parts = line.split() or [""]
        if key.lower() in _PICTURE_OF:
            count = next((k for k, part in enumerate(parts) if not _OPTION.fullmatch(part)), len(parts))
            name = f"picture-{len(pictures)}"
            pictures[name] = _picture(path.parent, " ".join(parts[count:]))
            parts[count:] = [name]
        if key.lower() in (*_PICTURE_OF, *_PLAIN):
            lines.append(" ".join([key, *parts]))
    whole: Json = {"uuid": uuid, "type": "_meshfile_object", "format": "obj", "data": text}
    whole |= {"mtl_library": "\n".join(lines), "resources": pictures, "matrix": scale.T.ravel().tolist()}
    return {"metadata": {"version": 4.5, "type": "Object"}, "geometries": [], "materials": [], "object": whole}
