"""Mesh files (.dae, .obj, .stl) as objects for meshcat's viewer, with the colours the files bring."""

from __future__ import annotations

import base64
import re
from pathlib import Path

import numpy as np
import umsgpack
from numpy.typing import NDArray

from twolink.show.meshcat_collada import Part, read_collada
from twolink.show.meshcat_shapes import Floats, Json, mesh, packed, phong

SUFFIXES = (".dae", ".obj", ".stl")

_WHITE = (  # a picture of one white pixel
    "data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mP8/5+hHgAHggJ/PchI7wAAAABJ"
    "RU5ErkJggg=="
)
_PICTURES = {".png": "image/png", ".jpg": "image/jpeg", ".jpeg": "image/jpeg"}
_LARGEST_PICTURE = 10_000_000  # bytes


def file_object(path: Path, *, own_colours: bool, rgba: Floats, uuid: str, scale: Floats) -> Json | None:
    """The three.js object of a mesh file; None when it is missing or unreadable.

    `own_colours`: use the colours it brings, and `rgba` only for parts without. `scale` is (4, 4).
    """
    try:
        raw = path.read_bytes()
        kind = path.suffix.lower()[1:]
        if not raw or kind not in ("dae", "obj", "stl"):
            return None
        if kind == "stl":
            return mesh(_geometry(kind, umsgpack.Ext(0x12, raw)), phong(rgba), uuid, scale)
        if kind == "obj":
            return _obj(raw.decode("utf-8", errors="replace"), path.parent, own_colours, rgba, uuid, scale)
        parts = read_collada(raw)
        if not parts:
            return None
        if own_colours and any(part.textured for part in parts):
            return _textured(raw.decode("utf-8", errors="replace"), path.parent, uuid, scale)
        return _parts(parts, own_colours, rgba, uuid, scale)
    except OSError:
        return None


def _parts(parts: list[Part], own_colours: bool, rgba: Floats, uuid: str, scale: Floats) -> Json:
    """One object of all parts, each a group with its own material."""
    rows, groups, first, count = [], [], 0, 0
    faces: list[NDArray[np.int64]] = []
    shaded = all(part.normals is not None for part in parts)
    for k, part in enumerate(parts):
        groups.append({"start": count, "count": part.faces.size, "materialIndex": k})
        count += part.faces.size
        row = np.zeros((len(part.vertices), 18), np.uint8)  # 12 bytes of position, 6 of normal
        row[:, :12] = np.ascontiguousarray(part.vertices, "<f4").view(np.uint8)
        if shaded and part.normals is not None:
            normals = np.round(32767 * np.clip(part.normals, -1.0, 1.0))
            row[:, 12:] = np.ascontiguousarray(normals, "<i2").view(np.uint8)
        # Published meshes repeat each vertex for each face: stored once, the page is a third as large.
        row, place = np.unique(row.view("V18").reshape(-1), return_inverse=True)
        rows.append(row)
        faces.append(place.reshape(-1)[part.faces] + first)
        first += len(row)
    table = np.concatenate(rows).view(np.uint8).reshape(-1, 18)
    position = np.ascontiguousarray(table[:, :12]).view("<f4")
    attributes: Json = {"position": {"itemSize": 3, "type": "Float32Array", "array": packed(position)}}
    if shaded:
        normal = packed(np.ascontiguousarray(table[:, 12:]).view("<i2"), "Int16Array")
        attributes["normal"] = {"itemSize": 3, "type": "Int16Array", "array": normal, "normalized": True}
    kind = "Uint16Array" if first < 2**16 else "Uint32Array"
    index = {"itemSize": 1, "type": kind, "array": packed(np.concatenate(faces), kind)}
    data = {"attributes": attributes, "index": index, "groups": groups}
    geometry = {"type": "BufferGeometry", "data": data}
    colours = [np.array(part.rgba) if own_colours and part.rgba else rgba for part in parts]
    return mesh(geometry, [phong(colour) for colour in colours], uuid, scale)


def _geometry(kind: str, data: object) -> Json:
    return {"type": "_meshfile_geometry", "format": kind, "data": data}


def _whole(kind: str, text: str, uuid: str, matrix: Floats, **more: object) -> Json:
    """A file that brings its materials: the viewer makes the object of it."""
    inner = {"uuid": uuid, "type": "_meshfile_object", "format": kind, "data": text, **more}
    inner["matrix"] = matrix.T.ravel().tolist()
    metadata = {"version": 4.5, "type": "Object"}
    return {"metadata": metadata, "geometries": [], "materials": [], "object": inner}


def _textured(text: str, folder: Path, uuid: str, scale: Floats) -> Json:
    # The viewer drops the file's length unit (it sits on the root node, whose matrix it never updates).
    unit = re.search(r"<unit\b[^>]*\bmeter\s*=\s*[\"']\s*([0-9.eE+-]+)", text[:20000])
    metres = float(unit.group(1)) if unit else 1.0
    names = re.findall(r"<init_from>\s*(?:<ref>)?\s*([^<\s][^<]*?)\s*<", text)
    matrix = scale @ np.diag([metres, metres, metres, 1.0])
    return _whole("dae", text, uuid, matrix, resources=_pictures(names, folder))


def _obj(text: str, folder: Path, own_colours: bool, rgba: Floats, uuid: str, scale: Floats) -> Json:
    library = re.search(r"^mtllib\s+(.+?)\s*$", text, re.MULTILINE)
    if own_colours and library and "/" not in library.group(1):
        try:
            materials = (folder / library.group(1)).read_text("utf-8", errors="replace")
        except OSError:
            return mesh(_geometry("obj", text), phong(rgba), uuid, scale)
        names = re.findall(r"^\s*(?:map_\w+|bump|disp|decal)\s+(?:.*\s)?(\S+)\s*$", materials, re.MULTILINE)
        return _whole("obj", text, uuid, scale, mtl_library=materials, resources=_pictures(names, folder))
    return mesh(_geometry("obj", text), phong(rgba), uuid, scale)


def _pictures(names: list[str], folder: Path) -> dict[str, str]:
    """Textures as data URLs; a missing one is white, so that the page never asks for it."""
    found = {}
    for name in names:
        found[name] = _WHITE
        path = folder / name
        mime = _PICTURES.get(path.suffix.lower())
        try:
            if mime and path.stat().st_size <= _LARGEST_PICTURE:
                found[name] = f"data:{mime};base64,{base64.b64encode(path.read_bytes()).decode('ascii')}"
        except OSError:
            continue
    return found
