"""Every failure twolink raises on purpose: what went wrong, where, and what to do about it.

TwolinkError
├── RobotError         a robot cannot be loaded: the URDF is refused, or the name is unknown
├── QueryError         a dynamics query got an argument it cannot answer
├── SceneError         a scene names something that does not exist or cannot be simulated
├── AccuracyError      the asked accuracy cannot be kept
├── CertificationError a compiled function disagrees with Pinocchio
├── ShowError          a figure or playback cannot be made
└── MissingExtraError  an optional library is needed and not installed
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import Any


class TwolinkError(Exception):
    """The root of all failures raised by twolink.

    `what` went wrong (with the offending value and what was expected), `where` (file, link, joint, argument),
    and the `remedy`. The message is these three in one line.
    """

    def __init__(self, what: str, *, where: str = "", remedy: str = "") -> None:
        self.what, self.where, self.remedy = what, where, remedy
        message = f"{where}: {what}" if where else what
        super().__init__(f"{message}; {remedy}" if remedy else message)

    def __reduce__(self) -> tuple[object, ...]:
        return _rebuild, (type(self), self.what, self.where, self.remedy)


def _rebuild(kind: type[TwolinkError], what: str, where: str, remedy: str) -> TwolinkError:
    """Unpickle an error (keyword-only arguments do not survive Exception's own pickling)."""
    return kind(what, where=where, remedy=remedy)


class RobotError(TwolinkError):
    """The robot cannot be loaded."""


class QueryError(TwolinkError, ValueError):
    """A dynamics query got an argument it cannot answer."""


class SceneError(TwolinkError, ValueError):
    """A scene names something that does not exist, or cannot be simulated."""


class AccuracyError(TwolinkError):
    """The asked accuracy cannot be kept. `run` is the best trajectory that was found, with its error bar, if any."""

    run: Any = None


class CertificationError(TwolinkError):
    """A compiled function disagrees with Pinocchio."""


class ShowError(TwolinkError):
    """A figure or a playback cannot be made."""


class MissingExtraError(TwolinkError, ImportError):
    """An optional library is needed and not installed."""


def nearest(name: str, known: Iterable[str], *, most: int = 12) -> str:
    """A remedy for an unknown name: the nearest right one, or the list when it is short."""
    names = list(known)
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    if close:
        return f"did you mean {close[0]!r}?"
    listed = ", ".join(names[:most]) + (", ..." if len(names) > most else "")
    return f"known: {listed}" if names else "there is none"
