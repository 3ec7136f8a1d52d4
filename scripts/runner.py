"""What benchmarks and studies share: options, seconds, tables, bars, new processes, and rows that outlive an interrupt.

    python -m scripts.benchmarks.NAME      what something costs, beside others
    python -m scripts.studies.NAME         whether what twolink says is true

From the top of the checkout; with --help for the options. What they write is in out/.
"""

import argparse
import contextlib
import csv
import functools
import io
import os
import re
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import astuple, dataclass, fields, replace
from pathlib import Path
from typing import Any, TypeVar

import msgspec

TOP = Path(__file__).parents[1]
OUT = TOP / "out"
FINGERS = {"panda_finger_joint1": 0.0, "panda_finger_joint2": 0.0}  # locked: peers solve the arm alone
R = TypeVar("R")
Bars = list[tuple[bool, str]]


class Some(tuple[str, ...]):
    """The default of an option that is a list of names: all of them. Others are refused."""


def options(doc: str | None, **defaults: Any) -> argparse.Namespace:
    """The command line by the defaults of its options.

    False is a switch, a tuple a list with commas, a type an option without a default; `rest` are the arguments that are
    no options.
    """
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, default in defaults.items():
        flag, kind = f"--{name.replace('_', '-')}", type(default)
        if name == "rest":
            parser.add_argument(name, nargs="*", default=list(default))
        elif default is False:
            parser.add_argument(flag, action="store_true")
        elif isinstance(default, type):
            parser.add_argument(flag, type=default)
        elif isinstance(default, tuple):
            kind = type(default[0])
            parser.add_argument(flag, type=lambda text, kind=kind: [*map(kind, text.split(","))], default=[*default])
        else:
            parser.add_argument(flag, type=kind, default=default)
    given = parser.parse_args()
    for name, default in defaults.items():
        unknown = set(getattr(given, name)) - set(default) if isinstance(default, Some) else ()
        if unknown:
            parser.error(f"unknown: {', '.join(sorted(unknown))}; known: {', '.join(default)}")
    return given


def once(call: Callable[[], R], clock: Callable[[], float] = time.perf_counter) -> tuple[float, R]:
    """Seconds of a call, and its result."""
    start = clock()
    result = call()
    return clock() - start, result


def seconds_of(
    *calls: Callable[[], object],
    rounds: int = 9,
    warm_up: int = 1,
    turn: int = 1,
    before: int = 0,
    at_least: float = 0.0,
    clock: Callable[[], float] = time.perf_counter,
    pick: Callable[[list[float]], float] = statistics.median,
) -> list[float]:
    """Seconds of each call. The calls take turns; of all times of a call the median counts, or what `pick` returns.

    warm_up: calls of each before all turns; before: and before each turn, neither timed. turn: timed calls in a row.
    at_least: seconds for which rounds go on.
    """
    taken: list[list[float]] = [[] for _ in calls]
    for call in calls:
        for _ in range(warm_up):
            call()
    done = 0
    while done < rounds or sum(map(sum, taken)) < at_least:
        for times, call in zip(taken, calls, strict=True):
            for _ in range(before):
                call()
            times += [once(call, clock)[0] for _ in range(turn)]
        done += 1
    return [pick(times) for times in taken]


def many(call: Callable[[], object], times: int) -> Callable[[], None]:
    """Calls in a row as one, where a single one is as short as looking at the clock."""

    def calls() -> None:
        for _ in range(times):
            call()

    return calls


def new_process(code: str, *arguments: str, cache: str | None = None, **more: Any) -> subprocess.CompletedProcess[str]:
    """Python code in a process of its own, with the kernels of the folder `cache`; None: with an empty cache.

    Linear algebra has one thread: on shared cores its threads wait for each other, 50 ms for an inverse of 0.2 ms.
    """
    given: dict[str, Any] = {"capture_output": True, "cwd": TOP, **more}
    with contextlib.nullcontext(cache) if cache else tempfile.TemporaryDirectory() as folder:
        environment = {"OPENBLAS_NUM_THREADS": "1", **os.environ, "TWOLINK_CACHE": folder}
        return subprocess.run([sys.executable, "-c", code, *arguments], env=environment, text=True,
                              **given)  # fmt: skip


def tests_of_a_copy(folder: Path, arguments: Sequence[str]) -> dict[str, Any]:
    """Copy the package into a folder, where it may be changed: what `subprocess.run` takes to test the copy."""
    shutil.copytree(TOP / "twolink", folder / "twolink", ignore=shutil.ignore_patterns("__pycache__"))
    for other in ("tests", "scripts", "urdf", "docs", "pyproject.toml", "README.md"):
        (folder / other).symlink_to(TOP / other)
    return {"args": [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *arguments], "cwd": folder,
            "env": {**os.environ, "PYTHONPATH": str(folder), "TWOLINK_CACHE": str(folder / "cache")}}  # fmt: skip


class Table:
    """Rows that are printed as they come, and kept. heads: names with formats, "robot <12 | ns a state >10.1f"."""

    def __init__(self, heads: str) -> None:
        self.formats = dict(re.split(r" +(?=\S+$)", cell.strip()) for cell in heads.split("|"))
        self.rows: list[tuple[Any, ...]] = []
        self._print(tuple(self.formats))

    def add(self, *row: Any) -> None:
        """Print a row. None leaves a cell empty; a text stands in any column."""
        self.rows.append(row)
        self._print(row)

    def _print(self, row: tuple[Any, ...]) -> None:
        cells = []
        for value, (name, form) in zip(row, self.formats.items(), strict=True):
            text = format(value, form) if not isinstance(value, str | None) else value or ""
            cells.append(f"{text:{form[0]}{max(len(name), int(re.findall('[0-9]+', form)[0]))}}")
        print(" ".join(cells).rstrip(), flush=True)

    def save(self, name: str) -> None:
        """Write out/NAME.csv."""
        OUT.mkdir(exist_ok=True)
        with (OUT / f"{name}.csv").open("w", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows([tuple(self.formats), *self.rows])
        print(f"wrote {OUT / f'{name}.csv'}")


def print_bars(bars: Bars) -> bool:
    """Print each bar met or missed. Returns whether all are met."""
    for met, text in bars:
        print(f"{'met   ' if met else 'MISSED'}  {text}")
    return all(met for met, _ in bars)


class OutOfTime(Exception):
    """The processor time is up."""


@contextlib.contextmanager
def processor_time(seconds: float) -> Iterator[None]:
    """Raise OutOfTime in what takes longer."""

    def stop(*_: object) -> None:
        raise OutOfTime

    signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)


@dataclass
class Judged:
    """A row of a study: a scene and what came of it. worst: the largest error, over its bar where it has one.

    why: the error's code, or the law that is broken. REFUSED: by an error, where there should be an answer.
    """

    scene: int
    kind: str = ""
    what: str = ""
    outcome: str = ""
    why: str = ""
    worst: float = 0.0
    seconds: float = 0.0

    @property
    def fails(self) -> bool:
        """Whether the answer is wrong in silence, or there is none."""
        return self.outcome in ("WRONG", "REFUSED", "HANG", "CRASH")


def read_rows(path: Path, kind: type[R]) -> list[R]:
    """The rows that a study wrote; a last line that was cut off is left out."""
    text = path.read_text("utf-8") if path.exists() else ""
    return msgspec.convert([*csv.DictReader(io.StringIO(text[: text.rfind("\n") + 1]))], list[kind], strict=False)  # type: ignore[valid-type]


def failing(rows: Iterable[R]) -> list[R]:
    return [row for row in rows if getattr(row, "fails", False)]


def collect(path: Path, kind: type[R], keys: Sequence[Any], check: Callable[[Any], Any]) -> list[R]:
    """The rows of the keys. Those that the file does not have are made by `check`, and appended to it as they come.

    The first column of a row is its key. `check` returns rows, or one row without the seconds that it took. Rows with a
    true `fails` are printed.
    """
    kept = read_rows(path, kind)
    rows, done, start = [row for row in kept if astuple(row)[0] in keys], {astuple(row)[0] for row in kept}, time.time()  # type: ignore[call-overload]
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:  # again, without what was cut off
        writer = csv.writer(file, lineterminator="\n")
        writer.writerows([[field.name for field in fields(kind)], *map(astuple, kept)])
        for i, key in enumerate(keys):
            if key in done:
                continue
            taken, made = once(functools.partial(check, key), time.process_time)
            new = [replace(made, seconds=round(taken, 1))] if isinstance(made, kind) else [*made]  # type: ignore[type-var]
            rows += new
            writer.writerows(map(astuple, new))
            file.flush()
            for row in failing(new):
                print(f"\n{row}", file=sys.stderr)
            print(f"\r{i + 1}/{len(keys)}, {time.time() - start:.0f} s, {len(failing(rows))} fail  ", end="",
                  file=sys.stderr, flush=True)  # fmt: skip
    return rows


def study(
    doc: str | None,
    name: str,
    kind: type[R],
    check: Callable[[Any, argparse.Namespace], Any],
    show: Callable[[list[R], argparse.Namespace], Bars],
    keys: Callable[[argparse.Namespace], Sequence[Any]] = lambda given: range(given.first, given.first + given.scenes),
    scenes: int = 100,
    **own: Any,
) -> int:
    """The command of a study, whose exit code it returns.

    The rows of each key, by default the number of a scene, go to out/NAME-SEED.csv (--out). After Ctrl-C the same
    command goes on behind the last row; --fresh starts again. Options of the study's own are part of the file's name.
    Kernels are not cached, as random robots would fill the cache. `show` prints tables, and returns the bars.
    """
    numbered = {"scenes": scenes, "seed": 0, "first": 0} if scenes else {}
    given = options(doc, **numbered, fresh=False, out=Path, **own)
    usual = {what: list(value) if isinstance(value, tuple) else value for what, value in own.items() if what != "rest"}
    chosen = {what: getattr(given, what) for what, value in usual.items() if getattr(given, what) != value}
    words = "".join(f" {what} {'' if value is True else value}" for what, value in chosen.items())
    more = re.sub("[^a-z0-9.]+", "-", words).rstrip("-")
    path = given.out or OUT / f"{name}{f'-{given.seed}' if scenes else ''}{more}.csv"
    os.environ["TWOLINK_CACHE"] = "off"
    if given.fresh:
        path.unlink(missing_ok=True)
    wanted = keys(given)
    try:
        rows, interrupted = collect(path, kind, wanted, lambda key: check(key, given)), False
    except KeyboardInterrupt:
        rows, interrupted = [row for row in read_rows(path, kind) if astuple(row)[0] in wanted], True  # type: ignore[call-overload]
    print(f"\r{len(rows)} rows in {path}\n")
    met = print_bars(show(rows, given)) if rows else True
    return 130 if interrupted else 0 if met else 1
