"""The progress bar of long commands, on stderr."""

from __future__ import annotations

import sys


class Progress:
    """A progress bar on stderr. It shows nothing where stderr is no terminal, so that programs see none."""

    def __init__(self) -> None:
        self._bar = None
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeElapsedColumn
            from rich.progress import Progress as Bar

            columns = (BarColumn(), TaskProgressColumn(), TimeElapsedColumn(), TextColumn("{task.description}"))
            console = Console(stderr=True)
            self._bar = Bar(*columns, console=console, transient=True, redirect_stdout=False, refresh_per_second=4)
            self._task = self._bar.add_task("", total=None)

    def __enter__(self) -> Progress:
        if self._bar is not None:
            self._bar.start()
        return self

    def __call__(self, done: float, total: float, label: str) -> None:
        """Show that `done` of `total` is done, and a label of the work under way."""
        if self._bar is not None:
            label = f"{label}  (Ctrl-C keeps what is done)"
            self._bar.update(self._task, completed=done, total=total, description=label)

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()
