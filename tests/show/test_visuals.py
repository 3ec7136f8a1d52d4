"""Missing and broken meshes are named; colours do not depend on them."""

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import twolink as tl
from tests.show.pieces import box_stl
from tests.urdf_text import joint, link, robot_of
from twolink.errors import ShowError
from twolink.show import meshcat_shapes, playback
from twolink.show import surfaces as surfaces_module
from twolink.show.meshcat_scene import scene_nodes
from twolink.show.surfaces import surfaces

RED, BLUE = '<color rgba="1 0 0 1"/>', '<color rgba="0 0 1 1"/>'


def urdf(*visuals: str) -> str:
    """Two links in a row, each with one of the visuals."""
    parents = ("ground", *(f"b{i}" for i in range(len(visuals))))
    return robot_of(*(
        link(f"b{i}", more=f"<visual>{visual}</visual>") + joint(f"j{i}", "continuous", parents[i], f"b{i}", "0 1 0")
        for i, visual in enumerate(visuals)))  # fmt: skip


def mesh(name: object, colour: str = "") -> str:
    return f'<geometry><mesh filename="{name}"/></geometry><material name="m">{colour}</material>'


def sphere(colour: str = "") -> str:
    return f'<geometry><sphere radius="0.1"/></geometry><material name="m">{colour}</material>'


def motion(robot: tl.Robot) -> tl.Trajectory:
    t = np.array([0.0, 0.1])
    return tl.Trajectory(robot, t, np.array([robot.neutral] * 2), np.zeros((2, robot.nv)), t, None, None)


@pytest.mark.parametrize(("visuals", "colour"), [
    ((mesh("gone.stl", RED), sphere()), [1, 0, 0, 1]), ((mesh("gone.stl", RED), sphere(BLUE)), [1, 0, 0, 1]),
    ((sphere(BLUE), mesh("gone.stl", RED), sphere()), [0, 0, 1, 1]),
])  # fmt: skip
def test_a_colour_does_not_depend_on_the_mesh_that_defined_it(
    visuals: tuple[str, ...], colour: list[float], tmp_path: Path
) -> None:
    """With the mesh or without it, the first definition counts for all later shapes."""
    corners = "vertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0"
    facet = f"facet normal 0 0 1\nouter loop\n{corners}\nendloop\nendfacet"
    (tmp_path / "a.stl").write_text(f"solid a\n{facet}\nendsolid a\n")
    there = [visual.replace("gone.stl", str(tmp_path / "a.stl")) for visual in visuals]
    for text in (urdf(*visuals), urdf(*there)):
        shapes = tl.load_robot(text).visual_model().geometryObjects
        for shape in (s for s in shapes if not s.meshPath.endswith(".stl")):
            assert shape.meshColor.tolist() == colour


def test_a_file_that_is_no_mesh_is_named(tmp_path: Path) -> None:
    (tmp_path / "bad.stl").write_bytes(b"garbage")
    run = motion(tl.load_robot(urdf(mesh(tmp_path / "bad.stl"))))
    for show in (lambda: run.playback(tmp_path / "x.html"), lambda: run.play(open_browser=False)):
        with pytest.raises(ShowError, match=r"the mesh '.*bad\.stl' cannot be read") as failure:
            show()
        assert "\n" not in str(failure.value)
    assert not (tmp_path / "x.html").exists()


def test_playing_logs_what_no_callback_takes(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture, tmp_path: Path
) -> None:
    """The address, and the missing pieces."""

    def play(*_: Any, on_url: Any, on_skipped: Any, **__: Any) -> None:
        on_url("http://here")
        on_skipped(["a", "b"])

    monkeypatch.setattr(playback, "play_live", play)
    run, said = motion(tl.load_robot("two_link")), []
    with caplog.at_level("INFO", logger="twolink"):
        run.play()
    assert caplog.messages == ["playing at http://here", "not drawn: a, b"]
    run.play(on_url=said.append, on_skipped=said.extend)
    assert said == ["http://here", "a", "b"]
    assert capfd.readouterr().out == ""
    run.playback(tmp_path / "x.html", on_skipped=said.extend)
    assert capfd.readouterr().out == ""


def test_a_saved_scene_keeps_its_meshes(tmp_path: Path) -> None:
    """Their files and scales go into the URDF that is written beside the scene."""
    (tmp_path / "far").mkdir()
    box_stl(tmp_path / "far" / "a.stl")
    scaled = mesh("package://far/a.stl").replace("<mesh ", '<mesh scale="1 2 -3" ')
    robot = tl.load_robot(urdf(scaled, sphere()), package_dirs=[tmp_path])
    again = tl.load_scene(tl.Scene(robot).save(tmp_path / "scene.toml")).robot
    for one, other in zip(*(r.visual_model().geometryObjects for r in (robot, again)), strict=True):
        assert (one.name, one.meshPath) == (other.name, other.meshPath)
        for shape in (one.geometry, other.geometry):
            shape.computeLocalAABB()
        assert one.geometry.aabb_local == other.geometry.aabb_local
    box = robot.visual_model().geometryObjects[0].geometry
    box.computeLocalAABB()
    np.testing.assert_allclose([box.aabb_local.min_, box.aabb_local.max_], [[0, 0, -3], [1, 2, 0]], atol=1e-6)


def test_no_reader_but_ours_opens_a_mesh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pinocchio's reader of URDF would open each mesh it sees, and the files that the mesh names."""
    box_stl(tmp_path / "a.stl")
    seen: list[str] = []
    build = pin.buildGeomFromUrdfString
    monkeypatch.setattr(pin, "buildGeomFromUrdfString", lambda *a: (seen.append(a[1]), build(*a))[1])
    shapes = tl.load_robot(urdf(mesh(tmp_path / "a.stl"))).visual_model().geometryObjects
    assert shapes[0].geometry.num_tris == 4
    assert "<sphere" in seen[0]
    assert "a.stl" not in seen[0]


def test_collada_files_of_a_robot_are_read_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is drawn from the parts that loading has read is what is drawn from the files."""
    locked = tl.load_robot("panda", lock={"panda_finger_joint1": 0.0})
    shapes = locked.visual_model(tree=False)
    from_files, _ = scene_nodes(pin.GeometryModel(shapes))
    seen, _ = surfaces(pin.GeometryModel(shapes))
    for module in (meshcat_shapes, surfaces_module):
        monkeypatch.setattr(module, "read_confined", None)
    assert [node.object for node in scene_nodes(shapes)[0]] == [node.object for node in from_files]
    assert len(from_files) == 11
    for one, other in zip(surfaces(shapes)[0], seen, strict=True):
        np.testing.assert_array_equal(one.triangles, other.triangles)
