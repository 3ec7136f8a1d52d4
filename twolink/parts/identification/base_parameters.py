"""Base parameters: the combinations of parameters that joint torques can show, each with its name in words.

Names and patterns select the parameters theta, which change pi of tau = Y pi.

Columns of the regressor that depend on each other linearly belong to parameters of which only combinations act:
Y_d = Y_b K, so tau = Y_b (pi_b + K pi_d), and the entries of pi_b + K pi_d are the base parameters.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from typing import Any

import numpy as np
import pinocchio as pin
import scipy.linalg

from twolink.algorithms.mechanism import BODY_PARAMETERS
from twolink.dynamics import Robot
from twolink.errors import QueryError, nearest


@dataclass(frozen=True)
class Term:
    """A coefficient of a joint model: its name, and the torques (..., nv) of a unit of it at q, v, a and `width`."""

    name: str
    torque: Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], np.ndarray]


def single_joints(robot: Robot) -> dict[str, int]:
    """The degrees of freedom of the joints that have one, by name."""
    return {joint.name: joint.v.start for joint in robot.joints if joint.v.stop - joint.v.start == 1}


def direction(v: np.ndarray, width: np.ndarray) -> np.ndarray:
    """The direction of friction, tanh(v / width): sign(v) but for speeds that cannot be told from rest."""
    return np.where(width > 0.0, np.tanh(v / np.where(width > 0.0, width, 1.0)), np.sign(v))


def regressor(robot: Robot, q: np.ndarray, v: np.ndarray, a: np.ndarray, width: np.ndarray) -> np.ndarray:
    """Y (n, nv, p) as `robot.regressor` has it, but for the `direction` of friction. width: (nv,), rad/s or m/s."""
    model, data, bodies = robot.model, robot.data, 10 * (robot.model.njoints - 1)
    if robot.has_mimic:
        out = robot.regressor(q, v, a)
    else:  # Pinocchio's own takes a twentieth of the time
        out = np.zeros((len(q), robot.nv, len(robot.parameter_names)))
        for row, *state in zip(out, q, v, a, strict=True):
            row[:, :bodies] = pin.computeJointTorqueRegressor(model, data, *state)
    dofs = [*single_joints(robot).values()]
    rates = (a, v, direction(v, width))  # of armature, damping and friction, each of all joints
    out[:, len(rates) * dofs, range(bodies, out.shape[-1])] = np.hstack([rate[:, dofs] for rate in rates])
    return out


@dataclass(frozen=True)
class Selection:
    """pi = pi0 + C (theta - theta0): names (k,) of theta, the robot's own values theta0 (k,), and C (p, k).

    terms: those of theta that are no parameters of the robot; their columns of C are 0. width (nv,): speeds within
    which no friction's direction is known, rad/s or m/s.
    """

    names: tuple[str, ...]
    nominal: np.ndarray
    columns: np.ndarray
    terms: tuple[Term, ...] = ()
    width: np.ndarray = field(default_factory=lambda: np.zeros(1))

    @property
    def rubbing(self) -> dict[str, str]:
        """The names whose torques turn with a joint's velocity, and their joints."""
        pairs = {name: name.rpartition(".") for name in self.names}
        return {name: joint for name, (joint, _, kind) in pairs.items() if kind.removeprefix("motor_") in RUBBING}

    def parameters(self, robot: Robot, theta: np.ndarray) -> np.ndarray:
        """pi (p,) for theta (k,)."""
        return np.asarray(robot.parameter_values + self.columns @ (theta - self.nominal))

    def system(self, robot: Robot, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """G (n, nv, k) and c (n, nv) of tau = G theta + c."""
        whole = regressor(robot, q, v, a, self.width)
        columns = whole @ self.columns
        for term in self.terms:
            columns[..., self.names.index(term.name)] = term.torque(q, v, a, self.width)
        return columns, whole @ self.parameters(robot, np.zeros(len(self.names)))

    def without(self, names: Collection[str]) -> "Selection":
        """The selection without these names."""
        keep = [k for k, name in enumerate(self.names) if name not in names]
        terms = tuple(term for term in self.terms if term.name not in names)
        names = tuple(self.names[k] for k in keep)
        return Selection(names, self.nominal[keep], self.columns[:, keep], terms, self.width)

    def beside(self, names: tuple[str, ...], nominal: np.ndarray) -> "Selection":
        """The selection with more names, whose values are given and to which no column of C belongs."""
        columns = np.hstack([self.columns, np.zeros((len(self.columns), len(names)))])
        return replace(self, names=(*self.names, *names), nominal=np.append(self.nominal, nominal), columns=columns)


def select(
    robot: Robot, parameters: Sequence[str] | None, of_joints: Sequence[str] = (), terms: tuple[Term, ...] = ()
) -> Selection:
    """The parameters that names and patterns ("forearm.*") stand for; None: all that belong to bodies.

    of_joints: more names of parameters; terms: of a joint model.

    A mass that is looked for without the other nine parameters of its link keeps the link's centre of mass and its
    inertia about that, as in `robot.compiled(parameters=...)`: dpi/dm = (1, c, -[c x]^2). All other parameters are
    entries of pi, and what was not asked for keeps its entry.

    Raises
    ------
    QueryError
        For a name or pattern that fits nothing, with the nearest right name; code "unknown-parameter".
    """
    known = robot.parameter_names
    names = known[: 10 * (robot.model.njoints - 1)] if parameters is None else _expand(parameters, known)
    names = tuple(dict.fromkeys([*names, *of_joints]))
    columns = np.zeros((len(known), len(names)))
    chosen = set(names)
    for k, name in enumerate(names):
        row = known.index(name)
        columns[row, k] = 1.0
        link = name.removesuffix(".mass")
        if link != name and chosen.isdisjoint(f"{link}.{entry}" for entry in BODY_PARAMETERS[1:]):
            lever = robot.model.inertias[row // 10 + 1].lever
            columns[row : row + 10, k] = pin.Inertia(1.0, lever, np.zeros((3, 3))).toDynamicParameters()
    own = Selection(names, robot.parameter_values[[known.index(name) for name in names]], columns)
    return replace(own.beside(tuple(term.name for term in terms), np.zeros(len(terms))), terms=terms)


def _expand(parameters: Sequence[str], known: Sequence[str]) -> tuple[str, ...]:
    """The known names that the texts stand for, each once, in the order in which they are asked for."""
    require_list(parameters, "*.damping")
    found: list[str] = []
    for text in parameters:
        fitting = [name for name in known if name == text or fnmatchcase(name, str(text))]
        if not fitting:
            raise QueryError(f"there is no parameter {text!r}", argument="parameters", code="unknown-parameter",
                             remedy=_remedy(str(text), known))  # fmt: skip
        found += fitting
    return tuple(dict.fromkeys(found))


def require_list(parameters: Any, other: str) -> None:
    """Require names of what is looked for; such as the forearm's mass and an other. Raises QueryError."""
    if isinstance(parameters, str) or not isinstance(parameters, Sequence) or not parameters:
        raise QueryError(f"expected a list of names, got {parameters!r:.60}", argument="parameters",
                         remedy=f'such as ["forearm.mass", "{other}"]')  # fmt: skip


def _remedy(text: str, known: Sequence[str]) -> str:
    link = text.rpartition(".com.")[0]
    if f"{link}.mass" in known:
        return f"look for {link}.mass and {link}.first_moment.*: the centre of mass is their ratio"
    link = text.rpartition(".inertia.")[0]
    if f"{link}.mass" in known:
        return f"look for {link}.origin_inertia.*, the inertia about the joint's origin"
    return nearest(text, known)


RANK = 1e-8
"""Columns, scaled to length 1, are dependent where what is left of one is shorter than this. URDFs write right angles
with 6 to 16 digits; rounding of the regressor is 1e-15."""
RUBBING = ("friction", "asymmetry", "stribeck")
_COEFFICIENT = 1e-9  # of a combination, below which a parameter is left out of it
_NOISE = 2.0  # what is left of a column must be this many times as long as its own error: noise alone is not


@dataclass(frozen=True)
class BaseParameters:
    """Base parameters of `names`: B theta, with B (r, k) of rank r.

    names: (k,) of all parameters. members: (r,), the column that leads each combination (coefficient 1).
    matrix: B. unseen: names that no torque depends on.
    """

    names: tuple[str, ...]
    members: tuple[int, ...]
    matrix: np.ndarray
    unseen: tuple[str, ...]

    @property
    def combinations(self) -> tuple[str, ...]:
        """The base parameters in words, such as "upper_arm.origin_inertia.yy + 0.25 forearm.mass"."""
        return tuple(in_words(self.names, row) for row in self.matrix)

    @property
    def null_space(self) -> np.ndarray:
        """A basis (k, k - r) of the changes of the parameters that change no torque, orthonormal."""
        return np.asarray(scipy.linalg.null_space(self.matrix))

    def beside(self, names: tuple[str, ...]) -> "BaseParameters":
        """These, and others of which each counts alone."""
        more = range(len(self.names), len(self.names) + len(names))
        matrix = scipy.linalg.block_diag(self.matrix, np.eye(len(names)))
        return BaseParameters((*self.names, *names), (*self.members, *more), matrix, self.unseen)

    def within(self, columns: np.ndarray, error: np.ndarray | None = None) -> "BaseParameters":
        """The part of these, or combinations of them, that columns (n, r) with these errors show."""
        seen = independent(self.combinations, columns, error)
        members = tuple(self.members[j] for j in seen.members)
        return BaseParameters(self.names, members, seen.matrix @ self.matrix, ())

    def not_identifiable(self, what: str = "torque") -> tuple[str, ...]:
        """Parameters that cannot be told, in words: those that do not act, and sums of which only the whole acts."""
        alone = [f"{name}: no {what} depends on it" for name in self.unseen]
        sums = [text for text, row in zip(self.combinations, self.matrix, strict=True) if np.count_nonzero(row) > 1]
        return (*alone, *(f"only the sum {text}" for text in sums))


def not_shown(possible: BaseParameters, shown: BaseParameters) -> tuple[str, ...]:
    """The combinations of those that are possible whose leading parameter none of the shown ones has."""
    pairs = zip(possible.combinations, possible.members, strict=True)
    return tuple(text for text, member in pairs if member not in shown.members)


def in_words(names: tuple[str, ...], row: np.ndarray) -> str:
    """A linear combination of parameters in words, the one with coefficient 1 that leads it first."""
    lead = next((k for k, c in enumerate(row) if c == 1.0), 0)
    text = names[lead]
    for k, c in enumerate(row):
        if k != lead and c != 0.0:
            size = "" if abs(abs(c) - 1) < 1e-9 else f"{abs(c):.6g} "
            text += f" {'-' if c < 0 else '+'} {size}{names[k]}"
    return text


def base_parameters(robot: Robot, parameters: Selection | list[str] | None = None, seed: int = 0) -> BaseParameters:
    """The base parameters of a robot: what the joint torques of some motion can show.

    Parameters
    ----------
    robot : Robot
        The robot.
    parameters : sequence of str, optional
        Names or patterns of `robot.parameter_names`; all parameters of the bodies by default.
    seed : int
        Seed of the random states whose regressor is looked at.

    Returns
    -------
    BaseParameters

    Raises
    ------
    QueryError
        For an unknown parameter.

    References
    ----------
    Gautier 1991, "Numerical calculation of the base inertial parameters of robots", J. Robotic Systems 8.
    """
    chosen = parameters if isinstance(parameters, Selection) else select(robot, parameters)
    count = 8 + 3 * len(chosen.names) // robot.nv
    q, v = robot.random_state(count, seed)
    a = np.random.default_rng(seed).uniform(-3, 3, v.shape)
    columns = chosen.system(robot, q, 2 * v, np.asarray(a))[0]
    return independent(chosen.names, columns.reshape(-1, len(chosen.names)))


def independent(names: tuple[str, ...], columns: np.ndarray, error: np.ndarray | None = None) -> BaseParameters:
    """The combinations that a regressor (n, k) shows, and those that it does not.

    error: the errors (n, k) of its columns, where they are known; a column must stand out of them.
    """
    k = len(names)
    stacked = columns if error is None else np.hstack([columns, error])
    small = np.asarray(np.linalg.qr(stacked, mode="r"))
    lengths = np.linalg.norm(small[:, :k], axis=0)
    seen = lengths > 1e-12 * lengths.max(initial=0.0)
    scale = np.where(seen, lengths, 1.0)
    scaled, errors = small[:, :k] / scale, np.zeros((len(small), k)) if error is None else small[:, k:] / scale
    order = [j for j in range(k) if seen[j]]
    members, dependence = _sweep(scaled, errors, order)
    diagonal, pivots = scipy.linalg.qr(scaled[:, order], mode="r", pivoting=True)
    if error is None and len(members) != int(np.sum(np.abs(np.diag(diagonal)) > RANK)):
        members, dependence = _sweep(scaled, errors, [order[j] for j in pivots])
    matrix = np.zeros((len(members), k))
    matrix[range(len(members)), members] = 1.0
    for j, coefficients in dependence.items():
        here = coefficients * scale[j] / scale[members[: len(coefficients)]]
        matrix[: len(here), j] = np.where(np.abs(coefficients) > _COEFFICIENT, here, 0.0)
    unseen = tuple(name for name, here in zip(names, seen, strict=True) if not here)
    return BaseParameters(names, tuple(members), matrix, unseen)


def _sweep(columns: np.ndarray, errors: np.ndarray, order: list[int]) -> tuple[list[int], dict[int, np.ndarray]]:
    """Take columns in this order, each that depends on no earlier ones; the others by their coefficients in those."""
    members: list[int] = []
    dependence: dict[int, np.ndarray] = {}
    basis = np.empty((len(columns), 0))
    triangle = np.empty((0, 0))
    for j in order:
        first = basis.T @ columns[:, j]
        left = columns[:, j] - basis @ first
        again = basis.T @ left  # orthogonalised twice: as good as Householder's
        left, first = left - basis @ again, first + again
        coefficients = scipy.linalg.solve_triangular(triangle, first) if members else first
        floor = np.linalg.norm(errors[:, j] - errors[:, members] @ coefficients)
        length = float(np.linalg.norm(left))
        if length <= max(RANK, _NOISE * float(floor)):
            dependence[j] = coefficients
            continue
        members.append(j)
        basis = np.column_stack([basis, left / length])
        triangle = np.block([[triangle, first[:, None]], [np.zeros((1, len(first))), np.array([[length]])]])
    return members, dependence
