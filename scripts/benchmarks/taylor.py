"""Taylor's method beside heyoka's: the first run, with what is traced or compiled before, and later ones.

    python -m scripts.benchmarks.taylor [--rounds 5] [--quick]

Processor seconds on one thread; later runs: minima after warm-up, in turns. Gravity acts for a second; 60 samples.
Both have the same orders, companion and longest step. Digits: 16 at a tolerance of 1e-15; heyoka's 19 and our 31 at
1e-19; heyoka's 33 and our 47 at 1e-33. errors: the largest of q at a sample, rad, against ours of 1e-42. heyoka
compiles straight code for the arm in 16 digits, loops else, which in more digits it does not optimize: optimizing
takes it 7 times as long, and halves its runs. verified: `tl.simulate` with a bar of 1e-12, 1e-25 and 1e-40, first.
"""

import functools
import os
import sys
import time
from typing import Any

import numpy as np

import twolink as tl
from scripts.heyoka_peer import integrator, parts_of, states_at
from scripts.runner import Table, once, options, print_bars, seconds_of
from scripts.tasks import scene_of
from twolink.integrate.digits import difference
from twolink.integrate.motion.scene_equations import equations_of
from twolink.integrate.solvers import taylor
from twolink.integrate.steps.perturbation import MIN_STEPS
from twolink.native import programs

DURATION, SAMPLES = 1.0, 60
TIMES = np.linspace(0.0, DURATION, SAMPLES + 1)
SETTINGS: dict[Any, tuple[float, float]] = {"double": (1e-15, 1e-12), "extended": (1e-19, 1e-25),
                                            "quad": (1e-33, 1e-40)}  # fmt: skip
BAR = 3.0  # of heyoka's time
clock = functools.partial(once, clock=time.process_time)


def row_of(name: str, precision: Any, truth: np.ndarray, rounds: int) -> tuple[Any, ...]:
    """A robot in a precision."""
    scene, (tolerance, accuracy) = scene_of(f"bent {name}"), SETTINGS[precision]
    equations, nq = equations_of(scene), scene.robot.nq
    code = {"compact_mode": name != "arm" or precision != "double", "opt_level": 3 if precision == "double" else 0}
    ours = functools.partial(taylor.solve, equations, TIMES, tolerance, precision=precision)
    programs._kept.clear()
    first, found = clock(ours)
    built, made = clock(lambda: integrator(equations, tolerance, precision, **code))
    start, kind = made.state.copy(), type(made.time)

    def theirs() -> np.ndarray:
        made.time, made.state[:] = kind(0), start
        return states_at(made, TIMES, DURATION / MIN_STEPS)

    alone, states = clock(theirs)
    warm, peer = seconds_of(ours, theirs, rounds=rounds, warm_up=0, clock=time.process_time, pick=min)
    numbers = found.x.T[..., None] if found.precise is None else found.precise
    errors = [float(np.abs(difference(x[:, :nq], truth[:, :nq])).max()) for x in (parts_of(states), numbers)]
    programs._kept.clear()
    verified, _ = clock(lambda: tl.simulate(scene, DURATION, accuracy=accuracy, samples_per_second=SAMPLES))
    return name, precision, *(1e3 * s for s in (built + alone, peer, first, warm)), warm / peer, *errors, verified


def main() -> int:
    given = options(__doc__, rounds=5, quick=False)
    os.environ["TWOLINK_CACHE"] = "off"
    table = Table("robot <6 | numbers <9 | heyoka first ms >8.0f | later ms >8.1f | ours first ms >8.0f | "
                  "ours later ms >8.1f | ratio >6.2f | its error >9.1e | our error >9.1e | bar s >6.2f")  # fmt: skip
    for name in ["arm"] if given.quick else ["arm", "ur5", "panda"]:
        truth = np.asarray(taylor.solve(equations_of(scene_of(f"bent {name}")), TIMES, 1e-42, precision="quad").precise)
        for precision in SETTINGS:
            table.add(*row_of(name, precision, truth, given.rounds))
    table.save("taylor")
    return not print_bars([(row[6] <= BAR, f"{row[0]}, {row[1]}: {row[6]:.2f} times heyoka's later runs (bar: {BAR:g})")
                           for row in table.rows])  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
