"""What accuracy studies measured on this machine: methods, settings, errors and seconds, kept in the cache folder.

Only studies write here. A simulation by itself does not, so that the same call gives the same bits again.
"""

import contextlib
import functools
import hashlib
import os
from collections.abc import Iterable
from pathlib import Path

import msgspec

from twolink.effects.effect import plain
from twolink.errors import TwolinkError
from twolink.integrate.motion.equations import Equations
from twolink.integrate.steps.methods import METHODS
from twolink.io import cache
from twolink.io.files import write_atomic
from twolink.io.fingerprints import kernel_key

FILE = "studies.json"
MAX_SCENES = 200
MARGIN = 3.0  # how many times smaller than the accuracy a measured error must be
SAME_DURATION = 1.01  # a study says nothing about a longer time


class Measured(msgspec.Struct, frozen=True):
    """One entry of a study: a method at a setting had this error and took these seconds."""

    method: str
    setting: float
    error: float
    seconds: float


class _Study(msgspec.Struct):
    duration: float
    entries: list[Measured]


def cheapest(equations: Equations, duration: float, accuracy: float) -> Measured | None:
    """The fastest entry for these equations, start and duration whose error is a third of the accuracy at most."""
    try:
        stamp = os.stat(cache.location(FILE)).st_mtime_ns  # mostly there is no file, and this is the quickest check
    except OSError:
        return None
    study = _read(cache.folder(), stamp).get(_key(equations) or "")
    if study is None or study.duration * SAME_DURATION < duration:
        return None
    good = [entry for entry in study.entries if entry.method in METHODS and entry.error * MARGIN <= accuracy]
    return min(good, key=lambda entry: entry.seconds, default=None)


def record(equations: Equations, duration: float, entries: Iterable[Measured]) -> None:
    """Keep what a study measured, in place of what an earlier one did."""
    folder, key = cache.folder(), _key(equations)
    if folder is None or key is None:
        return
    studies = dict(_read.__wrapped__(folder, 0))
    studies.pop(key, None)  # the newest last
    studies[key] = _Study(duration, list(entries))
    newest = dict(list(studies.items())[-MAX_SCENES:])
    with contextlib.suppress(TwolinkError):  # a full disk costs time, not answers
        write_atomic(folder / FILE, lambda file: file.write(msgspec.json.encode(newest)), private=True)
    _read.cache_clear()


def _key(equations: Equations) -> str | None:
    """A name for the motion: the equations, the start, and what happens at events.

    None where it would not say all: a class or a function of the user's own takes part in events.
    """
    tables = [(table.times, getattr(table, "values", ())) for table in equations.layout.tables]
    parts: list[object] = [equations.start.tolist(), tables]
    if (switching := equations.switching) is not None:
        if not all(type(effect).__module__.startswith("twolink.") for effect in switching.effects):
            return None
        try:
            parts.append(msgspec.json.encode(switching.effects, enc_hook=plain))
        except TypeError:
            return None
        touching = [contact.content for _, contact in switching.contacts] + [
            pair.content for _, pair in switching.pairs
        ]
        parts += [kernel_key(switching.base.model, touching), switching.holds, switching.stops]
    return equations.key("study", hashlib.sha256(repr(parts).encode()).hexdigest())


@functools.lru_cache(1)
def _read(folder: Path | None, _stamp: int) -> dict[str, _Study]:
    """The studies in the folder's file of this time stamp; none where it is damaged."""
    try:
        return {} if folder is None else msgspec.json.decode((folder / FILE).read_bytes(), type=dict[str, _Study])
    except (OSError, msgspec.MsgspecError):
        return {}
