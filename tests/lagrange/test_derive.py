"""The derivation by SymPy: complete, equal to the corrected arm, and different from the printed one."""

from __future__ import annotations

from typing import Any

import pytest
import sympy as sp
from sympy.simplify.fu import TR8

from tests.command import printed_by
from twolink.lagrange import derive, formulas
from twolink.lagrange.derive import PARAMETERS, SPEED, THETA

LENGTHS, MASSES = PARAMETERS[:2], PARAMETERS[2:4]


def normal(expression: Any) -> Any:
    """Products of sines and cosines as sums, in which only 0 equals 0."""
    return sp.expand(TR8(sp.expand(expression)))


def test_the_sorted_equations_are_the_whole_of_euler_lagrange() -> None:
    """Differentiate along the motion with real functions of time: nothing may be left over."""
    t = sp.Symbol("t")
    motion = sp.Matrix([sp.Function("f")(t), sp.Function("g")(t)])
    kinetic, potential = derive.energies(THETA, SPEED)
    put = dict(zip([*THETA, *SPEED], [*motion, *motion.diff(t)], strict=True))
    e = derive.derive()
    w1, w2 = motion.diff(t)
    ordered = e.A * motion.diff(t, 2) + e.B * w1 * w2 + e.C * sp.Matrix([w1**2, w2**2]) + e.D
    for i in range(2):
        momentum = kinetic.diff(SPEED[i]).subs(put)
        direct = momentum.diff(t) - kinetic.diff(THETA[i]).subs(put) + potential.diff(THETA[i]).subs(put)
        assert normal((direct - ordered[i].subs(put)).doit()) == 0


def test_corrected_is_equal_in_every_entry_and_printed_in_all_but_two() -> None:
    differences = derive.compare()
    assert tuple(differences) == derive.ENTRIES
    assert {corrected for corrected, _ in differences.values()} == {"0"}
    wrong = {name: sp.sympify(printed) for name, (_, printed) in differences.items() if printed != "0"}
    l1, l2, m2, theta2 = sp.symbols("l1 l2 m2 theta2")
    missing = m2 * l1 * l2 * sp.sin(theta2) / 2
    assert set(wrong) == {"C21", "C22"}
    assert sp.expand(wrong["C21"] + missing) == 0
    assert sp.expand(wrong["C22"] - missing) == 0


def test_a_wrong_formula_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    right = formulas.gravity_entries
    monkeypatch.setattr(formulas, "gravity_entries", lambda *a: (right(*a)[0], 2 * right(*a)[1]))
    assert [name for name, (corrected, _) in derive.compare().items() if corrected != "0"] == ["D2"]


def test_the_closed_determinant_is_that_of_the_mass_matrix() -> None:
    closed = formulas.mass_determinant(LENGTHS, MASSES, tuple(THETA), sp)
    assert normal(closed - derive.derive().A.det()) == 0


def test_the_potential_of_the_formulas_is_the_derived_one() -> None:
    formula = formulas.potential_entry(LENGTHS, MASSES, PARAMETERS[4], tuple(THETA), sp)
    assert normal(formula - derive.energies(THETA, SPEED)[1]) == 0


def test_the_arm_loads_where_sympy_cannot_be_imported() -> None:
    code = "import sys; sys.modules['sympy'] = None; import twolink.lagrange"
    assert printed_by(code) == ""
