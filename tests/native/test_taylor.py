"""Taylor's method in numbers of 1, 2 and 3 doubles against mpmath: arithmetic, functions, recurrences, motions."""

import math
from collections.abc import Callable
from typing import Any

import mpmath as mp
import numpy as np
import pytest

from twolink.errors import TwolinkError
from twolink.integrate.digits import decimals, difference
from twolink.integrate.solvers.taylor import UNITS
from twolink.native import library, taylor
from twolink.native.instructions import OPERATIONS, QUADS, Assembled
from twolink.native.machine import Program, trace
from twolink.native.stepper import Disturbances
from twolink.native.taylor import Series

if library.library() is None:
    pytest.skip("there is no native library", allow_module_level=True)
LEVELS = range(library.level() + 1)
DIGITS = 90
Formula = Callable[[Any, Any, Any], Any]
NONE = np.zeros(0)


class Exact:
    """The namespace of mpmath."""

    sin, cos, exp, tanh, sqrt, atan2 = mp.sin, mp.cos, mp.exp, mp.tanh, mp.sqrt, mp.atan2
    power = staticmethod(lambda x, k: mp.power(x, mp.mpf(k)))
    less = staticmethod(lambda a, b: a < b)
    less_equal = staticmethod(lambda a, b: a <= b)
    where = staticmethod(lambda c, a, b: a if c else b)


OF_TWO: dict[str, Formula] = {
    "product": lambda x, y, _xp: x * y,
    "sum": lambda x, y, _xp: x + y,
    "difference": lambda x, y, _xp: x - y,
    "quotient": lambda x, y, _xp: x / y,
    "squares": lambda x, y, _xp: x * x + y * y,
    "sine": lambda x, _y, xp: xp.sin(x),
    "cosine": lambda x, _y, xp: xp.cos(x),
    "exponential": lambda x, _y, xp: xp.exp(x),
    "tanh": lambda x, _y, xp: xp.tanh(x),
    "small tanh": lambda x, _y, xp: xp.tanh(x * 1e-9),
    "root": lambda x, _y, xp: xp.sqrt(x * x),
    "angle": lambda x, y, xp: xp.atan2(x, y),
    "power": lambda x, _y, xp: xp.power(x * x, 1.3),
    "cube": lambda x, _y, xp: xp.power(x, 3.0),
    "sixth root below": lambda x, _y, xp: 1.0 / xp.power(x, -6.0),
}
OF_TIME: dict[str, Callable[[Any, Any], Any]] = {
    "quotient": lambda t, _xp: (1.0 + t) / (3.0 - t * t),
    "constant over": lambda t, _xp: 2.0 / (1.5 + t),
    "over constant": lambda t, _xp: (1.5 + t * t * t) / 3.0,
    "root": lambda t, xp: xp.sqrt(2.0 + t),
    "sine of square": lambda t, xp: xp.sin(1.0 + 2.0 * t + t * t),
    "cosine": lambda t, xp: xp.cos(3.0 * t) * (2.0 - t),
    "exponential": lambda t, xp: xp.exp(-2.0 * t * t + t),
    "tanh": lambda t, xp: xp.tanh(2.0 * t - 0.5),
    "angle": lambda t, xp: xp.atan2(1.0 + t, t * t - 2.0),
    "angle about a constant": lambda t, xp: xp.atan2(t - 0.5, 1.25),
    "power": lambda t, xp: xp.power(1.5 + t, 1.3),
    "square at 0": lambda t, xp: xp.power(t, 2.0),
    "inverse cube": lambda t, xp: xp.power(1.0 + t, -3.0),
    "root as power": lambda t, xp: xp.power(1.0 + t, 0.5),
    "one side": lambda t, xp: xp.where(xp.less(t, 100.0), xp.exp(t), t),
    "other side": lambda t, xp: xp.where(xp.less_equal(100.0, t), 7.0, t * t),
    "long sum": lambda t, _xp: 0.5 + t * t + t * (1.0 - t) - (t + 2.0) * (t * t - 3.0) + (1.0 + t) * (2.0 + t) * t,
}


def value(parts: Any) -> mp.mpf:
    """A number of parts by mpmath."""
    return mp.fsum(mp.mpf(float(x)) for x in parts)


def solved(
    formula: Any, x0: Any, times: Any, parts: int, order: int, longest: float = 1e9, **options: Any
) -> np.ndarray:
    """The states (n, size, parts) of x' = formula([t, x], xp)."""
    start = np.zeros((len(x0), parts))
    start[:, 0] = x0
    out = np.empty((len(times), *start.shape))
    rate = Program(trace(formula, 1 + len(start)))
    series = Series(rate, order, 0.0, start, NONE, longest)
    assert series.advance(np.array(times, dtype=float), out, 100_000, **options) == len(times)
    return out


@pytest.fixture(params=LEVELS)
def at_level(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(taylor, "level", lambda: request.param)
    return int(request.param)


@pytest.mark.parametrize("name", OF_TWO)
def test_functions_are_right_to_a_few_units(name: str, at_level: int) -> None:
    """x' = f(a b, c d) with constants, for 1 s: products of doubles have more digits than a double."""
    count, rng = 100, np.random.default_rng(at_level)
    numbers = rng.uniform(-3.0, 3.0, (4, count))

    def formula(z: Any, xp: Any) -> list[Any]:
        a, b, c, d = z[1 + count :].reshape(4, count)
        return [OF_TWO[name](a[i] * b[i], c[i] * d[i], xp) for i in range(count)]

    rate = Program(trace(formula, 1 + 5 * count))
    for parts in (1, 2, 3):
        out, start = np.empty((1, count, parts)), np.zeros((count, parts))
        Series(rate, 3, 0.0, start, numbers.ravel(), 1.0).advance(np.ones(1), out, 10)
        with mp.workdps(DIGITS):
            for found, (a, b, c, d) in zip(out[0], numbers.T, strict=True):
                x, y = mp.mpf(a) * mp.mpf(b), mp.mpf(c) * mp.mpf(d)
                exact = OF_TWO[name](x, y, Exact)
                size = abs(x) + abs(y) if name in ("sum", "difference", "sine", "cosine") else abs(exact)
                units = 12.0 if name in ("power", "sixth root below") else 5.0
                assert abs(value(found) - exact) <= units * UNITS[parts - 1] * (size + (1.0 if "sine" in name else 0.0))


@pytest.mark.parametrize("parts", [2, 3])
@pytest.mark.parametrize("angle", [0.0, 1e-20, math.pi / 2, math.pi, 22.0, 1e5, -355.0, 2.0**40, 123456789.123])
def test_angles_of_any_size_are_reduced_with_all_digits(angle: float, parts: int) -> None:
    rate = Program(trace(lambda z, xp: [xp.sin(z[3]), xp.cos(z[3])], 4))
    out = np.empty((1, 2, parts))
    Series(rate, 3, 0.0, np.zeros((2, parts)), np.array([angle]), 1.0).advance(np.ones(1), out, 10)
    with mp.workdps(DIGITS):
        for found, exact in zip(out[0], (mp.sin(mp.mpf(angle)), mp.cos(mp.mpf(angle))), strict=True):
            assert abs(value(found) - exact) <= 4.0 * UNITS[parts - 1] * abs(exact)


@pytest.mark.usefixtures("at_level")
@pytest.mark.parametrize("name", OF_TIME)
def test_every_recurrence_gives_the_series(name: str) -> None:
    """The integral of f(t) over a step of order 50, by mpmath's quadrature."""
    end = 0.0625
    with mp.workdps(60):
        exact = mp.quad(lambda t: OF_TIME[name](t, Exact), [0, end])
    for parts in (1, 2, 3):
        found = solved(lambda z, xp: [OF_TIME[name](z[0], xp)], [0.0], [end], parts, 50)[0, 0]
        with mp.workdps(60):
            assert abs(value(found) - exact) <= 8.0 * UNITS[parts - 1] * abs(exact)


@pytest.mark.parametrize("order", [3, 4, 7, 12])
def test_the_error_of_a_step_falls_with_its_order(order: int) -> None:
    """x' = x: of a step h, h^(p+1) / (p+1)! is missing."""
    for longest in (0.0625, 0.03125):
        found = solved(lambda z, _xp: [z[1]], [1.0], [longest], 3, order, longest)[0, 0]
        with mp.workdps(60):
            missing = mp.exp(mp.mpf(longest)) - value(found)
            first = mp.mpf(longest) ** (order + 1) / mp.factorial(order + 1)
            assert first < missing < 1.02 * first


@pytest.mark.usefixtures("at_level")
def test_a_pendulum_follows_elliptic_functions_to_45_digits() -> None:
    """theta'' = -sin theta from rest at 1 rad: sin(theta / 2) = k sn(K - t, k)."""
    times = [0.5, 3.0, 10.0]
    found = solved(lambda z, xp: [z[2], -xp.sin(z[1])], [1.0, 0.0], times, 3, 55)
    with mp.workdps(60):
        k = mp.sin(mp.mpf(1) / 2)
        for t, state in zip(times, found, strict=True):
            exact = 2 * mp.asin(k * mp.ellipfun("sn", mp.ellipk(k**2) - mp.mpf(t), m=k**2))
            assert abs(value(state[0]) - exact) < 1e-45


def test_samples_between_steps_and_blocks_of_steps_change_nothing() -> None:
    def formula(z: Any, xp: Any) -> list[Any]:
        return [z[2], -xp.sin(z[1]) + 0.1 * xp.cos(z[0])]

    times = np.linspace(0.0, 10.0, 101)
    whole = solved(formula, [1.0, 0.0], times, 2, 24)
    np.testing.assert_array_equal(solved(formula, [1.0, 0.0], times[::20], 2, 24), whole[::20])
    start = np.array([[1.0, 0.0], [0.0, 0.0]])
    series, out, done, calls = Series(Program(trace(formula, 3)), 24, 0.0, start, NONE, 1e9), whole * 0.0, 0, 0
    while done < len(times):
        done += series.advance(times[done:], out[done:], 1)
        calls += 1
    assert calls >= series.steps > 10
    np.testing.assert_array_equal(out, whole)


@pytest.mark.parametrize("parts", [1, 2, 3])
def test_disturbances_have_the_size_that_is_asked_for(parts: int) -> None:
    """x' = 0 in steps of 1 s: each adds r |x| and b x, and nothing where nothing moves."""
    table = np.array([[0.5, -0.25, 1.0], [0.25, 0.5, 1.0]])
    size, start = UNITS[parts - 1], [2.0, 0.01, 5.0]
    moves = np.array([[1.0], [1.0], [0.0]])
    given = Disturbances(table, np.array([4.0 * size]), np.array([size]), np.zeros(1, int), moves,
                         (0, 2, 2, 3), 0.1)  # fmt: skip
    states = solved(lambda z, _xp: [0.0 * z[1]] * 3, start, [0.5, 1.5], parts, 5, 1.0, disturbances=given)
    with mp.workdps(60):
        added = [
            [float((value(x) - mp.mpf(x0)) / size) for x, x0 in zip(row, (2.0, 0.01, 5.0), strict=True)]
            for row in states
        ]
    least = 0.1 * 2.0
    expected = np.cumsum([[0.5 * 4.0 * 2.0 + 2.0, -0.25 * 4.0 * least + 0.01, 0.0],
                          [0.25 * 4.0 * 2.0 + 2.0, 0.5 * 4.0 * least + 0.01, 0.0]], axis=0)  # fmt: skip
    np.testing.assert_allclose(added, expected, rtol=0, atol=2.1)  # the sum itself is rounded, to 2 |x|


def test_a_motion_that_is_not_finite_ends_with_its_time() -> None:
    """x' = x^2 has a pole at t = 1."""
    for parts in (1, 2, 3):
        series = Series(Program(trace(lambda z, _xp: [z[1] * z[1]], 2)), 20, 0.0, np.eye(1, parts), NONE, 1.0)
        out = np.empty((1, 1, parts))
        with pytest.raises(FloatingPointError):
            series.advance(np.array([2.0]), out, 1_000_000)
        assert series.t == pytest.approx(1.0)


def test_every_operation_has_a_recurrence_and_an_unknown_one_is_refused_by_name(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in OPERATIONS:
        row = [2, 1, 0] if name == "POWER" or name.endswith("_K") or name.startswith("K_") else [2, 1, 1]
        row += [1] * (4 * QUADS.get(name, 1) - 3)
        code = np.array([OPERATIONS.index(name), 1, 0, 0, *row], dtype=np.uint16)
        arrays = Assembled(2, 3, code, np.array([1.5]), NONE, NONE.astype(np.int32), np.array([2], dtype=np.int32), 1)
        Series(Program(arrays), 5, 0.0, np.full((1, 2), 0.5), NONE, 1.0)

    class Without:
        def tl_taylor_new(self, *_: Any) -> int:
            return taylor.NO_SERIES + OPERATIONS.index("TANH")

    rate = Program(trace(lambda z, xp: [xp.tanh(z[1])], 2))
    monkeypatch.setattr(taylor, "library", Without)
    with pytest.raises(TwolinkError, match="no recurrence for TANH"):
        Series(rate, 5, 0.0, np.zeros((1, 1)), NONE, 1.0)


@pytest.mark.parametrize("start", [math.nan, math.inf, 1e305])
def test_a_start_that_is_not_finite_or_too_large_is_refused(start: float) -> None:
    for parts in (1, 2, 3):
        with pytest.raises(FloatingPointError):
            solved(lambda z, _xp: [z[1]], [start], [1.0], parts, 10)


def test_disturbances_and_arrays_that_do_not_fit_are_refused() -> None:
    one = np.ones(1)
    given = Disturbances(np.ones((3, 2)), one, one, np.zeros(1, int), np.ones((2, 1)), (0, 1, 1, 2), 0.1)
    with pytest.raises(ValueError, match="disturbances of"):
        solved(lambda z, _xp: [z[1]], [1.0], [1.0], 1, 10, disturbances=given)
    series = Series(Program(trace(lambda z, _xp: [z[1]], 2)), 10, 0.0, np.ones((1, 2)), NONE, 1.0)
    for shape in ((1, 1, 1), (0, 1, 2)):
        with pytest.raises(ValueError, match="for an array of"):
            series.advance(np.ones(1), np.empty(shape), 10)


@pytest.mark.parametrize(("x", "constants"), [(np.zeros((2, 1)), NONE), (np.zeros((1, 1)), np.ones(1))])
def test_starts_that_do_not_fit_are_refused(x: np.ndarray, constants: np.ndarray) -> None:
    with pytest.raises(ValueError, match="a rate of 2 inputs"):
        Series(Program(trace(lambda z, xp: [xp.tanh(z[1])], 2)), 5, 0.0, x, constants, 1.0)


@pytest.mark.parametrize(
    ("order", "longest", "parts"), [(2, 1.0, 1), (1000, 1.0, 1), (5, 0.0, 1), (5, math.nan, 1), (5, 1.0, 4)]
)
def test_orders_steps_and_numbers_out_of_bounds_are_refused(order: int, longest: float, parts: int) -> None:
    with pytest.raises(TwolinkError, match="out of bounds"):
        Series(Program(trace(lambda z, _xp: [z[1]], 2)), order, 0.0, np.zeros((1, parts)), NONE, longest)


def test_many_digits_as_decimals_and_differences() -> None:
    x = np.array([[1.0, 1e-17, 1e-34], [-2.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    assert [str(d) for d in decimals(x)[1:]] == ["-2", "0"]
    assert abs(mp.mpf(str(decimals(x)[0])) - 1) < 1.1e-17
    with mp.workdps(60):
        assert abs(mp.mpf(str(decimals(x)[0])) - value(x[0])) < 1e-47
    y = np.array([[1.0 + 2.0**-52, -(2.0**-52), 1e-34 + 1e-47]])
    assert float(difference(y, x[:1])[0]) == pytest.approx(-1e-17, rel=1e-15)
    assert np.isnan(difference(np.full((1, 2), np.inf), np.zeros((1, 2)))).all()
