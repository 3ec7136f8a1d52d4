"""The disk cache of compiled kernels: the user's own folder, whole files, checked before they are opened.

Loading a kernel runs what is in the file. A file therefore counts only when it and its folder belong to the user,
when nobody else can write there, and when its digest matches its content and its name: a kernel under another
kernel's name is refused. Other files are left alone, whoever put them there; a kernel that is refused is built again.
"""

import contextlib
import functools
import hashlib
import os
import pickle
import stat
from pathlib import Path
from typing import Any

import platformdirs

from twolink.errors import TwolinkError
from twolink.io.files import write_atomic

MAGIC = b"twolink kernel 2\n"
SUFFIX = ".kernel"
_DIGEST = hashlib.sha256().digest_size
_LOOKS = 64  # at all files of the folder, while as much as the limit is stored
_KEPT = 7 / 8  # of the limit, where some are deleted: files are opened then, which should not come often


def folder() -> Path | None:
    """The cache's folder, made with private permissions; None where there can be none (TWOLINK_CACHE=off)."""
    place = location()
    if not place:
        return None
    try:
        if not os.path.exists(place):
            Path(place).mkdir(mode=0o700, parents=True, exist_ok=True)
        return Path(place) if _is_private(os.stat(place), stat.S_ISDIR) else None
    except OSError:
        return None  # a read-only home: every process compiles for itself


def location(file: str = "") -> str:
    """The path of the folder, or of a file in it, whether it exists or not; empty with TWOLINK_CACHE=off."""
    place = os.environ.get("TWOLINK_CACHE", "") or _user_folder()
    if place == "off":
        return ""
    return os.path.join(place, file) if file else place


def kernel_path(name: str) -> Path | None:
    """The path of the kernel of this name, whether it exists or not; None where there is no folder."""
    place = folder()
    return None if place is None else place / f"{name}{SUFFIX}"


@functools.cache
def _user_folder() -> str:
    return str(platformdirs.user_cache_path("twolink", appauthor=False))


def _is_private(info: os.stat_result, right_kind: Any) -> bool:
    is_users = not hasattr(os, "getuid") or info.st_uid == os.getuid()
    return bool(is_users and right_kind(info.st_mode) and not info.st_mode & (stat.S_IWGRP | stat.S_IWOTH))


def has(name: str) -> bool:
    """True if there is a file for this name; `load` tells whether it can be used."""
    return os.path.exists(location(f"{name}{SUFFIX}"))


def load(name: str) -> Any:
    """The content stored under this name, or None: absent, damaged, another kernel's, or not the user's own."""
    path = kernel_path(name)
    try:
        handle = os.open(path or "", os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0))
    except OSError:
        return None
    with os.fdopen(handle, "rb") as file:
        if not _is_private(os.fstat(handle), stat.S_ISREG):
            return None
        head, payload = file.read(len(MAGIC) + _DIGEST), file.read()
    if head != _head(name, payload):
        return None
    try:
        content = pickle.loads(payload)
    except Exception:  # whatever an outdated file raises, it is built again
        return None
    with contextlib.suppress(OSError):  # a worker of the service may set no times
        os.utime(str(path))  # the least recently used is deleted first
    return content


def store(name: str, content: Any) -> None:
    """Store content under this name, whole or not at all, and keep all kernels below TWOLINK_CACHE_MB (512).

    A folder of years has 100,000 files, which take a second to look at. So the digest draws who looks: on the mean one
    each time that all processes have stored a 64th of the limit.
    """
    path = kernel_path(name)
    if path is None:
        return
    payload = pickle.dumps(content)
    try:
        head, limit = _head(name, payload), _limit()
        write_atomic(path, lambda file: file.write(head + payload), private=True)
        if int.from_bytes(head[-8:]) * limit <= 2**64 * _LOOKS * len(payload):
            _shrink(path.parent, limit)
    except (OSError, TwolinkError):
        return  # a full disk costs time, not answers


def _head(name: str, payload: bytes) -> bytes:
    return MAGIC + hashlib.sha256(name.encode() + b"\0" + payload).digest()


def _limit() -> int:
    """The largest size of all kernels, bytes."""
    setting = os.environ.get("TWOLINK_CACHE_MB", "512")
    return (int(setting) if setting.isdigit() else 512) * 2**20


def _shrink(place: Path, limit: int) -> None:
    """Delete the least recently used kernels where all together are above the limit. Other files do not count.

    Kernels that a killed process has begun to write, under names of their own, are among them.
    """
    with os.scandir(place) as entries:  # thousands of files: they are opened only where one is to be deleted
        if sum(entry.stat(follow_symlinks=False).st_size for entry in entries if SUFFIX in entry.name) <= limit:
            return
    candidates = (*place.glob(f"*{SUFFIX}"), *place.glob(f".*{SUFFIX}.*"))
    written = [(path, path.stat()) for path in candidates if _is_kernel(path)]
    kernels = [(info.st_mtime, info.st_size, path) for path, info in written]
    total = sum(size for _, size, _ in kernels)
    for _, size, path in sorted(kernels):
        if total <= _KEPT * limit:
            return
        path.unlink(missing_ok=True)
        total -= size


def _is_kernel(path: Path) -> bool:
    """True if this module wrote the file."""
    if path.is_symlink() or not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(MAGIC)) == MAGIC
