"""The two-link arm derived by SymPy: Euler-Lagrange, from the positions of the rods alone.

A third derivation beside the one by hand (`formulas`) and Pinocchio. It starts from the positions of the rods' centres
and the inertia of a uniform rod, which is itself integrated along the rod, and uses no formula made by hand:

    T = sum of m |dc/dt|^2 / 2 + I omega^2 / 2,    V = sum of m g (height of c),    I = m l^2 / 12
    torque_i = d/dt (dT/dtd_i) - dT/dtheta_i + dV/dtheta_i                              (Euler-Lagrange)

which is then sorted by ddtheta, td1 td2, td1^2, td2^2 and the remainder, like eq. 6 of the paper. Only `check` imports
this module, and with it SymPy. Symbols: l1 l2 [m], m1 m2 [kg], g [m/s^2], theta1 theta2 [rad].
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import sympy as sp
from sympy.simplify.fu import TR8

from twolink.lagrange import formulas

ENTRIES = ("A11", "A12", "A21", "A22", "B11+B12", "B21+B22", "C11", "C12", "C21", "C22", "D1", "D2")
PARAMETERS = sp.symbols("l1 l2 m1 m2 g", positive=True)
THETA = sp.Matrix(sp.symbols("theta1 theta2", real=True))
SPEED = sp.Matrix(sp.symbols("td1 td2", real=True))


@dataclass(frozen=True)
class ArmEquations:
    """torque = A ddtheta + B td1 td2 + C [td1^2, td2^2] + D, as SymPy matrices.

    A (2, 2), C (2, 2) [kg m^2] and D (2, 1) [N m] are the paper's; B (2, 1) [kg m^2] holds the SUMS of the
    rows of the paper's B, because both its columns multiply td1 td2 and no motion can tell them apart.
    """

    A: sp.Matrix
    B: sp.Matrix
    C: sp.Matrix
    D: sp.Matrix

    def entries(self) -> dict[str, sp.Expr]:
        """Every entry by its name in ENTRIES."""
        return dict(zip(ENTRIES, [*self.A, *self.B, *self.C, *self.D], strict=True))


def energies(theta: sp.Matrix, speed: sp.Matrix) -> tuple[sp.Expr, sp.Expr]:
    """Kinetic and potential energy of the arm as SymPy expressions of theta and speed, (2, 1) each."""
    l1, l2, m1, m2, g = PARAMETERS
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
def derive() -> ArmEquations:
    """A, B, C, D from the energies by Euler-Lagrange (about a second; kept after the first call)."""
    kinetic, potential = energies(THETA, SPEED)
    momentum = sp.Matrix([kinetic]).jacobian(SPEED).T
    mass = momentum.jacobian(SPEED)
    bias = momentum.jacobian(THETA) * SPEED - sp.Matrix([kinetic]).jacobian(THETA).T
    products = [sp.diff(h, SPEED[0], SPEED[1]) for h in bias]
    squares = [sp.diff(h, w, 2) / 2 for h in bias for w in SPEED]
    weight = sp.Matrix([potential]).jacobian(THETA).T
    sorted_by_motion = mass, sp.Matrix(products), sp.Matrix(2, 2, squares), weight
    return ArmEquations(*(matrix.applyfunc(_normal) for matrix in sorted_by_motion))


def symbolic(variant: formulas.Variant) -> ArmEquations:
    """The hand-derived equations: the lines of `formulas` that NumPy runs, run on symbols."""
    l1, l2, m1, m2, g = PARAMETERS
    arm, theta = ((l1, l2), (m1, m2)), tuple(THETA)
    products = [first + second for first, second in formulas.product_entries(*arm, theta, sp)]
    squares = formulas.square_entries(*arm, theta, sp, variant)
    weight = formulas.gravity_entries(*arm, g, theta, sp)
    mass = formulas.mass_entries(*arm, theta, sp)
    return ArmEquations(sp.Matrix(mass), sp.Matrix(products), sp.Matrix(squares), sp.Matrix(weight))


def compare() -> dict[str, tuple[str, str]]:
    """The equations by hand, (corrected, printed), minus the derived ones for every entry of ENTRIES.

    "0" means equal for all arms and states.
    """
    derived, corrected, printed = derive().entries(), symbolic("corrected").entries(), symbolic("printed").entries()
    return {
        name: (str(_normal(corrected[name] - entry)), str(_normal(printed[name] - entry)))
        for name, entry in derived.items()
    }


def evaluate(parameters: Sequence[np.ndarray], theta: np.ndarray) -> tuple[np.ndarray, ...]:
    """The derived equations on NumPy.

    Parameters
    ----------
    parameters : sequence of ndarray
        (l1, l2, m1, m2, g), (n,) each, in SI units.
    theta : ndarray
        The angles (n, 2) [rad].

    Returns
    -------
    tuple of ndarray
        A (n, 2, 2), B (n, 2), the sums of the rows, C (n, 2, 2) and D (n, 2).
    """
    functions = [sp.lambdify([*PARAMETERS, *THETA], entry, "numpy") for entry in derive().entries().values()]
    flat = np.column_stack([np.broadcast_to(f(*parameters, *theta.T), len(theta)) for f in functions])
    return flat[:, :4].reshape(-1, 2, 2), flat[:, 4:6], flat[:, 6:10].reshape(-1, 2, 2), flat[:, 10:]


def _normal(expression: Any) -> Any:
    """Products of sines and cosines as sums: a normal form, in which only 0 equals 0."""
    return sp.expand(TR8(sp.expand(expression)))
