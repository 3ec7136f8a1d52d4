"""The data folder of a service: opened by one service at a time, repaired when it has to be.

Only what a service wrote is ever moved or deleted: its database, and files with the names that it gives. The files of
robots and results may be in an object store (S3 and the like by URL, or a folder): then each process has copies.
"""

import contextlib
import errno
import logging
import re
import shutil
import sqlite3
import threading
import time
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, cast

from twolink.errors import TwolinkError, import_extra
from twolink.parts.service.problems import Refusal
from twolink.parts.service.store.database import EXTRA, VERSION

DATABASE = "twolink.sqlite"
ROBOTS, RESULTS, VISUALS, STAGING = "robots", "results", "visuals", "staging"
PARTS = (ROBOTS, RESULTS, VISUALS, STAGING)  # what worker processes may write
UPLOADED = re.compile(r"u-[0-9a-f]{20}")  # the id of an uploaded robot
_NAMES = {
    ROBOTS: UPLOADED,
    RESULTS: re.compile(r"(simulation|study|sensitivity|identification|sweep|operation|s)-[0-9a-f]{1,20}"),
}
_CORRUPT = ("SQLITE_CORRUPT", "SQLITE_NOTADB")
NAMED_ROBOTS = 100  # uploaded ones in a request
_CHUNK = 2**20
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


class Copies:
    """The copies that a data folder has of an object store. url: empty: there is no such store, the folder has all.

    A folder of files has a name in the store; its files are objects below it. Methods raise OSError where the store
    fails. Raises TwolinkError for a URL that is none.
    """

    def __init__(self, folder: Path, url: str) -> None:
        self._folder, self._store = folder, cast(Any, None)
        self._known: dict[str, dict[str, Any]] = {}  # files that the store has, by folder
        self._bringing = threading.Lock()
        self._states: dict[str, Any] = {}  # of results that are here, by job
        if not url:
            return
        stores = import_extra("obstore.store", EXTRA)
        self._obstore, errors = import_extra("obstore", EXTRA), import_extra("obstore.exceptions", EXTRA)
        self._failures = errors.BaseError, OSError
        try:
            self._store = stores.from_url(url, **({"mkdir": True} if url.startswith("file:") else {}))
            self._names("robots")
        except (*self._failures, ValueError) as error:
            what = f"the object store cannot be used: {_line(error)}"
            remedy = "check --store and its credentials, such as s3://bucket/folder or file:///shared/folder"
            raise TwolinkError(what, where="serve", code="data", remedy=remedy) from None

    def _names(self, name: str) -> list[str]:
        return [entry["path"] for page in self._obstore.list(self._store, name) for entry in page]

    @contextlib.contextmanager
    def _failing(self) -> Iterator[None]:
        try:
            yield
        except self._failures as error:
            raise OSError(errno.EIO, f"the object store: {_line(error)}") from None

    def check(self) -> None:
        """Raise OSError unless the object store answers."""
        if self._store is not None:
            with self._failing():
                next(iter(self._obstore.list(self._store, ROBOTS, chunk_size=1)), None)

    def keep(self, key: str) -> None:
        """Have the object store have the files of a job's result; or of a robot that is staged; the oldest first.

        Links are left out: only what a worker has written leaves this machine.
        """
        if self._store is None:
            return
        part, place = (ROBOTS, STAGING) if UPLOADED.fullmatch(key) else (RESULTS, RESULTS)
        folder, known = self._folder / place / key, self._known.setdefault(key, {})
        stats = {path: path.stat() for path in folder.rglob("*") if path.is_file() and not path.is_symlink()}
        for path in sorted(stats, key=lambda path: stats[path].st_mtime_ns):
            own, stamp = path.relative_to(folder).as_posix(), (stats[path].st_mtime_ns, stats[path].st_size)
            if known.get(own) != stamp and not path.name.startswith("draft-"):
                with self._failing():
                    self._obstore.put(self._store, f"{part}/{key}/{own}", path)
                known[own] = stamp

    def note(self, key: str, state: Any) -> None:
        """Note that the files of a result are here, as they are in that state of its job."""
        self._states[key] = state

    def bring(self, key: str, state: Any) -> bool:
        """Have the files of a result here, as they are in that state of its job. False where there are none."""
        if self._store is None:
            return (self._folder / RESULTS / key).exists()
        with self._bringing:
            if self._states.get(key) != state:
                self._known.pop(key, None)
                if not self._bring(RESULTS, key):
                    return False
                self.note(key, state)
        return True

    def _bring(self, part: str, key: str) -> bool:
        """Make a folder a copy of what the store has. False, and nothing is done, where that is nothing."""
        name, folder = f"{part}/{key}", self._folder / part / key
        draft = folder.with_name(f"draft-{key}")
        shutil.rmtree(draft, ignore_errors=True)
        with self._failing():
            for path in self._names(name):
                target = draft / path.rpartition(f"{name}/")[2]
                target.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
                with target.open("wb") as file:
                    file.writelines(self._obstore.get(self._store, path).stream(_CHUNK))
        if not draft.exists():
            return False
        shutil.rmtree(folder, ignore_errors=True)
        draft.rename(folder)
        return True

    def named_robots(self, content: bytes) -> set[str]:
        """The ids of uploaded robots in some content; none where all files are here. Raises Refusal (413)."""
        named = set(UPLOADED.findall(content.decode("latin-1"))) if self._store is not None else set[str]()
        if len(named) > NAMED_ROBOTS:
            what = f"it names {len(named)} uploaded robots, the limit is {NAMED_ROBOTS}"
            raise Refusal(413, what, where="body", remedy="ask for them one after the other")
        return named

    def bring_robots(self, keys: Iterable[str]) -> None:
        """Have the files of robots here, which are in the object store."""
        for key in keys:
            with self._bringing:
                if not (self._folder / ROBOTS / key).exists():
                    self._bring(ROBOTS, key)

    def drop(self, part: str, key: str) -> None:
        """Delete the files of a job or a robot, here and there."""
        self._known.pop(key, None)
        self._states.pop(key, None)
        if self._store is not None:
            with self._failing():
                if names := self._names(f"{part}/{key}"):
                    self._obstore.delete(self._store, names)
        shutil.rmtree(self._folder / part / key, ignore_errors=True)


def _line(error: BaseException) -> str:
    """The first line: libraries add their innermost state."""
    return (str(error).splitlines() or [type(error).__name__])[0]
