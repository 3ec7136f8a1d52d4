"""A hard case as data: a motion whose truth is known, or calls that must end in a named error."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from twolink.dynamics import Robot
from twolink.errors import TwolinkError
from twolink.scenes import Scene, load_scene

SCENES = Path(__file__).parent / "scenes"
PEERS = ("scipy", "mujoco", "drake")


class Track(NamedTuple):
    """A motion as anybody delivers it: t (n,) [s], q (n, nq), v (n, nv), laid out as Pinocchio's."""

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray


@dataclass(frozen=True)
class Truth:
    """What a motion is measured by.

    how: where the truth comes from, in words. error: of a track at each of its times (n,), NaN where nothing is known.
    quantity: what that is, with its unit. exact: it is the error of q, which our error bar is a bound of; else an
    invariant's drift, or another quantity. bar: the most it may be, for an accuracy. doubt: the truth's own error.
    """

    how: str
    error: Callable[[Robot, Track], np.ndarray]
    quantity: str = "error of q [rad]"
    exact: bool = True
    bar: Callable[[float], float] = lambda accuracy: accuracy
    doubt: float = 1e-14


@dataclass(frozen=True, kw_only=True)
class Case:
    """What all cases have. why: why it is hard. slow: not part of the quick suite."""

    name: str
    title: str
    why: str
    group: str
    slow: bool = False


@dataclass(frozen=True, kw_only=True)
class Motion(Case):
    """A scene that is simulated at several settings and held against its truth.

    scene: the stem of a file in `scenes`, or what makes the scene. settings: arguments of `simulate`, one mapping an
    attempt. samples: a second. may_refuse: from which accuracy on down an AccuracyError is a right answer; inf: always.
    peers: who can do it at all. size: of the motion; a peer whose error is above a tenth of it is wrong. peers_until:
    peers are asked for this part of the duration, s.
    """

    scene: str | Callable[[], Scene]
    truth: Truth
    settings: tuple[Mapping[str, Any], ...]
    duration: float | None = None
    samples: float = 20.0
    may_refuse: float = 0.0
    peers: tuple[str, ...] = PEERS
    size: float = 1.0

    def load(self) -> Scene:
        """The scene."""
        return self.scene() if callable(self.scene) else load_scene(SCENES / f"{self.scene}.toml")


@dataclass(frozen=True)
class Probe:
    """A call that must raise an error of this kind whose message holds `says`; kind None: it must just return."""

    call: Callable[[], object]
    kind: type[TwolinkError] | tuple[type[TwolinkError], ...] | None
    says: str = ""


@dataclass(frozen=True, kw_only=True)
class Refusals(Case):
    """Calls with wrong input, by what they are given; the truth is the named error that must come."""

    probes: Mapping[str, Probe] = field(default_factory=dict)


def at(*accuracies: float, **more: Any) -> tuple[Mapping[str, Any], ...]:
    """Settings: these accuracies, with what else `simulate` is told."""
    return tuple({"accuracy": accuracy, **more} for accuracy in accuracies)
