"""The progress bar of long commands, on stderr."""

import contextlib
import sys
import time
from collections.abc import Callable, Iterator

Report = Callable[[float, float, str], None]


@contextlib.contextmanager
def progress_bar() -> Iterator[Report]:
    """A progress bar, as a function of what is done, the total, and a label of the work under way.

    It shows nothing where stderr is no terminal, so that programs see none.
    """
    if not sys.stderr.isatty():
        yield lambda _done, _total, _label: None
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        TaskProgressColumn,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    label = TextColumn("{task.description}  (Ctrl-C keeps what is done)")
    left = TextColumn("left:"), TimeRemainingColumn()
    columns = BarColumn(), TaskProgressColumn(), TextColumn("{task.fields[rate]}"), TimeElapsedColumn(), *left, label
    begun = time.monotonic()
    with Progress(*columns, console=Console(stderr=True), transient=True, redirect_stdout=False) as bar:
        task = bar.add_task("", total=None, rate="")

        def report(done: float, total: float, label: str) -> None:
            rate = f"{done / max(time.monotonic() - begun, 1e-3):.3g}/s"
            bar.update(task, completed=done, total=total, description=label, rate=rate)

        yield report
