"""Mesh files: units, frames, colours, pictures; and which files they may make the program open."""

import base64
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pytest
import trimesh

from tests.show.pieces import DAE, fixed, geometry
from tests.show.test_playback import revived
from twolink.errors import ShowError
from twolink.io.mesh_files import read_collada
from twolink.show.meshcat_scene import scene_nodes
from twolink.show.playback import write_playback
from twolink.show.surfaces import surfaces

SECRET = b"the host's own file"
ENCODED = base64.b64encode(SECRET).decode()
OBJ = "mtllib {library}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n"
COLOUR = "<color>0 0.8 0 1</color>"
PICTURE = """<library_images><image id="i"><init_from>{name}</init_from></image></library_images>
<library_effects><effect id="e"><profile_COMMON><newparam sid="s"><surface type="2D">
<init_from>i</init_from></surface></newparam><newparam sid="t"><sampler2D><source>s</source></sampler2D></newparam>
<technique sid="c"><lambert>
<diffuse><texture texture="t" texcoord="u"/></diffuse></lambert></technique></profile_COMMON></effect>
</library_effects>"""


def textured(name: str) -> str:
    """The square of DAE with a picture for a colour."""
    start, end = DAE.index("<library_effects>"), DAE.index("<library_materials>")
    return DAE[:start] + PICTURE.format(name=name) + DAE[end:]


def drawn(path: Path, *, override: bool = False) -> dict[str, Any]:
    """The three.js object of a mesh file."""
    nodes, skipped = scene_nodes(fixed(geometry("mesh", coal.Sphere(1.0), mesh=str(path), override=override))[1])
    assert skipped == []
    return nodes[0].object


@pytest.mark.parametrize("scale", [(1.0, 1.0, 1.0), (1.0, 2.0, 3.0), (1.0, -2.0, 3.0)])
def test_normals_of_a_mesh_that_is_stretched_or_mirrored(scale: tuple[float, ...], tmp_path: Path) -> None:
    """Those of an ellipsoid, outward, of a ball's mesh."""
    trimesh.creation.icosphere(3).export(tmp_path / "ball.stl")
    piece = geometry("mesh", coal.Sphere(1.0), mesh=str(tmp_path / "ball.stl"))
    piece.meshScale = np.array(scale)
    (one,) = surfaces(fixed(piece)[1])[0]
    exact = one.triangles / np.square(scale)
    exact /= np.linalg.norm(exact, axis=-1, keepdims=True)
    assert (one.normals * exact).sum(axis=-1).min() > 0.98


def corners(drawn: dict[str, Any]) -> np.ndarray:
    """The corners (3m, 3) of an object's triangles, m."""
    data = revived(drawn["geometries"][0]["data"])
    whole = data["attributes"]["position"]["array"].reshape(-1, 3)[data["index"]["array"]]
    matrix = np.array(drawn["object"]["matrix"]).reshape(4, 4).T
    return whole @ matrix[:3, :3].T + matrix[:3, 3]


def test_collada_brings_its_unit_its_frames_and_its_colour(tmp_path: Path) -> None:
    (tmp_path / "a.dae").write_text(DAE)
    for override, colour in ((False, 0x00CC00), (True, 0xFF0000)):
        square = drawn(tmp_path / "a.dae", override=override)
        vertices = corners(square)
        np.testing.assert_allclose(vertices.min(axis=0), [-0.5, 0, 1], atol=1e-6)  # turned by 90 deg, lifted
        np.testing.assert_allclose(vertices.max(axis=0), [0, 0.5, 1], atol=1e-6)
        assert len(vertices) == 6  # a square is two triangles
        assert square["materials"][0]["color"] == colour


def test_a_missing_mesh_is_skipped_and_named(tmp_path: Path) -> None:
    gone = geometry("gone", coal.BVHModelOBBRSS(), mesh=str(tmp_path / "gone.stl"))
    skipped: list[str] = []
    model, visuals = fixed(geometry("here", coal.Sphere(0.1)), gone)
    page = write_playback(model, visuals, 0.0, np.empty(0), tmp_path / "a.html", on_skipped=skipped.extend)
    assert skipped == ["gone"]
    assert "not drawn: gone" in page.read_text("utf-8")
    with pytest.raises(ShowError, match="nothing to draw"):
        write_playback(*fixed(gone), 0.0, np.empty(0), tmp_path / "b.html")


def test_a_picture_beside_the_collada_file_covers_its_part(tmp_path: Path) -> None:
    (tmp_path / "p.png").write_bytes(SECRET)
    (tmp_path / "a.dae").write_text(textured("p.png"))
    item = drawn(tmp_path / "a.dae")
    assert item["images"][0]["url"] == f"data:image/png;base64,{ENCODED}"
    assert item["materials"][0]["map"] == item["textures"][0]["uuid"]
    assert item["textures"][0]["image"] == item["images"][0]["uuid"]
    assert item["geometries"][0]["data"]["attributes"]["uv"]["itemSize"] == 2
    assert "textures" not in drawn(tmp_path / "a.dae", override=True)  # the URDF's colour counts


def test_a_broken_material_costs_the_colour_and_not_the_part(tmp_path: Path) -> None:
    (tmp_path / "a.dae").write_text(DAE.replace('target="#m"', 'target="#gone"'))
    item = drawn(tmp_path / "a.dae")
    assert item["geometries"][0]["type"] == "BufferGeometry"
    assert item["materials"][0]["color"] == 0xFF0000


def test_a_comment_full_of_bindings_takes_a_step_for_each() -> None:
    comment = "<!--" + '<instance_material target="#gone">' * 100_000 + "-->"  # an hour, if each looks at all others
    text = DAE.replace("<asset>", f"{comment}<asset>").replace('target="#m"', 'target="#gone"')
    assert len(read_collada(text.encode())) == 1


@pytest.mark.parametrize("text", ["", "<COLLADA", DAE.replace("<COLLADA", "<!DOCTYPE x><COLLADA"), DAE[:900]])
def test_collada_that_cannot_be_read_is_not_drawn_from_the_file(text: str, tmp_path: Path) -> None:
    (tmp_path / "a.dae").write_text(text)
    assert drawn(tmp_path / "a.dae")["geometries"][0]["type"] == "SphereGeometry"  # what the reader of URDF made


@pytest.mark.parametrize("line", [
    "map_Kd {}", "map_Kd -o 0 0 0 {}", "  bump\t{}", "map_Kd x.png\rmap_Kd {}", "disp -s 1 1 1 {}", "map_kd m {}",
])  # fmt: skip
@pytest.mark.parametrize("absolute", [True, False])
def test_materials_cannot_show_pictures_outside_the_folder(line: str, absolute: bool, tmp_path: Path) -> None:
    (tmp_path / "secret.png").write_bytes(SECRET)
    folder = tmp_path / "meshes"
    folder.mkdir()
    (folder / "x.png").write_bytes(b"x")
    (folder / "a.obj").write_text(OBJ.format(library="a.mtl"))
    (folder / "a.mtl").write_text("newmtl m\n" + line.format(tmp_path / "secret.png" if absolute else "../secret.png"))
    assert ENCODED not in str(drawn(folder / "a.obj"))
    (folder / "a.mtl").write_text("newmtl m\nmap_Kd -o 0 0 0 near this.png")
    (folder / "near this.png").write_bytes(SECRET)
    assert ENCODED in str(drawn(folder / "a.obj"))  # so the check above can fail


def test_a_page_asks_for_no_file_that_a_material_names(tmp_path: Path) -> None:
    """The viewer gets the statements it knows, and pictures under names that are all among its resources."""
    maps = ["map_Kd http://elsewhere/a.png", "map_bump -bm 2 b.png", "refl http://elsewhere/c.png"]
    (tmp_path / "a.obj").write_text(OBJ.format(library="a.mtl"))
    for end in ("\n", "\r", "\r\n"):
        (tmp_path / "a.mtl").write_bytes(end.join(["newmtl m", "Kd 1 0 0", *maps]).encode())
        item = drawn(tmp_path / "a.obj")["object"]
        expected = ["newmtl m", "Kd 1 0 0", "map_Kd picture-0", "map_bump -bm 2 picture-1"]
        assert item["mtl_library"].split("\n") == expected
        assert list(item["resources"]) == ["picture-0", "picture-1"]


def test_links_collada_and_libraries_cannot_leave_the_folder(tmp_path: Path) -> None:
    (tmp_path / "secret.png").write_bytes(SECRET)
    (tmp_path / "secret.mtl").write_bytes(SECRET)
    folder = tmp_path / "meshes"
    folder.mkdir()
    (folder / "link.png").symlink_to(tmp_path / "secret.png")
    for name in ("link.png", "../secret.png", str(tmp_path / "secret.png"), "file://" + str(tmp_path / "secret.png")):
        (folder / "a.dae").write_text(textured(name))
        assert drawn(folder / "a.dae")["images"][0]["url"].startswith("data:image/png;base64,iVBOR")  # white
        assert ENCODED not in str(drawn(folder / "a.dae"))
    (folder / "a.obj").write_text(OBJ.format(library="../secret.mtl"))
    assert "mtl_library" not in str(drawn(folder / "a.obj"))
