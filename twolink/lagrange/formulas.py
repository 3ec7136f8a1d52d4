"""The formulas of the two-link arm of Umar and Abu Bakar, derived by hand: as printed and as corrected.

Source: S. N. H. Umar and E. Abu Bakar, "Study on Trajectory Motion and Computational Analysis of Robot
Manipulator", eqs 6-22; cited below by their numbers.

Two uniform rods move in a vertical plane about two hinges, the shoulder and the elbow. theta1 is measured
from the horizontal, theta2 from rod 1, both positive upwards; gravity g acts downwards. Lengths l [m],
masses m [kg], g [m/s^2], theta [rad], torque [N m]; td = dtheta/dt, s2 = sin(theta2):

    torque = A(theta) ddtheta + B(theta) [td1 td2, td2 td1] + C(theta) [td1^2, td2^2] + D(theta)    (eq. 6)

Each formula stands here and nowhere else, in plain arithmetic over a namespace `xp` with sin and cos: NumPy
evaluates it for `TwoLink`, and SymPy reads the very same line for `derive`.

Erratum. The paper prints the second row of C as (0, -C12); Euler-Lagrange gives (-C12, 0): the elbow feels
the square of the SHOULDER's speed. As printed, the arm makes energy out of nothing: its energy E changes,
with no torque applied, at the rate

    dE/dt = (1/2) m2 l1 l2 s2 td2 (td1^2 - td2^2)       instead of 0.

Everything else in A, B, C and D is right, and of B only the sum of each row can be observed, because both its
columns multiply td1 td2.
"""

from typing import Any, Literal, TypeAlias

Variant = Literal["corrected", "printed"]
Pair: TypeAlias = tuple[Any, Any]
Square: TypeAlias = tuple[Pair, Pair]


def mass_entries(lengths: Pair, masses: Pair, theta: Pair, xp: Any) -> Square:
    """The mass matrix A [kg m^2] (eqs 8-11)."""
    (l1, l2), (m1, m2), c2 = lengths, masses, xp.cos(theta[1])
    a22 = m2 * l2 * l2 / 3
    a12 = a22 + m2 * l1 * l2 * c2 / 2
    a11 = (m1 / 3 + m2) * l1 * l1 + a22 + m2 * l1 * l2 * c2
    return (a11, a12), (a12, a22)


def mass_determinant(lengths: Pair, masses: Pair, theta: Pair, xp: Any) -> Any:
    """det A = l1^2 l2^2 m2 (4 m1 + 3 m2 + 9 m2 s2^2) / 36 [kg^2 m^4].

    A sum of positive terms: A is positive definite for every theta, and nothing cancels, as it would in
    A11 A22 - A12^2.
    """
    (l1, l2), (m1, m2), s2 = lengths, masses, xp.sin(theta[1])
    return (l1 * l2) ** 2 * m2 * (4 * m1 + 3 * m2 + 9 * m2 * s2 * s2) / 36


def product_entries(lengths: Pair, masses: Pair, theta: Pair, xp: Any) -> Square:
    """B [kg m^2], to multiply [td1 td2, td2 td1]: the Coriolis torque (eqs 13, 14; there "centripetal")."""
    return (-masses[1] * lengths[0] * lengths[1] * xp.sin(theta[1]), 0), (0, 0)


def square_entries(lengths: Pair, masses: Pair, theta: Pair, xp: Any, variant: Variant) -> Square:
    """C [kg m^2], to multiply [td1^2, td2^2]: the centripetal torque (eqs 16-18; there "Coriolis")."""
    c12 = -masses[1] * lengths[0] * lengths[1] * xp.sin(theta[1]) / 2
    return ((0, c12), (-c12, 0)) if variant == "corrected" else ((0, c12), (0, -c12))


def gravity_entries(lengths: Pair, masses: Pair, g: Any, theta: Pair, xp: Any) -> Pair:
    """D [N m], the torque that holds the arm still against gravity (eqs 20, 21)."""
    (l1, l2), (m1, m2) = lengths, masses
    d2 = m2 * g * l2 * xp.cos(theta[0] + theta[1]) / 2
    return (m1 / 2 + m2) * g * l1 * xp.cos(theta[0]) + d2, d2


def potential_entry(lengths: Pair, masses: Pair, g: Any, theta: Pair, xp: Any) -> Any:
    """The potential energy [J], zero at shoulder height: weight times the height of each rod's centre."""
    (l1, l2), (m1, m2) = lengths, masses
    return (m1 / 2 + m2) * g * l1 * xp.sin(theta[0]) + m2 * g * l2 * xp.sin(theta[0] + theta[1]) / 2
