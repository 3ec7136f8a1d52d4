"""identify: parameters of a robot from measured positions and joint torques."""

import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from threadpoolctl import threadpool_limits

from twolink.dynamics import Robot
from twolink.dynamics.arguments import instance, one_of, positive
from twolink.errors import QueryError
from twolink.parts.identification.base_parameters import select
from twolink.parts.identification.filtering import (
    SMALLEST,
    Filter,
    Folds,
    Recording,
    half_window_of,
    rate_of,
    require_samples,
    states,
)
from twolink.parts.identification.joint_models import best_terms, explaining, joint_terms, with_width
from twolink.parts.identification.measurements import filtered, probability, recordings, wider
from twolink.parts.identification.regression import METHODS
from twolink.parts.identification.result import Identification
from twolink.parts.identification.setup import setup_of
from twolink.parts.identification.solving import IdentificationPlan, plan_of, solve, validation
from twolink.parts.identification.units import DEGREE, beyond_reach, in_degrees, range_of, wide_joint

_SURE = 0.5  # of the logarithm of the mean square: degrees must explain the torques so much better than radians


def identify(
    robot: Robot, t: Any, q: ArrayLike | None = None, v: ArrayLike | None = None, tau: ArrayLike | None = None,
    parameters: Sequence[str] | None = None, *, a: ArrayLike | None = None, joint_model: Any = None,
    coupling: ArrayLike | None = None, find: Sequence[str] | None = None, method: str = "weighted",
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
    joint_model : str, callable, list or mapping, optional
        Torques of the drives, found beside the parameters: words such as "viscous+coulomb+offset" of `viscous`,
        `coulomb`, `rotor`, `offset`, `asymmetric` and `stribeck:0.1` (with its velocity, rad/s or m/s); functions
        f(q, v, a) -> (n, nv), a column each; a list of these, or a mapping of joints to them. "auto": each joint's
        words by cross-validation; `result.joint_models` has the table. "none": no drives. By default auto, but none
        where parameters are given. While a joint moves, an asymmetry acts as an offset: auto takes the offset.
    coupling : array_like, (nv, nv), optional
        C of v_joint = C v_motor, for joints that several motors move: the laws then hold at the motors.
    find : sequence of str, optional
        What else is looked for, by an outer loop: "delay" of the torques, s; "zero" of the joints' positions;
        "gravity", its direction; "motor_constant", where tau has currents. Or names, such as "elbow.zero". By default
        a delay, where it is the clearest of the model errors that the residuals show; () takes the torques as logged.
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
        `filter`, `validation`, `model_errors`, `joint_models`, `setup`, `predict`, `report`.

    Raises
    ------
    QueryError
        For arguments of wrong shapes or values; codes "unknown-parameter", "times", "too-few-samples",
        "constant-data", "units", "nothing-identifiable", "no-torques", "not-converged".

    Notes
    -----
    The intervals hold for noise of the torques with mean 0, independent between joints; residuals that follow each
    other in time widen them (Newey and West; Andrews and Monahan), and so does what drifts over a whole log, by the
    residuals' spectrum (`identification.drift`). What the model lacks, such as friction by load or temperature, shows
    where parts of the data differ: the intervals are no narrower than those of a jackknife that leaves out 20 blocks of
    time, or 8 runs and more, one after the other, unless all samples as measured leave white residuals. The numerical
    error is added: a bound on rounding, and where positions are filtered the change of the result under a window that
    is wider by 1 / 0.7.

    Where a speed cannot be told from rest, by the filter's error, the direction of friction is not known: it counts as
    tanh(v / width), with the width by cross-validation, and a rest as one sample that tells friction within its size.
    The filter and the joint models are chosen by left-out pieces of the motion, or runs where there are three.

    A parameter counts as not excited where the motion, with rest in the place of what its own filter errors explain,
    cannot show it at all. `model_errors` are tests of the residuals by what the model lacks.

    Directions that the data hardly show are kept near the URDF's values by a ridge: a normal prior of 10 times the
    size of the links. It is part of the weighted and the robust method, and of the covariance.

    References
    ----------
    Khalil and Dombre 2002, "Modeling, Identification and Control of Robots", chapter 12.
    """
    instance(robot, Robot, "robot")
    one_of(METHODS, method, "method")
    confidence = probability(confidence)
    if joint_model is None:
        joint_model = "auto" if parameters is None else "none"
    of_joints, terms = joint_terms(robot, joint_model, coupling)
    chosen, setup = select(robot, parameters, of_joints, terms), setup_of(robot, find or ())
    runs = recordings(robot, t, q, v, tau, a)
    held_out = () if validate is None else recordings(robot, validate, None, None, None)
    if method == "total" and runs[0].v is not None:
        raise QueryError("the errors of measured velocities are not known", argument="method", code="no-errors",
                         remedy="leave v and a out, or use another method")  # fmt: skip
    half = _half_window(runs, half_window, cutoff)
    plan = plan_of(setup, runs, chosen, method, confidence, half)
    for run in runs:
        _require_radians(robot, run)
    with threadpool_limits(1, "blas"):  # the matrices are small: more threads spin while they wait for each other
        by, table = plan.filter_of(setup), None
        data = filtered(robot, runs, by)
        chosen = with_width(robot, chosen, data)
        if joint_model == "auto":
            chosen, table = best_terms(robot, chosen, data)
        plan = plan_of(setup, runs, chosen, method, confidence, half)
        result = solve(plan, setup, by)
        if find is None:
            result = _without_delay(plan, by, result)
    result = replace(result, joint_models=table)
    return replace(result, validation=validation(result, held_out)) if held_out else result


def _without_delay(plan: IdentificationPlan, by: Filter | None, result: Identification) -> Identification:
    """The identification with the torques' delay, where it is the clearest of the model errors."""
    if [error.name for error in result.model_errors[:1]] != ["delay"]:
        return result
    try:
        return solve(plan, setup_of(plan.robot, ["delay"]), by)
    except QueryError:  # it does not settle: `model_errors` still names it
        return result


def _half_window(runs: Sequence[Recording], half: int | None, frequency: float | None) -> int | None:
    """The half window that is given, or that a frequency is; None where it is to be chosen or none is needed."""
    if half is not None and (not isinstance(half, int | np.integer) or half < SMALLEST):
        raise QueryError(f"expected a whole number from {SMALLEST} on, got {half!r}", argument="half_window",
                         remedy="leave it out to choose by the torques")  # fmt: skip
    if half is not None and frequency is not None:
        raise QueryError("half_window is given too", argument="cutoff",
                         remedy="keep one: both say how wide the filter is")  # fmt: skip
    if runs[0].a is not None:
        return half
    for run in runs:
        require_samples(len(run.t), wider(half or SMALLEST), "q" if run.v is None else "v")
    if half is None and frequency is not None:
        given = positive(frequency, "cutoff", QueryError, "such as 8", expected="a frequency, Hz")
        half = half_window_of(given, rate_of(runs))
        require_samples(min(len(run.t) for run in runs), wider(half))
    return half


def _require_radians(robot: Robot, run: Recording) -> None:
    """Refuse angles in degrees (code "units"), where the torques say so; warn of a joint beyond its limits.

    Gravity's torques and those of the velocities tell radians from degrees, whatever is looked for: all parameters of
    the bodies and friction are fitted to parts of the run, and predict the others.
    """
    beyond, half = beyond_reach(robot, run.t, run.q), min(10, len(run.t) // 8)
    joint = beyond[0] if beyond else wide_joint(robot, run.q)
    if joint is None or (run.a is None and half < SMALLEST):
        return
    why = beyond[1] if beyond else "which is more than a turn or beyond its limits"
    radians, degrees = (_unexplained(robot, run, scale, half) for scale in (1.0, DEGREE))
    if degrees < radians - (0.0 if beyond else _SURE):
        better = np.exp((radians - degrees) / 2)
        raise in_degrees(robot, run.q, joint, f"{why}; as degrees it explains the torques {better:.3g} times as well")
    if beyond:
        warnings.warn(f"{range_of(robot, run.q, joint)}, {why}; the torques fit radians", RuntimeWarning, stacklevel=3)


def _unexplained(robot: Robot, run: Recording, scale: float, half: int) -> float:
    """The mean logarithm of the mean square of left-out torques (nv,) less their prediction, of motions times scale."""
    step = max(1, len(run.t) // 800)
    if run.v is not None and run.a is not None:
        at = np.arange(0, len(run.t), step)
        now = scale * run.q[at], scale * run.v[at], scale * run.a[at]
    else:
        at, v = np.arange(half, len(run.t) - half, step), None if run.v is None else scale * run.v
        now = states(robot, replace(run, q=scale * run.q, v=v), half, "q" if v is None else "v", at)
    system = explaining(robot, [run])
    columns, y = system(now, run.tau[at])
    return float(np.mean(np.log(Folds(columns, y, [len(at)]).left_out())))
