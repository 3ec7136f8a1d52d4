"""The files that --out writes, by their endings: of a run samples, figures and playbacks; of a study rows, figures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from twolink.accuracy import Study
from twolink.cli.failures import Interrupted, Misuse
from twolink.cli.printing import print_not_drawn
from twolink.errors import TwolinkError
from twolink.io.tables import SUFFIXES, require_format
from twolink.show.figure import FORMATS
from twolink.simulation.trajectory import Trajectory

RUN_ENDINGS = (*SUFFIXES, *FORMATS, ".html")
STUDY_ENDINGS = (*FORMATS, ".json", *SUFFIXES)


def require_endings(paths: Sequence[Path], endings: Sequence[str]) -> None:
    """Refuse files with other endings, before the work begins. Raises Misuse."""
    for path in paths:
        require_format(path, endings, Misuse)


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
