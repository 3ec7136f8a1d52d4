"""Hard cases: scenes that break simulators, with their truth, what twolink gets and what its peers get.

In: names of cases, accuracies. Out: judged results. `twolink.hard.peers` runs SciPy, MuJoCo and Drake on the same
tasks, here and for `scripts/compare_peers.py`.
"""

from twolink.hard.case import Case, Motion, Probe, Refusals, Track, Truth, at
from twolink.hard.case_result import Attempt, Result
from twolink.hard.cases import all_cases, chosen
from twolink.hard.run_case import run_case

__all__ = ["Attempt", "Case", "Motion", "Probe", "Refusals", "Result", "Track", "Truth", "all_cases", "at", "chosen",
           "run_case"]  # fmt: skip
