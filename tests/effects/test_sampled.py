"""Tables: what lies between and beyond their samples, and no step across a knot, by every kind of solver."""

import itertools
import pickle
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import BPoly, CubicSpline

import twolink as tl
from tests.effects.bodies import solved
from tests.effects.cases import E, assert_refused, robot
from tests.effects.test_closed_forms import wheel
from tests.near import assert_near, assert_within
from twolink.effects.inputs import derivatives_at, value_at
from twolink.errors import AccuracyError, SceneError
from twolink.integrate.motion.scene_equations import equations_of
from twolink.integrate.steps.methods import METHODS
from twolink.integrate.steps.step_map import step_map
from twolink.integrate.steps.stepping import integrate_many

KNOTS, VALUES = np.array([0.1, 0.4, 0.5, 1.0, 1.3]), np.array([1.0, -2.0, 3.0, 3.5, 0.5])
TIMES = np.linspace(-0.2, 1.6, 400)
INSIDE = (TIMES >= 0.1) & (TIMES < 1.3)


@pytest.mark.parametrize("interpolation", ["linear", "cubic", "hold"])
@pytest.mark.parametrize("beyond", ["hold", "zero", "error"])
def test_values(interpolation: str, beyond: str) -> None:
    table = E.Sampled(KNOTS, VALUES, interpolation=interpolation, beyond=beyond)
    found = np.asarray(value_at(table, TIMES, np))
    spline = CubicSpline(KNOTS, VALUES)
    expected = {
        "linear": np.interp(TIMES, KNOTS, VALUES),
        "cubic": spline(TIMES),
        "hold": VALUES[np.clip(np.searchsorted(KNOTS, TIMES, side="right") - 1, 0, None)],
    }[interpolation]
    assert_near(found[INSIDE], expected[INSIDE], 1e-13)
    outside = {"hold": (1.0, 0.5), "zero": (0.0, 0.0), "error": (np.nan, np.nan)}[beyond]
    assert np.array_equal(found[TIMES < 0.1], np.full((TIMES < 0.1).sum(), outside[0]), equal_nan=True)
    assert np.array_equal(found[TIMES >= 1.3], np.full((TIMES >= 1.3).sum(), outside[1]), equal_nan=True)
    if interpolation == "cubic":
        for k, one in enumerate(derivatives_at(table, TIMES[INSIDE], np)):
            assert_near(one, spline(TIMES[INSIDE], k), 1e-10)


@pytest.mark.parametrize("given", [2.0, E.Polynomial((1.0, -2.0, 0.5, 3.0)), E.Sine(2.0, 3.0, 0.4, 1.0),
                                   E.Bezier((1.0, -2.0, 0.5, 3.0, 1.0), 0.8)])  # fmt: skip
def test_derivatives(given: object) -> None:
    t, h = np.linspace(0, 1, 7), 1e-4
    value, first, second = (np.broadcast_to(x, t.shape) for x in derivatives_at(given, t, np))
    before, here, after = (value_at(given, t + d, np) * np.ones(7) for d in (-h, 0, h))
    assert_near(value, here, 1e-14)
    assert_near(first, (after - before) / (2 * h), 1e-6)
    assert_near(second, (after - 2 * here + before) / h**2, 1e-5)


def test_a_curve_of_control_points_is_bernsteins() -> None:
    points, t = (0.3, -1.0, 2.0, 0.5, 0.25, 4.0), np.linspace(0, 1.5, 9)
    ours = value_at(E.Bezier(points, 1.5), t, np)
    assert_near(ours, BPoly(np.array(points)[:, None], [0.0, 1.5])(t), 1e-14)


def exact(interpolation: str, t: np.ndarray) -> np.ndarray:
    """The wheel's angle from rest under the table as a torque, I = 0.5, by integrating polynomials twice."""
    fine = E.Sampled(KNOTS, VALUES, interpolation=interpolation)
    edges = np.unique(np.concatenate([[0.0], KNOTS, t]))
    q, v, out = 0.0, 0.0, {0.0: 0.0}
    nodes, weights = np.polynomial.legendre.leggauss(6)
    for a, b in itertools.pairwise(edges):
        s = a + (b - a) * (nodes + 1) / 2
        torque = np.asarray(value_at(fine, s, np)) * np.ones(6) / 0.5
        q += v * (b - a) + (b - a) / 2 * (weights * (b - s)) @ torque
        v += (b - a) / 2 * weights @ torque
        out[b] = q
    return np.array([out[x] for x in t])


@pytest.mark.slow
@pytest.mark.parametrize("method", ["dop853", "rk45", "rk4", "esdirk43", "taylor", "scipy-dop853", "scipy-lsoda"])
@pytest.mark.parametrize("interpolation", ["linear", "cubic", "hold"])
def test_a_wheel_driven_by_a_table(interpolation: str, method: str) -> None:
    """Between knots the motion is a polynomial of degree 5 at most: a step across a jump would be off by 1e-4."""
    drive = E.Torque({"axle": E.Sampled(KNOTS, VALUES, interpolation=interpolation)})
    step = {"step": 0.02} if not METHODS[method].adaptive else {"tolerance": 1e-9}
    run = tl.simulate(tl.Scene(wheel(), effects=[drive]), 1.6, method=method, samples_per_second=13, **step)
    assert len(run.t) == 22
    assert run.t[-1] == 1.6
    error = np.abs(run.q[:, 0] - exact(interpolation, run.t))
    assert error.max() < (2e-8 if METHODS[method].adaptive else 1e-6)
    assert np.all(error <= run.error + 1e-13)


def test_samples_at_and_beside_breaks_and_quadruple_precision() -> None:
    drive = E.Torque({"axle": E.Sampled((0.0, 0.5, 1.0), (1.0, -1.0, 1.0), interpolation="hold")})
    scene = tl.Scene(wheel(), effects=[drive])
    run = tl.simulate(scene, 1.5, accuracy=1e-10, samples_per_second=4)
    assert_near(run.q[:, 0], [0, 0.0625, 0.25, 0.4375, 0.5, 0.5625, 0.75], 1e-10)
    precise = tl.simulate(scene, 1.5, accuracy=1e-25, precision="quad", samples_per_second=4)
    assert abs(float(precise.precise[-1][0] - precise.precise[0][0]) - 0.75) < 1e-15
    assert precise.error[-1] <= 1e-25


@pytest.mark.slow
def test_long_tables_share_one_compiled_step_and_their_bars_hold() -> None:
    """Where each piece is hardly a step, two tolerances must still take different ones: else the bar would be 0."""
    knots = np.linspace(0, 1, 501)
    table = E.Sampled(knots, 3 * np.sin(5 * knots), interpolation="cubic")
    scene = tl.Scene(robot("arm"), [0.2, 0.4], effects=[E.Gravity(), E.Torque({"elbow": table})])
    truth = tl.simulate(scene, 1.0, method="taylor", tolerance=1e-17, samples_per_second=10).q
    smooth = [E.Gravity(), E.Torque({"elbow": E.Sine(3.0, 5.0)})]
    other = solved(scene.robot, smooth, 1.0, scene.q, accuracy=1e-11, samples_per_second=10)
    assert_near(other.q, truth, 1e-9)  # what the spline leaves
    for method in ("dop853", "rk23"):
        run = tl.simulate(scene, 1.0, accuracy=1e-6, method=method, samples_per_second=10)
        assert run.cost.steps >= 500
        assert_within(run.q, truth, run.error + 1e-13)


def test_one_table_in_two_effects_is_one_set_of_rows() -> None:
    table = E.Sampled(KNOTS, VALUES)
    drives = [E.Torque({"shoulder": table}), E.FrameWrench("tip", (table, 0.0, E.Sampled(KNOTS, VALUES)))]
    equations = equations_of(tl.Scene(robot("arm"), effects=drives))
    assert equations.space.size - equations.moving == 2 * table.rows == 6
    assert equations.breaks(1.0) == (0.1, 0.4, 0.5)


def test_many_worlds_end_steps_at_breaks() -> None:
    drive = E.Torque({"axle": E.Sampled(KNOTS, VALUES, interpolation="hold")})
    equations = equations_of(tl.Scene(wheel(), effects=[drive]))
    x0 = np.array([[0.0, 1.0, 2.0], [0.0, 0.0, 0.0]])
    times = np.array([0.0, 0.45, 1.6])
    for name, setting in (("dop853", 1e-9), ("rk4", 0.01)):
        found, steps, _ = integrate_many(step_map(equations, METHODS[name]), x0, times, setting)
        assert found.shape == (3, 2, 3)
        assert np.all(steps >= 6)
        expected = exact("hold", times)[:, None] + x0[0]
        assert_near(found[:, 0], expected, 1e-8)


def test_fixed_steps_longer_than_a_piece_are_refused_and_error_beyond_is_one() -> None:
    table = E.Sampled(np.linspace(0, 1, 101), np.zeros(101), beyond="error")
    scene = tl.Scene(wheel(), v=[1.0], effects=[E.Torque({"axle": table})])
    with pytest.raises(AccuracyError, match=r"step: .*longer than 0.01 s"):
        tl.simulate(scene, 1.0, method="rk4", step=0.02)
    assert tl.simulate(scene, 1.0, method="rk4", step=0.005).t[-1] == 1.0
    with pytest.raises(SceneError, match=r"from 0 to 1 s, the run from 0 to 1.5 s"):
        tl.simulate(scene, 1.5)
    with pytest.raises(SceneError, match=r"from 0 to 1 s, the run from 0 to 1.5 s"):
        tl.simulate_many(scene, duration=1.5)


def test_files(tmp_path: Path) -> None:
    path = tmp_path / "torque.csv"
    path.write_text("t [s],tau\n# a comment\n0,1.5\n\n0.5, -2\n")
    table = E.Sampled(file=str(path))
    assert (table.times, table.values) == ((0.0, 0.5), (1.5, -2.0))
    path.unlink()
    assert pickle.loads(pickle.dumps(table)) == table
    bad = {"0,1\n1,2,3\n": ":2: expected two numbers", "0,1\nx,2\n": ":2: expected two", "": "at one least"}
    for text, part in bad.items():
        path.write_text(text)
        with pytest.raises(SceneError, match=part.replace("at one least", "as many values as times")):
            tl.Scene(wheel(), effects=[E.Torque({"axle": E.Sampled(file=str(path))})])
    with pytest.raises(SceneError, match="cannot be read: No such file"):
        E.Sampled(file=str(tmp_path / "none.csv"))
    with pytest.raises(SceneError, match="both a file and samples"):
        E.Sampled((0.0,), (1.0,), file="x.csv")


@pytest.mark.parametrize(("table", "where", "part"), [
    (E.Sampled((0.0, 1.0), (1.0,)), "inputs.axle", "as many values as times"),
    (E.Sampled((0.0, 1.0, 1.0), (1.0, 2.0, 3.0)), "inputs.axle.times", "increase; at 2 1 follows 1"),
    (E.Sampled((0.0, float("nan")), (1.0, 2.0)), "inputs.axle.times", "finite"),
    (E.Sampled((0.0,), (float("inf"),)), "inputs.axle.values", "finite"),
    (E.Sampled((0.0,), (1.0,), interpolation="cubik"), "inputs.axle.interpolation", "mean 'cubic'"),
    (E.Sampled((0.0,), (1.0,), beyond="none"), "inputs.axle.beyond", "'none' is unknown"),
])  # fmt: skip
def test_tables_that_are_refused(table: E.Sampled, where: str, part: str) -> None:
    assert_refused(wheel(), E.Torque({"axle": table}), where, part)


@pytest.mark.parametrize("interpolation", ["linear", "cubic", "hold"])
def test_one_sample_is_a_constant(interpolation: str) -> None:
    drive = E.Torque({"axle": E.Sampled((0.5,), (1.0,), interpolation=interpolation)})
    run = solved(wheel(), [drive], 1.0, accuracy=1e-10)
    assert abs(run.q[-1, 0] - 1.0) < 1e-10


def test_the_error_bar_of_a_table_costs_no_steps() -> None:
    """Where steps are longer than the time between two checks, solutions pass these."""
    drive = E.Torque({"shoulder": E.Sampled((0.7, 1.6), (1.0, -0.5), interpolation="hold")})
    run, alone, finer = (
        solved(robot("two_link"), [drive], 2.0, [0.3, -0.4], accuracy=accuracy, verify=verify, method="dop853")
        for accuracy, verify in ((1e-6, True), (1e-6, False), (1e-11, False))
    )
    assert run.cost.steps <= alone.cost.steps + 2 < 60  # there are 101 checks
    assert_within(run.q, finer.q, run.error)
    assert run.error[-1] < 1e-6
