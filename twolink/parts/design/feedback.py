"""lqr: linear-quadratic regulators, as effects."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from twolink.dynamics.arguments import instance
from twolink.effects.checks import check_effect
from twolink.effects.controllers import Limits, StateFeedback, limit_of
from twolink.errors import SceneError
from twolink.integrate.motion.scene_equations import equations_of, require_no_states
from twolink.parts.design.linearization import AT_REST, Linearization, linearize
from twolink.parts.design.smooth import require_constant_forces
from twolink.scenes import Scene

RESIDUAL = 1e-8  # of the Riccati equation, relative
SEMIDEFINITE = 1e-12  # relative: an eigenvalue so little below 0 is 0


def lqr(
    scene: Scene,
    Q: ArrayLike,
    R: ArrayLike,
    q: ArrayLike | None = None,
    *,
    inputs: Sequence[str] | None = None,
    effort: Limits = None,
) -> StateFeedback:
    """The linear-quadratic regulator that holds a robot at rest at a configuration: tau = tau0 - K (dq, dv).

        minimal integral of x^T Q x + u^T R u,   x' = A x + B u
        A^T P + P A - P B R^-1 B^T P + Q = 0,   K = R^-1 B^T P

    Parameters
    ----------
    scene : Scene
        The robot with the effects that act besides the regulator.
    Q : float, array_like (2 d,) or (2 d, 2 d)
        Weight of the state (dq, dv), in the order of `linearize`'s names (d = nv without closed loops): symmetric, not
        negative; a vector is its diagonal.
    R : float, array_like (m,) or (m, m)
        Weight of the inputs: symmetric, positive.
    q : array_like (nq,), optional
        The configuration; by default the scene's own.
    inputs : sequence of str, optional
        The actuated joints; by default all with one degree of freedom. With fewer than nv, q must be an equilibrium
        that their torques can hold: an under-actuated robot.
    effort : mapping of joint to float, "urdf" or None
        Limits of the torques, N m or N: by joint, the URDF's, or none.

    Returns
    -------
    StateFeedback
        An effect: `scene.with_effects([*scene.effects, it])`. It can be saved in a scene file.

    Raises
    ------
    SceneError
        A weight does not fit (code "weights"); the inputs cannot hold q at rest, or not within `effort` (code
        "not-equilibrium"); some unstable motion cannot be reached by them (code "not-stabilizable"); forces depend on
        time; or as `linearize`.

    Notes
    -----
    It is optimal for the linear equations. How far from q the robot returns depends on its nonlinear forces and on
    limits of effort, and no bound for that is given: simulate it. Linearize the scene with it for the closed loop's
    eigenvalues.

    References
    ----------
    Anderson and Moore: Optimal Control: Linear Quadratic Methods, 1990, chapter 3.
    """
    equations = equations_of(instance(scene, Scene, "scene", SceneError))
    require_no_states(equations, "lqr")
    require_constant_forces(equations, "; a regulator holds a robot at rest in constant ones")
    at_rest = linearized_at_rest(scene, q, inputs)
    nv, m = scene.robot.nv, len(at_rest.inputs)
    state, control = _weight(Q, len(at_rest.A), "Q"), _weight(R, m, "R", positive=True)
    gain = np.zeros((m, 2 * nv))
    gain[:, [*at_rest.independent, *(nv + k for k in at_rest.independent)]] = _gain(at_rest, state, control)
    rows = {joint: tuple(row.tolist()) for joint, row in zip(at_rest.inputs, gain, strict=True)}
    torques = dict(zip(at_rest.inputs, at_rest.tau.tolist(), strict=True))
    regulator = StateFeedback(rows, tuple(at_rest.q.tolist()), torques, effort)
    check_effect(regulator, scene.robot)
    for joint, torque in torques.items():
        limit = limit_of(joint, effort, scene.robot.model)
        if limit is not None and abs(torque) > limit:
            raise SceneError(f"{abs(torque):.3g} at {joint!r} holds it there, above the limit {limit:g}",
                             argument="effort", code="not-equilibrium",
                             remedy="raise the limit, or give a q that needs less")  # fmt: skip
    return regulator


def linearized_at_rest(scene: Scene, q: ArrayLike | None = None, inputs: Sequence[str] | None = None) -> Linearization:
    """The linearization at rest at q under the smallest torques at the inputs that hold it there.

    Raises SceneError where they cannot, code "not-equilibrium".
    """
    q = scene.q if q is None else q
    free = linearize(scene, q, inputs=inputs)
    if free.A.ndim != 2:
        raise SceneError("expected one configuration", argument="q", remedy=f"give shape ({scene.robot.nq},)")
    if not free.inputs:
        raise SceneError("there is no actuated joint", argument="inputs", remedy="name some, such as ['elbow']")
    reach, falling = free.B[len(free.B) // 2 :], free.a[list(free.independent)]
    tau = np.linalg.lstsq(reach, -falling, rcond=None)[0]
    left = float(np.abs(falling + reach @ tau).max(initial=0.0))
    if left > AT_REST * (1.0 + float(np.abs(free.A).max(initial=0.0))):
        raise SceneError(f"torques at {', '.join(free.inputs)} cannot hold it there: it accelerates by {left:.2g}",
                         argument="q", code="not-equilibrium",
                         remedy="tl.equilibria(scene) finds where it stays at rest; or name more inputs")  # fmt: skip
    return linearize(scene, q, inputs=inputs, tau=tau)


def _weight(value: ArrayLike, size: int, name: str, *, positive: bool = False) -> np.ndarray:
    """A weight (size, size): symmetric, not negative or positive. Raises SceneError."""
    try:
        weight, got = np.asarray(value, dtype=float), str(np.shape(value))
    except (TypeError, ValueError):
        weight, got = np.array(np.nan), f"{value!r:.60}"
    if weight.ndim < 2 and weight.size in (1, size):
        weight = np.diag(np.broadcast_to(weight.ravel(), (size,)))
    scale, what = float(np.abs(weight).max(initial=0.0)), ""
    if weight.shape != (size, size) or not np.isfinite(weight).all():
        what = f"expected finite numbers of shape ({size}, {size}), got {got}"
    elif np.abs(weight - weight.T).max(initial=0.0) > SEMIDEFINITE * scale:
        what = "it is not symmetric"
    else:
        least = float(np.linalg.eigvalsh(weight).min())
        if least <= 0.0 if positive else least < -SEMIDEFINITE * scale:
            what = f"expected eigenvalues that are {'positive' if positive else 'not negative'}, got {least:.3g}"
    if what:
        raise SceneError(what, argument=name, code="weights",
                         remedy=f"give a number, {size} numbers, or a symmetric {size} x {size} matrix")  # fmt: skip
    return np.asarray(0.5 * (weight + weight.T))


def _gain(at_rest: Linearization, state: np.ndarray, control: np.ndarray) -> np.ndarray:
    """K (m, 2 nv). Raises SceneError where no K makes the closed loop stable, or none is optimal."""
    from scipy.linalg import solve_continuous_are

    a, b, size = at_rest.A, at_rest.B, len(at_rest.A)
    tolerance = at_rest.controllability.tolerance
    for value, error in zip(at_rest.eigenvalues, at_rest.eigenvalue_errors, strict=True):
        if value.real < -error:
            continue
        for matrices, code, what in (
            ((a, b), "not-stabilizable", "the inputs do not reach"),
            ((a.T, state), "not-detectable", "Q does not see"),
        ):
            distance = float(np.linalg.svd(np.hstack([matrices[0] - value * np.eye(size), matrices[1]]),
                                           compute_uv=False)[-1])  # fmt: skip
            if distance <= tolerance:
                remedy = "name more inputs" if code == "not-stabilizable" else "give every state a weight"
                raise SceneError(f"{what} the motion of eigenvalue {value:.3g}, which does not decay by itself",
                                 where="lqr", remedy=remedy, code=code)  # fmt: skip
    try:
        p = solve_continuous_are(a, b, state, control)
    except np.linalg.LinAlgError as error:
        raise SceneError(f"the Riccati equation has no stabilizing solution in double precision: {error}", where="lqr",
                         remedy="scale Q and R, or name more inputs", code="not-stabilizable") from None  # fmt: skip
    gain = np.linalg.solve(control, b.T @ p)
    left = a.T @ p + p @ a - p @ b @ gain + state
    closed = np.linalg.eigvals(a - b @ gain)
    size_of_terms = float(np.abs(p @ b @ gain).max() + np.abs(a.T @ p).max() + np.abs(state).max())
    if not (np.abs(left).max() <= RESIDUAL * size_of_terms and closed.real.max() < 0.0):
        raise SceneError(f"the closed loop is not stable in double precision: {closed.real.max():.2g} 1/s", where="lqr",
                         remedy="scale Q and R, or name more inputs", code="not-stabilizable")  # fmt: skip
    return np.asarray(gain)
