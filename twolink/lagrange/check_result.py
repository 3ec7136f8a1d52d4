"""The result of `check`, as data and as a plain table."""

from dataclasses import asdict, dataclass
from typing import Any

from twolink.io.listing import Table

LIMIT = 1e-12
MEASURE = (
    "error = largest difference from Pinocchio over all samples, relative to the largest magnitude in the\n"
    "matrix or vector; of accelerations and torques, relative to the sum of the magnitudes of their terms"
)


@dataclass(frozen=True)
class Comparison:
    """One quantity: the largest relative error of each set of equations against Pinocchio, and SymPy's differences.

    `*_minus_derived` is the symbolic difference from the equations that SymPy derives: "0" where equal for all arms and
    states, None for accelerations and torques, which follow from the entries.
    """

    quantity: str
    corrected: float
    derived: float
    printed: float
    corrected_minus_derived: str | None = None
    printed_minus_derived: str | None = None

    @property
    def misprinted(self) -> bool:
        """Whether the paper's entry is wrong, by its symbols."""
        return self.printed_minus_derived not in ("0", None)

    @property
    def right(self) -> bool:
        """Corrected and derived agree with Pinocchio to LIMIT and with each other symbolically, and numbers and
        symbols say the same about the printed entry."""
        agree = self.corrected <= LIMIT and self.derived <= LIMIT and self.corrected_minus_derived in ("0", None)
        wrong_in_numbers = not self.printed <= LIMIT  # so that NaN counts as wrong
        return agree and (self.printed_minus_derived is None or wrong_in_numbers == self.misprinted)

    @property
    def verdict(self) -> str:
        """SymPy's verdict in words; empty where there is none."""
        for name, difference in (("corrected", self.corrected_minus_derived), ("printed", self.printed_minus_derived)):
            if difference not in ("0", None):
                return f"{name} differs: {difference}"
        return "" if self.printed_minus_derived is None else "equal"


@dataclass(frozen=True)
class Energy:
    """The mechanical energy [J] along the motion by one set of equations from horizontal rest, where it is 0.

    `final` at the end, `largest` the largest magnitude at the steps of the integrator on the way.
    """

    model: str
    final: float
    largest: float


@dataclass(frozen=True)
class CheckReport:
    """The whole result.

    Attributes
    ----------
    n, seed : int
        The number of random arms and states, and the seed they come from.
    largest_condition : float
        The largest condition number of their mass matrices.
    rows : tuple of Comparison
        The comparison, quantity by quantity.
    horizon : float
        The time of the energy runs [s].
    energies : tuple of Energy
        The energies of the runs.
    """

    n: int
    seed: int
    largest_condition: float
    rows: tuple[Comparison, ...]
    horizon: float
    energies: tuple[Energy, ...]

    @property
    def misprints(self) -> tuple[str, ...]:
        """The paper's entries that are wrong."""
        return tuple(row.quantity for row in self.rows if row.misprinted)

    @property
    def energy_limit(self) -> float:
        """The change of an energy of the order of 10 J [J] that the integrator (tolerance 1e-10) may cause."""
        return 1e-9 * (1 + self.horizon)

    @property
    def energy_shown(self) -> bool:
        """Pinocchio and corrected keep the energy, and printed exceeds the limit a thousand times."""
        change = {energy.model: energy.largest for energy in self.energies}
        kept = change["Pinocchio"] <= self.energy_limit and change["corrected"] <= self.energy_limit
        return kept and change["printed"] > 1000 * self.energy_limit

    @property
    def passed(self) -> bool:
        """All rows are right, the paper errs in C21 and C22 and nowhere else, and the energy shows it."""
        return all(row.right for row in self.rows) and self.misprints == ("C21", "C22") and self.energy_shown

    def to_dict(self) -> dict[str, Any]:
        """Plain data, ready for JSON."""
        limits = {"bar": LIMIT, "energy_bar": self.energy_limit, "measure": MEASURE.replace("\n", " ")}
        return asdict(self) | {"passed": self.passed, "misprints": list(self.misprints), **limits}

    def text(self) -> str:
        """A plain table."""
        rows = []
        for row in self.rows:
            errors = (f"{error:.1e}" for error in (row.corrected, row.derived, row.printed))
            rows.append((row.quantity, *errors, row.verdict, "" if row.right else "fails"))
        energies = [(e.model, f"{e.final:.3g} J", f"{e.largest:.3g} J") for e in self.energies]
        misprints = ", ".join(self.misprints) or "no entry"
        return f"""{self.n:,} random two-link arms and states against Pinocchio, seed {self.seed}, limit {LIMIT:g}
{MEASURE}

{Table(("quantity", "corrected", "derived", "printed", "symbolically", ""), tuple(rows))}

B is compared by row sums: both its columns multiply td1 td2, and no motion tells them apart.
largest condition number of the mass matrix: {self.largest_condition:.0f}

True energy over {self.horizon:g} s from horizontal rest at 0 J (l = 1, 1 m; m = 3, 1 kg):
{Table(("motion by", "at the end", "largest"), tuple(energies))}

{"PASSED" if self.passed else "FAILED"}: the paper errs in {misprints}"""
