"""Each method's own order is the one that is observed: by halving its steps until rounding ends it."""

import itertools

import numpy as np
import pytest

from tests.integrate.problems import BOX_END, GRAVITY, arm, attempted, box, random_states, tight
from twolink.integrate.motion.scene_equations import equations_of
from twolink.integrate.solvers import taylor
from twolink.integrate.steps.methods import METHODS, Method
from twolink.integrate.steps.step_control import control_rows, initial_state
from twolink.integrate.steps.step_map import StepMap, step_map
from twolink.scenes import Scene

OURS = [m for m in METHODS.values() if m.kind in ("semi-implicit", "explicit", "implicit")]
EVERY = pytest.mark.parametrize("method", OURS, ids=lambda m: m.name)
ROUNDING = 1e-12  # errors below it are made of rounding as much as of the method
MOST = {1: 2048, 2: 1024, 3: 1024, 4: 512, 5: 512, 8: 512}  # steps, by order


def final(steps: StepMap, x: np.ndarray, n: int, duration: float) -> np.ndarray:
    """Worlds x (size, worlds) after n equal steps: adaptive methods take theirs at the tolerance inf, as samples do."""
    times, each = np.linspace(0, duration, n + 1), np.ones(x.shape[1])
    for start, end in itertools.pairwise(times):
        x = steps.partial(x, start * each, end * each)
    return x


def observed(method: Method, scene: Scene, x: np.ndarray, truth: np.ndarray, rows: slice, duration: float) -> list:
    """log2 of the ratios of errors at n and 2 n steps, down to rounding. Errors of several worlds in the mean: that of
    a single one changes its sign at some step size, and shows any order there."""
    steps = step_map(equations_of(scene), method)
    errors, n = [], 4
    while n <= MOST[method.order]:
        error = np.sqrt(np.mean((final(steps, x, n, duration)[rows] - truth[rows]) ** 2))
        if error < ROUNDING:
            break
        if np.isfinite(error):  # steps that are too large for an implicit method have no answer
            errors.append(error)
        n *= 2
    return np.log2(np.divide(errors[:-1], errors[1:])).tolist()


@EVERY
def test_order_on_the_arm(method: Method) -> None:
    """Eight swings about the hanging arm, with no symmetry. Order 8 needs small ones for long: in large ones the terms
    of order 10 and more, which its coefficients do not suppress, are above those of order 9 down to rounding."""
    size, duration = (0.02, 10.0) if method.order == 8 else (0.5, 2.0)
    scene = arm()
    x = np.array([[-np.pi / 2], [0], [0], [0]]) + size * np.random.default_rng(0).uniform(-1, 1, (4, 8))
    ends = [tight(Scene(scene.robot, c[:2], c[2:], GRAVITY), np.array([0, duration]))[:, -1] for c in x.T]
    orders = observed(method, scene, x, np.array(ends).T, slice(None), duration)
    assert len(orders) >= 2
    assert orders[-1] == pytest.approx(method.order, abs=0.2), orders


@pytest.mark.some(4)
@EVERY
def test_order_on_a_body_that_tumbles(method: Method) -> None:
    """The quaternion is scaled to length 1 after each step, which must not cost an order."""
    scene = box()
    truth = tight(scene, np.array([0, 1.0]))[:, -1:]
    np.testing.assert_allclose(truth[10:, 0], BOX_END, rtol=0, atol=1e-14)
    for rows in (slice(0, 7), slice(10, 13)):
        orders = observed(method, scene, equations_of(scene).start[:, None], truth, rows, 1.0)
        assert len(orders) >= 2
        assert orders[-1] == pytest.approx(method.order, abs=0.2), orders


@pytest.mark.parametrize("method", [m for m in OURS if m.tableau and m.tableau.errors], ids=lambda m: m.name)
def test_the_error_estimate_goes_as_the_control_believes(method: Method) -> None:
    """The control takes the estimate for h^error_order: with another order it over- or undershoots, and steps are
    refused in turns. The estimate of a step is the smallest tolerance that admits it."""
    scene = arm()
    steps = step_map(equations_of(scene), method)
    x = random_states(scene.robot, 64)
    estimates = [np.sqrt(np.mean(_smallest_admitted(steps, x, h) ** 2)) for h in (0.1, 0.05, 0.025)]
    orders = np.log2(np.divide(estimates[:-1], estimates[1:]))
    assert orders[-1] == pytest.approx(method.error_order, abs=0.5), orders


def _smallest_admitted(steps: StepMap, x: np.ndarray, h: float) -> np.ndarray:
    """The smallest tolerances (worlds,) at which steps of h from x are admitted, by bisection."""
    low, high = np.full(x.shape[1], 1e-16), np.full(x.shape[1], 1e3)
    for _ in range(60):
        middle = np.sqrt(low * high)
        out = attempted(steps, initial_state(x, 0.0, h, h, middle))
        admitted = out[control_rows(len(x)).accepted] == 1
        low, high = np.where(admitted, low, middle), np.where(admitted, middle, high)
    return high


def test_taylors_error_falls_with_its_tolerance() -> None:
    """Each digit of the tolerance is a digit of the answer, until the digits of a double end."""
    scene = arm()
    times = np.array([0, 2.0])
    truth = tight(scene, times)[:, -1]
    tolerances = [1e-3, 1e-5, 1e-7, 1e-9, 1e-11]
    errors = [np.abs(taylor.solve(equations_of(scene), times, t).x[:, -1] - truth).max() for t in tolerances]
    slope = np.polyfit(np.log10(tolerances), np.log10(errors), 1)[0]
    assert slope == pytest.approx(1.0, abs=0.25)
    assert np.all(np.array(errors) < 10 * np.array(tolerances))
    assert np.abs(taylor.solve(equations_of(scene), times, 1e-15).x[:, -1] - truth).max() < 1e-13
