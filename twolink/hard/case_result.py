"""What came of a case: attempts of ours, and of peers, with verdicts."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from twolink.hard.case import Case

MET, SAID, WRONG, MISSED = "met", "said so", "wrong silently", "missed"
"""Met: within its bar. Said so: not, and an error or the error bar says it. Wrong silently: not, and nothing says it.
Missed: refused, crashed or given up where an answer was due."""
UNABLE = "cannot"  # of peers: it has no such thing

CURVE_POINTS = 240


@dataclass(frozen=True)
class Curve:
    """Error over time for the plot: t (n,), error (n,), and the error bar that was reported (n,)."""

    t: np.ndarray
    error: np.ndarray
    bar: np.ndarray | None = None

    def thinned(self) -> Curve:
        """The largest of each of some intervals, so that no peak is lost."""
        known = np.isfinite(self.error)
        t, error = self.t[known], self.error[known]
        bar = None if self.bar is None else self.bar[known]
        if len(t) <= CURVE_POINTS:
            return Curve(t, error, bar)
        edges = np.linspace(0, len(t), CURVE_POINTS + 1).astype(int)[:-1]
        last = np.append(edges[1:], len(t)) - 1
        return Curve(t[last], np.maximum.reduceat(error, edges), None if bar is None else bar[last])


@dataclass(frozen=True)
class Attempt:
    """One run. error: the largest true one; bar: the error bar reported; seconds: all of it, compiling included.

    default: it is a peer's run at its default setting.
    """

    setting: str
    verdict: str
    error: float | None = None
    bar: float | None = None
    seconds: float = 0.0
    method: str = ""
    steps: int = 0
    message: str = ""
    trusted_until: float | None = None
    default: bool = False
    curve: Curve | None = field(default=None, repr=False)


@dataclass(frozen=True)
class Result:
    """A case with its attempts, ours and the peers' (a name each, with the settings in words)."""

    case: Case
    ours: tuple[Attempt, ...]
    peers: tuple[tuple[str, Attempt], ...] = ()

    @property
    def verdict(self) -> str:
        """The worst of ours."""
        order = (WRONG, MISSED, SAID, MET)
        return next((v for v in order if any(a.verdict == v for a in self.ours)), MISSED)

    @property
    def passed(self) -> bool:
        """Every attempt met its bar, or said that it does not."""
        return self.verdict in (MET, SAID)

    @property
    def seconds(self) -> float:
        """What ours took."""
        return sum(attempt.seconds for attempt in self.ours)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON, without the curves."""
        about = {"name": self.case.name, "title": self.case.title, "why": self.case.why, "group": self.case.group}
        truth = getattr(self.case, "truth", None)
        return {
            **about,
            "truth": getattr(truth, "how", "the named error"),
            "verdict": self.verdict,
            "seconds": self.seconds,
            "ours": [_plain(a) for a in self.ours],
            "peers": [{"peer": name, **_plain(a)} for name, a in self.peers],
        }


def _plain(attempt: Attempt) -> dict[str, Any]:
    return {name: _number(value) for name, value in vars(attempt).items() if name != "curve"}


def _number(value: Any) -> Any:
    """JSON has no word for what is not finite."""
    return None if isinstance(value, float) and not np.isfinite(value) else value
