"""Dynamics queries answered by Pinocchio: one state at a time, or rows of states.

Each query has Pinocchio's algorithm for one state (`Algorithm`). `answer` checks the arguments, broadcasts the
batch, calls the algorithm for every row, and refuses a result that is not finite.
"""

import itertools
import math
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from twolink.algorithms.functions import frame_index
from twolink.algorithms.references import symmetric
from twolink.dynamics.arguments import (
    Applied,
    FExt,
    array,
    batch_shape,
    configuration,
    joint_forces,
    one_of,
    read_wrenches,
    rows,
)
from twolink.dynamics.queries import ALGORITHMS, Algorithm, Array
from twolink.dynamics.threads import is_forked_child, thread_count
from twolink.errors import QueryError
from twolink.robots.checks import mass_matrix_by_columns
from twolink.robots.model import RobotModel

PARALLEL_FROM = 64
"""States from which Pinocchio's parallel loops are used: below, starting threads costs more than it saves
(scripts/benchmarks/queries.py). The choice depends on nothing else, since the parallel loops round differently."""

THREADS_FROM = 10_000
"""States times nv from which these loops use threads: 2 ms of work. OpenMP's threads turn idly for 4 ms after a call,
and where other programs use the cores, the caller may wait as long for them. OMP_WAIT_POLICY=PASSIVE, set before
Pinocchio is imported, lets them sleep instead."""

_local = threading.local()


def query_of(robot: RobotModel, name: str) -> Algorithm:
    """The algorithm of a query by name, of a frame as in "frame_pose:tip", with the robot's sizes.

    Raises QueryError for an unknown frame, or where Pinocchio has no algorithm for mimic joints.
    """
    kind, colon, frame = name.partition(":")
    algorithm = ALGORITHMS[kind]
    one = partial(algorithm.one, frame_index(robot.model, frame)) if colon else algorithm.one
    if robot.has_mimic and isinstance(algorithm.mimic, str):
        what = f"{kind.replace('_', ' ')} is not available for mimic joints"
        raise QueryError(what, where="robot", remedy=algorithm.mimic, code="mimic-joints")
    if robot.has_mimic and callable(algorithm.mimic):
        one = algorithm.mimic
    if algorithm.anywhere:
        one = partial(_at_origin, robot, one)
    return replace(algorithm, one=one, shape=tuple(robot.nv if n == "nv" else n for n in algorithm.shape))


def _at_origin(
    robot: RobotModel, one: Callable[..., Array], model: pin.Model, data: pin.Data, q: Array, *others: Array
) -> Array:
    """The answer of an algorithm that works in the world's axes, where it does not depend on where bases are."""
    return one(model, data, robot.with_bases_at_origin(q), *others)


def answer(
    robot: RobotModel, query: Algorithm, arguments: tuple[ArrayLike, ...], f_ext: FExt | None = None, method: str = ""
) -> Array:
    """The answer (..., *shape) for checked and broadcast arguments.

    method: of forward dynamics, "crba" for the mass matrix, the bias and a linear solve.
    """
    states = {"q": configuration("q", arguments[0], robot.nq, robot.joints)}
    states |= {name: array(name, x, robot.nv) for name, x in zip(query.arguments[1:], arguments[1:], strict=True)}
    applied = read_wrenches(robot.model, f_ext) if f_ext is not None else []
    batch = batch_shape(**states, **{f"f_ext[{i}]": w.value for i, w in enumerate(applied)})
    columns = [rows(x, batch) for x in states.values()]
    applied = [replace(w, value=rows(w.value, batch)) for w in applied]
    if method == "crba":
        result = _forward_by_matrix(robot, columns, applied)
    else:
        result = answer_rows(robot, query, columns, applied)
    return require_finite(result, batch, query.shape, robot.name).reshape(*batch, *query.shape)


def by_name(robot: RobotModel, name: str, arguments: Mapping[str, ArrayLike]) -> Array:
    """The answer (..., *shape) to a query by name, as in "frame_pose:tip", with mimic joints or without.

    arguments: by name; "f_ext:FRAME" is a wrench along the frame's own axes.
    """
    forces = {x.removeprefix("f_ext:"): value for x, value in arguments.items() if x.startswith("f_ext:")}
    given = tuple(value for x, value in arguments.items() if not x.startswith("f_ext:"))
    method = "crba" if name == "forward_dynamics" and robot.has_mimic else ""
    return answer(robot, query_of(robot, name), given, forces or None, method)


def answer_rows(robot: RobotModel, query: Algorithm, states: list[Array], applied: list[Applied]) -> Array:
    """The answers (n, *shape) for C-ordered rows (n, nq), (n, nv), ... and wrenches with values (n, 6)."""
    if not robot.is_whole and query.join and not applied:
        return query.join(_answers_of_trees(robot, query, states))
    count, model, data = len(states[0]), robot.model, robot.data
    if query.parallel and not applied and count >= PARALLEL_FROM:
        threads = 1 if count * model.nv < THREADS_FROM or is_forked_child() else thread_count()
        columns = np.empty((model.nv, count), order="F")
        states = [robot.with_bases_at_origin(states[0]), *states[1:]]  # abaInParallel works in the world's axes
        query.parallel(threads, _pool(model, threads), *(x.T for x in states), columns)
        return columns.T
    out = np.empty((count, *query.shape))
    for i, state in enumerate(zip(*states, strict=True)):
        if applied:
            wrenches = [replace(w, value=w.value[i]) for w in applied]
            state = (*state, joint_forces(model, data, state[0], wrenches))
        out[i] = query.one(model, data, *state)
    return out


def _answers_of_trees(robot: RobotModel, query: Algorithm, states: list[Array]) -> list[Array]:
    """The answers (n, *shape) for each tree."""
    parts, (q, *others) = [], states
    for tree, data in zip(robot.trees, robot.tree_data, strict=True):
        rows_of_tree = zip(q[:, tree.q], *(x[:, tree.v] for x in others), strict=True)
        parts.append(np.array([query.one(tree.model, data, *row) for row in rows_of_tree]))  # copies of Pinocchio's
    return parts


def require_finite(result: Array, batch: tuple[int, ...], shape: tuple[int, ...], name: str) -> Array:
    """The result; raises QueryError that names the first state whose answer is not finite."""
    if not np.isfinite(result).all():
        row = int(np.argwhere(~np.isfinite(result.reshape(math.prod(batch), *shape)))[0][0])
        what = f"the result is not finite{f' for state {row} of the batch' if batch else ''}"
        remedy = "the values overflow, or the mass matrix is singular there"
        raise QueryError(what, where=f"robot {name!r}", remedy=remedy, code="not-finite")
    return result


def with_losses(robot: RobotModel, losses: bool, tau: Array, v: ArrayLike, damped: Sequence[str] = ()) -> Array:
    """tau + d v + f sign(v), (..., nv), with the damping d and the friction f of the robot's file; sign(0) = 0.

    damped: the joints whose damping is in tau already.
    Raises QueryError where `losses` is no bool, for mimic joints, or for a result that is not finite.
    """
    if not isinstance(losses, bool | np.bool_):
        raise QueryError(f"expected True or False, got {losses!r:.60}", argument="losses", remedy="losses=True")
    if not losses:
        return tau
    if robot.has_mimic:
        what = "the damping and friction of joints that follow others are not in the model"
        raise QueryError(what, argument="losses", remedy="load the robot with mimic=False", code="mimic-joints")
    speed, model, damping = array("v", v, robot.nv), robot.model, np.array(robot.model.damping)
    damping[[model.idx_vs[model.getJointId(joint)] for joint in damped]] = 0.0
    with np.errstate(over="ignore", invalid="ignore"):  # refused below
        result = tau + damping * speed + np.asarray(model.friction) * np.sign(speed)
    return require_finite(result, result.shape[:-1], (robot.nv,), robot.name)


def require_method(method: str, has_mimic: bool) -> None:
    """Raise QueryError unless forward dynamics has this method for the robot."""
    if one_of(("auto", "aba", "crba"), method, "method") == "aba" and has_mimic:
        what, remedy = '"aba" cannot follow mimic joints', 'leave it out, or use method="crba"'
        raise QueryError(what, argument="method", remedy=remedy, code="mimic-joints")


def _forward_by_matrix(robot: RobotModel, states: list[Array], applied: list[Applied]) -> Array:
    """a (n, nv) from M(q) a = tau - h(q, v) + J^T f_ext."""
    q, v, tau = states
    bias = answer_rows(robot, query_of(robot, "inverse_dynamics"), [q, v, np.zeros_like(v)], applied)
    inertia = answer_rows(robot, query_of(robot, "mass_matrix"), [q], [])
    try:
        return np.asarray(np.linalg.solve(inertia, (tau - bias)[..., None])[..., 0])
    except np.linalg.LinAlgError:
        what = "the mass matrix is singular there"
        raise QueryError(what, argument="q", remedy="change the configuration", code="singular") from None


def _pool(model: pin.Model, threads: int) -> pin.ModelPool:
    """This thread's pool for the model: a pool serves one caller at a time."""
    pools: dict[tuple[int, int], tuple[pin.Model, pin.ModelPool]] = _local.__dict__.setdefault("pools", {})
    key = (id(model), threads)
    if key not in pools or pools[key][0] is not model:
        if len(pools) >= 8:
            pools.clear()
        pools[key] = (model, pin.ModelPool(model, threads))
    return pools[key][1]


# Algorithms for one state that are more than one call of Pinocchio. Results are copies: Pinocchio returns views of
# its data.


def energies(model: pin.Model, data: pin.Data, q: Array, v: Array) -> Array:
    """v^T M v / 2, and the potential energy.

    Pinocchio 4.1's computeKineticEnergy leaves out the armature of revolute joints with skew axes.
    """
    kinetic = v.dot(pin.crba(model, data, q).dot(v)) / 2
    return np.array([kinetic, pin.computePotentialEnergy(model, data, q)])


def centre_of_mass(model: pin.Model, data: pin.Data, q: Array) -> Array:
    return np.array(pin.centerOfMass(model, data, q, False))


def momentum(model: pin.Model, data: pin.Data, q: Array, v: Array) -> Array:
    return np.array(pin.computeCentroidalMomentum(model, data, q, v).vector)


def forward_derivatives(model: pin.Model, data: pin.Data, q: Array, v: Array, tau: Array) -> Array:
    pin.computeABADerivatives(model, data, q, v, tau)
    return np.stack([data.ddq_dq, data.ddq_dv, symmetric(data.Minv)])


def inverse_derivatives(model: pin.Model, data: pin.Data, q: Array, v: Array, a: Array) -> Array:
    by_q, by_v, by_a = pin.computeRNEADerivatives(model, data, q, v, a)
    return np.stack([by_q, by_v, symmetric(by_a)])


def frame_pose(index: int, model: pin.Model, data: pin.Data, q: Array) -> Array:
    pin.forwardKinematics(model, data, q)
    pose = pin.updateFramePlacement(model, data, index)
    return np.concatenate([pose.rotation.ravel(), pose.translation])


def by_axes(algorithm: Callable[..., Array]) -> dict[str, Callable[..., Array]]:
    """An algorithm that takes Pinocchio's axes first, by the names of the axes."""
    axes = {"local": pin.ReferenceFrame.LOCAL, "aligned": pin.ReferenceFrame.LOCAL_WORLD_ALIGNED}
    return {name: partial(algorithm, each) for name, each in axes.items()}


def frame_velocity(axes: pin.ReferenceFrame, index: int, model: pin.Model, data: pin.Data, q: Array, v: Array) -> Array:
    pin.forwardKinematics(model, data, q, v)
    return np.array(pin.getFrameVelocity(model, data, index, axes).vector)


def frame_jacobian(axes: pin.ReferenceFrame, index: int, model: pin.Model, data: pin.Data, q: Array) -> Array:
    # Pinocchio returns a matrix of one column as (6,).
    return np.asarray(pin.computeFrameJacobian(model, data, q, index, axes)).reshape(6, model.nv)


def energies_with_mimic(model: pin.Model, data: pin.Data, q: Array, v: Array) -> Array:
    """Kinetic and potential energy; Pinocchio 4.1 has none where joints mimic others."""
    kinetic = v @ mass_matrix_by_columns(model, data, q) @ v / 2
    mass = sum(body.mass for body in list(model.inertias)[1:])  # what is fixed to the world does not count
    return np.array([kinetic, -mass * (model.gravity.linear @ pin.centerOfMass(model, data, q, False))])


def shows_all(robot: RobotModel, known: dict[str, bool], name: str) -> bool:
    """True if Pinocchio's answer is not finite wherever an entry of the state is not; looked at once, kept in `known`.

    Then a look at the answer is one at the state: a sum takes longer than a third of the query. What is not a number
    stays so through sums and products; but a torque may not depend on the speed of a slider.
    """
    if name not in known:
        plain = not robot.weightless and not robot.has_mimic and robot.is_whole
        query = ALGORITHMS.get(name)
        known[name] = plain and query is not None and query.shape == ("nv",) and _shows_entries(robot, query)
    return known[name]


def _shows_entries(robot: RobotModel, query: Algorithm) -> bool:
    """Entry by entry, at a state like any other."""
    random = np.random.default_rng(0)
    q = pin.integrate(robot.model, pin.neutral(robot.model), random.uniform(-1.0, 1.0, robot.nv))
    state = [q, *random.uniform(-1.0, 1.0, (2, robot.nv))][: len(query.arguments)]
    for place, values in enumerate(state):
        for i, value in itertools.product(range(len(values)), (math.nan, math.inf, -math.inf)):
            changed = [x.copy() for x in state]
            changed[place][i] = value
            if math.isfinite(sum(query.one(robot.model, robot.data, *changed).tolist())):
                return False
    return True
