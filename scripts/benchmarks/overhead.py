"""What twolink adds: to importing, and to one call of Pinocchio. Medians after warm-up, in one run.

python scripts/bench_overhead.py
"""

import statistics
import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np
import pinocchio as pin

import twolink as tl

CASES = {"two_link": "fixed", "ur5": "fixed", "panda": "fixed", "kinova": "fixed", "anymal": "free"}


def microseconds(call: Callable[[], object], number: int = 2_000, repeats: int = 31) -> float:
    for _ in range(number):
        call()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        for _ in range(number):
            call()
        times.append((time.perf_counter() - start) / number * 1e6)
    return statistics.median(times)


def import_seconds(code: str, repeats: int = 9) -> float:
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        subprocess.run([sys.executable, "-c", code], check=True)
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def main() -> None:
    bare, pinocchio, ours = (import_seconds(code) for code in ("pass", "import pinocchio", "import twolink"))
    print(
        f"import twolink {ours - bare:.3f} s, of it pinocchio {pinocchio - bare:.3f} s (python itself {bare:.3f} s)\n"
    )
    print(f"{'one state, us':<12}{'query':<20}{'Pinocchio':>10}{'twolink':>10}{'on top':>8}")
    for name, root in CASES.items():
        for query, (theirs, ours_) in pairs(tl.load_robot(name, root=root)).items():
            a, b = microseconds(theirs), microseconds(ours_)
            print(f"{name:<12}{query:<20}{a:>10.2f}{b:>10.2f}{b - a:>8.2f}")


def pairs(robot: tl.Robot) -> dict[str, tuple[Callable[[], object], Callable[[], object]]]:
    """Each query as a bare call of Pinocchio, and as ours."""
    model, data = robot.model, robot.model.createData()
    rng = np.random.default_rng(0)
    q = robot.normalize(pin.integrate(model, robot.neutral, rng.uniform(-1, 1, robot.nv)))
    v, w = rng.uniform(-1, 1, (2, robot.nv))
    return {
        "forward_dynamics": (lambda: pin.aba(model, data, q, v, w), lambda: robot.forward_dynamics(q, v, w)),
        "inverse_dynamics": (lambda: pin.rnea(model, data, q, v, w), lambda: robot.inverse_dynamics(q, v, w)),
        "mass_matrix": (lambda: pin.crba(model, data, q), lambda: robot.mass_matrix(q)),
        "bias": (lambda: pin.nonLinearEffects(model, data, q, v), lambda: robot.bias(q, v)),
        "gravity_torque": (lambda: pin.computeGeneralizedGravity(model, data, q), lambda: robot.gravity_torque(q)),
    }


if __name__ == "__main__":
    main()
