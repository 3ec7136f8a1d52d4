"""What commands print, JSON or text, and the files that --out writes by their endings."""

import json
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import typer

from twolink.accuracy import Study
from twolink.cli.failures import Interrupted, Misuse
from twolink.errors import TwolinkError
from twolink.io.tables import SUFFIXES, require_format
from twolink.show.figure import FORMATS
from twolink.simulation.trajectory import Trajectory

RUN_ENDINGS = (*SUFFIXES, *FORMATS, ".html")
STUDY_ENDINGS = (*FORMATS, ".json", *SUFFIXES)


def show(record: Any, text: object, as_json: bool) -> None:
    """Print the record as one line of JSON, or the text.

    Arrays are lists and paths are texts. Numbers that are not finite are refused, because JSON has none.
    """
    typer.echo(json.dumps(record, default=_plain, allow_nan=False) if as_json else text)


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else os.fspath(value)


def print_address(url: str) -> None:
    """Say where a live playback is."""
    typer.echo(f"playing at {url} (Ctrl-C ends it)")


def print_not_drawn(names: Sequence[str]) -> None:
    """Name the shapes that cannot be drawn, on stderr."""
    typer.echo(f"twolink: not drawn: {', '.join(names)}", err=True)


def require_writable(paths: Sequence[Path], endings: Sequence[str]) -> None:
    """Refuse files with other endings, or that cannot be written, before the work begins. Raises Misuse.

    The folder of a file may be new, but not the folder that it is in.
    """
    for path in paths:
        require_format(path, endings, Misuse)
        folder = path.absolute().parent
        folder = folder if folder.exists() else folder.parent
        if not folder.is_dir():
            raise Misuse(f"cannot be written: there is no folder {folder}", where=str(path), remedy="make it first")
        if not os.access(folder, os.W_OK):
            raise Misuse("cannot be written", where=str(path), remedy="give a file in a folder of yours")


def write(paths: Sequence[Path], write_one: Callable[[Path], object]) -> tuple[list[Path], list[TwolinkError]]:
    """Write a result into each file. A file that fails does not keep the result from the others."""
    written: list[Path] = []
    failures: list[TwolinkError] = []
    for path in paths:
        try:
            write_one(path)
            written.append(path)
        except TwolinkError as error:
            failures.append(error)
    return written, failures


def write_by_ending(result: Trajectory | Study, path: Path) -> None:
    """Write a run or a study into a file by its ending."""
    suffix = path.suffix.lower()
    if suffix == ".html" and isinstance(result, Trajectory):
        result.playback(path, on_skipped=print_not_drawn)
    else:
        (result.plot if suffix in FORMATS else result.save)(path)


def finish(failures: Sequence[TwolinkError], interrupted: bool) -> None:
    """End a command whose results are printed and written. Raises its first failure, or Interrupted."""
    if failures:
        raise failures[0]
    if interrupted:
        raise Interrupted
