"""The commands about scenes: list, explain and simulate them, study what accuracy costs, and list the methods."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path
from typing import Annotated, Any, cast

import numpy as np
import typer

from twolink.accuracy import Study, accuracy_study
from twolink.cli.options import Misuse, misuse
from twolink.cli.printing import Progress, print_json, print_run
from twolink.cli.writing import require_formats, write
from twolink.errors import TwolinkError
from twolink.integrate.methods import methods as method_table
from twolink.io.tables import SUFFIXES
from twolink.scenes import bundled_scenes, load_scene
from twolink.show.figure import FORMATS
from twolink.simulation.records import run_record

SceneArgument = Annotated[str, typer.Argument(help="A bundled scene, or the path of a scene file (.toml).")]
Duration = Annotated[float | None, typer.Option(help="Seconds; the scene's own when left out.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON for programs.")]
KEPT = "what was done is kept"


def register(app: typer.Typer) -> None:
    """Add the commands about scenes to the command line."""
    for command in (scenes, explain, run, accuracy, methods):
        app.command()(command)


def scenes(
    schema: Annotated[bool, typer.Option("--schema", help="Print the JSON Schema of scene files instead.")] = False,
    as_json: JsonOption = False,
) -> None:
    """List the bundled scenes, which are scene files and serve as examples."""
    if schema:
        from twolink.scenes.file_format import scene_schema

        print_json(scene_schema())
        return
    titles = {name: load_scene(name).title for name in bundled_scenes()}
    if as_json:
        print_json(titles)
        return
    for name, title in titles.items():
        typer.echo(f"{name:<20}{title}")


def explain(
    scene: SceneArgument,
    duration: Duration = None,
    accuracy: Annotated[float, typer.Option(help="Bound on the global error of q, rad or m.")] = 1e-6,
    method: Annotated[str, typer.Option(help="auto, the cheapest, or one of `twolink methods`.")] = "auto",
    as_json: JsonOption = False,
) -> None:
    """Say what a scene computes: effects, the operations each one costs, the method, and what a run will take."""
    from twolink.simulation.explanation import explain as explained

    with misuse("duration", "accuracy", "method"):
        found = explained(load_scene(scene), accuracy, duration, method=method)
    if as_json:
        print_json(dataclasses.asdict(found))
    else:
        typer.echo(str(found))


def run(
    scene: SceneArgument,
    duration: Duration = None,
    accuracy: Annotated[float, typer.Option(help="Bound on the global error of q, rad or m.")] = 1e-6,
    method: Annotated[str, typer.Option(help="auto, the cheapest, or one of `twolink methods`.")] = "auto",
    tolerance: Annotated[
        float | None, typer.Option(help="Of an adaptive method, in place of what --accuracy calls for.")
    ] = None,
    step: Annotated[float | None, typer.Option(help="Of a method of fixed steps, seconds; likewise.")] = None,
    precision: Annotated[str, typer.Option(help="double (16 digits), or quad (33, by Taylor's method).")] = "double",
    samples: Annotated[float, typer.Option(help="Samples a second.")] = 200.0,
    no_verify: Annotated[bool, typer.Option("--no-verify", help="Skip the second solution: no error bar.")] = False,
    out: Annotated[
        list[Path] | None,
        typer.Option(
            help="Write samples (.csv .parquet .npz), a figure (.png .svg .pdf) or a playback (.html); repeatable."
        ),
    ] = None,
    book: Annotated[bool, typer.Option("--book", help="Print the energy book: each effect's work, impacts.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Simulate a scene and say how accurate the answer is and what it cost.

    \b
    twolink run arm-swing --accuracy 1e-9
    twolink run arm-swing --method rk4 --step 0.01      how wrong is that? the error bar says
    twolink run arm-swing --precision quad --accuracy 1e-25
    """
    from twolink.simulation.scene_run import simulate

    outs = out or []
    require_formats(outs)
    loaded = load_scene(scene)
    length = loaded.duration if duration is None else duration
    options = ("duration", "accuracy", "method", "samples", "tolerance", "step", "precision")
    with misuse(*options), Progress(length) as progress:
        result = simulate(
            loaded, length, accuracy, method=method, samples=samples, verify=not no_verify,
            precision=cast(Any, precision), tolerance=tolerance, step=step, progress=progress,
        )  # fmt: skip
    written, failures = write(result, outs)
    summary = {"scene": scene} | run_record(result) | {"written": written}
    if book:
        from twolink.simulation.energy_balance import energy_book

        kept = energy_book(loaded, result)
        summary["book"] = {"work": {name: float(w[-1]) for name, w in kept.work.items()},
                           "stored": [float(kept.stored[0]), float(kept.stored[-1])], "lost": float(kept.lost[-1]),
                           "residual": float(np.abs(kept.residual).max())}  # fmt: skip
    if as_json:
        print_json(summary)
    else:
        print_run(summary)
        if book:
            typer.echo(f"energy book\n{kept}")
    if failures:
        raise failures[0]
    if result.interrupted:
        raise TwolinkError("interrupted", remedy=KEPT)


def accuracy(
    scene: SceneArgument,
    duration: Duration = None,
    methods: Annotated[str | None, typer.Option(help="Comma between names: dop853,rk4; all when left out.")] = None,
    tolerances: Annotated[
        str | None, typer.Option(help="Comma between numbers: 1e-3,1e-6; from rough to rounding when left out.")
    ] = None,
    samples: Annotated[float, typer.Option(help="Samples a second, at which errors are taken.")] = 50.0,
    repeats: Annotated[int, typer.Option(min=1, help="Timed runs of each entry; it has their median.")] = 7,
    budget: Annotated[float, typer.Option(help="Seconds a run may take; a method goes no further then.")] = 1.0,
    out: Annotated[
        list[Path] | None,
        typer.Option(help="Write a figure (.png .svg .pdf), all of it (.json), or its rows (.csv .parquet .npz)."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Measure what accuracy costs on a scene: the error and the seconds of each method at several settings.

    Errors are measured against a reference of 19 or 33 digits, whose own error is told. Ctrl-C keeps what is done.
    A complete study of all methods is remembered: `twolink run` then chooses its method by it.

    \b
    twolink accuracy arm-swing --out cost.png            all methods; about a minute
    twolink accuracy arm-swing --methods rk4,dop853,taylor --tolerances 1e-3,1e-6,1e-9
    """
    outs = out or []
    require_formats(outs, (*FORMATS, ".json", *SUFFIXES))
    names = None if methods is None else [name.strip() for name in methods.split(",") if name.strip()]
    wanted = None if tolerances is None else _numbers(tolerances)
    options = ("duration", "method", "methods", "tolerances", "samples", "repeats", "budget")
    loaded = load_scene(scene)
    with misuse(*options), Bar(quiet=not sys.stderr.isatty()) as bar:
        study = accuracy_study(
            loaded, duration, methods=names, tolerances=wanted, samples=samples, repeats=repeats, budget=budget,
            progress=bar,
        )  # fmt: skip
    _show(scene, study, outs, as_json)


def _show(scene: str, study: Study, outs: list[Path], as_json: bool) -> None:
    written, failures = write(study, outs)
    if as_json:
        print_json({"scene": scene, **study.to_dict(), "written": written})
    else:
        typer.echo(study.text())
        for path in written:
            typer.echo(f"\nwrote {path}" if path == written[0] else f"wrote {path}")
    if study.interrupted:
        raise TwolinkError("interrupted", remedy=KEPT)
    if failures:
        raise failures[0]


def _numbers(text: str) -> list[float]:
    try:
        return [float(part) for part in text.split(",") if part.strip()]
    except ValueError:
        raise Misuse(f"{text!r} is not a list of numbers", where="tolerances", remedy="such as 1e-3,1e-6") from None


class Bar:
    """A progress bar on stderr: entries done, the one that is measured, and the time so far; none for programs."""

    def __init__(self, *, quiet: bool) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
        from rich.progress import Progress as RichProgress

        columns = (BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("{task.description}"))
        console = Console(stderr=True)
        self._bar = RichProgress(*columns, console=console, transient=True, disable=quiet, refresh_per_second=4)
        self._task = self._bar.add_task("", total=None)

    def __enter__(self) -> Bar:
        self._bar.start()
        return self

    def __call__(self, done: int, total: int, label: str) -> None:
        self._bar.update(self._task, completed=done, total=total, description=f"{label}  (Ctrl-C keeps what is done)")

    def __exit__(self, *_: object) -> None:
        self._bar.stop()


def methods(as_json: JsonOption = False) -> None:
    """List the methods that simulate: order, kind, adaptive or of fixed steps, what for, and where they come from."""
    table = method_table()
    if as_json:
        print_json(table.to_records())
        return
    typer.echo(table.select("name", "order", "kind", "adaptive", "good_for"))
    typer.echo("\nAdaptive methods take --tolerance, the others --step; auto takes the cheapest for --accuracy.")
    typer.echo("Sources:")
    for row in table:
        typer.echo(f"  {row['name']:<21}{row['source']}")
