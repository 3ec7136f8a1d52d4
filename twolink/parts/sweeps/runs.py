"""The runs of a block, computed by a worker: in batches where the scene allows, else one after the other.

A run has the same bits whatever the others in its block are, in any process, on any number of threads.
"""

import dataclasses
import functools
import json
import pickle
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from twolink.contact.choice import choose_contact_method
from twolink.dynamics.threads import one_thread
from twolink.errors import AccuracyError, SceneError, TwolinkError
from twolink.integrate.motion.scene_equations import equations_of
from twolink.integrate.steps.methods import METHODS
from twolink.parts.sweeps.design import OF_VARIANTS, Design, RunInputs, Variant
from twolink.parts.sweeps.outputs import DONE, FAILED, INACCURATE, Request, column_of, function_of, variables
from twolink.scenes import Scene
from twolink.scenes.parameters import Parameter, scene_with
from twolink.simulation.event_worlds import runs_of
from twolink.simulation.sampling import sample_times
from twolink.simulation.scene_run import ACCURACY
from twolink.simulation.trajectory import Trajectory
from twolink.simulation.world_solving import can_be_finer
from twolink.simulation.worlds import differs_beyond_numbers, simulate_many

SAMPLED = 200.0  # samples a second of runs that functions get, as `simulate` has them
LONGEST_REASON = 300
KEPT = 8  # scenes that a thread keeps
BEYOND = "its error bar is above the accuracy"
LOST = "its step size collapsed, or its state stopped being finite"
Columns = dict[str, np.ndarray]
_own = threading.local()  # Pinocchio's data in a scene are not for several threads


@dataclass(frozen=True, eq=False)
class SweepTask:
    """Runs for a worker.

    scene: pickled; key: its digest. quantities, values (n,): what varies, by name.
    """

    key: str
    scene: bytes
    request: Request
    quantities: dict[str, Parameter]
    values: dict[str, np.ndarray]

    @property
    def runs(self) -> int:
        """The number of runs."""
        return len(next(iter(self.values.values())))

    def part(self, some: np.ndarray) -> "SweepTask":
        """Some of the runs."""
        return dataclasses.replace(self, values={name: numbers[some] for name, numbers in self.values.items()})


def compute(task: SweepTask) -> Columns:
    """The variables (n, ...) of the runs, by name."""
    with one_thread():
        scene = _kept((task.key,), lambda: pickle.loads(task.scene))
        return _compute(scene, task)


def _kept(name: Any, make: Callable[[], Scene]) -> Scene:
    """A scene that this thread keeps for further blocks."""
    scenes: dict[Any, Scene] = _own.__dict__.setdefault("scenes", {})
    if name not in scenes:
        if len(scenes) >= KEPT:
            scenes.clear()
        scenes[name] = make()
    return scenes[name]


def _compute(scene: Scene, task: SweepTask) -> Columns:
    request, quantities, values = task.request, task.quantities, task.values
    for name in request.functions:
        function_of(name)  # a worker that lacks it fails, and not the runs
    out = {variable.name: variable.empty(task.runs) for variable in variables(scene.robot, request)}
    for variant, rows in groups(request.accuracy, quantities, values):
        some = {name: numbers[rows] for name, numbers in values.items()}
        try:
            own = _kept((task.key, variant.off, variant.robot), functools.partial(variant.of, scene))
        except TwolinkError as error:  # an effect does not fit the robot, or there is no such robot
            out["status"][rows], out["reason"][rows] = FAILED, str(error)[:LONGEST_REASON]
            continue
        group = _VariantRuns(request, variant.inputs(own, quantities, some), out, rows)
        (_batch if way(own, variant, request, quantities)[0] else _one_by_one)(group, np.arange(len(rows)))
    return out


def groups(accuracy: float | None, quantities: dict[str, Parameter], values: Columns,
           ) -> Iterator[tuple[Variant, np.ndarray]]:  # fmt: skip
    """The runs by variant, and their rows. accuracy: where it does not vary."""
    chosen = [name for name, what in quantities.items() if what.kind in OF_VARIANTS]
    table = np.zeros((len(next(iter(values.values()))), len(chosen)), dtype=int)
    known = {}
    for column, name in enumerate(chosen):
        known[name], table[:, column] = np.unique(values[name], return_inverse=True)
    for codes in np.unique(table, axis=0):
        own = {name: known[name][code] for name, code in zip(chosen, codes, strict=True)}
        off = sorted(quantities[n].entries[0] for n, on in own.items() if quantities[n].kind == "switch" and not on)
        asked = float(own["accuracy"]) if "accuracy" in own else accuracy
        yield Variant(tuple(off), asked, str(own.get("robot", ""))), np.flatnonzero((table == codes).all(axis=1))


def way(scene: Scene, variant: Variant, request: Request, quantities: dict[str, Parameter]) -> tuple[bool, str]:
    """True if runs of a variant are solved in batches, with the reason. scene: without the effects that are off."""
    if variant.robot:
        return False, "one by one: robots differ"
    if choose_contact_method(scene, None).method == "stepped":
        return False, "one by one: contacts are stepped, and errors are estimates"
    if request.functions:
        return False, f"one by one: {request.functions[0]} needs the whole run"
    varied = (name for name, what in quantities.items() if what.kind not in ("q", "v", *OF_VARIANTS))
    names = tuple(new for name in varied if (new := variant.renamed(name)) is not None)
    if "energy" in request.outputs and names:
        return False, "one by one: the energy depends on each run's parameters"
    bound = variant.accuracy or ACCURACY
    if request.verify and not can_be_finer(METHODS["dop853"], bound):
        return False, f"one by one: {bound:g} is below what batches can verify"
    if differs_beyond_numbers(scene, names):
        return False, "one by one: the scene has events, or loops, constants or states that differ by run"
    if "events" in request.outputs and equations_of(scene, ticks=True).has_events:
        return False, "one by one: batches do not tell when limits of effort are reached"
    return True, "in batches: the scene is smooth, and runs differ in numbers only"


def ways(scene: Scene, request: Request, quantities: dict[str, Parameter], values: Columns) -> list[str]:
    """The ways in which runs with these values (n,) by name are solved, with the reasons."""
    variants = (variant for variant, _ in groups(request.accuracy, quantities, values))
    return [*dict.fromkeys(way(scene if variant.robot else variant.of(scene), variant, request, quantities)[1]
                           for variant in variants)]  # fmt: skip


@dataclass(frozen=True, eq=False)
class _VariantRuns:
    """Runs of one variant, and where their results go: the rows (n,) of `out`."""

    request: Request
    inputs: RunInputs
    out: Columns
    rows: np.ndarray

    def put(self, some: np.ndarray, **values: Any) -> None:
        """Write results of some of the runs; those that are not asked for are left out."""
        for name, value in values.items():
            if name in self.out:
                self.out[name][self.rows[some]] = value

    def fail(self, i: int, error: BaseException) -> None:
        """Record why a run failed."""
        text = str(error) if isinstance(error, TwolinkError) else f"{type(error).__name__}: {error}"
        self.put(np.array([i]), status=FAILED, reason=" ".join(text.split())[:LONGEST_REASON])


def _batch(group: _VariantRuns, some: np.ndarray) -> None:
    """Solve some of the runs in one batch; where that is refused, in two halves, down to the run that is."""
    asked, own, times = group.request, group.inputs, group.request.times
    parameters = {name: numbers[some] for name, numbers in own.parameters.items()}
    try:
        worlds = simulate_many(own.scene, asked.duration, q=own.q[some], v=own.v[some], parameters=parameters,
                               accuracy=own.accuracy, t_eval=asked.t_eval or None, verify=asked.verify)  # fmt: skip
    except MemoryError:
        raise
    except Exception as error:  # whatever one of the runs caused
        if len(some) == 1:
            group.fail(int(some[0]), TwolinkError(LOST) if isinstance(error, AccuracyError) else error)
            return
        for half in np.array_split(some, 2):
            _batch(group, half)
        return
    good = np.isfinite(worlds.q).all(axis=1)
    error_bar = np.full(len(some), np.nan) if worlds.error is None else worlds.error
    good &= np.isfinite(error_bar) | (worlds.error is None)
    late = good & ~(error_bar <= (own.accuracy or ACCURACY)) & asked.verify
    status = np.where(late, INACCURATE, np.where(good, DONE, FAILED))
    reasons = np.array(["", BEYOND, LOST], dtype=object)[status - DONE]
    group.put(some, status=status, reason=reasons, error=error_bar,
              t=np.where(good, times[-1], np.nan), q=worlds.q, v=worlds.v, steps=worlds.steps,
              seconds=(worlds.cost.seconds + worlds.cost.verify_seconds) / len(some), events="[]")  # fmt: skip
    if "energy" in asked.outputs:
        energy = np.full(len(some), np.nan)
        energy[good] = sum(own.scene.robot.energy(worlds.q[good], worlds.v[good])) if good.any() else ()
        group.put(some, energy=energy)
    if "samples" in asked.outputs:
        q, v = worlds.samples_q, worlds.samples_v
        group.put(some, q_samples=q.swapaxes(0, 1), v_samples=v.swapaxes(0, 1))


def _one_by_one(group: _VariantRuns, some: np.ndarray) -> None:
    """Solve some of the runs one after the other."""
    asked = group.request
    times = asked.times
    if asked.functions:
        times = np.union1d(times, sample_times(asked.duration, None, SAMPLED))
    for i in some:
        try:
            _one(group, int(i), times)
        except MemoryError:
            raise
        except Exception as error:  # a run that fails is a row with its reason
            group.fail(int(i), error)


def _one(group: _VariantRuns, i: int, times: np.ndarray) -> None:
    asked, own = group.request, group.inputs
    values = {name: float(numbers[i]) for name, numbers in own.parameters.items()}
    scene = scene_with(own.scene, values) if values else own.scene
    start = np.concatenate([own.q[i], own.v[i]])
    status, reason = DONE, ""
    try:
        run = runs_of(scene, times, own.accuracy, verify=asked.verify)(start)
    except AccuracyError as error:
        if not isinstance(error.run, Trajectory) or error.run.error is None:
            raise
        run, status, reason = error.run, INACCURATE, str(error)[:LONGEST_REASON]
    if run.interrupted:
        raise KeyboardInterrupt
    here = np.array([i])
    events = [{"t": float(e.t), "kind": e.kind, "what": e.what, "detail": e.detail} for e in run.events]
    cost = run.cost
    group.put(here, error=np.nan if run.error is None else run.error[-1], t=run.t[-1], q=run.q[-1], v=run.v[-1],
              energy=run.energy[-1] if "energy" in asked.outputs else np.nan, event_count=len(events),
              events=json.dumps(events), steps=cost.steps if cost else 0,
              seconds=cost.seconds + cost.verify_seconds if cost else np.nan)  # fmt: skip
    if "samples" in asked.outputs:  # missing behind the event that ended the run
        samples = np.array(asked.t_eval)
        reached = np.flatnonzero(np.isin(samples, run.t))
        taken = np.searchsorted(run.t, samples[reached])
        for name, states in (("q_samples", run.q), ("v_samples", run.v)):
            group.out[name][group.rows[i], reached] = states[taken]
    for name in asked.functions:
        group.put(here, **{column_of(name): float(function_of(name)(run))})
    group.put(here, status=status, reason=reason)


def run_scene(
    scene: Scene, design: Design, accuracy: float | None, duration: float, number: int
) -> tuple[Scene, float | None, dict[str, Any]]:
    """The scene of one run, its accuracy, and what varies.

    Parameters
    ----------
    scene : Scene
        That of the sweep.
    design : Design
        Its runs, of `make_design`.
    accuracy, duration : float or None, float
        Of the sweep: rad or m, s.
    number : int
        The run in C order: the last dimension changes fastest.

    Raises
    ------
    SceneError
        There is no such run, or it cannot be made into a scene (its row in the store has the same reason).
    """
    if not 0 <= number < design.runs:
        raise SceneError(f"there is no run {number}", argument="run", remedy=f"0 to {design.runs - 1}")
    at = np.unravel_index(number, design.shape)
    values = design.in_block(tuple(slice(i, i + 1) for i in at))
    variant, _ = next(groups(accuracy, design.quantities, values))
    own = variant.inputs(variant.of(scene), design.quantities, values)
    changed = scene_with(own.scene, {name: float(numbers[0]) for name, numbers in own.parameters.items()})
    made = Scene(changed.base, own.q[0], own.v[0], changed.effects, duration, scene.title)
    return made, variant.accuracy, {name: numbers.tolist()[0] for name, numbers in values.items()}
