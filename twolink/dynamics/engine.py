"""Which engine answers a query with engine="auto": a fixed rule of the query, nv and the number of states.

The rule never looks at a clock, at earlier calls or at the disk cache, so that the same call gives the same bits every
time and in every process. It weighs what Pinocchio takes for the batch against what compiling takes:

- A kernel is compiled once for a robot and a machine (it is kept on disk), and a batch is rarely asked for only once.
  Where compiling takes up to PATIENCE, a batch is compiled from the size on where REPEATS calls of it pay for that.
- A longer wait is accepted only where it pays within one call.

Smaller batches take milliseconds either way; engine="compiled" answers them in a tenth to a hundredth of the time.
"""

import functools
import math

ENGINES = ("auto", "pinocchio", "compiled")
REPEATS = 10  # calls
PATIENCE = 2.0  # s

# Seconds that Pinocchio takes for a state of a batch, (constant, for each of nv), and that tracing, compiling and
# certifying take, (constant, for each of nv^2). Rounded from `scripts.benchmarks.kernels --engines` on two cores, for
# the arm, UR5, Panda, ANYmal, Talos and chains of 2 to 30 links. For example: UR5 forward dynamics 0.13 s, 1.2e-6 s;
# Panda mass matrix 0.10 s, 2.7e-6 s; ANYmal bias 0.27 s, 3.2e-6 s, derivatives of forward dynamics 3.4 s, 3.4e-5 s.
_STATE = {
    "forward_dynamics": (0.0, 2e-7),
    "inverse_dynamics": (0.0, 2e-7),
    "forward_dynamics_derivatives": (1.5e-5, 1e-6),
    "inverse_dynamics_derivatives": (1.5e-5, 1e-6),
}
_COMPILING = {
    "forward_dynamics": (0.08, 1e-3),
    "mass_matrix": (0.05, 2e-3),
    "forward_dynamics_derivatives": (0.1, 1.5e-2),
    "inverse_dynamics_derivatives": (0.1, 8e-3),
}


@functools.lru_cache(1024)
def compiled_from(name: str, nv: int) -> int:
    """The number of states from which the compiled function answers."""
    constant, slope = _STATE.get(name, (2e-6, 1e-7))
    fixed, square = _COMPILING.get(name, (0.05, 6e-4))
    compiling = fixed + square * nv**2
    calls = REPEATS if compiling <= PATIENCE else 1
    return math.ceil(compiling / (calls * (constant + slope * max(nv, 1))))
