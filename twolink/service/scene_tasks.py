"""What worker processes do with scenes: check and explain them, simulate, study accuracy, and write results."""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from twolink.accuracy import Study, accuracy_study
from twolink.dynamics.robot_record import link_names, robot_record
from twolink.errors import SceneError
from twolink.scenes import Scene
from twolink.service.job_requests import ExplainRequest, SceneRequest, SimulationRequest, StudyRequest, check_quotas
from twolink.service.kinematics import frame_poses
from twolink.service.scene_body import scene_of
from twolink.service.settings import Quotas
from twolink.service.worker import Tell
from twolink.show.meshcat_view import resample
from twolink.simulation.explanation import explain as explain_scene
from twolink.simulation.scene_run import simulate as simulate_scene
from twolink.simulation.trajectory import Trajectory

SAMPLES, ROWS = "result.npz", "result.json"
_OFTEN = 0.1  # seconds between two reports of progress


def validate(*, request: dict[str, Any], robots: str, **_: Any) -> dict[str, Any]:
    """A scene as it was understood."""
    scene = scene_of(msgspec.convert(request, SceneRequest).scene, robots)
    return {
        "title": scene.title,
        "robot": robot_record(scene.robot),
        "duration": scene.duration,
        "q": scene.q.tolist(),
        "v": scene.v.tolist(),
        "effects": [msgspec.to_builtins(effect) for effect in scene.effects],
    }


def explain(*, request: dict[str, Any], robots: str, quotas: dict[str, Any], **_: Any) -> dict[str, Any]:
    """What a scene computes, and what a run will take."""
    asked = msgspec.convert(request, ExplainRequest)
    scene = scene_of(asked.scene, robots)
    check_quotas(msgspec.convert(quotas, Quotas), asked.duration or scene.duration, 1.0)
    found = explain_scene(scene, asked.accuracy, asked.duration, method=asked.method)
    return {**dataclasses.asdict(found), "text": str(found)}


def simulate(
    *, request: dict[str, Any], robots: str, quotas: dict[str, Any], folder: str, tell: Tell
) -> dict[str, Any]:
    """Simulate, write the samples into `folder`, and return the summary."""
    asked, allowed = msgspec.convert(request, SimulationRequest), msgspec.convert(quotas, Quotas)
    scene = scene_of(asked.scene, robots)
    duration = asked.duration or scene.duration
    check_quotas(allowed, duration, asked.samples)
    run = simulate_scene(
        scene, duration, asked.accuracy, method=asked.method, samples=asked.samples, verify=asked.verify,
        precision=asked.precision, tolerance=asked.tolerance, step=asked.step,
        progress=_Progress(duration, 2 if asked.verify else 1, tell),
    )  # fmt: skip
    path = Path(folder) / SAMPLES
    run.save(path)
    if path.stat().st_size > allowed.result_mb * 2**20:
        path.unlink()
        raise SceneError(f"the result takes more than {allowed.result_mb:g} MB", where="samples",
                         remedy="ask for fewer samples")  # fmt: skip
    return _summary(scene, run)


class _Progress:
    """Reports how far a run is: it is solved once, again for the error bar, and more often where that is needed."""

    def __init__(self, duration: float, passes: int, tell: Tell) -> None:
        self._duration, self._passes, self._tell = duration, passes, tell
        self._done, self._t, self._fraction, self._then = 0, 0.0, 0.0, 0.0

    def __call__(self, t: float) -> None:
        if t < self._t:
            self._done += 1
        self._t = t
        part = (self._done + t / self._duration) / max(self._passes, self._done + 1)
        self._fraction = min(0.99, max(self._fraction, part))
        if time.monotonic() - self._then > _OFTEN:
            self._then = time.monotonic()
            self._tell({"fraction": self._fraction, "t": t, "solution": self._done + 1})


def _summary(scene: Scene, run: Trajectory) -> dict[str, Any]:
    return {
        "title": scene.title,
        "robot": scene.robot.name,
        "joints": list(scene.robot.joint_names),
        "duration": float(run.t[-1]),
        "samples": len(run.t),
        "error": None if run.error is None else float(run.error.max()),
        "accuracy": run.accuracy,
        "trusted_until": run.trusted_until,
        "energy_drift": float(np.ptp(run.energy)),
        "q": run.q[-1].tolist(),
        "v": run.v[-1].tolist(),
        "cost": None if run.cost is None else dataclasses.asdict(run.cost),
        "events": [dataclasses.asdict(event) for event in run.events],
        "precise": None if run.precise is None else [str(x) for x in run.precise[-1]],
    }


def study(*, request: dict[str, Any], robots: str, quotas: dict[str, Any], folder: str, tell: Tell) -> dict[str, Any]:
    """Study what accuracy costs, write it into `folder`, and return it."""
    asked, allowed = msgspec.convert(request, StudyRequest), msgspec.convert(quotas, Quotas)
    scene = scene_of(asked.scene, robots)
    duration = asked.duration or scene.duration
    check_quotas(allowed, duration, asked.samples)

    def progress(done: int, total: int, label: str) -> None:
        tell({"fraction": done / max(total, 1), "done": done, "total": total, "label": label})

    found = accuracy_study(
        scene, duration, methods=asked.methods, tolerances=asked.tolerances, repeats=asked.repeats,
        samples=asked.samples, budget=asked.budget, progress=progress,
    )  # fmt: skip
    found.save(Path(folder) / ROWS)
    return found.to_dict()


def export(*, kind: str, request: dict[str, Any], robots: str, folder: str, name: str, **_: Any) -> int:
    """Write a result in another format, beside it: a table, a figure or a playback by the name's ending. Its bytes."""
    path = Path(folder) / name
    if kind == "study":
        study = Study.load(Path(folder) / ROWS)
        (study.plot if path.suffix in (".svg", ".png") else study.save)(path)
    else:
        run = _run(request, robots, folder)
        if path.suffix == ".html":
            run.playback(path)
        else:
            (run.plot if path.suffix in (".svg", ".png") else run.save)(path)
    return path.stat().st_size


def motion(*, request: dict[str, Any], robots: str, folder: str, frames: int, name: str, **_: Any) -> int:
    """Write where the links are at `frames` instants at equal distances, as JSON. Its bytes."""
    run = _run(request, robots, folder)
    times = np.linspace(run.t[0], run.t[-1], frames)
    poses = frame_poses(run.robot, run.robot.normalize(resample(run.robot.model, run.t, run.q, times)))
    content = {"t": times.tolist(), "links": link_names(run.robot), "poses": np.round(poses, 7).tolist()}
    return (Path(folder) / name).write_bytes(msgspec.json.encode(content))


def _run(request: dict[str, Any], robots: str, folder: str) -> Trajectory:
    scene = scene_of(msgspec.convert(request, SimulationRequest).scene, robots)
    return Trajectory.load(Path(folder) / SAMPLES, scene.robot)
