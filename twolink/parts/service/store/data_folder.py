"""The data folder of a service: opened by one service at a time, repaired when it has to be.

Only what a service wrote is ever moved or deleted: its database, and files with the names that it gives.
"""

import contextlib
import logging
import re
import shutil
import sqlite3
import time
from collections.abc import Container, Mapping, Sequence
from pathlib import Path

from twolink.errors import TwolinkError
from twolink.parts.service.store.database import VERSION

DATABASE = "twolink.sqlite"
ROBOTS, RESULTS, VISUALS, STAGING = "robots", "results", "visuals", "staging"
PARTS = (ROBOTS, RESULTS, VISUALS, STAGING)  # what worker processes may write
UPLOADED = re.compile(r"u-[0-9a-f]{20}")  # the id of an uploaded robot
_NAMES = {
    ROBOTS: UPLOADED,
    RESULTS: re.compile(r"(simulation|study|sensitivity|identification|sweep|operation|s)-[0-9a-f]{1,20}"),
}
_CORRUPT = ("SQLITE_CORRUPT", "SQLITE_NOTADB")
_log = logging.getLogger("twolink.service")


def open_folder(folder: Path) -> sqlite3.Connection:
    """Open the data folder, which is made if there is none, and its database.

    A database that cannot be read is moved with its files into a folder of its own, and a new one is begun.

    Raises
    ------
    TwolinkError
        Another service uses the folder, it has files of somebody else, or it cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        _require_own(folder)
        try:
            database = _open_database(folder / DATABASE)
        except sqlite3.DatabaseError as error:
            if not _is_corrupt(error):
                raise
            what = "the database cannot be read (%s): it is kept with its files in %s, a new one begins"
            _log.error(what, error, _set_aside(folder))
            database = _open_database(folder / DATABASE)
        for part in PARTS:
            (folder / part).mkdir(exist_ok=True, mode=0o700)
    except (OSError, sqlite3.Error) as error:
        raise unusable(folder, error) from None
    return database


def unusable(folder: Path, error: OSError | sqlite3.Error) -> TwolinkError:
    """The failure of a start with a folder that cannot be used."""
    remedy = "end the service that uses it" if "locked" in str(error) else "check the folder and the disk"
    what = f"cannot be used: {error}"
    return TwolinkError(what, where=str(folder), remedy=f"{remedy}, or give another --data", code="data")


def _require_own(folder: Path) -> None:
    """Refuse a folder in which a part has files that no service wrote."""
    if (folder / DATABASE).exists():
        return
    for part in PARTS:
        if (folder / part).exists() and any((folder / part).iterdir()):
            what = f"{part!r} in it has files, and there is no {DATABASE}: it is not a data folder of twolink"
            raise TwolinkError(what, where=str(folder), remedy="give an empty folder as --data", code="data")


def _open_database(path: Path) -> sqlite3.Connection:
    """The database, with the tables of this version. It is locked until it is closed, or the process ends."""
    database = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
    try:
        for setting in ("locking_mode = EXCLUSIVE", "journal_mode = WAL", "synchronous = NORMAL"):
            database.execute(f"PRAGMA {setting}")
        version = database.execute("PRAGMA user_version").fetchone()[0]
        if version > VERSION:
            raise sqlite3.OperationalError(f"it is of a newer version of twolink ({version}, this one has {VERSION})")
        while version < VERSION:
            (step,) = Path(__file__).parent.glob(f"schema_{version}_to_*.sql")
            database.executescript(f"BEGIN; {step.read_text(encoding='utf-8')} COMMIT")
            version = int(step.stem.rpartition("_")[2])
        state = database.execute("PRAGMA quick_check(1)").fetchone()[0]
        if state != "ok":
            raise sqlite3.DatabaseError(state)
    except BaseException:
        database.close()
        raise
    return database


def _is_corrupt(error: sqlite3.DatabaseError) -> bool:
    name = getattr(error, "sqlite_errorname", "")  # quick_check's own answer comes without one
    return name.startswith(_CORRUPT) if name else type(error) is sqlite3.DatabaseError


def _set_aside(folder: Path) -> Path:
    """Move the database and all that it knew into a new folder beside them, and return that folder."""
    place = folder / f"set-aside-{time.strftime('%Y%m%dT%H%M%S')}-{time.time_ns() % 10**9:09d}"
    place.mkdir(mode=0o700)
    for name in (RESULTS, ROBOTS, f"{DATABASE}-wal", f"{DATABASE}-shm", DATABASE):
        with contextlib.suppress(FileNotFoundError):
            (folder / name).rename(place / name)
    return place


def tidy(folder: Path, robots: Container[str], results: Container[str], *, staging: bool = True) -> None:
    """Delete what a service that was killed has left: staged uploads, and files of robots and jobs it had deleted."""
    parts: list[tuple[str, Container[str]]] = [(ROBOTS, robots), (RESULTS, results), *[(STAGING, ())] * staging]
    for part, known in parts:
        pattern = _NAMES[ROBOTS if part == STAGING else part]
        for path in (folder / part).iterdir():
            if path.name not in known and pattern.fullmatch(path.name):
                shutil.rmtree(path, ignore_errors=True)


def size_of(folder: Path) -> int:
    """Bytes of all files below a folder. Files that vanish meanwhile do not count."""
    total = 0
    for path in folder.rglob("*"):
        with contextlib.suppress(FileNotFoundError):
            total += path.stat().st_size if path.is_file() else 0
    return total


def to_remove(
    jobs: Sequence[tuple[str, str, int]], sizes: Mapping[str, int], limits: Mapping[str, float], excess: float
) -> list[str]:
    """The jobs to remove until their owners keep to their limits and all take `excess` bytes less.

    jobs: id, owner and bytes, the last used first. sizes, limits: bytes by owner. The owner who has most loses first.
    """
    left, waiting, removed = dict(sizes), dict[str, list[tuple[str, int]]](), list[str]()
    for key, owner, size in jobs:
        waiting.setdefault(owner, []).append((key, size))
    while waiting:
        owner = max(waiting, key=lambda owner: (left[owner] > limits[owner], left[owner]))
        if excess <= 0 and left[owner] <= limits[owner]:
            break
        key, size = waiting[owner].pop()
        removed.append(key)
        excess, left[owner] = excess - size, left[owner] - size
        if not waiting[owner]:
            del waiting[owner]
    return removed
