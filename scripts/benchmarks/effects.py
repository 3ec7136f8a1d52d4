"""What effects cost: the same robot, as effects are added one at a time. And that absent effects cost nothing.

Below the table: what an event costs, by runs with friction, stops or a watch, less a run without them.

For each scene: operations of an evaluation, nanoseconds of one in a batch and alone (measured in compiled steps, the
median of rounds), and milliseconds of a whole run at the same accuracy. Two proofs stand below the table: the bare
robot's operations do not depend on which effects exist, and a scene without them does not import their modules.

    python scripts/bench_effects.py [--robot arm] [--quick]
"""

import argparse
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

import twolink as tl
from twolink.effects import Effect
from twolink.integrate.scene_equations import equations_of
from twolink.io.tables import write_table

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


def seconds_of_run(scene: tl.Scene, duration: float, accuracy: float, rounds: int) -> float:
    """The median time of solving, compiling not counted."""
    tl.simulate(scene, duration, accuracy, method="dop853", verify=False)
    taken = []
    for _ in range(rounds):
        start = time.perf_counter()
        tl.simulate(scene, duration, accuracy, method="dop853", verify=False)
        taken.append(time.perf_counter() - start)
    return float(np.median(taken))


def milliseconds_per_event(robot: tl.Robot, duration: float, accuracy: float, rounds: int) -> list[str]:
    """What each event adds to a run, by effect: processor time, the least of rounds."""
    fx = tl.effects
    joint, q = robot.joint_names[-1], np.where(robot.neutral == 0, 0.3, robot.neutral)
    smooth = [fx.Gravity(), fx.JointDamping({robot.joint_names[0]: 0.02})]
    effects = {
        "dry friction": fx.DryFriction({joint: 0.05}),
        "stops": fx.JointStops({joint: (0.2, 0.4)}, restitution=0.8),
        "a watch": fx.Watch("middle", when=fx.JointReaches(joint, 0.0)),
    }
    lines = []
    for name, effect in effects.items():
        seconds, events = [], 0
        for chosen in (smooth, [*smooth, effect]):
            scene = tl.Scene(robot, q=q, effects=chosen, duration=duration)
            taken = []
            for _ in range(rounds + 1):
                start = time.process_time()
                run = tl.simulate(scene, duration, accuracy, method="dop853", verify=False)
                taken.append(time.process_time() - start)
            seconds.append(min(taken))
            events = len(run.events)
        lines.append(f"{name}: {1e3 * (seconds[1] - seconds[0]) / max(1, events):.2f} ms ({events} events)")
    return lines


def absent_modules() -> list[str]:
    """The modules of effects that a scene with gravity alone imports."""
    code = (
        "import sys, twolink as tl; tl.simulate(tl.load_scene('arm-swing'), 0.1);"
        "print(*[m for m in sys.modules if m.startswith('twolink.effects.')])"
    )
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()


def main() -> None:
    """Print the table and the proofs; write out/bench_effects.csv."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robot", default="arm")
    parser.add_argument("--duration", type=float, default=5.0)
    parser.add_argument("--accuracy", type=float, default=1e-8)
    parser.add_argument("--quick", action="store_true", help="fewer rounds")
    options = parser.parse_args()
    robot = tl.load_robot(options.robot)
    q = np.where(robot.neutral == 0, 0.3, robot.neutral)
    rounds = 3 if options.quick else ROUNDS
    rows: dict[str, list[float]] = {"operations": [], "added": [], "ns_batch": [], "ns_alone": [], "run_ms": []}
    print(f"{'effects so far':<26}{'operations':>11}{'added':>7}{'ns, batch':>11}{'ns, alone':>11}{'run, ms':>9}")
    chosen: list[Effect] = []
    names = ["none: free motion"]
    for name, effect in [("none: free motion", None), *effects_of(robot)]:
        if effect is not None:
            chosen.append(effect)
            names.append(f"+ {name}")
        scene = tl.Scene(robot, q=q, effects=chosen, duration=options.duration)
        found = tl.explain(scene, options.accuracy, method="dop853")
        batch, alone = found.nanoseconds or (np.nan, np.nan)
        run = 1e3 * seconds_of_run(scene, options.duration, options.accuracy, rounds)
        added = found.operations - (rows["operations"][-1] if rows["operations"] else found.operations)
        for key, value in zip(rows, (found.operations, added, batch, alone, run), strict=True):
            rows[key].append(float(value))
        print(f"{names[-1]:<26}{found.operations:>11}{added:>+7.0f}{batch:>11.1f}{alone:>11.0f}{run:>9.2f}", flush=True)
    bare = equations_of(tl.Scene(robot, q=q)).operations
    print(f"\nthe bare robot again, all these modules loaded: {bare} operations, {rows['operations'][0]:.0f} before")
    print("an event adds to a run: " + ", ".join(
        milliseconds_per_event(robot, options.duration, options.accuracy, rounds)))  # fmt: skip
    print(f"modules of effects that arm-swing imports: {', '.join(absent_modules())}")
    columns = {"effects": np.array(names), **{k: np.array(v) for k, v in rows.items()}}
    print(f"wrote {write_table(Path('out/bench_effects.csv'), columns, {})}")


if __name__ == "__main__":
    main()
