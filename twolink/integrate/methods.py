"""The table of methods: what each is, what it is good for, and where it comes from. A new one adds no stepping code."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Literal

from twolink.errors import SceneError, nearest
from twolink.integrate.coefficients import (
    DOP853,
    ESDIRK,
    IMPLICIT_MIDPOINT,
    MIDPOINT,
    RK4,
    RK23,
    RK45,
    SUZUKI,
)
from twolink.integrate.tableau import Tableau
from twolink.io.listing import Table

ITERATIONS = 6  # of Newton's method a stage: from a guess within 1e-2 to rounding, as the matrix is kept for a step
Kind = Literal["semi-implicit", "explicit", "implicit", "taylor", "scipy"]


@dataclass(frozen=True)
class Method:
    """A method for x' = f(t, x).

    order: of its global error; a Taylor method takes the order its tolerance calls for. kind: how a step is made.
    adaptive: it chooses its steps by a tolerance; else the steps are all equal. tableau: of a Runge-Kutta method.
    solver: SciPy's class, of the methods that are SciPy's.
    """

    name: str
    order: int
    kind: Kind
    good_for: str
    source: str
    tableau: Tableau | None = None
    solver: str = ""

    @functools.cached_property
    def adaptive(self) -> bool:
        """Whether the method chooses its own steps."""
        return self.kind in ("taylor", "scipy") or bool(self.tableau and self.tableau.errors)

    @functools.cached_property
    def error_order(self) -> int:
        """The order that a step's error estimate behaves like, as h^order: two estimates go as their product does."""
        orders = self.tableau.error_orders if self.tableau else ()
        return sum(orders) if len(orders) == 2 else 1 + min(self.order, *orders, self.order)

    @functools.cached_property
    def evaluations(self) -> int:
        """Evaluations of f a step; of an implicit method with those of its iterations, but not of its Jacobian."""
        if self.tableau is None:
            return 1
        implicit = sum(d != 0.0 for d in self.tableau.diagonal)
        return len(self.tableau.b) - implicit + implicit * ITERATIONS + (self.tableau.diagonal[0] != 0.0)


_HAIRER = "Hairer, Norsett, Wanner: Solving Ordinary Differential Equations I"

METHODS: dict[str, Method] = {
    m.name: m
    for m in (
        Method(
            "semi-implicit-euler",
            1,
            "semi-implicit",
            "comparison with game and robot simulators, which use it",
            "v_new = v + h a(q, v), q_new = q + h v_new; Hairer, Lubich, Wanner: Geometric Numerical Integration, I.1",
        ),
        Method("midpoint", 2, "explicit", "teaching", f"Runge 1895; {_HAIRER}, II.1", MIDPOINT),
        Method("rk4", 4, "explicit", "fixed steps, and comparison with others' results", "Kutta 1901", RK4),
        Method("rk23", 3, "explicit", "rough accuracies, 1e-2", "Bogacki, Shampine: Appl. Math. Lett. 2 (1989)", RK23),
        Method(
            "rk45",
            5,
            "explicit",
            "accuracies of 1e-3 to 1e-5",
            "Dormand, Prince: J. Comp. Appl. Math. 6 (1980) 19-26",
            RK45,
        ),
        Method(
            "dop853",
            8,
            "explicit",
            "smooth scenes at 1e-5 and better, any robot",
            f"Dormand, Prince; {_HAIRER}, II.5",
            DOP853,
        ),
        Method(
            "implicit-midpoint",
            2,
            "implicit",
            "millions of steps: symmetric, no drift of energy in regular motion",
            "Hairer, Lubich, Wanner: Geometric Numerical Integration, II.1.4 and VI.4",
            IMPLICIT_MIDPOINT,
        ),
        Method(
            "suzuki4",
            4,
            "implicit",
            "millions of steps, more exactly: symmetric like its midpoint steps",
            "Suzuki: Phys. Lett. A 146 (1990) 319-323, of midpoint steps",
            SUZUKI,
        ),
        Method(
            "esdirk43",
            4,
            "implicit",
            "stiff scenes: hard springs and dampers (L-stable)",
            "ARK4(3)6L[2]SA of Kennedy, Carpenter: Appl. Numer. Math. 44 (2003) 139-181",
            ESDIRK,
        ),
        Method(
            "taylor",
            20,
            "taylor",
            "the highest accuracies, small robots; in quadruple precision on request",
            "Jorba, Zou: Exp. Math. 14 (2005) 99-117; Biscani, Izzo: MNRAS 504 (2021) 2614-2628 (heyoka)",
        ),
        Method("scipy-rk45", 5, "scipy", "a peer; any system", "SciPy", solver="RK45"),
        Method("scipy-dop853", 8, "scipy", "a peer; any system", "SciPy", solver="DOP853"),
        Method("scipy-lsoda", 12, "scipy", "a peer; stiff or not", "Petzold 1983 (ODEPACK), by SciPy", solver="LSODA"),
        Method(
            "scipy-radau",
            5,
            "scipy",
            "very stiff scenes, any robot",
            "Hairer, Wanner: Solving Ordinary Differential Equations II, IV.8, by SciPy",
            solver="Radau",
        ),
    )
}


def method_named(name: str, argument: str = "method") -> Method:
    """The method of this name. Raises SceneError with the nearest name for an unknown one."""
    if str(name) not in METHODS:
        raise SceneError(f"{name!r} is unknown", where="method", argument=argument,
                         remedy=nearest(str(name), ("auto", *METHODS)))  # fmt: skip
    return METHODS[str(name)]


def methods() -> Table:
    """The methods that simulate, as a table.

    Returns
    -------
    Table
        Columns name, order (of the global error), kind, adaptive (whether the method chooses its steps), good_for and
        source.
    """
    columns = ("name", "order", "kind", "adaptive", "good_for", "source")
    return Table(columns, tuple(tuple(getattr(method, name) for name in columns) for method in METHODS.values()))
