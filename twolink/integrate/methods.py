"""The table of methods: what each is, and what it is good for. For now SciPy's, around any right-hand side."""

from __future__ import annotations

from dataclasses import dataclass

from twolink.errors import SceneError, nearest


@dataclass(frozen=True)
class Method:
    """A method for x' = f(t, x): its name, order and kind, SciPy's class for it, and its source."""

    name: str
    order: int
    kind: str
    solver: str
    good_for: str
    source: str


METHODS: dict[str, Method] = {
    m.name: m
    for m in (
        Method(
            "dop853",
            8,
            "explicit Runge-Kutta",
            "DOP853",
            "smooth scenes at accuracies of 1e-6 and better",
            "Hairer, Norsett, Wanner: Solving Ordinary Differential Equations I, sec. II.5",
        ),
        Method(
            "rk45",
            5,
            "explicit Runge-Kutta",
            "RK45",
            "smooth scenes at accuracies of 1e-3",
            "Dormand, Prince: J. Comp. Appl. Math. 6 (1980) 19-26",
        ),
        Method(
            "radau",
            5,
            "implicit Runge-Kutta",
            "Radau",
            "stiff scenes",
            "Hairer, Wanner: Solving Ordinary Differential Equations II, sec. IV.8",
        ),
    )
}


def method_named(name: str) -> Method:
    """The method of this name; "auto" is the one for smooth scenes at high accuracy."""
    key = "dop853" if name == "auto" else str(name)
    if key not in METHODS:
        raise SceneError(f"{name!r} is unknown", where="method", remedy=nearest(str(name), ("auto", *METHODS)))
    return METHODS[key]
