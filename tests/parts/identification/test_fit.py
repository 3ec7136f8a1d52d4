"""fit: true values from simulated motions with noise, what cannot be told in words, and refused data."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.optimize import lsq_linear

import twolink as tl
from tests.parts.identification import motions
from tests.refusals import refusal
from tests.urdf_text import joint, link
from tests.urdf_text import robot_of as robot_text
from twolink.errors import QueryError, SceneError
from twolink.identification import base_parameters
from twolink.io.tables import write_table
from twolink.parts.identification.bounded_least_squares import Bounds, StepLimits, step_within
from twolink.parts.identification.consistency import body_of, central, from_central, log_cholesky_chart, pseudo_inertia
from twolink.parts.identification.shooting import ShootingInterval, Shot
from twolink.scenes.parameters import scene_with

E = tl.effects
ARM = tl.load_robot("arm")
SCENE = tl.Scene(ARM, [1.0, 0.7], effects=[E.Gravity(), E.JointDamping({"shoulder": 0.3, "elbow": 0.2})])
TRUE = {"forearm.mass": 1.9, "effects.1.damping.elbow": 0.25, "effects.1.damping.shoulder": 0.4}
TIMES = np.linspace(0.0, 2.0, 101)
NOISE = 2e-3


def motion_of(scene: tl.Scene, times: np.ndarray = TIMES) -> tuple[np.ndarray, np.ndarray]:
    return tl.simulate(scene, float(times[-1]), accuracy=1e-9).at(times)


Q, V = motion_of(scene_with(SCENE, TRUE))


def noisy(values: np.ndarray, seed: int = 0, size: float = NOISE) -> np.ndarray:
    return motions.noisy(values, size, seed)


def inside(found: tl.SceneFit, truth: dict[str, float]) -> list[bool]:
    return [low <= truth[name] <= high for name, (low, high) in found.intervals.items()]


def test_exact_measurements_give_the_true_values() -> None:
    found = tl.fit(SCENE, {"t": TIMES, "q": Q, "v": V}, list(TRUE))
    for name, value in TRUE.items():
        assert found.values[name] == pytest.approx(value, abs=2e-6)
    assert all(inside(found, TRUE))
    assert found.converged
    assert found.explained
    assert np.abs(found.residuals).max() < 1e-5


@pytest.mark.slow
def test_true_values_are_inside_the_intervals_as_often_as_stated() -> None:
    hits = []
    for seed in range(25):
        found = tl.fit(SCENE, {"t": TIMES, "q": noisy(Q, seed)}, list(TRUE))
        hits += inside(found, TRUE)
    assert np.mean(hits) >= 0.87  # 75 intervals of 95 %: 0.95 - 3 standard deviations


def test_ctrl_c_keeps_the_best_so_far() -> None:
    """It comes at the fifth simulation; what is kept is better than the first guess, and says it is not the end."""
    labels = []

    def interrupt(done: int, most: int, label: str) -> None:
        assert done < most
        labels.append(label)
        if len(labels) == 5:
            raise KeyboardInterrupt

    start = scene_with(SCENE, {"forearm.mass": 1.2})
    found = tl.fit(start, {"t": TIMES, "q": Q}, list(TRUE), progress=interrupt)
    assert found.interrupted
    assert not found.converged
    assert any("best so far" in text for text in found.warnings)
    assert "x the noise" in labels[-1]
    guess = motion_of(start)[0] - Q
    np.testing.assert_allclose(found.residuals, Q - motion_of(scene_with(start, found.values))[0], atol=1e-5)
    assert np.abs(found.residuals).max() < 0.5 * np.abs(guess).max()


def test_dry_friction_is_found_through_its_events() -> None:
    scene = tl.load_scene("pendulum-friction")
    name = "effects.1.kinetic.axle"
    true = scene.effects[1].kinetic["axle"]
    times = np.linspace(0.0, 2.0, 101)
    q, _ = motion_of(scene, times)
    found = tl.fit(scene_with(scene, {name: 0.9 * true}), {"t": times, "q": noisy(q)}, [name])
    low, high = found.intervals[name]
    assert low <= true <= high
    assert found.values[name] == pytest.approx(true, rel=0.01)
    with refusal(QueryError, code="one-segment", match="events or closed loops"):
        tl.fit(scene, {"t": times, "q": q}, [name], segments=3)


def test_one_joint_alone_and_a_start_that_is_not_known() -> None:
    names = ["forearm.mass", "q.shoulder", "v"]
    found = tl.fit(scene_with(SCENE, {"effects.1.damping.elbow": 0.25, "effects.1.damping.shoulder": 0.4}),
                   pd.DataFrame({"t": TIMES, "q.elbow": noisy(Q[:, 1])}), names)  # fmt: skip
    assert found.channels == ("q.elbow",)
    truth = {"forearm.mass": 1.9, "q.shoulder": 1.0, "v.shoulder": 0.0, "v.elbow": 0.0}
    assert np.mean(inside(found, truth)) >= 0.75
    assert found.values["forearm.mass"] == pytest.approx(1.9, abs=0.05)


def test_a_joint_that_shows_noise_alone_does_not_hide_that_the_motion_is_found() -> None:
    """A turntable that nothing turns, with a pendulum on it that swings."""
    robot = tl.load_robot(robot_text(
        link("table", moment=0.1), link("rod", moment=0.1, at="0 0 -0.5"),
        joint("turn", "revolute", "ground", "table", "0 0 1"), joint("swing", "revolute", "table", "rod", "0 1 0"),
    ))  # fmt: skip
    scene = tl.Scene(robot, [0.0, 1.0], effects=[E.Gravity(), E.JointDamping({"swing": 0.1})])
    found = tl.fit(scene, {"t": TIMES, "q": noisy(motion_of(scene)[0])}, ["effects.1.damping.swing"])
    assert found.explained
    assert found.segments == 1
    assert inside(found, {"effects.1.damping.swing": 0.1}) == [True]


def test_outliers_move_a_robust_fit_little() -> None:
    q = noisy(Q)
    q[::11] += 0.2
    plain, robust = (tl.fit(SCENE, {"t": TIMES, "q": q}, list(TRUE), method=m) for m in ("weighted", "robust"))
    off = [abs(found.values["forearm.mass"] - 1.9) for found in (plain, robust)]
    assert off[1] < 0.2 * off[0]


def test_a_stated_noise_counts_until_the_residuals_contradict_it() -> None:
    data, scene = {"t": TIMES, "q": noisy(Q)}, scene_with(SCENE, {n: x for n, x in TRUE.items() if "damping" in n})
    stated = tl.fit(scene, data, ["forearm.mass"], sigma={"q.shoulder": NOISE, "q.elbow": NOISE})
    assert np.array_equal(stated.noise, [NOISE, NOISE])
    wrong = tl.fit(scene, data, ["forearm.mass"], sigma=NOISE / 10)
    np.testing.assert_allclose(wrong.noise, NOISE, rtol=0.3)
    assert wrong.half_width[0] > 0.5 * stated.half_width[0]


@pytest.mark.parametrize("slow", [0.0, NOISE / 20])
@pytest.mark.parametrize("method", ["weighted", "robust"])
def test_small_residuals_that_follow_each_other_do_not_refute_a_stated_noise(slow: float, method: str) -> None:
    """The half-width is that of white noise of this size, by the slopes of two runs. It was 0.4 of it, and 5e-7."""
    name, step, times = "effects.1.damping.elbow", 1e-3, np.linspace(0.0, 1.0, 51)
    more, less = (motion_of(scene_with(SCENE, {name: 0.2 + change}), times)[0] for change in (step, -step))
    by_hand = 1.96 * NOISE / np.linalg.norm((more - less) / (2 * step))
    q = motion_of(SCENE, times)[0] + slow * np.sin(5 * times + 1)[:, None] * [1, -1]
    found = tl.fit(scene_with(SCENE, {name: 0.25}), {"t": times, "q": q}, [name], sigma=NOISE, method=method)
    assert found.half_width[0] == pytest.approx(by_hand, rel=0.02)


@pytest.mark.slow
def test_a_common_factor_of_all_masses_cannot_be_told_and_is_not_fitted() -> None:
    """M q'' + h = 0 under gravity alone is the same motion for any factor of all inertias."""
    scene = tl.Scene(ARM, [1.0, 0.7], effects=[E.Gravity()])
    heavy = scene_with(scene, {"forearm.mass": 1.9})
    q, _ = motion_of(heavy)
    bodies = ["*.mass", "*.first_moment.*", "*.origin_inertia.*"]
    found = tl.fit(scene, {"t": TIMES, "q": noisy(q, size=1e-4)}, bodies)
    base = base_parameters(ARM)
    assert len(found.combinations) + len(found.not_excited) == len(base.combinations) - 1
    assert found.not_identifiable[0].startswith("only the ratios of ")
    for name in base.unseen:
        assert f"{name}: no measurement depends on it" in found.not_identifiable
    assert found.explained
    ratio = found.parameters["forearm.first_moment.z"] / found.parameters["forearm.origin_inertia.yy"]
    truth = heavy.robot.parameter_values[[13, 16]]
    assert ratio == pytest.approx(truth[0] / truth[1], rel=0.02)


@pytest.mark.slow
def test_what_is_told_of_driven_links_are_pinocchios_base_parameters() -> None:
    """Known torques set the scale: all six combinations of the arm are told, in the words of `base_parameters`."""
    push = E.Torque({"shoulder": E.Sine(4.0, 1.1), "elbow": E.Sine(1.0, 2.3)})
    scene = tl.Scene(ARM, [0.5, 0.7], effects=[E.Gravity(), push])
    times = np.linspace(0.0, 3.0, 151)
    q, v = motion_of(scene_with(scene, {"forearm.mass": 1.8}), times)
    bodies = ["upper_arm.*", "forearm.*"]
    found = tl.fit(scene, {"t": times, "q": noisy(q, size=1e-5), "v": noisy(v, size=1e-5)}, bodies)
    base = base_parameters(ARM)
    names = ARM.parameter_names[:20]
    order = [list(found.parameters).index(name) for name in names]
    ours = found.matrix[:, order]
    assert len(found.combinations) == len(base.combinations)
    angle = ours - ours @ np.linalg.pinv(base.matrix) @ base.matrix
    assert np.abs(angle).max() < 1e-4 * np.abs(ours).max()
    truth = ours @ scene_with(scene, {"forearm.mass": 1.8}).robot.parameter_values[:20]
    assert np.mean(np.abs(found.estimate - truth) <= found.half_width) >= 5 / 6
    for inertia in found.found.model.inertias.tolist()[1:]:
        assert np.linalg.eigvalsh(pseudo_inertia(np.asarray(inertia.toDynamicParameters()))).min() > 0


def test_derivatives_of_segments_and_of_the_gaps_between_them() -> None:
    """Each moves by its own start alone, and a gap by the start behind it, too."""
    random, nx, k = np.random.default_rng(0), 4, 3
    segments = [
        ShootingInterval(*(np.empty(0),) * 3, random.normal(size=(m, 2, k)), random.normal(size=(m, 2, nx)),
                         random.normal(size=(nx, k)), random.normal(size=(nx, nx)), *(np.empty(0),) * 2)
        for m in (5, 4, 6)]  # fmt: skip
    basis, y, starts = random.normal(size=(k, 2)), random.normal(size=2), random.normal(size=(2, nx))
    z, moves = basis @ y, [np.zeros(nx), *starts]
    values = [(of.by_z @ z + of.by_start @ move).ravel() for of, move in zip(segments, moves, strict=True)]
    gaps = [of.end_by_z @ z + of.end_by_start @ move - after
            for of, move, after in zip(segments[:2], moves[:2], moves[1:], strict=True)]  # fmt: skip
    found = Shot(SCENE, segments, np.zeros((2, nx))).jacobian(basis) @ np.concatenate([y, *starts])
    np.testing.assert_allclose(found, np.concatenate([*values, *gaps]), atol=1e-12)


@pytest.mark.slow
def test_a_motion_that_one_piece_loses_is_found_in_segments() -> None:
    """A double pendulum over its top. One piece ends at a mass that is far off, and says that the motion is another."""
    scene = tl.Scene(tl.load_robot("two_link"), [1.5, 1.0], [4.0, 0.0], effects=[E.Gravity()])
    times = np.linspace(0.0, 8.0, 201)
    true = {"forearm.mass": 1.1, "gravity.z": -9.5}
    q = noisy(motion_of(scene_with(scene, true), times)[0], size=1e-3)
    one = tl.fit(scene, {"t": times, "q": q}, list(true), segments=1)
    assert "the scene's motion is not the measured one" in one.warnings[0]
    found = tl.fit(scene, {"t": times, "q": q}, list(true))
    assert found.segments > 1
    assert found.explained
    assert found.gap < 1e-6
    for name, value in true.items():
        assert found.values[name] == pytest.approx(value, rel=1e-3)


def test_a_search_goes_on_along_its_bounds() -> None:
    """Noise would make the damping negative: the best is at 0, or beside it, and the mass is found all the same."""
    names = ["forearm.mass", "effects.1.damping.elbow"]
    truth = {"forearm.mass": 1.9, "effects.1.damping.elbow": 0.0}
    q = noisy(motion_of(scene_with(SCENE, truth))[0], 3)
    found = tl.fit(SCENE, {"t": TIMES, "q": q}, names)
    assert found.parameters["effects.1.damping.elbow"] >= 0.0
    assert all(inside(found, truth))
    held = tl.fit(SCENE, {"t": TIMES, "q": q}, names, bounds={"forearm.mass": (1.0, 1.7)})
    assert held.converged
    assert held.parameters["forearm.mass"] == pytest.approx(1.7, abs=1e-12)


def test_a_part_of_a_body_is_moved_along_what_can_exist() -> None:
    """The moments alone, where com and inertia of the truth are others: the best of such bodies is at their border."""
    names = ["forearm.first_moment.z", "forearm.origin_inertia.yy"]
    q = motion_of(scene_with(SCENE, {"forearm.com.z": ARM.model.inertias[2].lever[2] * 1.2}))[0]
    found = tl.fit(SCENE, {"t": TIMES, "q": noisy(q, size=1e-4)}, names)
    assert found.converged
    assert np.linalg.eigvalsh(pseudo_inertia(found.found.parameter_values[10:20])).min() > 0


def test_bounded_steps_are_those_of_scipy() -> None:
    rng = np.random.default_rng(5)
    for _ in range(30):
        matrix, right = rng.standard_normal((12, 4)), rng.standard_normal(12)
        low, high = -rng.uniform(0, 0.3, 4), rng.uniform(0, 0.3, 4)
        bounds = Bounds(np.vstack([np.eye(4), -np.eye(4)]), np.concatenate([low, -high]))
        limits = StepLimits(bounds, lambda _: Bounds(np.empty((0, 4)), np.empty(0)))
        ours = step_within(matrix, -right, np.full(4, 1e-9), limits)
        np.testing.assert_allclose(ours, lsq_linear(matrix, right, (low, high), tol=1e-14).x, rtol=0, atol=1e-6)


def test_time_that_is_up_keeps_the_best_so_far() -> None:
    found = tl.fit(scene_with(SCENE, {"forearm.mass": 1.2}), {"t": TIMES, "q": Q}, list(TRUE), patience=1e-6)
    assert found.interrupted
    assert any("best so far" in text for text in found.warnings)


@pytest.mark.slow
@pytest.mark.parametrize("interpolation", ["linear", "cubic", "hold"])
def test_a_motion_driven_by_a_table_is_found(interpolation: str) -> None:
    """The truth is SciPy's, which begins anew at every knot."""
    knots = np.linspace(0.0, 1.2, 60)
    table = E.Sampled(times=tuple(knots), values=tuple(np.sin(7 * knots) - 0.3), interpolation=interpolation)
    scene = tl.Scene(ARM, [1.0, 0.7], effects=[*SCENE.effects, E.Torque({"elbow": table})])
    times = np.linspace(0.0, 1.2, 41)
    q, _ = tl.simulate(scene_with(scene, TRUE), 1.2, accuracy=1e-9, method="scipy-dop853").at(times)
    found = tl.fit(scene, {"t": times, "q": q}, list(TRUE))
    for name, value in TRUE.items():
        assert found.values[name] == pytest.approx(value, abs=2e-5)
    assert found.converged


def test_a_file_is_read_whatever_other_columns_it_has(tmp_path: Path) -> None:
    columns = {"t": TIMES, "q.shoulder": noisy(Q)[:, 0], "q.elbow": noisy(Q)[:, 1], "note": TIMES}
    damped = scene_with(SCENE, {name: x for name, x in TRUE.items() if "damping" in name})
    found = tl.fit(damped, write_table(tmp_path / "log.csv", columns, {}), ["forearm.mass"])
    assert found.to_dict()["noise"]["q.elbow"] == pytest.approx(NOISE, rel=0.3)


def test_any_coordinates_are_a_body_that_can_exist() -> None:
    body = np.asarray(ARM.model.inertias[2].toDynamicParameters())
    np.testing.assert_allclose(from_central(central(body)), body, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(body_of(pseudo_inertia(body)), body, rtol=1e-12, atol=1e-14)
    chart = log_cholesky_chart(body, 1.0)
    np.testing.assert_allclose(chart(np.zeros(10)), body, rtol=1e-9, atol=1e-12)
    for z in np.random.default_rng(0).uniform(-2, 2, (20, 10)):
        assert np.linalg.eigvalsh(pseudo_inertia(chart(z))).min() > 0


GIVEN = {"t": TIMES, "q": Q}
REFUSED = {  # other data, and other arguments
    "too few": ({"t": TIMES[30:33], "q": Q[30:33]}, {"parameters": [*TRUE, "q", "v"]}, "too-few-samples"),
    "constant": ({"q": np.ones_like(Q)}, {}, "constant-data"),
    "nan": ({"q": np.where(TIMES[:, None] > 1, Q, np.nan)}, {}, "query"),
    "times": ({"t": TIMES[::-1]}, {}, "times"),
    "before the start": ({"t": TIMES - 1}, {}, "times"),
    "degrees": ({"q": np.degrees(Q)}, {}, "units"),
    "degrees of another motion": ({"q": np.degrees(Q - Q[0])}, {}, "units"),
    "degrees of v": ({"v": np.degrees(V)}, {}, "units"),
    "shape": ({"q": Q[:-1]}, {}, "query"),
    "no t": ({"t": None}, {}, "column-missing"),
    "nothing": ({"q": None}, {}, "column-missing"),
    "misspelt": ({"q": None, "q.elbo": Q[:, 1]}, {}, "column-missing"),
    "unknown": ({}, {"parameters": ["forarm.mass"]}, "unknown-parameter"),
    "urdf damping": ({}, {"parameters": ["elbow.damping"]}, "unknown-parameter"),
    "mixed": ({}, {"parameters": ["forearm.com.x", "forearm.first_moment.z"]}, "mixed-parameters"),
    "unseen": ({}, {"parameters": ["forearm.com.y"]}, "nothing-identifiable"),
    "segments": ({}, {"segments": 50}, "query"),
    "no pair": ({}, {"bounds": {"forearm.mass": 5}}, "bounds"),
    "bounds": ({}, {"bounds": {"forearm.mass": (5, 9)}}, "bounds"),
    "sigma": ({}, {"sigma": {"q.elbow": 1.0}}, "query"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_data_that_cannot_be_used_are_refused_with_what_is_wrong(case: str) -> None:
    columns, options, code = REFUSED[case]
    data = {name: x for name, x in (GIVEN | columns).items() if x is not None}
    with refusal(SceneError if code == "unknown-parameter" else QueryError, code=code) as caught:
        tl.fit(SCENE, data, **{"parameters": ["forearm.mass"], **options})
    assert caught.value.remedy


def test_two_samples_that_no_mass_explains_are_refused_in_words() -> None:
    swing = tl.Scene(tl.load_robot("two_link"), [1.2, 0.5], effects=[E.Gravity()], duration=0.4)
    with pytest.raises(QueryError, match=r"do not depend on forearm\.mass"):
        tl.fit(swing, {"t": [0.0, 0.1], "q": [[0.0, 0.0], [1.0, 1.0]]}, ["forearm.mass"])
