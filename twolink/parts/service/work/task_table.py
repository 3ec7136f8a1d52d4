"""The tasks of worker processes by name; and those about what varies: linearization, sensitivities, identification."""

from typing import Any

import msgspec
import numpy as np

from twolink.errors import QueryError, SceneError
from twolink.io.tables import parse_csv
from twolink.parts.design.linearization import linearize as linearize_scene
from twolink.parts.service.problems import decode_unique
from twolink.parts.service.settings import Quotas
from twolink.parts.service.work.bodies import arguments_of
from twolink.parts.service.work.live_tasks import live
from twolink.parts.service.work.operations import operate
from twolink.parts.service.work.requests import JOB_KINDS, SceneRequest, linearization_request, prepare
from twolink.parts.service.work.robot_tasks import draw, load, receive, robot_by_id, robot_scene
from twolink.parts.service.work.scene_tasks import (
    ProgressOf,
    allowed,
    draw_scene,
    explain,
    export,
    motion,
    preview,
    scene_of,
    simulate,
    study,
    validate,
)
from twolink.parts.service.work.sweep_tasks import export_sweep, pack_robot, sweep, sweep_columns, sweep_run
from twolink.parts.service.work.worker import Report
from twolink.parts.sweeps.design import quantities as quantities_of
from twolink.simulation.sensitivities import sensitivities

_NUMBER_BYTES = 20  # of a number as JSON
_SHOWN = 2000  # samples of residuals in a record


def quantities(*, body: bytes, robots: str) -> bytes:
    """Quantities that can be varied in a scene, with the scene's own values, as JSON. body: a SceneRequest."""
    scene = scene_of(decode_unique(body, SceneRequest).scene, robots)
    rows = [{"name": name, "kind": asked.kind, "unit": asked.unit, "about": asked.about,
             "value": asked.nominal} for name, asked in quantities_of(scene).items()]  # fmt: skip
    return msgspec.json.encode(rows)


def linearize(*, body: bytes, robots: str) -> bytes:
    """A scene's equations near a state, as JSON. body: a `linearization_request`."""
    request = decode_unique(body, linearization_request())
    found = linearize_scene(scene_of(request.scene, robots), **arguments_of(request, "scene"))
    return msgspec.json.encode(found.to_dict(), enc_hook=np.generic.item)


def sense(*, body: bytes, robots: str, quotas: Quotas, report: Report) -> dict[str, Any]:
    """Derivatives of a motion, as a record. body: a request for sensitivities. Its result is all in the record."""
    request = msgspec.json.decode(body, type=JOB_KINDS["sensitivity"].request)
    found = sensitivities(**arguments_of(request) | allowed(request, robots, quotas), progress=ProgressOf(2, report))
    if sum(q.size + v.size for q, v in zip(found.q.values(), found.v.values(), strict=True)) * _NUMBER_BYTES > (
        quotas.answer_mb * 2**20
    ):
        what = f"the derivatives take more than {quotas.answer_mb:g} MB"
        raise SceneError(what, argument="samples_per_second", remedy="ask for fewer samples, or fewer names")
    names = {name: {"q": found.q[name].tolist(), "v": found.v[name].tolist(), "error": found.error[name].tolist()}
             for name in found.q}  # fmt: skip
    run = found.run
    samples = {"t": run.t.tolist(), "samples_q": run.q.tolist(), "samples_v": run.v.tolist()}
    return {"title": run.title, **run.to_dict(), **samples, "sensitivities": names}


def identify(*, body: bytes, robots: str) -> dict[str, Any]:
    """Parameters from measurements, as a record. body: a request for an identification."""
    # Its linear algebra takes half as long to import as all else of a worker: only where it is asked for.
    from twolink.parts.identification.identify import identify as identify_robot
    from twolink.parts.identification.measurements import measurements_of

    request = msgspec.json.decode(body, type=JOB_KINDS["identification"].request)
    robot = robot_by_id(request.robot, robots)
    samples = measurements_of(robot, parse_csv(request.data, "data", QueryError), "data")
    found = identify_robot(robot, **samples, **arguments_of(request, "robot", "data"))
    kept = np.unique(np.linspace(0, len(found.t) - 1, min(len(found.t), _SHOWN)).round().astype(int))
    curves = {"t": found.t, "residuals": found.residuals, "tau": found.torques}
    curves = {name: values[kept].tolist() for name, values in curves.items()}
    return {"title": f"{robot.name}: identification", **found.to_dict(), "curves": curves}


_ABOUT_ROBOTS = (receive, load, draw, robot_scene)
_ABOUT_SCENES = (validate, draw_scene, explain, preview, quantities, linearize, live)
_JOBS = (prepare, pack_robot, simulate, study, sense, identify, sweep, operate)
_RESULTS = (export, motion, export_sweep, sweep_columns, sweep_run)
TASKS = {task.__name__: task for task in (*_ABOUT_ROBOTS, *_ABOUT_SCENES, *_JOBS, *_RESULTS)}
