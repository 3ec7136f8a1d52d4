"""A live simulation: a scene solved step by step, at the pace of the service, and pulled by its clients."""

from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from twolink.dynamics import Robot
from twolink.dynamics.robot_record import link_poses
from twolink.errors import TwolinkError
from twolink.parts.service.problems import decode_unique, problem_of
from twolink.parts.service.work.requests import LiveRequest, LiveWords
from twolink.parts.service.work.scene_tasks import scene_of
from twolink.parts.service.work.worker import Ask

if TYPE_CHECKING:
    from twolink.simulation.stepwise import State

PULL = 12.0  # rad/s: how quickly a link follows what drags it, critically damped
SINGULAR = 1e-3  # of the largest: directions in which the link moves less than that are not pulled


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
