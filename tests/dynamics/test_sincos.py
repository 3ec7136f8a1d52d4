"""Our sine and cosine against exact arithmetic, as NumPy runs them and as heyoka compiles them."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import mpmath
import numpy as np
import pytest

from twolink.algorithms.namespaces import Expressions
from twolink.algorithms.sincos import LIMIT, sin_cos

Pair = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
BOUND = 4e-16
POINTS = 1500


@pytest.fixture(scope="module")
def x() -> Any:
    return pytest.importorskip("heyoka").expression("x")


@pytest.fixture(scope="module", params=["numpy", "default", "scalar"])
def pair(request: pytest.FixtureRequest) -> Pair:
    if request.param == "numpy":
        return sin_cos
    hy = pytest.importorskip("heyoka")
    x = hy.expression("x")
    options = {"batch_size": 1} if request.param == "scalar" else {}
    traced = Expressions(hy, own_sine=True)
    compiled = hy.cfunc([traced.sin(x), traced.cos(x)], vars=[x], **options)
    return lambda points: tuple(compiled(np.ascontiguousarray(points[None])))


def adversarial(limit: float, rng: np.random.Generator) -> np.ndarray:
    """The doubles nearest to multiples of pi / 4, their neighbours, and points at all distances from them."""
    with mpmath.workdps(40):
        quarter = mpmath.pi / 4
        last = int(limit / quarter)
        nearest = np.array([float(int(k) * quarter) for k in rng.integers(-last, last + 1, POINTS)])
    steps = [nearest + n * np.spacing(np.abs(nearest)) for n in (-2, -1, 0, 1, 2)]
    distances = rng.normal(size=POINTS) * 10.0 ** rng.uniform(-16, 0, POINTS)
    return np.clip(np.concatenate([*steps, nearest + distances]), -limit, limit)


def errors(points: np.ndarray, pair: Pair) -> tuple[float, float]:
    """The largest absolute errors of the sine and the cosine."""
    with mpmath.workdps(40):
        exact = [mpmath.cos_sin(mpmath.mpf(p)) for p in points.tolist()]
        answers = zip(*(a.tolist() for a in pair(points)), exact, strict=True)
        off = [(abs(s - sine), abs(c - cosine)) for s, c, (cosine, sine) in answers]
    return float(max(s for s, _ in off)), float(max(c for _, c in off))


@pytest.mark.slow
@pytest.mark.parametrize("limit", [math.pi / 2, 10.0, 1e3, 1e5, LIMIT])
def test_error_stays_within_its_bound(pair: Pair, limit: float) -> None:
    rng = np.random.default_rng(1)
    points = np.concatenate([rng.uniform(-limit, limit, 4 * POINTS), adversarial(limit, rng), [-limit, limit]])
    assert max(errors(points, pair)) <= BOUND


def test_error_where_the_cosine_vanishes(pair: Pair) -> None:
    """The worst place: the cosine is 1 less almost 1, and k jumps."""
    assert max(errors(np.linspace(1.5, 1.65, 4 * POINTS), pair)) <= BOUND


def test_zero_is_exact(pair: Pair) -> None:
    sine, cosine = pair(np.array([0.0, -0.0]))
    assert (sine == 0.0).all()
    assert (cosine == 1.0).all()


def test_small_angles_keep_their_digits(pair: Pair) -> None:
    points = 10.0 ** np.linspace(-300, -9, 50)
    sine, cosine = pair(points)
    assert (sine == points).all()
    assert (cosine == 1.0).all()


def test_odd_and_even(pair: Pair) -> None:
    rng = np.random.default_rng(2)
    points = np.concatenate([rng.uniform(0, LIMIT, POINTS), adversarial(LIMIT, rng)])
    (sine, cosine), (back, same) = pair(points), pair(-points)
    assert (sine == -back).all()
    assert (cosine == same).all()


def test_nan_and_infinity_give_nan(pair: Pair) -> None:
    with np.errstate(invalid="ignore"):
        answers = pair(np.array([math.nan, math.inf, -math.inf]))
    assert np.isnan(answers).all()


def test_one_float() -> None:
    assert sin_cos(0.5) == pytest.approx((math.sin(0.5), math.cos(0.5)), abs=BOUND)


def test_sine_and_cosine_share_the_reduction(x: Any) -> None:
    hy = pytest.importorskip("heyoka")

    def steps(*outputs: Any) -> int:
        return len(hy.cfunc(list(outputs), vars=[x]).dc)

    traced = Expressions(hy, own_sine=True)
    alone = steps(traced.sin(x)) + steps(traced.cos(x))
    both = steps(traced.sin(x), traced.cos(x))
    assert both == steps(*sin_cos(x))
    assert both <= alone - 17  # the reduction's operations


def test_square_root(x: Any) -> None:
    hy = pytest.importorskip("heyoka")
    assert hy.cfunc([Expressions(hy, own_sine=True).sqrt(x)], vars=[x])(np.array([2.0]))[0] == math.sqrt(2.0)
