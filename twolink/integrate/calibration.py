"""What accuracy studies measured on this machine: methods, settings, errors and seconds, kept in the cache folder.

Only studies write here. A simulation by itself does not, so that the same call gives the same bits again.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

from twolink.dynamics import cache
from twolink.errors import TwolinkError
from twolink.integrate.equations import Equations
from twolink.integrate.methods import METHODS
from twolink.io.atomic import write_atomic

FILE = "studies.json"
MAX_SCENES = 200
MARGIN = 3.0  # how many times smaller than the accuracy a measured error must be
SAME_DURATION = 1.01  # a study says nothing about a longer time


@dataclass(frozen=True)
class Measured:
    """One entry of a study: a method at a setting had this error and took these seconds."""

    method: str
    setting: float
    error: float
    seconds: float


def cheapest(equations: Equations, duration: float, accuracy: float) -> Measured | None:
    """The fastest entry for these equations, start and duration whose error is a third of the accuracy at most."""
    try:
        os.stat(cache.location(FILE))  # mostly there is none, and this is the quickest check
    except OSError:
        return None
    path = _path()
    study = None if path is None else _read(path).get(_key(equations))
    if not study or study["duration"] * SAME_DURATION < duration:
        return None
    entries = [Measured(**entry) for entry in study["entries"] if entry["method"] in METHODS]
    good = [entry for entry in entries if entry.error * MARGIN <= accuracy]
    return min(good, key=lambda entry: entry.seconds, default=None)


def record(equations: Equations, duration: float, entries: Iterable[Measured]) -> None:
    """Keep what a study measured, in place of what an earlier one did."""
    path = _path()
    if path is None:
        return
    studies = _read(path)
    studies.pop(_key(equations), None)
    studies[_key(equations)] = {"duration": duration, "entries": [asdict(entry) for entry in entries]}
    while len(studies) > MAX_SCENES:
        del studies[next(iter(studies))]
    try:
        write_atomic(path, lambda file: file.write(json.dumps(studies).encode()), private=True)
        _kept.clear()
    except TwolinkError:
        return  # a full disk costs time, not answers


def _key(equations: Equations) -> str:
    return equations.key("study", equations.start.tobytes().hex())


def _path() -> Path | None:
    folder = cache.folder()
    return None if folder is None else folder / FILE


_kept: dict[tuple[str, int], dict[str, dict[str, object]]] = {}


def _read(path: Path) -> dict:  # type: ignore[type-arg]
    """The file's content; nothing where it is damaged."""
    try:
        stamp = (str(path), path.stat().st_mtime_ns)
        if stamp not in _kept:
            _kept.clear()
            _kept[stamp] = json.loads(path.read_text(encoding="utf-8"))
        return dict(_kept[stamp])
    except (OSError, ValueError):
        return {}
