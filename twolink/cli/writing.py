"""The files that --out writes: of a run samples, figures and playbacks, of a study rows and figures; by endings."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from twolink.accuracy import Study
from twolink.cli.options import Misuse
from twolink.cli.printing import say_skipped
from twolink.errors import TwolinkError
from twolink.io.tables import SUFFIXES, require_format
from twolink.show.figure import FORMATS
from twolink.simulation.trajectory import Trajectory


def require_formats(outs: Sequence[Path], known: Sequence[str] = (*SUFFIXES, *FORMATS, ".html")) -> None:
    """Misuse for a file we could not write in the end: said before the run, not after it."""
    for path in outs:
        try:
            require_format(path, known)
        except TwolinkError as error:
            raise Misuse(error.what, where=error.where, remedy=error.remedy) from None


def write(result: Trajectory | Study, outs: Sequence[Path]) -> tuple[list[Path], list[TwolinkError]]:
    """Write a run or a study into each file by its ending. One that fails does not keep the run from the others."""
    written: list[Path] = []
    failures: list[TwolinkError] = []
    for path in outs:
        suffix = path.suffix.lower()
        try:
            if suffix == ".html" and isinstance(result, Trajectory):
                result.playback(path, on_skipped=say_skipped)
            else:
                (result.plot if suffix in FORMATS else result.save)(path)
            written.append(path)
        except TwolinkError as error:
            failures.append(error)
    return written, failures
