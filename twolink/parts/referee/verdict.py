"""The verdict on a trajectory, and its words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from twolink.parts.referee.causes import Cause
from twolink.parts.referee.trajectory_log import Array
from twolink.robots.joint_layout import rate_of
from twolink.show.figure import Plotted, plot_lines
from twolink.simulation.text import BaseResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Answer = Literal["right", "wrong", "not known"]


@dataclass(frozen=True, repr=False)
class Verdict(Plotted, BaseResult):
    """The verdict on a trajectory.

    Attributes
    ----------
    answer : {"right", "wrong", "not known"}
        "right": within the tolerance of the solution at every sample, its velocity within 100 times as much a second;
        digits that the log has not do not count. "wrong": farther off than the tolerance, the solution's error bar and
        the log's digits together. "not known": neither is certain, for the solution is not known well enough.
    unknown_from : float or None
        Since when it is not known, s; None: it is, or the log is wrong.
    excess : float
        By how much it is wrong at least, rad or m, or for velocities a second; 0 of others.
    t : ndarray (n,)
        Its samples, s, as far as the solution goes.
    distance : ndarray (n,)
        From the solution, max |difference(q, q_solution)|, rad or m.
    bar : ndarray (n,)
        How far the solution itself may be off, rad or m.
    digits : float
        How far q may be off for the digits that were written, at most, rad or m.
    beyond : mapping of str to float or None
        Since when it is farther off than some distances for certain, s; None: never.
    velocity : float or None
        The largest distance of v from the solution's, rad/s or m/s; None: the log has no velocities.
    defect : float or None
        The largest local defect of v from a sample to the next, rad/s or m/s; None: no interval without events.
    energy : float or None
        The largest difference of its energy from the solution's, J; None: the log has no velocities.
    constraints : mapping of str to float
        How far loops are open, and joints beyond their stops, at most, m or rad.
    causes : tuple of Cause
        The cause that leaves less than 1 % unexplained; behind it those that this motion does not tell it from. Empty
        where none is known, and of a log that is not wrong.
    nearest : Cause or None
        Where no cause is known: what leaves the least.
    not_looked_at : tuple of str
        What was not looked at for lack of time.
    scene : str
        The scene's title.
    guessed : tuple of str
        Which columns of the log were taken for t, q and v, where they have other names.
    unit : str
        Of distances: "rad", "m", or "rad or m".
    bound : {"verified", "estimated", ""}
        Of the solution's bar, as of its run.
    """

    answer: Answer
    unknown_from: float | None
    excess: float
    t: Array
    distance: Array
    bar: Array
    digits: float
    beyond: Mapping[str, float | None]
    velocity: float | None
    defect: float | None
    energy: float | None
    constraints: Mapping[str, float]
    causes: tuple[Cause, ...]
    nearest: Cause | None
    not_looked_at: tuple[str, ...]
    scene: str
    guessed: tuple[str, ...] = ()
    unit: str = "rad or m"
    bound: Literal["verified", "estimated", ""] = ""

    @property
    def right(self) -> bool:
        """True if the answer is "right"."""
        return self.answer == "right"

    def to_dict(self) -> dict[str, Any]:
        """The fields as plain data, and right."""
        return {"right": self.right, **super().to_dict()}

    def _figure(self) -> Figure:
        curves = {"distance from the solution": self.distance, "error bar of the solution": self.bar}
        return plot_lines(self.summary, ("t (s)", self.unit), self.t, curves, log=True)

    def _first_line(self) -> str:
        known = f"the solution is known to {self.bar.max():.1e}"
        known = known if self.bar.any() else "no error of the solution is seen"
        known += f", the log is known to {self.digits:.1e}" if self.digits else ""
        worst = int(np.argmax(self.distance))
        apart = f"at most {self.distance[worst]:.2g} {self.unit} from the solution, at {self.t[worst]:.4g} s"
        if self.answer == "not known":
            return f"not known from {self.unknown_from:.4g} s on, right until then; {apart} ({known})"
        if self.answer == "right":
            return f"right, {apart} ({known})"
        by = f", by at least {self.excess:.2g} {self.unit}" if self.beyond else (
            f", its velocities by at least {self.excess:.2g} {rate_of(self.unit)}" if self.excess else "")  # fmt: skip
        return f"WRONG{by}; {apart} ({known})"

    def __str__(self) -> str:
        lines = [f"{self.scene}: {self._first_line()}"]
        lines += [f"  read: {'; '.join(self.guessed)}"] if self.guessed else []
        lines += [f"  within {name} until {since:.4g} s" for name, since in self.beyond.items() if since is not None]
        if self.defect is not None:
            step, unit = 1e3 * float(np.median(np.diff(self.t))), rate_of(self.unit)
            lines.append(f"  local defect at most {self.defect:.2g} {unit} in a sample of {step:.4g} ms")
        if self.energy is not None:
            lines.append(f"  energy off by at most {self.energy:.2g} J")
        lines += [f"  {name} violated by {value:.2g}" for name, value in self.constraints.items()]
        if self.causes:
            lines.append(f"  cause: {self.causes[0]}")
            others = "; ".join(cause.what for cause in self.causes[1:])
            lines += [f"  which this motion does not tell from: {others}"] if others else []
        elif self.answer == "wrong":
            lines.append(f"  cause: none known{f'; nearest: {self.nearest}' if self.nearest else ''}")
        if self.not_looked_at:
            lines.append(f"  not looked at, for lack of time: {'; '.join(self.not_looked_at)}")
        return "\n".join(lines)

    __repr__ = __str__


@dataclass(frozen=True, repr=False)
class Verdicts(Plotted, BaseResult):
    """Verdicts on several trajectories of one scene.

    Attributes
    ----------
    verdicts : mapping of str to Verdict
        By the name of the log.
    """

    verdicts: Mapping[str, Verdict]

    @property
    def nearest(self) -> tuple[str, ...]:
        """The names of the logs, the one nearest to the solution first."""
        return tuple(sorted(self.verdicts, key=lambda name: float(self.verdicts[name].distance.max())))

    @property
    def common_causes(self) -> tuple[str, ...]:
        """The causes that are named of every log."""
        named = [[cause.what for cause in verdict.causes] for verdict in self.verdicts.values()]
        return tuple(what for what in named[0] if all(what in each for each in named))

    def to_dict(self) -> dict[str, Any]:
        """The verdicts as plain data, and what they have in common."""
        return {**super().to_dict(), "nearest": list(self.nearest), "common_causes": list(self.common_causes)}

    def _figure(self) -> Figure:
        farthest = max(self.verdicts.values(), key=lambda verdict: verdict.t[-1])
        curves = {name: np.interp(farthest.t, one.t, one.distance, right=np.nan) for name, one in self.verdicts.items()}
        curves["error bar of the solution"] = farthest.bar
        return plot_lines(self.summary, ("t (s)", f"{farthest.unit} from the solution"), farthest.t, curves, log=True)

    def __str__(self) -> str:
        first, *rest = self.nearest
        apart = {name: f"{self.verdicts[name].distance.max():.2g}" for name in self.nearest}
        lines = ["; ".join([f"nearest to the solution: {first}, at most {apart[first]} {self.verdicts[first].unit}",
                            *(f"{name} {apart[name]}" for name in rest)])]  # fmt: skip
        lines += [f"what all miss: {'; '.join(self.common_causes)}"] if self.common_causes else []
        return "\n".join([*lines, *(f"{name}\n  {verdict}" for name, verdict in self.verdicts.items())])

    __repr__ = __str__
