"""Closed chains of many loops: seconds to the first answer and of a run, and how far it is from the exact motion.

A row of N four-bars has 2 N + 1 degrees of freedom and moves as one pendulum, which is solved as a robot of one joint.
Four-bars below each other, 3 N degrees of freedom, keep their energy. Each first answer is that of a process of its
own with an empty cache: it includes what is made, compiled and certified, and the second solution behind the error bar.
The time for one state's accelerations stands beside that of a linear solve alone, of M and J given (`evaluation`).

    python -m scripts.benchmarks.loops [--shape row|hanging] [--numbers 1,2,4,8,16,40] [--duration 1] [--accuracy 1e-6]
"""

import json
import time
from collections.abc import Callable

import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

import twolink as tl
from scripts.runner import Table, new_process, once, options, seconds_of
from twolink.algorithms.namespaces import Numbers
from twolink.hard.cases.loops import hanging_four_bars, pendulum_of_row, row_of_four_bars
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.scene_equations import equations_of
from twolink.integrate.steps.programs import programs_of

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
    constraints = equations.constraints
    residuals = max(float(np.abs([float(g) for g in constraints.residuals(constraints.mech, list(q), np)]).max())
                    for q in run.q[:: len(run.q) // 4])  # fmt: skip
    print(json.dumps([number, scene.robot.nv, equations.operations, first, again, run.cost.compile_seconds,
                      *evaluation(equations, run), float(run.error[-1]), residuals, off]))  # fmt: skip


def evaluation(equations: Equations, run: tl.Trajectory) -> list[float]:
    """Processor microseconds for the accelerations of one of the run's states: compiled, and of a KKT solve.

    (M, J^T; J, 0) (a, -lambda) = (-h, -J' v), sparse (SuperLU) or dense (LAPACK), of matrices that are there already.
    The compiled rate computes its own; of one state after the other ("one"), or of all together, on one thread. All
    must agree.
    """
    robot, loops, nv = equations.robot, equations.constraints, equations.robot.nv
    numbers = range(0, len(run.q), max(1, len(run.q) // 50))
    code = programs_of(equations).rate
    columns = [np.concatenate([[0.0], run.q[i], run.v[i]]) for i in numbers]
    systems = []
    for i in numbers:
        q, v = run.q[i], run.v[i]
        jacobian = loops.jacobian_at(q, loops.kept)
        terms = [float(x) for x in loops.velocity_terms(loops.mech, q, v, Numbers)]
        matrix = np.block([[robot.mass_matrix(q), jacobian.T], [jacobian, np.zeros((len(terms), len(terms)))]])
        systems.append((matrix, csc_array(matrix), -np.concatenate([robot.bias(q, v), terms])))
    block = np.ascontiguousarray(np.array(columns).T)
    ways: dict[str, Callable[[], list[np.ndarray]]] = {
        "one": lambda: [code(x) for x in columns],
        "together": lambda: list(code(block).T),
        "sparse": lambda: [splu(sparse).solve(right) for _, sparse, right in systems],
        "dense": lambda: [np.linalg.solve(matrix, right) for matrix, _, right in systems],
    }
    accelerations = np.array(ways["dense"]())[:, :nv]
    for way, part in (("one", slice(-nv, None)), ("together", slice(-nv, None)), ("sparse", slice(nv))):
        np.testing.assert_allclose(np.array(ways[way]())[:, part], accelerations, rtol=1e-8, atol=1e-8)
    times = seconds_of(*ways.values(), rounds=20, warm_up=0, clock=time.thread_time, pick=min)
    return [1e6 * taken / len(columns) for taken in times]


def main() -> None:
    """The table, one process a row."""
    given = options(__doc__, shape="row", numbers=(1, 2, 4, 8, 16, 40), duration=1.0, accuracy=1e-6)
    print("us for the accelerations of a state: compiled, one and together; a KKT solve, sparse and dense")
    table = Table("N >4 | dofs >5 | operations >10, | first, s >8.2f | again, s >8.3f | compile, s >9.2f | one >8.2f | "
                  "together >8.2f | sparse >8.2f | dense >8.2f | bar >8.1e | residual >8.1e | off <8")  # fmt: skip
    for number in given.numbers:
        arguments = f"{given.shape!r}, {number}, {given.duration}, {given.accuracy}"
        done = new_process(f"from scripts.benchmarks.loops import print_row\nprint_row({arguments})", check=True)
        table.add(*json.loads(done.stdout.splitlines()[-1]))


if __name__ == "__main__":
    main()
