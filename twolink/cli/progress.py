"""The progress bar of long commands, on stderr."""

import contextlib
import sys
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
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

    label = TextColumn("{task.description}  (Ctrl-C keeps what is done)")
    columns = BarColumn(), TaskProgressColumn(), TimeElapsedColumn(), label
    with Progress(*columns, console=Console(stderr=True), transient=True, redirect_stdout=False) as bar:
        task = bar.add_task("", total=None)
        yield lambda done, total, label: bar.update(task, completed=done, total=total, description=label)
