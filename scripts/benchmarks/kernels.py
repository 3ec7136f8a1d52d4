"""Compiled kernels beside Pinocchio: what was decided by their speed, and what a single call costs.

python -m scripts.benchmarks.kernels --engines     # what the rule of twolink/dynamics/engine.py is rounded from
python -m scripts.benchmarks.kernels --single      # what twolink adds to importing, and to one call of Pinocchio
"""

import os
from functools import partial

import numpy as np
import pinocchio as pin

from scripts.benchmarks.queries import CHAINS, MODELS, draw
from scripts.runner import Table, many, new_process, once, options, seconds_of
from scripts.tasks import robot_of
from twolink.dynamics.engine import compiled_from

TAKES = {"mass_matrix": 1, "gravity_torque": 1, "bias": 2, "energy": 2, "forward_dynamics": 3,
         "inverse_dynamics": 3, "forward_dynamics_derivatives": 3, "inverse_dynamics_derivatives": 3}  # fmt: skip
BARE = {"forward_dynamics": pin.aba, "inverse_dynamics": pin.rnea, "mass_matrix": pin.crba,
        "bias": pin.nonLinearEffects, "gravity_torque": pin.computeGeneralizedGravity}  # fmt: skip
CALLS = 2_000  # of single states, timed together


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
    given = options(__doc__, engines=False, single=False)
    if given.engines:
        engines()
    if given.single:
        single()


if __name__ == "__main__":
    main()
