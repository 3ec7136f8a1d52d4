"""The two-link arm by hand: its queries on NumPy batches, as printed in the paper and as corrected.

The equations, their source and the erratum are in `formulas`.
"""

from dataclasses import dataclass
from typing import Any, get_args

import numpy as np
from numpy.typing import ArrayLike

from twolink.errors import QueryError, require_known
from twolink.lagrange import formulas
from twolink.lagrange.formulas import Pair, Square, Variant


@dataclass(frozen=True, eq=False)
class TwoLink:
    """The arm with its parameters, made and checked by `two_link`.

    Methods take angles theta, speeds dtheta [rad/s], accelerations ddtheta [rad/s^2] and torques [N m], each (..., 2)
    in the order shoulder, elbow. A result has the broadcast of the batch shapes of the arm and the states. States may
    be long double, or complex for derivatives by complex step.

    Attributes
    ----------
    lengths, masses : tuple of ndarray
        (l1, l2) [m] and (m1, m2) [kg], of the batch shape.
    g : ndarray
        Gravity [m/s^2], of the batch shape.
    variant : {"corrected", "printed"}
        Which equations.

    Raises
    ------
    QueryError
        By every method, for states that are not finite numbers of shape (..., 2), or whose batches do not broadcast.
    """

    lengths: tuple[np.ndarray, np.ndarray]
    masses: tuple[np.ndarray, np.ndarray]
    g: np.ndarray
    variant: Variant

    @property
    def batch(self) -> tuple[int, ...]:
        """The batch shape of the parameters, () for a single arm."""
        return np.shape(self.g)

    def mass_matrix(self, theta: ArrayLike) -> np.ndarray:
        """A(theta), (..., 2, 2) [kg m^2] (eqs 8-11), symmetric and positive definite."""
        return _matrix(formulas.mass_entries(self.lengths, self.masses, self._angles(theta), np))

    def velocity_products(self, theta: ArrayLike) -> np.ndarray:
        """B(theta), (..., 2, 2) [kg m^2], to multiply [td1 td2, td2 td1] (eqs 13, 14)."""
        return _matrix(formulas.product_entries(self.lengths, self.masses, self._angles(theta), np))

    def velocity_squares(self, theta: ArrayLike) -> np.ndarray:
        """C(theta), (..., 2, 2) [kg m^2], to multiply [td1^2, td2^2] (eqs 16-18; the erratum is here)."""
        return _matrix(formulas.square_entries(self.lengths, self.masses, self._angles(theta), np, self.variant))

    def gravity_torque(self, theta: ArrayLike) -> np.ndarray:
        """D(theta), (..., 2) [N m] (eqs 20, 21)."""
        return _vector(formulas.gravity_entries(self.lengths, self.masses, self.g, self._angles(theta), np))

    A, B, C, D = mass_matrix, velocity_products, velocity_squares, gravity_torque  # the paper's names

    def bias(self, theta: ArrayLike, dtheta: ArrayLike) -> np.ndarray:
        """h = B [td1 td2, td2 td1] + C [td1^2, td2^2] + D, (..., 2) [N m]: the torque for no acceleration."""
        angles, speeds = self._pairs(theta=theta, dtheta=dtheta)
        return _vector(self._bias(angles, speeds))

    def inverse_dynamics(self, theta: ArrayLike, dtheta: ArrayLike, ddtheta: ArrayLike) -> np.ndarray:
        """The torque A ddtheta + h, (..., 2) [N m], that gives the acceleration ddtheta [rad/s^2] (eq. 6)."""
        angles, speeds, (x1, x2) = self._pairs(theta=theta, dtheta=dtheta, ddtheta=ddtheta)
        h1, h2 = self._bias(angles, speeds)
        (a11, a12), (a21, a22) = formulas.mass_entries(self.lengths, self.masses, angles, np)
        return _vector((a11 * x1 + a12 * x2 + h1, a21 * x1 + a22 * x2 + h2))

    def forward_dynamics(self, theta: ArrayLike, dtheta: ArrayLike, torque: ArrayLike) -> np.ndarray:
        """The acceleration A^-1 (torque - h), (..., 2) [rad/s^2] (eq. 22), by Cramer's rule."""
        angles, speeds, (t1, t2) = self._pairs(theta=theta, dtheta=dtheta, torque=torque)
        h1, h2 = self._bias(angles, speeds)
        (a11, a12), (a21, a22) = formulas.mass_entries(self.lengths, self.masses, angles, np)
        r1, r2 = t1 - h1, t2 - h2
        det = formulas.mass_determinant(self.lengths, self.masses, angles, np)
        return _vector(((a22 * r1 - a12 * r2) / det, (a11 * r2 - a21 * r1) / det))

    def energy(self, theta: ArrayLike, dtheta: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """(kinetic dtheta.A.dtheta / 2, potential), (...,) each [J]; potential zero at shoulder height."""
        angles, (w1, w2) = self._pairs(theta=theta, dtheta=dtheta)
        (a11, a12), (_, a22) = formulas.mass_entries(self.lengths, self.masses, angles, np)
        kinetic = (a11 * w1 * w1 + 2 * a12 * w1 * w2 + a22 * w2 * w2) / 2
        potential = formulas.potential_entry(self.lengths, self.masses, self.g, angles, np)
        kinetic, potential = np.broadcast_arrays(kinetic, potential)
        return kinetic.copy(), potential.copy()

    def _angles(self, theta: ArrayLike) -> Pair:
        return self._pairs(theta=theta)[0]

    def _bias(self, angles: Pair, speeds: Pair) -> Pair:
        (b11, b12), (b21, b22) = formulas.product_entries(self.lengths, self.masses, angles, np)
        (c11, c12), (c21, c22) = formulas.square_entries(self.lengths, self.masses, angles, np, self.variant)
        d1, d2 = formulas.gravity_entries(self.lengths, self.masses, self.g, angles, np)
        w1, w2 = speeds
        w12, w11, w22 = w1 * w2, w1 * w1, w2 * w2
        return (b11 + b12) * w12 + c11 * w11 + c12 * w22 + d1, (b21 + b22) * w12 + c21 * w11 + c22 * w22 + d2

    def _pairs(self, **states: ArrayLike) -> list[Pair]:
        """Check the states by name and split each (..., 2) into its two components."""
        arrays = {name: _numbers(value, name, "iufc") for name, value in states.items()}
        for name, array in arrays.items():
            if array.ndim == 0 or array.shape[-1] != 2:
                what, remedy = f"expected shape (..., 2), got {array.shape}", "the last axis is (shoulder, elbow)"
                raise QueryError(what, argument=name, remedy=remedy)
        _broadcast({"the arm's parameters": self.batch} | {name: a.shape[:-1] for name, a in arrays.items()})
        return [(array[..., 0], array[..., 1]) for array in arrays.values()]


def two_link(
    lengths: tuple[ArrayLike, ArrayLike],
    masses: tuple[ArrayLike, ArrayLike],
    g: ArrayLike = 9.81,
    variant: Variant = "corrected",
) -> TwoLink:
    """The arm of two uniform rods with these parameters.

    Parameters
    ----------
    lengths, masses : pair of array_like
        (l1, l2) [m] and (m1, m2) [kg]; each a positive number or a batch.
    g : array_like
        Gravity [m/s^2].
    variant : {"corrected", "printed"}
        "printed" reproduces the paper's C, with C21 = 0 and C22 = -C12 instead of C21 = -C12 and C22 = 0. Its energy
        is not constant without torques (see `formulas`); it exists to show that, not to be used.

    Returns
    -------
    TwoLink
        The arm, or a batch of arms.

    Raises
    ------
    QueryError
        A parameter is not finite or not positive, the batches do not broadcast, or the variant is unknown.
    """
    what = "expected 'corrected' or 'printed', got {!r}"
    require_known(variant, get_args(Variant), QueryError, what, argument="variant")
    parameters: dict[str, Any] = {}
    for name, value in (("lengths", lengths), ("masses", masses)):
        try:
            parameters[f"{name[0]}1"], parameters[f"{name[0]}2"] = value
        except (TypeError, ValueError):
            what = f"expected the pair ({name[0]}1, {name[0]}2), got {value!r:.60}"
            raise QueryError(what, argument=name) from None
    arrays = {name: _numbers(value, name, "iuf") for name, value in {**parameters, "g": g}.items()}
    for name in parameters:
        if not np.all(arrays[name] > 0):
            raise QueryError(f"expected a positive number, got {arrays[name].min()}", argument=name)
    shape = _broadcast({name: array.shape for name, array in arrays.items()})
    # [()] turns an array without axes into a scalar, on which NumPy computes much faster
    l1, l2, m1, m2, g = (np.broadcast_to(array, shape)[()] for array in arrays.values())
    return TwoLink((l1, l2), (m1, m2), g, variant)


def _numbers(value: ArrayLike, name: str, kinds: str) -> np.ndarray:
    """A finite copy of `value` in double precision or wider (long double and complex stay what they are)."""
    try:
        array = np.array(value)
    except ValueError:
        raise QueryError("expected a rectangular array, got rows of unequal length", argument=name) from None
    if array.dtype.kind not in kinds:
        raise QueryError(f"expected numbers, got {array.dtype} {value!r}", argument=name)
    if not np.all(np.isfinite(array)):
        at = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        place = f" at index {at}" if at else ""
        raise QueryError(f"expected finite numbers, got {array[at]}{place}", argument=name)
    return array.astype(np.result_type(array, float), copy=False)


def _broadcast(shapes: dict[str, tuple[int, ...]]) -> tuple[int, ...]:
    """The common batch shape. Raises QueryError that names all shapes."""
    try:
        return np.broadcast_shapes(*shapes.values())
    except ValueError:
        listed = ", ".join(f"{name} {shape}" for name, shape in shapes.items())
        raise QueryError(f"batch shapes do not broadcast: {listed}", argument=next(reversed(shapes))) from None


def _vector(entries: tuple[Any, ...]) -> np.ndarray:
    return np.stack(np.broadcast_arrays(*entries), axis=-1)


def _matrix(entries: Square) -> np.ndarray:
    flat = _vector((*entries[0], *entries[1]))
    return flat.reshape(*flat.shape[:-1], 2, 2)
