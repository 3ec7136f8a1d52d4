"""Which engine answers a query with engine="auto": a fixed rule of the query, nv and the number of states.

The rule never looks at a clock, at earlier calls or at the disk cache, so that the same call gives the same bits every
time and in every process. A batch is answered by the compiled function from the size on where Pinocchio would take a
tenth of the time that compiling takes: a kernel is compiled once for a robot and a machine (it is kept on disk), and a
batch is rarely asked for only once. A batch that is just large enough waits ten times as long the first time, and
then takes a tenth to a hundredth of Pinocchio's time. Smaller batches take milliseconds either way.
"""

from __future__ import annotations

import math

ENGINES = ("auto", "pinocchio", "compiled")
REPEATS = 10  # calls of a batch that are to pay for compiling

# Seconds that Pinocchio takes for a state of a batch, as (constant, per nv), and that tracing, compiling and
# certifying take, as (constant, per nv^2). Two cores; `scripts/bench_queries.py --engines` measures both.
_STATE_PARALLEL, _STATE_LOOP = (0.0, 2e-7), (2e-6, 1e-7)
_COMPILING = {"forward_dynamics": (0.15, 3e-3)}
_COMPILING_ELSE = (0.15, 1.5e-3)


def compiled_from(name: str, nv: int) -> int:
    """The number of states from which the compiled function answers."""
    parallel = name in ("forward_dynamics", "inverse_dynamics")
    constant, slope = _STATE_PARALLEL if parallel else _STATE_LOOP
    fixed, square = _COMPILING.get(name, _COMPILING_ELSE)
    return math.ceil((fixed + square * nv**2) / (REPEATS * (constant + slope * max(nv, 1))))
