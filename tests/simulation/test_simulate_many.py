"""simulate_many: worlds agree with single runs, keep their accuracy, and say which do not."""

from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from scripts.studies.scenes.exact import case
from tests.near import assert_near, assert_within
from twolink.errors import AccuracyError, QueryError, SceneError
from twolink.hard.truths import extended_reference
from twolink.integrate.motion.scene_equations import equations_of
from twolink.integrate.steps.methods import METHODS
from twolink.integrate.steps.step_map import step_map
from twolink.lagrange import two_link
from twolink.simulation.world_solving import _Tried, _Worlds

RNG = np.random.default_rng(5)


def starts(count: int) -> np.ndarray:
    return RNG.uniform(-0.5, 0.5, (count, 2))


def test_worlds_agree_with_single_runs_within_their_bars() -> None:
    scene = tl.load_scene("arm-swing")
    q = starts(20)
    worlds = tl.simulate_many(scene, q=q, duration=3.0, accuracy=1e-7)
    assert worlds.within_accuracy.all()
    for i, start in enumerate(q):
        alone = tl.simulate(tl.Scene(tl.load_robot("two_link"), start, effects=scene.effects), 3.0, accuracy=1e-11)
        assert np.abs(worlds.q[i] - alone.q[-1]).max() <= worlds.error[i] <= 1e-7


def test_a_worlds_bits_do_not_depend_on_the_others_nor_on_their_number() -> None:
    scene, q = tl.load_scene("arm-swing"), np.random.default_rng(4).uniform(-1, 1, (100, 2))
    whole = tl.simulate_many(scene, q=q, duration=2.0, verify=False)
    for part in (slice(3, 12), slice(17, 40), *map(slice, (1, 8, 17, 40, 64))):
        few = tl.simulate_many(scene, q=q[part], duration=2.0, verify=False)
        assert np.array_equal(few.q, whole.q[part])
        assert np.array_equal(few.v, whole.v[part])


@pytest.mark.parametrize("accuracy", [1e-3, 1e-6])
def test_worlds_that_are_solved_again_do_not_depend_on_the_others(accuracy: float) -> None:
    scene, q = tl.load_scene("arm-swing"), np.random.default_rng(6).uniform(-2, 2, (40, 2))
    whole = tl.simulate_many(scene, q=q, accuracy=accuracy)
    once = tl.simulate_many(scene, q=q, accuracy=accuracy, verify=False)
    assert (whole.q != once.q).any(axis=1).sum() > 10  # solved again
    for part in (slice(0, 1), slice(3, 12), slice(17, 40)):
        few = tl.simulate_many(scene, q=q[part], accuracy=accuracy)
        assert np.array_equal(few.q, whole.q[part])
        assert np.array_equal(few.error, whole.error[part])


@pytest.mark.slow
@pytest.mark.parametrize("number", [98, 178, 748, 788])
def test_bars_of_worlds_that_are_solved_again_in_few_steps(number: int) -> None:
    """Where steps are as long as they may be, a finer solution has shorter ones, too: 0.9 of the bars without."""
    one = case(number, 20261129)
    worlds = tl.simulate_many(one.scene, q=one.q, v=one.v, duration=one.duration, accuracy=one.accuracy)
    ends = np.array([0.0, one.duration])
    for i, (q, v) in enumerate(zip(one.q, one.v, strict=True)):
        exact = extended_reference(tl.Scene(one.scene.base, q, v, effects=one.scene.effects), ends)[0][-1]
        assert_near(worlds.robot.difference(worlds.q[i], exact.astype(float)), 0.0, 0.5 * worlds.error[i])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["two_link", "ur5"])
def test_bars_of_many_worlds_hold_at_many_accuracies(name: str) -> None:
    robot = tl.load_robot(name)
    scene = tl.Scene(robot, effects=[tl.effects.Gravity()], duration=10.0 if name == "two_link" else 1.0)
    q = robot.random_state(300, seed=3)[0] * (2.0 / np.pi if name == "two_link" else 1.0)
    truth, judged = tl.simulate_many(scene, q=q, accuracy=1e-11), 0
    for accuracy in (1e-3, 1e-4, 1e-6, 1e-8, 1e-9):
        worlds, known = tl.simulate_many(scene, q=q, accuracy=accuracy), truth.error < accuracy / 100
        error = np.abs(robot.difference(truth.q, worlds.q)).max(axis=1)
        assert (error <= worlds.error + truth.error)[known].all()
        judged += int(known.sum())
    assert judged > 700


def test_error_bars_of_worlds_hold() -> None:
    rng = np.random.default_rng(2)
    q, v = rng.uniform(-3, 3, (40, 2)), rng.uniform(-3, 3, (40, 2))
    scene = tl.load_scene("arm-swing")
    rough = tl.simulate_many(scene, q=q, v=v, duration=2.0, accuracy=1e-3)
    fine = tl.simulate_many(scene, q=q, v=v, duration=2.0, accuracy=1e-9)
    assert_within(rough.q, fine.q, rough.error)


def test_a_world_keeps_the_best_bar_that_it_has_had(monkeypatch: pytest.MonkeyPatch) -> None:
    """Solutions with smaller tolerances whose bars are larger are not taken."""
    bars, looks = _Worlds.bars, list[int]()

    def growing(given: _Worlds, one: _Tried, before: int) -> _Tried:
        finer = bars(given, one, before)
        one.error[:] = (2.0 + before) * given.accuracy
        looks.append(before)
        return finer

    monkeypatch.setattr(_Worlds, "bars", growing)
    monkeypatch.setattr(_Worlds, "first_bars", lambda given, one: growing(given, one, 0))
    given = {"duration": 1.0, "q": starts(3), "accuracy": 1e-6}
    worlds = tl.simulate_many(tl.load_scene("arm-swing"), **given)
    assert max(looks) > 0
    np.testing.assert_array_equal(worlds.error, 2e-6)
    np.testing.assert_array_equal(worlds.q, tl.simulate_many(tl.load_scene("arm-swing"), **given, verify=False).q)


def test_samples_on_the_way() -> None:
    scene, q = tl.load_scene("arm-swing"), starts(9)
    worlds = tl.simulate_many(scene, q=q, duration=2.0, accuracy=1e-8, samples_per_second=4)
    np.testing.assert_array_equal(worlds.samples_t, np.linspace(0.0, 2.0, 9))
    assert worlds.samples_q.shape == (9, 9, 2)
    assert worlds.samples_v.shape == (9, 9, 2)
    np.testing.assert_array_equal(worlds.samples_q[-1], worlds.q)
    np.testing.assert_array_equal(worlds[3].t, worlds.samples_t)
    some = tl.simulate_many(scene, 2.0, q=q, accuracy=1e-8, t_eval=[0.5, 1.25])
    assert_near(some.samples_q, worlds.samples_q[[2, 5]], 2e-8)
    np.testing.assert_array_equal(some[3].t, [0.5, 1.25, 2.0])


def test_a_lost_world_is_nan_and_the_others_go_on() -> None:
    v = np.zeros((9, 2))
    v[4] = 1e200
    worlds = tl.simulate_many(tl.load_scene("arm-swing"), v=v, duration=1.0)
    assert np.isnan(worlds.q[4]).all()
    assert np.isnan(worlds.error[4])
    others = np.delete(np.arange(9), 4)
    assert np.isfinite(worlds.q[others]).all()
    assert (worlds.error[others] <= 1e-6).all()
    assert not worlds.within_accuracy[4]


@pytest.mark.parametrize(
    ("options", "kind", "part"),
    [
        ({"q": [[0.0, 0.0]] * 3, "v": [[0.0, 0.0]] * 4}, SceneError, "do not match"),
        ({"parameters": {"forarm.mass": 1.0}}, SceneError, "forearm.mass"),
        ({"q": [[np.nan, 0.0]]}, QueryError, "finite"),
        ({"accuracy": 0}, AccuracyError, "above 0"),
        ({"duration": -1}, SceneError, "above 0 s"),
        ({"q": np.zeros((2, 3, 2))}, SceneError, "reshape"),
        ({"q": np.zeros((0, 2))}, SceneError, "there are no worlds"),
        ({"parameters": {"upper_arm.mass": -0.2}}, SceneError, "expected at least 0, got -0.2"),
        ({"parameters": {"forearm.mass": [1.0, 0.0]}}, SceneError, "forearm.mass: no body has .* with 0 kg"),
        (
            {"parameters": {"forearm.mass": [1.0, 0.0]} | {f"forearm.inertia.{k}{k}": [0.1, 0.0] for k in "xyz"}},
            SceneError,
            "joint 'elbow' then moves no inertia",
        ),
        ({"parameters": {"forearm.mass": "x"}}, SceneError, "expected numbers, got 'x'"),
        ({"parameters": [1.0]}, SceneError, "expected values by name, got list"),
        ({"samples_per_second": -1}, SceneError, "samples_per_second: expected a number above 0"),
        ({"samples_per_second": 1e9}, SceneError, "samples, the limit is"),
        ({"t_eval": [0.5, 0.2]}, SceneError, "t_eval: expected times that increase"),
        ({"accuracy": 1e-16}, AccuracyError, "below what can be verified in batches"),
    ],
)
def test_refusals(options: dict, kind: type, part: str) -> None:
    with pytest.raises(kind, match=part):
        tl.simulate_many(tl.load_scene("arm-swing"), **options)


def test_parameters_are_the_physics() -> None:
    """At rest in the horizontal the first accelerations tell the masses: closed form of the paper's arm."""
    mass, t = np.array([0.5, 1.0, 2.0]), 1e-3
    scene = tl.load_scene("arm-swing")
    worlds = tl.simulate_many(scene, parameters={"forearm.mass": mass}, duration=t, accuracy=1e-12, verify=False)
    for m, v in zip(mass, worlds.v, strict=True):
        # The rod's own inertia stays that of 1 kg, m L^2 / 12 = 1 / 12: only its mass changes.
        arm = two_link((1.0, 1.0), (3.0, float(m)))
        inertia = arm.mass_matrix(np.zeros(2)) + (1 - m) / 12 * np.ones((2, 2))
        inertia[0, 1] += 0.0
        bias = arm.bias(np.zeros(2), np.zeros(2))
        np.testing.assert_allclose(v / t, np.linalg.solve(inertia, -bias), rtol=1e-5)


def test_bars_hold_where_an_unstable_motion_makes_rounding_large() -> None:
    """Beside the upright equilibrium truncation is nearly nothing; one second solution agrees by chance with the first,
    and such bars were up to 5 times too small."""
    beside = np.array([[1.34006437e-08, 3.87022564e-08], [1.06947832e-07, 1.20585962e-07],
                       [-6.04451023e-07, -5.12432790e-07], [-3.54260210e-08, -1.31556265e-08]])  # fmt: skip
    q = beside + np.array([np.pi / 2, 0.0])
    scene = tl.load_scene("arm-swing")
    worlds = tl.simulate_many(scene, q=q, duration=2.5, accuracy=1e-7)
    for start, end, bar in zip(q, worlds.q, worlds.error, strict=True):
        one = tl.Scene(tl.load_robot("two_link"), start, effects=scene.effects)
        reference, doubt = extended_reference(one, np.array([0.0, 2.5]))
        assert doubt[-1] <= 0.01 * bar
        assert np.abs(end - reference[-1]).max() <= bar


def test_a_bar_holds_where_an_error_is_not_in_proportion_to_the_tolerance() -> None:
    """The error is 2.6e-7 at a tolerance of 9e-10, 1.4e-6 at 1e-10 and 1.7e-7 at 9e-12: without the solutions from
    before, the bar of this double pendulum was too small by 1.5."""
    scene, start = tl.load_scene("arm-swing"), [0.08690058790446842, -0.4605889701952244]
    worlds = tl.simulate_many(scene, q=[start], duration=10.0)
    reference, doubt = extended_reference(tl.Scene(scene.base, start, effects=scene.effects), np.array([0.0, 10.0]))
    assert doubt[-1] <= 0.01 * worlds.error[0]
    assert np.abs(worlds.q[0] - reference[-1]).max() <= worlds.error[0] <= 1e-6


def test_worlds_keep_an_accuracy_that_single_runs_keep() -> None:
    """Of unstable motions, whose first solutions are off by up to 0.5 rad, and whose disturbed ones are far from them.

    Worlds were given up for that; of the first one the finer solution had by chance the error of the first, and a bar
    half as large.
    """
    scene = tl.load_scene("arm-swing")
    q = np.array([[1.40565397, -0.77401247], [1.38727734, 1.06192205], [0.75197626, 0.90603571]])
    v = np.array([[-0.06756031, 0.29406411], [-0.23926747, 1.16801885], [-0.50278865, -0.0241168]])
    worlds = tl.simulate_many(scene, q=q, v=v, duration=14.182, accuracy=5e-6)
    assert worlds.within_accuracy.all()
    for start, speed, end, bar in zip(q, v, worlds.q, worlds.error, strict=True):
        one = tl.Scene(scene.base, start, speed, effects=scene.effects)
        reference, doubt = extended_reference(one, np.array([0.0, 14.182]))
        assert np.abs(end - reference[-1]).max() + doubt[-1] <= bar


def test_bars_of_two_solutions_of_a_world_do_not_contradict_each_other() -> None:
    step = step_map(equations_of(tl.load_scene("arm-swing")), METHODS["dop853"])
    given = _Worlds(step, np.tile([[0.1], [0.2], [0.0], [0.0]], 3), np.array([0.0, 5.0]), None, None, 1e-6)
    one, other = (given.solved(np.arange(3), np.full(3, tolerance)) for tolerance in (1e-3, 1e-9))
    far = np.abs(one.x[-1, :2] - other.x[-1, :2]).max()
    assert far > 1e-6
    one.error, other.error = far * np.array([0.5, 2.0, np.nan]), far * np.array([0.1, 0.1, 0.1])
    np.testing.assert_allclose(np.array(given.agreeing(one, other)) / far, [[1.1, 2.0, np.nan], [1.5, 0.1, 0.1]])


def test_worlds_out_of_reach_are_not_solved_again() -> None:
    """Two of five worlds are chaotic: no tolerance of double precision keeps 1e-6 in them for 30 s."""
    v, scene = np.array([[0.0, 0.0], [9.0, -9.0], [0.1, 0.0], [-8.0, 9.0], [0.0, 0.1]]), tl.load_scene("arm-swing")
    q = np.tile([-np.pi / 2, 0.0], (5, 1))
    worlds = tl.simulate_many(scene, q=q, v=v, duration=30.0)
    once = tl.simulate_many(scene, q=q, v=v, duration=30.0, verify=False)
    assert worlds.within_accuracy.tolist() == [True, False, True, False, True]
    assert worlds.steps[[1, 3]].tolist() == once.steps[[1, 3]].tolist()


@pytest.mark.parametrize("count", [3, 200])
def test_progress_goes_on_to_the_end_and_may_stop_it(count: int) -> None:
    """200 worlds are shared by threads, where there is more than one."""
    scene, seen = tl.load_scene("arm-swing"), list[float]()
    tl.simulate_many(scene, q=starts(count), duration=2.0, verify=False, progress=lambda t, *_: seen.append(t))
    assert seen[-1] == 2.0
    assert seen == sorted(seen)

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        tl.simulate_many(scene, q=starts(count), duration=2.0, progress=stop)


@pytest.fixture(scope="module")
def swings() -> tl.Worlds:
    """Three worlds that differ in a mass and a start."""
    scene = tl.load_scene("arm-swing")
    return tl.simulate_many(scene, q=[[0.0, 0.1 * k] for k in range(3)], parameters={"forearm.mass": [1.0, 1.5, 2.0]},
                            duration=1.0, accuracy=1e-6, samples_per_second=21)  # fmt: skip


def test_a_world_is_a_run_and_has_a_scene_that_gives_it_again(swings: tl.Worlds, tmp_path: Path) -> None:
    assert len(swings) == 3
    assert len(list(swings)) == 3
    one, scene = swings[-1], swings.scene_of(-1)
    np.testing.assert_array_equal(scene.q, [0.0, 0.2])
    assert scene.robot.model.inertias[2].mass == pytest.approx(2.0)
    alone = tl.simulate(scene, accuracy=1e-10, samples_per_second=21)
    np.testing.assert_allclose(one.t, alone.t)
    assert np.abs(one.q - alone.q).max() <= one.error.max() <= 1e-6
    assert_near(one.energy, alone.energy, 1e-4)  # of a forearm of 2 kg
    again = tl.Trajectory.load(one.save(tmp_path / "one.npz"), robot=scene.robot)
    np.testing.assert_array_equal(again.q, one.q)
    with pytest.raises(IndexError):
        swings[3]
    bare = tl.simulate_many(tl.load_scene("arm-swing"), q=[[0.0, 0.1]], duration=1.0, accuracy=1e-6)
    with pytest.raises(SceneError, match=r"samples_per_second=100\) keeps them; tl.simulate\(worlds.scene_of\(0\)\)"):
        bare[0]


def test_worlds_are_a_table_a_figure_and_html(swings: tl.Worlds, tmp_path: Path) -> None:
    table = swings.to_pandas()
    assert list(table) == ["forearm.mass", "q.elbow", "end.q.shoulder", "end.q.elbow", "end.v.shoulder", "end.v.elbow",
                           "t", "error", "steps"]  # fmt: skip
    np.testing.assert_array_equal(table["end.q.elbow"], swings.q[:, 1])
    saved = np.genfromtxt(swings.save(tmp_path / "worlds.csv"), delimiter=",", names=True, deletechars="")
    np.testing.assert_array_equal(saved["end.q.elbow"], swings.q[:, 1])
    figure = swings.plot()
    drawn = [axis for axis in figure.axes if axis.collections and len(axis.collections[0].get_segments()) == 3]
    assert [axis.get_ylabel() for axis in drawn] == ["shoulder\n(rad)", "elbow\n(rad)"]
    np.testing.assert_array_equal(drawn[1].collections[0].get_segments()[2][:, 1], swings[2].q[:, 1])
    assert swings.plot(tmp_path / "worlds.png").stat().st_size > 10_000
    assert "forearm.mass</td><td>1</td><td>1.5</td><td>2</td>" in swings._repr_html_()
