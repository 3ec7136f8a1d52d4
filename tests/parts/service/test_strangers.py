"""Uploads that name files of the host: they load, without those files; and nothing outside the upload is opened."""

import asyncio
import gzip
import io
import stat
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest

from tests.parts.service.serving import mesh, pendulum, stl, zipped
from tests.parts.service.working import working
from tests.show.pieces import DAE
from tests.show.test_mesh_files import ENCODED, OBJ, SECRET, textured


def uploads(secret: Path) -> Iterator[tuple[str, str, bytes]]:
    """Name, kind and content of uploads that name the file `secret`(.png, .mtl or .stl) in every way we know."""
    above = "../" * 12 + str(secret)[1:]
    picture, outside = f"{secret}.png", f"{above}.png"
    for name in (
        f"file://{secret}.stl", f"{secret}.stl", f"{above}.stl", f"package://{above}.stl",
        f"package://a/{above}.stl".replace("..", "&#46;&#x2e;"), "http://127.0.0.1:9/a.stl", "package://a\\..\\..\\b.stl",
        "n" * 5000, "package://example-robot-data/../../../../../../../../../../.." + f"{secret}.stl",
    ):  # fmt: skip
        yield f"mesh {name[:60]}", "urdf", pendulum(mesh(name)).encode()
    obj, dae = {"r.urdf": pendulum(mesh("a.obj"))}, {"r.urdf": pendulum(mesh("a.dae"))}
    for line in ("map_Kd {}", "map_Kd -o 0 0 0 {}", "bump\t{}", "map_Kd x\rmap_Kd {}", "map_d m {}"):
        for name in (picture, outside):
            material = ("newmtl m\n" + line.format(name)).encode()
            yield line, "zip", zipped({**obj, "a.obj": OBJ.format(library="m.mtl"), "m.mtl": material})
    for library in (f"{secret}.mtl", f"{above}.mtl"):
        for end in ("\n", "\r", "\r\n"):
            yield f"library {library}", "zip", zipped({**obj, "a.obj": OBJ.format(library=library).replace("\n", end)})
    as_library = zipped({**obj, "a.obj": OBJ.format(library="m.png"), "m.png": f"newmtl m\nmap_Kd {picture}"})
    yield "a picture as library", "zip", as_library
    hidden = outside.replace("..", "&#46;&#46;"), picture.replace("/", "\\")
    for name in (picture, outside, f"file://{picture}", *hidden):
        yield f"texture {name}", "zip", zipped({**dae, "a.dae": textured(name)})
    entity = f'<!DOCTYPE x [<!ENTITY e SYSTEM "file://{secret}.png">]>'
    yield "entity", "zip", zipped({**dae, "a.dae": DAE.replace("<COLLADA", f"{entity}<COLLADA").replace("half", "&e;")})
    yield "zip as Collada", "zip", zipped({**dae, "a.dae": zipped({"a.dae": entity + DAE}, zipfile.ZIP_STORED)})
    gltf = f'{{"asset": {{"version": "2.0"}}, "buffers": [{{"uri": "{picture}", "byteLength": 19}}]}}'
    yield "glTF as STL", "zip", zipped({"r.urdf": pendulum(mesh("a.stl")), "a.stl": gltf})
    yield "OBJ as STL", "zip", zipped({"r.urdf": pendulum(mesh("a.stl")), "a.stl": OBJ.format(library=f"{secret}.mtl")})
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr("r.urdf", pendulum(mesh("a.stl")))
        link = zipfile.ZipInfo("a.stl")
        link.create_system, link.external_attr = 3, (stat.S_IFLNK | 0o777) << 16
        archive.writestr(link, f"{secret}.stl")
    yield "link in a zip", "zip", out.getvalue()


@pytest.fixture(scope="module")
def traced(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[str, dict[str, Any], str]]:
    """Each upload's name, what was opened for it, and its visuals."""
    top = tmp_path_factory.mktemp("host")
    secret = top / "secret"
    for suffix, content in {".png": SECRET, ".stl": stl(), ".mtl": b"newmtl m\nKd 0.123 0 0"}.items():
        secret.with_suffix(suffix).write_bytes(content)

    async def work() -> list[tuple[str, dict[str, Any], str]]:
        results, cases = [], [("control", "urdf", pendulum().encode()), *uploads(secret)]
        async with working(tasks="tests.parts.service.traced_tasks", writable=[top]) as workers:
            for number, (name, kind, content) in enumerate(cases):
                folder = top / "robots" / f"u-{number:020x}"
                folder.mkdir(parents=True)
                (folder / "body").write_bytes(content)
                also = str(secret.with_suffix(".png")) if name == "control" else ""
                traced = await workers.run("upload", 60, folder=str(folder), kind=kind, also=also)
                drawn = folder / "visuals.json.gz"
                results.append((name, traced, gzip.decompress(drawn.read_bytes()).decode() if drawn.exists() else ""))
        return results

    return asyncio.run(work())


@pytest.mark.slow
def test_nothing_outside_the_upload_is_opened(traced: list[tuple[str, dict[str, Any], str]]) -> None:
    (_, control, _), *cases = traced
    assert [Path(path).name for path in control["opened"]] == ["secret.png"]  # so the check below can fail
    assert {name: found["opened"] for name, found, _ in cases if found["opened"]} == {}
    assert all(found["inside"] >= 3 for _, found, _ in cases)


def test_nothing_outside_the_upload_is_shown(traced: list[tuple[str, dict[str, Any], str]]) -> None:
    for name, found, drawn in traced:
        assert ENCODED not in drawn, name
        assert "0.123" not in drawn, name
        if name.startswith("mesh "):  # they are missing, and the report says so
            assert msgspec.json.decode(drawn)["pieces"] == []
            assert "not found" in str(found["report"])
        elif name.startswith(("map", "bump", "library", "texture", "a picture")):  # the mesh is drawn without them
            assert len(msgspec.json.decode(drawn)["pieces"]) == 1, (name, found)
        elif name != "control":
            assert "cannot be read" in found["refused"], (name, found)
