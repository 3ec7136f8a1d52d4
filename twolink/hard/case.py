"""A hard case as data: a simulation whose exact motion is known, or calls that must end in a named error."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from twolink.dynamics import Robot
from twolink.errors import TwolinkError
from twolink.scenes import Scene

SCENES = Path(__file__).parent / "scenes"


class Track(NamedTuple):
    """A motion from any simulator: t (n,) [s], q (n, nq), v (n, nv) in Pinocchio's layout."""

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray


ErrorFunction = Callable[[Robot, Track], np.ndarray]
"""The error of a motion at each of its times (n,); NaN where the exact value is not available."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """What all cases have.

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
