"""Compiled kernels: what making, certifying and reading them costs, how exact they are, and what was decided by that.

    python -m scripts.benchmarks.kernels [ROBOT ...]   # of every robot that loads, or of these
    python -m scripts.benchmarks.kernels --engines     # what the rule of twolink/dynamics/engine.py is rounded from

The table: seconds until a kernel of a new process answers, first made and certified, then read from the cache, both
after the first kernel of the process; and its worst error against Pinocchio over the certificate's states, relative to
the size of the terms (carried through the inverse of the mass matrix where it is solved with). The bound is 1e-11.
"""

import json
import os
import tempfile
from functools import partial

import twolink as tl
from scripts.benchmarks.queries import draw, robots
from scripts.runner import Table, new_process, once, options, seconds_of
from twolink.dynamics.engine import compiled_from

FUNCTIONS = ("forward_dynamics", "inverse_dynamics", "mass_matrix", "bias")
TAKES = {"mass_matrix": 1, "gravity_torque": 1, "bias": 2, "energy": 2, "forward_dynamics": 3,
         "inverse_dynamics": 3, "forward_dynamics_derivatives": 3, "inverse_dynamics_derivatives": 3}  # fmt: skip
CODE = f"""
import json, resource, sys, time, twolink as tl
from twolink.robots.catalogue import catalogue_entry
robot, found = tl.load_robot(sys.argv[1], root=catalogue_entry(sys.argv[1]).usual_root), []
if robot.nv:
    robot.compiled().certificate("gravity_torque")
    for query in {FUNCTIONS}:
        start = time.perf_counter()
        worst = robot.compiled().certificate(query).worst
        found.append((time.perf_counter() - start, worst))
print(json.dumps([robot.nv, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, found]))
"""


def certify(names: list[str]) -> None:
    """The table, two processes a robot."""
    table = Table("robot <28 | nv >4 | MB >5.0f | query <16 | made, s >8.2f | read, s >8.3f | error >8.1e")
    for name in names:
        with tempfile.TemporaryDirectory() as cache:
            done = [new_process(CODE, name, cache=cache) for _ in range(2)]
        if done[0].returncode:
            print(f"{name:<28} refused: {done[0].stderr.strip().splitlines()[-1]}"[:160])
            continue
        (nv, memory, made), (_, _, read) = (json.loads(one.stdout) for one in done)
        for query, (cold, worst), (warm, _) in zip(FUNCTIONS, made, read, strict=True) if nv else ():
            table.add(name, nv, memory, query, cold, warm, worst)
    worst = max((row[-1] for row in table.rows), default=0.0)
    print(f"\nworst error {worst:.1e}")


def engines(n: int = 2_000) -> None:
    """Seconds of tracing and certifying, and of a state by Pinocchio and by the kernel, next to the rule."""
    os.environ["TWOLINK_CACHE"] = "off"
    table = Table("robot <10 | nv >4 | query <30 | tracing s >11.2f | Pinocchio us >13.2f | kernel us >10.3f | rule >8")
    for name, robot in robots(quick=False).items():
        states = draw(robot, n)
        for query, count in TAKES.items():
            if robot.nv > 20 and "derivatives" in query:
                continue
            tracing, _ = once(lambda robot=robot, query=query: robot.compiled().certificate(query))
            calls = [partial(getattr(robot, query), *states[:count], engine=e) for e in ("pinocchio", "compiled")]
            theirs, ours = (taken / n * 1e6 for taken in seconds_of(*calls, rounds=5, warm_up=0, pick=min))
            table.add(name, robot.nv, query, tracing, theirs, ours, compiled_from(query, robot.nv))


def main() -> None:
    given = options(__doc__, rest=(), engines=False)
    if given.engines:
        engines()
    else:
        certify(given.rest or [row[0] for row in tl.robots().rows])


if __name__ == "__main__":
    main()
