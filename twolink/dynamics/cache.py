"""The disk cache of compiled kernels: the user's own folder, whole files, checked before they are opened.

Loading a kernel runs what is in the file, so that a file counts only when it and the folder belong to the user and
nobody else can write there, and when its digest matches. Anything else is left alone and built again.
"""

from __future__ import annotations

import functools
import hashlib
import os
import pickle
import stat
from pathlib import Path
from typing import Any

from twolink.errors import TwolinkError
from twolink.io.atomic import write_atomic

DIGEST = hashlib.sha256().digest_size


def folder() -> Path | None:
    """The cache's folder, made with private permissions; None where there can be none (TWOLINK_CACHE=off)."""
    name = location()
    return _private_folder(name) if name else None


def location(file: str = "") -> str:
    """Where the folder, or a file in it, is or would be; empty with TWOLINK_CACHE=off. Nothing is looked at."""
    environment = os.environ
    setting, base = environment.get("TWOLINK_CACHE", ""), environment.get("XDG_CACHE_HOME", "")
    return _location(setting, base, environment.get("HOME", ""), file)


@functools.lru_cache(64)
def _location(setting: str, base: str, home: str, file: str) -> str:
    del home  # what the home folder depends on
    if setting == "off":
        return ""
    place = setting or os.path.join(base or os.path.join(os.path.expanduser("~"), ".cache"), "twolink")
    return os.path.join(place, file) if file else place


def _private_folder(name: str) -> Path | None:
    try:
        return Path(name) if _is_private(os.stat(name), stat.S_ISDIR) else None
    except FileNotFoundError:
        return _made_folder(name)
    except OSError:
        return None


def _made_folder(name: str) -> Path | None:
    try:
        Path(name).mkdir(mode=0o700, parents=True, exist_ok=True)
        return Path(name) if _is_private(os.stat(name), stat.S_ISDIR) else None
    except OSError:
        return None  # a read-only home: every process compiles for itself


def _is_private(info: os.stat_result, right_kind: Any) -> bool:
    ours = not hasattr(os, "getuid") or info.st_uid == os.getuid()
    return bool(ours and right_kind(info.st_mode) and not info.st_mode & (stat.S_IWGRP | stat.S_IWOTH))


def load(name: str) -> Any:
    """The content stored under this name, or None: absent, damaged, or not the user's own."""
    place = folder()
    if place is None:
        return None
    try:
        handle = os.open(place / name, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0))
    except OSError:
        return None
    with os.fdopen(handle, "rb") as file:
        if not _is_private(os.fstat(handle), stat.S_ISREG):
            return None
        data = file.read()
    if hashlib.sha256(data[DIGEST:]).digest() != data[:DIGEST]:
        return None
    try:
        content = pickle.loads(data[DIGEST:])
        os.utime(place / name)  # the least recently used goes first
    except Exception:  # whatever an outdated file raises, it is built again
        return None
    return content


def store(name: str, content: Any) -> None:
    """Store content under this name, whole or not at all, and keep the folder below its size."""
    place = folder()
    if place is None:
        return
    payload = pickle.dumps(content)
    content = hashlib.sha256(payload).digest() + payload
    try:
        write_atomic(place / name, lambda file: file.write(content), private=True)
        _shrink(place)
    except (OSError, TwolinkError):
        return  # a full disk costs time, not answers


def _shrink(place: Path) -> None:
    """Remove the least recently used files until the folder is below TWOLINK_CACHE_MB (512)."""
    setting = os.environ.get("TWOLINK_CACHE_MB", "512")
    limit = (int(setting) if setting.isdigit() else 512) * 2**20
    files = []
    for entry in os.scandir(place):
        info = entry.stat(follow_symlinks=False)
        files.append((info.st_mtime, info.st_size, entry.path))
    total = sum(size for _, size, _ in files)
    for _, size, path in sorted(files):
        if total <= limit:
            return
        Path(path).unlink(missing_ok=True)
        total -= size
