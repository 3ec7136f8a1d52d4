"""The two-link arm derived by machine: Euler-Lagrange with SymPy, from nothing but where each rod is.

Third witness beside the hand derivation (`formulas`) and Pinocchio. It starts from the positions of the rods'
centres and the inertia of a uniform rod, itself integrated along the rod, and uses no hand-made formula:

    T = sum of m |dc/dt|^2 / 2 + I omega^2 / 2,    V = sum of m g (height of c),    I = m l^2 / 12
    torque_i = d/dt (dT/dtd_i) - dT/dtheta_i + dV/dtheta_i                              (Euler-Lagrange)

which is then sorted by ddtheta, td1 td2, td1^2, td2^2 and the rest, like eq. 6 of the paper. SymPy is
imported here only, and only when a function is called. Symbols: l1 l2 [m], m1 m2 [kg], g [m/s^2], theta1
theta2 [rad].
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from twolink.lagrange import formulas

if TYPE_CHECKING:
    import sympy

Array: TypeAlias = NDArray[Any]
PARAMETERS = "l1 l2 m1 m2 g"
ENTRIES = ("A11", "A12", "A21", "A22", "B11+B12", "B21+B22", "C11", "C12", "C21", "C22", "D1", "D2")


@dataclass(frozen=True)
class Equations:
    """torque = A ddtheta + B td1 td2 + C [td1^2, td2^2] + D, as SymPy matrices.

    A (2, 2), C (2, 2) [kg m^2] and D (2, 1) [N m] are the paper's; B (2, 1) [kg m^2] holds the SUMS of the
    rows of the paper's B, because both its columns multiply td1 td2 and no motion can tell them apart.
    """

    A: sympy.Matrix
    B: sympy.Matrix
    C: sympy.Matrix
    D: sympy.Matrix

    def entries(self) -> dict[str, sympy.Expr]:
        """Every entry by its name in ENTRIES."""
        return dict(zip(ENTRIES, [*self.A, *self.B, *self.C, *self.D], strict=True))


@dataclass(frozen=True)
class Verdict:
    """One entry of the hand-derived equations minus the derived one: "0" when symbolically equal."""

    entry: str
    corrected: str
    printed: str


@dataclass(frozen=True)
class Numeric:
    """The derived equations on NumPy: parameters (l1, l2, m1, m2, g) and states may be batches."""

    functions: dict[str, Callable[..., Any]]

    def entries(self, parameters: tuple[Array, ...], theta: Array) -> dict[str, Array]:
        """Every entry by its name in ENTRIES, each (...,), at theta (..., 2)."""
        arguments = (*parameters, theta[..., 0], theta[..., 1])
        shape = np.broadcast_shapes(*(np.shape(x) for x in arguments))
        return {name: np.broadcast_to(f(*arguments), shape) for name, f in self.functions.items()}

    def inverse_dynamics(self, parameters: tuple[Array, ...], theta: Array, dtheta: Array, ddtheta: Array) -> Array:
        """The torque, (..., 2) [N m], for the acceleration ddtheta (..., 2) [rad/s^2]."""
        mass, bias = self._mass_and_bias(parameters, theta, dtheta)
        return np.asarray((mass @ ddtheta[..., None])[..., 0] + bias)

    def forward_dynamics(self, parameters: tuple[Array, ...], theta: Array, dtheta: Array, torque: Array) -> Array:
        """The acceleration, (..., 2) [rad/s^2], by LAPACK: not the closed form of `TwoLink`."""
        mass, bias = self._mass_and_bias(parameters, theta, dtheta)
        return np.asarray(np.linalg.solve(mass, (torque - bias)[..., None])[..., 0])

    def _mass_and_bias(self, parameters: tuple[Array, ...], theta: Array, dtheta: Array) -> tuple[Array, Array]:
        e = self.entries(parameters, theta)
        w1, w2 = dtheta[..., 0], dtheta[..., 1]
        rows = [e[f"B{i}1+B{i}2"] * w1 * w2 + e[f"C{i}1"] * w1**2 + e[f"C{i}2"] * w2**2 + e[f"D{i}"] for i in (1, 2)]
        mass = np.stack([e["A11"], e["A12"], e["A21"], e["A22"]], axis=-1)
        return mass.reshape(*mass.shape[:-1], 2, 2), np.stack(rows, axis=-1)


def energies(theta: sympy.Matrix, speed: sympy.Matrix) -> tuple[sympy.Expr, sympy.Expr]:
    """Kinetic and potential energy of the arm as SymPy expressions of theta and speed, (2, 1) each."""
    import sympy as sp

    l1, l2, m1, m2, g = _symbols()
    s = sp.Symbol("s", real=True)
    elbow = sp.Matrix([l1 * sp.cos(theta[0]), l1 * sp.sin(theta[0])])
    along = sp.Matrix([sp.cos(theta[0] + theta[1]), sp.sin(theta[0] + theta[1])])
    rods = [(m1, l1, elbow / 2, speed[0]), (m2, l2, elbow + along * l2 / 2, speed[0] + speed[1])]
    kinetic = potential = sp.Integer(0)
    for mass, length, centre, turning in rods:
        inertia = sp.integrate(mass / length * s**2, (s, -length / 2, length / 2))
        velocity = centre.jacobian(theta) * speed
        kinetic += mass * velocity.dot(velocity) / 2 + inertia * turning**2 / 2
        potential += mass * g * centre[1]
    return kinetic, potential


@cache
def derive() -> Equations:
    """A, B, C, D from the energies by Euler-Lagrange (about a second; kept after the first call)."""
    import sympy as sp

    theta = sp.Matrix(sp.symbols("theta1 theta2", real=True))
    speed = sp.Matrix(sp.symbols("td1 td2", real=True))
    kinetic, potential = energies(theta, speed)
    momentum = sp.Matrix([kinetic]).jacobian(speed).T
    mass = momentum.jacobian(speed)
    bias = momentum.jacobian(theta) * speed - sp.Matrix([kinetic]).jacobian(theta).T
    products = [sp.diff(h, speed[0], speed[1]) for h in bias]
    squares = [sp.diff(h, w, 2) / 2 for h in bias for w in speed]
    weight = sp.Matrix([potential]).jacobian(theta).T
    sorted_by_motion = mass, sp.Matrix(products), sp.Matrix(2, 2, squares), weight
    return Equations(*(matrix.applyfunc(_normal) for matrix in sorted_by_motion))


def symbolic(variant: formulas.Variant) -> Equations:
    """The hand-derived equations: the lines of `formulas` that NumPy runs, run on symbols."""
    import sympy as sp

    l1, l2, m1, m2, g = _symbols()
    arm = (l1, l2), (m1, m2)
    theta = sp.symbols("theta1 theta2", real=True)
    products = [first + second for first, second in formulas.product_entries(*arm, theta, sp)]
    squares = formulas.square_entries(*arm, theta, sp, variant)
    weight = formulas.gravity_entries(*arm, g, theta, sp)
    mass = formulas.mass_entries(*arm, theta, sp)
    return Equations(sp.Matrix(mass), sp.Matrix(products), sp.Matrix(squares), sp.Matrix(weight))


def compare() -> tuple[Verdict, ...]:
    """Hand minus machine for every entry of ENTRIES; "0" means equal for all arms and states."""
    derived = derive().entries()
    corrected, printed = symbolic("corrected").entries(), symbolic("printed").entries()

    def difference(hand: dict[str, Any], name: str) -> str:
        return str(_normal(hand[name] - derived[name]))

    return tuple(Verdict(name, difference(corrected, name), difference(printed, name)) for name in ENTRIES)


def numeric() -> Numeric:
    """The derived equations as NumPy functions."""
    import sympy as sp

    arguments = [*_symbols(), *sp.symbols("theta1 theta2", real=True)]
    entries = derive().entries().items()
    return Numeric({name: sp.lambdify(arguments, entry, "numpy") for name, entry in entries})


def _symbols() -> tuple[Any, ...]:
    import sympy as sp

    return tuple(sp.symbols(PARAMETERS, positive=True))


def _normal(expression: Any) -> Any:
    """Turn products of sines and cosines into sums: a normal form, in which only 0 equals 0."""
    import sympy as sp
    from sympy.simplify.fu import TR8

    return sp.expand(TR8(sp.expand(expression)))
