"""The table of methods, read from methods.toml, and their Butcher tableaus. A new Runge-Kutta method is an entry there.

    k_i = f(t + c_i h, x + h sum_j a_ij k_j),    x_new = x + h sum_i b_i k_i

The tests prove the orders by the conditions of all rooted trees.
"""

import functools
import math
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Literal

from twolink.errors import SceneError, nearest, shown
from twolink.io.text import Table

ITERATIONS = 6  # of Newton's method a stage: from a guess within 1e-2 to rounding, as the matrix is kept for a step
Kind = Literal["semi-implicit", "explicit", "implicit", "taylor", "scipy"]


Row = tuple[float, ...]


@dataclass(frozen=True)
class Tableau:
    """Rows `a` up to the diagonal (explicit methods: below it), weights `b`, nodes `c`, order.

    errors: weights e whose sum h sum_i e_i k_i estimates the error of a step, being the difference to a method of the
    order named beside it in error_orders; none for a method of fixed steps.
    """

    a: tuple[Row, ...]
    b: Row
    order: int
    errors: tuple[Row, ...] = ()
    error_orders: tuple[int, ...] = ()

    @functools.cached_property
    def c(self) -> Row:
        """The nodes: the sums of the rows, as for every method that treats t like a state."""
        return tuple(math.fsum(row) for row in self.a)

    @functools.cached_property
    def diagonal(self) -> Row:
        """a_ii of each stage; 0 where the stage is explicit."""
        return tuple(row[i] if len(row) > i else 0.0 for i, row in enumerate(self.a))


def tableau_of(
    order: int,
    a: Sequence[Sequence[float | str]],
    b: Sequence[float | str],
    errors: Sequence[Sequence[float | str]] = (),
    embedded: Sequence[Sequence[float | str]] = (),
    error_orders: Sequence[int] = (),
) -> Tableau:
    """A tableau from coefficients that are numbers or fractions as texts; embedded: weights b - e in place of e."""
    weights = [Fraction(w) for w in b]
    estimates = [[Fraction(e) for e in row] for row in errors]
    estimates += [[w - Fraction(e) for w, e in zip(weights, row, strict=True)] for row in embedded]
    return Tableau(
        tuple(tuple(float(Fraction(x)) for x in row) for row in a),
        tuple(map(float, weights)),
        order,
        tuple(tuple(map(float, row)) for row in estimates),
        tuple(error_orders),
    )


@dataclass(frozen=True)
class Method:
    """A method for x' = f(t, x).

    Parameters
    ----------
    name : str
    order : int
        Of the global error; a Taylor method takes the order that its tolerance calls for.
    kind : str
        How a step is made.
    good_for, source : str
        What it is good for, and where it comes from.
    tableau : Tableau, optional
        Of a Runge-Kutta method.
    solver : str
        SciPy's class, of the methods that are SciPy's.
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
        """True if the method chooses its own steps."""
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


def _load() -> dict[str, Method]:
    """The methods by name, from methods.toml."""
    table = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
    methods = {}
    for name, entry in table.items():
        rows = entry.pop("tableau", None)
        tableau = None if rows is None else tableau_of(entry["order"], **rows)
        methods[name] = Method(name, **entry, tableau=tableau)
    return methods


METHODS = _load()
ELSEWHERE = {"ode45": "rk45", "ode23": "rk23", "ode15s": "esdirk43", "ode113": "dop853", "RK4": "rk4",
             "RK45": "rk45", "RK23": "rk23", "DOP853": "dop853", "Euler": "semi-implicit-euler"}  # fmt: skip
"""Names in MATLAB, SciPy and MuJoCo: the same formula here, or of ode15s and ode113 the method for the same purpose."""


def method_named(name: str, argument: str = "method") -> Method:
    """The method of this name, or of one of `ELSEWHERE`. Raises SceneError with the nearest for an unknown one."""
    ours = ELSEWHERE.get(str(name), str(name))
    if ours not in METHODS:
        raise SceneError(f"{shown(name)} is unknown", where="method", argument=argument,
                         remedy=nearest(ours, ("auto", *METHODS)))  # fmt: skip
    return METHODS[ours]


def known_as(name: str) -> str:
    """Of a name from elsewhere, for the note of a run: how it is meant here; "" for ours."""
    other = ", which is not here: this has the same purpose" if name in ("ode15s", "ode113") else ""
    return f" as {name}{other}" if name in ELSEWHERE else ""


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
