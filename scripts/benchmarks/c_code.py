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
from scripts.runner import Table, options, print_bars, seconds_of
from twolink.algorithms.functions import function

BOUND, FASTEST = 1e-12, 1000.0  # relative; ns of the Panda
ROBOTS = ("two_link", "ur5", "kinova", "panda", "z1", "hyq", "solo12", "anymal", "tiago_no_hand", "talos")
QUERIES = ("forward_dynamics", "mass_matrix", "bias", "inverse_dynamics")
LOOP = """
void all_{name}(long n, {taken}, double *out) {{
  for (long i = 0; i < n; i++) arm_{name}({passed}, out + i * {size});
}}
"""
COLUMNS = "robot <14 | nv >3 | M >8.1e | h >8.1e | tau >8.1e | a >8.1e | solved >8.1e | residual >8.1e | ns >6.0f"


def compiled(robot: tl.Robot, folder: str) -> ctypes.CDLL:
    """The exported functions as a library, which runs each over many states."""
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
    subprocess.run(["cc", *flags, source, main, "-o", library, "-lm"], check=True)
    return ctypes.CDLL(str(library))


def answers(library: ctypes.CDLL, robot: tl.Robot, name: str, given: dict[str, np.ndarray]) -> tuple[float, np.ndarray]:
    """ns a state, and the results of all."""
    of, n = function(robot.model, name), len(given["q"])
    out = np.empty((n, *of.shape))
    arrays = [np.ascontiguousarray(x) for x in (*(given[k] for k, _ in of.arguments), out)]
    pointers, loop = [x.ctypes.data_as(ctypes.c_void_p) for x in arrays], getattr(library, f"all_{name}")
    (taken,) = seconds_of(lambda: loop(ctypes.c_long(n), *pointers), rounds=7, clock=time.process_time, pick=min)
    return 1e9 * taken / n, out


def figures(library: ctypes.CDLL, robot: tl.Robot, n: int, seed: int) -> np.ndarray:
    """The errors of a row of the table over n states, and ns of a forward dynamics."""
    q, v = robot.random_state(n, seed=seed)
    tau, chosen = np.random.default_rng(seed).uniform(-20, 20, (2, n, robot.nv))
    (ns, a), *found = (answers(library, robot, one, {"q": q, "v": v, "tau": tau, "a": chosen}) for one in QUERIES)
    mass, bias = robot.mass_matrix(q, engine="pinocchio"), robot.bias(q, v, engine="pinocchio")
    torque = robot.inverse_dynamics(q, v, chosen, engine="pinocchio")
    true = robot.forward_dynamics(q, v, tau, engine="pinocchio")
    solved = np.linalg.solve(mass, (tau - bias)[..., None])[..., 0]
    terms = np.abs(np.einsum("nij,nj->ni", mass, a)) + np.abs(bias) + np.abs(tau)
    pairs = zip([*(x for _, x in found), a, solved], [mass, bias, torque, true, true], strict=True)
    sizes = [*((x - y, y) for x, y in pairs), (robot.inverse_dynamics(q, v, a, engine="pinocchio") - tau, terms)]
    errors, sizes = (np.array([np.abs(x).reshape(n, -1).max(1) for x in part]) for part in zip(*sizes, strict=True))
    return np.append((errors / np.where(sizes, sizes, 1.0)).max(axis=1), ns)


def measure(name: str, states: int, table: Table) -> np.ndarray:
    """Add a row, and return its figures."""
    robot = tl.load_robot(name)
    with tempfile.TemporaryDirectory() as folder:
        library = compiled(robot, folder)
        parts = range(0, states, 10_000)  # memory
        every = np.array([figures(library, robot, min(10_000, states - part), seed=part) for part in parts])
    row = np.append(every[:, :-1].max(axis=0), every[:, -1].min())
    table.add(name, robot.nv, *row.tolist())
    return row


def main() -> bool:
    """Print the table and the bars."""
    given, table = options(__doc__, states=100_000, rest=ROBOTS), Table(COLUMNS)
    rows = {name: measure(name, given.states, table) for name in given.rest}
    near = sum(row[3] <= BOUND for row in rows.values())
    bars = [(all(max(row[:3]) <= BOUND for row in rows.values()), f"M, h and tau equal to Pinocchio's to {BOUND:g}"),
            (all(row[5] <= BOUND for row in rows.values()), f"M a + h = tau by Pinocchio to {BOUND:g} of the terms"),
            (near == len(rows), f"a equal to Pinocchio's to {BOUND:g} of the largest: {near} of {len(rows)} robots"),
            ]  # fmt: skip
    if "panda" in rows:
        bars.append((rows["panda"][-1] <= FASTEST, f"forward dynamics of the Panda in {rows['panda'][-1]:.0f} ns"))
    return print_bars(bars)


if __name__ == "__main__":
    sys.exit(not main())
