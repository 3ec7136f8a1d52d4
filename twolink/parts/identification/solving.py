"""From filtered runs to an identification: the linear system, what the data show of it, its solution, held-out runs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri, stdtrit

from twolink.dynamics import Robot
from twolink.errors import QueryError
from twolink.parts.identification.base_parameters import (
    BaseParameters,
    Selection,
    base_parameters,
    direction,
    not_shown,
    regressor,
    select,
    single_joints,
)
from twolink.parts.identification.filtering import Filter, Recording, choose, require_samples
from twolink.parts.identification.joint_models import explaining, joint_terms
from twolink.parts.identification.measurements import Measurements, filtered, linear_system, require_enough, wider
from twolink.parts.identification.model_errors import model_errors
from twolink.parts.identification.regression import Fit, fit
from twolink.parts.identification.result import Identification, Validation
from twolink.parts.identification.setup import Setup, derivatives, names_of

_SHORTEST = 0.1  # m: of the links of a robot whose joints are at one place
_STILL = 2.0  # times its filter's error: a joint's q, v or a below it does not move
_OPPOSITE = -0.8  # correlation with the torques of the robot as it was given
_RESTS = 0.5  # of a block's samples: it belongs to a rest
_ROUNDS, _STEPS, _CLOSE = 2, 15, 0.1  # of the filter and of the setup; standard errors of a step that ends the search
_ANY_TILT = 0.1  # rad: gravity that is not known to be along an axis shows more parameters
_LARGEST_STEP = 1.0  # of the logarithm of a motor constant
_FEWEST = 3  # degrees of freedom of a covariance
_RUNS = 8  # so many runs tell the covariance from run to run, fewer are cut in blocks


@dataclass(frozen=True)
class IdentificationPlan:
    """The plan of an identification: runs, what is looked for, and how. possible: what some motion can show of it."""

    robot: Robot
    runs: Sequence[Recording]
    chosen: Selection
    possible: BaseParameters
    method: str
    confidence: float
    half_window: int | None

    def filter_of(self, setup: Setup) -> Filter | None:
        """The window that is given, or that suits the data; None where accelerations were measured."""
        if self.runs[0].a is not None:
            return None
        corrected = [setup.corrected(run) for run in self.runs]
        return choose(self.robot, corrected, explaining(setup.true_robot, corrected, self.chosen), self.half_window)


def plan_of(
    setup: Setup, runs: Sequence[Recording], chosen: Selection, method: str, confidence: float, half: int | None
) -> IdentificationPlan:
    """A plan. Raises QueryError where no motion can show what is looked for."""
    robot = setup.robot
    base = base_parameters(replace(setup, values=setup.values + _ANY_TILT).true_robot, chosen)
    if not base.members:
        what = f"no joint torque depends on {', '.join(chosen.names[:6])}"
        remedy = "look for other parameters: `base_parameters(robot)` lists what can be told"
        raise QueryError(what, argument="parameters", remedy=remedy, code="nothing-identifiable")
    return IdentificationPlan(robot, runs, chosen, base, method, confidence, half)


@dataclass(frozen=True)
class SolvedIdentification:
    """An identification, and what it was solved from: samples, columns of G, the fit, residuals by a wider window."""

    result: Identification
    data: Measurements
    columns: np.ndarray
    fit: Fit
    wide: np.ndarray | None
    sure: np.ndarray


def solve(plan: IdentificationPlan, setup: Setup, by: Filter | None) -> Identification:
    """The solution, with the model errors that its residuals show; the setup by Gauss-Newton's steps.

    Raises
    ------
    QueryError
        Codes "too-few-samples", "nothing-identifiable", "no-torques", "units", "not-converged".
    """
    found = _solved(plan, setup, by, None)
    setup = _with_constants(setup, found)
    for number in range(_ROUNDS if setup.names else 0):
        by = plan.filter_of(setup) if number else by
        for _ in range(_STEPS):
            found = _solved(plan, setup, by, found.result)
            change, setup = np.abs(found.result.setup.values - setup.values), found.result.setup
            if np.all(change <= _CLOSE * _errors_of(found.result)):
                break
        else:
            raise QueryError(f"{', '.join(setup.names)} did not settle in {_STEPS} steps", argument="find",
                             remedy="look for less of the setup, or hold parameters that act alike",
                             code="not-converged")  # fmt: skip
    return _examined(plan, found)


def _with_constants(setup: Setup, first: SolvedIdentification) -> Setup:
    """The setup with motor constants that take what was measured to the torques of the robot as it was given."""
    data, nominal = first.data, _nominal(setup.robot, first.data)
    ratio = np.sum(nominal * data.tau, axis=0) / np.maximum(np.sum(data.tau**2, axis=0), 1e-300)
    starts = [ratio[setup.dof(name)] if name.endswith(".motor_constant") else 0.0 for name in setup.names]
    return replace(setup, values=np.where(np.array(starts) > 0, starts, setup.values))


def _nominal(robot: Robot, data: Measurements) -> np.ndarray:
    """The torques (n, nv) of the robot as it was given."""
    return np.concatenate([regressor(robot, *state, np.zeros(1)) @ robot.parameter_values for state in data.states()])


def _errors_of(result: Identification) -> np.ndarray:
    """Standard errors of the setup's values; infinite where they cannot be told."""
    leads = {text.partition(" ")[0]: error for text, error in result.standard_errors.items()}
    return np.array([leads.get(name, np.inf) for name in result.setup.names])


def _solved(
    plan: IdentificationPlan, setup: Setup, by: Filter | None, around: Identification | None
) -> SolvedIdentification:
    """Linear least squares at a setup. around: what the derivatives by the setup are taken at; None leaves them out."""
    robot, names = setup.true_robot, () if around is None else setup.names
    chosen = plan.chosen.beside(names, setup.values[: len(names)])
    data = filtered(robot, [setup.corrected(run) for run in plan.runs], by)
    slopes = _slopes(around, names, data)
    known = slopes @ setup.values[: len(names)]
    columns, y = linear_system(robot, plan.chosen, data)
    columns, y = np.concatenate([columns, slopes], axis=-1), y + known
    base = _excited(plan, robot, names, data, columns)
    members = list(base.members)
    columns, prior = columns[..., members], _prior(robot, chosen, base)
    require_enough(robot, columns * chosen.nominal[members], y, data)
    ends = data.block_ends
    blocks = ends if len(ends) >= _RUNS else None
    rest = _rest(robot, chosen, base, data)
    if data.coarse is None:
        found = fit(columns, y, plan.method, prior=prior, blocks=blocks, runs=ends, rest=rest)
        wide, numerical = None, found.rounding
    else:
        other, torques = linear_system(robot, plan.chosen, data.coarse)
        other, torques = np.concatenate([other, slopes], axis=-1)[..., members], torques + known
        errors = np.concatenate([other - columns, (torques - y)[..., None]], axis=-1)
        found = fit(columns, y, plan.method, errors, prior=prior, blocks=blocks, runs=ends, rest=rest)
        second = fit(other, torques, plan.method, errors, prior=prior, rest=rest)
        wide, numerical = second.residuals, found.rounding + np.abs(second.x - found.x)
    half_width = _half_width(plan, y, found, by is None and blocks is None) + numerical
    told = half_width / ndtri((1 + plan.confidence) / 2) / np.maximum(np.sqrt(np.diag(found.metric)), 1e-300)
    loose = np.sqrt(np.maximum(told, 1.0))
    result = Identification(
        robot=plan.robot, selection=chosen, combinations=base.combinations, matrix=base.matrix, estimate=found.x,
        covariance=found.covariance, numerical_error=numerical, confidence=plan.confidence,
        half_width=half_width,
        not_identifiable=(*plan.possible.not_identifiable(), *_untold(base, names)),
        not_excited=not_shown(plan.possible, base), noise=found.noise, t=data.averaged(data.t),
        residuals=found.residuals, condition=found.condition, correlated=found.correlated, method=plan.method,
        filter=by, metric=found.metric * np.outer(loose, loose), torques=data.averaged(data.tau),
        setup=replace(setup, values=_values(chosen, base, found.x, len(names))) if names else setup,
        block_covariance=found.by_blocks, mirrored=np.zeros(robot.nv, dtype=bool),
    )  # fmt: skip
    return SolvedIdentification(result, data, columns, found, wide, prior[1])


def _rest(
    robot: Robot, chosen: Selection, base: BaseParameters, data: Measurements
) -> tuple[np.ndarray, np.ndarray] | None:
    """Samples (blocks, nv) at rest in a row, and what of the parameters adds up to the friction there (nv, r).

    Where a joint rests, its friction is anything within its size: a bound, once for as long as it lasts.
    """
    sizes = np.zeros((robot.nv, len(base.members)))
    joints, rubbing = single_joints(robot), chosen.rubbing
    for k, name in enumerate(chosen.names[member] for member in base.members):
        if name in rubbing:
            sizes[joints[rubbing[name]], k] = 1.0
    still = data.averaged(1 - direction(data.v, data.width) ** 2)
    long = np.empty_like(still)
    for column, out in zip(still.T, long.T, strict=True):
        cuts = np.flatnonzero(np.diff(column > _RESTS)) + 1
        for rows in np.split(np.arange(len(column)), cuts):
            out[rows] = column[rows] * max(column[rows].sum(), 1.0) if column[rows[0]] > _RESTS else column[rows] ** 2
    return (long, sizes) if sizes.any() and long.any() else None


def _half_width(plan: IdentificationPlan, y: np.ndarray, found: Fit, whole: bool) -> np.ndarray:
    """Of the intervals: the widest by the residuals' memory, by what drifts, and by what blocks of time change.

    Blocks show what the model lacks, which no residual tells from noise where the motion hardly shows a parameter. They
    count unless the whole of the samples, neither filtered nor runs, has white residuals.
    """
    level = (1 + plan.confidence) / 2
    free = y.size - len(found.x) if found.length == 0 else max(len(y) / (2 * found.length), _FEWEST)
    width = stdtrit(free, level) * np.sqrt(np.diag(found.covariance))
    if found.slow is not None:
        width = np.maximum(width, stdtrit(found.slow[1], level) * np.sqrt(found.slow[0]))
    if not whole or found.correlated:
        width = np.maximum(width, stdtrit(found.blocks - 1, level) * np.sqrt(np.diag(found.by_blocks)))
    return np.asarray(width)


def _slopes(around: Identification | None, names: Sequence[str], data: Measurements) -> np.ndarray:
    """Derivatives (blocks, nv, m) of the torques by what is looked for of the setup.

    They are those of the estimate itself: bodies that can exist, but do not fit, would give steps that end elsewhere.
    """
    if around is None or not names:
        return np.zeros((len(data.averaged(data.t)), data.tau.shape[1], 0))
    near = around.consistency
    theta = np.array(list(near.parameters.values()))
    theta = theta + np.linalg.pinv(around.matrix) @ (around.estimate - around.matrix @ theta)
    own = dict(zip(near.parameters, theta.tolist(), strict=True))
    exact = replace(near, parameters=own, vector=around.selection.parameters(around.robot, theta))
    torques = np.concatenate([around.model_torques(*state, exact) for state in data.states()])
    return data.averaged(derivatives(around.setup, exact.vector, names, data, torques))


def _values(chosen: Selection, base: BaseParameters, x: np.ndarray, count: int) -> np.ndarray:
    """The setup's values (m,): what cannot be told keeps its own."""
    theta = chosen.nominal.copy()
    for row, member, value in zip(base.matrix, base.members, x, strict=True):
        step = value - row @ chosen.nominal
        if chosen.names[member].endswith(".motor_constant"):
            theta[member] *= np.exp(np.clip(step / theta[member], -_LARGEST_STEP, _LARGEST_STEP))
        elif member >= len(theta) - count:
            theta[member] += step
    return theta[len(theta) - count :]


def _untold(base: BaseParameters, names: Sequence[str]) -> tuple[str, ...]:
    """Quantities of a setup that cannot be told, in words."""
    own = base.matrix[:, len(base.names) - len(names) :]
    alone = [f"{name}: no torque depends on it" for name, column in zip(names, own.T, strict=True) if not column.any()]
    mixed = [np.any(part) and np.count_nonzero(row) > 1 for part, row in zip(own, base.matrix, strict=True)]
    return (*alone, *(f"only the sum {text}" for text, here in zip(base.combinations, mixed, strict=True) if here))


def _examined(plan: IdentificationPlan, found: SolvedIdentification) -> Identification:
    """The identification with the model errors that its residuals show."""
    result, data = found.result, found.data
    every = select(plan.robot, ["*"], terms=joint_terms(plan.robot, ["offset", "stribeck"])[1])
    left = every.without(plan.chosen.names)
    setup = [name for name in names_of(plan.robot) if name not in result.setup.names]
    of_setup = _slopes(result, setup, data)
    tried = np.concatenate([linear_system(result.setup.true_robot, left, data)[0], of_setup], axis=-1)
    errors = model_errors((*left.names, *setup), tried, found.columns, result.combinations, found.fit, found.wide,
                          found.sure, result.torques)  # fmt: skip
    nominal = _nominal(plan.robot, data)
    alike = np.sum(nominal * data.tau, axis=0)
    alike = alike / np.maximum(np.linalg.norm(nominal, axis=0) * np.linalg.norm(data.tau, axis=0), 1e-300)
    return replace(result, model_errors=errors, mirrored=alike < _OPPOSITE)


def _prior(robot: Robot, chosen: Selection, base: BaseParameters) -> tuple[np.ndarray, np.ndarray]:
    """The URDF's base parameters (r,), and the reciprocals of their standard deviations: 10 times the links' sizes.

    So wide a ridge moves only what the data hardly show. Friction, damping and armature have none: 0.
    """
    model = robot.model
    bodies, sizes = 10 * (model.njoints - 1), np.zeros(len(robot.parameter_names))
    length = max((float(np.linalg.norm(place.translation)) for place in list(model.jointPlacements)[1:]), default=0.0)
    length = max(length, _SHORTEST)
    masses = np.maximum([body.mass for body in list(model.inertias)[1:]], robot.mass / model.njoints)
    sizes[:bodies] = np.outer(masses, [1.0, *[length] * 3, *[length**2] * 6]).ravel()
    of_names = np.abs(chosen.columns[:bodies].T) @ sizes[:bodies]
    of_names[np.any(chosen.columns[bodies:], axis=0)] = np.inf
    with np.errstate(invalid="ignore"):
        spread = 10 * np.nansum(np.abs(base.matrix) * of_names, axis=1)
    return base.matrix @ chosen.nominal, np.divide(1.0, spread, out=np.zeros_like(spread), where=spread > 0)


def validation(found: Identification, held_out: Sequence[Recording]) -> Validation:
    """Torques of other runs, by the same filter, less their prediction."""
    if found.filter is not None:
        for run in held_out:
            require_samples(len(run.t), wider(found.filter.half_window))
        held_out = [replace(run, a=None) for run in held_out]
    elif any(run.a is None for run in held_out):
        raise QueryError("the runs that were identified have accelerations, these have not", argument="validate",
                         code="column-missing", remedy="give q, v and a")  # fmt: skip
    data = filtered(found.robot, [found.setup.corrected(run) for run in held_out], found.filter)
    predicted = np.concatenate([found.model_torques(*state) for state in data.states()])
    tau, predicted = data.averaged(data.tau), data.averaged(predicted)
    return Validation(data.averaged(data.t), tau, tau - predicted)


def _excited(
    plan: IdentificationPlan, robot: Robot, names: tuple[str, ...], data: Measurements, columns: np.ndarray
) -> BaseParameters:
    """Base parameters and setup that this motion shows: its null space without what only noise moves."""
    if (calm := _without_noise(robot, data)) is not None:
        own = linear_system(robot, plan.chosen, calm)[0]
        columns = np.concatenate([own, columns[..., own.shape[-1] :]], axis=-1)
    whole = plan.possible.beside(names)
    return whole.within(columns[..., list(whole.members)].reshape(-1, len(whole.members)))


def _without_noise(robot: Robot, data: Measurements) -> Measurements | None:
    """The samples with rest in the place of each q, v and a that its filter's error explains; None where none is.

    A position at rest is rounded to its error, so that a link that hangs straight shows no more than it does there.
    """
    if data.coarse is None:
        return None
    angles = np.asarray(robot.difference(np.broadcast_to(robot.neutral, data.q.shape), data.q))
    pairs = [(angles, np.asarray(robot.difference(data.coarse.q, data.q)))]
    pairs += [(x, x - other) for x, other in ((data.v, data.coarse.v), (data.a, data.coarse.a))]
    errors = [_STILL * np.sqrt(np.mean(error**2, axis=0)) for _, error in pairs]
    still = [x.std(axis=0) <= error for (x, _), error in zip(pairs, errors, strict=True)]
    if not np.any(still):
        return None
    step = np.maximum(errors[0], 1e-300)
    move = np.where(still[0], np.round(angles.mean(axis=0) / step) * step - angles, 0.0)
    v, a = (np.where(rest, 0.0, x) for rest, x in zip(still[1:], (data.v, data.a), strict=True))
    return replace(data, q=np.asarray(robot.integrate(data.q, move)), v=v, a=a, coarse=None)
