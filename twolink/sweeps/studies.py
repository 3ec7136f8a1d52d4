"""Studies: sweeps as TOML files, from a path or bundled with twolink, and what these keep of a run."""

import math
import os
import tomllib
from importlib import resources
from pathlib import Path
from typing import Any

import msgspec

from twolink.errors import SceneError, nearest
from twolink.io.text import read_text, split_path
from twolink.scenes import load_scene
from twolink.simulation.trajectory import Trajectory
from twolink.sweeps.sweeping import sweep


def landing(run: Trajectory) -> float:
    """Where the ball of a pitch lands, m; NaN where it does not."""
    if not any(event.what == "landed" for event in run.events):
        return math.nan
    return float(run.robot.frame_pose(run.robot.normalize(run.q[-1]), "ball")[1][0])


MAX_BYTES = 2**20
REMEDY = "give ranges in place of long lists"


class SweepFigure(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the figure of a study shows: the arguments of `plot_sweep`."""

    variable: str = ""
    turns: bool = False


class SweepStudy(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A sweep: the arguments of `sweep`, and its figure."""

    scene: str
    vary: dict[str, Any]
    title: str = ""
    accuracy: float = 1e-6
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
    folder = resources.files("twolink.sweeps") / "bundled"
    return tuple(sorted(p.name.removesuffix(".toml") for p in folder.iterdir() if p.name.endswith(".toml")))


def load_study(source: str) -> SweepStudy:
    """A bundled study by its name, or one from a TOML file. Raises SceneError, code "unknown-study" or "schema"."""
    if source.endswith(".toml"):
        text = read_text(Path(source), SceneError, MAX_BYTES, REMEDY)
    elif source in bundled_studies():
        text = (resources.files("twolink.sweeps") / "bundled" / f"{source}.toml").read_text(encoding="utf-8")
    else:
        raise SceneError(f"there is no study {source!r}", argument="source", code="unknown-study",
                         remedy=f"{nearest(source, bundled_studies())} (a file's name ends in .toml)")  # fmt: skip
    try:
        study = msgspec.convert(_content(text, source), SweepStudy)
    except msgspec.ValidationError as error:
        what, path = split_path(str(error))
        raise SceneError(what, where=f"{source}: {path}".rstrip(": "), remedy="see a bundled study for an example",
                         code="schema") from None  # fmt: skip
    beside = Path(source).parent / study.scene
    return msgspec.structs.replace(study, scene=str(beside)) if study.scene.endswith(".toml") else study


def _content(text: str, source: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except ValueError as error:
        raise SceneError(f"not TOML: {error}", where=source, remedy="check that line", code="not-toml") from None


def study_of(source: str) -> SweepStudy:
    """A study by its name or file; or one of a scene in which nothing varies yet."""
    if source in bundled_studies():
        return load_study(source)
    if source.endswith(".toml") and "vary" in _content(read_text(Path(source), SceneError, MAX_BYTES, REMEDY), source):
        return load_study(source)
    return SweepStudy(source, {})


def run_study(study: SweepStudy, out: str | os.PathLike[str], **options: Any) -> Any:
    """Run a study into a store; options: executor, workers, chunk and progress of `sweep`. Returns its Dataset."""
    given = msgspec.structs.asdict(study)
    for name in ("scene", "title", "figure"):
        del given[name]
    return sweep(load_scene(study.scene), out=out, **given, **options)
