"""Sampled: an input as a table of samples, and the polynomials it is made of between them."""

import functools
import math
from pathlib import Path
from typing import Any, Literal, NamedTuple

import msgspec
import numpy as np

from twolink.algorithms.spatial import Scalar
from twolink.errors import SceneError
from twolink.io.csv_text import csv_rows
from twolink.io.text import parse_number, read_text

Array = np.ndarray[Any, np.dtype[np.float64]]
MAX_BYTES = 2**28
DEGREES = {"hold": 0, "linear": 1, "cubic": 3}


class Piece(NamedTuple):
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
        Before the first and after the last time: the value there, 0, or a refusal.

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
        """How many numbers make a piece: its coefficients, and where it starts if that matters."""
        degree = DEGREES[self.interpolation]
        return degree + 2 if degree else 1

    def piece_of(self, rows: Any) -> Piece:
        """The piece made of so many numbers, or symbols."""
        return Piece(rows[0], tuple(rows[1:])) if len(rows) > 1 else Piece(0.0, tuple(rows))

    def rows_at(self, t: float) -> Array:
        """The numbers of the piece that holds at time t, (rows,)."""
        starts, coefficients = self._pieces
        at = int(np.searchsorted(self.times, t, side="right"))
        return np.append(starts[at], coefficients[at]) if len(coefficients[at]) > 1 else coefficients[at]

    def piece_at(self, t: Scalar) -> Piece:
        """The piece that holds at time t, or from it on; of an array of times, the piece of each."""
        starts, coefficients = self._pieces
        at = np.searchsorted(self.times, np.asarray(t, dtype=float), side="right")
        return Piece(starts[at], tuple(np.moveaxis(coefficients[at], -1, 0)))

    @functools.cached_property
    def _pieces(self) -> tuple[Array, Array]:
        """Where each piece starts (n + 1,), and its coefficients (n + 1, degree + 1): n - 1 between, one each side."""
        degree = DEGREES[self.interpolation]
        knots, values = np.array(self.times, dtype=float), np.array(self.values, dtype=float)
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
        return np.append(knots[:1], knots), coefficients

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
