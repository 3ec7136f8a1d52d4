"""The paper's two-link arm: by hand as printed and as corrected, derived by SymPy, and compared with Pinocchio.

In: lengths, masses and inertias of the arm. Out: its mass, Coriolis and gravity terms, and the comparison. `two_link`
is the model, `twolink.lagrange.derive` the derivation from energies, `twolink.lagrange.check` the comparison. This
room knows nothing of scenes or simulation.
"""

from twolink.lagrange.formulas import Variant
from twolink.lagrange.two_link import TwoLink, two_link

__all__ = ["TwoLink", "Variant", "two_link"]
