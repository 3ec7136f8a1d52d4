"""twolink.simulation.scene_run, by its public call alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

import twolink as tl
from twolink.errors import TwolinkError

from .problem import Accelerations, Answer, Contestant, Problem, RefusedError, Rung

PLAIN, VERIFIED = "twolink", "twolink, verified"
SAMPLES = 200  # a second, the default: all of them are computed within the time that is measured


def accelerations(problem: Problem) -> Accelerations:
    """The compiled forward dynamics, for the check against pin.aba."""
    robot, still = problem.scene.robot, np.zeros(problem.model.nv)
    return lambda q, v: np.asarray(robot.forward_dynamics(q, v, still, engine="compiled"))


def contestants(problem: Problem, accuracies: list[float]) -> Iterator[Contestant]:
    """Without and with the second solution behind the error bar."""
    for name, verify in ((PLAIN, False), (VERIFIED, True)):
        yield Contestant(name, [Rung(f"accuracy {a:.0e}", _run(problem, a, verify)) for a in accuracies])


def _run(problem: Problem, accuracy: float, verify: bool) -> Callable[[], Answer]:
    wanted = np.round(problem.times * SAMPLES).astype(int)

    def run() -> Answer:
        try:
            got = tl.simulate(problem.scene, problem.duration, accuracy=accuracy, method="auto", verify=verify)
        except TwolinkError as error:
            raise RefusedError(str(error).split("\n")[0]) from None
        if np.abs(got.t[wanted] - problem.times).max() > 1e-12:
            raise RefusedError("the samples are not at the common times")
        return Answer(got.q[wanted], getattr(got.cost, "evaluations", None))

    return run
