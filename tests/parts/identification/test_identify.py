"""identify: exact data give exact values, noisy ones intervals that hold, and what cannot be told is named."""

import itertools
import re
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import twolink as tl
from tests.parts.identification.motions import motion, noisy
from tests.refusals import refusal
from tests.urdf_text import joint, link, robot_of
from twolink.errors import QueryError
from twolink.identification import Identification, identify
from twolink.parts.identification.regression import fit

ARM = tl.load_robot("arm")
T, Q, V, A = motion(ARM)
FRICTION = {"shoulder.damping": 0.4, "elbow.damping": 0.2, "shoulder.friction": 0.3, "elbow.friction": 0.15}
TRUE = dict(zip(ARM.parameter_names, ARM.parameter_values.tolist(), strict=True)) | FRICTION
TAU = ARM.regressor(Q, V, A) @ np.array(list(TRUE.values()))
NOISE = np.array([0.2, 0.02])
WANTED = ["forearm.mass", "forearm.first_moment.*", "*.damping", "*.friction"]


def truth(found: Identification) -> np.ndarray:
    return found.matrix @ [TRUE[name] for name in found.parameters]


def misses(found: Identification) -> np.ndarray:
    """The distance of each estimate from the truth, in half widths of its interval."""
    return np.abs(found.estimate - truth(found)) / found.half_width


def test_exact_data_give_the_true_values_and_name_what_they_cannot_tell() -> None:
    found = identify(ARM, T, Q, V, TAU, ["*"], a=A)
    np.testing.assert_allclose(found.estimate, truth(found), rtol=0, atol=1e-12)
    assert np.all(misses(found) < 1)
    assert found.values["elbow.friction"] == pytest.approx(0.15, abs=1e-12)
    assert found.combinations[2] == "upper_arm.origin_inertia.yy + 0.0793549 forearm.mass + shoulder.armature"
    assert f"only the sum {found.combinations[2]}" in found.not_identifiable
    assert "upper_arm.mass: no torque depends on it" in found.not_identifiable
    assert found.not_excited == ()


@pytest.mark.slow
@pytest.mark.parametrize("method", ["ordinary", "weighted", "robust"])
def test_true_values_are_inside_the_intervals_as_often_as_stated(method: str) -> None:
    inside = []
    for seed in range(100):
        found = identify(ARM, T, Q, V, noisy(TAU, NOISE, seed), WANTED, a=A, method=method)
        inside.append(misses(found) < 1)
    assert 0.92 < np.mean(inside) < 0.98  # 700 intervals of 95 %, six of each run nearly independent


def test_weights_make_the_intervals_narrower_than_ordinary_least_squares() -> None:
    tau = TAU + NOISE * np.random.default_rng(3).standard_normal(TAU.shape)
    weighted, ordinary = (identify(ARM, T, Q, V, tau, WANTED, a=A, method=m) for m in ("weighted", "ordinary"))
    np.testing.assert_allclose(weighted.noise, NOISE, rtol=0.15)
    assert np.all(weighted.half_width < 1.05 * ordinary.half_width)
    assert np.any(weighted.half_width < 0.3 * ordinary.half_width)


def test_robust_withstands_outliers_that_ordinary_least_squares_follows() -> None:
    rng = np.random.default_rng(5)
    tau = TAU + NOISE * rng.standard_normal(TAU.shape)
    tau[rng.integers(0, len(T), 20)] += 3.0
    robust, ordinary = (identify(ARM, T, Q, V, tau, WANTED, a=A, method=m) for m in ("robust", "ordinary"))
    assert np.all(misses(robust) < 2)
    assert np.linalg.norm(robust.estimate - truth(robust)) < 0.2 * np.linalg.norm(ordinary.estimate - truth(ordinary))


def test_positions_alone_are_filtered_and_differentiated() -> None:
    tau = TAU + NOISE * np.random.default_rng(6).standard_normal(TAU.shape)
    exact = identify(ARM, T, Q, None, tau, WANTED)
    assert np.all(misses(exact) < 1.5)
    noisier = identify(ARM, T, noisy(Q, 2e-4), None, tau, WANTED)
    assert len(noisier.t) < len(exact.t) < len(T)  # noise asks for a wider window
    assert np.all(misses(noisier) < 1.5)
    assert noisier.numerical_error.max() > 100 * exact.numerical_error.max()


def test_uneven_times_are_differentiated_too() -> None:
    keep = np.sort(np.random.default_rng(7).choice(len(T), 220, replace=False))
    found = identify(ARM, T[keep], Q[keep], None, TAU[keep], WANTED)
    np.testing.assert_allclose(found.estimate, truth(found), rtol=0, atol=2e-3)


def test_runs_that_are_shorter_than_a_block_of_samples() -> None:
    """Averages over blocks leave nothing of the second run, and a block or two of each of the others."""
    clean = ARM.inverse_dynamics(Q, V, A)
    tau = clean + 0.05 * np.cumsum(noisy(np.zeros_like(clean), 0.1), axis=0)
    whole, *short = ({"t": T[rows], "q": Q[rows], "tau": tau[rows]} for rows in (slice(None), slice(80), slice(99)))
    for runs in ([whole, short[0]], [short[1], *short, *short]):
        assert np.isfinite(identify(ARM, runs, parameters=["forearm.mass"], half_window=25).covariance).all()


def test_continuous_joints_are_differentiated_along_their_tangent() -> None:
    text = ARM.visuals.text.replace('type="revolute"', 'type="continuous"')
    robot = tl.load_robot(text)
    q = np.stack([np.cos(Q), np.sin(Q)], axis=-1).reshape(len(T), -1)
    tau = robot.inverse_dynamics(q, V, A)
    found = identify(robot, T, q, None, tau, ["forearm.mass"])
    assert found.values["forearm.mass"] == pytest.approx(TRUE["forearm.mass"], abs=1e-5)


@pytest.mark.slow
def test_total_least_squares_undoes_the_bias_of_noisy_positions() -> None:
    """Errors of the regressor pull weighted estimates towards zero; eight seeds show the bias beyond their spread."""
    name, clean = "forearm.origin_inertia.yy", ARM.inverse_dynamics(Q, V, A)
    bias: dict[str, list[float]] = {"weighted": [], "total": []}
    for seed in range(8):
        for method, errors in bias.items():
            found = identify(ARM, T, noisy(Q, 3e-4, seed), None, noisy(clean, 0.02, 100 + seed), [name],
                             method=method, half_window=4)  # fmt: skip
            errors.append(found.values[name] - TRUE[name])
    assert np.mean(bias["weighted"]) < -2 * np.std(bias["weighted"])
    assert abs(np.mean(bias["total"])) < 0.5 * abs(np.mean(bias["weighted"]))


def test_what_the_data_do_not_excite_is_named_and_not_fitted() -> None:
    """With the shoulder at rest the forearm alone moves: nothing of the upper arm shows but its weight."""
    q, v, a = Q * [0, 1], V * [0, 1], A * [0, 1]
    tau = ARM.inverse_dynamics(q, v, a)
    found = identify(ARM, T, q, v, tau, ["upper_arm.origin_inertia.yy", "forearm.*"], a=a)
    assert found.not_excited == ("upper_arm.origin_inertia.yy", "forearm.mass")
    assert not any("upper_arm" in name for name in found.combinations)
    assert found.values["forearm.origin_inertia.yy"] == pytest.approx(TRUE["forearm.origin_inertia.yy"], abs=1e-9)
    by_noise = identify(ARM, T, noisy(q, 1e-4), None, tau, ["upper_arm.origin_inertia.yy", "forearm.*"])
    assert by_noise.not_excited == found.not_excited


def test_forces_that_the_model_lacks_are_seen_in_the_residuals_and_widen_the_intervals() -> None:
    tau = noisy(TAU, 0.02)
    whole = identify(ARM, T, Q, V, tau, [*WANTED], a=A)
    lacking = identify(ARM, T, Q, V, tau, WANTED[:2], a=A)
    assert not whole.correlated
    assert lacking.correlated
    assert "missing forces" in str(lacking)
    assert lacking.half_width[0] > 3 * whole.half_width[0]


def test_intervals_are_no_narrower_than_what_parts_of_the_data_change() -> None:
    """A jackknife, by hand: the fit without each of 20 blocks of time, where friction grows with the load."""
    load = 0.3 * np.sign(V) * np.abs(ARM.inverse_dynamics(Q, V, A))
    columns, y = ARM.regressor(Q, V, A)[..., [10, 11, 13]], noisy(TAU + load, 0.02)
    found = fit(columns, y, "ordinary")
    ends = np.linspace(0, len(y), 21).round().astype(int)
    without = [np.delete(np.arange(len(y)), np.arange(*rows)) for rows in itertools.pairwise(ends)]
    moved = [np.linalg.lstsq(columns[k].reshape(-1, 3), y[k].ravel(), rcond=None)[0] - found.x for k in without]
    np.testing.assert_allclose(found.by_blocks, 19 / 20 * np.array(moved).T @ np.array(moved), rtol=1e-6)
    whole = identify(ARM, T, Q, V, noisy(TAU + load, 0.02), joint_model="viscous+coulomb")
    least = 2.093 * np.sqrt(np.diag(whole.block_covariance))  # Student's quantile for 19 degrees of freedom
    assert np.all(whole.half_width > least)


def pseudo_inertias(robot: tl.Robot) -> list[np.ndarray]:
    return [pin.PseudoInertia.FromInertia(robot.model.inertias[j]).toMatrix() for j in range(1, robot.model.njoints)]


@pytest.mark.parametrize("seeds", [15, pytest.param(40, marks=pytest.mark.slow)])
def test_intervals_hold_where_an_offset_of_the_torques_walks_at_random(seeds: int) -> None:
    robot = tl.load_robot("arm")
    t, q, v, a = motion(robot, 500)
    tau, held = robot.inverse_dynamics(q, v, a), []
    for seed in range(seeds):
        steps = 0.02 * np.random.default_rng(seed).standard_normal((2, *tau.shape))
        found = identify(robot, t, q, v, tau + steps[0] + np.cumsum(steps[1], axis=0) / np.sqrt(len(t)), a=a,
                         joint_model="none")  # fmt: skip
        held.append(np.abs(found.estimate - found.matrix @ found.selection.nominal) <= found.half_width)
    assert 0.92 <= np.mean(held) <= 0.99


def test_bodies_that_are_found_can_exist() -> None:
    """With so much noise the estimate alone is impossible: the nearest possible bodies are within its errors."""
    tau = ARM.inverse_dynamics(Q, V, A)
    found = identify(ARM, T, Q, V, noisy(tau, 8.0, 2), a=A, joint_model="none")
    assert found.estimate[2] < 0
    assert found.consistency.consistent
    assert found.consistency.distance > 0.3
    for pseudo in pseudo_inertias(found.found):
        assert np.linalg.eigvalsh(pseudo).min() > 0
    precise = identify(ARM, T, Q, V, noisy(tau, 0.01), a=A)
    assert precise.consistency.distance < 0.1
    np.testing.assert_allclose(precise.found.inverse_dynamics(Q, V, A), tau, rtol=0, atol=0.02)


def test_data_that_no_body_explains_are_told() -> None:
    tau = -ARM.inverse_dynamics(Q, V, A)
    found = identify(ARM, T, Q, V, noisy(tau, 0.05), a=A)
    assert not found.consistency.consistent
    assert "opposite sign" in found.consistency.verdict
    assert str(found).startswith("shoulder: its torques have the opposite sign")
    assert min(np.linalg.eigvalsh(pseudo).min() for pseudo in pseudo_inertias(found.found)) > 0


def test_found_robot_has_the_friction_and_armature_that_were_found() -> None:
    geared = TAU + A * [0.05, 0.02]
    found = identify(ARM, T, Q, V, geared, ["*.armature", "*.damping", "*.friction"], a=A).found.model
    np.testing.assert_allclose(found.armature, [0.05, 0.02], rtol=1e-6)
    np.testing.assert_allclose(found.damping, [0.4, 0.2], rtol=1e-6)
    np.testing.assert_allclose(found.upperDryFrictionLimit, [0.3, 0.15], rtol=1e-6)


def test_a_robot_whose_joints_follow_others() -> None:
    """Torques are those of the chain in which nothing follows, G^T tau(G q): identify refused what it found."""
    text = robot_of(
        link("a", 2.0, 0.1, "0.1 0 -0.3"),
        link("b", 1.5, 0.1, "0.2 0.1 0"),
        link("c", 1.0, 0.1, "0.3 0 0"),
        joint("j1", "revolute", "ground", "a", "0 1 0"),
        joint("j2", "revolute", "a", "b", "1 0.2 0"),
        joint("f", "revolute", "b", "c", "0 1 0", more='<mimic joint="j2" multiplier="-1.5"/>'),
    )
    whole, robot = tl.load_robot(text), tl.load_robot(text, mimic=True)
    t, *states = motion(robot)
    follow = np.array([[1.0, 0.0], [0.0, 1.0], [0.0, -1.5]])
    tau = whole.inverse_dynamics(*(x @ follow.T for x in states)) @ follow
    found = identify(robot, t, states[0], states[1], noisy(tau, 0.01), a=states[2])
    true = dict(zip(robot.parameter_names, robot.parameter_values, strict=True))
    off = found.estimate - found.matrix @ [true.get(name, 0.0) for name in found.parameters]
    assert np.mean(np.abs(off) < found.half_width) > 0.8
    for text, at in (("zero", robot), ("gravity", ARM.with_gravity((0.0, 0.0, 0.0)))):
        with pytest.raises(QueryError, match=f"nothing of this robot's setup is called '{text}'"):
            identify(at, t, states[0], states[1], tau, a=states[2], find=[text])


GIVEN = {"t": T, "q": Q, "v": V, "tau": TAU}
REFUSED = {
    "too few": ({**{name: x[:2] for name, x in GIVEN.items()}, "a": A[:2]}, "too-few-samples", "4 torques"),
    "too few to filter": ({"t": T[:8], "q": Q[:8], "v": None, "tau": TAU[:8]}, "too-few-samples", "8 samples"),
    "constant": ({"q": 0 * Q, "v": 0 * V}, "constant-data", "never moves"),
    "nan": ({"tau": np.where(T[:, None] > 1, TAU, np.nan)}, "query", "tau: expected finite"),
    "times": ({"t": T[::-1]}, "times", "does not come after t[0]"),
    "time twice": ({"t": np.round(T, 1)}, "times", "t[1] = 0 s does not come after"),
    "shape": ({"q": Q[:-1]}, "query", "q: expected shape (300, 2), got (299, 2)"),
    "degrees": ({"v": np.degrees(V)}, "units", "57.28 times the rate of its q; is v in"),
    "degrees of q": ({"q": np.degrees(Q), "v": None}, "units", "is q in degrees?"),
    "milliseconds": ({"t": 1000 * T}, "units", "is t in milliseconds?"),
    "a without v": ({"v": None, "a": A}, "query", "v: accelerations came without"),
    "unseen": ({"parameters": ["forearm.first_moment.y"]}, "nothing-identifiable", "no joint"),
    "unknown": ({"parameters": ["wrist.mass"]}, "unknown-parameter", "no parameter 'wrist.mass'"),
    "method": ({"a": A, "method": "total"}, "no-errors", "leave v and a out"),
    "window": ({"v": None, "half_window": 1}, "query", "half_window: expected a whole"),
    "two": ({"v": None, "half_window": 5, "cutoff": 3}, "query", "half_window is given"),
    "no samples": ({name: x[:0] for name, x in GIVEN.items()}, "too-few-samples", "there are no samples"),
    "too few for v": ({name: x[:7] for name, x in GIVEN.items()}, "too-few-samples", "to differentiate v"),
    "nanoseconds": ({"t": T * 1e15, "v": None}, "times", "give seconds"),
    "huge": ({"tau": TAU * 1e200, "a": A}, "units", "cannot be used"),
    "filter": ({"q": noisy(Q, 1e-2), "v": None, "parameters": ["forearm.origin_inertia.yy"], "half_window": 4},
               "nothing-identifiable", "beyond the errors of the filter"),
    "confidence": ({"confidence": 95}, "query", "expected a probability"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_data_that_cannot_be_used_are_refused_with_what_is_wrong(case: str) -> None:
    given, code, part = REFUSED[case]
    with refusal(QueryError, code=code, match=re.escape(part)) as caught:
        identify(ARM, **GIVEN | given)
    assert caught.value.remedy


def test_the_figure_shows_residuals_region_and_all_intervals(tmp_path: Path) -> None:
    found = identify(ARM, T, Q, V, noisy(TAU, NOISE), WANTED, a=A)
    text = found.plot(tmp_path / "found.svg").read_text()
    assert len(found.plot().axes) == 3
    for part in ("shoulder", "elbow", "95 % region", "95 % interval", *found.combinations):
        assert f"<!-- {part}" in text, part
