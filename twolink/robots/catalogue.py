"""The robots known by name, ours in urdf/ and those of example-robot-data listed in examples.csv; and where a URDF
comes from: such a name, a file, or text.

example-robot-data 6 ships data only; the names are those of its former Python loader, which users know.
"""

import csv
import functools
import os
import sysconfig
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, cast

from twolink.errors import RobotError, nearest, shown
from twolink.io.text import read_bytes
from twolink.robots.xml import MAX_BYTES

Root = Literal["fixed", "free"]

# Without a joint: fixed to the world they do not move.
_SINGLE_BODIES = ("ball", "box", "can", "heavy_top", "plank", "rattleback", "spinning_box", "tippe_top")
_NOT_URDF = {
    "cassie": "example-robot-data describes Cassie in SDF only (it has closed loops, which URDF cannot hold)",
    "talos_legs": "it is not a file: the former loader cut it out of Talos in code",
}
FILES = (".urdf", ".xml", ".xacro", ".mjcf", ".sdf", ".usd", ".usda", ".usdc", ".usdz")
_REMEDY = "pass a name, a path, or the text of a URDF or MJCF"


@dataclass(frozen=True)
class CatalogueEntry:
    """A robot known by name: its URDF, the root it is meant to have, and the package it comes from."""

    name: str
    path: Path
    usual_root: Root
    origin: str


@functools.cache
def examples_share() -> Path | None:
    """The folder that `package://example-robot-data/...` counts from, or None when it is not installed."""
    paths = sysconfig.get_paths()
    shares = (Path(paths[key]) / "cmeel.prefix" / "share" for key in ("purelib", "platlib"))
    return next((share for share in shares if (share / "example-robot-data" / "robots").is_dir()), None)


@functools.cache
def _examples() -> dict[str, tuple[str, Root]]:
    """The file below example-robot-data/robots and the usual root of each robot, by name."""
    with (Path(__file__).parent / "examples.csv").open(newline="", encoding="utf-8") as file:
        return {row["name"]: (row["file"], cast(Root, row["root"])) for row in csv.DictReader(file)}


@functools.cache
def our_urdfs() -> Path:
    """The folder of our own URDFs: inside the installed package, or at the top of a checkout."""
    package = Path(__file__).resolve().parent.parent
    installed = package / "urdf"
    return installed if installed.is_dir() else package.parent / "urdf"


def catalogue_folders() -> tuple[Path, ...]:
    """The folders of the catalogue's robots and their meshes."""
    share = examples_share()
    return (our_urdfs(), *([] if share is None else [share / "example-robot-data"]))


def catalogue_names() -> tuple[str, ...]:
    """All names that `load_robot` knows here: ours first, then those of example-robot-data."""
    ours = sorted(p.stem for p in our_urdfs().glob("*.urdf"))
    examples = [] if examples_share() is None else list(_examples())
    return (*ours, *(n for n in examples if n not in ours))


def catalogue_entry(name: str) -> CatalogueEntry:
    """The entry of a name.

    Raises
    ------
    RobotError
        Code "unknown-robot", with the nearest name; code "missing-extra" where example-robot-data is not installed.
    """
    ours = our_urdfs() / f"{name}.urdf"
    if ours.stem == name and ours in our_urdfs().glob("*.urdf"):
        return CatalogueEntry(name, ours, "free" if name in _SINGLE_BODIES else "fixed", "twolink")
    share = examples_share()
    if name in _examples() and share is not None:
        file, root = _examples()[name]
        return CatalogueEntry(name, share / "example-robot-data" / "robots" / file, root, "example-robot-data")
    where, code = f"robot {name!r}", "unknown-robot"
    if name in _NOT_URDF:
        raise RobotError(_NOT_URDF[name], where=where, remedy="pass a URDF of it", code=code)
    if name in _examples():
        remedy = "pip install example-robot-data"
        raise RobotError("example-robot-data is not installed", where=where, remedy=remedy, code="missing-extra")
    what = f"no robot of this name, and no such file: {shown(name)}"
    remedy = f"{nearest(name, catalogue_names())} (`twolink robots` lists them)"
    raise RobotError(what, where="load_robot", remedy=remedy, code=code, argument="source")


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
    looks_like_path = isinstance(source, os.PathLike) or os.sep in text or text.endswith(FILES)
    if not looks_like_path and (text in catalogue_names() or not os.path.isfile(text)):
        entry = catalogue_entry(text)
        return Source(entry.path.name, read_bytes(entry.path, RobotError, MAX_BYTES), entry.path, entry)
    path = Path(text)
    return Source(path.name, read_bytes(path, RobotError, MAX_BYTES), path)
