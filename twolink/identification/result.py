"""What an identification found: values with intervals, what cannot be told, and whether such a robot can exist.

`Estimate` is what it shares with a fit by simulation.
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from twolink.dynamics import Robot
from twolink.identification.base_parameters import Selection
from twolink.identification.consistency import Consistency, consistent
from twolink.io.text import Table
from twolink.simulation.text import Result

if TYPE_CHECKING:
    from matplotlib.figure import Figure


if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Estimate(Result):
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


@dataclass(frozen=True, repr=False)
class Identification(Estimate):
    """Parameters from measurements.

    Attributes
    ----------
    robot : Robot
        The robot whose parameters were looked for, as it was.
    selection : Selection
        What was looked for: k names, and how they change pi.
    combinations : tuple of str, (r,)
        What was found: names of parameters that can be told alone, and sums such as "forearm.mass + hand.mass".
    matrix : ndarray, (r, k)
        The combinations' coefficients.
    estimate : ndarray, (r,)
        Their values, SI units.
    covariance : ndarray, (r, r)
        Of the estimate, from the noise of the measured torques.
    numerical_error : ndarray, (r,)
        Bound on the error from rounding, and an estimate of that from filtering positions; not in the covariance.
    half_width : ndarray, (r,)
        The intervals at `confidence` are estimate +- half_width, numerical error included.
    confidence : float
        The probability of the intervals.
    not_identifiable : tuple of str
        What no motion of this robot can show, in words.
    not_excited : tuple of str
        What other motions can show and these data do not.
    noise : ndarray, (nv,)
        The standard deviation of the residuals of each joint, N m or N.
    residuals : ndarray, (m, nv)
        Measured torques minus those of the estimate, at the times `t`.
    t : ndarray, (m,)
        The samples that were used; a filter leaves out those at the ends.
    condition : float
        Of the regressor with columns of length 1: 1 is best, above 100 the motion excites poorly.
    correlated : bool
        Whether residuals follow each other in time: forces are missing in the model, or filters act.
    method : str
        How it was fitted.
    """

    robot: Robot
    selection: Selection
    combinations: tuple[str, ...]
    matrix: np.ndarray
    estimate: np.ndarray
    covariance: np.ndarray
    numerical_error: np.ndarray
    half_width: np.ndarray
    confidence: float
    not_identifiable: tuple[str, ...]
    not_excited: tuple[str, ...]
    noise: np.ndarray
    residuals: np.ndarray
    t: np.ndarray
    condition: float
    correlated: bool
    method: str

    @property
    def parameters(self) -> tuple[str, ...]:
        """What was looked for, k names."""
        return self.selection.names

    @cached_property
    def consistency(self) -> Consistency:
        """Whether bodies with such parameters can exist, and the nearest that can."""
        names, matrix = self.combinations, self.matrix
        return consistent(self.robot, self.selection, names, matrix, self.estimate, self.covariance)

    @cached_property
    def found(self) -> Robot:
        """The robot with what was found: the consistent parameters nearest to its own that fit the estimate."""
        return self.consistency.robot_of(self.robot)

    def to_dict(self) -> dict[str, Any]:
        """A record for JSON."""
        return {
            "robot": self.robot.name,
            "method": self.method,
            "samples": len(self.t),
            "confidence": self.confidence,
            "found": self.table().to_records(),
            "covariance": self.covariance.tolist(),
            "not_identifiable": list(self.not_identifiable),
            "not_excited": list(self.not_excited),
            "noise": dict(zip(_dof_names(self.robot), self.noise.tolist(), strict=True)),
            "condition": self.condition,
            "correlated": self.correlated,
            "consistency": self.consistency.to_dict(),
        }

    def _draw(self, path: Path | None) -> "Path | Figure":
        """Residuals, the covariance of the two values that are correlated most, and all intervals."""
        from twolink.identification.fit_plot import plot_identification

        title = f"{self.robot.name}: {len(self.estimate)} found from {len(self.t)} samples"
        scaled = (self.residuals / np.maximum(self.noise, 1e-300)).T
        return plot_identification(title, self, self.t, dict(zip(_dof_names(self.robot), scaled, strict=True)), path)

    def __str__(self) -> str:
        percent = f"{100 * self.confidence:g} %"
        lines = [
            f"{self.robot.name}: {len(self.estimate)} found from {len(self.t)} samples, {self.method} least squares"
        ]
        lines += ["", str(self.table()), "", f"low, high: {percent} intervals; condition {self.condition:.3g}"]
        noises = zip(_dof_names(self.robot), self.noise.tolist(), strict=True)
        lines.append("noise of tau: " + ", ".join(f"{name} {value:.3g}" for name, value in noises))
        if self.correlated:
            lines.append(
                "residuals are correlated in time: forces may be missing (friction?); the intervals allow for it"
            )
        alone = [text.partition(":")[0] for text in self.not_identifiable if ":" in text]
        lines += [f"no torque depends on: {', '.join(alone)}"] if alone else []
        lines += [f"cannot be identified: {text}" for text in self.not_identifiable if ":" not in text]
        lines += [f"not excited by these data: {text}" for text in self.not_excited]
        return "\n".join([*lines, str(self.consistency)])

    __repr__ = __str__


def _dof_names(robot: Robot) -> list[str]:
    """A name for each entry of v."""
    return [
        joint.name + (f".{k}" if joint.v.stop - joint.v.start > 1 else "")
        for joint in robot.joints
        for k in range(joint.v.stop - joint.v.start)
    ]
