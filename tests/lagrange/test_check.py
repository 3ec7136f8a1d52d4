"""The check passes on the equations as they are, and fails on each error that is put in."""

from __future__ import annotations

import dataclasses
import json
from typing import Any

import numpy as np
import pytest

from twolink.errors import QueryError
from twolink.lagrange import check as module
from twolink.lagrange import derive, formulas, two_link
from twolink.lagrange.check import CheckReport, check
from twolink.lagrange.two_link import TwoLink


@pytest.fixture(scope="module")
def report() -> CheckReport:
    return check(n=300, seed=1, horizon=10.0)


def test_the_check_passes_and_names_the_two_misprints(report: CheckReport) -> None:
    assert report.passed
    assert report.misprints == ("C21", "C22")
    assert [row.quantity for row in report.rows[:12]] == list(derive.ENTRIES)
    assert all(max(row.corrected, row.derived) <= 1e-12 for row in report.rows)
    assert {row.quantity for row in report.rows if row.printed > 1e-12} == {
        "C21",
        "C22",
        "acceleration, ABA",
        "acceleration, CRBA + solve",
        "torque, RNEA",
    }
    assert report.largest_condition > 1000


def test_the_misprinted_equations_change_the_energy(report: CheckReport) -> None:
    energies = {energy.model: energy for energy in report.energies}
    assert energies["printed"].final == pytest.approx(305, abs=1)
    assert energies["corrected"].largest < 1e-9
    assert energies["Pinocchio"].largest < 1e-9


def test_text_is_aligned_and_the_dictionary_is_json(report: CheckReport) -> None:
    lines = report.text().splitlines()
    rows = [line for line in lines if line.startswith(("A11", "C21", "torque"))]
    assert {line.index("e-1", 20) for line in rows} == {rows[0].index("e-1", 20)}
    assert "printed differs: -l1*l2*m2*sin(theta2)/2" in rows[1]
    assert lines[-1] == "PASSED: the paper errs in C21, C22"
    data = json.loads(json.dumps(report.to_dict()))
    assert data["passed"] is True
    assert data["rows"][0]["quantity"] == "A11"


def test_the_same_seed_gives_the_same_report() -> None:
    assert check(n=20, seed=4, horizon=0.2) == check(n=20, seed=4, horizon=0.2)


class HeavierByABillionth(TwoLink):
    def mass_matrix(self, theta: Any) -> Any:
        return super().mass_matrix(theta) * (1 + 1e-9)


class Drifting(TwoLink):
    def forward_dynamics(self, theta: Any, dtheta: Any, torque: Any) -> Any:
        return super().forward_dynamics(theta, dtheta, torque) * (1 + 1e-9)


@pytest.mark.parametrize(("altered", "quantity"), [(HeavierByABillionth, "A11"), (Drifting, "acceleration, ABA")])
def test_an_arm_that_is_wrong_by_1e_9_fails(
    monkeypatch: pytest.MonkeyPatch, altered: type[TwoLink], quantity: str
) -> None:
    def plant(*arguments: Any) -> TwoLink:
        return altered(**vars(two_link(*arguments)))

    monkeypatch.setattr(module, "two_link", plant)
    report = check(n=50, horizon=0.5)
    assert not report.passed
    assert not next(row for row in report.rows if row.quantity == quantity).right
    assert report.text().splitlines()[-1].startswith("FAILED")
    assert any(line.endswith("fails") for line in report.text().splitlines())


def test_a_formula_with_the_wrong_sign_fails_in_numbers_and_symbols(monkeypatch: pytest.MonkeyPatch) -> None:
    """NumPy and SymPy read the same formula."""
    right = formulas.product_entries

    def wrong(*arguments: Any) -> Any:
        (b11, b12), second = right(*arguments)
        return (-b11, b12), second

    monkeypatch.setattr(formulas, "product_entries", wrong)
    report = check(n=50, horizon=0.5)
    row = report.rows[4]
    assert not report.passed
    assert row.corrected > 1
    assert row.verdict.startswith("corrected differs")


def test_a_wrong_derivation_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    right = derive.derive()
    monkeypatch.setattr(derive, "derive", lambda: dataclasses.replace(right, D=right.D * 2))
    report = check(n=50, horizon=0.5)
    assert not report.passed
    assert {row.quantity for row in report.rows[:12] if row.derived > 1e-12} == {"D1", "D2"}


def test_a_reference_with_another_inertia_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_ROD", module._ROD.replace("{inertia!r}", "{mass!r}"))
    report = check(n=50, horizon=0.5)
    assert not report.passed
    assert not report.rows[0].right


def test_the_check_fails_when_the_printed_equations_are_right(monkeypatch: pytest.MonkeyPatch) -> None:
    def corrected(lengths: Any, masses: Any, g: Any, _: str) -> TwoLink:
        return two_link(lengths, masses, g, "corrected")

    monkeypatch.setattr(module, "two_link", corrected)
    report = check(n=50, horizon=0.5)
    assert not report.passed
    assert [row.quantity for row in report.rows if not row.right] == ["C21", "C22"]


@pytest.mark.parametrize("change", [
    {"corrected": np.nan},
    {"derived": np.nan},
    {"derived": 1e-11},
    {"corrected_minus_derived": "l1"},
    {"printed": 1.0},
    {"printed": np.nan},
    {"printed_minus_derived": "l1"},
    {"printed_minus_derived": "l1", "printed": 1.0},
])  # fmt: skip
def test_each_column_of_a_row_counts(report: CheckReport, change: dict[str, Any]) -> None:
    row = dataclasses.replace(report.rows[0], **change)
    assert not dataclasses.replace(report, rows=(row, *report.rows[1:])).passed


@pytest.mark.parametrize(
    ("model", "largest"), [("Pinocchio", 1e-3), ("corrected", 1e-3), ("corrected", np.nan), ("printed", 1e-9)]
)
def test_each_energy_counts(report: CheckReport, model: str, largest: float) -> None:
    energies = tuple(
        dataclasses.replace(energy, largest=largest) if energy.model == model else energy for energy in report.energies
    )
    assert not dataclasses.replace(report, energies=energies).passed


@pytest.mark.parametrize(("arguments", "message"), [
    ({"n": 0}, "n: expected a whole number from 1, got 0"),
    ({"horizon": 0.0}, "horizon: expected a number above 0, got 0"),
    ({"horizon": np.inf}, "horizon: expected a number above 0"),
])  # fmt: skip
def test_bad_arguments_are_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(QueryError, match=message):
        check(**arguments)
