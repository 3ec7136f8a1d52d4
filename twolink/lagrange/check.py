"""The check of the two-link arm's equations: by hand, by SymPy, and by Pinocchio, compared with each other.

Every set of parameters becomes a URDF of uniform rods, which Pinocchio reads; none of its answers comes from a formula
of this package.

Pinocchio (the reference), the equations by hand as corrected and as printed, and those derived by SymPy answer the same
questions about n random arms in random states, entry by entry. SymPy says which entries are equal for ALL arms and
states, and the energy of a released arm shows what the misprint means.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any, get_args

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

from twolink.dynamics.arguments import positive, whole
from twolink.errors import AccuracyError, QueryError
from twolink.io.text import Table
from twolink.lagrange import derive
from twolink.lagrange.formulas import Variant
from twolink.lagrange.two_link import two_link

ACCELERATIONS = ("acceleration, ABA", "acceleration, CRBA + solve")
TORQUE = "torque, RNEA"

# The arm moves in the x-z plane; turning about -y is positive upwards, as the paper measures both angles.
_URDF = """<robot name="two_link"><link name="base"/>
<link name="upper_arm">{upper}</link><link name="forearm">{lower}</link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper_arm"/>
<axis xyz="0 -1 0"/><limit lower="-1000" upper="1000" effort="1000" velocity="1000"/></joint>
<joint name="elbow" type="revolute"><parent link="upper_arm"/><child link="forearm"/>
<origin xyz="{elbow!r} 0 0"/><axis xyz="0 -1 0"/>
<limit lower="-1000" upper="1000" effort="1000" velocity="1000"/></joint></robot>"""
_ROD = """<inertial><origin xyz="{centre!r} 0 0"/><mass value="{mass!r}"/>
<inertia ixx="0" iyy="{inertia!r}" izz="{inertia!r}" ixy="0" ixz="0" iyz="0"/></inertial>"""


@dataclass(frozen=True)
class ArmSamples:
    """n arms with a state each: parameters (l1, l2, m1, m2, g), (n,) each; states (n, 2) in SI units."""

    parameters: tuple[np.ndarray, ...]
    theta: np.ndarray
    dtheta: np.ndarray
    ddtheta: np.ndarray
    torque: np.ndarray


def arm_urdf(l1: float, l2: float, m1: float, m2: float) -> str:
    """The arm of two uniform rods (inertia m l^2 / 12 at mid-rod) as the text of a URDF."""
    upper, lower = (
        _ROD.format(centre=float(length / 2), mass=float(mass), inertia=float(mass * length**2 / 12))
        for length, mass in ((l1, m1), (l2, m2))
    )
    return _URDF.format(upper=upper, lower=lower, elbow=float(l1))


def pinocchio_arm(l1: float, l2: float, m1: float, m2: float, g: float) -> pin.Model:
    """The arm as Pinocchio reads it from its URDF."""
    model = pin.buildModelFromXML(arm_urdf(l1, l2, m1, m2))
    model.gravity.linear = np.array([0.0, 0.0, -g])
    return model


def pinocchio_answers(samples: ArmSamples) -> dict[str, np.ndarray]:
    """Pinocchio's answers, one arm and state at a time.

    A (n, 2, 2) by crba; B (n, 2), the sums of B's rows, and C (n, 2, 2) from nonLinearEffects at unit speeds
    with gravity off, so that weight cannot drown them; D (n, 2) by computeGeneralizedGravity; h (n, 2), the
    bias; (n, 2) each the accelerations by aba and by crba and a solve, and the torque by rnea, under ACCELERATIONS and
    TORQUE.
    """
    n = len(samples.theta)
    out = {name: np.empty((n, 2)) for name in ("B", "D", "h", *ACCELERATIONS, TORQUE)}
    out |= {name: np.empty((n, 2, 2)) for name in ("A", "C")}
    aba, crba = ACCELERATIONS
    for i, parameters in enumerate(np.stack(samples.parameters, axis=1).tolist()):
        model = pinocchio_arm(*parameters)
        data = model.createData()
        q, v, tau = samples.theta[i], samples.dtheta[i], samples.torque[i]
        mass = out["A"][i] = pin.crba(model, data, q)
        out["D"][i] = pin.computeGeneralizedGravity(model, data, q)
        bias = out["h"][i] = pin.nonLinearEffects(model, data, q, v)
        out[crba][i] = np.linalg.solve(mass, tau - bias)
        out[aba][i] = pin.aba(model, data, q, v, tau)
        out[TORQUE][i] = pin.rnea(model, data, q, v, samples.ddtheta[i])
        model.gravity.linear = np.zeros(3)
        squares = out["C"][i] = np.stack([pin.nonLinearEffects(model, data, q, unit) for unit in np.eye(2)], axis=1)
        out["B"][i] = pin.nonLinearEffects(model, data, q, np.ones(2)) - squares.sum(axis=1)
    return out


LIMIT = 1e-12
MEASURE = (
    "error = largest difference from Pinocchio over all samples, relative to the largest magnitude in the\n"
    "matrix or vector; of accelerations and torques, relative to the sum of the magnitudes of their terms"
)
Columns = dict[str, np.ndarray]  # by quantity: (n, 1) for an entry, (n, 2) for a vector

TOLERANCE = 1e-10  # of the energy runs, relative and absolute


@dataclass(frozen=True)
class QuantityComparison:
    """One quantity: the largest relative error of each set of equations against Pinocchio, and SymPy's differences.

    `*_minus_derived` is the symbolic difference from the equations that SymPy derives: "0" where equal for all arms and
    states, None for accelerations and torques, which follow from the entries.
    """

    quantity: str
    corrected: float
    derived: float
    printed: float
    corrected_minus_derived: str | None = None
    printed_minus_derived: str | None = None

    @property
    def misprinted(self) -> bool:
        """True if the paper's entry is wrong, by its symbols."""
        return self.printed_minus_derived not in ("0", None)

    @property
    def right(self) -> bool:
        """Corrected and derived agree with Pinocchio to LIMIT and with each other symbolically, and numbers and
        symbols say the same about the printed entry."""
        agree = self.corrected <= LIMIT and self.derived <= LIMIT and self.corrected_minus_derived in ("0", None)
        wrong_in_numbers = not self.printed <= LIMIT  # so that NaN counts as wrong
        return agree and (self.printed_minus_derived is None or wrong_in_numbers == self.misprinted)

    @property
    def verdict(self) -> str:
        """SymPy's verdict in words; empty where there is none."""
        for name, difference in (("corrected", self.corrected_minus_derived), ("printed", self.printed_minus_derived)):
            if difference not in ("0", None):
                return f"{name} differs: {difference}"
        return "" if self.printed_minus_derived is None else "equal"


@dataclass(frozen=True)
class Energy:
    """The mechanical energy [J] along the motion by one set of equations from horizontal rest, where it is 0.

    `final` at the end, `largest` the largest magnitude at the steps of the integrator on the way.
    """

    model: str
    final: float
    largest: float


@dataclass(frozen=True)
class CheckReport:
    """The whole result.

    Attributes
    ----------
    n, seed : int
        The number of random arms and states, and the seed they come from.
    largest_condition : float
        The largest condition number of their mass matrices.
    rows : tuple of QuantityComparison
        The comparison, quantity by quantity.
    horizon : float
        The time of the energy runs [s].
    energies : tuple of Energy
        The energies of the runs.
    """

    n: int
    seed: int
    largest_condition: float
    rows: tuple[QuantityComparison, ...]
    horizon: float
    energies: tuple[Energy, ...]

    @property
    def misprints(self) -> tuple[str, ...]:
        """The paper's entries that are wrong."""
        return tuple(row.quantity for row in self.rows if row.misprinted)

    @property
    def energy_limit(self) -> float:
        """The change of an energy of the order of 10 J [J] that the integrator (tolerance 1e-10) may cause."""
        return 1e-9 * (1 + self.horizon)

    @property
    def energy_shown(self) -> bool:
        """Pinocchio and corrected keep the energy, and printed exceeds the limit a thousand times."""
        change = {energy.model: energy.largest for energy in self.energies}
        kept = change["Pinocchio"] <= self.energy_limit and change["corrected"] <= self.energy_limit
        return kept and change["printed"] > 1000 * self.energy_limit

    @property
    def passed(self) -> bool:
        """All rows are right, the paper errs in C21 and C22 and nowhere else, and the energy shows it."""
        return all(row.right for row in self.rows) and self.misprints == ("C21", "C22") and self.energy_shown

    def to_dict(self) -> dict[str, Any]:
        """Plain data, ready for JSON."""
        limits = {"bar": LIMIT, "energy_bar": self.energy_limit, "measure": MEASURE.replace("\n", " ")}
        return asdict(self) | {"passed": self.passed, "misprints": list(self.misprints), **limits}

    def text(self) -> str:
        """A plain table."""
        rows = []
        for row in self.rows:
            errors = (f"{error:.1e}" for error in (row.corrected, row.derived, row.printed))
            rows.append((row.quantity, *errors, row.verdict, "" if row.right else "fails"))
        energies = [(e.model, f"{e.final:.3g} J", f"{e.largest:.3g} J") for e in self.energies]
        misprints = ", ".join(self.misprints) or "no entry"
        return f"""{self.n:,} random two-link arms and states against Pinocchio, seed {self.seed}, limit {LIMIT:g}
{MEASURE}

{Table(("quantity", "corrected", "derived", "printed", "symbolically", ""), tuple(rows))}

B is compared by row sums: both its columns multiply td1 td2, and no motion tells them apart.
largest condition number of the mass matrix: {self.largest_condition:.0f}

True energy over {self.horizon:g} s from horizontal rest at 0 J (l = 1, 1 m; m = 3, 1 kg):
{Table(("motion by", "at the end", "largest"), tuple(energies))}

{"PASSED" if self.passed else "FAILED"}: the paper errs in {misprints}"""


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
    n, seed = whole(n, "n", QueryError, "such as 10000", 1), whole(seed, "seed", QueryError)
    horizon = positive(horizon, "horizon", QueryError, "such as 10 s")
    samples = draw(n, seed)
    answers = pinocchio_answers(samples)
    expected = _columns(*(answers[name] for name in ("A", "B", "C", "D", *ACCELERATIONS, TORQUE)))
    scale, differences = _scales(answers, samples), derive.compare()
    equations = _by_hand(samples, "corrected"), _by_sympy(samples), _by_hand(samples, "printed")
    rows = []
    for name, values in expected.items():
        errors = [float(np.max(np.abs(columns[name] - values) / scale[name])) for columns in equations]
        rows.append(QuantityComparison(name, errors[0], errors[1], errors[2], *differences.get(name, ())))
    condition = float(np.linalg.cond(answers["A"]).max())
    return CheckReport(n, seed, condition, tuple(rows), horizon, energies(horizon))


def draw(n: int, seed: int) -> ArmSamples:
    """n random arms and states.

    Lengths from 0.1 to 3 m and masses from 0.1 to 30 kg (log-uniform), g from 0 to 25 m/s^2, any angles, speeds within
    10 rad/s, accelerations within 50 rad/s^2, torques within 50 N m.
    """
    rng = np.random.default_rng(seed)
    lengths = np.exp(rng.uniform(np.log(0.1), np.log(3), (2, n)))
    masses = np.exp(rng.uniform(np.log(0.1), np.log(30), (2, n)))
    theta, dtheta, ddtheta, torque = (rng.uniform(-limit, limit, (n, 2)) for limit in (np.pi, 10, 50, 50))
    return ArmSamples((*lengths, *masses, rng.uniform(0, 25, n)), theta, dtheta, ddtheta, torque)


def energies(horizon: float) -> tuple[Energy, ...]:
    """The mechanical energy, by Pinocchio, along the motion by each set of equations from rest in the horizontal.

    l = 1, 1 m, m = 3, 1 kg, g = 9.81 m/s^2, no torque; SciPy's DOP853 with rtol = atol = 1e-10.
    """
    lengths, masses, g = (1.0, 1.0), (3.0, 1.0), 9.81
    model = pinocchio_arm(*lengths, *masses, g)
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
    data = model.createData()
    energy = [pin.computeMechanicalEnergy(model, data, x[:2], x[2:]) for x in run.y.T]  # J, 0 at rest in the horizontal
    return Energy(name, energy[-1], float(np.max(np.abs(energy))))


def _scales(answers: Columns, samples: ArmSamples) -> Columns:
    """Scales to which each error is relative, (n, 1): see `check`. Where all is zero, errors are absolute."""
    mass, bias = np.abs(answers["A"]), np.abs(answers["h"])
    inverse = np.abs(np.linalg.inv(answers["A"]))
    scale = {name: largest(answers[name[0]]) for name in derive.ENTRIES}
    effort = np.abs(samples.torque) + bias
    scale |= dict.fromkeys(ACCELERATIONS, largest(np.einsum("nij,nj->ni", inverse, effort)))
    scale[TORQUE] = largest(np.einsum("nij,nj->ni", mass, np.abs(samples.ddtheta)) + bias)
    return {name: np.where(size > 0, size, 1.0) for name, size in scale.items()}


def _by_hand(samples: ArmSamples, variant: Variant) -> Columns:
    """The answers of the equations by hand, for all arms in one call each."""
    l1, l2, m1, m2, g = samples.parameters
    model, theta, dtheta = two_link((l1, l2), (m1, m2), g, variant), samples.theta, samples.dtheta
    products, squares = model.velocity_products(theta).sum(axis=-1), model.velocity_squares(theta)
    acceleration = model.forward_dynamics(theta, dtheta, samples.torque)
    torque = model.inverse_dynamics(theta, dtheta, samples.ddtheta)
    entries = model.mass_matrix(theta), products, squares, model.gravity_torque(theta)
    return _columns(*entries, acceleration, acceleration, torque)


def _by_sympy(samples: ArmSamples) -> Columns:
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


def largest(values: np.ndarray) -> np.ndarray:
    """The largest magnitude of each sample, (n, 1), of values (n, ...)."""
    return np.asarray(np.abs(values).reshape(len(values), -1).max(axis=1, keepdims=True))
