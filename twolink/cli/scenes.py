"""The commands about scenes: list, explain, simulate and linearize them; study accuracy; list the methods."""

import dataclasses
import os
import tomllib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated, Any, cast

import numpy as np
import typer
from typer import Argument, Option

from twolink.accuracy import accuracy_study
from twolink.cli.common import (
    RUN_ENDINGS,
    STUDY_ENDINGS,
    Accuracy,
    AskedAccuracy,
    ContactWay,
    Duration,
    Files,
    Json,
    Lock,
    Method,
    Misuse,
    RobotLoader,
    RobotName,
    Root,
    SampleTimes,
    SceneName,
    completion,
    deliver,
    locks_of,
    require_writable,
    robot_from,
    sample_times_of,
    scene_from,
    show,
    with_robot_options,
    write_by_ending,
)
from twolink.cli.wording import REPORTED, spoken
from twolink.errors import TwolinkError
from twolink.integrate.steps.methods import methods as method_table
from twolink.io.files import write_atomic
from twolink.io.progress import progress_bar
from twolink.io.text import parse_numbers
from twolink.robots.catalogue import catalogue_names
from twolink.robots.joint_layout import JointLayout
from twolink.scenes import Scene, bundled_scenes
from twolink.scenes import scenes as scene_table
from twolink.scenes.file import bundled_text
from twolink.scenes.file_format import RobotEntry
from twolink.scenes.template import scene_template
from twolink.scenes.urdf_scene import UrdfScene, limited_joints, limits_by_joint, scene_of
from twolink.simulation.trajectory import Trajectory
from twolink.simulation.trajectory_tables import states

SHOWN_EVENTS = 20


def scenes(
    name: Annotated[
        str | None,
        Argument(metavar="NAME", help="Print the file of this scene.", autocompletion=completion(bundled_scenes)),
    ] = None,
    schema: Annotated[bool, Option("--schema", help="Print the JSON Schema of scene files instead.")] = False,
    as_json: Json = False,
) -> None:
    """List the bundled scenes, or print the file of one.

    They serve as examples for scenes of your own.

    \b
    twolink scenes pendulum-friction > mine.toml
    """
    if schema:
        from twolink.scenes.file_format import scene_schema

        show(scene_schema(), "", as_json=True)
        return
    if name is not None:
        text = bundled_text(name)
        show({"name": name, **tomllib.loads(text)}, text.rstrip(), as_json)
        return
    table = scene_table()
    show({record["name"]: record["title"] for record in table}, table.select("name", "title"), as_json)


def new(
    robot: RobotName,
    file: Annotated[Path, Argument(metavar="FILE", help="The scene file to write (.toml).")],
    root: Root = "fixed",
    lock: Lock = None,
) -> None:
    """Begin a scene file for a robot.

    It has the robot's joints, off equilibrium and within their limits, gravity, what the robot's file says (damping,
    friction, stops, loops; the ground under a free base), and comments on what else there may be.

    \b
    twolink new my_robot.urdf mine.toml
    twolink new anymal mine.toml --root free
    twolink run mine.toml --out mine.html
    """
    require_writable([file], (".toml",))
    if file.exists():
        raise Misuse("it exists already", where=str(file), remedy="give another name, or delete it")
    loaded = robot_from(robot, root, lock)
    named = robot if robot in catalogue_names() else os.path.relpath(robot, file.parent)
    text = scene_template(RobotEntry(named, cast(Any, root), {**locks_of(lock)}),
                          scene_of(loaded, contact=root == "free"))  # fmt: skip
    write_atomic(file, lambda out: out.write(text.encode()))
    typer.echo(f"wrote {file}; `twolink run {file} --out motion.html` simulates it")


def explain(
    scene: SceneName,
    duration: Duration = None,
    accuracy: Accuracy = 1e-6,
    method: Method = "auto",
    contact: ContactWay = None,
    as_json: Json = False,
) -> None:
    """Say what a scene computes and what `twolink run` will take.

    That is: its effects, the operations each one costs, the method, and an estimate of the seconds.
    """
    from twolink.simulation.explanation import explain as explain_scene

    asked = scene_from(scene, ground=None)
    explanation = explain_scene(asked, duration, accuracy=accuracy, method=method, contact=contact)
    show(dataclasses.asdict(explanation), explanation, as_json)


@with_robot_options
def run(
    scene: SceneName,
    duration: Duration = None,
    accuracy: AskedAccuracy = None,
    method: Method = "auto",
    tolerance: Annotated[float | None, Option(help="Tolerance of an adaptive method, in place of --accuracy.")] = None,
    step: Annotated[float | None, Option(help="Step of a fixed-step method, s, in place of --accuracy.")] = None,
    precision: Annotated[str, Option(help="double (16 digits), extended (31) or quad (47); auto: as needed.")] = "auto",
    patience: Annotated[float | None, Option(help="Seconds of solving: 600, or no limit for stepped contacts.")] = None,
    contact: ContactWay = None,
    ground: Annotated[
        bool | None,
        Option(
            "--ground/--no-ground",
            help="Of a robot: its links touch each other and the ground.",
            show_default="of robots that are meant to move about",
        ),
    ] = None,
    t_eval: SampleTimes = None,
    samples_per_second: Annotated[float, Option(help="Samples a second, without --t-eval.")] = 200.0,
    no_verify: Annotated[bool, Option("--no-verify", help="Skip the solutions behind the error bar.")] = False,
    out: Files = None,
    book: Annotated[bool, Option("--book", help="Print the energy balance: work of each effect, impacts.")] = False,
    as_json: Json = False,
    *,
    load: RobotLoader,
) -> None:
    """Simulate a scene, with an error bar and its cost.

    --out writes samples (.csv .parquet .npz .mat), a recording (.mcap .db3 .rrd), a figure (.png .svg .pdf) or a
    playback (.html) or a film (.mp4 .webm .gif).

    \b
    twolink run panda                                    with the damping, friction and stops of its URDF
    twolink run anymal                                   on its feet; --root free leaves the ground out
    twolink run arm-swing --accuracy 1e-9
    twolink run arm-swing --method rk4 --step 0.01      the error bar says how wrong that is
    twolink run arm-swing --accuracy 1e-25               31 digits, as 16 do not reach it
    """
    from twolink.simulation.scene_run import simulate

    require_writable(out or [], RUN_ENDINGS)
    loaded = scene_from(scene, load, ground=ground)
    length = loaded.duration if duration is None else duration
    with progress_bar() as report:
        result = simulate(
            loaded, length, accuracy=accuracy, t_eval=sample_times_of(t_eval), samples_per_second=samples_per_second,
            method=method, verify=not no_verify, precision=cast(Any, precision), tolerance=tolerance, step=step,
            contact=contact, patience=patience, progress=report,
        )  # fmt: skip
    record = result.to_dict() | {"scene": scene}
    text = _text(scene, result, record)
    if isinstance(loaded, UrdfScene):
        record |= {"report": loaded.report.to_dict(), "beyond_limits": limit_notes(result)}
        beyond = (f"  beyond   {note}" for note in record["beyond_limits"])
        text = "\n".join([text, *beyond, spoken(str(loaded.report), REPORTED)])
    balance, lacking = _book(loaded, result, record) if book else ("", [])
    deliver(record, text + balance, out, partial(write_by_ending, result), as_json, interrupted=result.interrupted,
            line="  wrote   ", lacking=lacking)  # fmt: skip


def _book(scene: Scene, run: Trajectory, record: dict[str, Any]) -> tuple[str, list[TwolinkError]]:
    """The energy balance as text, and in the record; or why there is none."""
    from twolink.simulation.energy_balance import energy_book

    try:
        balance = energy_book(scene, run)
    except TwolinkError as error:
        return "", [error]
    record["book"] = balance.to_dict()
    return f"\nenergy balance\n{balance}", []


def _text(scene: str, run: Trajectory, record: dict[str, Any]) -> str:
    """A run for people: error, energy, events, cost, the end."""
    error = run.error_text if run.bound != "verified" else f"{run.error_text}, at every sample"
    lines = [
        f"{scene}: robot {run.robot.name!r}, {record['duration']:g} s",
        f"  error    {error}",
        f"  energy   changes by {record['energy_drift']:.1e} J",
        *(f"  event    {event}" for event in run.events[:SHOWN_EVENTS]),
    ]
    if len(run.events) > SHOWN_EVENTS:
        lines.append(f"  event    and {len(run.events) - SHOWN_EVENTS} more: --json lists them all")
    costs = [] if run.cost is None else str(run.cost).splitlines()
    lines += [f"  {label}  {cost}" for label, cost in zip(("method ", "steps  ", "seconds"), costs, strict=False)]
    digits = record.get("q_precise")
    if run.contact_record is not None:
        found = run.contact_record
        lines.append(f"  contacts overlap by at most {found['overlap']:.1e} m at samples; laws of the steps kept to "
                     f"{found['feasibility']:.1e} m/s and {found['complementarity']:.1e} J")  # fmt: skip
    end = f"[{' '.join(digits)}]" if digits else np.array2string(run.q[-1], precision=15)
    time = "end" if run.t[-1] == run.end else f"{run.t[-1]:g} s"
    return "\n".join([*lines, f"  q({time}) = {end}"])


def accuracy(
    scene: SceneName,
    duration: Duration = None,
    methods: Annotated[str | None, Option(help="Methods, such as dop853,rk4.", show_default="all")] = None,
    tolerances: Annotated[
        str | None, Option(help="Tolerances, such as 1e-3,1e-6.", show_default="1e-1 to rounding")
    ] = None,
    t_eval: SampleTimes = None,
    samples_per_second: Annotated[
        float, Option(help="Samples a second, without --t-eval; there errors are measured.")
    ] = 50.0,
    repeats: Annotated[int, Option(min=1, metavar="COUNT", help="Timed runs an entry; the least counts.")] = 7,
    budget: Annotated[float, Option(help="Limit of a run's time, s; a method ends at it.")] = 1.0,
    out: Files = None,
    as_json: Json = False,
) -> None:
    """Measure what accuracy costs on a scene.

    Each method is run at several settings. Errors are measured against a reference of 31 digits, whose own error
    is printed. Ctrl-C keeps what is done. --out writes a figure (.png .svg .pdf), the study (.json) or its rows (.csv
    .parquet .npz).

    \b
    twolink accuracy arm-swing --out cost.png            all methods; about a minute
    twolink accuracy arm-swing --methods rk4,dop853,taylor --tolerances 1e-3,1e-6,1e-9
    """
    require_writable(out or [], STUDY_ENDINGS)
    names = None if methods is None else [name.strip() for name in methods.split(",") if name.strip()]
    values = None if tolerances is None else parse_numbers("tolerances", tolerances)
    with progress_bar() as report:
        study = accuracy_study(
            scene_from(scene), duration, methods=names, tolerances=values, t_eval=sample_times_of(t_eval),
            samples_per_second=samples_per_second, repeats=repeats, budget=budget, progress=report,
        )  # fmt: skip
    deliver({"scene": scene, **study.to_dict()}, study.text() + "\n" * bool(out), out, partial(write_by_ending, study),
            as_json, interrupted=study.interrupted)  # fmt: skip


def methods(as_json: Json = False) -> None:
    """List the methods that simulate.

    Each has its order, kind, whether it adapts its steps, what it is good for, and its source.
    """
    table = method_table()
    about = "Adaptive methods take --tolerance, the others --step; auto takes the cheapest for --accuracy."
    parts = table.select("name", "order", "kind", "adaptive", "good_for"), about, table.select("name", "source")
    text = "\n\n".join(map(str, parts))
    show(table.to_records(), text, as_json)


def limit_notes(run: Trajectory) -> list[str]:
    """Notes on a run beyond the URDF's limits of velocity or position, one line a joint."""
    robot, notes, (t, q, v) = run.robot, list[str](), states(run, whole=True)

    def note(joint: JointLayout, unit: str, values: np.ndarray, limit: float, sign: float = 1.0) -> None:
        beyond = sign * (values - limit)
        if beyond[most := int(beyond.argmax())] > 1e-6:
            since, end = t[np.argmax(beyond > 1e-6)], "at most" if sign > 0 else "at least"
            notes.append(f"{joint.name} is beyond its limit of {limit:.4g} {unit} from {since:.3g} s on: "
                         f"{values[most]:.4g} {end}")  # fmt: skip

    for joint, ends in limited_joints(robot):
        for limit, sign in zip(ends, (-1.0, 1.0), strict=True):
            note(joint, joint.unit, q[:, joint.q.start], limit, sign)
    limits = limits_by_joint(robot, robot.model.velocityLimit)
    for joint in robot.joints:
        if joint.name in limits:
            note(joint, f"{joint.unit}/s", np.abs(v[:, joint.v]).max(axis=1), limits[joint.name])
    return notes


def energy() -> Callable[..., Any]:
    """Say where the energy of a run went.

    \b
    twolink energy pendulum-friction --out energy.png
    """
    from twolink.simulation.energy_balance import energy_book

    return energy_book
