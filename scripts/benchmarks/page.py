"""One page of results: runs the benchmarks one after the other and puts what they print, with plots, on a page.

    scripts/bench [--quick] [--html out/bench.html] [--only peers,queries]

Each benchmark is a module of its own, which prints its tables and may write out/NAME.csv, from which the plot is made.
Nothing else should run on the machine meanwhile. --quick: short runs, to see whether all is well.
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
from pathlib import Path

import numpy as np

from scripts.runner import OUT, TOP, Some, once, options
from twolink.io.files import write_atomic
from twolink.io.fingerprints import processor, versions
from twolink.show.figure import COLOURS, new_figure

PACKAGES = ("twolink", "pin", "heyoka", "numpy", "scipy", "mujoco", "drake")
Rows = list[dict[str, str]]
STYLE = Path(__file__).with_name("page.css")


@dataclass(frozen=True)
class Bench:
    """A module, its title, its options for a full and for a short run, and the plot of its table as SVG."""

    name: str
    title: str
    full: tuple[str, ...]
    quick: tuple[str, ...]
    plot: Callable[[Rows], str] = lambda _rows: ""


def bars(axis: str, label: str, values: tuple[str, ...]) -> Callable[[Rows], str]:
    """A plot of columns beside each other."""
    return lambda rows: drawn(axis, {name: {row[label]: float(row[name]) for row in rows} for name in values})


def queries(rows: Rows) -> str:
    """How many times as fast as Pinocchio's own parallel batches."""
    groups: dict[str, dict[str, float]] = {}
    for row in rows:
        if not any(word in row["who"] for word in ("InParallel", "loop", "limit")):
            groups.setdefault(row["who"], {})[f"{row['robot']}, {row['query']}"] = float(row["times"])
    return drawn("times as fast as abaInParallel or rneaInParallel", groups)


def drawn(axis: str, groups: dict[str, dict[str, float]]) -> str:
    """Horizontal bars by label, a colour for each group, on a logarithmic axis."""
    labels = list(dict.fromkeys(label for group in groups.values() for label in group))
    figure, axes = new_figure(1, size=(9.0, 1.2 + 0.16 * len(labels) * (len(groups) + 1)))
    plot, height, text = axes[0, 0], 0.8 / len(groups), io.StringIO()
    for i, (name, group) in enumerate(groups.items()):
        values = [group.get(label, np.nan) for label in labels]
        plot.barh(np.arange(len(labels)) + i * height, values, height, label=name, color=COLOURS[i])
    plot.set(xscale="log", xlabel=axis, yticks=np.arange(len(labels)) + 0.4 - height / 2, yticklabels=labels)
    plot.invert_yaxis()
    figure.legend(loc="outside upper left", ncols=4, fontsize=8, frameon=False)
    figure.savefig(text, format="svg")
    return text.getvalue()


BENCHES = (
    # Every setting, with the full budget, takes half an hour: python -m scripts.benchmarks.peers.
    Bench("peers", "Single trajectories, beside SciPy, MuJoCo and Drake", ("--quick", "--rounds", "3"), ("--quick",),
          lambda _rows: (OUT / "peers.svg").read_text()),
    Bench("queries", "Batches of queries, beside Pinocchio and MuJoCo", (),
          ("--quick", "--rounds", "3", "--states", "20000"), queries),
    Bench("worlds", "Many worlds, beside MuJoCo", (), ("--quick",)),
    Bench("first_answers", "The first answer of a new scene, beside SciPy", (), ("--quick",),
          bars("seconds", "scene", ("first", "cached", "last", "scipy"))),
    Bench("effects", "What effects cost", (), ("--quick",),
          bars("milliseconds of a run", "effects so far", ("run, ms",))),
    Bench("sensitivities", "Sensitivities, beside heyoka", (), ("--runs", "3", "--no-peers")),
    Bench("loops", "Closed chains of many loops", ("--numbers", "1,4,16"), ("--numbers", "1,4")),
    Bench("service", "The service over HTTP", (), ("--seconds", "1", "--rounds", "1", "--requests", "5000")),
)  # fmt: skip


def section(bench: Bench, quick: bool) -> str:
    """Run a benchmark. Returns its part of the page."""
    started, path, plot = time.time(), OUT / f"{bench.name}.csv", ""
    command = [sys.executable, "-m", f"scripts.benchmarks.{bench.name}", *(bench.quick if quick else bench.full)]
    seconds, done = once(lambda: subprocess.run(command, cwd=TOP, capture_output=True, text=True))
    print(f"{bench.name}: {seconds:.0f} s{', failed' * bool(done.returncode)}", flush=True)
    if path.exists() and path.stat().st_mtime >= started and not done.returncode:
        svg = bench.plot([*csv.DictReader(path.read_text("utf-8").splitlines())])
        plot = svg and f'<div class="plot">{svg[svg.index("<svg") :]}</div>'
    failed = '<p class="failed">It ended with an error, or a bar is missed.</p>' if done.returncode else ""
    text = f"{done.stdout}\n{done.stderr[-2000:] if done.returncode else ''}".strip()
    return f'<h2 id="{bench.name}">{escape(bench.title)}</h2>{failed}{plot}<pre>{escape(text)}</pre>'


def machine() -> str:
    """The processor, how many of it there are, and the versions of the packages that are there."""
    found = ", ".join(f"{name} {version}" for name, version in versions(PACKAGES).items() if version)
    kind = processor() or platform.machine()
    return f"{kind}, {os.cpu_count()} of them. Python {platform.python_version()}, {found}"


def main() -> None:
    given = options(__doc__, html=OUT / "bench.html", quick=False, only=Some(bench.name for bench in BENCHES))
    chosen = [bench for bench in BENCHES if bench.name in given.only]
    parts = [section(bench, given.quick) for bench in chosen]
    links = " ".join(f'<a href="#{bench.name}">{escape(bench.title.split(",")[0])}</a>' for bench in chosen)
    kind = "Short runs. " if given.quick else ""
    page = (
        '<!doctype html><html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width">'
        f"<title>twolink: measurements</title><style>{STYLE.read_text('utf-8')}</style><h1>twolink: measurements</h1>"
        f"<p>{kind}{time.strftime('%Y-%m-%d %H:%M')}. {escape(machine())}.</p><nav>{links}</nav>{''.join(parts)}</html>"
    )
    print(f"wrote {write_atomic(given.html, lambda file: file.write(page.encode()))}")


if __name__ == "__main__":
    main()
