"""Study: the result of an accuracy study, with its text, figure and files."""

from __future__ import annotations

import html
import json
import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import msgspec
import numpy as np

from twolink.accuracy.study_data import Row, StudyData
from twolink.accuracy.text import study_text
from twolink.errors import ShowError, TwolinkError
from twolink.io.atomic import write_atomic
from twolink.io.tables import SUFFIXES, require_format, write_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SAVED = (".json", *SUFFIXES)


@dataclass(frozen=True, repr=False)
class Study(StudyData):
    """What each method's accuracy costs on a scene: rows, the Pareto front, and the price of each further digit."""

    def to_dict(self) -> dict[str, Any]:
        """The study as plain data, which `save` writes as JSON."""
        prices = [
            {"accuracy": p.accuracy, "seconds": p.seconds, "ratio": p.ratio, "method": p.row.method,
             "tolerance": p.row.tolerance, "step": p.row.step} for p in self.price_of_digits()
        ]  # fmt: skip
        return {**msgspec.json.decode(msgspec.json.encode(self)), "price_of_digits": prices}

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Study:
        """Read a study saved as .json. Raises TwolinkError for what is not one."""
        try:
            return msgspec.json.decode(Path(path).read_bytes(), type=cls)
        except OSError as error:
            raise TwolinkError(f"cannot be read: {error.strerror or error}", where=str(path), remedy="check the path",
                               code="not-readable") from None  # fmt: skip
        except msgspec.MsgspecError:
            raise TwolinkError("it is not a saved study", where=str(path), remedy="save the study again, as .json",
                               code="not-a-study") from None  # fmt: skip

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

    @overload
    def plot(self) -> Figure: ...

    @overload
    def plot(self, path: str | os.PathLike[str]) -> Path: ...

    def plot(self, path: str | os.PathLike[str] | None = None) -> Path | Figure:
        """Draw seconds over error, a line a method, with the front and its prices.

        Parameters
        ----------
        path : str or path, optional
            A .png, .svg or .pdf file.

        Returns
        -------
        Path or matplotlib.figure.Figure
            The path; without one the figure, which notebooks show.

        Raises
        ------
        ShowError
            No row has an error below 3, the file's ending is another one, or it cannot be written.
        """
        from twolink.accuracy.plot import plot_study

        return plot_study(self, None if path is None else Path(path))

    def text(self) -> str:
        """The study as tables for people."""
        return study_text(self)

    def __str__(self) -> str:
        return self.text()

    def __repr__(self) -> str:
        ended = ", interrupted" if self.interrupted else ""
        best = min((row.error for row in self.rows), default=math.nan)
        return (
            f"<Study of {self.robot!r}: {self.duration:g} s, {len(self.rows)} rows, {len(self.front)} on the front, "
            f"best error {best:.1e}{ended}>"
        )

    def _repr_html_(self) -> str:
        from twolink.show.figure import figure_html

        try:
            picture = figure_html(self.plot())
        except ShowError:  # no row has an error that can be drawn
            picture = ""
        return f"<pre>{html.escape(self.text())}</pre>{picture}"
