"""Closed chains of many loops: seconds to the first answer and of a run, and how far it is from the exact motion.

A row of N four-bars has 2 N + 1 degrees of freedom and moves as one pendulum, which is solved as a robot of one joint.
Four-bars below each other, 3 N degrees of freedom, keep their energy. Each first answer is that of a process of its
own with an empty cache: it includes what is made, compiled and certified, and the second solution behind the error bar.

    python -m scripts.benchmarks.loops [--shape row|hanging] [--numbers 1,2,4,8,16,40] [--duration 1] [--accuracy 1e-6]
"""

import json

import numpy as np

import twolink as tl
from scripts.runner import Table, new_process, once, options
from twolink.hard.cases.loops import hanging_four_bars, pendulum_of_row, row_of_four_bars
from twolink.integrate.motion.scene_equations import equations_of

START = -1.1, 0.5  # rad, rad/s: of the links of a row, which do not pass their singular position


def print_row(shape: str, number: int, duration: float, accuracy: float) -> None:
    """Print a row of the table as JSON."""
    scene = row_of_four_bars(number, *START) if shape == "row" else hanging_four_bars(number)
    first, run = once(lambda: tl.simulate(scene, duration, accuracy=accuracy))
    again, _ = once(lambda: tl.simulate(scene, duration, accuracy=accuracy))
    if shape == "row":
        exact = tl.simulate(pendulum_of_row(number, *START), duration, accuracy=accuracy / 1e3)
        signs = np.array([1.0 if name.startswith("j") else -1.0 for name in scene.robot.joint_names])
        off = f"{np.abs(run.q - exact.q * signs).max():.1e}"
    else:
        off = f"{np.ptp(run.energy) / np.abs(run.energy).max():.1e} of its energy"
    equations = equations_of(scene)
    loops = equations.constraints
    residuals = max(float(np.abs([float(g) for g in loops.residuals(loops.mech, list(q), np)]).max())
                    for q in run.q[:: len(run.q) // 4])  # fmt: skip
    print(json.dumps([number, scene.robot.nv, equations.operations, first, again, run.cost.compile_seconds,
                      float(run.error[-1]), residuals, off]))  # fmt: skip


def main() -> None:
    """The table, one process a row."""
    given = options(__doc__, shape="row", numbers=(1, 2, 4, 8, 16, 40), duration=1.0, accuracy=1e-6)
    table = Table("N >4 | dofs >5 | operations >10, | first, s >8.2f | again, s >8.3f | compile, s >9.2f | bar >8.1e | "
                  "residual >8.1e | off <8")  # fmt: skip
    for number in given.numbers:
        arguments = f"{given.shape!r}, {number}, {given.duration}, {given.accuracy}"
        done = new_process(f"from scripts.benchmarks.loops import print_row\nprint_row({arguments})", check=True)
        table.add(*json.loads(done.stdout.splitlines()[-1]))


if __name__ == "__main__":
    main()
