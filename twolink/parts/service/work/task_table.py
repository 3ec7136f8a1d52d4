"""The tasks of worker processes by name; and those about what varies, and of simulations that clients pull.

What varies: linearization, sensitivities, identification. A live simulation is solved step by step, at the pace of the
service.
"""

from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from twolink.dynamics import Robot
from twolink.dynamics.robot_record import link_poses
from twolink.errors import QueryError, SceneError, TwolinkError
from twolink.io.tables import parse_csv
from twolink.parts.design.linearization import linearize as linearize_scene
from twolink.parts.service.problems import decode_unique, encode, problem_of
from twolink.parts.service.settings import Quotas
from twolink.parts.service.work.requests import (
    LiveRequest,
    LiveWords,
    SceneRequest,
    arguments_of,
    job_request,
    linearization_request,
    prepare,
)
from twolink.parts.service.work.robot_tasks import draw, load, receive, robot_by_id, robot_scene
from twolink.parts.service.work.scene_tasks import (
    allowed,
    explain,
    export,
    motion,
    operate,
    preview,
    progress_of,
    scene_of,
    scene_visuals,
    simulate,
    study,
    validate,
)
from twolink.parts.service.work.sweep_tasks import export_sweep, pack_robot, sweep, sweep_columns, sweep_run
from twolink.parts.service.work.worker import Ask, Report
from twolink.parts.sweeps.design import quantities as quantities_of
from twolink.simulation.sensitivities import sensitivities

if TYPE_CHECKING:
    from twolink.simulation.stepwise import State

PULL = 12.0  # rad/s: how quickly a link follows what drags it, critically damped
SINGULAR = 1e-3  # of the largest: directions in which the link moves less than that are not pulled
_NUMBER_BYTES = 20  # of a number as JSON
_SHOWN = 2000  # samples of residuals in a record


def live(*, body: bytes, robots: str, ask: Ask) -> None:
    """Solve a scene step by step. body: a LiveRequest. ask: shows a frame, and returns the answer, `LiveWords`.

    The first frame has the names of the links. A message that does not fit is a problem in the next frame, and what
    acted before goes on.
    """
    from twolink.simulation.stepwise import Simulation  # workers start without what few tasks need

    request = decode_unique(body, LiveRequest)
    scene = scene_of(request.scene, robots)
    sim, heard, words = Simulation(scene, accuracy=request.accuracy), LiveWords(), LiveWords()
    more: dict[str, Any] = {"links": list(scene.robot.frame_names)}
    while not heard.end:
        state = sim.state
        shown = {"t": state.t, "q": state.q.tolist(), "v": state.v.tolist(), **more,
                 "poses": link_poses(scene.robot, state.q).tolist()}  # fmt: skip
        said, more = msgspec.convert(ask(shown), LiveWords), {}
        if said != heard:
            heard = said
            try:
                torques(scene.robot, state, said)
                words = said
            except TwolinkError as error:
                more = {"problem": msgspec.to_builtins(problem_of(error))}
        sim.step(1.0 / request.frames_per_second, torques(scene.robot, state, words))


def torques(robot: Robot, state: "State", said: LiveWords) -> np.ndarray:
    """The torques (nv,) of a message: those that it gives, and J' F of a spring that drags a point of a link.

        F = L (w^2 d - 2 w p'),   L = (J M^-1 J')^-1,   d = to - p, of length |J| at most

    L is the mass that the point shows (Khatib 1987, IEEE Journal on Robotics and Automation 3(1), 43-53). |J| is how
    far the point moves by a radian: what is farther would turn a point beside an axis more stiffly than frames follow.

    Raises QueryError where names or sizes do not fit.
    """
    from twolink.simulation.stepwise import one

    tau = np.zeros(robot.nv) if said.tau is None else one("tau", said.tau, robot.nv)
    if said.drag is None:
        return tau
    rotation, position = robot.frame_pose(state.q, said.drag.link)
    arm = rotation @ np.array(said.drag.point)
    linear, turning = np.split(robot.frame_jacobian(state.q, said.drag.link), 2)
    jacobian = linear + np.cross(turning, arm[:, None], axis=0)
    mobility = jacobian @ np.linalg.solve(robot.mass_matrix(state.q), jacobian.T)
    away, reach = np.array(said.drag.to) - position - arm, float(np.linalg.norm(jacobian, 2))
    if (size := float(np.linalg.norm(away))) > reach:
        away *= reach / size
    wanted = PULL**2 * away - 2.0 * PULL * jacobian @ state.v
    return np.asarray(tau + jacobian.T @ np.linalg.pinv(mobility, rcond=SINGULAR, hermitian=True) @ wanted)


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
    return encode(found.to_dict())


def sense(*, body: bytes, robots: str, quotas: Quotas, report: Report) -> dict[str, Any]:
    """Derivatives of a motion, as a record. body: a request for sensitivities. Its result is all in the record."""
    asked = allowed(job_request("sensitivity", body), robots, quotas)
    found = sensitivities(**asked, progress=progress_of(2, report))
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

    request = job_request("identification", body)
    robot = robot_by_id(request.robot, robots)
    samples = measurements_of(robot, parse_csv(request.data, "data", QueryError), "data")
    found = identify_robot(robot, **samples, **arguments_of(request, "robot", "data"))
    kept = np.unique(np.linspace(0, len(found.t) - 1, min(len(found.t), _SHOWN)).round().astype(int))
    curves = {"t": found.t, "residuals": found.residuals, "tau": found.torques}
    curves = {name: values[kept].tolist() for name, values in curves.items()}
    return {"title": f"{robot.name}: identification", **found.to_dict(), "curves": curves}


_ABOUT_ROBOTS = (receive, load, draw, robot_scene)
_ABOUT_SCENES = (validate, scene_visuals, explain, preview, quantities, linearize, live)
_JOBS = (prepare, pack_robot, simulate, study, sense, identify, sweep, operate)
_RESULTS = (export, motion, export_sweep, sweep_columns, sweep_run)
TASKS = {task.__name__: task for task in (*_ABOUT_ROBOTS, *_ABOUT_SCENES, *_JOBS, *_RESULTS)}
