"""The files that `twolink run --out` writes: samples, figures and playbacks, by their endings."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from twolink.cli_options import Misuse
from twolink.cli_print import say_skipped
from twolink.errors import TwolinkError
from twolink.files import SUFFIXES, require_format
from twolink.show.plots import FORMATS
from twolink.trajectory import Trajectory


def require_formats(outs: Sequence[Path]) -> None:
    """Misuse for a file we could not write in the end: said before the run, not after it."""
    for path in outs:
        try:
            require_format(path, (*SUFFIXES, *FORMATS, ".html"))
        except TwolinkError as error:
            raise Misuse(error.what, where=error.where, remedy=error.remedy) from None


def write(result: Trajectory, outs: Sequence[Path]) -> tuple[list[Path], list[TwolinkError]]:
    """Write a run into each file by its ending. One that fails does not keep the run from the others."""
    written: list[Path] = []
    failures: list[TwolinkError] = []
    for path in outs:
        suffix = path.suffix.lower()
        try:
            if suffix == ".html":
                result.playback(path, on_skipped=say_skipped)
            else:
                (result.plot if suffix in FORMATS else result.save)(path)
            written.append(path)
        except TwolinkError as error:
            failures.append(error)
    return written, failures
