"""What `explain` takes, and whether its figures are true: for robots of the catalogue under gravity with damped joints.

    python -m scripts.benchmarks.explaining [ROBOT ...] [--rounds 3] [--measured 12]

Columns: processor seconds of `explain`, its programs not yet traced; its nanoseconds of an evaluation over measured
ones, in a batch of 8,192 and alone; its seconds of the run over those of the run alone, its programs at hand. The
figures of the first `measured` robots that can be solved are held against measured ones, those of all others are not.
Ends 0 if each answer comes within 0.3 s, each evaluation is true within a factor of 2.5, each run within one of 6.
"""

import sys
import time
from functools import partial
from typing import Any

import numpy as np

import twolink as tl
from scripts.runner import Table, once, options, print_bars, seconds_of
from scripts.tasks import falling, loaded
from twolink.errors import TwolinkError
from twolink.integrate.motion.scene_equations import equations_of
from twolink.integrate.steps.programs import programs_of
from twolink.robots.catalogue import catalogue_entry

LIMIT, FACTORS, BATCH = 0.3, {"batch": 2.5, "alone": 2.5, "run": 6.0}, 8192


def scene_of(name: str) -> tl.Scene:
    """The robot from a random start, as the catalogue has its root."""
    return falling(name, root=catalogue_entry(name).usual_root)


def measured(scene: tl.Scene, found: Any, rounds: int) -> list[float]:
    """The explanation's figures over measured ones: in a batch, alone, and of the run."""
    equations = equations_of(scene, ticks=True)
    rate = programs_of(equations).rate
    x = np.repeat(np.concatenate([[0.0], equations.start])[None], BATCH, axis=0)
    out = np.empty((BATCH, rate.outputs))
    run = partial(tl.simulate, scene, method=found.method, tolerance=found.setting, verify=False)
    taken = seconds_of(lambda: rate.run([x], [out]), lambda: rate.run([x], [out], 1), run,
                       rounds=rounds, clock=time.process_time, pick=min)  # fmt: skip
    said = (*(1e-9 * BATCH * ns for ns in found.nanoseconds), found.expected_seconds)
    return [ours / true for ours, true in zip(said, taken, strict=True)]


def main() -> int:
    given = options(__doc__, rest=(), rounds=3, measured=12)
    names, left = given.rest or loaded(tl.robots), given.measured
    tl.explain(scene_of("arm"))  # imports, and the speed of this processor
    table = Table("robot <26 | nv >4 | operations >10 | s >6.2f | method <9 | batch >6.2f | alone >6.2f | run >6.2f")
    for name in names:
        scene, ratios = scene_of(name), [None] * len(FACTORS)
        seconds, found = once(partial(tl.explain, scene), time.process_time)
        if left and found.nanoseconds is not None:
            try:
                ratios, left = measured(scene, found, given.rounds), left - 1
            except TwolinkError as error:
                print(f"{name} is not solved: {error}")
        table.add(name, scene.robot.nv, found.operations, seconds, found.method, *ratios)
    table.save("explaining")
    late = [f"{row[0]} {row[3]:.2f}" for row in table.rows if row[3] > LIMIT]
    bars = [(not late, f"{len(names) - len(late)} of {len(names)} answers within {LIMIT} s; later: {', '.join(late)}")]
    for at, (what, factor) in enumerate(FACTORS.items(), 5):
        off = max((max(row[at], 1 / row[at]) for row in table.rows if row[at] is not None), default=1.0)
        bars.append((off <= factor, f"{what}: true within {off:.1f} (bar: {factor})"))
    return not print_bars(bars)


if __name__ == "__main__":
    sys.exit(main())
