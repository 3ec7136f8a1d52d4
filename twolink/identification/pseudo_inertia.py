"""Pseudo-inertias of bodies, and charts of those that can exist.

A body with mass density rho >= 0 has the pseudo-inertia P = integral of (x, 1)(x, 1)^T rho dV, positive semidefinite,
and linear in its ten parameters (Wensing, Kim and Slotine 2018). With P = U U^T,

    U = e^alpha [e^d1 s12 s13 t1; 0 e^d2 s23 t2; 0 0 e^d3 t3; 0 0 0 1],

any ten numbers (alpha, d, s, t) are a body that can exist (Rucker and Wensing 2022, log-Cholesky parameters).

The functions take complex numbers too, so that derivatives are complex steps.
"""

from collections.abc import Callable

import numpy as np

from twolink.algorithms.spatial import ENTRIES

_THIN = 1e-6  # thin rods and point masses are allowed: P may lack this share of its second moments
# Entries of the inertia in robot.parameter_names: xx, xy, yy, xz, yz, zz.
_ORIGIN = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))


def pseudo_inertia(body: np.ndarray) -> np.ndarray:
    """P (4, 4) of the ten parameters (`dynamics.regressors.BODY_PARAMETERS`): second and first moment, mass."""
    inertia, first = _symmetric(body[4:], _ORIGIN), body[1:4, None]
    second = np.trace(inertia) / 2 * np.eye(3) - inertia
    return np.asarray(np.block([[second, first], [first.T, body[:1, None]]]))


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
