"""Robots and scenes of benchmarks and studies, by name, and runs of them that several measure."""

import functools
import time
from collections.abc import Callable
from typing import Any

import numpy as np

import twolink as tl
from scripts.runner import FINGERS, new_process, seconds_of

FREE = ("anymal", "talos")  # in the air
DAMPING = 0.1  # N m s/rad or N s/m: of the joints of robots that fall
FEET = {"solo12": 0.0165, "anymal": 0.03}  # m, their radius
GAINS = {"solo12": (5.0, 0.1), "anymal": (150.0, 4.0)}  # N m/rad, N m s/rad
FACTORS = 10.0, 3.0, 1.0, 0.3, 0.1, 0.03, 0.01, 1e-3  # of the error: tolerances of SciPy
RUNS = """
import sys, time, twolink as tl
from scripts.tasks import scene_of
scene = scene_of(sys.argv[1])
for _ in range(int(sys.argv[3])):
    start = time.process_time()
    tl.simulate(scene, accuracy=float(sys.argv[2]))
    print(time.process_time() - start, flush=True)
"""


@functools.cache
def robot_of(name: str) -> tl.Robot:
    """A robot of the catalogue, the Panda with locked fingers; "chain30": 30 rods of 1 m and 1 kg in a plane."""
    if name.startswith("chain"):
        from twolink.hard.cases.smooth import chain_urdf

        return tl.load_robot(chain_urdf([1.0] * int(name[5:])))
    return tl.load_robot(name, root="free" if name in FREE else "fixed", lock=FINGERS if name == "panda" else None)


def falling(name: str, start: int = 0, root: str = "fixed", *, stops: bool = False) -> tl.Scene:
    """A robot of the catalogue under gravity with damped joints, from a random start, for 2 s.

    stops: with those of its URDF.
    """
    robot, fx = tl.load_robot(name, root=root), tl.effects
    damped = {joint.name: DAMPING for joint in robot.joints if joint.kind != "free-flyer"}
    q, v = robot.random_state(1, seed=start)
    effects = [fx.Gravity(), *([fx.JointDamping(damped)] if damped else [])]
    effects += [fx.JointStops()] if stops and fx.JointStops().modes(robot) else []
    return tl.Scene(robot, q[0], v[0], effects=effects, duration=2.0)


def bent_legs(robot: tl.Robot) -> tuple[np.ndarray, dict[str, float]]:
    """A quadruped's q with bent legs, whose hind ones bend the other way, and the targets of its joints."""
    q, target = robot.neutral, dict[str, float]()
    for joint in robot.joints[1:]:
        side = -1.0 if "H" in joint.name[:2] else 1.0
        q[joint.q] = target[joint.name] = side * {"HAA": 0.0, "HFE": 0.8, "KFE": -1.6}[joint.name[-3:]]
    return q, target


def on_feet(name: str) -> tuple[tl.Robot, np.ndarray, dict[str, float], tl.effects.Contact]:
    """A quadruped 1 cm above the ground with bent legs; the targets of its joints; its feet on the ground."""
    robot = tl.load_robot(name, root="free")
    q, target = bent_legs(robot)
    feet, radius = [name for name in robot.frame_names if name.endswith("FOOT")], FEET[name]
    q[2] = radius + 0.01 - min(float(robot.frame_pose(q, foot)[1][2]) for foot in feet)
    contact = tl.effects.Contact(tuple((foot, "ground") for foot in feet), 0.6,
                                 shapes={foot: (tl.effects.Sphere(radius),) for foot in feet})  # fmt: skip
    return robot, q, target, contact


def scene_of(name: str) -> tl.Scene:
    """A bundled scene, a robot that falls, or, as "bent ur5", one that is released from a bent posture, for 2 s."""
    if name.startswith("bent "):
        robot = robot_of(name[5:])
        return tl.Scene(robot, np.linspace(0.3, 0.9, robot.nq), effects=[tl.effects.Gravity()], duration=2.0)
    return tl.load_scene(name) if name in {one["name"] for one in tl.scenes().to_records()} else falling(name)


def loaded(kind: Callable[[], Any]) -> list[str]:
    """The names in a catalogue, `tl.robots` or `tl.scenes`, but for those that are refused."""
    return [one["name"] for one in kind().to_records() if not one.get("refused")]


def runs_anew(name: str, accuracy: float, runs: int = 1, **how: Any) -> list[float]:
    """Processor seconds of the runs of a scene in a new process, without imports. how: of the process."""
    done = new_process(RUNS, name, str(accuracy), str(runs), **how)
    if done.returncode:
        raise RuntimeError(done.stderr.strip().splitlines()[-1][:90])
    return [float(line) for line in done.stdout.splitlines()]


def alone(scene: tl.Scene, accuracy: float, run: tl.Trajectory) -> Callable[[], tl.Trajectory]:
    """The run that an answer is, without the second solution behind its error bar."""
    cost, how = run.cost, dict[str, Any](verify=False)
    if cost.method == "stepped":
        return functools.partial(tl.simulate, scene, step=cost.step, **how)
    how |= {"tolerance": cost.tolerance} if cost.tolerance else {"step": cost.step}
    how |= {"precision": cost.precision} if cost.precision != "double" else {}
    return functools.partial(tl.simulate, scene, accuracy=accuracy, method=cost.method, **how)


def by_scipy(scene: tl.Scene, exact: tl.Trajectory, error: float) -> tuple[Callable[[], Any], str]:
    """The cheapest of SciPy's methods on `pin.aba` with at most this true error, as a call, and its name.

    Where none comes so near, the tightest. Raises UnsupportedError for a scene that is more than smooth joints.
    """
    from twolink.hard.peers import scipy_peer
    from twolink.hard.peers.task import Setting, task_of
    from twolink.hard.truths import distance

    task, found = task_of(scene, exact.t), list[tuple[bool, float, Callable[[], Any], str]]()
    for method in ("DOP853", "RK45", "LSODA"):
        for factor in FACTORS:
            tolerance = max(error * factor, 1e-13)
            call = scipy_peer.prepare(task, Setting(method, "", tolerance))
            reached = float(distance(scene.robot, call().track.q, exact.q).max()) <= error
            if reached or factor == FACTORS[-1]:
                (taken,) = seconds_of(call, rounds=3, warm_up=0, clock=time.process_time, pick=min)
                found.append((not reached, taken, call, f"{method} {tolerance:.0e}"))
                break
    missed, _, call, name = min(found, key=lambda one: one[:2])
    return call, f"{name} (less exact)" if missed else name
