"""Study: what accuracy costs in time, row by row, its Pareto front, and the price of each further digit."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from twolink.accuracy.truth import BETTER, Reference
from twolink.errors import AccuracyError, TwolinkError
from twolink.io.atomic import write_atomic
from twolink.io.tables import SUFFIXES, require_format, write_table

SAVED = (".json", *SUFFIXES)
COARSEST, FINEST = 0.1, 1e-16  # rad or m: the first digit that has a price, and the last one of a double


@dataclass(frozen=True)
class Row:
    """A method at a setting: its error [rad, m], the largest of q at any sample, and its seconds of wall clock.

    tolerance: of adaptive methods, else None. step: of methods with fixed steps [s], else None. seconds: the median of
    some runs after a first one, compiling not counted; compile_seconds: that, 0 where it was at hand. front: no other
    row is both more accurate and quicker. resolved: the reference is 100 times better than this row, so that the error
    is known; where it is not, the error is at most `error` plus the reference's own.
    """

    method: str
    tolerance: float | None
    step: float | None
    error: float
    seconds: float
    evaluations: int
    steps: int
    rejected: int = 0
    compile_seconds: float = 0.0
    front: bool = False
    resolved: bool = True

    @property
    def setting(self) -> str:
        """The tolerance or the step, as text."""
        return f"tolerance {self.tolerance:.2g}" if self.step is None else f"step {self.step:.3g} s"


@dataclass(frozen=True)
class Failure:
    """A method, at a setting or altogether (both None), that gave no row, and why."""

    method: str
    tolerance: float | None
    step: float | None
    reason: str


@dataclass(frozen=True)
class Price:
    """The cheapest row with an error of at most `accuracy` [rad, m]: its seconds, and those over the decade before."""

    accuracy: float
    seconds: float
    ratio: float | None
    row: Row


@dataclass(frozen=True)
class Study:
    """What each method's accuracy costs on a scene.

    robot: its name. duration [s], samples: how many. rows: by method, from rough to accurate. failures: what gave no
    row, and why. reference: what the errors were measured against. interrupted: Ctrl-C ended it early.
    """

    robot: str
    duration: float
    samples: int
    rows: tuple[Row, ...]
    failures: tuple[Failure, ...]
    reference: Reference
    seconds: float
    interrupted: bool = False

    @property
    def front(self) -> tuple[Row, ...]:
        """The Pareto front: rows that no other beats in both error and seconds, from rough to accurate."""
        return tuple(sorted((row for row in self.rows if row.front), key=lambda row: -row.error))

    def cheapest(self, accuracy: float) -> Row:
        """The row with the fewest seconds among those with an error of at most `accuracy` [rad, m].

        The reference's own error counts as the row's. Raises AccuracyError with the best that was reached.
        """
        good = [row for row in self.rows if row.error + self.reference.error <= accuracy]
        if good:
            return min(good, key=lambda row: row.seconds)
        best = min(self.rows, key=lambda row: row.error, default=None)
        if best is None:
            why = self.failures[0].reason if self.failures else "it was interrupted"
            raise AccuracyError(f"the study has no rows: {why}", where="accuracy", remedy="a larger budget= or others")
        raise AccuracyError(
            f"nothing reached {accuracy:g}: the best was {best.error:.1e} by {best.method}, {best.setting}",
            where="accuracy",
            remedy="ask for less, or simulate with precision='quad'",
        )

    def price_of_digits(self) -> tuple[Price, ...]:
        """For each decade of accuracy that was reached, 0.1 and better: the fewest seconds, and what that is as a
        multiple of the decade before."""
        prices: list[Price] = []
        best = min((row.error + self.reference.error for row in self.rows), default=math.inf)
        accuracy = COARSEST
        while best <= accuracy and accuracy >= FINEST:
            row = self.cheapest(accuracy)
            prices.append(Price(accuracy, row.seconds, row.seconds / prices[-1].seconds if prices else None, row))
            accuracy = float(f"1e{round(math.log10(accuracy)) - 1}")
        return tuple(prices)

    def to_dict(self) -> dict[str, Any]:
        """The study as plain data, which `save` writes as JSON."""
        own = {name: getattr(self, name) for name in ("robot", "duration", "samples", "seconds", "interrupted")}
        prices = [
            {"accuracy": p.accuracy, "seconds": p.seconds, "ratio": p.ratio, "method": p.row.method,
             "tolerance": p.row.tolerance, "step": p.row.step} for p in self.price_of_digits()
        ]  # fmt: skip
        reference = {**asdict(self.reference), "q_end": list(self.reference.q_end)}
        return {**own, "reference": reference, "rows": [asdict(row) for row in self.rows],
                "failures": [asdict(failure) for failure in self.failures], "price_of_digits": prices}  # fmt: skip

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Study:
        """Read a study saved as .json. Raises TwolinkError for what is not one."""
        try:
            data = json.loads(Path(path).read_text(encoding="utf-8"))
            own = {name: data[name] for name in ("robot", "duration", "samples", "seconds", "interrupted")}
            reference = Reference(**{**data["reference"], "q_end": tuple(data["reference"]["q_end"])})
            rows, failures = (Row(**row) for row in data["rows"]), (Failure(**f) for f in data["failures"])
            return cls(**own, rows=tuple(rows), failures=tuple(failures), reference=reference)
        except OSError as error:
            what = f"cannot be read: {error.strerror or error}"
            raise TwolinkError(what, where=str(path), remedy="check the path") from None
        except (ValueError, KeyError, TypeError):
            remedy = "save the study again, as .json"
            raise TwolinkError("it is not a saved study", where=str(path), remedy=remedy) from None

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write all of it to .json, or its rows to .csv, .parquet or .npz; numbers keep every digit."""
        target = Path(path)
        suffix = require_format(target, SAVED)
        if suffix == ".json":
            text = json.dumps(self.to_dict(), indent=1, allow_nan=False)
            return write_atomic(target, lambda file: file.write(text.encode()))
        notes = {"robot": self.robot, "duration": repr(self.duration), "reference": self.reference.how,
                 "reference_error": repr(self.reference.error)}  # fmt: skip
        return write_table(target, self._columns(as_text=suffix == ".csv"), notes)

    def _columns(self, *, as_text: bool) -> dict[str, np.ndarray]:
        """The rows by column. As text, what a row does not have is empty; as numbers it is NaN."""
        table: dict[str, np.ndarray] = {}
        for name in Row.__dataclass_fields__:
            values = [getattr(row, name) for row in self.rows]
            if as_text:
                table[name] = np.array(["" if v is None else str(v) for v in values], dtype=str)
            elif name in ("tolerance", "step"):
                table[name] = np.array([math.nan if v is None else v for v in values], dtype=float)
            else:
                table[name] = np.array(values)
        return table

    def plot(self, path: str | os.PathLike[str]) -> Path:
        """Draw seconds over error, a line a method, with the front and its prices, into a .png, .svg or .pdf."""
        from twolink.accuracy.plot import plot_study

        return plot_study(self, Path(path))

    def text(self) -> str:
        """The study as tables for people."""
        from twolink.accuracy.text import report

        return report(self)

    def __str__(self) -> str:
        return self.text()


def with_front(rows: Sequence[Row], reference: Reference) -> tuple[Row, ...]:
    """The rows, each with whether it is on the Pareto front and whether its error is resolved."""
    bounds = [row.error + reference.error for row in rows]
    order = sorted(range(len(rows)), key=lambda i: (rows[i].seconds, bounds[i]))
    best, front = math.inf, set()
    for i in order:
        if bounds[i] < best:
            best = bounds[i]
            front.add(i)
    return tuple(
        replace(row, front=i in front, resolved=row.error >= BETTER * reference.error) for i, row in enumerate(rows)
    )
