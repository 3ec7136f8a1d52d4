"""Mesh files of every readable format give the body they describe, and what is none is refused."""

import numpy as np
import pytest
import trimesh

from tests.show.pieces import DAE
from twolink.io.mesh_files import SUFFIXES, read_triangles

BOX = trimesh.creation.box((1.0, 2.0, 3.0))


def enclosed(vertices: np.ndarray, faces: np.ndarray) -> float:
    """The volume inside outward triangles, by the divergence theorem."""
    a, b, c = vertices[faces].transpose(1, 0, 2)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


@pytest.mark.parametrize("suffix", [suffix for suffix in SUFFIXES if suffix != ".dae"])
def test_each_format_gives_the_body(suffix: str) -> None:
    raw = BOX.export(file_type=suffix[1:])
    vertices, faces = read_triangles(raw.encode() if isinstance(raw, str) else raw, suffix)
    assert enclosed(vertices, faces) == pytest.approx(6.0)
    assert vertices.min(axis=0) == pytest.approx([-0.5, -1.0, -1.5])


def test_ascii_stl_and_any_end_of_line() -> None:
    for suffix in ("stl_ascii", "obj"):
        text = BOX.export(file_type=suffix)
        for end in ("\n", "\r\n", "\r") if suffix == "obj" else ("\n", "\r\n"):
            vertices, faces = read_triangles(text.replace("\n", end).encode(), f".{suffix[:3]}")
            assert enclosed(vertices, faces) == pytest.approx(6.0)


def test_an_obj_of_polygons_counted_from_either_end() -> None:
    pyramid = """# of a square and four sides, v x y z with a weight, texture and normals
v 0 0 0 1.0
v 2 0 0
v 2 2 \\
0
v 0 2 0
v 1 1 3
vn 0 0 1
vt 0 0
f 4/1/1 3/1/1 2//1 1
f -5 -4 -1
 f 2 3 5
f 3 4 5
f 4 1 5
"""
    vertices, faces = read_triangles(pyramid.encode(), ".obj")
    assert (len(vertices), len(faces)) == (5, 6)
    assert enclosed(vertices, faces) == pytest.approx(4.0)


def test_an_obj_counts_back_from_the_face_and_not_from_the_end_of_the_file() -> None:
    def box(side: float, height: float) -> str:
        made = trimesh.creation.box((side, side, side))
        corners = "".join(f"v {x} {y} {z + height}\n" for x, y, z in made.vertices)
        return corners + "".join("f {} {} {}\n".format(*(face - 8)) for face in made.faces)

    vertices, faces = read_triangles((box(0.2, 0.0) + box(0.4, 1.0)).encode(), ".obj")
    assert enclosed(vertices, faces) == pytest.approx(0.2**3 + 0.4**3)
    assert (vertices[faces][..., 2].min(), vertices[faces][..., 2].max()) == (-0.1, 1.2)


def test_collada_comes_in_metres() -> None:
    vertices, _ = read_triangles(DAE.encode(), ".dae")
    np.testing.assert_allclose(np.ptp(vertices, axis=0), [0.5, 0.5, 0.0], atol=1e-12)


@pytest.mark.parametrize("suffix", [*SUFFIXES, ".fbx", ""])
@pytest.mark.parametrize("raw", [
    b"",
    b"garbage",
    b"\x00" * 200,
    b"v 0 0 0\nv 1 0 0\nv nan 1 0\nf 1 2 3\n",
    b"f 1 2 9\n",
    b"v 0 0\nv 1 0\nv 0 1\nf 1 2 1\n",
    b"v 0 0 0\nf 1 2 99999999999999999999\n",
    b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n",
    b"v 0 0 0\nv 1 0 0\nf -3 -2 -1\nv 0 1 0\n",
])  # fmt: skip
def test_what_is_no_mesh_is_refused(raw: bytes, suffix: str) -> None:
    with pytest.raises(ValueError, match=r"\w"):
        read_triangles(raw, suffix)
