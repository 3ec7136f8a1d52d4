"""The choice of the engine with engine="auto": a fixed rule of the query, nv and the number of states.

The rule never looks at a clock, at earlier calls or at the disk cache, so that the same call gives the same bits every
time and in every process. Single states, without leading axes, go to Pinocchio. Batches, even of one, go to programs,
which take a tenth to a fiftieth of the time, so that a state has the same bits in each of them; but where tracing and
certifying take long, from the size on where REPEATS calls of it pay for that. It happens once for a robot and a
machine: programs are kept on disk.
"""

import functools
import math

ENGINES = ("auto", "pinocchio", "compiled")
REPEATS = 100  # calls
PATIENCE = 1.0  # s

# Seconds that Pinocchio takes for a state of a batch, (constant, for each of nv), and that tracing, assembling and
# certifying take, (constant, for each of nv^2), rounded from `scripts.benchmarks.kernels --engines`.
_STATE = {
    "forward_dynamics": (0.0, 2e-7),
    "inverse_dynamics": (0.0, 2e-7),
    "forward_dynamics_derivatives": (1.5e-5, 1e-6),
    "inverse_dynamics_derivatives": (1.5e-5, 1e-6),
}
_TRACING = {
    "forward_dynamics": (0.05, 6e-4),
    "mass_matrix": (0.05, 4e-4),
    "forward_dynamics_derivatives": (0.1, 6e-3),
    "inverse_dynamics_derivatives": (0.1, 3e-3),
}


@functools.lru_cache(1024)
def compiled_from(name: str, nv: int) -> int:
    """The number of states from which the program answers."""
    constant, slope = _STATE.get(name, (2e-6, 1e-7))
    fixed, square = _TRACING.get(name, (0.05, 4e-4))
    tracing = fixed + square * nv**2
    if tracing <= PATIENCE:
        return 1
    return max(1, math.ceil(tracing / (REPEATS * (constant + slope * max(nv, 1)))))
