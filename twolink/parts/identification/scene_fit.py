"""fit: parameters of a scene from measured motions, by simulation with sensitivities."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtri, stdtrit

from twolink.dynamics.arguments import Positive, array, instance, one_of, positive
from twolink.errors import QueryError, require_known
from twolink.io.progress import Report
from twolink.parts.identification.base_parameters import BaseParameters, not_shown
from twolink.parts.identification.fit_result import SceneFit
from twolink.parts.identification.fit_search import METHODS, CondensedProblem, LeastSquaresSearch, Point
from twolink.parts.identification.measured_motion import MeasuredMotion, measured_motion
from twolink.parts.identification.measurements import probability
from twolink.parts.identification.shooting import can_be_cut, segment_counts
from twolink.parts.identification.unknowns import unknowns_of
from twolink.scenes import Scene
from twolink.scenes.scene import accuracy_of

_FINER = 30.0  # times more accurate are the simulations that tell the numerical error
_ZERO = 1e-5  # of the sizes of its parts: a sum that is not told from 0
_EXPLAINED = 0.2  # of what is measured: residuals below it say that the motion was found


def fit(
    scene: Scene,
    measurements: Any,
    parameters: Sequence[str],
    *,
    sigma: float | Mapping[str, float] | ArrayLike | None = None,
    method: str = "weighted",
    segments: int | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    patience: float = 600.0,
    accuracy: Positive = 1e-6,
    confidence: float = 0.95,
    progress: Report | None = None,
) -> SceneFit:
    """Find parameters of a scene such that its motion is the measured one, with intervals; name what cannot be found.

        minimise sum over samples and channels of ((measured - simulated(p)) / sigma)^2

    Parameters
    ----------
    scene : Scene
        The experiment, with the effects that acted (torques, damping, gravity) and a first guess of all values.
    measurements : mapping, DataFrame, str or path
        Columns t (s, from the scene's start), q.JOINT and v.JOINT [rad, m, per second], or whole arrays t (n,),
        q (n, nq), v (n, nv); or a .csv, .parquet or .npz file. Joints and velocities may be missing.
    parameters : sequence of str
        Physical constants ("forearm.mass", "forearm.com.x", "elbow.armature", "gravity.z"); the ten parameters about
        the joint's frame as in `tl.identify` ("forearm.first_moment.x", "forearm.origin_inertia.yy", "forearm.*");
        numbers of effects ("effects.1.damping.elbow"); the initial state ("q", "v", "q.elbow").
    sigma : float, mapping of channels to float, or array_like (c,), optional
        Standard deviations of the measurements. By default the residuals tell them. Where residuals are clearly larger
        than sigma, they count; where they are smaller, the intervals are those of sigma.
    method : {"weighted", "robust"}
        Robust: outliers count less (Huber).
    segments : int, optional
        Of multiple shooting. By default 1, and more where errors of the start grow a lot or one does not find the
        motion. Motions with events and closed loops are simulated in one segment.
    bounds : mapping of names to (float, float), optional
        The least and the largest values, infinite where there is none. Masses, damping and the like are never
        negative, also without.
    patience : float
        Seconds, after which the search ends with the best so far.
    accuracy : float
        Bound on the error of simulated positions, rad or m, and of derivatives relative to the largest, or 1.
    confidence : float
        The probability of the intervals.
    progress : callable, optional
        Called now and then with what is done, the total and a label; here simulations, and the most that the present
        search may take.

    Returns
    -------
    SceneFit
        `values`, `intervals`, `scene` (with what was found), `not_identifiable`, `residuals`, `plot`. Ctrl-C ends the
        search with the best so far, which is marked `interrupted`.

    Raises
    ------
    SceneError
        A name is unknown (code "unknown-parameter"), or there are no derivatives by it (code "sensitivity-undefined").
    QueryError
        For arguments that do not fit; codes "mixed-parameters", "column-missing", "times",
        "too-few-samples", "constant-data", "units", "nothing-identifiable", "bounds".
    AccuracyError
        The scene's own motion cannot be simulated, or its sensitivities do not exist.

    Notes
    -----
    Levenberg and Marquardt's steps within bounds (`identification.bounded_least_squares`) with Jacobians from
    `tl.sensitivities`, in coordinates in which every body can exist (`identification.unknowns`), along those directions
    only that the measurements show. In several segments the gaps are penalised ever more, and closed by steps of the
    condensed equations (`identification.shooting`). The intervals are those of the linearised problem at the solution;
    correlated residuals widen them (Newey and West). The numerical error is added: the step to the solution by
    simulations 30 times as accurate, and what their error bars may change.

    References
    ----------
    Bock 1983, "Recent advances in parameter identification techniques for O.D.E."; Rucker and Wensing 2022, "Smooth
    parameterization of rigid-body inertia", IEEE Robotics and Automation Letters 7.
    """
    one_of(METHODS, method, "method")
    confidence = probability(confidence)
    data = measured_motion(instance(scene, Scene, "scene").robot, measurements)
    unknowns, noise = unknowns_of(scene, parameters), _noise_of(sigma, data)
    seconds = positive(patience, "patience", QueryError, "such as 60")
    search = LeastSquaresSearch(unknowns, data, noise, method, accuracy_of(accuracy), patience=seconds,
                                limits=unknowns.limits(bounds or {}), progress=progress,
                                in_segments=segments != 1 and can_be_cut(scene))  # fmt: skip
    points: list[Point] = []
    for count in segment_counts(segments, search.growth, data, scene):
        try:
            points.append(search.point_with(count))
        except KeyboardInterrupt:  # before there was anything to keep of this search
            if not points:
                raise
            search.interrupted = True
        if search.interrupted or _unexplained(search, points[-1]) < _EXPLAINED:
            break
    best = min(points, key=lambda point: _unexplained(search, point))
    return _result(search, best, method, confidence)


def _unexplained(search: LeastSquaresSearch, point: Point) -> float:
    """The share of what was measured that residuals are, in the channel where it is largest."""
    return float((np.sqrt(np.mean(point.shot.residuals**2, axis=0)) / search.spread).max())


def _result(search: LeastSquaresSearch, point: Point, method: str, confidence: float) -> SceneFit:
    """Values, covariance and numerical errors at the end of a search."""
    unknowns, data, shooting = search.unknowns, search.data, point.shooting
    fine = replace(point, shot=shooting(point.z, point.starts, search.accuracy / _FINER))
    now = search.at(fine)
    found = search.statistics(fine, now)
    numerical = np.abs(found.x) + found.rounding + _from_bars(now, fine, found.noise)
    known = search.known is not None and np.array_equal(found.noise, search.known)
    half = (1 + confidence) / 2
    quantile = ndtri(half) if known else stdtrit(now.residuals.size - len(found.x), half)
    shown, possible = now.shown, now.possible
    values = unknowns.values(point.z)
    weighted = search.at(point).columns @ unknowns.derivatives(point.z)[0] / found.noise[:, None]
    return SceneFit(
        scene=unknowns.scene_at(point.z), start=unknowns.scene, robot=unknowns.scene.robot,
        parameters=dict(zip(unknowns.names, values.tolist(), strict=True)), combinations=shown.combinations,
        matrix=shown.matrix, estimate=shown.matrix @ values, covariance=found.covariance, numerical_error=numerical,
        half_width=quantile * np.sqrt(np.diag(found.covariance)) + numerical, confidence=confidence,
        not_identifiable=(*_ratios(possible, values), *possible.not_identifiable("measurement")),
        not_excited=not_shown(possible, shown), channels=data.channels, noise=found.noise, t=data.t,
        measured=data.values, residuals=point.shot.residuals,
        singular_values=np.linalg.svd(weighted.reshape(-1, len(values)), compute_uv=False),
        condition=found.condition, correlated=found.correlated, method=method, segments=len(point.shot.segments),
        gap=float(np.abs(point.shot.gaps).max(initial=0.0)), converged=point.converged,
        explained=_unexplained(search, point) < _EXPLAINED, simulations=search.simulations,
        interrupted=search.interrupted,
    )  # fmt: skip


def _ratios(possible: BaseParameters, values: np.ndarray) -> list[str]:
    """Notes on a common factor of parameters that changes nothing: sums that are 0 are ratios."""
    size = np.abs(possible.matrix) @ np.abs(values)
    sums = (np.abs(possible.matrix @ values) < _ZERO * size) & (np.count_nonzero(possible.matrix, axis=1) > 1)
    names = [name for name, here in zip(possible.names, possible.matrix[sums].any(axis=0), strict=True) if here]
    return [f"only the ratios of {', '.join(names)}; leave one out, whose value is known"] if names else []


def _from_bars(now: CondensedProblem, point: Point, noise: np.ndarray) -> np.ndarray:
    """Bounds (r,) on the estimate's change by the errors of the simulated values and of their derivatives."""
    columns = now.of_members / noise[:, None]
    flat = columns.reshape(-1, columns.shape[-1])
    lengths = np.linalg.norm(flat, axis=0)
    inverse = np.linalg.pinv(flat / lengths) / lengths[:, None]
    error = np.concatenate([segment.error for segment in point.shot.segments])
    of_values = np.abs(inverse) @ (error[:, None] / noise).ravel()
    scores = np.abs(now.residuals / noise**2).sum(axis=1) @ now.error[:, list(now.shown.members)]
    return np.asarray(of_values + np.abs(inverse @ inverse.T) @ scores)


def _noise_of(sigma: Any, data: MeasuredMotion) -> np.ndarray | None:
    """The standard deviations (c,) that the caller gives, or None. Raises QueryError."""
    if sigma is None:
        return None
    channels = data.channels
    if isinstance(sigma, Mapping):
        for name in sigma:
            require_known(str(name), channels, QueryError, "there is no channel {!r}", argument="sigma")
        lacking = [name for name in channels if name not in sigma]
        if lacking:
            raise QueryError(f"there is none for {lacking[0]}", argument="sigma", remedy="give one for each channel")
        sigma = [sigma[name] for name in channels]
    values = np.broadcast_to(array("sigma", sigma, None), (len(channels),)) if np.ndim(sigma) < 1 else array(
        "sigma", sigma, len(channels))  # fmt: skip
    if values.ndim != 1 or (values <= 0).any():
        raise QueryError("expected numbers above 0, one for each channel", argument="sigma", remedy="such as 1e-3")
    return np.asarray(values)
