"""The names by which sensitivities are asked for, and the derivatives of the start by what they name."""

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np

from twolink.algorithms.mechanism import parameter_names
from twolink.effects.loops import Loop
from twolink.errors import SceneError, require_known
from twolink.integrate.assembly import RANK, assembled
from twolink.integrate.constraints import Constraints
from twolink.integrate.effect_numbers import PREFIX, all_effect_numbers
from twolink.integrate.equations import Equations
from twolink.integrate.neighbours import Neighbours, derivative
from twolink.integrate.scene_equations import equations_of
from twolink.scenes import Scene

STEP = 1e-3  # of differences of closed positions, whose error is its fourth power
CLOSED = 1e-9  # rad, m, per second: a start that was moved by less was closed


@dataclass(frozen=True, eq=False)
class Wanted:
    """What is asked for.

    neighbours: of the scene, by the parameters among it. columns: of each name, the columns that it has. start
    (2 nv + p, k): the derivatives of the start by each column, and of the parameters.
    """

    neighbours: Neighbours
    columns: dict[str, slice]
    start: np.ndarray

    @property
    def values(self) -> dict[str, float]:
        """The values of the parameters."""
        return dict(zip(self.neighbours.names, self.neighbours.values, strict=True))


def wanted_of(scene: Scene, wrt: Sequence[str]) -> Wanted:
    """What the names ask for. Raises SceneError for an unknown one, code "unknown-sensitivity"."""
    names = [wrt] if isinstance(wrt, str) else list(wrt)
    if not names:
        raise SceneError("it names nothing", argument="wrt", remedy='such as ["q", "v"]')
    nv, equations = scene.robot.nv, equations_of(scene)
    of_state = {"q": range(nv), "v": range(nv, 2 * nv)}
    for joint in scene.robot.joints:
        of_state[f"q.{joint.name}"] = range(joint.v.start, joint.v.stop)
        of_state[f"v.{joint.name}"] = range(nv + joint.v.start, nv + joint.v.stop)
    numbers = {name: value for name, value in all_effect_numbers(scene).items() if math.isfinite(value)}
    constants = (*parameter_names(equations.robot.model), *numbers)
    for name in names:
        require_known(name, (*of_state, *constants), SceneError, "there is nothing named {!r} to differentiate by",
                      argument="wrt", code="unknown-sensitivity")  # fmt: skip
    names = list(dict.fromkeys(names))
    parameters = tuple(name for name in names if name not in of_state)
    if equations.constraints is not None and any(_closes(scene, name) for name in parameters):
        raise SceneError("a length changes how loops close, which sensitivities do not follow yet", argument="wrt",
                         remedy="ask for masses or the initial state", code="sensitivities-lengths")  # fmt: skip
    rows = 2 * nv + len(parameters)
    columns, entries = {}, list[int]()
    for name in names:
        own = of_state.get(name) or [2 * nv + parameters.index(name)]
        columns[name] = slice(len(entries), len(entries) + len(own))
        entries += own
    start = np.eye(rows)[:, entries]
    if equations.constraints is not None:
        start[: 2 * nv] = _assembled_along(scene, equations, start[: 2 * nv])
    return Wanted(Neighbours(scene, parameters), columns, start)


def _closes(scene: Scene, name: str) -> bool:
    """Whether a parameter changes how loops close."""
    if not name.startswith(PREFIX):
        return ".origin." in name
    _, place, *path = name.split(".")
    effect = scene.effects[int(place)]
    return isinstance(effect, Loop) or (path[0] == "of" and isinstance(getattr(effect, "of", None), Loop))


def _assembled_along(scene: Scene, equations: Equations, directions: np.ndarray) -> np.ndarray:
    """The derivatives (2 nv, k) of the start that closes the loops, along directions (2 nv, k) of the scene's state.

    From a closed start they are taken along what the loops allow: where loops have redundant rows, positions beside the
    closed ones do not tell where the nearest closed one is.
    """
    robot, nv, constraints = scene.robot, scene.robot.nv, cast("Constraints", equations.constraints)
    nq, start = robot.nq, equations.start[: equations.moving]
    q, v = scene.q, scene.v
    if max(equations.assembled) <= CLOSED:
        q, v = start[:nq], start[nq:]
        rows = constraints.jacobian_at(q, constraints.all_rows)
        directions = directions.copy()
        directions[:nv] -= np.linalg.lstsq(rows, rows @ directions[:nv], rcond=RANK)[0]

    def moved(direction: np.ndarray, k: float) -> np.ndarray:
        step = k * STEP
        there = np.concatenate([robot.integrate(q, step * direction[:nv]), v + step * direction[nv:]])
        x = assembled(constraints, there)
        return np.concatenate([robot.difference(start[:nq], x[:nq]), x[nq:] - start[nq:]])

    out = [derivative(functools.partial(moved, direction), STEP) for direction in directions.T]
    return np.array(out).T.reshape(directions.shape)
