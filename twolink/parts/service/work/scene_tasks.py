"""Tasks of worker processes about scenes: check, explain, simulate, study accuracy, and call other functions.

A scene in a request has the schema of scene files, as JSON, with robots by id. Nothing is read from files.
"""

import dataclasses
import functools
import inspect
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

import twolink as tl
from twolink.accuracy import Study, accuracy_study
from twolink.dynamics import Robot, load_robot
from twolink.dynamics.robot_record import link_poses, robot_record
from twolink.effects.effect import Effect
from twolink.errors import RobotError, SceneError, TwolinkError
from twolink.parts.service.problems import Refusal, decode_unique, encode, kept
from twolink.parts.service.settings import Quotas
from twolink.parts.service.store.archives import read_robot, write_robot
from twolink.parts.service.store.data_folder import UPLOADED
from twolink.parts.service.work.requests import (
    NOT_SENT,
    SceneRequest,
    arguments_of,
    explain_request,
    job_request,
    preview_request,
    sent_as,
)
from twolink.parts.service.work.robot_tasks import robot_by_id, visuals_of
from twolink.parts.service.work.worker import Report
from twolink.robots.catalogue import catalogue_names
from twolink.scenes import Scene, load_scene
from twolink.scenes.file import scene_from_data
from twolink.scenes.file_format import RobotEntry, SceneFile
from twolink.scenes.objects import is_mesh
from twolink.scenes.urdf_scene import is_robot
from twolink.scenes.urdf_scene import scene_of as scene_of_robot
from twolink.show.meshcat_scene import plane_direction
from twolink.show.viewer_data import contact_data, resample
from twolink.simulation.explanation import explain as explain_scene
from twolink.simulation.scene_run import simulate as simulate_scene
from twolink.simulation.text import as_data
from twolink.simulation.trajectory import Trajectory

_MOST = 200  # effects or objects
SAMPLES, ROBOT, ROWS = "result.npz", "robot.pickle", "result.json"  # of simulations: samples, robot; of studies: all
_POSE_BYTES = 80  # of seven numbers as JSON
_REPORT_EVERY = 0.1  # seconds


def scene_of(scene: str | SceneFile, robots: str, robot: bytes = b"") -> Scene:
    """The scene: a bundled one by name, or one in full. robots: the folder of uploaded robots. robot: of `pack_robot`.

    Raises SceneError and RobotError whose `where` is the path in the request.
    """
    if isinstance(scene, str):
        if scene.endswith(".toml") or "/" in scene or "\\" in scene:
            raise SceneError("paths are not read here", argument="scene", remedy="GET /v1/scenes lists the scenes")
        return load_scene(scene)
    try:
        for name, items in (("effects", scene.effects), ("objects", scene.objects)):
            if len(items) > _MOST:
                raise SceneError(f"{len(items)} {name}, the limit is {_MOST}", argument=name, remedy="leave some out")
        _refuse_files([*scene.effects, *({"file": one.source} for one in scene.objects if is_mesh(one.source))])
        if robot:  # which has them
            scene = msgspec.structs.replace(scene, objects=[])
        return scene_from_data(scene, (lambda _: read_robot(robot)) if robot else functools.partial(_robot, robots))
    except TwolinkError as error:
        where = f"scene.{error.where}" if error.where else "scene"
        raise error.at(where, argument=error.argument or "scene") from None


def _robot(robots: str, entry: RobotEntry) -> Robot:
    """A robot by id. Only those of the catalogue take options here: an uploaded one has its own."""
    if entry.root == "fixed" and not entry.lock:
        return robot_by_id(entry.source, robots)
    if entry.source in catalogue_names():
        return load_robot(entry.source, root=entry.root, lock=entry.lock)
    what = "an uploaded robot's root and lock are set when it is uploaded"
    raise RobotError(what, argument="robot", remedy="POST /v1/robots with other options gives another id")


def _refuse_files(value: Any) -> None:
    """Raise SceneError where a table of samples would be read from a file."""
    if isinstance(value, dict):
        if isinstance(value.get("file"), str):
            what = f"files are not read here: {value['file'][:80]!r}"
            raise SceneError(what, argument="effects", remedy="send times and values, or shapes")
        value = list(value.values())
    for item in value if isinstance(value, list) else ():
        _refuse_files(item)


def validate(*, body: bytes, robots: str) -> bytes:
    """A scene as it is understood, as JSON. body: a SceneRequest. robots: the folder of uploaded robots."""
    scene = scene_of(decode_unique(body, SceneRequest).scene, robots)
    content = {"title": scene.title, "robot": robot_record(scene.robot), "duration": scene.duration,
               "q": scene.q.tolist(), "v": scene.v.tolist(), "effects": scene.effects,
               "frames": scene.robot.frame_names, "poses": link_poses(scene.robot, scene.q).tolist()}  # fmt: skip
    return encode(content)


def scene_visuals(*, body: bytes, robots: str) -> bytes:
    """Draw a scene with its objects, as `visuals_of` a robot. body, robots: as for `validate`."""
    return visuals_of(scene_of(decode_unique(body, SceneRequest).scene, robots).robot)


def explain(*, body: bytes, robots: str, quotas: Quotas) -> bytes:
    """Explain the computation of a scene, and the cost of a run, as JSON. body: an `explain_request`."""
    request = decode_unique(body, explain_request())
    explanation = explain_scene(**allowed(request, robots, quotas))
    return encode({**dataclasses.asdict(explanation), "text": str(explanation)})


def allowed(request: Any, robots: str, quotas: Quotas, *without: str, robot: bytes = b"") -> dict[str, Any]:
    """The arguments of the call of a request, with its scene and duration [s]. robots, robot: see `scene_of`.

    without: fields of the request that are no arguments.
    """
    scene = scene_of(request.scene, robots, robot)
    own = {"scene": scene, "duration": require_allowed(request, scene, quotas)}
    return arguments_of(request, *without) | own


def require_allowed(request: Any, scene: Scene, quotas: Quotas) -> float:
    """The duration [s] of a run. Raises SceneError for one that is longer, or has more samples, than allowed."""
    seconds: float = request.duration or scene.duration
    if seconds > quotas.duration:
        what = f"{seconds:g} s are too long, the service simulates up to {quotas.duration:g} s"
        raise SceneError(what, argument="duration", remedy="ask for less")
    samples = samples_of(request, seconds)
    if samples > quotas.samples:
        what = f"{samples:.3g} samples are too many, the limit is {quotas.samples}"
        raise SceneError(what, argument="samples_per_second", remedy="ask for fewer, or a shorter duration")
    return seconds


def samples_of(request: Any, seconds: float) -> float:
    """The number of samples of a run of so many seconds that are kept."""
    times = getattr(request, "t_eval", None)
    if "samples" not in getattr(request, "outputs", ("samples",)):
        return 0.0
    return seconds * getattr(request, "samples_per_second", 0.0) if times is None else len(times)


def told(report: Report) -> Callable[[float, float, str], None]:
    """The callback of a function's progress: what is done, the total, and a label."""
    return lambda done, total, label: report({"fraction": 0.99 * done / max(total, 1), "done": done, "total": total,
                                              "label": label})  # fmt: skip


def simulate(*, body: bytes, robots: str, quotas: Quotas, folder: str, report: Report) -> dict[str, Any]:
    """Simulate, write the samples and the robot into `folder`, and return the record of the run.

    body: a request for a simulation.
    """
    request = job_request("simulation", body)
    given = allowed(request, robots, quotas, "simulator")
    if request.simulator != "twolink":
        return _peers_run(request, given["scene"], given["duration"], Path(folder))
    progress = progress_of(2 if request.verify else 1, report)
    run = simulate_scene(**given, progress=progress)
    path, largest = Path(folder) / SAMPLES, quotas.result_mb * 2**20
    run.save(path)
    if path.stat().st_size > largest:  # the samples matter more than what is drawn over them
        dataclasses.replace(run, solution=None, recorded_contacts=None).save(path)
    if path.stat().st_size > largest:
        path.unlink()
        what = f"the result takes more than {quotas.result_mb:g} MB"
        raise SceneError(what, argument="samples_per_second", remedy="ask for fewer samples")
    (Path(folder) / ROBOT).write_bytes(write_robot(run.robot))
    return {"title": run.title, **run.to_dict()}


def _peers_run(request: Any, scene: Scene, duration: float, folder: Path) -> dict[str, Any]:
    """Run the scene in another simulator: `setting` says which one and how."""
    from twolink.parts.referee.comparison import peer_log  # few services are asked for it

    for name in ("t_eval", "tolerance", "step", "contact"):
        if getattr(request, name) is not None:
            what = "another simulator runs at its default setting, and has samples at equal distances only"
            raise SceneError(what, argument=name, remedy="leave it out")
    times = np.linspace(0.0, duration, max(3, round(samples_of(request, duration)) + 1))
    found = peer_log(scene, request.simulator, times)
    found.log.save(folder / SAMPLES)
    (folder / ROBOT).write_bytes(write_robot(scene.robot))
    return {"title": scene.title, "setting": f"{found.peer}, {found.setting}", **found.log.to_dict()}


def preview(*, body: bytes, robots: str, quotas: Quotas) -> bytes:
    """A run without an error bar, with its samples and the poses of its links, as JSON. body: a `preview_request`."""
    request = decode_unique(body, preview_request())
    given = allowed(request, robots, quotas, "frames")
    run = simulate_scene(**given, verify=False, patience=quotas.load_seconds)
    columns = {name: values.tolist() for name, values in thinned(run.columns(), request.frames).items()}
    result = {"title": run.title, **run.to_dict()}
    return msgspec.json.encode({"result": result, "columns": columns, "motion": _motion(run, request.frames, quotas)})


def thinned(columns: dict[str, np.ndarray], points: int) -> dict[str, np.ndarray]:
    """The columns (n,) at no more than so many samples, ends included; without those of more axes."""
    count = len(columns["t"])
    kept = np.unique(np.linspace(0, count - 1, min(points, count)).round().astype(int))
    return {name: values[kept] for name, values in columns.items() if values.ndim == 1}


def progress_of(passes: int, report: Report) -> Callable[[float, float, str], None]:
    """The callback that reports how far a run is: solved once, again for the error bar, and more often where needed."""
    done, last, fraction, reported = 0, 0.0, 0.0, 0.0

    def tell(t: float, duration: float, _label: str) -> None:
        nonlocal done, last, fraction, reported
        done += t < last
        last = t
        part = (done + t / duration) / max(passes, done + 1)
        fraction = min(0.99, max(fraction, part))
        if time.monotonic() - reported > _REPORT_EVERY:
            reported = time.monotonic()
            report({"fraction": fraction, "t": t, "solution": done + 1})

    return tell


def study(*, body: bytes, robots: str, quotas: Quotas, folder: str, report: Report) -> dict[str, Any]:
    """Study what accuracy costs, write the study into `folder`, and return it. body: a request for a study."""
    asked = allowed(job_request("study", body), robots, quotas)
    result = accuracy_study(**asked, progress=told(report))
    result.save(Path(folder) / ROWS)
    return result.to_dict()


def export(*, path: str) -> None:
    """Write a result in another format, beside it: a table, a figure or a playback by the ending of the path."""
    target = Path(path)
    rows = target.with_name(ROWS)
    result = Study.load(rows) if rows.exists() else _run_in(target.parent)
    if isinstance(result, Trajectory) and target.suffix == ".html":
        result.playback(target)
    else:
        (result.plot if target.suffix in (".svg", ".png") else result.save)(target)


def motion(*, folder: str, frames: int, quotas: Quotas) -> bytes:
    """Poses of the links at `frames` times at equal distances, as JSON."""
    return msgspec.json.encode(_motion(_run_in(Path(folder)), frames, quotas))


def _motion(run: Trajectory, frames: int, quotas: Quotas) -> dict[str, Any]:
    count = frames * len(run.robot.frame_names)
    if count * _POSE_BYTES > quotas.answer_mb * 2**20:
        what = f"{count} poses take more than {quotas.answer_mb:g} MB"
        raise Refusal(413, what, where="query: frames", remedy="ask for fewer frames")
    times = np.linspace(run.t[0], run.t[-1], frames)
    known = not run.estimated and (run.error is not None or run.solution is not None)  # when v jumps: at its events
    v, breaks = run.v if known else None, [event.t for event in run.events]
    q = run.robot.normalize(resample(run.robot.model, run.t, run.q, times, v, breaks))
    poses = link_poses(run.robot, q)
    return {
        "t": times.tolist(),
        "links": run.robot.frame_names,
        "poses": np.round(poses, 7).tolist(),
        "centre_of_mass": np.round(run.robot.centre_of_mass(q), 7).tolist(),
        "direction": plane_direction(poses),
        "contacts": contact_data(run.t, run.contacts, times),
        "forces": contact_data(run.t, run.forces_on_links, times),
    }


def _run_in(folder: Path) -> Trajectory:
    """The run that `simulate` has written into a folder."""
    with kept("the run", "delete it, and ask for it again"):
        return Trajectory.load(folder / SAMPLES, read_robot((folder / ROBOT).read_bytes()))


def answer_of_call(
    request: Any, scene_from: Callable[[Any], Scene], robot_from: Callable[[str], Robot], **own: Any
) -> dict[str, Any]:
    """The result of the function that a request names, as plain data, with a title and its text for people.

    request: one of the requests for an operation. own: what the caller decides, where the function takes it.
    """
    function = getattr(tl, request.__struct_config__.tag)
    given = arguments_of(request)
    scenes, robots = sent_as(function, Scene), sent_as(function, Robot)
    for name in {*scenes, *robots}:  # which may be the same: a robot stays one, as the function means it otherwise
        asked = given[name]
        named = isinstance(asked, str) and bool(is_robot(asked) or UPLOADED.fullmatch(asked))
        given[name] = (robot_from if name in robots and (named or name not in scenes) else scene_from)(asked)
    titles = [one.title or one.robot.name if isinstance(one, Scene) else one.name
              for one in given.values() if isinstance(one, Scene | Robot)]  # fmt: skip
    taken = inspect.signature(function).parameters
    found = function(**given, **{name: own[name] for name in NOT_SENT if name in taken and name in own})
    record = msgspec.to_builtins(found) if isinstance(found, Effect) else as_data(found)
    return {"title": ", ".join(titles), "text": str(found), **record}


def operate(*, body: bytes, robots: str, quotas: Quotas, report: Report) -> dict[str, Any]:
    """Call the function that a request names, and return the record of its result, which is all of it.

    body: a request for an operation.
    """
    request = job_request("operation", body)

    def scene_from(asked: Any) -> Scene:
        scene = scene_of(asked, robots)
        if hasattr(request, "duration"):
            require_allowed(request, scene, quotas)
        return scene

    def robot_from(key: str) -> Robot:
        robot = robot_by_id(key, robots)
        if hasattr(request, "duration"):
            require_allowed(request, scene_of_robot(robot), quotas)
        return robot

    record = answer_of_call(request, scene_from, robot_from, progress=told(report), patience=quotas.job_seconds)
    size = len(msgspec.json.encode(record))
    if size > quotas.answer_mb * 2**20:
        what = f"the answer takes {size / 2**20:.0f} MB, more than {quotas.answer_mb:g}"
        raise SceneError(what, where="request", code="too-large", remedy="ask for less: fewer samples, or shorter")
    return record
