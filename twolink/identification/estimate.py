"""Estimated parameters by name: values, errors and intervals, of a regression or of a fit."""

from pathlib import Path
from typing import TYPE_CHECKING, overload

import numpy as np

from twolink.io.listing import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Estimate:
    """What results that have an estimate share.

    Attributes
    ----------
    combinations : tuple of str, (r,)
        Names of what was found.
    estimate, numerical_error, half_width : ndarray, (r,)
        Values, bounds on their numerical errors, and half of their intervals.
    covariance : ndarray, (r, r)
        Of the estimate.
    """

    combinations: tuple[str, ...]
    estimate: np.ndarray
    covariance: np.ndarray
    numerical_error: np.ndarray
    half_width: np.ndarray

    @property
    def values(self) -> dict[str, float]:
        """The estimate by combination."""
        return dict(zip(self.combinations, self.estimate.tolist(), strict=True))

    @property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """The intervals by combination."""
        low, high = self.estimate - self.half_width, self.estimate + self.half_width
        return dict(zip(self.combinations, zip(low.tolist(), high.tolist(), strict=True), strict=True))

    @property
    def standard_errors(self) -> dict[str, float]:
        """The standard deviations by combination, from the noise of the measurements alone."""
        return dict(zip(self.combinations, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    def table(self) -> Table:
        """Value, standard error, numerical error and interval of each combination."""
        errors, spans = self.standard_errors.values(), self.intervals.values()
        rows = zip(self.combinations, self.estimate.tolist(), errors, self.numerical_error.tolist(), spans, strict=True)
        columns = ("parameter", "value", "standard error", "numerical error", "low", "high")
        return Table(columns, tuple((name, x, s, e, *span) for name, x, s, e, span in rows))

    @overload
    def plot(self) -> "Figure": ...

    @overload
    def plot(self, path: str | Path) -> Path: ...

    def plot(self, path: str | Path | None = None) -> "Path | Figure":
        """Draw residuals and the covariance of the two values that are correlated most.

        With them a regression shows all intervals, a fit by simulation the measured and fitted motion and the singular
        values.

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
            The file cannot be written.
        """
        return self._draw(None if path is None else Path(path))

    def _draw(self, path: Path | None) -> "Path | Figure":
        raise NotImplementedError
