"""Mesh files (.dae, .obj, .stl) as objects for meshcat's viewer, with the colours and pictures that they name.

They are read here, but for .obj files with materials, which the viewer reads. A mesh file may come from a stranger:
only files in its own folder are opened on its behalf.
"""

import base64
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from twolink.io.collada import Part, read_collada
from twolink.io.confined import read_confined
from twolink.io.mesh_triangles import read_triangles
from twolink.robots.mesh_shapes import LARGEST
from twolink.show.meshcat_shapes import Floats, Json, attribute, mesh, phong, triangle_index
from twolink.show.smooth_shading import shaded_triangles

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
SUFFIXES = (".dae", ".obj", ".stl")


def file_object(path: Path, *, file_colours: bool, rgba: Floats, uuid: str, scale: Floats) -> Json | None:
    """The three.js object of a mesh file; None when it is missing or unreadable.

    Parameters
    ----------
    path : Path
        The mesh file.
    file_colours : bool
        Whether to use the colours that the file brings, and `rgba` only for parts without one.
    rgba : array (4,)
        The colour, 0 to 1.
    uuid : str
        The object's name, unlike any other in the scene.
    scale : array (4, 4)
        The transform from the file's coordinates into the node's.
    """
    try:
        raw = read_confined(path.parent, path.name, LARGEST)
    except OSError:
        return None
    kind = path.suffix.lower()
    if not raw or kind not in SUFFIXES:
        return None
    if kind == ".obj" and file_colours:
        drawn = _obj_with_materials(raw.decode("utf-8", errors="replace"), path.parent, uuid, scale)
        if drawn is not None:
            return drawn
    parts = read_collada(raw) if kind == ".dae" else _one_part(raw, kind)
    return _drawn(parts, path.parent, file_colours, rgba, uuid, scale) if parts else None


def _one_part(raw: bytes, kind: str) -> tuple[Part, ...]:
    """A file without colours of its own; nothing where it cannot be read."""
    try:
        corners, normals = shaded_triangles(*read_triangles(raw, kind))
    except ValueError:
        return ()
    return (Part(corners.reshape(-1, 3), normals.reshape(-1, 3), np.zeros((corners.size // 3, 2)), None, None),)


def _picture(folder: Path, name: str) -> str:
    """A picture as a data URL; white when there is none, so that no page asks for it."""
    mime = _PICTURES.get(Path(name).suffix.lower())
    try:
        raw = read_confined(folder, name, _LARGEST_PICTURE) if mime else b""
    except OSError:
        raw = b""
    return f"data:{mime};base64,{base64.b64encode(raw).decode('ascii')}" if raw else _WHITE


def _drawn(parts: Sequence[Part], folder: Path, file_colours: bool, rgba: Floats, uuid: str, scale: Floats) -> Json:
    """One object of all parts, each a group with its own material."""
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


def _obj_with_materials(text: str, folder: Path, uuid: str, scale: Floats) -> Json | None:
    """An .obj file with the materials of a file beside it, which the viewer reads; None without such a file."""
    try:
        library = _LIBRARY.search(text)
        raw = read_confined(folder, library[1].strip(), _LARGEST_LIBRARY) if library else b""
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
            pictures[name] = _picture(folder, " ".join(parts[count:]))
            parts[count:] = [name]
        if key.lower() in (*_PICTURE_OF, *_PLAIN):
            lines.append(" ".join([key, *parts]))
    whole: Json = {"uuid": uuid, "type": "_meshfile_object", "format": "obj", "data": text}
    whole |= {"mtl_library": "\n".join(lines), "resources": pictures, "matrix": scale.T.ravel().tolist()}
    return {"metadata": {"version": 4.5, "type": "Object"}, "geometries": [], "materials": [], "object": whole}
