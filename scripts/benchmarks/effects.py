"""What effects cost: the same robot, as effects are added one at a time. And that absent effects cost nothing.

Below the table: what an event costs, by runs with friction, stops or a watch, less a run without them.

For each scene: operations of an evaluation, nanoseconds of one in a batch and alone (measured in compiled steps, the
median of rounds), and milliseconds of a whole run at the same accuracy. Two proofs stand below the table: the bare
robot's operations do not depend on which effects exist, and a scene without them does not import their modules.

    python -m scripts.benchmarks.effects [--robot arm] [--duration 5] [--accuracy 1e-8] [--quick]

Writes out/effects.csv.
"""

import time
from functools import partial

import numpy as np

import twolink as tl
from scripts.runner import Table, new_process, options, seconds_of
from twolink.effects import Effect
from twolink.integrate.motion.scene_equations import equations_of

ROUNDS = 9


def effects_of(robot: tl.Robot) -> list[tuple[str, Effect]]:
    """Effects to add, in order, each with a name for the table."""
    fx = tl.effects
    first, last = robot.joint_names[0], robot.joint_names[-1]
    tip = robot.model.frames[-1].name
    return [
        ("gravity", fx.Gravity()),
        ("damping of one joint", fx.JointDamping({first: 0.2})),
        ("damping of the others", fx.JointDamping(dict.fromkeys(robot.joint_names[1:], 0.1))),
        ("spring", fx.JointSpring({last: 3.0})),
        ("torque, a sine of time", fx.Torque({first: fx.Sine(1.0, 2.0)})),
        ("smoothed friction", fx.SmoothFriction(friction={first: 0.1}, scale=0.05)),
        ("drag on the last link", fx.AirDrag(frame=tip, area=0.02)),
        ("force on the last link", fx.FrameWrench(frame=tip, force=(0.5, 0.0, 0.0), axes="world")),
        ("rotor", fx.Rotor({first: 1e-4}, ratio={first: 50.0})),
        ("payload", fx.Payload(frame=tip, mass=0.3)),
        ("dry friction", fx.DryFriction({last: 0.05})),
        ("stops", fx.JointStops({last: (-2.0, 2.0)}, restitution=0.3)),
    ]


def milliseconds_per_event(robot: tl.Robot, q: np.ndarray, duration: float, accuracy: float, rounds: int) -> list[str]:
    """What each event adds to a run, by effect: processor time, the least of rounds."""
    fx, joint = tl.effects, robot.joint_names[-1]
    smooth = [fx.Gravity(), fx.JointDamping({robot.joint_names[0]: 0.02})]
    effects = {
        "dry friction": fx.DryFriction({joint: 0.05}),
        "stops": fx.JointStops({joint: (0.2, 0.4)}, restitution=0.8),
        "a watch": fx.Watch("middle", when=fx.JointReaches(joint, 0.0)),
    }
    lines = []
    for name, effect in effects.items():
        scenes = [tl.Scene(robot, q=q, effects=chosen, duration=duration) for chosen in (smooth, [*smooth, effect])]
        runs = [
            partial(tl.simulate, scene, duration, accuracy=accuracy, method="dop853", verify=False) for scene in scenes
        ]
        without, with_events = seconds_of(*runs, rounds=rounds, clock=time.process_time, pick=min)
        events = len(runs[1]().events)
        lines.append(f"{name}: {1e3 * (with_events - without) / max(1, events):.2f} ms ({events} events)")
    return lines


def main() -> None:
    """Print the table and the proofs."""
    given = options(__doc__, robot="arm", duration=5.0, accuracy=1e-8, quick=False)
    robot, rounds = tl.load_robot(given.robot), 3 if given.quick else ROUNDS
    q = np.where(robot.neutral == 0, 0.3, robot.neutral)
    table = Table(
        "effects so far <26 | operations >10 | added >+6.0f | ns, batch >10.1f | ns, alone >10.0f | run, ms >8.2f"
    )
    chosen: list[Effect] = []
    for name, effect in [("none: free motion", None), *effects_of(robot)]:
        chosen += [effect] if effect else []
        scene = tl.Scene(robot, q=q, effects=chosen, duration=given.duration)
        found = tl.explain(scene, accuracy=given.accuracy, method="dop853")
        run = partial(tl.simulate, scene, given.duration, accuracy=given.accuracy, method="dop853", verify=False)
        added = found.operations - (table.rows[-1][1] if table.rows else found.operations)
        table.add(name if effect is None else f"+ {name}", found.operations, added,
                  *(found.nanoseconds or (np.nan, np.nan)), 1e3 * seconds_of(run, rounds=rounds)[0])  # fmt: skip
    bare = equations_of(tl.Scene(robot, q=q)).operations
    print(f"\nthe bare robot again, all these modules loaded: {bare} operations, {table.rows[0][1]} before")
    events = milliseconds_per_event(robot, q, given.duration, given.accuracy, rounds)
    print(f"an event adds to a run: {', '.join(events)}")
    code = ("import sys, twolink as tl; tl.simulate(tl.load_scene('arm-swing'), 0.1);"
            "print(*[m for m in sys.modules if m.startswith('twolink.effects.')], sep=', ')")  # fmt: skip
    print(f"modules of effects that arm-swing imports: {new_process(code, check=True).stdout.strip()}")
    table.save("effects")


if __name__ == "__main__":
    main()
