"""Stepping: samples between steps, many worlds at once, and what ends a solution early."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.integrate.problems import GRAVITY, arm, box, random_states, rods, tight
from twolink.errors import AccuracyError
from twolink.integrate.core.smooth import solve_smooth
from twolink.integrate.motion.scene_equations import equations_of
from twolink.integrate.steps.methods import METHODS
from twolink.integrate.steps.step_map import step_map
from twolink.integrate.steps.stepping import integrate_many
from twolink.scenes import Scene, load_scene

TIMES = np.linspace(0, 2, 401)


@pytest.mark.parametrize("name", ["rk4", "midpoint", "suzuki4", "semi-implicit-euler"])
def test_samples_between_fixed_steps_are_as_exact_as_those_at_their_ends(name: str) -> None:
    """Three of four samples are inside a step; a straight line through the steps would miss by 1e-3."""
    scene = arm()
    found = solve_smooth(equations_of(scene), METHODS[name], TIMES, 0.02)
    error = np.abs(found.x - tight(scene, TIMES)).max(axis=0)
    assert found.steps == 100
    at_ends = np.zeros(401, bool)
    at_ends[::4] = True
    assert 0 < error[~at_ends].max() <= 1.3 * error[at_ends].max()


@pytest.mark.parametrize("name", ["rk23", "rk45", "dop853", "esdirk43"])
@pytest.mark.parametrize("scene", [arm, box])
def test_samples_keep_the_tolerance_wherever_they_are(name: str, scene: object) -> None:
    """Dense samples are no less exact than the few at which the steps are made to end."""
    problem = scene()
    steps, truth = step_map(equations_of(problem), METHODS[name]), tight(problem, TIMES)
    found = solve_smooth(steps.equations, steps.method, TIMES, 1e-7)
    ends = solve_smooth(steps.equations, steps.method, TIMES[[0, -1]], 1e-7)
    assert found.steps == ends.steps  # samples cost no steps
    np.testing.assert_array_equal(found.x[:, -1], ends.x[:, -1])
    assert np.abs(found.x - truth).max() < 1e-4
    assert np.abs(solve_smooth(steps.equations, steps.method, TIMES, 1e-10).x - truth).max() < 1e-6


@pytest.mark.parametrize("name", ["dop853", "rk4"])
def test_worlds_of_a_batch_are_as_they_are_alone(name: str) -> None:
    scene, times = arm(), np.array([0.0, 0.3, 1.0])
    x = random_states(scene.robot, 11)
    x[2:, :5] *= 4  # some are livelier than others
    setting = 1e-9 if METHODS[name].adaptive else 0.002
    found, taken, rejected = integrate_many(step_map(equations_of(scene), METHODS[name]), x, times, setting)
    assert found.shape == (3, 4, 11)
    assert (rejected > 0).any() == METHODS[name].adaptive
    for i in range(11):
        own = equations_of(Scene(scene.robot, x[:2, i], x[2:, i], GRAVITY))
        alone = solve_smooth(own, METHODS[name], times, setting)
        np.testing.assert_allclose(found[:, :, i], alone.x.T, rtol=0, atol=1e-6)
    if METHODS[name].adaptive:
        assert taken[:5].mean() > taken[5:].mean()


def test_a_lost_world_is_nan_and_the_others_go_on() -> None:
    """A world whose gravity is NaN: its steps shrink until none is left."""
    scene, times = arm(), np.array([0.0, 0.5, 1.0])
    x, gravity = random_states(scene.robot, 10), np.full((1, 10), -9.81)
    steps = step_map(equations_of(scene, parameters=["gravity.z"]), METHODS["dop853"])
    before, *_ = integrate_many(steps, x, times, 1e-8, gravity)
    gravity[0, 4] = np.nan
    found, *_ = integrate_many(steps, x, times, 1e-8, gravity)
    others = np.arange(10) != 4
    assert np.isnan(found[1:, :, 4]).all()
    np.testing.assert_allclose(found[:, :, others], before[:, :, others], rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", ["dop853", "rk4", "esdirk43", "implicit-midpoint"])
def test_what_is_not_finite_is_an_error_with_its_time(name: str) -> None:
    setting = 1e-6 if METHODS[name].adaptive else 0.01
    scene = rods(v=[1e200, -1e200])
    with pytest.raises(AccuracyError, match="t = ") as caught:
        solve_smooth(equations_of(scene), METHODS[name], np.array([0.0, 1.0]), setting)
    assert caught.value.where.startswith("t = 0")


def test_a_fixed_step_that_is_too_large_says_so_with_the_time_it_came_to() -> None:
    """Steps of 0.1 s on chaotic rods: sooner or later the implicit equations are not solved."""
    steps = step_map(equations_of(rods()), METHODS["implicit-midpoint"])
    with pytest.raises(AccuracyError, match="not finite") as caught:
        solve_smooth(steps.equations, steps.method, np.linspace(0, 60, 601), 0.1)
    assert 0 < float(caught.value.where.split()[2]) < 60
    assert "steps smaller than 0.1 s" in caught.value.remedy


def test_interrupting_keeps_the_samples_so_far() -> None:
    scene, times = arm(), np.linspace(0, 20, 2001)
    steps = step_map(equations_of(scene), METHODS["rk4"])
    whole = solve_smooth(steps.equations, steps.method, times, 0.005)
    seen: list[float] = []

    def stop(t: float) -> None:
        seen.append(t)
        if t > 5:
            raise KeyboardInterrupt

    try:
        part = solve_smooth(steps.equations, steps.method, times, 0.005, stop)
    except KeyboardInterrupt:
        pytest.fail("Ctrl-C got through, and the samples so far are lost")
    assert part.interrupted
    assert not whole.interrupted
    assert 5 < seen[-1] < 20
    assert 0.9 * seen[-1] < part.t[-1] <= seen[-1]
    assert part.x.shape == (4, len(part.t))
    np.testing.assert_array_equal(part.x, whole.x[:, : len(part.t)])


def test_samples_at_singular_instants_are_as_exact_as_others() -> None:
    """The links of two four-bars are level ten times in 10 s, where no stage of a step gives a number."""
    scene = load_scene("four-bar")
    times = np.linspace(0, 10, 20_001)
    found = solve_smooth(equations_of(scene), METHODS["dop853"], times, 1e-9)
    exact = solve_ivp(lambda _, y: [y[1], -3.5 / 3 * 9.81 * np.sin(y[0])], (0.0, 10.0), [np.pi, 1.0], method="DOP853",
                      t_eval=times, rtol=1e-13, atol=1e-13).y  # fmt: skip
    left = scene.robot.joints[0]
    assert np.abs(np.pi / 2 - found.x[left.q.start] - (exact[0] - np.pi)).max() < 1e-6
    assert np.abs(found.x[scene.robot.nq + left.v.start] + exact[1]).max() < 1e-6
