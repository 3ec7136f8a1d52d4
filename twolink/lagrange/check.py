"""Four witnesses to the equations of the two-link arm, held against each other: `check`.

Pinocchio (the reference), the hand derivation as corrected and as printed, and the machine derivation from
energies answer the same questions about n random arms in random states, entry by entry; SymPy says which
entries are equal for ALL arms and states; and the energy of a released arm shows what the misprint means.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias, get_args

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from twolink.errors import AccuracyError, QueryError
from twolink.lagrange import derive
from twolink.lagrange import pinocchio_arm as reference
from twolink.lagrange.check_result import CheckReport, Energy, Row
from twolink.lagrange.formulas import Variant
from twolink.lagrange.pinocchio_arm import Samples
from twolink.lagrange.two_link import two_link

Array: TypeAlias = NDArray[Any]
Witness: TypeAlias = dict[str, Array]  # every column of the table: (n, 1) for an entry, (n, 2) for a vector

ACCELERATIONS = {"acceleration, ABA": "aba", "acceleration, CRBA + solve": "crba"}
TORQUE = "torque, RNEA"
TOLERANCE = 1e-10  # of the energy runs, relative and absolute


def check(n: int = 10_000, seed: int = 0, horizon: float = 10.0) -> CheckReport:
    """Compare Pinocchio, corrected, derived and printed on n random arms, and the energy over `horizon` [s].

    Errors are relative: of an entry, to the largest magnitude in Pinocchio's matrix or vector for that arm
    and state (a single entry may pass through zero); of an acceleration or torque, which are sums that may
    cancel, to the sum of the magnitudes of their terms, |M^-1| (|tau| + |h|) and |M| |a| + |h|. Nothing is
    scaled with cond(M). Raises QueryError unless n >= 1 and horizon > 0.
    """
    if n < 1:
        raise QueryError(f"expected at least one sample, got {n}", where="n")
    if not (np.isfinite(horizon) and horizon > 0):
        raise QueryError(f"expected a positive number of seconds, got {horizon}", where="horizon")
    samples = draw(n, seed)
    pinocchio = reference.answers(samples)
    truth, scale = _truth(pinocchio), _scales(pinocchio, samples)
    witnesses = {
        "corrected": _hand(samples, "corrected"),
        "derived": _machine(samples),
        "printed": _hand(samples, "printed"),
    }
    symbols = {verdict.entry: verdict for verdict in derive.compare()}
    rows = []
    for name, expected in truth.items():
        error = {
            who: float(np.max(np.abs(columns[name] - expected) / scale[name])) for who, columns in witnesses.items()
        }
        verdict = symbols.get(name)
        differences = (verdict.corrected, verdict.printed) if verdict else (None, None)
        rows.append(Row(name, error["corrected"], error["derived"], error["printed"], *differences))
    condition = float(np.linalg.cond(pinocchio["A"]).max())
    return CheckReport(n, seed, condition, tuple(rows), horizon, energies(horizon))


def draw(n: int, seed: int) -> Samples:
    """n arms and states: lengths 0.1 to 3 m and masses 0.1 to 30 kg (log-uniform), g 0 to 25 m/s^2, any
    angles, speeds within 10 rad/s, accelerations within 50 rad/s^2, torques within 50 N m."""
    rng = np.random.default_rng(seed)
    lengths = np.exp(rng.uniform(np.log(0.1), np.log(3), (2, n)))
    masses = np.exp(rng.uniform(np.log(0.1), np.log(30), (2, n)))
    theta, dtheta, ddtheta, torque = (rng.uniform(-most, most, (n, 2)) for most in (np.pi, 10, 50, 50))
    return Samples((*lengths, *masses, rng.uniform(0, 25, n)), theta, dtheta, ddtheta, torque)


def energies(horizon: float) -> tuple[Energy, ...]:
    """The true mechanical energy, by Pinocchio, along each model's motion from rest in the horizontal.

    l = 1, 1 m, m = 3, 1 kg, g = 9.81 m/s^2, no torque; SciPy's DOP853 with rtol = atol = 1e-10.
    """
    lengths, masses, g, rest = (1.0, 1.0), (3.0, 1.0), 9.81, np.zeros(2)
    model = reference.arm(*lengths, *masses, g)
    data = model.createData()
    corrected, printed = (two_link(lengths, masses, g, variant) for variant in get_args(Variant))
    motions: dict[str, Callable[[Array, Array], Array]] = {
        "Pinocchio": lambda q, v: pin.aba(model, data, q, v, rest),
        "corrected": lambda q, v: corrected.forward_dynamics(q, v, rest),
        "printed": lambda q, v: printed.forward_dynamics(q, v, rest),
    }
    return tuple(_energy(name, acceleration, model, horizon) for name, acceleration in motions.items())


def _energy(name: str, acceleration: Callable[[Array, Array], Array], model: pin.Model, horizon: float) -> Energy:
    def rate(_: float, x: Array) -> Array:
        return np.concatenate([x[2:], acceleration(x[:2], x[2:])])

    run = solve_ivp(rate, (0, horizon), np.zeros(4), method="DOP853", rtol=TOLERANCE, atol=TOLERANCE)
    if not run.success:
        raise AccuracyError(f"DOP853 stopped at t = {run.t[-1]:g} s: {run.message}", where=f"{name} motion")
    energy = reference.energy(model, run.y[:2].T, run.y[2:].T)
    return Energy(name, float(energy[-1]), float(np.max(np.abs(energy))))


def _truth(pinocchio: dict[str, Array]) -> Witness:
    """Pinocchio's answers as columns of the table."""
    vectors = {name: pinocchio[key] for name, key in ACCELERATIONS.items()} | {TORQUE: pinocchio["rnea"]}
    return _columns(*(pinocchio[key] for key in "ABCD")) | vectors


def _scales(pinocchio: dict[str, Array], samples: Samples) -> Witness:
    """What each error is relative to, (n, 1): see `check`. Where all is zero, errors are absolute."""
    mass, bias = np.abs(pinocchio["A"]), np.abs(pinocchio["h"])
    reach = np.abs(np.linalg.inv(pinocchio["A"]))
    scale = {name: _largest(pinocchio[name[0]]) for name in derive.ENTRIES}
    effort = np.abs(samples.torque) + bias
    scale |= dict.fromkeys(ACCELERATIONS, _largest(np.einsum("nij,nj->ni", reach, effort)))
    scale[TORQUE] = _largest(np.einsum("nij,nj->ni", mass, np.abs(samples.ddtheta)) + bias)
    return {name: np.where(size > 0, size, 1.0) for name, size in scale.items()}


def _hand(samples: Samples, variant: Variant) -> Witness:
    """The answers of the equations by hand, for all arms in one call each."""
    l1, l2, m1, m2, g = samples.parameters
    model = two_link((l1, l2), (m1, m2), g, variant)
    theta, dtheta = samples.theta, samples.dtheta
    columns = _columns(
        model.mass_matrix(theta),
        model.velocity_products(theta).sum(axis=-1),
        model.velocity_squares(theta),
        model.gravity_torque(theta),
    )
    columns |= dict.fromkeys(ACCELERATIONS, model.forward_dynamics(theta, dtheta, samples.torque))
    return columns | {TORQUE: model.inverse_dynamics(theta, dtheta, samples.ddtheta)}


def _machine(samples: Samples) -> Witness:
    """The answers of the equations derived from energies."""
    equations, arms, theta, dtheta = derive.numeric(), samples.parameters, samples.theta, samples.dtheta
    columns: Witness = {name: entry[:, None] for name, entry in equations.entries(arms, theta).items()}
    columns |= dict.fromkeys(ACCELERATIONS, equations.forward_dynamics(arms, theta, dtheta, samples.torque))
    return columns | {TORQUE: equations.inverse_dynamics(arms, theta, dtheta, samples.ddtheta)}


def _columns(*groups: Array) -> Witness:
    """A (n, 2, 2), B (n, 2), C (n, 2, 2), D (n, 2) as named columns (n, 1) in the order of derive.ENTRIES."""
    flat = np.concatenate([group.reshape(len(group), -1) for group in groups], axis=1)
    return {name: flat[:, i : i + 1] for i, name in enumerate(derive.ENTRIES)}


def _largest(values: Array) -> Array:
    return np.asarray(np.abs(values).reshape(len(values), -1).max(axis=1, keepdims=True))
