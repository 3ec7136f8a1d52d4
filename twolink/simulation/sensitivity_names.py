"""The names by which sensitivities are asked for, and the derivatives of the start by what they name."""

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np

from twolink.algorithms.dual_numbers import derivative
from twolink.dynamics.arguments import texts
from twolink.effects.loops import Loop
from twolink.errors import SceneError
from twolink.integrate.derivatives.parameter_variation import ParameterVariation
from twolink.integrate.motion.assembly import RANK, assembled
from twolink.integrate.motion.constraints import Constraints
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.scene_equations import decides_states, equations_of, with_starting_states
from twolink.scenes import Scene
from twolink.scenes.parameters import PREFIX, named_parameters, part_of

STEP = 1e-3  # of differences of closed positions, whose error is its fourth power
CLOSED = 1e-9  # rad, m, per second: a start that was moved by less was closed


@dataclass(frozen=True, eq=False)
class Wanted:
    """Sensitivities asked for: the quantities to differentiate by, with their columns.

    variation: of the scene, by the parameters among it. columns: of each name, the columns that it has. start
    (tangent + p, k): the derivatives of the start by each column, and of the parameters.
    """

    variation: ParameterVariation
    columns: dict[str, slice]
    start: np.ndarray

    @property
    def values(self) -> dict[str, float]:
        """The values of the parameters."""
        return dict(zip(self.variation.names, self.variation.values, strict=True))


def wanted_of(scene: Scene, wrt: Sequence[str]) -> Wanted:
    """Sensitivities that the names ask for. Raises SceneError: codes "unknown-parameter", "sensitivity-undefined"."""
    names = list(dict.fromkeys(texts(wrt, "wrt", SceneError, 'such as ["q", "v"]')))
    if not names:
        raise SceneError("it names nothing", argument="wrt", remedy='such as ["q", "v"]')
    nv, equations, of_state = scene.robot.nv, equations_of(scene), _of_state(scene)
    equations.require_motion()
    parameters = tuple(name for name in names if name not in of_state)
    for parameter in named_parameters(scene, parameters, "wrt", of_state):
        if parameter.kind not in ("constant", "effect") or not math.isfinite(parameter.nominal):
            raise SceneError(f"there are no derivatives by {parameter.name!r}: {parameter.about}", argument="wrt",
                             remedy="ask for another number", code="sensitivity-undefined")  # fmt: skip
        if not parameter.nominal and decides_states(scene, parameter.name):
            raise SceneError(f"{parameter.name!r} is 0: the state that it is the gain or the time of is left out",
                             argument="wrt", code="sensitivity-undefined", remedy="give it some value")  # fmt: skip
    if equations.constraints is not None and any(_closes(scene, name) for name in parameters):
        raise SceneError("a length changes how loops close, which sensitivities do not follow yet", argument="wrt",
                         remedy="ask for masses or the initial state", code="sensitivities-lengths")  # fmt: skip
    tangent = equations.space.tangent
    rows = tangent + len(parameters)
    columns, entries = {}, list[int]()
    for name in names:
        own = of_state.get(name) or [tangent + parameters.index(name)]
        columns[name] = slice(len(entries), len(entries) + len(own))
        entries += own
    start = np.eye(rows)[:, entries]
    if equations.constraints is not None:
        start[: 2 * nv] = _assembled_along(scene, equations, start[: 2 * nv])
    variation = ParameterVariation(scene, parameters)
    if equations.space.states:
        start[2 * nv : tangent] = _begun_along(equations, variation, start)
    return Wanted(variation, columns, start)


def _begun_along(equations: Equations, variation: ParameterVariation, directions: np.ndarray) -> np.ndarray:
    """The derivatives (states, k) of what effects begin with, along directions (., k) of the start and parameters."""
    robot, space, x = equations.robot, equations.space, equations.start
    nv, q, v = space.nv, x[: space.nq], x[space.v_rows]

    def moved(direction: np.ndarray, k: float) -> np.ndarray:
        parameter = np.flatnonzero(direction[space.tangent :])
        step = k * (variation.step(int(parameter[0])) if parameter.size else STEP)
        there = np.concatenate([robot.integrate(q, step * direction[:nv]), v + step * direction[nv : 2 * nv]])
        own = variation.equations_beside(int(parameter[0]), k) if parameter.size else equations
        return with_starting_states(own, there)[space.z_rows]

    steps = [variation.step(int(np.argmax(d[space.tangent :]))) if d[space.tangent :].any() else STEP
             for d in directions.T]  # fmt: skip
    return np.array([derivative(functools.partial(moved, direction), step)
                     for direction, step in zip(directions.T, steps, strict=True)]).T  # fmt: skip


def _of_state(scene: Scene) -> dict[str, range]:
    """The rows of (q, v) that names of the initial state stand for."""
    nv = scene.robot.nv
    rows = {f"v.{joint.name}.{k}": range(nv + i, nv + i + 1) for joint in scene.robot.joints
            for k, i in enumerate(range(joint.v.start, joint.v.stop))}  # fmt: skip
    for joint in scene.robot.joints:
        rows[f"q.{joint.name}"] = range(joint.v.start, joint.v.stop)
        rows[f"v.{joint.name}"] = range(nv + joint.v.start, nv + joint.v.stop)
    return {"q": range(nv), "v": range(nv, 2 * nv), **rows}


def _closes(scene: Scene, name: str) -> bool:
    """True if a parameter changes the closure of loops."""
    if not name.startswith(PREFIX):
        return ".origin." in name
    _, place, *path = name.split(".")
    return isinstance(part_of(scene.effects[int(place)], path), Loop)


def _assembled_along(scene: Scene, equations: Equations, directions: np.ndarray) -> np.ndarray:
    """The derivatives (2 nv, k) of the start that closes the loops, along directions (2 nv, k) of the scene's state.

    From a closed start they are taken along what the loops allow: where loops have redundant rows, positions beside the
    closed ones do not tell where the nearest closed one is.
    """
    robot, nv, constraints = scene.robot, scene.robot.nv, cast("Constraints", equations.constraints)
    nq, start = robot.nq, equations.start[: equations.space.v_rows.stop]
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
