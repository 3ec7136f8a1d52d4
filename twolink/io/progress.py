"""Progress of long work: one signature for the `progress` of every call, and a bar that shows it."""

import contextlib
import html
import inspect
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any, Protocol

from twolink.errors import SceneError

Report = Callable[[float, float, str], None]
"""Called now and then with what is done, the total, and a label: simulated seconds, simulations, runs or pictures."""


def in_time(progress: Report | None, duration: float) -> Callable[[float], None] | None:
    """The callback for solvers, of the simulated time [s], of a run of so many seconds. Raises SceneError."""
    if progress is None:
        return None
    try:
        inspect.signature(progress).bind(0.0, duration, "")
    except TypeError:
        raise SceneError("expected a function of what is done, the total and a label", argument="progress",
                         remedy="such as lambda done, total, label: print(label)") from None  # fmt: skip
    except ValueError:  # a function of C, whose signature is not known
        pass
    return lambda t: progress(t, duration, f"t = {t:.4g} s")


BETWEEN = 0.1  # s: a notebook's bar is sent anew at most so often


class Bar(Protocol):
    """Tells what is done, the total where it is known, and a label of the work under way."""

    def __call__(self, done: float, total: float | None = None, label: str = "") -> None:
        """Show it."""


@contextlib.contextmanager
def progress_bar() -> Iterator[Bar]:
    """A progress bar: a function of what is done, the total and a label.

    Yields
    ------
    callable
        report(done, total=None, label=""). It goes as the `progress` of `simulate`, `accuracy_study` and others.

    Notes
    -----
    In a terminal the bar is on stderr, with rate and time left, and vanishes at the end. Elsewhere, such as in a
    program's log, nothing is shown.
    """
    if _in_notebook():
        yield _in_cell()
    elif sys.stderr.isatty():
        with _in_terminal() as report:
            yield report
    else:
        yield lambda *_, **__: None


@contextlib.contextmanager
def _in_terminal() -> Iterator[Bar]:
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        TaskProgressColumn,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    label_column = TextColumn("{task.description}  (Ctrl-C keeps what is done)")
    left, rate_column = (TextColumn("left:"), TimeRemainingColumn()), TextColumn("{task.fields[rate]}")
    columns = BarColumn(), TaskProgressColumn(), rate_column, TimeElapsedColumn(), *left, label_column
    begun = time.monotonic()
    with Progress(*columns, console=Console(stderr=True), transient=True, redirect_stdout=False) as bar:
        task = bar.add_task("", total=None, rate="")

        def report(done: float, total: float | None = None, label: str = "") -> None:
            rate = f"{done / max(time.monotonic() - begun, 1e-3):.3g}/s"
            bar.update(task, completed=done, total=total, description=label, rate=rate)

        yield report


def _in_notebook() -> bool:
    """True if this is the kernel of a notebook."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return hasattr(shell, "kernel")


def _in_cell() -> Bar:
    """A bar below the cell that runs."""
    shown: Any = sys.modules["IPython"].display  # a notebook has imported it
    place = shown.display(shown.HTML(""), display_id=True)
    sent = [-BETWEEN]

    def report(done: float, total: float | None = None, label: str = "") -> None:
        now = time.monotonic()
        if now - sent[0] < BETWEEN and done != total:
            return
        sent[0] = now
        length = "" if total is None else f'value="{done}" max="{total}"'
        place.update(shown.HTML(f"<progress {length}></progress> {html.escape(label or f'{done:.4g}')}"))

    return report
