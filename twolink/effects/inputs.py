"""Inputs: what a scene gives as a function of time, by a formula or by a table of samples."""

from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import Any, ClassVar, TypeVar

import msgspec

from twolink.algorithms.spatial import Scalar, minus, plus, times
from twolink.effects.effect import Effect, number
from twolink.effects.sampled import Piece, Sampled
from twolink.errors import SceneError

_E = TypeVar("_E", bound=Effect)
SAME_TIME = 1e-12  # relative: an end that differs by rounding


class Polynomial(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="polynomial"):
    """c0 + c1 t + c2 t^2 + ...

    Parameters
    ----------
    coefficients : tuple of float
        c0, c1, ...; t in seconds from the start.
    """

    coefficients: tuple[float, ...]


class Sine(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="sine"):
    """mean + amplitude sin(frequency t + phase), with an angular frequency.

    Parameters
    ----------
    amplitude, mean : float
        In the unit of the input.
    frequency : float
        Angular frequency, rad/s, not Hz: 2 pi times the oscillations a second.
    phase : float
        rad.
    """

    amplitude: float
    frequency: float
    phase: float = 0.0
    mean: float = 0.0


class Bezier(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="bezier"):
    """A polynomial by its control points: sum_i C(n, i) s^i (1 - s)^(n - i) p_i, s = t / duration.

    Parameters
    ----------
    points : tuple of float
        p_0, ..., p_n, in the unit of the input.
    duration : float
        Of the way from p_0 to p_n, s, above 0. A longer run is refused.

    Notes
    -----
    It stays between the least and the greatest of its points, and begins and ends at rest where three are equal at
    either end: (a, a, a, b, b, b) is the path of least jerk. Sensitivities and `tl.optimize` follow its points.

    References
    ----------
    Farin, Curves and Surfaces for CAGD, 2002, chapters 4 and 5. Flash, Hogan 1985, Journal of Neuroscience 5(7).
    """

    points: tuple[float, ...]
    duration: float


class Slot(msgspec.Struct, frozen=True, tag_field="kind", tag="slot"):
    """A number that is constant between events and not known before: it is a row of the state."""

    name: str

    rows: ClassVar[int] = 1
    times: ClassVar[tuple[float, ...]] = ()  # of knots

    def piece_of(self, rows: Any) -> Any:
        """The number."""
        return rows[0]


Input = float | Polynomial | Bezier | Sine | Sampled


def value_at(signal: Input | Piece, t: Scalar, xp: Any) -> Scalar:
    """The input at time t. A table is looked up at numbers; in expressions its current piece stands for it."""
    if isinstance(signal, Sine):
        return plus(times(number(signal.amplitude), xp.sin(signal.frequency * t + signal.phase)), number(signal.mean))
    return _polynomial(*_series(signal, t))


def derivatives_at(signal: Input | Piece, t: Scalar, xp: Any) -> tuple[Scalar, Scalar, Scalar]:
    """The input and its first and second derivatives at time t."""
    if isinstance(signal, Sine):
        a, w, angle = number(signal.amplitude), number(signal.frequency), signal.frequency * t + signal.phase
        oscillating = xp.sin(angle)
        value = plus(times(a, oscillating), number(signal.mean))
        return value, times(a * w, xp.cos(angle)), times(-a * w * w, oscillating)
    coefficients, t = _series(signal, t)
    once = _derivative(coefficients)
    return _polynomial(coefficients, t), _polynomial(once, t), _polynomial(_derivative(once), t)


def _series(signal: Any, t: Scalar) -> tuple[list[Scalar], Scalar]:
    """The coefficients of a number, a polynomial or a piece of a table, and the time that they are of."""
    piece = signal.piece_at(t) if isinstance(signal, Sampled) else signal
    if isinstance(piece, Piece):
        return list(piece.coefficients), t - piece.start
    if isinstance(piece, Bezier):
        return _powers(piece), t
    return [number(c) for c in (piece.coefficients if isinstance(piece, Polynomial) else (piece,))], t


def _powers(curve: Bezier) -> list[Scalar]:
    """The coefficients of 1, t, t^2, ...: C(n, k) D^k p_0 / T^k, D the forward difference."""
    differences, rate = [number(point) for point in curve.points], 1.0 / number(curve.duration)
    factor: Scalar = 1.0
    coefficients = []
    for k in range(len(differences)):
        coefficients.append(times(factor, differences[0]))
        factor = times(factor, (len(curve.points) - 1 - k) / (k + 1) * rate)
        differences = [minus(after, before) for before, after in pairwise(differences)]
    return coefficients


def check_curve(curve: Bezier, field: str) -> None:
    """Require points and a duration. Raises SceneError."""
    if not curve.points:
        raise SceneError("expected control points, got none", where=f"{field}.points", remedy="such as (0.0, 0.0, 1.0)")
    if not curve.duration > 0.0:
        raise SceneError(f"expected a duration above 0 s, got {curve.duration!r}", where=f"{field}.duration",
                         remedy="give the time from the first point to the last")  # fmt: skip


def _polynomial(coefficients: Any, t: Scalar) -> Scalar:
    """c0 + c1 t + ..., by Horner's rule."""
    value: Scalar = 0.0
    for coefficient in reversed(coefficients):
        value = plus(times(value, t), coefficient)
    return value


def _derivative(coefficients: list[Scalar]) -> list[Scalar]:
    return [times(float(k), c) for k, c in enumerate(coefficients)][1:]


def require_curves(signal: Any, end: float) -> None:
    """Require that the curves in an effect, or in one of its fields, reach to a time. Raises SceneError."""
    if isinstance(signal, Bezier):
        if end > signal.duration * (1.0 + SAME_TIME):
            raise SceneError(f"a curve ends at {signal.duration:g} s, the run at {end:g} s",
                             where="effects: bezier input", remedy="give it the duration of the run, or a shorter run",
                             code="curve-ends")  # fmt: skip
    elif isinstance(signal, Effect):
        for name in signal.__struct_fields__:
            require_curves(getattr(signal, name), end)
    elif isinstance(signal, (Mapping, tuple, list)):
        for value in signal.values() if isinstance(signal, Mapping) else signal:
            require_curves(value, end)


def tables_of(effect: Effect) -> list[Sampled | Slot]:
    """The tables and slots among an effect's inputs, in the order of its fields."""
    tables: list[Sampled | Slot] = []

    with_pieces(effect, tables.append)
    return tables


def with_pieces(effect: _E, piece: Callable[[Sampled | Slot], Any]) -> _E:
    """The effect with a polynomial in the place of each table, and a number in that of each slot."""
    fields = {name: getattr(effect, name) for name in effect.__struct_fields__}
    return msgspec.structs.replace(effect, **_replaced(fields, piece))


def _replaced(signal: Any, change: Callable[[Sampled | Slot], Any]) -> Any:
    if isinstance(signal, (Sampled, Slot)):
        return change(signal)
    if isinstance(signal, Mapping):
        return {key: _replaced(value, change) for key, value in signal.items()}
    if isinstance(signal, (tuple, list)):
        return tuple(_replaced(value, change) for value in signal)
    return signal
