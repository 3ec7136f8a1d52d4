"""What effects cost: the same robot, as effects are added one at a time.

Below the table: what an event costs, by runs with friction, stops or a watch, less a run without them.

For each scene: operations of an evaluation, nanoseconds of one in a batch and alone (measured in compiled steps, the
median of rounds), and milliseconds of a whole run at the same accuracy. That absent effects cost nothing is held by
tests/effects/test_every_effect.py.

    python -m scripts.benchmarks.effects [--robot arm] [--duration 5] [--accuracy 1e-8] [--quick]

Writes out/effects.csv.
"""

import time
from functools import partial

import numpy as np

import twolink as tl
from scripts.runner import Table, options, seconds_of
from twolink.effects import Effect

ROUNDS = 9


def effects_of(robot: tl.Robot) -> dict[str, Effect]:
    """Effects to add, in order."""
    fx = tl.effects
    first, last, tip = robot.joint_names[0], robot.joint_names[-1], robot.model.frames[-1].name
    return {
        "gravity": fx.Gravity(),
        "damping of one joint": fx.JointDamping({first: 0.2}),
        "damping of the others": fx.JointDamping(dict.fromkeys(robot.joint_names[1:], 0.1)),
        "spring": fx.JointSpring({last: 3.0}),
        "torque, a sine of time": fx.Torque({first: fx.Sine(1.0, 2.0)}),
        "smoothed friction": fx.SmoothFriction(friction={first: 0.1}, scale=0.05),
        "drag on the last link": fx.AirDrag(frame=tip, area=0.02),
        "force on the last link": fx.FrameWrench(frame=tip, force=(0.5, 0.0, 0.0), axes="world"),
        "rotor": fx.Rotor({first: 1e-4}, ratio={first: 50.0}),
        "payload": fx.Payload(frame=tip, mass=0.3),
        "dry friction": fx.DryFriction({last: 0.05}),
        "stops": fx.JointStops({last: (-2.0, 2.0)}, restitution=0.3),
    }


def main() -> None:
    """Print the table, and what each event adds to a run: processor time, the least of rounds."""
    given, fx = options(__doc__, robot="arm", duration=5.0, accuracy=1e-8, quick=False), tl.effects
    robot, rounds = tl.load_robot(given.robot), 3 if given.quick else ROUNDS
    q, joint = np.where(robot.neutral == 0, 0.3, robot.neutral), robot.joint_names[-1]
    table = Table("effects so far <26 | operations >10 | added >+6.0f | ns, batch >10.1f | ns, alone >10.0f | "
                  "run, ms >8.2f")  # fmt: skip

    def run_of(chosen: list[Effect]) -> partial[tl.Trajectory]:
        scene = tl.Scene(robot, q=q, effects=chosen, duration=given.duration)
        return partial(tl.simulate, scene, accuracy=given.accuracy, method="dop853", verify=False)

    chosen: list[Effect] = []
    for name, effect in {"none: free motion": None, **effects_of(robot)}.items():
        chosen += [effect] if effect else []
        run = run_of(chosen)
        found = tl.explain(run.args[0], accuracy=given.accuracy, method="dop853")
        added = found.operations - (table.rows[-1][1] if table.rows else found.operations)
        table.add(name if effect is None else f"+ {name}", found.operations, added,
                  *(found.nanoseconds or (np.nan, np.nan)), 1e3 * seconds_of(run, rounds=rounds)[0])  # fmt: skip
    smooth = [fx.Gravity(), fx.JointDamping({robot.joint_names[0]: 0.02})]
    switching = {"dry friction": fx.DryFriction({joint: 0.05}),
                 "a watch": fx.Watch("middle", when=fx.JointReaches(joint, 0.0)),
                 "stops": fx.JointStops({joint: (0.2, 0.4)}, restitution=0.8)}  # fmt: skip
    for name, effect in switching.items():
        runs = run_of(smooth), run_of([*smooth, effect])
        without, with_events = seconds_of(*runs, rounds=rounds, clock=time.process_time, pick=min)
        events = len(runs[1]().events)
        print(f"{name}: {1e3 * (with_events - without) / max(1, events):.2f} ms an event ({events} events)")
    table.save("effects")


if __name__ == "__main__":
    main()
