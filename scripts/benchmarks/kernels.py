"""Compiles and certifies forward and inverse dynamics of every robot that loads, and says how far they agree.

    python scripts/certify_all.py [NAME ...]

Cold and cached seconds, peak memory, and the worst error against Pinocchio over the certificate's states, relative to
the size of the terms (carried through the inverse of the mass matrix where it is solved with). The bound is 1e-11.
"""

import os
import resource
import sys
import tempfile
import time

import twolink as tl
from twolink.robots import catalogue_names
from twolink.robots.catalogue import catalogue_entry

FUNCTIONS = ("forward_dynamics", "inverse_dynamics")


def seconds(robot: tl.Robot, function: str) -> tuple[float, float]:
    """Seconds to build or read a function, and its certificate's worst error."""
    start = time.perf_counter()
    certificate = robot.compiled().certificate(function)
    return time.perf_counter() - start, certificate.worst


def main() -> None:
    os.environ["TWOLINK_CACHE"] = tempfile.mkdtemp(prefix="twolink-certify-")
    worst = 0.0
    print(f"{'robot':<28}{'nv':>4}" + "".join(f"{f:>20}{'cold s':>8}{'cache s':>9}" for f in FUNCTIONS))
    for name in sys.argv[1:] or catalogue_names():
        root = catalogue_entry(name).usual_root
        try:
            robots = [tl.load_robot(name, root=root) for _ in range(2)]
        except tl.errors.RobotError as error:
            print(f"{name:<28}refused: {error.what}")
            continue
        if robots[0].nv == 0:
            continue
        line = f"{name:<28}{robots[0].nv:>4}"
        for function in FUNCTIONS:
            (cold, error), (warm, _) = (seconds(robot, function) for robot in robots)
            worst = max(worst, error)
            line += f"{error:>20.1e}{cold:>8.2f}{warm:>9.3f}"
        print(line, flush=True)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"\nworst error {worst:.1e}; peak memory of all together {memory:.0f} MB")


if __name__ == "__main__":
    main()
