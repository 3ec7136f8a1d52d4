"""How long a function of exported C code takes for one state: python -m scripts.benchmarks.c_code [ROBOT ...].

Beside it: one call of Pinocchio from Python, one state in a compiled batch, and the seconds of cc.
"""

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import twolink as tl

CALLS = 200_000
MAIN = """#include "arm.h"
#include <stdio.h>
#include <time.h>
int main(void) {{
  double q[{nq}] = {{{q}}}, v[{nv}] = {{{v}}}, tau[{nv}] = {{0}}, a[{nv}], sum = 0, best = 1e9;
  for (int round = 0; round < 7; round++) {{
    struct timespec begun, ended;
    clock_gettime(CLOCK_MONOTONIC, &begun);
    for (int i = 0; i < {calls}; i++) {{ tau[0] = 1e-9 * i; arm_forward_dynamics(q, v, tau, a); sum += a[0]; }}
    clock_gettime(CLOCK_MONOTONIC, &ended);
    const double spent = (ended.tv_sec - begun.tv_sec) * 1e9 + (ended.tv_nsec - begun.tv_nsec);
    best = spent < best ? spent : best;
  }}
  printf("%.1f %g\\n", best / {calls}, sum);
  return 0;
}}
"""


def measure(name: str) -> str:
    """One line on a robot: ns of a call in C, of Pinocchio from Python, and of a state in a batch."""
    robot = tl.load_robot(name)
    q, v = robot.random_state(10_000, seed=1)
    with tempfile.TemporaryDirectory() as folder:
        source, _ = robot.export_c(Path(folder) / "arm.c")
        numbers = {k: ", ".join(map(repr, x[0].tolist())) for k, x in (("q", q), ("v", v))}
        main = Path(folder) / "main.c"
        main.write_text(MAIN.format(nq=robot.nq, nv=robot.nv, calls=CALLS, **numbers))
        begun = time.perf_counter()
        subprocess.run(["cc", "-O2", "-march=native", str(source), str(main), "-o", f"{folder}/run", "-lm"], check=True)
        compiling = time.perf_counter() - begun
        in_c = float(subprocess.run([f"{folder}/run"], capture_output=True, check=True, text=True).stdout.split()[0])
        size = source.stat().st_size
    tau = np.zeros_like(v)
    single = min(_seconds(lambda: robot.forward_dynamics(q[0], v[0], tau[0])) for _ in range(2000))
    batch = min(_seconds(lambda: robot.forward_dynamics(q, v, tau)) for _ in range(20)) / len(q)
    return (f"{name:<12} nv {robot.nv:>3}  C {in_c:7.0f} ns  one call {1e9 * single:7.0f} ns  "
            f"in a batch {1e9 * batch:6.0f} ns  {size / 1000:.0f} kB, cc {compiling:.1f} s")  # fmt: skip


def _seconds(call: object) -> float:
    begun = time.perf_counter()
    call()  # type: ignore[operator]
    return time.perf_counter() - begun


if __name__ == "__main__":
    for robot in sys.argv[1:] or ("two_link", "ur5", "panda", "talos"):
        print(measure(robot), flush=True)
