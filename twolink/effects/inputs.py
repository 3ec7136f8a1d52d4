"""Inputs: what a scene gives as a function of time, by a formula or by a table of samples."""

import bisect
import functools
import math
from collections.abc import Callable, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, TypeVar

import msgspec
import numpy as np

from twolink.algorithms.spatial import Scalar, minus, plus, times
from twolink.effects.effect import Effect, number, quantity
from twolink.errors import SceneError
from twolink.io.tables import csv_rows
from twolink.io.text import parse_number, read_text

Array = np.ndarray[Any, np.dtype[np.float64]]
MAX_BYTES = 2**28
DEGREES = {"hold": 0, "linear": 1, "cubic": 3}


class PolynomialPiece(NamedTuple):
    """c0 + c1 (t - start) + ...: a table between two of its knots."""

    start: Scalar
    coefficients: tuple[Scalar, ...]


class Sampled(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True, dict=True, tag_field="kind",
    tag="sampled",
):  # fmt: skip
    """A table of samples, and what lies between and beyond them.

    Parameters
    ----------
    times : tuple of float
        Seconds from the start, increasing.
    values : tuple of float
        One a time.
    file : str, optional
        A CSV file with the two columns instead, read when the input is made; a first line without numbers is a
        header, `#` begins a comment. In a scene file, the path starts from that file's folder.
    interpolation : {"linear", "cubic", "hold"}
        "hold": each value until the next time. "cubic": the spline with continuous second derivative (not-a-knot, as
        SciPy's CubicSpline).
    beyond : {"hold", "zero", "error"}
        Before the first time, and from the last one on where the run goes on: the value there, 0, or a refusal.

    Notes
    -----
    The integrator ends a step at every time of the table, so that no step crosses what is not smooth.
    """

    times: tuple[float, ...] = ()
    values: tuple[float, ...] = ()
    file: str | None = None
    interpolation: Literal["linear", "cubic", "hold"] = "linear"
    beyond: Literal["hold", "zero", "error"] = "hold"

    def __post_init__(self) -> None:
        times, values = self.times, self.values
        if self.file is not None:
            if len(times) or len(values):
                raise SceneError("both a file and samples are given", where="sampled", remedy="give one")
            times, values = _read(Path(self.file))
        for name, numbers in (("times", times), ("values", values)):
            plain = tuple(np.asarray(numbers).tolist()) if isinstance(numbers, np.ndarray) else numbers
            msgspec.structs.force_setattr(self, name, tuple(plain))
        msgspec.structs.force_setattr(self, "file", None)  # what was read is all there is: copies need no file

    @property
    def rows(self) -> int:
        """The count of numbers that make a piece: its coefficients, and its start if that matters."""
        degree = DEGREES[self.interpolation]
        return degree + 2 if degree else 1

    def piece_of(self, rows: Any) -> PolynomialPiece:
        """The piece made of so many numbers, or symbols."""
        return PolynomialPiece(rows[0], tuple(rows[1:])) if len(rows) > 1 else PolynomialPiece(0.0, tuple(rows))

    def rows_at(self, t: float) -> Array:
        """The numbers of the piece that holds at time t, (rows,)."""
        return np.asarray(self._pieces[bisect.bisect_right(self.times, t)])

    def piece_at(self, t: Scalar) -> PolynomialPiece:
        """The piece that holds at time t, or from it on; of an array of times, the piece of each."""
        at = np.searchsorted(self._knots, np.asarray(t, dtype=float), side="right")
        return self.piece_of(np.moveaxis(self._pieces[at], -1, 0))

    @functools.cached_property
    def _knots(self) -> Array:
        return np.array(self.times, dtype=float)

    @functools.cached_property
    def _pieces(self) -> Array:
        """The numbers of the pieces (n + 1, rows): n - 1 between the times, one each side."""
        degree = DEGREES[self.interpolation]
        knots, values = self._knots, np.array(self.values, dtype=float)
        coefficients = np.zeros((len(knots) + 1, degree + 1))
        outside = {"hold": (values[0], values[-1]), "zero": (0.0, 0.0), "error": (math.nan, math.nan)}[self.beyond]
        coefficients[[0, -1], 0] = outside
        if self.interpolation == "cubic" and len(knots) > 1:
            from scipy.interpolate import CubicSpline

            coefficients[1:-1] = CubicSpline(knots, values).c[::-1].T
        else:
            coefficients[1:-1, 0] = values[:-1]
            if degree:
                coefficients[1:-1, 1] = np.diff(values) / np.diff(knots)
        return np.column_stack([np.append(knots[:1], knots), coefficients]) if degree else coefficients

    def require(self, start: float, end: float) -> None:
        """Raise SceneError where the table says nothing of a part of this time and should not be asked."""
        if self.beyond == "error" and not (self.times[0] <= start and end <= self.times[-1]):
            raise SceneError(
                f"a table reaches from {self.times[0]:g} to {self.times[-1]:g} s, the run from {start:g} to {end:g} s",
                where="effects: sampled input",
                remedy='give more samples, a shorter duration, or beyond="hold"',
            )


def check_table(table: Sampled, field: str) -> None:
    """Require as many values as times, and times that increase. Raises SceneError."""
    if not table.times or len(table.times) != len(table.values):
        what = f"expected as many values as times, one at least; got {len(table.values)} and {len(table.times)}"
        raise SceneError(what, where=field, remedy="give times and values, or a file with the two columns")
    late = next((i for i, (a, b) in enumerate(zip(table.times, table.times[1:], strict=False)) if not a < b), None)
    if late is not None:
        raise SceneError(
            f"times must increase; at {late + 1} {table.times[late + 1]:g} follows {table.times[late]:g}",
            where=f"{field}.times",
            remedy="sort them, and keep one sample a time",
        )


def _read(path: Path) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """The two columns of a CSV file."""
    text = read_text(path, SceneError, MAX_BYTES, "keep fewer samples")
    times, values = [], []
    for line, cells in csv_rows(text, str(path), SceneError):
        if cells[0].lstrip().startswith("#"):
            continue
        try:
            time, value = map(parse_number, cells)
        except ValueError:
            if line == 1:
                continue  # a header
            what = f"expected two numbers, got {','.join(cells)[:60]!r}"
            remedy = "give a time and a value a line"
            raise SceneError(what, where=f"{path}:{line}", remedy=remedy, code="csv") from None
        times.append(time)
        values.append(value)
    return tuple(times), tuple(values)


_E = TypeVar("_E", bound=Effect)
SAME_TIME = 1e-12  # relative: times that differ by less are one: ticks, breaks, samples, ends of curves and of runs


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
PlaceSignal = Annotated[Input | str, quantity("q")]
EffortSignal = Annotated[Input | str, quantity("tau")]
AnySignal = Input | PolynomialPiece | str  # texts are read when a scene is made


def value_at(signal: AnySignal, t: Scalar, xp: Any) -> Scalar:
    """The input at time t. A table is looked up at numbers; in expressions its current piece stands for it."""
    if isinstance(signal, Sine):
        return plus(times(number(signal.amplitude), xp.sin(signal.frequency * t + signal.phase)), number(signal.mean))
    return _polynomial(*_series(signal, t))


def values_met(signal: AnySignal) -> list[float]:
    """Values that an input has at some time, among them the least and the greatest of a sine or a table."""
    if isinstance(signal, Sine):
        return [signal.mean - abs(signal.amplitude), signal.mean + abs(signal.amplitude)]
    if isinstance(signal, Bezier):
        return [signal.points[0], signal.points[-1]]
    return list(signal.values if isinstance(signal, Sampled) else _series(signal, 0.0)[0][:1])


def derivatives_at(signal: AnySignal, t: Scalar, xp: Any) -> tuple[Scalar, Scalar, Scalar]:
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
    if isinstance(piece, PolynomialPiece):
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
        raise SceneError(f"expected a duration above 0 s, got {curve.duration!r:.60}", where=f"{field}.duration",
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
    if end > curve_end(signal) * (1.0 + SAME_TIME):
        raise SceneError(f"a curve ends at {curve_end(signal):g} s, the run at {end:g} s",
                         where="effects: bezier input", remedy="give it the duration of the run, or a shorter run",
                         code="curve-ends")  # fmt: skip


def curve_end(signal: Any) -> float:
    """The time at which the first of the curves in an effect, or in one of its fields, ends; infinite without one."""
    if isinstance(signal, Bezier):
        return signal.duration
    parts: Any = ()
    if isinstance(signal, Effect):
        parts = [getattr(signal, name) for name in signal.__struct_fields__]
    elif isinstance(signal, (Mapping, tuple, list)):
        parts = signal.values() if isinstance(signal, Mapping) else signal
    return min(map(curve_end, parts), default=math.inf)


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
    if isinstance(signal, Effect):
        return with_pieces(signal, change)
    if isinstance(signal, Mapping):
        return {key: _replaced(value, change) for key, value in signal.items()}
    if isinstance(signal, (tuple, list)):
        return tuple(_replaced(value, change) for value in signal)
    return signal
