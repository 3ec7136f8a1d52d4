"""Parameters that real bodies can have, as near as possible to the robot's own and to what the data say.

A body with mass density rho >= 0 has the pseudo-inertia P = integral of (x, 1)(x, 1)^T rho dV, positive semidefinite,
and linear in its ten parameters (Wensing, Kim and Slotine 2018). Sought is theta that makes

    |B theta - estimate|^2_(information) / 2 + weight sum over bodies of [tr(P0^-1 P) - log det(P0^-1 P) - 4]

least, with the information matrix of least squares, so that it is the loss of fit that is weighed. The sum is the
Bregman divergence from the robot's own bodies P0 (Lee, Wensing and Park 2020): it keeps P positive definite, and
decides what the data do not show, with a weight of 0.1: a body that is ten times the URDF's costs as much as an
estimate that is off by two standard errors. A joint's damping, friction and armature, of which URDFs know nothing, are
expected as large as the data allow. The problem is convex, also where some parameters of a body are held, so
Newton's method finds its one minimum; in log-Cholesky parameters (Rucker and Wensing 2022) it is not convex, and
parameters cannot be held.

For charts, any ten numbers (alpha, d, s, t) are a body that can exist: P = U U^T with

    U = e^alpha [e^d1 s12 s13 t1; 0 e^d2 s23 t2; 0 0 e^d3 t3; 0 0 0 1].

The functions of pseudo-inertias take complex numbers too, so that derivatives are complex steps.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from twolink.algorithms.spatial import ENTRIES
from twolink.dynamics import Robot
from twolink.dynamics.regressors import JOINT_PARAMETERS
from twolink.parts.identification.base_parameters import Selection
from twolink.robots.checks import weightless_joints

_THIN = 1e-6  # thin rods and point masses are allowed: P may lack this share of its second moments
# Entries of the inertia in robot.parameter_names: xx, xy, yy, xz, yz, zz.
_ORIGIN = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))


def pseudo_inertia(body: np.ndarray) -> np.ndarray:
    """P (4, 4) of the ten parameters (`algorithms.mechanism.BODY_PARAMETERS`): second and first moment, mass."""
    inertia, first = _symmetric(body[4:], _ORIGIN), body[1:4, None]
    second = np.trace(inertia) / 2 * np.eye(3) - inertia
    return np.block([[second, first], [first.T, body[:1, None]]])


def body_of(pseudo: np.ndarray) -> np.ndarray:
    """The ten parameters (10,) of P."""
    inertia = np.trace(pseudo[:3, :3]) * np.eye(3) - pseudo[:3, :3]
    return np.array([pseudo[3, 3], *pseudo[:3, 3], *(inertia[i, j] for i, j in _ORIGIN)])


def central(body: np.ndarray) -> np.ndarray:
    """Mass, centre of mass, and inertia about it as xx, xy, xz, yy, yz, zz (10,) of the ten parameters."""
    mass, lever = body[0], body[1:4] / body[0]
    inertia = _symmetric(body[4:], _ORIGIN) - mass * _of_a_point(lever)
    return np.array([mass, *lever, *(inertia[i, j] for i, j in ENTRIES)])


def from_central(values: np.ndarray) -> np.ndarray:
    """The ten parameters (10,) of what `central` returns."""
    mass, lever = values[0], values[1:4]
    inertia = _symmetric(values[4:], ENTRIES) + mass * _of_a_point(lever)
    return np.array([mass, *(mass * lever), *(inertia[i, j] for i, j in _ORIGIN)])


def thickened(pseudo: np.ndarray, mass: float) -> np.ndarray:
    """P, where it is thin with more second moment in every direction and some mass, to be positive definite."""
    moved = pseudo.copy()
    moved[3, 3] = max(moved[3, 3], 1e-9 * mass)
    around = moved[:3, :3] - np.outer(moved[:3, 3], moved[:3, 3]) / moved[3, 3]
    wanted = _THIN * max(np.trace(around), 1e-6 * moved[3, 3])
    moved[:3, :3] += max(wanted - float(np.linalg.eigvalsh(around)[0]), 0.0) * np.eye(3)
    return moved


def size_of(body: np.ndarray) -> float:
    """The radius of gyration of a body about its centre of mass, m."""
    inertia = _symmetric(central(body)[4:], ENTRIES)
    return float(np.sqrt(max(np.trace(inertia) / (2 * body[0]), 1e-12)))


def log_cholesky_chart(body: np.ndarray, mass: float) -> Callable[[np.ndarray], np.ndarray]:
    """z (10,) -> the ten parameters of a body that can exist; 0 is this body, 1 a change as large as itself.

    mass: of the robot, for a body without any.
    """
    start = thickened(pseudo_inertia(body), mass)
    factor = np.linalg.cholesky(start[::-1, ::-1])[::-1, ::-1]  # upper triangular, U U^T = P
    scale = factor[3, 3]
    diagonal, upper = np.diag(factor)[:3] / scale, np.triu_indices(4, 1)
    length = float(np.linalg.norm(diagonal))

    def chart(z: np.ndarray) -> np.ndarray:
        u = np.eye(4, dtype=z.dtype)
        u[range(3), range(3)] = diagonal * np.exp(z[1:4])
        u[upper] = factor[upper] / scale + length * z[4:]
        u = scale * np.exp(z[0]) * u
        return body_of(np.asarray(u @ u.T))

    return chart


def _symmetric(entries: np.ndarray, places: tuple[tuple[int, int], ...]) -> np.ndarray:
    matrix = np.empty((3, 3), dtype=entries.dtype)
    for value, (i, j) in zip(entries, places, strict=True):
        matrix[i, j] = matrix[j, i] = value
    return matrix


def _of_a_point(lever: np.ndarray) -> np.ndarray:
    """The inertia of a unit mass there."""
    return np.asarray((lever @ lever) * np.eye(3) - np.outer(lever, lever))


WEIGHT = 0.1  # of the divergence: it moves what the data show by this times standard error / value, in standard errors
_EXACT = 1e-7  # estimates count as no more exact than this times their size: keeps Newton's equations solvable
_RADIUS = 0.1  # m, of gyration of a link without inertia or extent, before it is identified
_POINT = 1e-5  # m, of gyration: a smaller link is a point, and may move no inertia
_STEPS = 60  # for each weight; data that no body explains may need more, and their distance is then an upper bound


@dataclass(frozen=True)
class Consistency:
    """The nearest parameters that real bodies can have.

    parameters: by name, of those that were looked for. vector (p,): all of pi.
    distance: how far the estimate had to move, in standard errors of the combination that moved most.
    moved: that combination. model_errors: what the residuals show that makes the intervals wrong. verdict: in words.
    """

    parameters: dict[str, float]
    vector: np.ndarray
    distance: float
    moved: str
    model_errors: tuple[str, ...] = ()

    @property
    def consistent(self) -> bool:
        """True if such bodies exist within three standard errors of the estimate, and no model error moves it more."""
        return self.distance < 3.0 and not self.model_errors

    @property
    def verdict(self) -> str:
        """The verdict on the distance, in words."""
        if self.model_errors:
            return f"not consistent, the model lacks something: {self.model_errors[0]}"
        if self.distance < 0.1:
            return "physically consistent"
        return f"the nearest bodies that can exist are {self.distance:.2g} standard errors away ({self.moved})"

    def __str__(self) -> str:
        return f"consistency: {self.verdict}"

    def to_dict(self) -> dict[str, Any]:
        """A record for JSON."""
        return {"consistent": self.consistent, "distance": self.distance, "moved": self.moved,
                "verdict": self.verdict, "parameters": self.parameters}  # fmt: skip

    def robot_of(self, robot: Robot) -> Robot:
        """The robot with these parameters; damping and friction go to its model's damping and dryFrictionLimit."""
        names, vector, before = robot.parameter_names, self.vector, robot.parameter_values

        def change(model: pin.Model) -> None:
            for j in range(1, model.njoints):
                body = slice(10 * (j - 1), 10 * j)
                if not np.array_equal(vector[body], before[body]):  # a body without mass has no centre of mass
                    model.inertias[j] = pin.Inertia.FromDynamicParameters(vector[body])
            drives = {"armature": np.array(model.armature), "damping": np.array(model.damping),
                      "friction": np.array(model.upperDryFrictionLimit)}  # fmt: skip
            for name in self.parameters:
                joint, _, kind = name.rpartition(".")
                if kind in drives:
                    drives[kind][model.idx_vs[model.getJointId(joint)]] = vector[names.index(name)]
            model.armature, model.damping, friction = drives.values()
            model.upperDryFrictionLimit, model.lowerDryFrictionLimit = friction, -friction

        found = robot.changed(change)
        found.weightless = weightless_joints(found.model) if robot.weightless else ()
        return found


def consistent(
    robot: Robot, chosen: Selection, combinations: tuple[str, ...], matrix: np.ndarray, estimate: np.ndarray,
    covariance: np.ndarray, metric: np.ndarray,
) -> Consistency:  # fmt: skip
    """The parameters theta that real bodies can have, nearest to the estimate of B theta (matrix (r, k)).

    covariance tells how far that is; metric, the inverse of the information, what is near.
    """
    floor = _EXACT * np.maximum(np.abs(estimate), np.abs(matrix) @ np.abs(chosen.nominal) + 1e-12)
    errors = np.sqrt(np.diag(covariance))
    inexact = metric + np.diag(np.maximum(floor**2 - np.diag(metric), 0.0))
    scale = np.sqrt(np.diag(inexact))
    values, vectors = np.linalg.eigh(inexact / np.outer(scale, scale))
    whiten = vectors.T / np.sqrt(np.maximum(values, 1e-12))[:, None] / scale
    domains = _domains(robot, chosen, np.abs(matrix.T) @ (np.abs(estimate) + errors))
    first = sum((domain.first for domain in domains), np.zeros(len(chosen.names)))
    theta = chosen.nominal + _newton(whiten @ matrix, whiten @ (estimate - matrix @ chosen.nominal), domains, first)
    of_joints = [name.rpartition(".")[2] in JOINT_PARAMETERS for name in chosen.names]
    theta = np.where(of_joints, np.maximum(theta, 0.0), theta)
    gaps = np.abs(matrix @ theta - estimate) / np.maximum(errors, floor)
    worst = int(np.argmax(gaps))
    named = dict(zip(chosen.names, theta.tolist(), strict=True))
    return Consistency(named, chosen.parameters(robot, theta), float(gaps[worst]), combinations[worst])


@dataclass(frozen=True)
class _Domain:
    """A matrix start + sum_k slopes[k] (theta_k - nominal_k) that has to be positive definite.

    inverse: of the matrix that is near, which is start but for links without inertia. first (k,): the change to it.
    """

    start: np.ndarray
    slopes: np.ndarray
    inverse: np.ndarray
    first: np.ndarray


def _domains(robot: Robot, chosen: Selection, sizes: np.ndarray) -> list[_Domain]:
    """The pseudo-inertias of the bodies that change, and the joints' parameters, which are not negative."""
    found = []
    pi = robot.parameter_values
    bodies = 10 * (robot.model.njoints - 1)
    for first in range(0, bodies, 10):
        slopes = np.stack([pseudo_inertia(column[first : first + 10]) for column in chosen.columns.T])
        if slopes.any():
            own, part = pi[first : first + 10], chosen.columns[first : first + 10]
            given = pseudo_inertia(own)
            start = near = thickened(given, robot.mass or 1.0)
            change = np.zeros(len(chosen.names))
            is_whole = np.linalg.matrix_rank(part) == len(part)
            if is_whole and (own[0] == 0 or np.abs(central(own)[4:]).max() < _POINT**2 * own[0]):
                mass = own[0] or (robot.mass or robot.nv) / robot.nv
                lacking = np.array([mass - own[0], 0, 0, 0, *(mass * _RADIUS**2 * np.array([1, 0, 1, 0, 0, 1]))])
                near, change = start + pseudo_inertia(lacking), np.linalg.pinv(part) @ lacking
            elif is_whole and np.abs(near - given).max() > 2 * _THIN * np.abs(given).max():  # no body has it
                start, change = given, np.linalg.pinv(part) @ (body_of(near) - own)
            found.append(_Domain(start, slopes, np.linalg.inv(near), change))
    for k, column in enumerate(chosen.columns.T):
        if column[bodies:].any():
            low, high = (max(float(chosen.nominal[k]), share * float(sizes[k]), 1e-12) for share in (1e-3, 1.0))
            unit, inverse = np.eye(len(chosen.names))[k], np.array([[1 / high]])
            found.append(_Domain(np.array([[low]]), unit[:, None, None], inverse, (high - low) * unit))
    return found


def _newton(matrix: np.ndarray, target: np.ndarray, domains: list[_Domain], first: np.ndarray) -> np.ndarray:
    """The minimum by Newton steps, with weights of the divergence that fall to the last one (path following)."""
    change = first
    weight = max(1.0, float(target @ target))
    while True:
        value = _objective(matrix, target, domains, change, weight)
        for _ in range(_STEPS):
            step, length = _step(matrix, target, domains, change, weight)
            trial = _objective(matrix, target, domains, change + length * step, weight)
            while trial > value and length > 1e-9:
                length /= 2
                trial = _objective(matrix, target, domains, change + length * step, weight)
            gain = value - trial
            if gain > 0:
                change, value = change + length * step, trial
            if gain <= 0.1 * weight:
                break
        if weight <= WEIGHT:
            return change
        weight = max(weight / 3, WEIGHT)


def _step(
    matrix: np.ndarray, target: np.ndarray, domains: list[_Domain], change: np.ndarray, weight: float
) -> tuple[np.ndarray, float]:
    """Newton's step by linear least squares, and how much of it goes at most 0.95 of the way to the boundary."""
    blocks, right = [matrix], [target - matrix @ change]
    for domain in domains:
        rows, left = _rows(domain, np.linalg.cholesky(_at(domain, change)))
        blocks.append(rows)
        right.append(left)
    weights = [1.0, *[np.sqrt(weight)] * len(domains)]
    system = np.vstack([w * block for w, block in zip(weights, blocks, strict=True)])
    scale = np.maximum(np.linalg.norm(system, axis=0), 1e-300)
    known = np.concatenate([w * part for w, part in zip(weights, right, strict=True)])
    step = np.linalg.lstsq(system / scale, known, rcond=None)[0] / scale
    least = min((_least(rows @ step) for rows in blocks[1:]), default=0.0)
    return np.asarray(step), min(1.0, 0.95 / max(-least, 1e-300))


def _least(entries: np.ndarray) -> float:
    """The least eigenvalue of a symmetric matrix in one row of entries."""
    size = round(len(entries) ** 0.5)
    return float(np.linalg.eigvalsh(entries.reshape(size, size))[0])


def _at(domain: _Domain, change: np.ndarray) -> np.ndarray:
    return domain.start + np.tensordot(change, domain.slopes, axes=1)


def _rows(domain: _Domain, factor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows R and gap g of the divergence's second-order model |R step - g|^2 / 2 at P = F F^T.

    Its Hessian is tr(P^-1 E_i P^-1 E_j) = R^T R with the columns vec(F^-1 E_i F^-T) in R, its gradient -R^T g with
    g = vec(1 - F^T P0^-1 F).
    """
    inner = np.linalg.inv(factor)
    rows = (inner @ domain.slopes @ inner.T).reshape(len(domain.slopes), -1).T
    return rows, (np.eye(len(factor)) - factor.T @ domain.inverse @ factor).ravel()


def _objective(
    matrix: np.ndarray, target: np.ndarray, domains: list[_Domain], change: np.ndarray, weight: float
) -> float:
    value = 0.5 * float(np.sum((matrix @ change - target) ** 2))
    for domain in domains:
        now = _at(domain, change)
        try:
            factor = np.linalg.cholesky(now)
        except np.linalg.LinAlgError:
            return np.inf
        value += weight * float(np.sum(domain.inverse * now) - 2 * np.sum(np.log(np.diag(factor))))
    return value
