"""Trajectories: saving keeps every digit, loading is strict, figures are drawn."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.near import assert_near
from tests.refusals import refusal
from tests.show.test_playback import film
from twolink.errors import SceneError, ShowError, TwolinkError
from twolink.integrate.solution import Event

HEADER = b"t,q.shoulder,q.elbow,v.shoulder,v.elbow,energy"


@pytest.fixture(scope="module")
def run() -> tl.Trajectory:
    return tl.simulate(tl.load_scene("arm-swing"), 0.5, accuracy=1e-8)


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".npz"])
def test_saved_and_loaded_is_the_same(run: tl.Trajectory, suffix: str, tmp_path: Path) -> None:
    path = run.save(tmp_path / "deep" / f"x{suffix}")
    again = tl.Trajectory.load(path, run.robot if suffix == ".csv" else None)
    for name in ("t", "q", "v", "energy", "error"):
        assert np.array_equal(getattr(again, name), getattr(run, name)), name
    assert again.robot.name == "two_link"
    assert again.title == run.title or suffix == ".csv"
    assert [p.name for p in path.parent.iterdir()] == [path.name]


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".npz"])
def test_events_and_contacts_are_saved_but_in_csv(suffix: str, tmp_path: Path) -> None:
    points = np.array([[[0.5, 0.0, 1.0], [0.25, 0.0, 0.0]], [[np.nan] * 3, [0.1, 0.2, 0.3]]])
    contacts = {"tip - ../wall": (points, 2.0 * points), "tip - a.b": (points[:, :1], -points[:, :1])}
    events = (Event(0.5, "impact", "tip", "with the wall", 0.25), Event(np.float64(0.75), "leave", "tip"))
    run = tl.Trajectory(tl.load_robot("two_link"), np.array([0.0, 1.0]), np.zeros((2, 2)), np.zeros((2, 2)), None, None,
                        events, recorded_contacts=contacts)  # fmt: skip
    again = tl.Trajectory.load(run.save(tmp_path / f"x{suffix}"), run.robot)
    if suffix == ".csv":
        assert (again.events, again.contacts, again.accuracy) == ((), {}, None)
        with pytest.raises(SceneError, match="simulate it again"):
            _ = again.contact_forces
        return
    assert again.events == events
    assert list(again.contacts) == list(contacts)
    for pair, both in contacts.items():
        np.testing.assert_array_equal(again.contacts[pair], both)
        np.testing.assert_array_equal(again.contact_forces[pair], run.contact_forces[pair])


@pytest.mark.parametrize(
    ("column", "events", "part"),
    [
        (np.zeros((101, 5)), "[]", "'contact a - b' is not a table of forces"),
        (np.zeros((100, 6)), "[]", "'contact a - b' is not a table of forces"),
        (np.zeros((101, 6)), '[{"t": 1}]', "its note of events is damaged"),
    ],
)
def test_contacts_and_events_that_do_not_fit(
    run: tl.Trajectory, column: np.ndarray, events: str, part: str, tmp_path: Path
) -> None:
    notes = {"note:events": np.array(events), "note:robot": np.array("two_link")}
    np.savez(tmp_path / "x.npz", **run.columns(), **notes, **{"contact a - b": column})
    with pytest.raises(SceneError, match=part):
        tl.Trajectory.load(tmp_path / "x.npz", run.robot)


@pytest.mark.parametrize("ending", [".parquet", ".npz", ".mat", ".mcap", ".db3"])
def test_the_accuracy_asked_for_is_kept(run: tl.Trajectory, ending: str, tmp_path: Path) -> None:
    again = tl.Trajectory.load(run.save(tmp_path / f"x{ending}"))
    assert again.accuracy == run.accuracy == 1e-8
    assert again.trusted_until == run.trusted_until
    without = tl.Trajectory.load(replace(run, accuracy=None).save(tmp_path / f"without{ending}"))
    assert (without.accuracy, without.trusted_until) == (None, None)


@pytest.mark.parametrize("name", ["at", "acceleration", "sensors", "contact_forces"])
def test_a_loaded_run_names_what_it_has_not(run: tl.Trajectory, name: str, tmp_path: Path) -> None:
    again = tl.Trajectory.load(run.save(tmp_path / "x.csv"), run.robot)
    with refusal(
        SceneError, code="no-equations", match=rf"Trajectory\.{name}: a loaded trajectory has no equations"
    ) as caught:
        getattr(again, name)(0.005)  # a property raises before it would be called
    assert "simulate it again with its scene" in caught.value.remedy


def test_columns_are_named_by_joint() -> None:
    assert list(tl.simulate(tl.load_scene("arm-swing"), 0.01).columns()) == [
        "t", "q.shoulder", "q.elbow", "v.shoulder", "v.elbow", "tau.shoulder", "tau.elbow", "energy", "error"
    ]  # fmt: skip
    scene = tl.Scene(tl.load_robot("kinova"))
    assert "q.j2s6s200_joint_1.1" in tl.simulate(scene, 0.01, verify=False).columns()


@pytest.mark.parametrize("ending", [".csv", ".npz", ".mat"])
def test_saved_torques_are_those_that_rnea_wants(tmp_path: Path, ending: str) -> None:
    run = tl.simulate(tl.load_scene("pendulum-friction"), 0.5, verify=False)
    loaded = tl.Trajectory.load(run.save(tmp_path / f"x{ending}"), run.robot)
    wanted = run.robot.inverse_dynamics(run.q, run.v, run.acceleration)
    assert np.abs(wanted).max() > 1e-3
    assert_near(loaded.tau, wanted, 1e-9)


def test_not_verified_has_no_error_column(tmp_path: Path) -> None:
    run = tl.simulate(tl.load_scene("arm-swing"), 0.1, verify=False)
    assert "error" not in run.columns()
    assert tl.Trajectory.load(run.save(tmp_path / "x.npz")).error is None


def test_other_programs_read_them(run: tl.Trajectory, tmp_path: Path) -> None:
    import pyarrow.parquet

    table = pyarrow.parquet.read_table(run.save(tmp_path / "x.parquet"))
    assert np.array_equal(table["q.elbow"].to_numpy(), run.q[:, 1])
    csv = np.genfromtxt(run.save(tmp_path / "x.csv"), delimiter=",", names=True, deletechars="")
    assert np.array_equal(csv["q.elbow"], run.q[:, 1])


@pytest.mark.parametrize(
    ("name", "content", "part"),
    [
        ("x.csv", b"", "expected a header"),
        ("x.csv", b"t,q.shoulder\n0,0\n", "column 'q.elbow'"),
        ("x.csv", HEADER + b",z\n0,0,0,0,0,0,0\n", "column 'z' is unknown"),
        ("x.csv", HEADER + b"\n0,0,0,0,0,0\n0,0,0,0,0,0\n", "t does not increase at sample 1"),
        ("x.csv", HEADER + b"\n1,0,0,0,0,0\n0,0,0,0,0,0\n", "t does not increase at sample 1"),
        ("x.csv", HEADER + b"\n0,0,inf,0,0,0\n", "not finite"),
        ("x.csv", HEADER + b"\n", "no samples"),
        ("x.csv", b"t,q.shoulder\n0,zero\n", "zero"),
        ("x.npz", b"not a zip", "cannot be read"),
        ("x.parquet", b"not parquet", "cannot be read"),
        ("x.txt", b"", "not a format we know"),
    ],
)
def test_files_that_are_none(run: tl.Trajectory, name: str, content: bytes, part: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(TwolinkError, match=part):
        tl.Trajectory.load(tmp_path / name, run.robot)
    with pytest.raises(TwolinkError, match=r"No such file|not a format"):
        tl.Trajectory.load(tmp_path / f"none-{name}", run.robot)


def test_what_is_no_path_and_no_robot_is_refused(run: tl.Trajectory, tmp_path: Path) -> None:
    with pytest.raises(TwolinkError, match="expected the path of a file, got 3"):
        tl.Trajectory.load(3)
    with pytest.raises(SceneError, match="robot: expected a Robot, got str"):
        tl.Trajectory.load(run.save(tmp_path / "x.csv"), "two_link")


@pytest.mark.parametrize(
    ("name", "values", "part"),
    [
        ("error", np.zeros(3), "column 'error' has 3 samples, t has 101"),
        ("q.elbow", np.zeros(1), "column 'q.elbow' has 1 samples, t has 101"),
        ("q.elbow", np.zeros((101, 1)), "column 'q.elbow' is not a row of numbers"),
        ("q.elbow", np.array(["a"] * 101), "column 'q.elbow' is not a row of numbers"),
        ("q.elbow", np.zeros(101, complex), "column 'q.elbow' is not a row of numbers"),
        ("error", np.full(101, np.nan), "not finite"),
    ],
)
def test_columns_that_do_not_fit(run: tl.Trajectory, name: str, values: np.ndarray, part: str, tmp_path: Path) -> None:
    np.savez(tmp_path / "x.npz", **{**run.columns(), name: values})
    with pytest.raises(SceneError, match=part):
        tl.Trajectory.load(tmp_path / "x.npz", run.robot)


def test_columns_of_one_name_are_refused() -> None:
    text = run_of_names("a", "a.0", kinds=("floating", "revolute"))
    run = tl.simulate(tl.Scene(tl.load_robot(text)), 0.01, verify=False)
    with pytest.raises(SceneError, match=r"joint 'a\.0': two columns are named 'q\.a\.0'"):
        run.save("never.csv")


def run_of_names(first: str, second: str, kinds: tuple[str, str] = ("revolute", "revolute"), name: str = "x") -> str:
    """A URDF with two joints of these names."""
    body = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    joint = (
        '<joint name="{}" type="{}"><parent link="{}"/><child link="{}"/><axis xyz="0 1 0"/>'
        '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
    )
    links = f'<link name="w"/><link name="b">{body}</link><link name="c">{body}</link>'
    joints = joint.format(first, kinds[0], "w", "b") + joint.format(second, kinds[1], "b", "c")
    return f'<robot name="{name}">{links}{joints}</robot>'


def test_names_are_quoted_in_csv(tmp_path: Path) -> None:
    robot = tl.load_robot(run_of_names("a,b", "c&quot;d"))
    run = tl.simulate(tl.Scene(robot, v=[1, 2]), 0.05, verify=False)
    again = tl.Trajectory.load(run.save(tmp_path / "x.csv"), robot)
    assert np.array_equal(again.q, run.q)


@pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
def test_names_are_drawn_to_the_letter(suffix: str, tmp_path: Path) -> None:
    robot = tl.load_robot(run_of_names(r"$\frac{$", "_x", name="$$_$"))
    tl.simulate(tl.Scene(robot, v=[1, 2]), 0.05, verify=False).plot(tmp_path / f"x{suffix}")


def test_pickles_are_not_opened(run: tl.Trajectory, tmp_path: Path) -> None:
    np.savez(tmp_path / "x.npz", t=np.array([object()], dtype=object))
    with pytest.raises(TwolinkError, match="cannot be read"):
        tl.Trajectory.load(tmp_path / "x.npz", run.robot)


def test_places_that_cannot_be_written(run: tl.Trajectory, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(TwolinkError, match="cannot be written"):
        run.save(tmp_path / "file" / "x.csv")
    with pytest.raises(ShowError, match="cannot be written"):
        run.plot(tmp_path / "file" / "x.png")


@pytest.mark.some(1)
@pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
def test_plots(run: tl.Trajectory, suffix: str, tmp_path: Path) -> None:
    path = run.plot(tmp_path / f"x{suffix}")
    start = {".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF"}[suffix]
    assert path.read_bytes().startswith(start)
    assert path.stat().st_size > 10_000


def test_playback_is_written(run: tl.Trajectory, tmp_path: Path) -> None:
    page = run.playback(tmp_path / "x.html").read_text()
    assert "two-link arm" in page  # the title of its scene
    assert "http://" not in page.split("<script")[0]


def test_a_short_motion_is_played_slowly(run: tl.Trajectory, tmp_path: Path) -> None:
    short = tl.Trajectory(run.robot, run.t / 16, run.q, run.v, None, None)  # 31 ms
    assert film(short.playback(tmp_path / "short.html"))["speed"] == 0.01
    assert film(run.playback(tmp_path / "run.html", speed=1.0))["speed"] == 1.0


def test_a_playback_takes_events_trails_and_a_second_run(run: tl.Trajectory, tmp_path: Path) -> None:
    other = tl.Trajectory(run.robot, run.t, -run.q, run.v, None, None, title="mirrored")
    shown = film(run.playback(tmp_path / "x.html", trails=["forearm"], beside=other))
    assert shown["trails"] == ["forearm"]
    assert (shown["ghost"]["title"], shown["ghost"]["visuals"]) == ("mirrored", None)
    assert len(shown["ghost"]["motion"]["t"]) == len(shown["motion"]["t"])
    assert film(run.playback(tmp_path / "x.html"))["trails"] is None
    assert film(run.playback(tmp_path / "x.html", trails="forearm"))["trails"] == ["forearm"]
    with pytest.raises(ShowError, match="beside: expected a Trajectory, got Robot"):
        run.playback(tmp_path / "x.html", beside=run.robot)
    with pytest.raises(ShowError, match="no moving link 'elbow'"):
        run.playback(tmp_path / "x.html", trails=["elbow"])


def test_a_page_and_a_film_are_saved_by_their_endings(tmp_path: Path) -> None:
    run = tl.simulate(tl.load_scene("arm-swing"), 0.1)
    assert run.save(tmp_path / "a.html").read_text() == run.playback(tmp_path / "b.html").read_text()
    assert run.save(tmp_path / "a.gif").read_bytes().startswith(b"GIF89a")
    with pytest.raises(tl.errors.TwolinkError, match=r"known: \.csv, .*\.html, \.mp4, \.webm, \.gif"):
        run.save(tmp_path / "a.avi")


@pytest.mark.parametrize("name", ["x.gif", "x.mp4", "x.htm", "x"])
def test_a_playback_is_a_page_and_nothing_else(run: tl.Trajectory, name: str, tmp_path: Path) -> None:
    with refusal(ShowError, code="unknown-format", match="is not a format we know"):
        run.playback(tmp_path / name)
    assert not (tmp_path / name).exists()


def test_unknown_picture_format(run: tl.Trajectory, tmp_path: Path) -> None:
    with pytest.raises(ShowError, match=r"known: \.png, \.svg, \.pdf"):
        run.plot(tmp_path / "x.pngg")


def test_forces_on_links_act_where_and_when_effects_say(tmp_path: Path) -> None:
    robot = tl.load_robot("two_link")
    wrench = tl.effects.FrameWrench("forearm", force=(3.0, 0.0, -4.0), point=(0.0, 0.0, 0.1))
    spring = tl.effects.SpringBetween("forearm", "universe", stiffness=20.0, second_point=(1.0, 0.0, 1.0))
    effects = [wrench, tl.effects.Release(spring, at=0.25), tl.effects.Gravity()]
    run = tl.simulate(tl.Scene(robot, q=[0.3, 0.4], effects=effects, duration=0.5), samples_per_second=40)
    found = run.forces_on_links
    loaded = tl.Trajectory.load(run.save(tmp_path / "a.npz"), robot).forces_on_links
    assert all(np.array_equal(loaded[name], both, equal_nan=True) for name, both in found.items())
    assert list(found) == ["frame-wrench on forearm", "spring-between on forearm"]
    turn, place = robot.frame_pose(run.q, "forearm")
    points, forces = found["frame-wrench on forearm"]
    assert_near(points[:, 0], place + turn @ [0.0, 0.0, 0.1], 1e-12)
    np.testing.assert_allclose(forces[:, 0], np.tile([3.0, 0.0, -4.0], (len(run.t), 1)))
    points, forces = found["spring-between on forearm"]
    held = run.t < 0.25
    assert_near(forces[held, 0], 20.0 * (np.array([1.0, 0.0, 1.0]) - place[held]), 1e-10)
    assert np.isnan(forces[~held]).all()
    assert np.isnan(points[~held]).all()
