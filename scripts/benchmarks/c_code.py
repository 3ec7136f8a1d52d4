"""Exported C code beside Pinocchio: its error over many states, and its time for one of them.

    python -m scripts.benchmarks.c_code [ROBOT ...] [--states 100000]

Ten robots if none is named. M, h and tau: the largest difference of a mass matrix, bias force or torque of the inverse
dynamics, relative to the largest entry of that matrix or vector. a: the same of accelerations, by Pinocchio's
articulated bodies. Their rounding grows with the condition number of M, in Pinocchio too: `solved` is how far
M^-1 (tau - h), by Pinocchio's M and h, is from those. residual: |M a + h - tau| of our a by Pinocchio's inverse
dynamics, relative to the largest of |M a| + |h| + |tau|, which is free of that number. ns: of a forward dynamics in C,
state after state.
"""

import ctypes
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import twolink as tl
from scripts.runner import Table, once, options, print_bars
from twolink.algorithms.functions import function

BOUND, FASTEST = 1e-12, 1000.0  # relative; ns of the Panda
ROBOTS = ("two_link", "ur5", "kinova", "panda", "z1", "hyq", "solo12", "anymal", "tiago_no_hand", "talos")
QUERIES = ("forward_dynamics", "mass_matrix", "bias", "inverse_dynamics")
LOOP = """
void all_{name}(long n, {taken}, double *out) {{
  for (long i = 0; i < n; i++) arm_{name}({passed}, out + i * {size});
}}
"""


def compiled(robot: tl.Robot, folder: str) -> tuple[ctypes.CDLL, float]:
    """The exported functions as a library, which runs each over many states; seconds of cc."""
    source, _ = robot.export_c(Path(folder) / "arm.c", QUERIES)
    loops = ['#include "arm.h"']
    for name in QUERIES:
        of = function(robot.model, name)
        taken = ", ".join(f"const double *{k}" for k, _ in of.arguments)
        passed = ", ".join(f"{k} + i * {size}" for k, size in of.arguments)
        loops.append(LOOP.format(name=name, taken=taken, passed=passed, size=int(np.prod(of.shape))))
    main, library = Path(folder) / "loops.c", Path(folder) / "arm.so"
    main.write_text("".join(loops))
    flags = ["-O2", "-march=native", "-ffp-contract=off", "-fPIC", "-shared"]
    command = ["cc", *flags, source, main, "-o", library, "-lm"]
    seconds, _ = once(lambda: subprocess.run(command, check=True))
    return ctypes.CDLL(str(library)), seconds


def answers(library: ctypes.CDLL, robot: tl.Robot, name: str, given: dict[str, np.ndarray]) -> tuple[float, np.ndarray]:
    """ns a state, and the results of all."""
    of, n = function(robot.model, name), len(given["q"])
    out = np.empty((n, *of.shape))
    arrays = [np.ascontiguousarray(x) for x in (*(given[k] for k, _ in of.arguments), out)]
    pointers = [x.ctypes.data_as(ctypes.c_void_p) for x in arrays]
    loop, taken = getattr(library, f"all_{name}"), []
    for _ in range(7):
        taken.append(once(lambda: loop(ctypes.c_long(n), *pointers), time.process_time)[0])
    return 1e9 * min(taken) / n, arrays[-1]


def measure(name: str, states: int, table: Table) -> tuple[float, ...]:
    """Add a row. Returns the worst of M, h and tau, of a, and of its residual; ns of a forward dynamics."""
    robot = tl.load_robot(name)
    with tempfile.TemporaryDirectory() as folder:
        library, compiling = compiled(robot, folder)
        worst, best = np.zeros(6), np.inf
        for part in range(0, states, 10_000):  # memory
            errors, ns = _errors(library, robot, min(10_000, states - part), seed=part)
            worst, best = np.maximum(worst, errors), min(best, ns)
    table.add(name, robot.nv, *worst, best, compiling)
    return float(worst[:3].max()), float(worst[3]), float(worst[5]), best


def _errors(library: ctypes.CDLL, robot: tl.Robot, n: int, seed: int) -> tuple[np.ndarray, float]:
    """The errors of a table's row over n states, and ns of a forward dynamics."""
    rng = np.random.default_rng(seed)
    q, v = robot.random_state(n, seed=seed)
    tau, chosen = rng.uniform(-20, 20, (2, n, robot.nv))
    given = {"q": q, "v": v, "tau": tau, "a": chosen}
    ns, a = answers(library, robot, "forward_dynamics", given)
    found = [answers(library, robot, query, given)[1] for query in QUERIES[1:]]
    mass, bias = robot.mass_matrix(q, engine="pinocchio"), robot.bias(q, v, engine="pinocchio")
    torque = robot.inverse_dynamics(q, v, chosen, engine="pinocchio")
    true = robot.forward_dynamics(q, v, tau, engine="pinocchio")
    solved = np.linalg.solve(mass, (tau - bias)[..., None])[..., 0]
    terms = np.abs(np.einsum("nij,nj->ni", mass, a)) + np.abs(bias) + np.abs(tau)
    left = np.abs(robot.inverse_dynamics(q, v, a, engine="pinocchio") - tau)
    pairs = zip([*found, a, solved], [mass, bias, torque, true, true], strict=True)
    sizes = [(np.abs(x - y).reshape(n, -1).max(1), np.abs(y).reshape(n, -1).max(1)) for x, y in pairs]
    sizes.append((left.max(1), terms.max(1)))
    return np.array([float((error / np.where(size, size, 1.0)).max()) for error, size in sizes]), ns


def main() -> bool:
    """Print the table and the bars."""
    given = options(__doc__, states=100_000, rest=ROBOTS)
    table = Table("robot <14 | nv >3 | M >8.1e | h >8.1e | tau >8.1e | a >8.1e | solved >8.1e | residual >8.1e"
                  " | ns >6.0f | cc, s >5.1f")  # fmt: skip
    rows = {name: measure(name, given.states, table) for name in given.rest}
    near = [name for name, row in rows.items() if row[1] <= BOUND]
    bars = [(all(row[0] <= BOUND for row in rows.values()), f"M, h and tau equal to Pinocchio's to {BOUND:g}"),
            (all(row[2] <= BOUND for row in rows.values()), f"M a + h = tau by Pinocchio to {BOUND:g} of the terms"),
            (len(near) == len(rows), f"a equal to Pinocchio's to {BOUND:g} of the largest: {len(near)} of {len(rows)}"
                                     f" robots")]  # fmt: skip
    if "panda" in rows:
        bars.append((rows["panda"][3] <= FASTEST, f"forward dynamics of the Panda in {rows['panda'][3]:.0f} ns"))
    return print_bars(bars)


if __name__ == "__main__":
    sys.exit(not main())
