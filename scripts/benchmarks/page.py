"""One page of results: runs the benchmarks one after the other and puts what they print, with plots, on a page.

    scripts/bench [--quick] [--html out/bench.html] [--only peers,queries]

Each benchmark is a module of its own, which prints its tables and may write out/NAME.csv, from which the plot is made.
Nothing else should run on the machine meanwhile.
"""

import csv
import io
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from html import escape
from importlib.metadata import version
from pathlib import Path

import numpy as np

from scripts.benchmarks.peers_report import Entry, picture
from scripts.runner import OUT, TOP, Some, options
from twolink.io.atomic import write_atomic
from twolink.show.figure import COLOURS, new_figure

PACKAGES = ("twolink", "pin", "heyoka", "numpy", "scipy", "mujoco", "drake")
Columns = dict[str, np.ndarray]
STYLE = """
:root { color-scheme: light dark; --paper: #fff; --ink: #1c1c1c; --soft: #f3f4f6; --line: #d0d4da }
@media (prefers-color-scheme: dark) { :root { --paper: #15181c; --ink: #e6e6e6; --soft: #1f242a; --line: #3a424c } }
body { margin: 0 auto; max-width: 70rem; padding: 1rem; font: 1rem/1.5 system-ui, sans-serif; background: var(--paper);
  color: var(--ink) }
h1 { line-height: 1.2 } h2 { margin-top: 2.5rem; border-top: 1px solid var(--line); padding-top: 1rem }
nav a { margin-right: 1rem; white-space: nowrap }
pre { overflow-x: auto; padding: .8rem; background: var(--soft); border-radius: .4rem; font-size: .8rem;
  line-height: 1.35 }
.plot { overflow-x: auto; background: #fff; border-radius: .4rem } .plot svg { width: 100%; height: auto;
  min-width: 34rem; display: block }
.failed { color: #d33; font-weight: bold }
"""


@dataclass(frozen=True)
class Bench:
    """A module, its title, its options for a full and for a short run, and the plot of its table as SVG."""

    name: str
    title: str
    full: tuple[str, ...]
    quick: tuple[str, ...]
    plot: Callable[[Columns], str] | None = None


def columns_of(path: Path) -> Columns:
    """The columns of a table, numbers where all entries are."""
    with path.open(newline="") as file:
        names, *rows = csv.reader(file)
    columns = {}
    for name, values in zip(names, zip(*rows, strict=True), strict=True):
        try:
            columns[name] = np.array(values, dtype=float)
        except ValueError:
            columns[name] = np.array(values)
    return columns


def bars(labels: list[str], groups: dict[str, np.ndarray], axis: str) -> str:
    """Horizontal bars (labels) of each group, on a logarithmic axis."""
    figure, axes = new_figure(1, size=(9.0, 1.2 + 0.16 * len(labels) * (len(groups) + 1)))
    plot, height = axes[0, 0], 0.8 / len(groups)
    for i, (name, values) in enumerate(groups.items()):
        plot.barh(np.arange(len(labels)) + i * height, values, height, label=name, color=COLOURS[i])
    plot.set(xscale="log", xlabel=axis, yticks=np.arange(len(labels)) + 0.4 - height / 2, yticklabels=labels)
    plot.invert_yaxis()
    figure.legend(loc="outside upper left", ncols=4, fontsize=8, frameon=False)
    return as_svg(figure)


def as_svg(figure: object) -> str:
    """The figure's SVG element."""
    file = io.StringIO()
    figure.savefig(file, format="svg")  # type: ignore[attr-defined]
    text = file.getvalue()
    return text[text.index("<svg") :]


def peers(columns: Columns) -> str:
    """Seconds against error, a line a contestant."""
    names, path = ("scene", "contestant", "setting", "error_rad", "seconds"), OUT / "peers.svg"
    rows = zip(*(columns[name].tolist() for name in names), strict=True)
    picture([Entry(*row, None, 1) for row in rows], path)
    text = path.read_text()
    return text[text.index("<svg") :]


def queries(columns: Columns) -> str:
    """How many times as fast as Pinocchio's own parallel batches."""
    rows = list(zip(*(columns[name].tolist() for name in ("robot", "query", "who", "times")), strict=True))
    labels = list(dict.fromkeys(f"{robot}, {query}" for robot, query, _, _ in rows))
    found = {(f"{robot}, {query}", who): float(times) for robot, query, who, times in rows}
    everybody = dict.fromkeys(row[2] for row in rows)
    names = [who for who in everybody if not (who.endswith("InParallel") or "loop" in who or who.startswith("limit"))]
    groups = {who: np.array([found.get((label, who), np.nan) for label in labels]) for who in names}
    return bars(labels, groups, "times as fast as abaInParallel or rneaInParallel")


def plain(label: str, axis: str, **groups: str) -> Callable[[Columns], str]:
    """Columns beside each other: their names on the plot, with those in the table."""
    return lambda columns: bars(columns[label].tolist(), {name: columns[own].astype(float) for name, own in
                                                          groups.items()}, axis)  # fmt: skip


BENCHES = (
    # Every setting, with the full budget, takes half an hour: python -m scripts.benchmarks.peers.
    Bench("peers", "Single trajectories, beside SciPy, MuJoCo and Drake", ("--quick", "--rounds", "3"),
          ("--quick",), peers),
    Bench("queries", "Batches of queries, beside Pinocchio and MuJoCo", (),
          ("--quick", "--rounds", "3", "--states", "20000"), queries),
    Bench("worlds", "Many worlds, beside MuJoCo", (), ("--quick",)),
    Bench("first_answers", "The first answer of a new scene, beside SciPy", (), ("--quick",),
          plain("scene", "seconds", cold="cold", cached="cached", again="again", scipy="scipy")),
    Bench("effects", "What effects cost", (), ("--quick",),
          plain("effects so far", "milliseconds of a run", run="run, ms")),
    Bench("sensitivities", "Sensitivities, beside heyoka", (), ("--runs", "3", "--no-peers")),
    Bench("loops", "Closed chains of many loops", (), ("--numbers", "1,4,16"), ("--numbers", "1,4")),
    Bench("service", "The service over HTTP", (), ("--seconds", "1", "--rounds", "1", "--requests", "5000")),
)  # fmt: skip


def run(bench: Bench, quick: bool) -> tuple[str, str, bool]:
    """(what it printed, its plot, whether it went well)."""
    started, table = time.time(), OUT / f"{bench.name}.csv"
    command = [sys.executable, "-m", f"scripts.benchmarks.{bench.name}", *(bench.quick if quick else bench.full)]
    done = subprocess.run(command, cwd=TOP, capture_output=True, text=True)
    text = done.stdout if not done.returncode else f"{done.stdout}\n{done.stderr[-2000:]}"
    fresh = table.exists() and table.stat().st_mtime >= started
    plot = bench.plot(columns_of(table)) if bench.plot and fresh and not done.returncode else ""
    return text.strip(), plot, not done.returncode


def processor() -> str:
    """The processor's name and how many of it there are."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        name = next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        name = platform.processor() or platform.machine()
    return f"{name}, {os.cpu_count()} of them"


def installed() -> str:
    """The versions of the packages that are there."""
    found = [f"Python {platform.python_version()}"]
    for name in PACKAGES:
        try:
            found.append(f"{name} {version(name)}")
        except ModuleNotFoundError:
            continue
    return ", ".join(found)


def section(bench: Bench, text: str, plot: str, good: bool) -> str:
    """One benchmark on the page."""
    figure = f'<div class="plot">{plot}</div>' if plot else ""
    failed = "" if good else '<p class="failed">It ended with an error, or a bar is missed.</p>'
    return f'<h2 id="{bench.name}">{escape(bench.title)}</h2>{failed}{figure}<pre>{escape(text)}</pre>'


def main() -> None:
    given = options(__doc__, html=OUT / "bench.html", quick=False, only=Some(bench.name for bench in BENCHES))
    parts, links = [], []
    for bench in (bench for bench in BENCHES if bench.name in given.only):
        start = time.perf_counter()
        print(f"{bench.name} ... ", end="", flush=True)
        text, plot, good = run(bench, given.quick)
        print(f"{time.perf_counter() - start:.0f} s{'' if good else ', failed'}", flush=True)
        parts.append(section(bench, text, plot, good))
        links.append(f'<a href="#{bench.name}">{escape(bench.title.split(",")[0])}</a>')
    kind = "Short runs. " if given.quick else ""
    page = (
        '<!doctype html><html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width">'
        f"<title>twolink: measurements</title><style>{STYLE}</style><h1>twolink: measurements</h1>"
        f"<p>{kind}{time.strftime('%Y-%m-%d %H:%M')}. {escape(processor())}. {escape(installed())}.</p>"
        f"<nav>{' '.join(links)}</nav>{''.join(parts)}</html>"
    )
    print(f"wrote {write_atomic(given.html, lambda file: file.write(page.encode()))}")


if __name__ == "__main__":
    main()
