"""Where a URDF comes from: a name of the catalogue, a file, or text."""

import os
from dataclasses import dataclass
from pathlib import Path

from twolink.errors import RobotError
from twolink.io.text import read_bytes
from twolink.robots.catalogue import CatalogueEntry, catalogue_entry, catalogue_names
from twolink.robots.xml import MAX_BYTES

_REMEDY = "pass a name, a path or URDF text"


@dataclass(frozen=True)
class Source:
    """The bytes of a URDF, with the name that errors and the report use for it."""

    label: str
    data: bytes
    path: Path | None = None
    entry: CatalogueEntry | None = None
    encoding: str | None = None


def open_source(source: str | os.PathLike[str]) -> Source:
    """Text when it looks like XML, a file when it looks like a path, else a name of the catalogue."""
    if isinstance(source, str) and "<" in source:
        return Source("URDF text", source.encode("utf-8", "surrogatepass"), encoding="utf-8")
    if not isinstance(source, (str, os.PathLike)):
        what = f"a {type(source).__name__} is not a robot"
        raise RobotError(what, where="load_robot", remedy=_REMEDY, argument="source")
    text = os.fspath(source)
    if not isinstance(text, str) or not text.strip():
        raise RobotError("the source is empty", where="load_robot", remedy=_REMEDY, argument="source")
    looks_like_path = isinstance(source, os.PathLike) or os.sep in text or text.endswith((".urdf", ".xml", ".xacro"))
    if not looks_like_path and (text in catalogue_names() or not os.path.isfile(text)):
        entry = catalogue_entry(text)
        return Source(entry.path.name, read_bytes(entry.path, RobotError, MAX_BYTES), entry.path, entry)
    path = Path(text)
    return Source(path.name, read_bytes(path, RobotError, MAX_BYTES), path)
