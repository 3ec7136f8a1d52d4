"""Tasks with contacts: what the first answer costs, one run by steps, and MuJoCo at its default and at the same error.

Of each task a line for `simulate(scene)` without arguments, with its estimate beside its error; for one run with a step
of 5 ms, the second one, without an estimate; for MuJoCo's default, Euler with 2 ms; for MuJoCo's longest steps that are
as exact as the run of 5 ms; and for Drake's usual settings, where it is installed. Errors are of q at 20 samples a
second, against a run with steps of 0.5 ms; in piles, whose motion depends on roundings, they say little. ms are of the
processor, ratios to MuJoCo's default.

Where contacts are located by default, the run with an accuracy of 1e-8 is what errors are against, and a line has the
second run. PD control in MuJoCo is springs and dampers in the joints, which its Euler method takes implicitly.

    python -m scripts.benchmarks.contact_tasks [block upright_box stack pile dominoes spheres quadruped solo12 ...]
"""

import contextlib
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import mujoco
import numpy as np

import twolink as tl
from scripts.runner import Table, once, options
from scripts.studies.scenes.robots import body, free_robot, robot_of
from scripts.tasks import GAINS, bent_legs, on_feet
from twolink.hard.peers import mujoco_peer, peer_module
from twolink.hard.peers.task import PeerError, Setting, UnsupportedError, task_of

E = tl.effects
G, RADIUS = 9.75, 0.05  # m, of balls
GRAVITY = E.Gravity((0.0, 0.0, -G))
Task = tuple[tl.Scene, float]  # and its duration, s


def block() -> Task:
    """A block slides to rest on its four corners."""
    robot = robot_of(body("cart", 1e-3, 1e-6, "prismatic", "x", axis="1 0 0")
                     + body("block", 1.0, 1e-6, "prismatic", "z", parent="cart"))  # fmt: skip
    contact = E.Contact((("block", "ground"),), 0.3, shapes={"block": (E.Box((0.4, 0.3, 0.2)),)})
    return tl.Scene(robot, [0.0, 0.1], [2.0, 0.0], [GRAVITY, contact]), 1.0


def boxes(sizes: np.ndarray, places: np.ndarray, friction: float, *, v: np.ndarray | None = None) -> tl.Scene:
    """Boxes of 1000 kg/m^3 with edges (n, 3) at places (n, 7) over the ground."""
    masses = 1000.0 * sizes.prod(axis=1)
    moments = [tuple((m / 12.0 * (e @ e - e**2)).tolist()) for m, e in zip(masses, sizes, strict=True)]
    names = [f"b{k}" for k in range(len(sizes))]
    robot = free_robot(*zip(names, masses.tolist(), moments, strict=True))
    shapes = {name: (E.Box(tuple(size)),) for name, size in zip(names, sizes.tolist(), strict=True)}
    q = robot.normalize(places.ravel())
    return tl.Scene(robot, q, v, [GRAVITY, E.Contact(("self", "ground"), friction, shapes=shapes)])


def upright_box() -> Task:
    """An upright box slides to rest."""
    v = np.array([1.0, 0, 0, 0, 0, 0])
    return boxes(np.array([[0.1, 0.1, 0.3]]), np.array([[0, 0, 0.15, 0, 0, 0, 1.0]]), 0.2, v=v), 1.0


def stack(count: int = 10) -> Task:
    """Boxes on each other."""
    heights = 0.05 + 0.1 * np.arange(count)[:, None]
    places = np.concatenate([np.zeros((count, 2)), heights, np.tile([0, 0, 0, 1.0], (count, 1))], axis=1)
    return boxes(np.full((count, 3), 0.1), places, 0.5), 1.0


def pile() -> Task:
    """Ten boxes tumble onto each other and come to rest."""
    random = np.random.default_rng(1)
    high = 0.15 + 0.17 * np.arange(10)[:, None]
    places = np.concatenate([random.uniform(-0.06, 0.06, (10, 2)), high, random.normal(size=(10, 4))], axis=1)
    return boxes(np.full((10, 3), 0.1), places, 0.5), 2.0


def dominoes() -> Task:
    """The first of ten falls on the others."""
    places = np.zeros((10, 7))
    places[:, 0], places[:, 2], places[:, 6] = 0.06 * np.arange(10), 0.06, 1.0
    v = np.zeros(60)
    v[:6] = 2.5 * np.array([0.06, 0, 0.01, 0, 1.0, 0])  # about its front edge
    return boxes(np.tile([0.02, 0.06, 0.12], (10, 1)), places, 0.4, v=v), 1.0


def spheres(count: int = 50, side: int = 4, duration: float = 1.5) -> Task:
    """Spheres fall into a box, in layers of so many in a row."""
    random, wide = np.random.default_rng(1), 1.2 * RADIUS * side
    names = [f"s{k}" for k in range(count)]
    robot = free_robot(*((name, 0.5, (0.4 * 0.5 * RADIUS**2,) * 3) for name in names))
    places = np.array([(k % side, k // side % side, k // side**2) for k in range(count)], float) * 2.4 * RADIUS
    places += [1.2 * RADIUS - wide, 1.2 * RADIUS - wide, 3 * RADIUS]
    places += random.uniform(-0.1 * RADIUS, 0.1 * RADIUS, (count, 3))
    q = np.concatenate([places, np.tile([0, 0, 0, 1.0], (count, 1))], axis=1).ravel()
    pairs = ("self", "ground", *((name, wall) for name in names for wall in walls(side)))
    contact = E.Contact(pairs, 0.3, shapes={name: (E.Sphere(RADIUS),) for name in names})
    return tl.Scene(robot, q, effects=[GRAVITY, contact]), duration


def walls(side: int) -> list[tl.effects.Plane]:
    """The sides of the box."""
    return [E.Plane((x, y, 0.0), -1.2 * RADIUS * side) for x, y in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0))]


def balls_by_mujoco(scene: tl.Scene, side: int, step: float) -> Any:
    """MuJoCo's model of `spheres`: its own broad phase needs geoms that may touch, not pairs."""
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


def sprung(robot: tl.Robot, q: np.ndarray, target: dict[str, float], contact: E.Contact, name: str) -> tl.Scene:
    """A quadruped with springs and dampers in its joints."""
    kp, kd = (dict.fromkeys(target, gain) for gain in GAINS[name])
    return tl.Scene(robot, q, effects=[GRAVITY, E.JointSpring(kp, rest=target), E.JointDamping(kd), contact])


def quadruped() -> Task:
    """Solo on its own collision meshes falls 1 cm and stands."""
    robot = tl.load_robot("solo12", root="free")
    q, target = bent_legs(robot)
    q[2] = 0.25
    return sprung(robot, q, target, E.Contact(("ground",), 0.6), "solo12"), 1.0


def standing(name: str) -> Task:
    """A quadruped falls 1 cm on four spheres and stands."""
    return sprung(*on_feet(name), name), 2.0


TASKS: dict[str, Callable[[], Task]] = {
    **{one.__name__: one for one in (block, upright_box, stack, pile, dominoes, spheres, quadruped)},
    **{name: partial(standing, name) for name in GAINS}, "stack-20": partial(stack, 20)}  # fmt: skip
LARGE = {"spheres-200": (200, 6, 1.5), "spheres-500": (500, 8, 0.5)}  # spheres, in a row, and the time, s
BUNDLED = ("arm-pushes-box", "bouncing-ball", "bowl", "can-on-table", "grasp", "newtons-cradle", "quadruped-stands",
           "quadruped-trots", "rattleback", "sphere-pile", "spinning-coin", "tippe-top")  # fmt: skip
STEP, EXACT, DEFAULT = 5e-3, 5e-4, 2e-3  # s: of the run, of the truth, MuJoCo's
CHANCE = 0.1  # rad or m: estimates above say nothing
TRUE = 1e-8  # rad, m: of located contacts
FINER, FINEST = 4.0, 1e-5  # by which MuJoCo's steps become shorter, and the shortest, s


def bundled(name: str) -> Task:
    """A bundled scene."""
    scene = tl.load_scene(name)
    return scene, scene.duration


def compare(name: str, table: Table) -> None:
    """The lines of a task."""
    scene, duration = TASKS.get(name, partial(bundled, name))()
    times = np.linspace(0.0, duration, round(20 * duration) + 1)

    def stepped(step: float) -> Callable[[], tl.Trajectory]:
        return partial(tl.simulate, scene, duration, t_eval=times, contact="stepped", step=step, verify=False)

    def located(accuracy: float | None = None) -> tl.Trajectory:
        return tl.simulate(scene, duration, t_eval=times, accuracy=accuracy)

    def peer(setting: Setting | float, module: Any = mujoco_peer) -> tuple[float, np.ndarray]:
        known = setting if isinstance(setting, Setting) else Setting("Euler", "", step=setting)
        run = module.prepare(task_of(scene, times), known)
        run()
        taken, answer = once(run, time.process_time)
        return taken, answer.track.q

    first, answer = once(located, time.process_time)
    is_located = answer.bound == "verified"
    parted = is_located or answer.error[-1] > CHANCE  # of motions that have parted no step is the truth
    if is_located:
        exact = located(TRUE).q
    else:
        exact = stepped(EXACT if parted else min(EXACT, (answer.cost.step or EXACT) / FINER))().q
    default, usual = np.nan, None
    try:
        default, usual = peer(DEFAULT)
    except (PeerError, UnsupportedError) as error:
        print(f"{name}: MuJoCo is left out: {error}")

    def line(way: str, taken: float, q: np.ndarray, more: str = "") -> float:
        off = float(np.abs(scene.robot.difference(q, exact)).max())
        table.add(name, way, off, 1e3 * taken, taken / default, more)
        return off

    line("simulate(scene)", first, answer.q, f"{answer.bound}, error <= {answer.error[-1]:.1e}; {answer.cost.why}")
    least = np.inf
    if is_located:
        taken, run = once(located, time.process_time)
        least = line("second run", taken, run.q)
    try:
        stepped(STEP)()
        taken, run = once(stepped(STEP), time.process_time)
        least = min(least, line(f"stepped, {1e3 * STEP:g} ms", taken, run.q, str(run.contact_record)))
    except tl.errors.SceneError as error:
        print(f"{name}: {error}")
    if usual is None:
        return
    off, step = line(f"MuJoCo, {1e3 * DEFAULT:g} ms", default, usual), DEFAULT
    while off > least and (step := step / FINER) >= FINEST:
        taken, q = peer(step)
        off = line(f"MuJoCo, {1e3 * step:g} ms", taken, q)
    with contextlib.suppress(ImportError):  # an extra
        drake = peer_module("drake")
        for setting in drake.usual_settings(task_of(scene, times)):
            line(f"Drake, {setting}", *peer(setting, drake))


def compare_large(name: str, table: Table) -> None:
    """The lines of spheres whose motion no shorter step tells: what they cost."""
    count, side, duration = LARGE[name]
    scene = spheres(count, side)[0]
    model = balls_by_mujoco(scene, side, DEFAULT)
    steps = partial(mujoco.mj_step, model, mujoco.MjData(model), round(duration / DEFAULT))
    default, _ = once(steps, time.process_time)
    solve = partial(tl.simulate, scene, duration, samples_per_second=20, contact="stepped", step=STEP, verify=False)
    taken, run = once(solve, time.process_time)
    table.add(name, f"stepped, {1e3 * STEP:g} ms", np.nan, 1e3 * taken, taken / default, str(run.contact_record))
    table.add(name, f"MuJoCo, {1e3 * DEFAULT:g} ms", np.nan, 1e3 * default, 1.0, "")


def main() -> None:
    given = options(__doc__, rest=(*TASKS, *BUNDLED, *LARGE))
    table = Table("task <12 | way <33 | error >8.1e | ms >9.1f | ratio >7.1f | more <1")
    for name in given.rest:
        (compare_large if name in LARGE else compare)(name, table)


if __name__ == "__main__":
    main()
