"""The triangles of mesh files, and the colours and pictures of Collada files (.dae), read by pycollada.

The readers that Pinocchio has (Assimp, through Coal) take a path and open whatever other files the mesh names. These
take bytes, and open none.

pycollada is used directly, not through trimesh: it keeps the names of picture files, which go into a page as they
are, where trimesh decodes every picture; and it takes half the time. meshcat's viewer could read Collada too, but
it loses parts whose neighbours have another material (half of a UR5) and ignores the file's unit of length.
"""

import io
import re
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_DECLARATION = re.compile(r"\A\s*<\?xml.*?\?>", re.DOTALL)
_BINDING = re.compile(  # no part runs past the begin of the next binding: otherwise a comment of many takes N^2 steps
    r"<instance_material\b[^<>]*?\btarget=[\"']#([^\"'<]*)[\"'][^<>]*?(/>|>(?:(?!</?instance_material\b).)*</instance_material>)",
    re.DOTALL,
)
Faces = NDArray[np.int64]
SUFFIXES = (".dae", ".stl", ".obj", ".ply", ".off", ".glb")


@dataclass(frozen=True, slots=True)
class Part:
    """The m triangles of one material; each has three corners of its own."""

    position: Floats  # (3m, 3) m
    normal: Floats  # (3m, 3) unit
    uv: Floats  # (3m, 2) the place in the picture; 0 without one
    rgba: tuple[float, float, float, float] | None  # None: the file gives no colour
    picture: str | None  # the file name of the picture that gives the colour


def read_collada(raw: bytes) -> tuple[Part, ...]:
    """The parts of a Collada file, in metres and along the file's own axes; none when it cannot be read.

    pycollada opens no other file.
    """
    text = _DECLARATION.sub("", raw.decode("utf-8", errors="replace"))
    if "<!DOCTYPE" in text or zipfile.is_zipfile(io.BytesIO(raw)):  # entities; pycollada would look into the zip
        return ()
    try:
        document = _document(text)
        metres = document.assetInfo.unitmeter or 1.0
        scene = document.scene or document.scenes[0]
        return tuple(part for geometry in scene.objects("geometry") for part in _geometry_parts(geometry, metres))
    except Exception:  # pycollada lets errors of many kinds through
        return ()


def _document(text: str) -> Any:
    """The file as pycollada reads it. Without bindings to broken materials: they would cost the geometry too."""
    import collada

    document = collada.Collada(io.BytesIO(text.encode()), ignore=[collada.DaeError])
    if not document.errors:
        return document
    materials = {material.id for material in document.materials}
    bound = _BINDING.sub(lambda match: match[0] if match[1] in materials else "", text)
    return collada.Collada(io.BytesIO(bound.encode()), ignore=[collada.DaeError])


def _geometry_parts(geometry: Any, metres: float) -> Iterator[Part]:
    """The parts of one geometry where the scene's nodes put it."""
    turn, shift = geometry.matrix[:3, :3].astype(float), geometry.matrix[:3, 3]
    for primitive in geometry.original.primitives:
        triangles = primitive.triangleset() if hasattr(primitive, "triangleset") else primitive
        if not hasattr(triangles, "ntriangles") or not len(triangles):
            continue  # lines
        position = (triangles.vertex @ turn.T + shift)[triangles.vertex_index].reshape(-1, 3)
        if triangles.normal is None:
            sides = position.reshape(-1, 3, 3)
            normal = np.repeat(np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0]), 3, axis=0)
        else:  # a normal turns with the inverse, transposed; here from the right
            normal = (triangles.normal @ np.linalg.inv(turn))[triangles.normal_index].reshape(-1, 3)
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
        uv = np.zeros((len(position), 2))
        if triangles.texcoordset:
            uv = triangles.texcoordset[0][triangles.texcoord_indexset[0]].reshape(-1, 2)
        binding = geometry.materialnodebysymbol.get(triangles.material)
        yield Part(metres * position, normal, uv, *_colour(binding.target if binding else None))


def _colour(material: Any) -> tuple[tuple[float, float, float, float] | None, str | None]:
    """The colour of a material, and its picture. Always opaque: files disagree on what <transparency> means."""
    diffuse = material.effect.diffuse if material is not None and material.effect is not None else None
    if diffuse is None:
        return None, None
    if hasattr(diffuse, "sampler"):
        return None, diffuse.sampler.surface.image.path
    red, green, blue = (float(share) for share in diffuse[:3])
    return (red, green, blue, 1.0), None


def read_triangles(raw: bytes, suffix: str, parts: Sequence[Part] | None = None) -> tuple[Floats, Faces]:
    """Vertices (n, 3) and faces (m, 3) of a mesh file.

    Parameters
    ----------
    raw : bytes
        The file's content.
    suffix : str
        The ending of its name, such as ".stl": one of SUFFIXES.
    parts : sequence of Part, optional
        Of a Collada file, where they are read already.

    Raises
    ------
    ValueError
        It is not such a file, or has no triangles.
    """
    if suffix == ".dae":
        parts = read_collada(raw) if parts is None else parts
        vertices = np.concatenate([part.position for part in parts]) if parts else np.empty((0, 3))
        faces = np.arange(len(vertices)).reshape(-1, 3)
    elif suffix == ".stl" and len(raw) == 84 + 50 * (count := int.from_bytes(raw[80:84], "little")):  # binary
        rows = np.frombuffer(raw, np.dtype([("normal", "<f4", 3), ("corners", "<f4", 9), ("more", "<u2")]), offset=84)
        vertices, faces = rows["corners"].astype(float).reshape(-1, 3), np.arange(3 * count).reshape(-1, 3)
    elif suffix == ".obj":
        vertices, faces = _read_obj(raw)
    elif suffix in SUFFIXES:
        vertices, faces = _by_trimesh(raw, suffix)
    else:
        raise ValueError(f"{suffix!r} is not one of {', '.join(SUFFIXES)}")
    if not len(faces):
        raise ValueError("it has no triangles")
    if not np.isfinite(vertices).all():
        raise ValueError("a vertex is not finite")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise ValueError("a triangle names a vertex that is not there")
    return vertices, faces


def is_closed(vertices: Floats, faces: Faces) -> bool:
    """True if each edge lies in as many faces one way as the other; corners within 1e-6 of the size are one."""
    low, size = vertices.min(axis=0), np.ptp(vertices, axis=0).max()
    x, y, z = np.rint((vertices - low) * (2**20 / max(size, 1e-300))).astype(np.int64).T
    places = np.unique((x << 42) | (y << 21) | z, return_inverse=True)[1].reshape(-1)[faces]
    start, end = places.reshape(-1), np.roll(places, -1, axis=1).reshape(-1)
    there, back = (np.sort((a << 32) | b) for a, b in ((start, end), (end, start)))
    return bool(np.array_equal(there, back))


def _read_obj(raw: bytes) -> tuple[Floats, Faces]:
    """The vertices of a Wavefront OBJ, and its polygons as fans of triangles.

    Not by trimesh, which takes ten times as long for large ones and ends no line at a carriage return.
    """
    # A line that ends in \ goes on; of vertex/texture/normal the first counts, from 1 on, or back from the last vertex
    # before the face.
    text = b"\n" + raw.replace(b"\\\r\n", b"").replace(b"\\\n", b"").replace(b"\r", b"\n")
    lines = re.findall(rb"\n[ \t]*([vf])[ \t]([^\n]*)", text)
    places = [rest.split(None, 3)[:3] for kind, rest in lines if kind == b"v"]
    if any(len(place) < 3 for place in places):
        raise ValueError("a vertex has fewer than 3 coordinates")
    is_face = np.array([kind == b"f" for kind, _ in lines], bool)
    before = np.cumsum(~is_face)[is_face]
    corners = re.sub(rb"/\S*", b"", b"\n".join(rest for kind, rest in lines if kind == b"f"))
    polygons = [polygon.split() for polygon in corners.split(b"\n")]
    sizes = np.array([len(polygon) for polygon in polygons])
    fans = [np.empty((0, 3), np.int64)]
    for size in np.unique(sizes[sizes > 0]):
        try:
            alike = np.array([polygon for polygon in polygons if len(polygon) == size], np.int64)
        except OverflowError:
            raise ValueError("a face names a vertex that is not there") from None
        alike = np.where(alike < 0, alike + before[sizes == size, None], alike - 1)
        fans += [alike[:, [0, k, k + 1]] for k in range(1, size - 1)]
    return np.array(places, float).reshape(-1, 3), np.concatenate(fans)


def _by_trimesh(raw: bytes, suffix: str) -> tuple[Floats, Faces]:
    import trimesh

    try:
        scene = trimesh.load_scene(io.BytesIO(raw), file_type=suffix[1:], process=False, skip_materials=True)
        mesh = scene.to_mesh()
        return np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)
    except Exception as error:  # trimesh lets errors of many kinds through
        raise ValueError(str(error) or type(error).__name__) from None
