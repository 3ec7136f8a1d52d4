"""The paper's two-link arm: by hand as printed and as corrected, by machine, and against Pinocchio.

`two_link` is the model; `twolink.lagrange.derive` derives it from energies with SymPy and
`twolink.lagrange.check` holds all of them against Pinocchio.
"""

from twolink.lagrange.formulas import Variant
from twolink.lagrange.two_link import TwoLink, two_link

__all__ = ["TwoLink", "Variant", "two_link"]
