"""sweep: many runs of a scene into a store; and studies, sweeps as TOML files, from a path or bundled with twolink."""

import dataclasses
import logging
import math
import os
import tomllib
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import msgspec
from numpy.typing import ArrayLike

from twolink.dynamics.arguments import Positive
from twolink.errors import SceneError, import_extra, nearest, require_extra
from twolink.io.progress import Report
from twolink.io.schemas import misfit
from twolink.io.text import read_text
from twolink.parts.sweeps.design import make_design
from twolink.parts.sweeps.engines import BlockEngine
from twolink.parts.sweeps.outputs import Request, check_outputs
from twolink.parts.sweeps.plan import SweepPlan, make_plan
from twolink.parts.sweeps.runs import compute
from twolink.parts.sweeps.store import EXTRA, locked, open_store, read_record
from twolink.parts.sweeps.working import Work, engine_of
from twolink.scenes import Scene
from twolink.scenes.scene import accuracy_of
from twolink.scenes.urdf_scene import named_scene
from twolink.simulation.sampling import duration_for, sample_times
from twolink.simulation.trajectory import Trajectory

log = logging.getLogger("twolink")
PART = 1e-3  # of a run, that compiles its steps


def sweep(
    scene: Scene,
    duration: Positive | None = None,
    *,
    vary: Mapping[str, Any],
    out: str | os.PathLike[str],
    accuracy: Positive | None = None,
    t_eval: ArrayLike | None = None,
    samples_per_second: Positive = 200.0,
    design: str = "grid",
    count: int | None = None,
    seed: int = 0,
    outputs: Sequence[str] = ("final",),
    verify: bool = True,
    executor: Any = None,
    workers: int | None = None,
    chunk: int | None = None,
    progress: Report | None = None,
) -> Any:
    """Run a scene many times, with other initial states, parameters, effects or accuracies, into a Zarr store.

    Called again with the same arguments it goes on where it was stopped, however that was. With more values it computes
    the new runs only.

    Parameters
    ----------
    scene : Scene
    duration : float, optional
        Simulated time, s; by default the scene's own.
    vary : mapping
        Values (n,) by name: "q.JOINT", "v.JOINT", a physical parameter or number of an effect as in `simulate_many`
        ("LINK.mass" alone keeps the inertia about the centre of mass),
        "effects.1" (true or false: whether it acts), "accuracy", "robot" (names: other robots under the same effects,
        from `random_state(1, seed=0)`). {"range": [first, last, count]} stands for equally
        spaced values; samples have {"uniform": [low, high]} or {"normal": [mean, standard deviation]}.
    out : path-like
        The store, a folder; by custom it ends in .zarr.
    accuracy : float, optional
        Bound on the global error of q in every run, rad or m; by default as in `simulate`.
    t_eval, samples_per_second : optional
        The samples, as in `simulate`, of the output "samples".
    design : {"grid", "list", "random", "sobol", "latin-hypercube"}
        All combinations; the values at one position of all together; or samples (scipy.stats.qmc).
    count, seed : int
        Of samples.
    outputs : sequence of str
        "final": t, q, v at the end. "samples": q, v at each. "events". "energy" at the end. "cost". In
        Python also a function of the run, "module:function", which takes a Trajectory and returns a number.
    verify : bool
        Compute error bars.
    executor : optional
        None: processes of this machine. A `dask.distributed.Client` or the address of a scheduler. Slurm:
        "slurm:/shared/folder?partition=cpu&time=60", with sbatch's long options. Or what has the interface of
        `concurrent.futures.Executor`.
    workers : int, optional
        Number of local processes; by default one a core (TWOLINK_THREADS).
    chunk : int, optional
        Runs that are computed and written together, of a new store.
    progress : callable, optional
        Called now and then with what is done, the total and a label; here runs.

    Returns
    -------
    xarray.Dataset
        Opened lazily. Dimensions are named by what varies (grid), or "run". Variables: what is asked for, `error` (the
        bar at the end, rad or m), `status` (1 done, 2 inaccurate, 3 failed, 4 abandoned: workers died of it three
        times; 0 pending) and `reason`. Attributes: title, `how` runs are solved and why, and `twolink`: JSON of the
        plan, versions, machine and time, and of other machines or versions that went on with it (`resumed`). Ctrl-C
        returns what is done so far.

    Raises
    ------
    SceneError
        An argument does not fit; or the store belongs to another sweep (code "another-sweep", with the difference).
    TwolinkError
        The store cannot be written (code "not-writable") or is in use (code "in-use"), or the cluster is gone (code
        "cluster-lost"), or workers lack what they need (code "workers-differ"). What was finished is kept.
    MissingExtraError
        xarray or zarr is not installed.

    Notes
    -----
    A run has the same bits whatever the engine, the number of workers and the size of chunks.
    """
    import_extra("zarr", EXTRA)
    require_extra("xarray", EXTRA)  # takes half a second to import, and is needed at the end
    end, kept = duration_for(scene, duration), check_outputs(outputs)
    times = sample_times(end, t_eval, samples_per_second)
    if t_eval is not None and "samples" not in kept:
        raise SceneError("samples are not among the outputs", argument="t_eval", remedy='outputs=["final", "samples"]')
    samples = tuple(times.tolist()) if "samples" in kept else ()
    request = Request(end, None if accuracy is None else accuracy_of(accuracy), kept, samples, bool(verify))
    plan = make_plan(scene, make_design(scene, vary, design, count, seed), request, chunk)
    path = Path(out)
    with locked(path):
        store = open_store(path, plan)
        if next(store.pending(), None) is not None:
            store.note_origin()
            log.info("%s runs %s", f"{plan.design.runs:,}", "; ".join(plan.ways))
            try:
                with engine_of(executor, workers) as engine:
                    _compile(plan, engine)
                    Work(store, engine, progress or (lambda *_: None)).all()
            except KeyboardInterrupt:
                log.warning("interrupted: what is done is kept in %s", path)
    return open_sweep(path)


def _compile(plan: SweepPlan, engine: BlockEngine) -> None:
    """Compile what runs need, once: workers load it.

    Of batches here, by a part of the first run. Other runs need a whole one to meet all their modes; a worker takes it,
    as it may end the process.
    """
    task = plan.task(tuple(slice(0, 1) for _ in plan.design.shape))  # the first run
    request = dataclasses.replace(task.request, outputs=(), t_eval=())
    if all(text.startswith("in batches") for text in plan.ways):
        request = dataclasses.replace(request, duration=PART * request.duration)
        compute(dataclasses.replace(task, request=request))
        engine.ready()
        return
    engine.ready()
    try:
        engine.submit(dataclasses.replace(task, request=request)).result()
    except Exception:  # the run is tried again in its block
        engine.restart()


def open_sweep(path: str | os.PathLike[str]) -> Any:
    """The results of a sweep, finished or not, as an xarray.Dataset that is read when it is used.

    Raises
    ------
    SceneError
        It is no store of a sweep; code "no-sweep".
    """
    xarray = import_extra("xarray", EXTRA)
    read_record(Path(path))
    return xarray.open_zarr(str(path), consolidated=False, chunks=None)


def landing(run: Trajectory) -> float:
    """The x coordinate at which the ball of a pitch lands, m; NaN where it does not."""
    if not any(event.what == "landed" for event in run.events):
        return math.nan
    return float(run.robot.frame_pose(run.robot.normalize(run.q[-1]), "ball")[1][0])


class SweepFigure(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Contents of a study's figure: the arguments of `plot_sweep`."""

    variable: str = ""
    turns: bool = False


class SweepStudy(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A sweep: the arguments of `sweep`, and its figure."""

    scene: str
    vary: dict[str, Any]
    title: str = ""
    accuracy: float | None = None
    duration: float | None = None
    design: str = "grid"
    count: int | None = None
    seed: int = 0
    outputs: tuple[str, ...] = ("final",)
    t_eval: tuple[float, ...] | None = None
    samples_per_second: float = 200.0
    figure: SweepFigure = SweepFigure()


def bundled_studies() -> tuple[str, ...]:
    """The names of the studies that come with twolink."""
    folder = resources.files("twolink.parts.sweeps") / "bundled"
    return tuple(sorted(p.name.removesuffix(".toml") for p in folder.iterdir() if p.name.endswith(".toml")))


def load_study(source: str) -> SweepStudy:
    """A bundled study by its name, or one from a TOML file. Raises SceneError, code "unknown-study" or "schema"."""
    if source.endswith(".toml"):
        content = _content(source)
    elif source in bundled_studies():
        file = resources.files("twolink.parts.sweeps") / "bundled" / f"{source}.toml"
        content = tomllib.loads(file.read_text(encoding="utf-8"))
    else:
        raise SceneError(f"there is no study {source!r}", argument="source", code="unknown-study",
                         remedy=f"{nearest(source, bundled_studies())} (a file's name ends in .toml)")  # fmt: skip
    try:
        study = msgspec.convert(content, SweepStudy)
    except msgspec.ValidationError as error:
        what, path, remedy = misfit(error, SweepStudy)
        raise SceneError(what, where=f"{source}: {path}".rstrip(": "), code="schema",
                         remedy=remedy or "see a bundled study for an example") from None  # fmt: skip
    beside = Path(source).parent / study.scene
    return msgspec.structs.replace(study, scene=str(beside)) if study.scene.endswith(".toml") else study


def _content(source: str) -> dict[str, Any]:
    try:
        return tomllib.loads(read_text(Path(source), SceneError, 2**20, "give ranges in place of long lists"))
    except ValueError as error:
        raise SceneError(f"not TOML: {error}", where=source, remedy="check that line", code="not-toml") from None


def study_of(source: str) -> SweepStudy:
    """A study by its name or file; or one of a scene in which nothing varies yet."""
    if source in bundled_studies() or (source.endswith(".toml") and "vary" in _content(source)):
        return load_study(source)
    return SweepStudy(source, {})


def run_study(study: SweepStudy, out: str | os.PathLike[str], **options: Any) -> Any:
    """Run a study into a store; options: executor, workers, chunk and progress of `sweep`. Returns its Dataset."""
    own = ("scene", "title", "figure")
    given = {name: value for name, value in msgspec.structs.asdict(study).items() if name not in own}
    return sweep(named_scene(study.scene), out=out, **given, **options)
