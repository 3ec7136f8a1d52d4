"""The command that runs a scene many times into a store."""

import re
from collections import Counter
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import msgspec
from typer import Argument, Option

from twolink.cli.common import (
    Duration,
    Files,
    Json,
    Misuse,
    SampleTimes,
    deliver,
    require_writable,
    sample_times_of,
    show,
)
from twolink.io.progress import progress_bar
from twolink.io.text import parse_numbers
from twolink.show.figure import FORMATS

STORE = ".zarr"
SWITCH = {"on": True, "off": False}
SHOWN_REASONS = 5
WROTE = "  wrote   "

Source = Annotated[
    str, Argument(metavar="SOURCE", help="A scene with --vary; or a study: basin, release, price, or a .toml file.")
]
Vary = Annotated[list[str] | None, Option(metavar="NAME=VALUES", help="What varies, as above; repeatable.")]
Bound = Annotated[
    float | None, Option(help="Bound on the global error of q, rad or m.", show_default="as of run, or the study's")
]
Design = Annotated[
    str | None,
    Option(help="grid (all combinations), list, or samples: random, sobol, latin-hypercube.", show_default="grid"),
]
Count = Annotated[int | None, Option(metavar="COUNT", help="Number of samples.")]
Seed = Annotated[int | None, Option(metavar="COUNT", help="Of samples.", show_default="0")]
KEPT_HELP = "What is kept, with commas: final, samples, events, energy, cost, module:function."
Outputs = Annotated[str | None, Option(metavar="NAMES", help=KEPT_HELP, show_default="final")]
SamplesPerSecond = Annotated[float | None, Option(help="Of the output samples, without --t-eval.", show_default="200")]
NoVerify = Annotated[bool, Option("--no-verify", help="Skip the solutions behind the error bar.")]
Executor = Annotated[
    str | None,
    Option(
        metavar="ADDRESS",
        help="A Dask scheduler, or slurm:/shared/folder?partition=NAME.",
        show_default="local processes",
    ),
]
Workers = Annotated[int | None, Option(min=1, metavar="COUNT", help="Processes.", show_default="one a core")]
Variable = Annotated[str, Option(help="What a figure shows, such as end.q.elbow.", show_default="the first")]
Status = Annotated[bool, Option("--status", help="Say how far the store is, and compute nothing.")]


def sweep(
    source: Source,
    vary: Vary = None,
    out: Files = None,
    duration: Duration = None,
    accuracy: Bound = None,
    design: Design = None,
    count: Count = None,
    seed: Seed = None,
    outputs: Outputs = None,
    t_eval: SampleTimes = None,
    samples_per_second: SamplesPerSecond = None,
    no_verify: NoVerify = False,
    executor: Executor = None,
    workers: Workers = None,
    variable: Variable = "",
    status: Status = False,
    as_json: Json = False,
) -> None:
    """Run a scene many times into a store.

    It can be stopped at any moment. Called again it goes on where it was stopped; with more values it computes the new
    runs only.
    --out names the store (.zarr), and writes a figure (.png .svg .pdf) or a table (.csv .parquet).

    \b
    twolink sweep arm-swing --vary q.elbow=-1:1:100 --vary forearm.mass=1,1.5,2 --out arm.zarr --out arm.png
    twolink sweep arm-swing --vary "q.elbow=uniform(-1,1)" --design sobol --count 4096 --out arm.zarr
    twolink sweep basin --out basin.zarr --out basin.png
    twolink sweep basin --out basin.zarr --status

    \b
    NAME: q.JOINT, v.JOINT, LINK.mass, ..., effects.1.FIELD, effects.1 (on,off), accuracy, robot (names)
          LINK.mass alone keeps the link's centre of mass and its inertia about that
    VALUES: 1,2,3   FIRST:LAST:COUNT   uniform(LOW,HIGH)   normal(MEAN,DEVIATION)   on,off
    STATUS of a run in the store: 1 done, 2 inaccurate (its error is above the accuracy), 3 failed (reason says why),
          4 abandoned (workers died of it), 0 pending
    """  # fmt: skip
    from twolink.parts.sweeps.results import plot_sweep, sweep_status, write_sweep_table
    from twolink.parts.sweeps.sweeping import bundled_studies, run_study, study_of

    paths = out or []
    require_writable(paths, (STORE, *FORMATS, ".csv", ".parquet"))
    stores, files = ([p for p in paths if (p.suffix.lower() == STORE) == is_store] for is_store in (True, False))
    if len(stores) != 1:
        raise Misuse(f"expected one store, got {len(stores)}", where="out", remedy="give one --out NAME.zarr")
    store = stores[0]
    if status:
        found = sweep_status(store)
        show({"store": store, **found.to_dict()}, found, as_json)
        return
    given = {"accuracy": accuracy, "duration": duration, "design": design, "count": count, "seed": seed,
             "t_eval": sample_times_of(t_eval), "samples_per_second": samples_per_second,
             "outputs": None if outputs is None else tuple(outputs.split(","))}  # fmt: skip
    study = study_of(source)
    changes: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    changes["vary"] = study.vary | dict(map(_varied, vary or []))
    study = msgspec.structs.replace(study, **changes)
    if not study.vary:
        raise Misuse("nothing varies", where="vary",
                     remedy=f"give --vary NAME=VALUES, or a study: {', '.join(bundled_studies())}")  # fmt: skip
    with progress_bar() as report:
        data = run_study(study, store, verify=not no_verify, executor=executor, workers=workers, progress=report)
    found = sweep_status(store)
    figure = partial(plot_sweep, variable=variable or study.figure.variable, turns=study.figure.turns)

    def write_one(path: Path) -> None:
        (figure if path.suffix.lower() in FORMATS else write_sweep_table)(data, path)

    record = {"source": source, "store": store, **found.to_dict()}
    text = _text(study.title or source, found, data, store)
    deliver(record, text, files, write_one, as_json, interrupted=found.pending > 0, line=WROTE)


def _varied(text: str) -> tuple[str, Any]:
    """The name and the values of NAME=VALUES. Raises Misuse."""
    name, separator, values = (part.strip() for part in text.partition("="))
    if not separator or not name or not values:
        raise Misuse(f"expected NAME=VALUES, got {text!r:.60}", where="vary", remedy='such as "q.elbow=-1:1:100"')
    if name == "robot":
        return name, [part.strip() for part in values.split(",")]
    law = re.fullmatch(r"(uniform|normal)\((.*)\)", values)
    if law:
        return name, {law[1]: parse_numbers("vary", law[2])}
    if ":" in values:
        if values.count(":") != 2:
            raise Misuse(f"expected FIRST:LAST:COUNT, got {values!r:.60}", where=f"--vary {name}",
                         remedy=f'such as --vary "{name}=-1:1:100"')  # fmt: skip
        return name, {"range": parse_numbers("vary", values.replace(":", " "))}
    switches = [SWITCH.get(part.strip()) for part in values.split(",")]
    return name, switches if None not in switches else parse_numbers("vary", values)


def _text(title: str, status: object, data: Any, store: Path) -> str:
    """A sweep for people: how far it is, the most frequent reasons for which runs are not done, how runs are solved."""
    counts = Counter(reason for reason in data["reason"].values.ravel().tolist() if reason)
    reasons = [f"  {count:>6,}   {reason}" for reason, count in counts.most_common(SHOWN_REASONS)]
    return "\n".join([f"{title}: {status}", *reasons, f"  runs     {data.attrs['how']}", f"{WROTE} {store}"])


COMMANDS = (sweep,)
