"""A hard case as data: a simulation whose exact motion is known, or calls that must end in a named error; and what came
of it: attempts of ours, and of peers, with verdicts.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from twolink.dynamics import Robot
from twolink.errors import TwolinkError
from twolink.scenes import Scene

FOLDER = Path(__file__).parent / "scenes"
MET, SAID, WRONG, MISSED, INTERRUPTED = "met", "said so", "wrong silently", "missed", "interrupted"
"""Met: the error is within its limit. Said so: it is not, and an error or the error bar says it. Wrong silently: it is
not, and nothing says it. Missed: a refusal, a crash or a timeout where an answer was due. Interrupted: Ctrl-C ended it,
it is not judged."""
UNABLE = "cannot"  # of peers: they lack a feature, or take too long


class StateHistory(NamedTuple):
    """A motion from any simulator: t (n,) [s], q (n, nq), v (n, nv) in Pinocchio's layout."""

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray


ErrorFunction = Callable[[Robot, StateHistory], np.ndarray]
"""The error of a motion at each of its times (n,); NaN where the exact value is not available."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """The common fields of all cases.

    Parameters
    ----------
    name, title, group : str
        The name for the command line, one line for people, and the group.
    why : str
        Why the case is hard.
    truth : str
        What the results are compared with.
    slow : bool
        Whether the quick suite leaves it out.
    """

    name: str
    title: str
    group: str
    why: str
    truth: str = "the named error that must be raised, or an answer where one is due"
    slow: bool = False


@dataclass(frozen=True, kw_only=True)
class SimulationCase(Case):
    """A scene that is simulated at several settings and compared with its exact motion.

    Parameters
    ----------
    load : callable
        Makes the scene.
    error : callable
        The error of a motion.
    settings : tuple of mappings
        Arguments of `simulate`, one mapping an attempt.
    duration : float, optional
        Seconds; the scene's own when None.
    samples : float
        Samples a second.
    quantity : str
        What the error is, with its unit.
    bounded : bool
        Whether the error bar of a run is a bound of this error. If not, it is the drift of an invariant.
    uncertainty : float
        Error of the truth itself.
    allowed : float, optional
        The largest error that counts as met; `slack` times the accuracy when None.
    slack : float
        See `allowed`.
    may_refuse : float
        The largest accuracy at which an AccuracyError is a right answer; inf: at all of them.
    peers : tuple of str
        The peers that can do the case.
    size : float
        Size of the motion in the unit of the error. A peer whose error is above a tenth of it is wrong.
    """

    load: Callable[[], Scene]
    error: ErrorFunction
    settings: tuple[Mapping[str, Any], ...]
    duration: float | None = None
    samples: float = 20.0
    quantity: str = "error of q [rad]"
    bounded: bool = True
    uncertainty: float = 1e-14
    allowed: float | None = None
    slack: float = 1.0
    may_refuse: float = 0.0
    peers: tuple[str, ...] = ("scipy", "mujoco", "drake")
    size: float = 1.0

    def limit(self, accuracy: float) -> float:
        """The largest error that counts as met at an accuracy."""
        return self.slack * accuracy if self.allowed is None else self.allowed


@dataclass(frozen=True)
class ErrorCheck:
    """A call that must raise an error of this kind whose message holds `part`; kind None: it must return."""

    call: Callable[[], object]
    kind: type[TwolinkError] | tuple[type[TwolinkError], ...] | None
    part: str = ""


@dataclass(frozen=True, kw_only=True)
class RefusalCase(Case):
    """Calls with wrong input, by what is wrong; each must raise a named error."""

    checks: Mapping[str, ErrorCheck]


@dataclass(frozen=True)
class ErrorCurve:
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
    curve : ErrorCurve, optional
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
    curve: ErrorCurve | None = field(default=None, repr=False)

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
        """True if every attempt met its limit, or said that it does not."""
        return self.verdict in (MET, SAID)

    @property
    def interrupted(self) -> bool:
        """True if Ctrl-C ended the last attempt; those before it are judged."""
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
