"""The check of the two-link arm's equations: by hand, by SymPy, and by Pinocchio, compared with each other.

Pinocchio (the reference), the equations by hand as corrected and as printed, and those derived by SymPy answer the same
questions about n random arms in random states, entry by entry. SymPy says which entries are equal for ALL arms and
states, and the energy of a released arm shows what the misprint means.
"""

from collections.abc import Callable
from functools import partial
from typing import get_args

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

from twolink.errors import AccuracyError, QueryError
from twolink.lagrange import derive, pinocchio_arm
from twolink.lagrange.check_result import CheckReport, Comparison, Energy
from twolink.lagrange.formulas import Variant
from twolink.lagrange.pinocchio_arm import ACCELERATIONS, TORQUE, Samples
from twolink.lagrange.two_link import two_link

Columns = dict[str, np.ndarray]  # by quantity: (n, 1) for an entry, (n, 2) for a vector

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
    expected = _columns(*(answers[name] for name in ("A", "B", "C", "D", *ACCELERATIONS, TORQUE)))
    scale, differences = _scales(answers, samples), derive.compare()
    equations = _by_hand(samples, "corrected"), _by_sympy(samples), _by_hand(samples, "printed")
    rows = []
    for name, values in expected.items():
        errors = [float(np.max(np.abs(columns[name] - values) / scale[name])) for columns in equations]
        rows.append(Comparison(name, errors[0], errors[1], errors[2], *differences.get(name, ())))
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
    lengths, masses, g = (1.0, 1.0), (3.0, 1.0), 9.81
    model = pinocchio_arm.arm(*lengths, *masses, g)
    accelerations: dict[str, Callable[..., np.ndarray]] = {"Pinocchio": partial(pin.aba, model, model.createData())}
    accelerations |= {name: two_link(lengths, masses, g, name).forward_dynamics for name in get_args(Variant)}
    return tuple(_energy(name, acceleration, model, horizon) for name, acceleration in accelerations.items())


def _energy(name: str, acceleration: Callable[..., np.ndarray], model: pin.Model, horizon: float) -> Energy:
    """The energy along the motion with this acceleration, a function of angles, speeds and torques."""

    def rate(_: float, x: np.ndarray) -> np.ndarray:
        return np.concatenate([x[2:], acceleration(x[:2], x[2:], np.zeros(2))])

    run = solve_ivp(rate, (0, horizon), np.zeros(4), method="DOP853", rtol=TOLERANCE, atol=TOLERANCE)
    if not run.success:
        raise AccuracyError(f"DOP853 stopped at t = {run.t[-1]:g} s: {run.message}", where=f"{name} motion")
    energy = pinocchio_arm.energy(model, run.y[:2].T, run.y[2:].T)
    return Energy(name, float(energy[-1]), float(np.max(np.abs(energy))))


def _scales(answers: Columns, samples: Samples) -> Columns:
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
    acceleration = model.forward_dynamics(theta, dtheta, samples.torque)
    torque = model.inverse_dynamics(theta, dtheta, samples.ddtheta)
    entries = model.mass_matrix(theta), products, squares, model.gravity_torque(theta)
    return _columns(*entries, acceleration, acceleration, torque)


def _by_sympy(samples: Samples) -> Columns:
    """The answers of the equations that SymPy derives; accelerations by LAPACK, not by the closed form of TwoLink."""
    a, b, c, d = derive.evaluate(samples.parameters, samples.theta)
    speeds = samples.dtheta
    bias = b * speeds.prod(axis=1, keepdims=True) + np.einsum("nij,nj->ni", c, speeds**2) + d
    acceleration = np.linalg.solve(a, (samples.torque - bias)[..., None])[..., 0]
    torque = np.einsum("nij,nj->ni", a, samples.ddtheta) + bias
    return _columns(a, b, c, d, acceleration, acceleration, torque)


def _columns(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray, *motion: np.ndarray) -> Columns:
    """A, C (n, 2, 2) and B, D (n, 2) by entry, then the accelerations and the torque (n, 2), by name."""
    entries = np.hstack([matrix.reshape(len(matrix), -1) for matrix in (a, b, c, d)])[..., None]
    named = dict(zip(derive.ENTRIES, np.moveaxis(entries, 1, 0), strict=True))
    return named | dict(zip((*ACCELERATIONS, TORQUE), motion, strict=True))


def _largest(values: np.ndarray) -> np.ndarray:
    return np.asarray(np.abs(values).reshape(len(values), -1).max(axis=1, keepdims=True))
