"""Hard cases: scenes that break simulators, what their truth is, what we get and what peers get."""

from twolink.hard.case import Case, Motion, Probe, Refusals, Track, Truth, at
from twolink.hard.case_result import Attempt, Result
from twolink.hard.cases import all_cases, chosen
from twolink.hard.run_case import run_case

__all__ = ["Attempt", "Case", "Motion", "Probe", "Refusals", "Result", "Track", "Truth", "all_cases", "at", "chosen",
           "run_case"]  # fmt: skip
