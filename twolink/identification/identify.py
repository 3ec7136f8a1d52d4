"""identify: parameters of a robot from measured positions and joint torques."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import stdtrit

from twolink.dynamics import Robot
from twolink.dynamics.arguments import one_of, positive
from twolink.errors import QueryError
from twolink.identification.base_parameters import BaseParameters, Selection, base_parameters, independent, select
from twolink.identification.measurements import Measurements, measurements, require_reach
from twolink.identification.regression import METHODS, fit
from twolink.identification.result import Identification

_UNEXPLAINED = 0.3  # of the torques: residuals above it ask for the reason
_LARGEST = 1e100  # of torques and of the regressor: squares and their ratios stay within the range of doubles


def identify(
    robot: Robot, t: ArrayLike, q: ArrayLike, v: ArrayLike | None, tau: ArrayLike,
    parameters: Sequence[str] | None = None, *, a: ArrayLike | None = None, method: str = "weighted",
    half_window: int | None = None, confidence: float = 0.95,
) -> Identification:  # fmt: skip
    """Find parameters pi in tau = Y(q, v, a) pi from measurements, with intervals, and name what cannot be found.

    Parameters
    ----------
    robot : Robot
        The robot. Parameters that are not looked for keep its values; damping and friction are then 0.
    t : array_like, (n,)
        Increasing times, s.
    q : array_like, (n, nq)
        Configurations, rad or m.
    v : array_like, (n, nv), or None
        Velocities, rad/s or m/s. None: q is filtered and differentiated by local polynomials of degree 4 (Savitzky and
        Golay), and the samples within half a window of the ends are left out.
    tau : array_like, (n, nv)
        Joint torques, N m or N.
    parameters : sequence of str, optional
        Names of `robot.parameter_names`, or patterns such as "forearm.*" and "*.damping"; by default all parameters of
        the bodies. A mass alone keeps its link's centre of mass and its inertia about that.
    a : array_like, (n, nv), optional
        Accelerations. Otherwise v is differentiated.
    method : {"weighted", "ordinary", "robust", "total"}
        Weighted: each joint's torques count by their own noise. Robust: outliers count less (Huber). Total: errors of
        the filtered positions are taken in as well as those of the torques; it needs v=None.
    half_window : int, optional
        Samples on each side of the filter's window; by default 0.7 of the widest whose residuals are noise alone.
    confidence : float
        The probability of the intervals.

    Returns
    -------
    Identification
        `values`, `intervals`, `covariance`, `not_identifiable`, `not_excited`, `consistency`, `found`.

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

    References
    ----------
    Khalil and Dombre 2002, "Modeling, Identification and Control of Robots", chapter 12.
    """
    one_of(METHODS, method, "method")
    confidence = positive(confidence, "confidence", QueryError, "such as 0.95", expected="a probability")
    if confidence >= 1.0:
        raise QueryError(f"expected a probability, got {confidence!r}", argument="confidence", remedy="such as 0.95")
    chosen = select(robot, parameters)
    data = measurements(robot, t, q, v, tau, a, half_window)
    if method == "total" and data.coarse is None:
        what, remedy = "the errors of measured velocities are not known", "leave v and a out, or use another method"
        raise QueryError(what, argument="method", remedy=remedy, code="no-errors")
    possible = _possible(robot, chosen)
    columns, y = _system(robot, chosen, data)
    coarse = None if data.coarse is None else _system(robot, chosen, data.coarse)
    base = _excited(possible, columns, None if coarse is None else coarse[0] - columns)
    _require_enough(data, base)
    columns = columns[..., list(base.members)]
    if coarse is None:
        found = fit(columns, y, method)
        numerical = found.rounding
    else:
        wider, torques = coarse[0][..., list(base.members)], coarse[1]
        errors = np.concatenate([wider - columns, (torques - y)[..., None]], axis=-1)
        found = fit(columns, y, method, errors)
        numerical = found.rounding + np.abs(fit(wider, torques, method, errors).x - found.x)
    if np.std(found.residuals) > _UNEXPLAINED * np.std(y):
        require_reach(robot, data.t, data.q)
    wide = stdtrit(y.size - len(found.x), (1 + confidence) / 2) * np.sqrt(np.diag(found.covariance)) + numerical
    return Identification(
        robot=robot, selection=chosen, combinations=base.combinations, matrix=base.matrix, estimate=found.x,
        covariance=found.covariance, numerical_error=numerical, half_width=wide, confidence=confidence,
        not_identifiable=possible.not_identifiable(), not_excited=_not_excited(possible, base), noise=found.noise,
        t=data.t, residuals=found.residuals, condition=found.condition, correlated=found.correlated, method=method,
    )  # fmt: skip


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
    both = np.concatenate(columns), data.tau - np.concatenate(torques)
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


def _require_enough(data: Measurements, base: BaseParameters) -> None:
    """Require more torques than parameters. Raises QueryError (code "too-few-samples")."""
    if data.tau.size <= len(base.members):
        what = f"{data.tau.size} torques at {len(data.t)} samples are too few for {len(base.members)} parameters"
        remedy = "measure longer, or look for fewer parameters"
        raise QueryError(what, argument="t", remedy=remedy, code="too-few-samples")
    if not base.members:
        what = "no torque in these data depends on the parameters, beyond the errors of the filter"
        remedy = "measure a motion that moves those links more"
        raise QueryError(what, argument="q", remedy=remedy, code="nothing-identifiable")
