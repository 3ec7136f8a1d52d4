"""What came of a case: attempts of ours, and of peers, with verdicts."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from twolink.hard.case import Case

MET, SAID, WRONG, MISSED, INTERRUPTED = "met", "said so", "wrong silently", "missed", "interrupted"
"""Met: the error is within its limit. Said so: it is not, and an error or the error bar says it. Wrong silently: it is
not, and nothing says it. Missed: a refusal, a crash or a timeout where an answer was due. Interrupted: Ctrl-C ended it,
it is not judged."""
UNABLE = "cannot"  # of peers: they lack a feature, or take too long


@dataclass(frozen=True)
class Curve:
    """Error over time: t (n,) [s], error (n,), and the reported error bar (n,)."""

    t: np.ndarray
    error: np.ndarray
    bar: np.ndarray | None = None


@dataclass(frozen=True)
class Attempt:
    """One run at one setting.

    Parameters
    ----------
    setting : str
        The setting in words.
    verdict : str
        MET, SAID, WRONG, MISSED, INTERRUPTED or UNABLE.
    error, bar : float, optional
        The largest true error, and the reported error bar at its largest.
    seconds : float
        The whole call, compiling included.
    method, steps
        Of the solution.
    message : str
        An error, a warning, or what the verdict rests on.
    trusted_until : float, optional
        The time up to which the accuracy is kept, s.
    default : bool
        Whether this is a peer at its default setting.
    curve : Curve, optional
        The error over time.
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

    def record(self) -> dict[str, Any]:
        """Plain data for JSON, without the curve; None for what is not finite."""
        values = {name: value for name, value in vars(self).items() if name != "curve"}
        return {k: None if isinstance(x, float) and not np.isfinite(x) else x for k, x in values.items()}


@dataclass(frozen=True)
class CaseResult:
    """A case with its attempts, ours and the peers' (each with the peer's name)."""

    case: Case
    ours: tuple[Attempt, ...]
    peers: tuple[tuple[str, Attempt], ...] = ()

    @property
    def verdict(self) -> str:
        """The worst of ours."""
        order = (WRONG, MISSED, INTERRUPTED, SAID, MET)
        return min((a.verdict for a in self.ours), key=order.index, default=MISSED)

    @property
    def passed(self) -> bool:
        """Whether every attempt met its limit, or said that it does not."""
        return self.verdict in (MET, SAID)

    @property
    def interrupted(self) -> bool:
        """Whether Ctrl-C ended the last attempt; those before it are judged."""
        return any(a.verdict == INTERRUPTED for a in (*self.ours, *(attempt for _, attempt in self.peers)))

    @property
    def seconds(self) -> float:
        """The time of all our attempts."""
        return sum(attempt.seconds for attempt in self.ours)

    @property
    def wrong_by_default(self) -> dict[str, Attempt]:
        """The peers, by name, that are silently wrong at their default setting."""
        return {name: a for name, a in self.peers if a.default and a.verdict == WRONG}

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON, without the curves."""
        case = self.case
        return {
            "name": case.name, "title": case.title, "why": case.why, "group": case.group, "truth": case.truth,
            "verdict": self.verdict, "seconds": self.seconds,
            "ours": [a.record() for a in self.ours],
            "peers": [{"peer": name, **a.record()} for name, a in self.peers],
        }  # fmt: skip
