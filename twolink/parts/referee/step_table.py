"""step_table: which step and integrator of another simulator is enough for a model, against the verified run."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from twolink.dynamics import Robot
from twolink.dynamics.arguments import Positive, positive
from twolink.effects.forces import Torque
from twolink.effects.inputs import Sampled
from twolink.errors import SceneError, require_known
from twolink.hard.peers import NAMES
from twolink.hard.peers.task import PeerError, PeerRun, PeerTask, Setting, task_of
from twolink.io.progress import Report
from twolink.io.text import Table
from twolink.parts.referee.comparison import installed_peer, refusing
from twolink.parts.referee.referee import ESTIMATED, best_run, scene_from
from twolink.robots.joint_layout import column_forms, read_columns, unit_of
from twolink.robots.log_columns import in_our_names, read_log_table
from twolink.scenes import Scene
from twolink.scenes.scene import fall_notes
from twolink.show.figure import COLOURS, Plotted, new_figure, plain
from twolink.simulation.text import BaseResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STEPS = (0.02, 0.01, 0.005, 0.002, 0.001, 5e-4, 2e-4, 1e-4)  # s
STEPPED = ("mujoco",)  # peers that take steps of one length
INTERVAL = 0.02  # s, about, between the times at which states are compared
ACCURACY = 1e-8  # rad or m, of the truth
MOST = 1e8  # steps of a run
FINER = 4  # times smaller than the smallest step: of the peer's own limit
ROUNDS, SHARE = 3, 0.2  # of timing; of the budget that one setting may take
SECONDS = 30.0
Prepare = Callable[[PeerTask, Setting], Callable[[], PeerRun]]
Array = np.ndarray
LEVEL = 1e-3  # rad or m, of the text's last line


@dataclass(frozen=True)
class StepRow:
    """A setting of the other simulator.

    Attributes
    ----------
    method : str
        Its integrator.
    step : float
        s.
    error : float or None
        The largest distance from the truth of any joint at any time compared, rad or m; None: it failed.
    solver : float or None
        That from the simulator's own limit of small steps, where its laws are not the scene's: what the step is to
        blame for.
    seconds : float or None
        Processor time of the run, the least of some.
    own : bool
        Whether these are the options of the model's own file, or the simulator's default.
    message : str
        What the simulator said where it failed.
    """

    method: str
    step: float
    error: float | None
    solver: float | None
    seconds: float | None
    own: bool
    message: str = ""


@dataclass(frozen=True, repr=False)
class StepTable(Plotted, BaseResult):
    """Errors and costs of another simulator's steps and integrators on a model.

    Attributes
    ----------
    peer, scene : str
        The simulator with its version, and the scene's title.
    duration : float
        s.
    rows : tuple of StepRow
        The model's own setting first, then by integrator, the longest step first.
    bar : float
        How far the truth may be off, rad or m: of every error.
    soft : tuple of str
        What the simulator replaces by soft laws of its own: contacts, friction, stops, couplings, loops.
    softness : float or None
        How far its limit of small steps is from the truth: the difference of the models, which no step takes away;
        None: the models are one.
    ours : float
        Seconds that the truth took, with its error bar.
    guessed : tuple of str
        Which columns of the log were taken for t, q, v and tau, where they have other names.
    unit : str
        Of errors: "rad", "m", or "rad or m".
    notes : tuple of str
        What to know of the scene.
    """

    peer: str
    scene: str
    duration: float
    rows: tuple[StepRow, ...]
    bar: float
    soft: tuple[str, ...]
    softness: float | None
    ours: float
    guessed: tuple[str, ...] = ()
    unit: str = "rad or m"
    notes: tuple[str, ...] = ()

    def largest_step(self, error: float, method: str | None = None) -> float | None:
        """The largest step with which an integrator keeps within an error.

        Parameters
        ----------
        error : float
            rad or m: at most so far from the truth, the truth's own error bar included; where laws are soft, from the
            simulator's own limit, for no step makes up for the rest.
        method : str, optional
            The integrator; the model's own by default.

        Returns
        -------
        float or None
            s. No shorter step of the table goes beyond the error. None: no step of the table keeps within it.
        """
        name = method or self.rows[0].method
        require_known(name, [row.method for row in self.rows], SceneError, argument="method")
        found = None
        for row in sorted((row for row in self.rows if row.method == name), key=lambda row: row.step):
            off = _off(row, self.bar)
            if off is None or off > error:
                break
            found = row.step
        return found

    def __str__(self) -> str:
        heads = ("method", "step_ms", "error", *(["solver"] if self.softness is not None else []), "ms", "")
        lines = [f"{self.peer} on {self.scene}, {self.duration:g} s: errors in {self.unit}, the truth is known to "
                 f"{self.bar:.1e}, in {self.ours:.2g} s"]  # fmt: skip
        lines += [f"  read: {'; '.join(self.guessed)}"] if self.guessed else []
        lines += [f"  note: {note}" for note in self.notes]
        if self.softness is not None:
            soft = f"  soft {', '.join(self.soft)}: its limit of small steps is {self.softness:.2g} {self.unit} off, "
            lines.append(soft + "whatever the step; solver: the distance from that limit")
        rows = [(row.method, 1e3 * row.step, row.error, *([row.solver] if self.softness is not None else []),
                 None if row.seconds is None else 1e3 * row.seconds, row.message or ("own" if row.own else ""))
                for row in self.rows]  # fmt: skip
        lines += [f"  {line}" for line in str(Table(heads, tuple(rows))).splitlines()]
        found = {name: self.largest_step(LEVEL, name) for name in dict.fromkeys(row.method for row in self.rows)}
        shown = ", ".join(f"{name} {'none' if step is None else f'{1e3 * step:g} ms'}" for name, step in found.items())
        lines.append(f"  largest steps within {LEVEL:g} {self.unit}: {shown}")
        return "\n".join(lines)

    __repr__ = __str__

    def _figure(self) -> Figure:
        figure, axes = new_figure(1, size=(6.4, 4.0))
        axis = axes[0, 0]
        for colour, method in zip(COLOURS, dict.fromkeys(row.method for row in self.rows), strict=False):
            rows = [row for row in self.rows if row.method == method and row.error is not None]
            rows.sort(key=lambda row: row.step)
            axis.loglog([1e3 * row.step for row in rows], [max(row.error or 0.0, self.bar) for row in rows], "o-",
                        color=colour, label=method)  # fmt: skip
        axis.axhline(self.bar, color="0.6", label="error bar of the truth")
        if self.softness is not None:
            axis.axhline(self.softness, color="0.3", linestyle="--", label=f"soft {', '.join(self.soft)}")
        axis.set_xlabel("step (ms)")
        axis.set_ylabel(f"largest error ({self.unit})")
        axis.set_title(plain(f"{self.peer}: {self.scene}"))
        axis.legend()
        return figure


def _off(row: StepRow, bar: float) -> float | None:
    """A bound on the error that the step is to blame for."""
    if row.solver is not None:
        return row.solver
    return None if row.error is None else row.error + bar


def step_table(
    model: Scene | Robot | str | os.PathLike[str],
    peer: str = "mujoco",
    *,
    duration: Positive | None = None,
    log: str | os.PathLike[str] | None = None,
    steps: Sequence[float] = STEPS,
    methods: Sequence[str] | None = None,
    accuracy: Positive = ACCURACY,
    seconds: Positive = SECONDS,
    progress: Report | None = None,
) -> StepTable:
    """Hold each step and integrator of another simulator against the verified run of a model.

    Parameters
    ----------
    model : Scene, Robot, str or path
        As in `judge`: of a robot or its file, with all that the file says. Of an MJCF, its own <option> comes first.
    peer : {"mujoco"}
    duration : float, optional
        s; the scene's own by default, or the log's.
    log : path, optional
        A table with t and tau.JOINT: torques, held until the next time. With q.JOINT and v.JOINT, the run starts from
        their first row. Names of other programs are taken as `judge` does.
    steps : sequence of float
        s.
    methods : sequence of str, optional
        Integrators, by the simulator's names.
    accuracy : float
        Of the truth, rad or m; where it cannot be kept, the best run is taken.
    seconds : float
        Of computing, after which settings that would take long are left out.
    progress : callable, optional
        Called with what is done, the total and a label.

    Returns
    -------
    StepTable
        Seconds are the least processor times of three rounds in which all settings take turns. Torques of a log are
        set from Python once a step, which counts.

    Raises
    ------
    SceneError
        The peer does not simulate a part of the scene, which is named (code "no-peer"), or an argument is wrong.
    MissingExtraError
        It is not installed.
    """
    require_known(peer, STEPPED, SceneError, argument="peer")
    module, scene = installed_peer(peer), scene_from(model)[0]
    scene, guessed = (scene, ()) if log is None else _driven(scene, Path(log))
    end = positive(scene.duration if duration is None else duration, "duration", SceneError, "such as 2")
    lengths, patience = _lengths(steps, end), positive(seconds, "seconds", SceneError, "such as 10")
    names = tuple(module.STAGES) if methods is None else tuple(methods)
    for name in names:
        require_known(name, module.STAGES, SceneError, argument="methods")
    with refusing(scene, peer):
        task = task_of(scene, _times(INTERVAL, end))
        own = module.usual_settings(task)[0]
        module.prepare(task, own)
    grid = [Setting(name, "", step=step) for name in names for step in lengths]
    settings = [own, *(one for one in grid if (one.method, one.step) != (own.method, own.step))]
    trials = [_Trial(one, replace(task, times=_times(one.step, end))) for one in settings]
    begun = time.process_time()
    every = np.unique(np.round(np.concatenate([trial.task.times for trial in trials]), 12))
    truth = best_run(scene, every, accuracy)
    ours = time.process_time() - begun
    bar = float(np.max(truth.error)) * (ESTIMATED if truth.estimated else 1.0) if truth.error is not None else np.inf

    def apart(times: Array, q: Array) -> float:
        known = times <= truth.t[-1] + 1e-9
        at = np.searchsorted(truth.t, times[known] - 1e-9)
        return float(np.abs(task.robot.difference(truth.q[at], q[known])).max())

    _measure(module.prepare, trials, patience, progress)
    soft = tuple(sorted(set(module.SOFTENS | {"contacts", "loops"}) & task.needs))
    finest = Setting("RK4", "", step=min(lengths) / FINER)
    with refusing(scene, peer):
        limits = {each.interval: module.prepare(each, finest)().track.q for each in
                  {trial.task.interval: trial.task for trial in trials}.values()} if soft else {}  # fmt: skip
    rows = tuple(_row(trial, apart, limits.get(trial.task.interval), trial is trials[0]) for trial in trials)
    softness = apart(task.times, limits[task.interval]) if soft else None
    title = scene.title or scene.robot.name
    return StepTable(f"{NAMES[peer]} {module.VERSION}", title, end, rows, bar, soft, softness, ours,
                     guessed, unit_of(scene.robot.joints), tuple(fall_notes(scene)))  # fmt: skip


def _lengths(steps: Sequence[float], end: float) -> list[float]:
    """The steps that fit into a run, the longest first. Raises SceneError."""
    given = {float(step) for step in steps if positive(step, "steps", SceneError, "such as 0.001") <= end}
    if not given:
        raise SceneError(f"none is within the {end:g} s of the run", argument="steps", remedy="such as (0.001,)")
    if min(given) < end / MOST:
        what = f"{min(given):g} s are more than {MOST:.0e} steps"
        raise SceneError(what, argument="steps", remedy="give longer ones")
    return sorted(given, reverse=True)


@dataclass
class _Trial:
    """A setting, its task, and what came of it."""

    setting: Setting
    task: PeerTask
    q: Array | None = None
    seconds: float = np.inf
    message: str = ""


def _times(step: float, end: float) -> Array:
    """Times of about `INTERVAL` from one another that steps meet."""
    interval = step * max(1, round(INTERVAL / step))
    return interval * np.arange(max(1, int(end / interval * (1 + 1e-9))) + 1)


def _driven(scene: Scene, path: Path) -> tuple[Scene, tuple[str, ...]]:
    """The scene with the torques of a log, from its first state if it has one; and what was guessed of its columns."""
    table, guessed = in_our_names(read_log_table(path), scene.robot)
    times = np.asarray(table.get("t", ()), dtype=float)
    table |= {f"tau{k}": column for k, column in enumerate(np.transpose(table.get("tau", ())))}
    left = [column for column in table if re.fullmatch(r"tau(\..+|\d+)", column) and np.any(table[column])]
    torques: dict[str, Array] = {}
    for joint in scene.robot.joints:
        for form in column_forms(joint, "tau"):
            if len(form) == 1 and form[0] in table:
                torques[joint.name] = np.asarray(table[form[0]], dtype=float)
                left = [column for column in left if column != form[0]]
    if len(times) < 2 or not torques or left:
        lacks = f"its column {left[0]!r} drives no joint of one coordinate" if left else "it has no times or no torques"
        raise SceneError(lacks, where=str(path), argument="log", remedy="give columns t and tau.JOINT")
    held = {joint: Sampled(tuple(times - times[0]), tuple(tau), interpolation="hold") for joint, tau in torques.items()}
    q, v = (read_columns(table, scene.robot.joints, name)[0] for name in ("q", "v"))
    q = scene.q if q is None else scene.robot.normalize(np.asarray(q, dtype=float))[0]
    v = scene.v if v is None else np.asarray(v, dtype=float)[0]
    effects, end = [*scene.effects, Torque(held)], float(times[-1] - times[0])
    return Scene(scene.base, q, v, effects, end, scene.title), guessed


def _measure(prepare: Prepare, trials: Sequence[_Trial], budget: float, progress: Report | None) -> None:
    """Run each setting, in rounds that give the least time; one that fails, or cannot be afforded, says why."""
    begun, last = time.process_time(), dict[str, float]()  # of each method: seconds times step
    for count in range(ROUNDS * len(trials)):
        trial = trials[count % len(trials)]
        method, step = trial.setting.method, trial.setting.step
        if progress is not None:
            progress(count, ROUNDS * len(trials), f"{method}, {1e3 * step:g} ms")
        cost = last.get(method, 0.0) / step
        if trial.q is None and cost > SHARE * budget:
            trial.message = "left out: it would take too long"
        if trial.message or (trial.q is not None and time.process_time() - begun + cost > budget):
            continue
        try:
            run = prepare(trial.task, trial.setting)
            start = time.process_time()
            trial.q = run().track.q
            trial.seconds = min(trial.seconds, time.process_time() - start)
            last[method] = trial.seconds * step
            trial.message = "" if np.isfinite(trial.q).all() else "not finite"
        except PeerError as error:
            trial.message = str(error)


def _row(trial: _Trial, apart: Callable[[Array, Array], float], limit: Array | None, own: bool) -> StepRow:
    setting = trial.setting
    if trial.q is None or trial.message:
        return StepRow(setting.method, setting.step, None, None, None, own, trial.message)
    solver = None if limit is None else float(np.abs(trial.task.robot.difference(limit, trial.q)).max())
    return StepRow(setting.method, setting.step, apart(trial.task.times, trial.q), solver, trial.seconds, own)
