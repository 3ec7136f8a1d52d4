"""Mesh files (.dae, .obj, .stl) as objects for meshcat's viewer, with the colours and pictures that they name.

Collada is read here; the viewer itself reads .obj and .stl. A mesh file may come from a stranger: only files in its
own folder are opened on its behalf.
"""

import base64
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import umsgpack

from twolink.io.collada import Part, read_collada
from twolink.io.confined import read_confined
from twolink.robots.mesh_shapes import LARGEST
from twolink.show.meshcat_shapes import Floats, Json, attribute, mesh, phong

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
_CORNER = np.dtype([("position", "<f4", 3), ("normal", "<i2", 3), ("uv", "<f4", 2)])
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
    if kind == ".stl":
        return mesh(_viewer_geometry("stl", umsgpack.Ext(0x12, raw)), [phong(rgba)], uuid, scale)
    if kind == ".obj":
        return _obj(raw.decode("utf-8", errors="replace"), path.parent, file_colours, rgba, uuid, scale)
    parts = read_collada(raw)
    return _collada(parts, path.parent, file_colours, rgba, uuid, scale) if parts else None


def _picture(folder: Path, name: str) -> str:
    """A picture as a data URL; white when there is none, so that no page asks for it."""
    mime = _PICTURES.get(Path(name).suffix.lower())
    try:
        raw = read_confined(folder, name, _LARGEST_PICTURE) if mime else b""
    except OSError:
        raw = b""
    return f"data:{mime};base64,{base64.b64encode(raw).decode('ascii')}" if raw else _WHITE


def _collada(parts: Sequence[Part], folder: Path, file_colours: bool, rgba: Floats, uuid: str, scale: Floats) -> Json:
    """One object of all parts, each a group with its own material."""
    pictures = sorted({part.picture for part in parts if part.picture}) if file_colours else []
    materials = []
    for part in parts:
        material = phong(np.array(part.rgba) if file_colours and part.rgba else rgba)
        if part.picture in pictures:
            material |= {"map": f"{uuid}-texture-{pictures.index(part.picture)}", "color": 0xFFFFFF}
        materials.append(material)
    drawn = mesh(_merged(parts, bool(pictures)), materials, uuid, scale)
    for k, name in enumerate(pictures):
        texture = {"uuid": f"{uuid}-texture-{k}", "image": f"{uuid}-image-{k}", "wrap": [_REPEAT, _REPEAT]}
        drawn.setdefault("textures", []).append(texture)
        drawn.setdefault("images", []).append({"uuid": f"{uuid}-image-{k}", "url": _picture(folder, name)})
    return drawn


def _merged(parts: Sequence[Part], textured: bool) -> Json:
    """A geometry with one group a part. Equal corners are stored once: that makes the page a third as large."""
    counts = [len(part.position) for part in parts]
    corners = np.zeros(sum(counts), _CORNER)
    corners["position"] = np.concatenate([part.position for part in parts])
    corners["normal"] = np.round(32767 * np.concatenate([part.normal for part in parts]))
    if textured:
        corners["uv"] = np.concatenate([part.uv for part in parts])
    distinct, index = np.unique(corners.view(f"V{_CORNER.itemsize}"), return_inverse=True)
    columns = distinct.view(_CORNER)
    attributes = {
        "position": attribute(columns["position"]),
        "normal": {**attribute(columns["normal"], "Int16Array"), "normalized": True},
    }
    if textured:
        attributes["uv"] = attribute(columns["uv"])
    starts = np.cumsum(counts) - counts
    groups = [
        {"start": int(a), "count": n, "materialIndex": k} for k, (a, n) in enumerate(zip(starts, counts, strict=True))
    ]
    kind = "Uint16Array" if len(columns) < 2**16 else "Uint32Array"
    data = {"attributes": attributes, "index": attribute(index.reshape(-1, 1), kind), "groups": groups}
    return {"type": "BufferGeometry", "data": data}


def _viewer_geometry(kind: str, data: object) -> Json:
    """A geometry that the viewer reads from the file's bytes or text."""
    return {"type": "_meshfile_geometry", "format": kind, "data": data}


def _obj(text: str, folder: Path, file_colours: bool, rgba: Floats, uuid: str, scale: Floats) -> Json:
    """An .obj file, with its materials when they are in a file beside it."""
    try:
        library = _LIBRARY.search(text) if file_colours else None
        raw = read_confined(folder, library[1].strip(), _LARGEST_LIBRARY) if library else b""
    except OSError:
        raw = b""
    if not raw:
        return mesh(_viewer_geometry("obj", text), [phong(rgba)], uuid, scale)
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
