"""What an optimization found: the best scene, its run and the history, and how far they can be trusted."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from twolink.io.listing import Table
from twolink.scenes import Scene
from twolink.simulation.text import ShownAsText
from twolink.simulation.trajectory import Trajectory


@dataclass(frozen=True, eq=False, repr=False)
class Optimum(ShownAsText):
    """The best that a search found. It unpacks as scene, run, history.

    Attributes
    ----------
    scene : Scene
        The scene with the best values.
    run : Trajectory
        Its run, with an error bar.
    history : Table
        Every evaluation: start, values by name, objective, least constraint, slope (norm of the gradient with the
        variables scaled to [0, 1]), where the derivatives came from, seconds.
    values : mapping of str to float
        The best values by name, SI units.
    objective : float
        The objective there.
    error : float
        Its numerical error: twice its distance to the value of a run that is FINER times as accurate and has twice
        the samples. NaN: there is no such run.
    gradient : ndarray (k,)
        The objective's derivatives there, per unit of each variable.
    gradient_error : ndarray (k,)
        Their numerical error, found in the same way; NaN where they are differences of runs.
    hessian : ndarray (k, k)
        Second derivatives, by differences of gradients. NaN: not computed.
    on_bound : mapping of str to str
        "low" or "high" for the variables whose best value is on a bound.
    constraints : mapping of str to float
        The constraints there; each is to be at least 0.
    simulations : int
        Runs that it took, those that a file held included.
    seconds : float
        Of wall clock, likewise.
    ends : tuple of str
        Why the search from each start ended.
    interrupted : bool
        Ctrl-C ended it; this is the best so far.
    """

    scene: Scene
    run: Trajectory
    history: Table
    values: Mapping[str, float]
    objective: float
    error: float
    gradient: np.ndarray
    gradient_error: np.ndarray
    hessian: np.ndarray
    on_bound: Mapping[str, str]
    constraints: Mapping[str, float]
    simulations: int
    seconds: float
    ends: tuple[str, ...]
    interrupted: bool = False

    def __iter__(self) -> Iterator[Any]:
        return iter((self.scene, self.run, self.history))

    @property
    def resolution(self) -> dict[str, float]:
        """How far each variable alone may be off before the objective changes by more than its error.

        The positive root d of |g_k| d + |H_kk| d^2 / 2 = error; NaN where error or Hessian are not known.
        """
        slope, curvature = np.abs(self.gradient), np.abs(np.diag(self.hessian))
        with np.errstate(divide="ignore", invalid="ignore"):
            off = 2.0 * self.error / (slope + np.sqrt(slope**2 + 2.0 * curvature * self.error))
        return dict(zip(self.values, off.tolist(), strict=True))

    def table(self) -> Table:
        """Value, bound, resolution, first and second derivative of each variable."""
        resolution, rows = self.resolution, []
        for k, (name, value) in enumerate(self.values.items()):
            rows.append((name, value, _known(resolution[name]), self.on_bound.get(name), float(self.gradient[k]),
                         _known(float(self.gradient_error[k])), _known(float(self.hessian[k, k]))))  # fmt: skip
        return Table(("variable", "value", "±", "bound", "slope", "± slope", "curvature"), tuple(rows))

    def to_dict(self) -> dict[str, Any]:
        """A record for JSON."""
        return {
            "objective": self.objective,
            "error": _known(self.error),
            "variables": self.table().to_records(),
            "hessian": [[_known(x) for x in row] for row in self.hessian.tolist()],
            "constraints": dict(self.constraints),
            "simulations": self.simulations,
            "seconds": self.seconds,
            "ends": list(self.ends),
            "interrupted": self.interrupted,
            "history": self.history.to_records(),
        }

    def __repr__(self) -> str:
        error = "error not known" if np.isnan(self.error) else f"± {self.error:.1e}"
        lines = [f"objective {self.objective:.9g} {error}, {len(self.history)} evaluations, "
                 f"{self.simulations} simulations, {self.seconds:.3g} s", str(self.table())]  # fmt: skip
        lines += [f"constraint {name}: {value:.6g}{' (violated)' if value < -(self.run.accuracy or 0.0) else ''}"
                  for name, value in self.constraints.items()]  # fmt: skip
        lines += [f"start {i}: {end}" for i, end in enumerate(self.ends, 1)]
        by_runs = dict.fromkeys(record["derivatives"] for record in self.history)
        lines += [f"derivatives: {by}" for by in by_runs if by.startswith("differences")]
        return "\n".join([*lines, "interrupted: this is the best so far"] if self.interrupted else lines)


def _known(value: float) -> float | None:
    """A number for JSON and tables, None for one that is not known."""
    return None if np.isnan(value) else float(value)
