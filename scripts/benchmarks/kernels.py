"""Compiled kernels: what making, certifying and reading them costs, how exact they are, and what was decided by that.

    python -m scripts.benchmarks.kernels [ROBOT ...]   # of every robot that loads, or of these
    python -m scripts.benchmarks.kernels --engines     # what the rule of twolink/dynamics/engine.py is rounded from
    python -m scripts.benchmarks.kernels --single      # what twolink adds to importing, and to one call of Pinocchio

The table: seconds until a kernel of a new process answers, first made and certified, then read from the cache, both
after the first kernel of the process; and its worst error against Pinocchio over the certificate's states, relative to
the size of the terms (carried through the inverse of the mass matrix where it is solved with). The bound is 1e-11.
"""

import json
import os
import tempfile
from functools import partial

import numpy as np
import pinocchio as pin

import twolink as tl
from scripts.benchmarks.queries import CHAINS, MODELS, draw
from scripts.runner import Table, many, new_process, once, options, seconds_of
from scripts.tasks import robot_of
from twolink.dynamics.engine import compiled_from

FUNCTIONS = ("forward_dynamics", "inverse_dynamics", "mass_matrix", "bias")
TAKES = {"mass_matrix": 1, "gravity_torque": 1, "bias": 2, "energy": 2, "forward_dynamics": 3,
         "inverse_dynamics": 3, "forward_dynamics_derivatives": 3, "inverse_dynamics_derivatives": 3}  # fmt: skip
BARE = {"forward_dynamics": pin.aba, "inverse_dynamics": pin.rnea, "mass_matrix": pin.crba,
        "bias": pin.nonLinearEffects, "gravity_torque": pin.computeGeneralizedGravity}  # fmt: skip
CALLS = 2_000  # of single states, timed together
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
    print(f"\nworst error {max((row[-1] for row in table.rows), default=0.0):.1e}")


def engines(n: int = 2_000) -> None:
    """Seconds of tracing and certifying, and of a state by Pinocchio and by the kernel, next to the rule."""
    os.environ["TWOLINK_CACHE"] = "off"
    table = Table("robot <10 | nv >4 | query <30 | tracing s >11.2f | Pinocchio us >13.2f | kernel us >10.3f | rule >8")
    for name in (*MODELS, *CHAINS):
        robot = robot_of(name)
        states = draw(robot, n)
        for query, count in TAKES.items():
            if robot.nv > 20 and "derivatives" in query:
                continue
            tracing, _ = once(lambda robot=robot, query=query: robot.compiled().certificate(query))
            calls = [partial(getattr(robot, query), *states[:count], engine=e) for e in ("pinocchio", "compiled")]
            theirs, ours = (taken / n * 1e6 for taken in seconds_of(*calls, rounds=5, warm_up=0, pick=min))
            table.add(name, robot.nv, query, tracing, theirs, ours, compiled_from(query, robot.nv))


def single() -> None:
    """Seconds of imports, and us of one state by a bare call of Pinocchio and by ours: medians after warm-up."""
    imports = [lambda code=code: new_process(code, cache="off", check=True)
               for code in ("pass", "import pinocchio", "import twolink")]  # fmt: skip
    bare, pinocchio, ours = seconds_of(*imports)
    print(f"import twolink {ours - bare:.3f} s, of it pinocchio {pinocchio - bare:.3f} s (python alone {bare:.3f} s)\n")
    table = Table("one state, us <12 | query <20 | Pinocchio >9.2f | twolink >9.2f | on top >7.2f")
    for name in ("two_link", "ur5", "panda", "kinova", "anymal"):
        robot, random = robot_of(name), np.random.default_rng(0)
        q = robot.normalize(pin.integrate(robot.model, robot.neutral, random.uniform(-1, 1, robot.nv)))
        state = q, *random.uniform(-1, 1, (2, robot.nv))
        for query, call in BARE.items():
            given = state[: TAKES[query]]
            pair = partial(call, robot.model, robot.model.createData(), *given), partial(getattr(robot, query), *given)
            a, b = (1e6 * taken / CALLS for taken in seconds_of(*(many(one, CALLS) for one in pair), rounds=31))
            table.add(name, query, a, b, b - a)


def main() -> None:
    given = options(__doc__, rest=(), engines=False, single=False)
    if given.engines or given.single:
        engines() if given.engines else single()
    else:
        certify(given.rest or [row[0] for row in tl.robots().rows])


if __name__ == "__main__":
    main()
