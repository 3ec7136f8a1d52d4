"""Files of robots and results in an object store (S3 and the like by URL, or a folder): each process has copies."""

import contextlib
import errno
import shutil
import threading
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from twolink.errors import TwolinkError, import_extra
from twolink.parts.service.problems import Refusal
from twolink.parts.service.store.data_folder import RESULTS, ROBOTS, STAGING, UPLOADED
from twolink.parts.service.store.database import EXTRA

NAMED_ROBOTS = 100  # uploaded ones in a request
_CHUNK = 2**20


class Objects:
    """An object store. A folder of files has a name; its files are objects below it.

    Its methods raise OSError where the store fails. Raises TwolinkError for a URL that is none.
    """

    def __init__(self, url: str) -> None:
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

    def keep(self, name: str, folder: Path, known: dict[str, Any]) -> None:
        """Put the files of a folder there, the oldest first, but for those that are there. known: which are; it grows.

        Links are left out: only what a worker has written leaves this machine.
        """
        stats = {path: path.stat() for path in folder.rglob("*") if path.is_file() and not path.is_symlink()}
        for path in sorted(stats, key=lambda path: stats[path].st_mtime_ns):
            own, stamp = path.relative_to(folder).as_posix(), (stats[path].st_mtime_ns, stats[path].st_size)
            if known.get(own) != stamp and not path.name.startswith("draft-"):
                with self._failing():
                    self._obstore.put(self._store, f"{name}/{own}", path)
                known[own] = stamp

    def bring(self, name: str, folder: Path) -> bool:
        """Make `folder` a copy of what is there under that name. False, and nothing is done, where nothing is."""
        draft = folder.with_name(f"draft-{folder.name}")
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

    def drop(self, name: str) -> None:
        """Delete what is there under that name."""
        with self._failing():
            if names := self._names(name):
                self._obstore.delete(self._store, names)

    def check(self) -> None:
        """Raise OSError unless it answers."""
        with self._failing():
            next(iter(self._obstore.list(self._store, ROBOTS, chunk_size=1)), None)

    @contextlib.contextmanager
    def _failing(self) -> Iterator[None]:
        try:
            yield
        except self._failures as error:
            raise OSError(errno.EIO, f"the object store: {_line(error)}") from None


class Copies:
    """The copies that a data folder has of an object store. url: empty: there is no such store, the folder has all."""

    def __init__(self, folder: Path, url: str) -> None:
        self._folder, self._objects = folder, Objects(url) if url else None
        self._known: dict[str, dict[str, Any]] = {}  # files that the store has, by folder
        self._bringing = threading.Lock()
        self._states: dict[str, Any] = {}  # of results that are here, by job

    def check(self) -> None:
        """Raise OSError unless the object store answers."""
        if self._objects is not None:
            self._objects.check()

    def keep(self, key: str) -> None:
        """Have the object store have the files of a job's result; or of a robot that is staged."""
        if self._objects is not None:
            part, place = (ROBOTS, STAGING) if UPLOADED.fullmatch(key) else (RESULTS, RESULTS)
            self._objects.keep(f"{part}/{key}", self._folder / place / key, self._known.setdefault(key, {}))

    def note(self, key: str, state: Any) -> None:
        """Note that the files of a result are here, as they are in that state of its job."""
        self._states[key] = state

    def bring(self, key: str, state: Any) -> bool:
        """Have the files of a result here, as they are in that state of its job. False where there are none."""
        folder = self._folder / RESULTS / key
        if self._objects is None:
            return folder.exists()
        with self._bringing:
            if self._states.get(key) != state:
                self._known.pop(key, None)
                if not self._objects.bring(f"{RESULTS}/{key}", folder):
                    return False
                self.note(key, state)
        return True

    def named_robots(self, content: bytes) -> set[str]:
        """The ids of uploaded robots in some content; none where all files are here. Raises Refusal (413)."""
        named = set(UPLOADED.findall(content.decode("latin-1"))) if self._objects is not None else set[str]()
        if len(named) > NAMED_ROBOTS:
            what = f"it names {len(named)} uploaded robots, the limit is {NAMED_ROBOTS}"
            raise Refusal(413, what, where="body", remedy="ask for them one after the other")
        return named

    def bring_robots(self, keys: Iterable[str]) -> None:
        """Have the files of robots here."""
        for key in keys:
            folder = self._folder / ROBOTS / key
            with self._bringing:
                if self._objects is not None and not folder.exists():
                    self._objects.bring(f"{ROBOTS}/{key}", folder)

    def drop(self, part: str, key: str) -> None:
        """Delete the files of a job or a robot, here and there."""
        self._known.pop(key, None)
        self._states.pop(key, None)
        if self._objects is not None:
            self._objects.drop(f"{part}/{key}")
        shutil.rmtree(self._folder / part / key, ignore_errors=True)


def _line(error: BaseException) -> str:
    """The first line: libraries add their innermost state."""
    return (str(error).splitlines() or [type(error).__name__])[0]
