"""Bodies that touch: what an error costs beside MuJoCo and Drake, and large scenes by time stepping.

block       a block slides to rest, v0^2 / (2 mu g): error over seconds, located, stepped, and by the peers
spheres     spheres fall into a box: energy, overlap, speed at the end, seconds a step, beside MuJoCo's
quadruped   Solo and ANYmal fall on their four feet and stand, under PD control: error over seconds, beside MuJoCo's
Seconds are of the processor, medians for block and quadruped. Durations and steps in s are the part's own by default.

    python -m scripts.benchmarks.contact [block spheres quadruped] [--count 500] [--duration 1] [--step 2e-3]
"""

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

import twolink as tl
from scripts.runner import Table, once, options, seconds_of
from scripts.studies.scenes.robots import body, free_robot, robot_of
from twolink.hard.peers import peer_module
from twolink.hard.peers.task import Setting, task_of

E, G = tl.effects, 9.81
PARTS = ("block", "spheres", "quadruped")
STIFF = 10.0 ** -np.arange(3.0, 10.0)  # accuracies of Drake's stiff contact
COLUMNS = "way <58 | error >9.1e | ms >11.3f | more <1"
RADIUS = 0.05  # m, of balls
FEET = {"solo12": 0.0165, "anymal": 0.03}  # m
GAINS = {"solo12": (5.0, 0.1), "anymal": (150.0, 4.0)}  # N m/rad, N m s/rad


def measured(run: Callable[[], Any]) -> tuple[float, Any]:
    """The median of the processor ms, and the result: other programs may be running."""
    return 1e3 * seconds_of(run, clock=time.process_time)[0], run()


def block() -> None:
    """A block slides to rest on its four corners."""
    mu, v0, end = 0.3, 2.0, 1.0
    robot = robot_of(body("cart", 1e-3, 1e-6, "prismatic", "x", axis="1 0 0")
                     + body("block", 1.0, 1e-6, "prismatic", "z", parent="cart"))  # fmt: skip
    effects = [E.Gravity(), E.Contact((("block", "ground"),), mu, shapes={"block": (E.Box((0.4, 0.3, 0.2)),)})]
    scene = tl.Scene(robot, [0, 0.1], [v0, 0], effects, end)
    times = np.linspace(0, end, 11)
    slower = mu * G / 1.001  # the cart moves along and presses on nothing
    t = np.fmin(times, v0 / slower)
    exact = v0 * t - slower * t**2 / 2
    print("a block slides to rest: the largest error of 10 samples")
    table = Table(COLUMNS)

    def line(name: str, run: Callable[[], Any], q_of: Callable[[Any], np.ndarray] = lambda run: run.q) -> None:
        taken, answer = measured(run)
        table.add(name, float(np.abs(q_of(answer)[:, 0] - exact).max()), taken, "")

    solve = partial(partial, tl.simulate, scene, end, samples_per_second=10)
    for accuracy in (1e-4, 1e-8):
        for verify in (False, True):
            bar = ", with error bar" * verify
            line(f"located, accuracy {accuracy:g}{bar}", solve(accuracy=accuracy, verify=verify))
    for step in (1e-1, 1e-2, 1e-3):
        line(f"stepped, {step:g} s", solve(contact="stepped", step=step, verify=False))
    settings = {
        "mujoco": [Setting(method, f"step {h:g} s", step=h) for method in ("Euler", "implicitfast", "RK4")
                   for h in (2e-3, 2e-4, 2e-5)],
        "drake": [*(Setting("discrete plant (SAP)", f"step {h:g} s", step=h) for h in (1e-2, 1e-3, 1e-4)),
                  *(Setting("cenic", f"stiffness 1e7 N/m, accuracy {a:g}", a, 0.1) for a in STIFF)],
    }  # fmt: skip
    task = task_of(scene, times)
    for name, own in settings.items():
        try:
            module = peer_module(name)
        except ImportError:
            continue
        for setting in own:
            line(f"{name} {module.VERSION}, {setting}", module.prepare(task, setting), lambda run: run.track.q)


def balls(count: int, side: int, g: float = G) -> tl.Scene:
    """Balls fall into a box, in layers of side x side."""
    random, wide = np.random.default_rng(1), 1.2 * RADIUS * side
    names = [f"s{k}" for k in range(count)]
    robot = free_robot(*((name, 0.5, (0.4 * 0.5 * RADIUS**2,) * 3) for name in names))
    places = np.array([(k % side, k // side % side, k // side**2) for k in range(count)], float) * 2.4 * RADIUS
    places += [1.2 * RADIUS - wide, 1.2 * RADIUS - wide, 3 * RADIUS]
    places += random.uniform(-0.1 * RADIUS, 0.1 * RADIUS, (count, 3))
    q = np.concatenate([places, np.tile([0, 0, 0, 1.0], (count, 1))], axis=1).ravel()
    pairs = ("self", "ground", *((name, wall) for name in names for wall in walls(side)))
    contact = E.Contact(pairs, 0.3, shapes={name: (E.Sphere(RADIUS),) for name in names})
    return tl.Scene(robot, q, effects=[E.Gravity((0.0, 0.0, -g)), contact])


def walls(side: int) -> list[tl.effects.Plane]:
    """The sides of the box."""
    return [E.Plane((x, y, 0.0), -1.2 * RADIUS * side) for x, y in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0))]


def balls_by_mujoco(scene: tl.Scene, side: int, step: float) -> Any:
    """MuJoCo's model of `balls`: its own broad phase needs geoms that may touch, not pairs."""
    import mujoco

    spec = mujoco.MjSpec()
    spec.option.timestep, spec.option.gravity, spec.memory = step, scene.robot.model.gravity.linear, 2**30
    touching: dict[str, Any] = {"friction": [0.3, 0, 0], "condim": 3}
    for plane in (E.Plane(), *walls(side)):
        n = np.array(plane.normal)
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[5, 5, 1], pos=n * plane.height, zaxis=n,
                                **touching)  # fmt: skip
    for pose in scene.q.reshape(-1, 7):
        body = spec.worldbody.add_body(pos=pose[:3])
        body.add_freejoint()
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[RADIUS, 0, 0], mass=0.5, **touching)
    return spec.compile()


def spheres(count: int, duration: float, step: float) -> None:
    """Many balls, ours and MuJoCo's."""
    import mujoco

    side = max(3, round(count ** (1 / 3)))
    taken, scene = once(lambda: balls(count, side))
    print(f"{count} spheres, {duration:g} s, step {step:g} s: scene in {taken:.1f} s", flush=True)
    taken, run = once(lambda: tl.simulate(
        scene, duration, contact="stepped", step=step, samples_per_second=1 / step, verify=False,
        progress=lambda t, *_: print(f"    t = {t:.3f} s", flush=True)), time.process_time)  # fmt: skip
    grown, fastest = np.diff(run.energy).max() / abs(run.energy[0]), np.abs(run.v[-1].reshape(-1, 6)).max(axis=0)
    print(f"  {taken * step / duration * 1e3:.1f} ms a step, energy grows by {grown:.1e} of itself in a step at most, "
          f"{run.energy[0]:.1f} J to {run.energy[-1]:.1f} J, at the end up to {fastest[:3].max():.1e} m/s and "
          f"{fastest[3:].max():.1e} rad/s, {run.contact_record}")  # fmt: skip
    model, steps, deepest, taken = balls_by_mujoco(scene, side, step), round(duration / step), 0.0, 0.0
    data = mujoco.MjData(model)
    for _ in range(steps):
        taken += once(lambda: mujoco.mj_step(model, data), time.process_time)[0]
        deepest = max(deepest, -float(data.contact.dist.min(initial=0.0)))
    print(f"  MuJoCo {mujoco.__version__}: {taken / steps * 1e3:.1f} ms a step, overlap up to {deepest:.1e} m")


def bent_legs(robot: tl.Robot) -> tuple[np.ndarray, dict[str, float]]:
    """A quadruped's q with bent legs, whose hind ones bend the other way, and the targets of its joints."""
    q, target = robot.neutral, dict[str, float]()
    for joint in robot.joints[1:]:
        side = -1.0 if "H" in joint.name[:2] else 1.0
        q[joint.q] = target[joint.name] = side * {"HAA": 0.0, "HFE": 0.8, "KFE": -1.6}[joint.name[-3:]]
    return q, target


def on_feet(name: str) -> tuple[tl.Robot, np.ndarray, dict[str, float], E.Contact]:
    """A quadruped 1 cm above the ground with bent legs; the targets of its joints; its feet on the ground."""
    robot = tl.load_robot(name, root="free")
    q, target = bent_legs(robot)
    feet, radius = [name for name in robot.frame_names if name.endswith("FOOT")], FEET[name]
    q[2] = radius + 0.01 - min(float(robot.frame_pose(q, foot)[1][2]) for foot in feet)
    pairs = tuple((foot, "ground") for foot in feet)
    return robot, q, target, E.Contact(pairs, 0.6, shapes={foot: (E.Sphere(radius),) for foot in feet})


def quadruped(name: str, duration: float) -> None:
    """A robot on its feet. Errors are of q: against the law of rigid contact, and of MuJoCo's against its own limit.

    Rigid contact is located; that of ANYmal, whose feet slide and stick many times, is stepped by 50 us. MuJoCo's PD
    control is springs and dampers in the joints, which its Euler method takes implicitly.
    """
    robot, q, target, contact = on_feet(name)
    gains = tuple(dict.fromkeys(target, gain) for gain in GAINS[name])
    scene = tl.Scene(robot, q, effects=[E.Gravity(), E.JointPD(target, *gains), contact])
    effects = [E.Gravity(), E.JointSpring(gains[0], rest=target), E.JointDamping(gains[1]), contact]
    times = np.linspace(0.0, duration, round(20 * duration) + 1)
    task = task_of(tl.Scene(robot, q, effects=effects), times)
    print(f"{name} falls on its feet and stands, {duration:g} s: the largest error of q at {len(times)} samples")
    exactly: dict[str, Any] = {"contact": "stepped", "step": 5e-5} if name == "anymal" else {"contact": "located"}
    solve = partial(tl.simulate, scene, duration, samples_per_second=20, verify=False)
    exact, table = solve(accuracy=1e-8, **exactly).q, Table(COLUMNS)

    def off(some: np.ndarray, others: np.ndarray) -> float:
        return float(np.abs(robot.difference(some, others)).max())

    mujoco = peer_module("mujoco")
    limit = mujoco.prepare(task, Setting("Euler", "", step=2e-5))().track.q
    for step in (1e-2, 4e-3, 2e-3, 1e-3, 2e-4):
        taken, answer = measured(mujoco.prepare(task, Setting("Euler", "", step=step)))
        found, usual = answer.track.q, ", the default" * (step == 2e-3)
        table.add(f"mujoco {mujoco.VERSION}, Euler, step {step:g} s{usual}", off(found, exact), taken,
                  f"{off(found, limit):.1e} from its own limit")  # fmt: skip
    for count in (2, 3, 4, 5, 10, 25):
        stepped = partial(solve, contact="stepped", step=0.05 / count)
        way = f"stepped, {50 / count:.3g} ms"
        try:
            while "held" not in (stepped().contact_record or {})["solvers"]:
                pass  # until its steps have cost what compiling them does
        except tl.errors.AccuracyError as error:
            table.add(way, None, None, error.what)
            continue
        taken, run = measured(stepped)
        slower, verified = measured(partial(stepped, verify=True))
        more = f"with its error estimated, {verified.error.max():.1e}: {slower:.1f} ms; {run.contact_record}"
        table.add(way, off(run.q, exact), taken, more)
    if exactly["contact"] == "located":
        taken, run = measured(partial(solve, accuracy=1e-4, **exactly))
        table.add("located, accuracy 1e-4", off(run.q, exact), taken, "")


def main() -> None:
    given = options(__doc__, rest=PARTS, count=500, duration=float, step=float)
    if "block" in given.rest:
        block()
    if "quadruped" in given.rest:
        for name in FEET:
            quadruped(name, given.duration or 2.0)
    if "spheres" in given.rest:
        spheres(given.count, given.duration or 1.0, given.step or 2e-3)


if __name__ == "__main__":
    main()
