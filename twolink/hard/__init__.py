"""Hard cases: scenes that break simulators, with their truth, what twolink gets and what its peers get.

In: names of cases, accuracies. Out: judged results. `twolink.hard.peers` runs SciPy, MuJoCo and Drake on the same
tasks, here and for `scripts/benchmarks/peers.py`. The referee holds any simulator's log against the solution.
"""

from twolink.hard.attempts import run_case
from twolink.hard.case import Attempt, Case, CaseResult, ErrorCheck, RefusalCase, SimulationCase, StateHistory
from twolink.hard.cases import all_cases, select_cases

__all__ = ["Attempt", "Case", "CaseResult", "ErrorCheck", "RefusalCase", "SimulationCase", "StateHistory", "all_cases",
           "run_case", "select_cases"]  # fmt: skip
