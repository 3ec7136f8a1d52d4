"""Films and pictures without a display."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image, ImageSequence

import twolink as tl
from tests.command import call, one_line
from tests.urdf_text import joint, link, robot_of
from twolink import effects as fx
from twolink.errors import SceneError, ShowError
from twolink.show.meshcat_scene import look_at, picture_axes, poses
from twolink.show.raycasting import CONTACT_COLOUR, DOT, FORCE_COLOUR, Arrows, Camera, Picture
from twolink.show.surfaces import surfaces
from twolink.simulation import Trajectory

RED = '<material name="r"><color rgba="1 0 0 1"/></material>'
BALL = link("base", more=f'<visual><geometry><sphere radius="0.1"/></geometry>{RED}</visual>')
SIZE = (160, 120)
G = 9.81
AT_REST = np.array([[0.0, 0, 0, 0, 0, 0, 1]])


@pytest.fixture(scope="module")
def run() -> Trajectory:
    return tl.simulate(tl.load_scene("arm-swing"), 1.0, accuracy=1e-3, samples_per_second=50)


@pytest.fixture(scope="module")
def ball() -> tuple[tl.Robot, Any, list[Any]]:
    """A ball, its visuals and what is drawn of them."""
    robot = tl.load_robot(f'<robot name="ball">{BALL}</robot>', root="free")
    visuals = robot.visual_model()
    drawn, skipped = surfaces(visuals)
    assert not skipped
    return robot, visuals, drawn


@pytest.fixture(scope="module")
def camera(ball: tuple[tl.Robot, Any, list[Any]]) -> Camera:
    """One that looks at the ball along y."""
    robot, visuals, drawn = ball
    return Camera(look_at(drawn, poses(robot.model, visuals, AT_REST, drawn), (0, -1, 0)), SIZE)


def test_a_ball_fills_the_circle_that_perspective_gives(ball: tuple[tl.Robot, Any, list[Any]], camera: Camera) -> None:
    robot, visuals, drawn = ball
    image = Picture(robot.model, visuals, drawn, camera).of(AT_REST[0]).astype(int)
    red = (image[..., 0] - image[..., 2]) > 60
    # A sphere seen from d has the half angle asin(r / d).
    distance = np.linalg.norm(camera.position)
    radius = np.tan(np.arcsin(0.1 / distance)) / camera.pixel
    assert red.sum() == pytest.approx(np.pi * radius**2, rel=0.02)
    rows, columns = np.nonzero(red)
    assert columns.mean() == pytest.approx((SIZE[0] - 1) / 2, abs=0.3)
    assert rows.mean() == pytest.approx((SIZE[1] - 1) / 2, abs=0.3)


@pytest.mark.parametrize("kind", [".gif", ".mp4", ".webm"])
def test_a_film_has_the_pictures_of_its_length(run: Trajectory, tmp_path: Path, kind: str) -> None:
    import imageio_ffmpeg

    done: list[tuple[int, int, str]] = []
    path = run.video(tmp_path / f"a{kind}", size=SIZE, rate=10, curves=["q.elbow", "energy"], speed=2.0,
                     progress=lambda *numbers: done.append(numbers))  # fmt: skip
    assert done == [(k + 1, 6, f"picture {k + 1} of 6") for k in range(6)]
    wide = SIZE[0] + 90
    if kind == ".gif":
        with Image.open(path) as film:
            assert (film.size, film.n_frames, film.info["duration"]) == ((wide, SIZE[1]), 6, 100)
        return
    pictures, seconds = imageio_ffmpeg.count_frames_and_secs(str(path))
    assert (pictures, seconds) == (6, pytest.approx(0.6, abs=0.05))


@pytest.mark.parametrize("rate", [7, 21])
def test_a_gif_plays_as_long_as_the_motion(run: Trajectory, tmp_path: Path, rate: float) -> None:
    """Its pictures last whole hundredths of a second."""
    with Image.open(run.video(tmp_path / "a.gif", size=(64, 64), rate=rate, speed=1.0)) as film:
        seconds = [1e-3 * picture.info["duration"] for picture in ImageSequence.Iterator(film)]
    assert sum(seconds) == pytest.approx(len(seconds) / rate, abs=0.005)


def test_a_picture_of_a_moment_by_the_command(run: Trajectory, tmp_path: Path) -> None:
    saved = run.save(tmp_path / "run.npz")
    moments = [str(tmp_path / f"{k}.png") for k in range(3)]
    for path, at in zip(moments, ("0", "0.5", "0.5"), strict=True):
        assert call("video", str(saved), path, "--size", "160x120", "--at", at).returncode == 0
    first, second, again = (np.asarray(Image.open(path)).astype(int) for path in moments)
    assert np.abs(first - second).max() > 100
    np.testing.assert_array_equal(second, again)
    assert call("video", str(saved), moments[0], "--size", "160x120", "--curves", "q.elbow, energy").returncode == 0
    loaded = Trajectory.load(saved)
    loaded.video(moments[1], size=SIZE, curves=["q.elbow", "energy"])
    loaded.video(moments[2], size=SIZE, curves="energy")
    named, listed, one = (np.asarray(Image.open(path)) for path in moments)
    np.testing.assert_array_equal(named, listed)
    assert one.shape == listed.shape
    one_line(call("video", str(saved), "a.avi"), 2, "is not a format we know")
    one_line(call("video", str(saved), "a.png", "--size", "big"), 2, "expected WIDTHxHEIGHT, got 'big'")
    one_line(call("video", str(saved), "a.png", "--camera", "a b c"), 2, "is not a list of numbers")


@pytest.mark.parametrize(("options", "error", "part"), [
    ({"size": (161, 120)}, ShowError, "size is 161x120, expected even numbers from 64 to 4096"),
    ({"rate": 0.0}, ShowError, "rate is 0.0, expected a number above 0"),
    ({"at": 2.0}, ShowError, "at is 2.0 s, expected a time from 0 to 1 s"),
    ({"direction": [1.0, 2.0]}, ShowError, "expected three numbers"),
    ({"direction": (0, 0, 0)}, ShowError, "expected three numbers that are not all 0"),
    ({"curves": ["q.elbw"]}, SceneError, "did you mean 'q.elbow'"),
    ({"curves": 3}, ShowError, "curves: expected texts, got 3"),
    ({"at": "1"}, ShowError, "at is 1 s, expected a time"),
    ({"rate": "x"}, ShowError, "rate is x, expected a number"),
    ({"direction": "x"}, ShowError, "direction is 'x', expected three numbers"),
    ({"speed": -1.0}, ShowError, "speed is -1.0"),
])  # fmt: skip
def test_refusals_name_the_option(run: Trajectory, tmp_path: Path, options: dict, error: type, part: str) -> None:
    with pytest.raises(error, match=part):
        run.video(tmp_path / "a.png", **options)
    assert not any(tmp_path.iterdir())


@pytest.fixture(scope="module")
def dropped() -> Trajectory:
    """A box of 2 kg on a slider that falls on the ground, and rests there from 0.15 s on."""
    shape = '<geometry><box size="0.2 0.2 0.2"/></geometry>'
    box = link("box", 2.0, more=f"<visual>{shape}</visual><collision>{shape}</collision>")
    robot = tl.load_robot(robot_of(box, joint("z", "prismatic", "ground", "box")))
    effects = [fx.Gravity(), fx.Contact("ground")]
    return tl.simulate(tl.Scene(robot, [0.1 + G * 0.15**2 / 2], effects=effects), 0.4, accuracy=1e-6)


@pytest.mark.slow
def test_a_film_of_a_dropped_box_shows_the_contacts_once_it_touches(dropped: Trajectory, tmp_path: Path) -> None:
    path = dropped.video(tmp_path / "a.gif", size=SIZE, speed=1.0, rate=10, direction=(0, -1, 0))
    with Image.open(path) as film:
        pictures = [np.asarray(frame.convert("RGB")).astype(int) for frame in ImageSequence.Iterator(film)]
    coloured = [int((np.abs(image - CONTACT_COLOUR).max(axis=2) < 60).sum()) for image in pictures]
    assert coloured[:2] == [0, 0]
    assert min(coloured[2:]) > 20


@pytest.mark.parametrize("arrows", [True, False])
def test_the_floor_of_a_film_is_where_bodies_touch_it(
    dropped: Trajectory, run: Trajectory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arrows: bool
) -> None:
    """By the scenes the ground is at z = 0; below an arm, which touches nothing, it is below all that moves."""
    floors = []

    def seen(*arguments: Any, **options: Any) -> Any:
        floors.append(look_at(*arguments, **options))
        return floors[-1]

    monkeypatch.setattr("twolink.show.video.look_at", seen)
    on_slider = tl.load_robot(robot_of(BALL, joint("z", "prismatic", "ground", "base")))
    plane = fx.PlaneContact("base", radius=0.1, restitution=0.5)
    bouncing = tl.simulate(tl.Scene(on_slider, [0.2], effects=[fx.Gravity(), plane]), 0.3, accuracy=1e-6)
    for motion in (dropped, bouncing, run):
        motion.video(tmp_path / "a.png", size=(64, 64), contacts=arrows)
    assert [view.floor for view in floors[:2]] == pytest.approx([0.0, 0.0], abs=0.004)  # half of a sample's way
    assert floors[2].floor < (floors[2].centre + floors[2].seen @ picture_axes(floors[2].direction))[:, 2].min() - 0.01


def test_an_arrow_goes_from_its_point_along_its_force(camera: Camera) -> None:
    """The strongest force is 0.22 of the motion's extent long, half of it half as long; NaN is no force."""
    white = np.full((SIZE[1], SIZE[0], 3), 255, np.uint8)
    points = np.array([[[0.05, 0.0, -0.08]] * 2, [[np.nan] * 3, [-0.06, 0.02, -0.08]]])
    forces = np.array([[[0.0, 0.0, 8.0]] * 2, [[np.nan] * 3, [0.0, 0.0, 4.0]]])
    times, shown = np.array([0.0, 1.0]), np.array([0.0, 0.9, 1.0])
    arrows = Arrows(camera, times, shown, {}, {"wind on ball": (points, forces)})
    extent = 2.0 * np.abs(camera.view.seen[:, :2]).max()
    pictures = [arrows.over(white, k) for k in range(3)]
    np.testing.assert_array_equal(pictures[0], pictures[1])  # the forces of the last sample before
    for picture, start, length in ((pictures[0], points[0, 1], 0.22), (pictures[2], points[1, 1], 0.11)):
        rows, columns = np.nonzero((picture < 200).any(axis=2))
        (x, low), (_, high) = camera.place(np.array([start, start + np.array([0.0, 0.0, length * extent])]))
        assert (rows.min(), rows.max()) == (pytest.approx(high, abs=2.0), pytest.approx(low, abs=3.0))
        assert (columns.min(), columns.max()) == (pytest.approx(x, abs=3.0), pytest.approx(x, abs=3.0))
        assert np.abs(picture.reshape(-1, 3).astype(int) - FORCE_COLOUR).max(axis=1).min() < 50


def test_a_blow_does_not_hide_the_weight(camera: Camera) -> None:
    """Of 100 samples with a weight of 5 N after a blow of 500 N, the weight's arrow is half as long as the blow's."""
    white, times = np.full((SIZE[1], SIZE[0], 3), 255, np.uint8), np.arange(100.0)
    points, forces = np.zeros((100, 1, 3)), np.tile([0.0, 0.0, 5.0], (100, 1, 1))
    forces[0] *= 100.0
    arrows = Arrows(camera, times, times, {"ball - ground": (points, forces)}, {})
    heights = [np.ptp(np.nonzero((arrows.over(white, k) < 200).any(axis=2))[0]) for k in (0, 50)]
    base = DOT * SIZE[1]
    assert (heights[1] - base) / (heights[0] - base) == pytest.approx(0.5, abs=0.06)


def test_points_are_placed_where_the_rays_of_their_pixels_go(camera: Camera) -> None:
    pixels = np.array([[0.0, 0.0], [20.0, 99.0], [140.5, 3.25]])
    points = camera.position + np.array([[0.2], [1.0], [7.0]]) * camera.rays(pixels)
    np.testing.assert_allclose(camera.place(points), pixels, atol=1e-9)


def test_what_has_no_surface_is_refused(tmp_path: Path) -> None:
    bare = tl.load_robot(f'<robot name="bare">{link("base")}</robot>', root="free")
    run = tl.simulate(tl.Scene(bare), 0.1, verify=False)
    with pytest.raises(ShowError, match="the robot has nothing to draw"):
        run.video(tmp_path / "a.png")
