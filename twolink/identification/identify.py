"""identify: parameters of a robot from measured positions and joint torques."""

import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import stdtrit

from twolink.dynamics import Robot
from twolink.dynamics.arguments import one_of, positive
from twolink.errors import QueryError
from twolink.identification.base_parameters import BaseParameters, Selection, base_parameters, independent, select
from twolink.identification.filtering import (
    SMALLEST,
    Filter,
    Recording,
    States,
    System,
    choose,
    half_window_of,
    left_out,
    require_samples,
    states,
)
from twolink.identification.measurements import Measurements, beyond_reach, filtered, recordings, wider
from twolink.identification.regression import METHODS, fit
from twolink.identification.result import Identification, Validation

_SHORTEST = 0.1  # m: of the links of a robot whose joints are at one place
_LARGEST = 1e100  # of torques and of the regressor: squares and their ratios stay within the range of doubles


def identify(
    robot: Robot, t: Any, q: ArrayLike | None = None, v: ArrayLike | None = None, tau: ArrayLike | None = None,
    parameters: Sequence[str] | None = None, *, a: ArrayLike | None = None, method: str = "weighted",
    half_window: int | None = None, cutoff: float | None = None, confidence: float = 0.95, validate: Any = None,
) -> Identification:  # fmt: skip
    """Find parameters pi in tau = Y(q, v, a) pi from measurements, with intervals, and name what cannot be found.

    Parameters
    ----------
    robot : Robot
        The robot. Parameters that are not looked for keep its values; damping and friction are then 0.
    t : array_like, (n,), or runs
        Increasing times, s. Or, without q, v, tau and a, a run or a list of runs: tables of columns or of whole
        arrays, DataFrames, or files, as `twolink identify` takes them. A column `run` tells the runs of a table apart.
    q : array_like, (n, nq)
        Configurations, rad or m.
    v : array_like, (n, nv), or None
        Velocities, rad/s or m/s. Without a, positions and velocities are filtered and differentiated by local
        polynomials of degree 4 (Savitzky and Golay), the samples near the ends of each run are left out, and torques
        and the regressor's columns are averaged over the same blocks of a quarter of the window.
    tau : array_like, (n, nv)
        Joint torques, N m or N.
    parameters : sequence of str, optional
        Names of `robot.parameter_names`, or patterns such as "forearm.*" and "*.damping"; by default all parameters of
        the bodies. A mass alone keeps its link's centre of mass and its inertia about that.
    a : array_like, (n, nv), optional
        Accelerations. Otherwise v or q is differentiated.
    method : {"weighted", "ordinary", "robust", "total"}
        Weighted: each joint's torques count by their own noise. Robust: outliers count less (Huber). Total: errors of
        the filtered positions are taken in as well as those of the torques; it needs v=None.
    half_window : int, optional
        Samples on each side of the filter's window; by default the one whose states predict the torques of left-out
        parts of the data best. Measured velocities are used only where they do better than those of q.
    cutoff : float, optional
        The filter's cut-off frequency (-3 dB), Hz, in place of half_window.
    confidence : float
        The probability of the intervals.
    validate : runs, optional
        Runs that are kept out of the fit, in the form of t; `result.validation` has their residuals.

    Returns
    -------
    Identification
        `values`, `intervals`, `covariance`, `not_identifiable`, `not_excited`, `consistency`, `found`,
        `filter`, `validation`, `predict`.

    Raises
    ------
    QueryError
        For arguments of wrong shapes or values; codes "unknown-parameter", "times", "too-few-samples",
        "constant-data", "units", "nothing-identifiable".

    Notes
    -----
    The intervals hold for noise of the torques with mean 0, independent between joints; residuals that follow each
    other in time widen them (Newey and West). The numerical error is added to them: a bound on rounding, and where
    positions are filtered the change of the result under a window that is wider by 1 / 0.7.

    Directions that the data hardly show are held near the URDF's values by a ridge: a normal prior of 10 times the
    size of the links. It is part of the weighted and the robust method, and of the covariance.

    References
    ----------
    Khalil and Dombre 2002, "Modeling, Identification and Control of Robots", chapter 12.
    """
    one_of(METHODS, method, "method")
    confidence = positive(confidence, "confidence", QueryError, "such as 0.95", expected="a probability")
    if confidence >= 1.0:
        raise QueryError(f"expected a probability, got {confidence!r}", argument="confidence", remedy="such as 0.95")
    chosen = select(robot, parameters)
    runs = recordings(robot, t, q, v, tau, a)
    held = () if validate is None else recordings(robot, validate, None, None, None)
    if method == "total" and runs[0].v is not None:
        what, remedy = "the errors of measured velocities are not known", "leave v and a out, or use another method"
        raise QueryError(what, argument="method", remedy=remedy, code="no-errors")
    possible = _possible(robot, chosen)
    for run in runs:
        _require_radians(robot, run, _system_of(robot, chosen, possible))
    by = _filter_of(robot, chosen, possible, runs, half_window, cutoff)
    data = filtered(robot, runs, by)
    columns, y = _system(robot, chosen, data)
    coarse = None if data.coarse is None else _system(robot, chosen, data.coarse)
    base = _excited(possible, columns, None if coarse is None else coarse[0] - columns)
    _require_enough(y, data, base)
    columns = columns[..., list(base.members)]
    prior = _prior(robot, chosen, base)
    if coarse is None:
        found = fit(columns, y, method, prior=prior)
        numerical = found.rounding
    else:
        wide, torques = coarse[0][..., list(base.members)], coarse[1]
        errors = np.concatenate([wide - columns, (torques - y)[..., None]], axis=-1)
        found = fit(columns, y, method, errors, prior=prior)
        numerical = found.rounding + np.abs(fit(wide, torques, method, errors, prior=prior).x - found.x)
    half_width = stdtrit(y.size - len(found.x), (1 + confidence) / 2) * np.sqrt(np.diag(found.covariance)) + numerical
    result = Identification(
        robot=robot, selection=chosen, combinations=base.combinations, matrix=base.matrix, estimate=found.x,
        covariance=found.covariance, numerical_error=numerical, half_width=half_width, confidence=confidence,
        not_identifiable=possible.not_identifiable(), not_excited=_not_excited(possible, base), noise=found.noise,
        t=data.averaged(data.t), residuals=found.residuals, condition=found.condition, correlated=found.correlated,
        method=method, filter=by, metric=found.metric, torques=data.averaged(data.tau), validation=None,
    )  # fmt: skip
    return replace(result, validation=_validation(result, held)) if held else result


def _filter_of(
    robot: Robot, chosen: Selection, possible: BaseParameters, runs: Sequence[Recording],
    half: int | None, frequency: float | None,
) -> Filter | None:  # fmt: skip
    """The window that is given, or that suits the data; None where accelerations were measured."""
    if half is not None and (not isinstance(half, int | np.integer) or half < SMALLEST):
        what = f"expected a whole number from {SMALLEST} on, got {half!r}"
        raise QueryError(what, argument="half_window", remedy="leave it out to choose by the torques")
    if runs[0].a is not None:
        return None
    for run in runs:
        require_samples(len(run.t), wider(half or SMALLEST), "q" if run.v is None else "v")
    if half is None and frequency is not None:
        rate = float(np.median([(len(run.t) - 1) / (run.t[-1] - run.t[0]) for run in runs]))
        half = half_window_of(positive(frequency, "cutoff", QueryError, "such as 8", expected="a frequency, Hz"), rate)
        require_samples(min(len(run.t) for run in runs), wider(half))
    return choose(robot, runs, _system_of(robot, chosen, possible), half)


def _system_of(robot: Robot, chosen: Selection, possible: BaseParameters) -> System:
    """The equations y = G theta of what can be told, from states and torques."""
    known, members = chosen.parameters(robot, np.zeros(len(chosen.names))), list(possible.members)

    def system(now: States, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        regressor = robot.regressor(now.q, now.v, now.a)
        return (regressor @ chosen.columns)[..., members], tau - regressor @ known

    return system


def _require_radians(robot: Robot, run: Recording, system: System) -> None:
    """Warn of a joint beyond its limits; refuse (code "units") where the torques say that its angles are degrees."""
    what = beyond_reach(robot, run.t, run.q)
    half = min(10, len(run.t) // 8)
    if not what or half < SMALLEST:
        return
    at, errors = np.arange(half, len(run.t) - half, max(1, len(run.t) // 800)), []
    for scale in (1.0, np.pi / 180):
        v = None if run.v is None else scale * run.v
        now = states(robot, replace(run, q=scale * run.q, v=v), half, "q" if v is None else "v", at)
        errors.append(float(np.mean(np.log(left_out(*system(now, run.tau[at]))))))
    if errors[1] < errors[0]:
        raise QueryError(f"{what}; is q in degrees?", argument="q", remedy="give radians", code="units")
    warnings.warn(f"{what}; the torques fit radians", RuntimeWarning, stacklevel=3)


def _prior(robot: Robot, chosen: Selection, base: BaseParameters) -> tuple[np.ndarray, np.ndarray]:
    """The URDF's base parameters (r,), and the reciprocals of their standard deviations: 10 times the links' sizes.

    So wide a ridge moves only what the data hardly show. Friction, damping and armature have none: 0.
    """
    model = robot.model
    bodies, sizes = 10 * (model.njoints - 1), np.zeros(len(robot.parameter_names))
    length = max((float(np.linalg.norm(place.translation)) for place in list(model.jointPlacements)[1:]), default=0.0)
    length = max(length, _SHORTEST)
    for j in range(model.njoints - 1):
        mass = max(model.inertias[j + 1].mass, robot.mass / model.njoints)
        sizes[10 * j : 10 * j + 10] = mass * np.array([1.0, *[length] * 3, *[length**2] * 6])
    of_names = np.abs(chosen.columns[:bodies].T) @ sizes[:bodies]
    of_names[np.any(chosen.columns[bodies:], axis=0)] = np.inf
    with np.errstate(invalid="ignore"):
        spread = 10 * np.nansum(np.abs(base.matrix) * of_names, axis=1)
    return base.matrix @ chosen.nominal, np.divide(1.0, spread, out=np.zeros_like(spread), where=spread > 0)


def _validation(found: Identification, held: Sequence[Recording]) -> Validation:
    """Torques of other runs, by the same filter, less their prediction."""
    if found.filter is not None:
        for run in held:
            require_samples(len(run.t), wider(found.filter.half_window))
        held = [replace(run, a=None) for run in held]
    elif any(run.a is None for run in held):
        what, remedy = "the runs that were identified have accelerations, these have not", "give q, v and a"
        raise QueryError(what, argument="validate", remedy=remedy, code="column-missing")
    data = filtered(found.robot, held, found.filter)
    predicted = np.concatenate([found.predict(*state) for state in data.states()])
    tau, predicted = data.averaged(data.tau), data.averaged(predicted)
    return Validation(data.averaged(data.t), tau, tau - predicted)


def _possible(robot: Robot, chosen: Selection) -> BaseParameters:
    """What some motion can show. Raises QueryError where it is nothing."""
    base = base_parameters(robot, chosen)
    if not base.members:
        what = f"no joint torque depends on {', '.join(chosen.names[:6])}"
        remedy = "look for other parameters: `base_parameters(robot)` lists what can be told"
        raise QueryError(what, argument="parameters", remedy=remedy, code="nothing-identifiable")
    return base


def _system(robot: Robot, chosen: Selection, data: Measurements) -> tuple[np.ndarray, np.ndarray]:
    """G (n, nv, k) and y (n, nv) of y = G theta: y is without the torques of what is not looked for."""
    known = chosen.parameters(robot, np.zeros(len(chosen.names)))
    columns, torques = [], []
    for state in data.states():
        regressor = robot.regressor(*state)
        columns.append(regressor @ chosen.columns)
        torques.append(regressor @ known)
    both = data.averaged(np.concatenate(columns)), data.averaged(data.tau - np.concatenate(torques))
    largest = max(float(np.abs(x).max(initial=0.0)) for x in both)
    if largest > _LARGEST:
        what = f"numbers of the size {largest:.3g} cannot be used"
        raise QueryError(what, where="identify", remedy="give SI units and radians", code="units")
    return both


def _excited(possible: BaseParameters, columns: np.ndarray, error: np.ndarray | None) -> BaseParameters:
    """What these data show of it: the columns must be independent, beyond the errors that filters leave in them."""
    members = list(possible.members)
    flat = columns[..., members].reshape(-1, len(members))
    errors = None if error is None else error[..., members].reshape(-1, len(members))
    seen = independent(possible.combinations, flat, errors)
    where = tuple(members[k] for k in seen.members)
    return BaseParameters(possible.names, where, seen.matrix @ possible.matrix, ())


def _not_excited(possible: BaseParameters, base: BaseParameters) -> tuple[str, ...]:
    """The combinations that other motions can show and these data do not, alone or within sums."""
    lacking = [possible.members.index(k) for k in possible.members if k not in base.members]
    return tuple(possible.combinations[k] for k in lacking)


def _require_enough(y: np.ndarray, data: Measurements, base: BaseParameters) -> None:
    """Require more torques than parameters. Raises QueryError (code "too-few-samples")."""
    if y.size <= len(base.members):
        what = f"{y.size} torques at {len(data.t)} samples are too few for {len(base.members)} parameters"
        remedy = "measure longer, or look for fewer parameters"
        raise QueryError(what, argument="t", remedy=remedy, code="too-few-samples")
    if not base.members:
        what = "no torque in these data depends on the parameters, beyond the errors of the filter"
        remedy = "measure a motion that moves those links more"
        raise QueryError(what, argument="q", remedy=remedy, code="nothing-identifiable")
