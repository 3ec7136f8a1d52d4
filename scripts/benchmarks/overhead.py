"""What twolink adds: to importing, and to one call of Pinocchio. Medians after warm-up, in one run.

python -m scripts.benchmarks.overhead
"""

from collections.abc import Callable

import numpy as np
import pinocchio as pin

import twolink as tl
from scripts.runner import Table, new_process, options, seconds_of

CASES = {"two_link": "fixed", "ur5": "fixed", "panda": "fixed", "kinova": "fixed", "anymal": "free"}
CALLS = 2_000  # timed together


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


def many(call: Callable[[], object]) -> Callable[[], None]:
    def calls() -> None:
        for _ in range(CALLS):
            call()

    return calls


def main() -> None:
    options(__doc__)
    imports = [lambda code=code: new_process(code, cache="off", check=True)
               for code in ("pass", "import pinocchio", "import twolink")]  # fmt: skip
    bare, pinocchio, ours = seconds_of(*imports)
    print(f"import twolink {ours - bare:.3f} s, of it pinocchio {pinocchio - bare:.3f} s (python alone {bare:.3f} s)\n")
    table = Table("one state, us <12 | query <20 | Pinocchio >9.2f | twolink >9.2f | on top >7.2f")
    for name, root in CASES.items():
        for query, calls in pairs(tl.load_robot(name, root=root)).items():
            a, b = (1e6 * taken / CALLS for taken in seconds_of(*map(many, calls), rounds=31))
            table.add(name, query, a, b, b - a)


if __name__ == "__main__":
    main()
