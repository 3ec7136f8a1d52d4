"""The check of the two-link arm's equations: by hand, by SymPy, and by Pinocchio, compared with each other.

Pinocchio (the reference), the equations by hand as corrected and as printed, and those derived by SymPy answer the same
questions about n random arms in random states, entry by entry. SymPy says which entries are equal for ALL arms and
states, and the energy of a released arm shows what the misprint means.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias, get_args

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from twolink.errors import AccuracyError, QueryError
from twolink.lagrange import derive, pinocchio_arm
from twolink.lagrange.check_result import CheckReport, Comparison, Energy
from twolink.lagrange.formulas import Variant
from twolink.lagrange.pinocchio_arm import Samples
from twolink.lagrange.two_link import two_link

Array: TypeAlias = NDArray[Any]
Columns: TypeAlias = dict[str, Array]  # by quantity: (n, 1) for an entry, (n, 2) for a vector

ACCELERATIONS = {"acceleration, ABA": "aba", "acceleration, CRBA + solve": "crba"}
TORQUE = "torque, RNEA"
TOLERANCE = 1e-10  # of the energy runs, relative and absolute


def check(n: int = 10_000, seed: int = 0, horizon: float = 10.0) -> CheckReport:
    """Compare the equations on n random arms, and the energy of a released arm over some time.

    Errors are relative: of an entry, to the largest magnitude in Pinocchio's matrix or vector for that arm and state
    (a single entry may pass through zero); of an acceleration or torque, which are sums that may cancel, to the sum of
    the magnitudes of their terms, |M^-1| (|tau| + |h|) and |M| |a| + |h|. Nothing is scaled with cond(M).

    Parameters
    ----------
    n : int
        The number of arms, each in one state.
    seed : int
        Of the random arms and states.
    horizon : float
        The time of the energy runs [s].

    Returns
    -------
    CheckReport
        The errors of each quantity, SymPy's differences, and the energies.

    Raises
    ------
    QueryError
        Unless n >= 1 and horizon > 0.
    """
    if n < 1:
        raise QueryError(f"expected at least one sample, got {n}", argument="n")
    if not (np.isfinite(horizon) and horizon > 0):
        raise QueryError(f"expected a positive number of seconds, got {horizon}", argument="horizon")
    samples = draw(n, seed)
    answers = pinocchio_arm.answers(samples)
    expected, scale = _by_pinocchio(answers), _scales(answers, samples)
    equations = {
        "corrected": _by_hand(samples, "corrected"),
        "derived": _by_sympy(samples),
        "printed": _by_hand(samples, "printed"),
    }
    differences = derive.compare()
    rows = []
    for name, values in expected.items():
        errors = {key: float(np.max(np.abs(c[name] - values) / scale[name])) for key, c in equations.items()}
        symbolic = differences.get(name, (None, None))
        rows.append(Comparison(name, errors["corrected"], errors["derived"], errors["printed"], *symbolic))
    condition = float(np.linalg.cond(answers["A"]).max())
    return CheckReport(n, seed, condition, tuple(rows), horizon, energies(horizon))


def draw(n: int, seed: int) -> Samples:
    """n random arms and states.

    Lengths from 0.1 to 3 m and masses from 0.1 to 30 kg (log-uniform), g from 0 to 25 m/s^2, any angles, speeds within
    10 rad/s, accelerations within 50 rad/s^2, torques within 50 N m.
    """
    rng = np.random.default_rng(seed)
    lengths = np.exp(rng.uniform(np.log(0.1), np.log(3), (2, n)))
    masses = np.exp(rng.uniform(np.log(0.1), np.log(30), (2, n)))
    theta, dtheta, ddtheta, torque = (rng.uniform(-limit, limit, (n, 2)) for limit in (np.pi, 10, 50, 50))
    return Samples((*lengths, *masses, rng.uniform(0, 25, n)), theta, dtheta, ddtheta, torque)


def energies(horizon: float) -> tuple[Energy, ...]:
    """The mechanical energy, by Pinocchio, along the motion by each set of equations from rest in the horizontal.

    l = 1, 1 m, m = 3, 1 kg, g = 9.81 m/s^2, no torque; SciPy's DOP853 with rtol = atol = 1e-10.
    """
    lengths, masses, g, no_torque = (1.0, 1.0), (3.0, 1.0), 9.81, np.zeros(2)
    model = pinocchio_arm.arm(*lengths, *masses, g)
    data = model.createData()
    corrected, printed = (two_link(lengths, masses, g, variant) for variant in get_args(Variant))
    accelerations: dict[str, Callable[[Array, Array], Array]] = {
        "Pinocchio": lambda q, v: pin.aba(model, data, q, v, no_torque),
        "corrected": lambda q, v: corrected.forward_dynamics(q, v, no_torque),
        "printed": lambda q, v: printed.forward_dynamics(q, v, no_torque),
    }
    return tuple(_energy(name, acceleration, model, horizon) for name, acceleration in accelerations.items())


def _energy(name: str, acceleration: Callable[[Array, Array], Array], model: pin.Model, horizon: float) -> Energy:
    """The energy along the motion with this acceleration, a function of angles and speeds."""

    def rate(_: float, x: Array) -> Array:
        return np.concatenate([x[2:], acceleration(x[:2], x[2:])])

    run = solve_ivp(rate, (0, horizon), np.zeros(4), method="DOP853", rtol=TOLERANCE, atol=TOLERANCE)
    if not run.success:
        raise AccuracyError(f"DOP853 stopped at t = {run.t[-1]:g} s: {run.message}", where=f"{name} motion")
    energy = pinocchio_arm.energy(model, run.y[:2].T, run.y[2:].T)
    return Energy(name, float(energy[-1]), float(np.max(np.abs(energy))))


def _by_pinocchio(answers: dict[str, Array]) -> Columns:
    """Pinocchio's answers as columns."""
    vectors = {name: answers[key] for name, key in ACCELERATIONS.items()} | {TORQUE: answers["rnea"]}
    return _columns(*(answers[key] for key in "ABCD")) | vectors


def _scales(answers: dict[str, Array], samples: Samples) -> Columns:
    """What each error is relative to, (n, 1): see `check`. Where all is zero, errors are absolute."""
    mass, bias = np.abs(answers["A"]), np.abs(answers["h"])
    inverse = np.abs(np.linalg.inv(answers["A"]))
    scale = {name: _largest(answers[name[0]]) for name in derive.ENTRIES}
    effort = np.abs(samples.torque) + bias
    scale |= dict.fromkeys(ACCELERATIONS, _largest(np.einsum("nij,nj->ni", inverse, effort)))
    scale[TORQUE] = _largest(np.einsum("nij,nj->ni", mass, np.abs(samples.ddtheta)) + bias)
    return {name: np.where(size > 0, size, 1.0) for name, size in scale.items()}


def _by_hand(samples: Samples, variant: Variant) -> Columns:
    """The answers of the equations by hand, for all arms in one call each."""
    l1, l2, m1, m2, g = samples.parameters
    model, theta, dtheta = two_link((l1, l2), (m1, m2), g, variant), samples.theta, samples.dtheta
    products, squares = model.velocity_products(theta).sum(axis=-1), model.velocity_squares(theta)
    columns = _columns(model.mass_matrix(theta), products, squares, model.gravity_torque(theta))
    columns |= dict.fromkeys(ACCELERATIONS, model.forward_dynamics(theta, dtheta, samples.torque))
    return columns | {TORQUE: model.inverse_dynamics(theta, dtheta, samples.ddtheta)}


def _by_sympy(samples: Samples) -> Columns:
    """The answers of the equations that SymPy derives; accelerations by LAPACK, not by the closed form of TwoLink."""
    a, b, c, d = derive.numeric()(samples.parameters, samples.theta)
    speeds = samples.dtheta
    bias = b * speeds.prod(axis=1, keepdims=True) + np.einsum("nij,nj->ni", c, speeds**2) + d
    acceleration = np.linalg.solve(a, (samples.torque - bias)[..., None])[..., 0]
    torque = np.einsum("nij,nj->ni", a, samples.ddtheta) + bias
    return _columns(a, b, c, d) | dict.fromkeys(ACCELERATIONS, acceleration) | {TORQUE: torque}


def _columns(*groups: Array) -> Columns:
    """A (n, 2, 2), B (n, 2), C (n, 2, 2), D (n, 2) as named columns (n, 1) in the order of derive.ENTRIES."""
    flat = np.concatenate([group.reshape(len(group), -1) for group in groups], axis=1)
    return {name: flat[:, i : i + 1] for i, name in enumerate(derive.ENTRIES)}


def _largest(values: Array) -> Array:
    return np.asarray(np.abs(values).reshape(len(values), -1).max(axis=1, keepdims=True))
