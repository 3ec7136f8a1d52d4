"""Files: written whole or not at all, and those that other files name, opened only inside a folder.

A URDF or a mesh may come from a stranger. Whatever a name in it looks like, the file is judged where it is opened.
"""

import contextlib
import contextvars
import errno
import os
import secrets
import stat
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

from twolink.errors import QueryError, TwolinkError, shown

_roots: contextvars.ContextVar[tuple[Path, ...] | None] = contextvars.ContextVar("confining_roots", default=None)


@contextlib.contextmanager
def confined(*roots: Path) -> Iterator[None]:
    """Within it, models, scenes, tables and meshes are read in these folders alone, and no xacro is expanded."""
    token = _roots.set(tuple(root.resolve() for root in roots))
    try:
        yield
    finally:
        _roots.reset(token)


def confining_roots() -> tuple[Path, ...] | None:
    """The folders that files must lie in, after all links; None where any may be read."""
    return _roots.get()


def may_be_read(path: Path) -> bool:
    """True if `confined` admits a path."""
    roots = _roots.get()
    return roots is None or any(path.resolve().is_relative_to(root) for root in roots)


def path_to_write(given: Any) -> Path:
    """The path that a user gave for a file. Raises QueryError for what is none."""
    try:
        return Path(given)
    except TypeError:
        what, remedy = f"expected the path of a file, got {shown(given)}", "give a text or a pathlib.Path"
        raise QueryError(what, argument="path", remedy=remedy) from None


def write_atomic(
    path: Path, write: Callable[[BinaryIO], object], *, private: bool = False, error: type[TwolinkError] = TwolinkError
) -> Path:
    """Write a file so that readers see the old content or all of the new one, never a part.

    The content goes to a temporary file in the same folder, which then replaces the path. A failure leaves the old
    file as it was.

    Parameters
    ----------
    path : Path
        The file. Its folder is created if it does not exist.
    write : callable
        Writes the content to the binary file that it gets.
    private : bool
        Whether only the user may read the file (mode 0600), whatever the umask is.
    error : type
        The class of the failure.

    Returns
    -------
    Path
        The path.

    Raises
    ------
    error
        Code "not-writable": the folder or the file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        draft, mode = path.with_name(f".{path.name}.{secrets.token_hex(4)}"), 0o600 if private else 0o666
        try:
            with open(draft, "xb", opener=lambda name, flags: os.open(name, flags, mode)) as file:
                write(file)
            draft.replace(path)
        finally:
            draft.unlink(missing_ok=True)  # nothing is left to remove after a success
    except OSError as failure:
        what = f"cannot be written: {failure.strerror or failure}"
        raise error(what, where=str(path), remedy="check the folder and the disk", code="not-writable") from None
    return path


def read_confined(root: Path, name: str | Path, limit: int) -> bytes:
    """The content of a regular file in a folder.

    Parameters
    ----------
    root : Path
        The folder that the file must lie in, after all symbolic links.
    name : str or Path
        The file, relative to `root`, or an absolute path.
    limit : int
        The largest size, bytes.

    Raises
    ------
    OSError
        The file is missing, outside, too large, or no regular file (a device or a pipe may have no end).
    """
    try:
        path = (root / name).resolve()
        is_inside = path.is_relative_to(root.resolve())
    except (ValueError, RuntimeError):  # a NUL in the name, a loop of links
        raise OSError(errno.EINVAL, "not the name of a file", str(name)) from None
    if not is_inside:
        raise OSError(errno.EACCES, f"outside {root}", str(name))
    flags = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    with os.fdopen(os.open(path, flags), "rb") as file:
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise OSError(errno.EINVAL, "not a regular file", str(name))
        content = file.read(limit + 1)
    if len(content) > limit:
        raise OSError(errno.EFBIG, f"larger than {limit} bytes", str(name))
    return content
