"""The figures of a trajectory and of its sensitivities: what is drawn where, in which colour, under which name."""

import itertools
from pathlib import Path
from typing import Any

import matplotlib.style
import matplotlib.text
import numpy as np
import pytest

import twolink as tl
from tests.simulation.test_trajectory import run_of_names
from tests.urdf_text import joint as joint_of
from tests.urdf_text import link, robot_of
from twolink.errors import SceneError, ShowError
from twolink.show.figure import COLOURS
from twolink.show.motion_plots import tube


def names_beside(axis: Any) -> list[str]:
    return [text.get_text() for text in axis.texts]


def curves(axis: Any) -> dict[str, Any]:
    return {line.get_label(): line for line in axis.get_lines() if not line.get_label().startswith("_")}


def panels(figure: Any) -> dict[str, Any]:
    return {axis.get_ylabel().split("\n")[0]: axis for axis in figure.axes}


def test_every_name_stands_beside_its_curve() -> None:
    figure = tl.simulate(tl.Scene(tl.load_robot(run_of_names("_x", "$y$"))), 0.05).plot()
    assert names_beside(figure.axes[0]) == [" _x", r"\$y\$"]


def test_of_curves_that_cover_each_other_the_names_do_not_and_one_is_dashed() -> None:
    figure = tl.simulate(tl.Scene(tl.load_robot(run_of_names("a", "b"))), 0.05).plot()  # both at rest at 0
    first, second = (text.get_window_extent() for text in figure.axes[0].texts)
    assert first.y0 >= second.y1 or second.y0 >= first.y1
    assert [line.is_dashed() for line in curves(figure.axes[0]).values()] == [False, True]


def test_the_samples_are_drawn_in_a_colour_a_joint() -> None:
    run = tl.simulate(tl.load_scene("arm-swing"), 3)
    figure = run.plot()
    angle, speed = map(curves, figure.axes[:2])
    assert list(angle) == list(speed) == names_beside(figure.axes[0]) == ["shoulder", "elbow"]
    assert np.array_equal(angle["elbow"].get_ydata(), run.q[:, 1])
    assert np.array_equal(speed["elbow"].get_ydata(), run.v[:, 1])
    assert len({angle[name].get_color() for name in angle}) == 2
    assert all(angle[name].get_color() == speed[name].get_color() for name in angle)
    assert run.title in figure.get_suptitle()
    assert figure._repr_png_().startswith(b"\x89PNG")


def test_few_samples_are_drawn_as_the_solution_between_them() -> None:
    run = tl.simulate(tl.load_scene("arm-swing"), 3, samples_per_second=2)
    figure = run.plot()
    line, energy = curves(figure.axes[0])["elbow"], figure.axes[-2].lines[0]
    assert len(run.t) == 7
    assert len(line.get_xdata()) >= 400
    q, v = run.at(line.get_xdata())
    np.testing.assert_allclose(line.get_ydata(), q[:, 1], atol=1e-12)
    above = np.sum(run.robot.energy(q, v), axis=0) - run.energy[0]
    np.testing.assert_allclose(energy.get_ydata(), above, atol=1e-9)


@pytest.fixture(scope="module")
def talos() -> tl.Robot:
    return tl.load_robot("talos", root="free")


def moved(robot: tl.Robot, q: np.ndarray) -> Any:
    t = np.linspace(0, 1, len(q))
    return tl.Trajectory(robot, t, q, np.zeros((len(q), robot.nv)), None, None).plot()


def test_of_many_joints_those_are_drawn_that_move_the_most(talos: tl.Robot) -> None:
    q = np.tile(talos.neutral, (30, 1))
    q[:, 7:19] = np.linspace(0, 1, 30)[:, None] * np.arange(12, 0, -1)  # the first joint moves the most
    figure = moved(talos, q)
    assert list(panels(figure)) == ["angle", "energy change", "error bar"]  # its velocities are all 0
    assert list(curves(figure.axes[0])) == list(talos.joint_names[1:11])
    assert len({line.get_color() for line in curves(figure.axes[0]).values()}) == 10
    assert f"the 10 of {len(talos.joints)} joints that move the most" in figure.get_suptitle()


def test_angles_positions_and_quaternions_are_apart(talos: tl.Robot) -> None:
    q = np.tile(talos.neutral, (30, 1))
    angle = np.linspace(0, 1, 30)
    q[:, 0], q[:, 3], q[:, 6], q[:, 7] = 5 * angle, np.sin(angle / 2), np.cos(angle / 2), angle
    drawn = panels(moved(talos, q))
    assert list(curves(drawn["orientation"])) == [f"root_joint {x}" for x in "xyzw"]
    assert list(curves(drawn["position"])) == [f"root_joint {x}" for x in "xyz"]
    assert talos.joint_names[1] in curves(drawn["angle"])
    assert "root_joint" not in "".join(curves(drawn["angle"]))


def test_the_angle_of_a_continuous_joint_is_counted_on() -> None:
    robot = tl.load_robot(run_of_names("a", "b", ("continuous", "revolute")))
    run = tl.simulate(tl.Scene(robot, v=[9.0, 0.0]), 2, verify=False)
    angle = curves(run.plot().axes[0])["a"].get_ydata()
    assert angle[-1] > 10
    np.testing.assert_allclose(np.cos(angle), run.q[:, 0], atol=1e-9)


def test_events_are_lines_in_every_panel_and_named_where_there_is_room() -> None:
    run = tl.simulate(tl.load_scene("bouncing-ball"), 1.5)
    figure = run.plot()
    times = [event.t for event in run.events]
    for axis in figure.axes:
        marked = [line.get_xdata()[0] for line in axis.get_lines() if line.get_label() == "_event"]
        assert marked == times[:60]
    names = [text for text in figure.axes[0].texts if text.get_text() == "impact"]
    figure.draw_without_rendering()
    places = [text.get_window_extent() for text in names]
    assert 2 <= len(names) <= len(times)
    assert all(a.x0 < b.x0 for a, b in itertools.pairwise(places))
    assert "error of q: at most" in figure.get_suptitle()


def test_worlds_without_a_coordinate_to_draw_show_their_error_bars() -> None:
    """A body on a ball joint has a quaternion alone."""
    text = robot_of(link("body", 1.0, 0.1), joint_of("ball", "spherical", "ground", "body"))
    scene = tl.Scene(tl.load_robot(text), v=[1.0, 2.0, 3.0])
    for verify, rows in ((True, ["error bar\n(rad or m)"]), (False, [""])):
        worlds = tl.simulate_many(scene, 0.05, v=[scene.v, 2.0 * scene.v], samples_per_second=100, verify=verify)
        assert [axis.get_ylabel() for axis in worlds.plot().axes] == rows


def test_events_before_the_first_sample_are_not_marked() -> None:
    run = tl.simulate(tl.load_scene("bouncing-ball"), t_eval=np.linspace(0.6, 1.0, 50))
    figure = run.plot()
    within = [event.t for event in run.events if 0.6 <= event.t <= 1.0]
    marked = [line.get_xdata()[0] for line in figure.axes[0].get_lines() if line.get_label() == "_event"]
    assert 0 < len(within) < len(run.events)
    assert marked == within
    figure.draw_without_rendering()
    left = figure.axes[0].get_window_extent().x0
    assert all(text.get_window_extent().x0 >= left for text in figure.axes[0].texts if text.get_text() == "impact")


def test_a_joint_whose_name_is_a_pattern_of_another_ones_is_drawn() -> None:
    run = tl.simulate(tl.Scene(tl.load_robot(run_of_names("j1", "j[1]")), v=[1.0, 2.0]), 0.05)
    for joints, drawn in (("j[1]", ["j[1]"]), ("j1", ["j1"]), ("j*", ["j1", "j[1]"]), ((), ["j1", "j[1]"])):
        assert list(curves(run.plot(joints=joints).axes[0])) == drawn
    with pytest.raises(ShowError, match="joints: expected texts, got 3"):
        run.plot(joints=3)


def test_what_stays_has_no_panel_and_the_title_says_so() -> None:
    figure = tl.simulate(tl.load_scene("heavy-top"), 0.05).plot()  # its tip is the point that is fixed
    assert list(panels(figure)) == ["orientation", "angular velocity", "energy change", "error bar"]
    assert "constant, and left out: position, velocity" in figure.get_suptitle()
    assert "position" in panels(tl.simulate(tl.load_scene("box-stack"), 0.01).plot())  # where all stays, all is shown


def test_the_error_axis_spans_a_decade() -> None:
    low, high = tl.simulate(tl.load_scene("arm-swing"), 0.2).plot().axes[-1].get_ylim()
    assert high > 8.0 * low


def texts_that_overlap(figure: Any) -> list[tuple[str, str]]:
    """Pairs of texts, of those that are drawn, whose boxes share more than a pixel."""
    figure.draw_without_rendering()
    unseen = {text for axis in figure.axes for side in (axis.xaxis, axis.yaxis)
              for text in side.get_ticklabels(which="both") if not drawn_tick(axis, side, text)}  # fmt: skip
    shown = [t for t in figure.findobj(matplotlib.text.Text) if t.get_visible() and t.get_text() and t not in unseen]
    boxes = [(text.get_text(), text.get_window_extent()) for text in shown]
    return [(a, b) for (a, box), (b, other) in itertools.combinations(boxes, 2)
            if min(box.x1, other.x1) - max(box.x0, other.x0) > 1.0
            and min(box.y1, other.y1) - max(box.y0, other.y0) > 1.0]  # fmt: skip


def drawn_tick(axis: Any, side: Any, text: Any) -> bool:
    """Whether a tick's name is of a tick within the axis."""
    low, high = sorted(side.get_view_interval())
    place = text.get_position()[0 if side is axis.xaxis else 1]
    return bool(low <= place <= high)


@pytest.mark.some(1)
@pytest.mark.parametrize("name", [row["name"] for row in tl.scenes().to_records()])
def test_no_text_covers_another_one_in_the_figures_of_the_bundled_scenes(name: str) -> None:
    scene = tl.load_scene(name)
    run = tl.simulate(scene, min(scene.duration, 1.0), accuracy=1e-3, verify=False)
    for joints in ((), scene.robot.joint_names[-1]):
        assert texts_that_overlap(run.plot(joints=joints)) == []


def test_texts_that_overlap_are_found() -> None:
    figure = tl.simulate(tl.load_scene("arm-swing"), 0.2, verify=False).plot()
    figure.axes[0].text(*figure.axes[0].texts[0].get_position(), "over it", transform=figure.axes[0].transAxes)
    assert ("shoulder", "over it") in texts_that_overlap(figure)


@pytest.mark.slow
def test_a_limb_is_drawn_by_a_pattern_and_the_base_where_it_moves(talos: tl.Robot) -> None:
    q = np.tile(talos.neutral, (30, 1))
    q[:, 7:] = np.linspace(0, 1, 30)[:, None]
    q[:, 2] = np.linspace(0, 1e-3, 30)  # less than all others, but it is the base
    run = tl.Trajectory(talos, np.linspace(0, 1, 30), q, np.zeros((30, talos.nv)), None, None)
    assert "root_joint z" in curves(panels(run.plot())["position"])
    limb = [name for name in talos.joint_names if name.startswith("leg_left_")]
    assert list(curves(run.plot(joints="leg_left_*").axes[0])) == limb
    with pytest.raises(ShowError, match=r"'leg_leftt_1_joint'.*leg_left_1_joint"):
        run.plot(joints=["leg_leftt_1_joint"])


@pytest.mark.slow
def test_the_style_is_for_all_and_the_caption_says_what_was_asked(tmp_path: Path) -> None:
    run = tl.simulate(tl.load_scene("arm-swing"), 0.2, accuracy=1e-5)
    assert b"/Type0" in run.plot(tmp_path / "run.pdf").read_bytes()  # TrueType letters, not bitmaps of them
    assert "asked for 1e-05" in run.plot().get_suptitle()
    with matplotlib.style.context("twolink.show.twolink"):
        cycle = matplotlib.rcParams["axes.prop_cycle"].by_key()["color"]
    assert cycle == list(COLOURS)


@pytest.fixture(scope="module")
def found() -> tl.Sensitivities:
    return tl.sensitivities(tl.load_scene("arm-swing"), wrt=["forearm.mass", "q"], duration=1.0)


def test_the_tube_is_where_other_parameters_bring_the_motion(found: tl.Sensitivities) -> None:
    """One percent of the forearm's mass, against the motions of arms that have it."""
    figure = found.plot(name="forearm.mass")
    angle, *_, moves = figure.axes
    sides = [band.get_paths()[0].vertices for band in angle.collections]
    mass = found.values["forearm.mass"]
    worlds = tl.simulate_many(tl.load_scene("arm-swing"), parameters={"forearm.mass": [0.99 * mass, 1.01 * mass]},
                              duration=1.0, accuracy=1e-9, verify=False)  # fmt: skip
    assert len(sides) == 2
    for joint, side in enumerate(sides):
        ends = side[side[:, 0] == 1.0, 1]
        wide = ends.max() - ends.min()
        assert wide == pytest.approx(abs(np.ptp(worlds.q[:, joint])), rel=0.02)
        assert wide > 1e-4
    assert "forearm.mass ± 1 %" in figure.get_suptitle()
    lines = {line.get_label(): line for line in moves.get_lines() if not line.get_label().startswith("_")}
    assert set(lines) == {"forearm.mass", "q"}
    largest = 0.01 * mass * np.abs(found.q["forearm.mass"][-1]).max()
    assert lines["forearm.mass"].get_ydata()[-1] == pytest.approx(largest)


@pytest.mark.slow
def test_by_default_it_is_of_what_moves_the_motion_most(found: tl.Sensitivities, tmp_path: Path) -> None:
    moves = {name: np.abs(found.q[name]).sum(axis=2).max() for name in found.q}
    moves["forearm.mass"] *= found.values["forearm.mass"]
    most = max(moves, key=lambda name: moves[name])
    assert f"{most} ± " in found.plot(change=0.05).get_suptitle()
    assert b"<svg" in found.plot(tmp_path / "tube.svg", name="q", change=0.02).read_bytes()
    with pytest.raises(SceneError, match="forearm") as caught:
        found.plot(name="forearm.mas")
    assert caught.value.code == "unknown-sensitivity"


def test_free_bodies_have_tubes_in_each_panel() -> None:
    """A small turn about an axis moves one entry of the quaternion by half of it, and nothing else."""
    robot = tl.load_robot("spinning_box", root="free")
    turn = np.zeros((2, 6, 1))
    turn[1, 5, 0] = -0.02  # rad about z
    widths = tube(robot, np.tile(robot.neutral, (2, 1)), np.zeros((2, 6)), turn, turn)
    entries = ["x", "y", "z", "qx", "qy", "qz", "qw", "vx", "vy", "vz", "wx", "wy", "wz"]
    moved = {name: width[1] for name, width in zip(entries, widths, strict=True) if width.any()}
    assert moved == pytest.approx({"qz": 0.01, "wz": 0.02}, rel=1e-6)
    assert not np.any([width[0] for width in widths])
