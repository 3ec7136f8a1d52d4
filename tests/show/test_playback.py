"""Playback pages: their animation, limits and refusals, and what a browser shows."""

import base64
import gzip
import json
import re
import time
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

import twolink as tl

# `browser` is a fixture: imported, so that pytest finds it here.
from tests.show.browser import Browser
from tests.show.pieces import DAE, Robot, box_stl, fixed, geometry
from twolink.errors import ShowError
from twolink.show.meshcat_scene import look_at, poses, scene_nodes
from twolink.show.playback import choose_frames, write_playback

BLUE, ORANGE = (0.13, 0.40, 0.68), (0.93, 0.54, 0.16)  # as two_link.urdf has them


@pytest.fixture(scope="module")
def swing(arm: Robot) -> tuple[np.ndarray, np.ndarray]:
    """The paper's arm released from rest, 10 s."""
    model, data = arm[0], arm[0].createData()

    def rate(_: float, x: np.ndarray) -> np.ndarray:
        return np.concatenate([x[2:], pin.aba(model, data, x[:2], x[2:], np.zeros(2))])

    solution = solve_ivp(rate, (0, 10), np.zeros(4), t_eval=np.linspace(0, 10, 601), rtol=1e-8, atol=1e-8)
    return solution.t, solution.y[:2].T


def film(page: Path) -> dict[str, Any]:
    """What a page plays, with its typed arrays."""
    block = re.search(r'<script id="film" type="text/plain">([^<]*)</script>', page.read_text("utf-8"))
    assert block is not None
    return revived(json.loads(gzip.decompress(base64.b64decode(block.group(1)))))


def revived(value: Any) -> Any:
    """The same with typed arrays as NumPy's."""
    if isinstance(value, dict):
        if "$array" in value:
            kind = np.dtype(value["$array"].removesuffix("Array").lower()).newbyteorder("<")
            array = np.frombuffer(base64.b64decode(value["base64"]), kind)
            return counted(array) if value.get("below_new") else array
        return {key: revived(item) for key, item in value.items()}
    return [revived(item) for item in value] if isinstance(value, list) else value


def counted(below: np.ndarray) -> np.ndarray:
    """Numbers that are told by how far they are below the next new one."""
    index, new = np.empty(len(below), int), 0
    for i, number in enumerate(below.tolist()):
        index[i] = new - number
        new += number == 0
    return index


def way(page: Path, piece: str) -> tuple[np.ndarray, np.ndarray]:
    """The times (n,) of a page, and the poses of a piece (n, 7)."""
    shown = film(page)
    motion = shown["motion"]
    drawn = next(item for item in shown["visuals"]["pieces"] if item["name"] == piece)
    placed = motion["poses"].reshape(len(motion["t"]), -1, 7)[:, motion["links"].index(drawn["link"])].astype(float)
    at = pin.XYZQUATToSE3(np.array(drawn["placement"]))
    return motion["t"], np.array([pin.SE3ToXYZQUAT(pin.XYZQUATToSE3(pose) * at) for pose in placed])


def test_bodies_have_their_poses(arm: Robot, swing: tuple[np.ndarray, np.ndarray], tmp_path: Path) -> None:
    page = write_playback(*arm, *swing, tmp_path / "a.html")
    times, placed = way(page, "forearm_1")
    elbow = np.stack([np.cos(swing[1][:, 0]), 0 * swing[0], np.sin(swing[1][:, 0])], axis=-1)
    np.testing.assert_allclose(placed[:, :3], elbow, atol=2e-6)
    np.testing.assert_allclose(times, swing[0], atol=1e-12)
    centre = film(page)["motion"]["centre_of_mass"].reshape(-1, 3)
    expected = [pin.centerOfMass(arm[0], arm[0].createData(), q) for q in swing[1]]
    np.testing.assert_allclose(centre, expected, atol=2e-6)
    assert page.stat().st_size < 1_500_000


def test_speed_decides_on_the_frames(arm: Robot, tmp_path: Path) -> None:
    page = write_playback(*arm, [1.0, 3.0], [[0.0, 0.0], [1.0, 1.0]], tmp_path / "a.html", speed=0.5)
    shown = film(page)
    assert shown["speed"] == 0.5
    np.testing.assert_allclose(shown["motion"]["t"], np.linspace(1.0, 3.0, 241))


def test_few_samples_are_played_as_the_solution_between_them(tmp_path: Path) -> None:
    scene = tl.Scene(tl.load_robot("two_link"), effects=[tl.effects.Gravity()])
    few, many = (
        film(tl.simulate(scene, 2.0, t_eval=t).playback(tmp_path / "a.html"))["motion"]
        for t in ([0.0, 2.0], np.linspace(0.0, 2.0, 400))
    )
    np.testing.assert_allclose(few["poses"], many["poses"], atol=1e-3)


def test_frames_are_capped_and_the_page_says_so(arm: Robot, tmp_path: Path) -> None:
    t = np.linspace(0.0, 100.0, 11)
    page = write_playback(*arm, t, np.column_stack([t, t]) / 50, tmp_path / "a.html", max_frames=201)
    assert len(film(page)["motion"]["t"]) == 201
    assert "shown at 2 frames a second" in page.read_text("utf-8")
    assert choose_frames(t, 1.0, 10_000)[1] == ""


def test_bytes_are_capped_by_dropping_frames_then_refused(arm: Robot, tmp_path: Path) -> None:
    t = np.linspace(0.0, 60.0, 101)
    motion = t, np.column_stack([np.sin(t), np.cos(t)])
    whole = write_playback(*arm, *motion, tmp_path / "a.html")
    smallest = write_playback(*arm, *motion, tmp_path / "b.html", max_frames=2).stat().st_size
    cap = (smallest + whole.stat().st_size) // 2
    page = write_playback(*arm, *motion, tmp_path / "c.html", max_bytes=cap)
    assert page.stat().st_size <= cap
    times = film(page)["motion"]["t"]
    assert 30 < len(times) < 3600
    assert times[-1] == pytest.approx(60.0)
    assert "frames a second" in page.read_text("utf-8")
    with pytest.raises(ShowError, match="more than max_bytes"):
        write_playback(*arm, *motion, tmp_path / "d.html", max_bytes=100_000)
    assert not (tmp_path / "d.html").exists()


@pytest.mark.slow
def test_a_robot_with_large_meshes_fits_a_small_page(tmp_path: Path) -> None:
    """ANYmal's mesh files have 18 MB; copies of one mesh are in the page once."""
    anymal, t = tl.load_robot("anymal"), np.linspace(0.0, 10.0, 11)
    q = np.array([anymal.integrate(anymal.neutral, np.full(anymal.nv, 0.2 * np.sin(s))) for s in t])
    page = write_playback(anymal.model, anymal.visual_model(), t, q, tmp_path / "a.html")
    visuals = film(page)["visuals"]
    assert page.stat().st_size < 5_000_000
    assert len(visuals["objects"]) < len(visuals["pieces"]) == len(anymal.visual_model().geometryObjects)


def test_a_floating_body_is_interpolated_on_its_manifold(tmp_path: Path) -> None:
    model = pin.Model()
    model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root")
    visuals = pin.GeometryModel()
    visuals.addGeometryObject(geometry("cube", coal.Box(1.0, 1.0, 1.0), joint=1))
    half_turn = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1e-9]
    q = np.array([[0, 0, 0, 0, 0, 0, 1], half_turn], float)
    page = write_playback(model, visuals, [0.0, 1.0], q, tmp_path / "a.html")
    middle = way(page, "cube")[1][30, 3:]
    np.testing.assert_allclose(np.abs(middle), [0, 0, np.sqrt(0.5), np.sqrt(0.5)], atol=1e-6)


def test_colour_and_alpha_are_those_of_the_urdf(arm: Robot) -> None:
    nodes, _ = scene_nodes(arm[1])
    materials = {node.name: node.object["materials"][0] for node in nodes}
    assert materials["forearm_0"]["color"] == sum(round(255 * c) << s for c, s in zip(ORANGE, (16, 8, 0), strict=True))
    assert not materials["forearm_0"]["transparent"]
    nodes, _ = scene_nodes(fixed(geometry("glass", coal.Sphere(0.1)))[1])
    assert nodes[0].object["materials"][0]["opacity"] == pytest.approx(0.5)
    assert nodes[0].object["materials"][0]["transparent"]


HOSTILE = "</script><script>window.hacked=1</script>%%VIEWER%%<img src=x onerror=hacked=1>"


def test_names_cannot_inject_markup(tmp_path: Path) -> None:
    names = [HOSTILE, "a/b", "__proto__", "constructor"]
    items = [geometry(name, coal.Sphere(0.1)) for name in names]
    path = write_playback(*fixed(*items), 0.0, np.empty(0), tmp_path / "a.html", title=HOSTILE)
    page = path.read_text("utf-8")
    assert "<script>window.hacked" not in page
    assert "<img src=x" not in page
    assert page.count("</script>") == 3
    assert [piece["name"] for piece in film(path)["visuals"]["pieces"]] == names


@pytest.mark.parametrize(("t", "q", "what"), [
    ([0.0, 1.0], [[0.0, 0.0], [np.nan, 0.0]], "q is not finite at sample 1"),
    ([0.0, np.inf], [[0.0, 0.0], [0.0, 0.0]], "t is not finite at sample 1"),
    ([0.0, 2.0, 1.0], np.zeros((3, 2)), "t does not increase at sample 2"),
    ([0.0, 0.0], np.zeros((2, 2)), "t does not increase at sample 1"),
    ([0.0, 1.0], np.zeros((3, 2)), "q is (3, 2)"), ([], np.zeros((0, 2)), "n >= 1"),
])  # fmt: skip
def test_a_motion_that_cannot_be_shown_is_refused(arm: Robot, tmp_path: Path, t: Any, q: Any, what: str) -> None:
    with pytest.raises(ShowError, match=re.escape(what)):
        write_playback(*arm, t, q, tmp_path / "a.html")


def test_paths_and_speeds_that_are_refused(arm: Robot, tmp_path: Path) -> None:
    still = [0.0], [[0.0, 0.0]]
    (tmp_path / "file").write_text("")
    with pytest.raises(ShowError, match="cannot be written"):
        write_playback(*arm, *still, tmp_path / "file" / "a.html")
    with pytest.raises(ShowError, match="speed is -1"):
        write_playback(*arm, *still, tmp_path / "a.html", speed=-1.0)


def test_a_plane_motion_is_seen_from_the_side_and_fits(arm: Robot, swing: tuple[np.ndarray, np.ndarray]) -> None:
    nodes, _ = scene_nodes(arm[1])
    placed = poses(*arm, swing[1], nodes)
    view = look_at(nodes, placed)
    np.testing.assert_allclose(view.direction, [0, -1, 0], atol=1e-9)
    assert view.floor < placed[..., 2].min()
    still = look_at(nodes, placed[:1])
    assert abs(still.direction[0]) > 0.1  # one pose has no plane of motion
    for aspect in (0.5, 1.0, 2.0):
        distance, slope = view.distance(aspect), np.tan(np.radians(16.0))
        spread = np.abs(view.seen[:, :2]) / (distance - view.seen[:, 2:]) / slope / [aspect, 1.0]
        assert 0.8 < spread.max() < 1.0


def near(picture: np.ndarray, rgb: tuple[float, float, float]) -> int:
    """The number of pixels of that hue, at any brightness."""
    colour = picture.astype(float)
    bright = np.linalg.norm(colour, axis=-1)
    along = colour @ (np.array(rgb) / np.linalg.norm(rgb))
    return int(((along > 0.995 * bright) & (bright > 60)).sum())


TIME = "Number.parseFloat(document.getElementById('clock').textContent)"


@pytest.mark.browser
def test_the_page_plays_offline(
    arm: Robot, swing: tuple[np.ndarray, np.ndarray], tmp_path: Path, browser: Browser
) -> None:
    events = [(2.0, "reverse elbow"), (2.001, "stick elbow"), (9.0, "</script>")]
    page = write_playback(*arm, *swing, tmp_path / "swing.html", title="Two links & <rods>", speed=0.5, events=events)
    browser.open(page.as_uri())
    browser.wait_for(f"window.viewer?.motion && {TIME} > 0.1")
    first, shown = browser.screenshot(), browser.evaluate(TIME)
    time.sleep(0.5)
    second = browser.screenshot()
    assert len(np.unique(first.reshape(-1, 3), axis=0)) > 50
    assert near(first, BLUE) > 1000
    assert near(first, ORANGE) > 1000
    assert (first != second).any(axis=-1).sum() > 500
    assert browser.evaluate(TIME) != shown
    assert "Two links & <rods>" in browser.evaluate("document.body.innerText")
    assert browser.evaluate("document.getElementById('speed').value") == "0.5"
    # an event's mark on the time line goes there
    marks = browser.evaluate("[...document.querySelectorAll('.mark')].map(mark => mark.title)")
    assert marks == ["2 s: reverse elbow, and 1 more", "9 s: </script>"]
    browser.evaluate("document.querySelector('.mark').click()")
    assert browser.evaluate("document.getElementById('clock').textContent") == "2.00 s"
    elbow = browser.evaluate("viewer.robot.links.get('elbow').group.position.toArray()")
    q = swing[1][int(np.argmin(np.abs(swing[0] - 2.0)))]
    np.testing.assert_allclose(elbow, [np.cos(q[0]), 0, np.sin(q[0])], atol=1e-3)
    assert [url for url in browser.requests if not url.startswith(("file:", "data:", "blob:"))] == []
    assert [url for url in browser.requests if url.startswith("file:")] == [page.as_uri()]
    assert browser.errors == []


@pytest.mark.slow
@pytest.mark.browser
def test_what_is_drawn_over_the_robot_is_where_it_belongs(arm: Robot, tmp_path: Path, browser: Browser) -> None:
    t = np.linspace(0.0, 1.0, 61)
    q = np.column_stack([t, -2.0 * t])
    points = np.full((61, 1, 3), np.nan)
    points[30:] = [1.5, 0.0, 0.25]
    contacts = {"tip - ground": (points, np.where(np.isfinite(points), [0.0, 0.0, 7.0], np.nan))}
    forces = {"push on tip": (np.ones((61, 1, 3)), np.full((61, 1, 3), [0.0, 3.0, 4.0]))}
    page = write_playback(*arm, t, q, tmp_path / "a.html", contacts=contacts, forces=forces, trails=["tip"],
                          beside=(*arm, t, -q))  # fmt: skip
    browser.open(page.as_uri())
    browser.wait_for("window.viewer?.ghost")

    def at(moment: float, expression: str) -> Any:
        return browser.evaluate(f"viewer.timeline.pause(), viewer.timeline.seek({moment}), {expression}")

    place = "[...{}.position.toArray()]"
    arrow = "viewer.overlays.parts.get('contacts').object.children[0]"
    assert at(0.25, f"{arrow}.visible") is False
    assert at(0.75, f"{arrow}.visible") is True
    assert at(0.75, place.format(arrow)) == [1.5, 0.0, 0.25]
    assert "contact forces, up to 7 N" in browser.evaluate("document.getElementById('view-menu').textContent")
    tip = np.array([np.cos(0.5) + np.cos(-0.5), 0.0, np.sin(0.5) + np.sin(-0.5)])
    end = """(() => {
        const { geometry } = viewer.overlays.parts.get('trail tip').object;
        const { start, count } = geometry.drawRange, { array } = geometry.attributes.position;
        const ring = [0, 1, 2, 3, 4, 5].map(i => geometry.index.getX(start + count + 6 * i));
        return [0, 1, 2].map(k => ring.reduce((sum, i) => sum + array[3 * i + k], 0) / 6); })()"""
    np.testing.assert_allclose(at(0.5, end), tip, atol=0.01)
    ghost = at(0.5, place.format("viewer.ghost.robot.links.get('elbow').group"))
    np.testing.assert_allclose(ghost, [np.cos(0.5), 0.0, -np.sin(0.5)], atol=1e-6)
    click = "[...document.querySelectorAll('#view-menu label')].find(e => e.textContent.includes('{}')).control.click()"
    browser.evaluate(click.format("frames"))
    browser.evaluate(click.format("centre"))
    browser.evaluate(click.format("forces on links, up to 5 N"))
    push = "viewer.overlays.parts.get('forces').object.children[0]"
    assert at(0.5, place.format(push)) == [1.0, 1.0, 1.0]
    assert at(0.5, f"{push}.visible") is True
    assert browser.evaluate("viewer.overlays.parts.get('frames').object.children.length") == 3
    centre = at(0.5, place.format("viewer.overlays.parts.get('centre').object.children[0]"))
    expected = pin.centerOfMass(arm[0], arm[0].createData(), np.array([0.5, -1.0]))
    np.testing.assert_allclose(centre, expected, atol=1e-6)
    # the camera goes with the link that it is on
    browser.evaluate("""(() => { const select = document.querySelector('#view-menu select'); select.value = 'tip';
        select.dispatchEvent(new Event('change')); })()""")
    look = "viewer.stage.viewer.controls.target.toArray()"  # y is up
    np.testing.assert_allclose(at(0.5, look), [tip[0], tip[2], -tip[1]], atol=1e-3)
    assert browser.errors == []


@pytest.mark.slow
@pytest.mark.browser
def test_a_ball_that_flies_away_does_not_shrink_the_arm(tmp_path: Path, browser: Browser) -> None:
    scene, t = tl.load_scene("pitch"), np.linspace(0.0, 2.0, 61)
    q = np.tile(scene.q, (61, 1))
    q[:, 2] += 30.0 * t  # the ball, along x
    page = write_playback(scene.robot.model, scene.robot.visual_model(), t, q, tmp_path / "a.html")
    browser.open(page.as_uri())
    browser.wait_for("window.viewer?.motion")
    distance = "viewer.stage.viewer.camera.position.distanceTo(viewer.stage.viewer.controls.target)"
    assert browser.evaluate(distance) < 8.0
    browser.evaluate("document.getElementById('view-fit').click()")  # all of it
    assert browser.evaluate(distance) > 50.0


@pytest.mark.slow
@pytest.mark.browser
def test_the_animation_repeats(arm: Robot, tmp_path: Path, browser: Browser) -> None:
    page = write_playback(*arm, [0.0, 1.0], [[0.0, 0.0], [1.0, 1.0]], tmp_path / "short.html")
    browser.open(page.as_uri())
    browser.wait_for(f"window.viewer?.motion && {TIME} > 0.6")
    browser.wait_for(f"{TIME} < 0.4")
    assert browser.evaluate("viewer.timeline.playing")


@pytest.mark.slow
@pytest.mark.browser
def test_every_shape_has_its_true_size(tmp_path: Path, browser: Browser) -> None:
    (tmp_path / "a.dae").write_text(DAE)
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 2 0 0\nv 0 3 0\nv 0 0 4\nf 1 3 2\nf 1 2 4\nf 1 4 3\n")
    bodies = {
        "box": (coal.Box(1.0, 2.0, 3.0), "", [1, 2, 3]),
        "ball": (coal.Sphere(0.5), "", [1, 1, 1]),
        "tube": (coal.Cylinder(0.5, 3.0), "", [1, 1, 3]),
        "pill": (coal.Capsule(0.5, 3.0), "", [1, 1, 4]),
        "cone": (coal.Cone(0.5, 3.0), "", [1, 1, 3]),
        "egg": (coal.Ellipsoid(1.0, 2.0, 3.0), "", [2, 4, 6]),
        "stl": (coal.Sphere(1.0), str(box_stl(tmp_path / "a.stl")), [1, 1, 1]),
        "dae": (coal.Sphere(1.0), str(tmp_path / "a.dae"), [0.5, 0.5, 0]),
        "obj": (coal.Sphere(1.0), str(tmp_path / "a.obj"), [2, 3, 4]),
        HOSTILE: (coal.Sphere(0.5), "", [1, 1, 1]),
        "__proto__": (coal.Sphere(0.5), "", [1, 1, 1]),
    }
    items = [geometry(name, shape, mesh=mesh) for name, (shape, mesh, _) in bodies.items()]
    page = write_playback(*fixed(*items), 0.0, np.empty(0), tmp_path / "shapes.html", title=HOSTILE)
    browser.open(page.as_uri())
    browser.wait_for("window.viewer?.motion")
    sizes = browser.evaluate("""viewer.visuals.pieces.map((piece, i) => {
        viewer.stage.viewer.scene.updateMatrixWorld(true);
        const node = viewer.stage.viewer.scene_tree.find(["robot", "world", `piece ${i}`]).object;
        const size = new MeshCat.THREE.Box3().setFromObject(node).getSize(new MeshCat.THREE.Vector3());
        return [size.x, size.z, size.y];  // the scene is turned: its z is up in three.js's y
    })""")
    for size, (name, (_, _, expected)) in zip(sizes, bodies.items(), strict=True):
        np.testing.assert_allclose(size, expected, rtol=0.01, atol=1e-6, err_msg=name)
    assert browser.evaluate("window.hacked") is None
    assert browser.errors == []
