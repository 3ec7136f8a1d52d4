"""Others' tests: published numbers and exact solutions (`published`), SimBenchmark's scenes, ContactBench's problems.

SimBenchmark (Kang, Hwangbo 2018, github.com/leggedrobotics/SimBenchmark, benchmark/*.hpp) plots an error against the
seconds of a run, both for each length of step. Its errors are means over a run of squares:
rolling     25 balls on a box that 150 N push over the ground: of the velocities of box and ball, m^2/s^2
bouncing    49 balls of 10 kg that fall 5 m and bounce without loss: of the energy of all, J^2
balls       216 balls without friction fall on each other and on the ground: of all overlaps, m^2
elastic     the same without loss: of the energy, J^2
`theirs` are its published figures (data/*/sample.csv), the best engine without error reduction at that step, with that
engine's error and seconds on its authors' machine. Seconds are of the processor.

ContactBench (Le Lidec et al. 2023, github.com/Simple-Robotics/ContactBench) has problems as files of G, g and mus
(tests/python/data/*.npz there): --problems names a folder with them. Lines say what the laws are missed by.

    python -m scripts.benchmarks.outsiders [published rolling bouncing balls elastic] [--steps 0.01,0.001]
        [--problems FOLDER] [--results FOLDER]

--results writes the motions of IFToMM's problems as its library takes them.
"""

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from scipy.spatial.distance import pdist

import twolink as tl
from scripts.benchmarks.published import compare, write_results
from scripts.runner import Some, Table, once, options
from scripts.studies.scenes.robots import free_robot
from twolink.contact.impulses import ContactProblem, solve_impulses

E, G = tl.effects, 9.8
Error = Callable[[tl.Trajectory], float]
# By test and step, s: error, seconds and engine.
THEIRS = {
    "rolling": {1e-2: "4.4e-09 in 0.11 s, Bullet", 1e-3: "4.9e-09 in 0.59 s, Bullet"},
    "bouncing": {1e-2: "1.9e+02 in 0.025 s, RaiSim", 1e-3: "1.9e-02 in 0.22 s, RaiSim"},
    "balls": {1e-2: "1.5e-02 in 0.16 s, RaiSim", 1e-3: "1.4e-04 in 1.4 s, RaiSim"},
    "elastic": {1e-2: "5.2e+06 in 0.073 s, RaiSim", 1e-3: "8.4e+00 in 0.68 s, RaiSim"},
}


def spheres(centres: np.ndarray, radius: float, mass: float, **contact: float) -> tl.Scene:
    """Balls at centres (n, 3) over the ground."""
    names = [f"b{k}" for k in range(len(centres))]
    robot = free_robot(*((name, mass, (0.4 * mass * radius**2,) * 3) for name in names))
    q = np.concatenate([centres, np.tile([0.0, 0.0, 0.0, 1.0], (len(names), 1))], axis=1).ravel()
    shapes = {name: (E.Sphere(radius),) for name in names}
    return tl.Scene(robot, q, effects=[E.Gravity((0, 0, -G)), E.Contact(("self", "ground"), shapes=shapes, **contact)])


def rolling() -> tuple[tl.Scene, float, Error]:
    grid = 2.0 * np.arange(5) - 4.0
    centres = [(x, y, 1.5) for x in grid for y in grid]
    balls, mass, force, mu, mu_ball = [f"b{k}" for k in range(25)], 10.0, 150.0, 0.4, 0.8
    plate = tuple(mass / 12.0 * x for x in (401.0, 401.0, 800.0))
    robot = free_robot(("a", mass, plate), *((name, 1.0, (0.1,) * 3) for name in balls))
    q = np.concatenate([np.array([[0.0, 0.0, 0.5], *centres]), np.tile([0.0, 0.0, 0.0, 1.0], (26, 1))], axis=1).ravel()
    shapes = {"a": (E.Box((20.0, 20.0, 1.0)),), **{name: (E.Sphere(0.5),) for name in balls}}
    pairs = tuple((name, "a") for name in balls)
    effects = [E.Gravity((0, 0, -G)), E.FrameWrench("a", force=(0.0, force, 0.0)),
               E.Contact((("a", "ground"),), mu, shapes=shapes), E.Contact(pairs, mu_ball, shapes=shapes)]  # fmt: skip
    drag = mu * (mass + 25.0) * G
    # Of the box on each ball, which rolls: a slip's rate is 3.5 of it.
    push = (force - drag) / mass / (3.5 + 25.0 / mass)
    rates = np.array([(force - drag - 25.0 * push) / mass, push])

    def error(run: tl.Trajectory) -> float:
        v = run.v.reshape(len(run.t), 26, 6)[:, :2, :3].copy()
        for k, row in enumerate(v):  # along the world's axes
            for i in range(2):
                row[i] = run.robot.frame_pose(run.q[k], ("a", "b0")[i])[0] @ row[i]
        v[:, :, 1] -= run.t[:, None] * rates
        return float((v**2).sum(axis=(1, 2)).mean())

    return tl.Scene(robot, q, effects=effects), 4.0, error


def energy(run: tl.Trajectory) -> float:
    return float(((run.energy - run.energy[0]) ** 2).mean())


def bouncing() -> tuple[tl.Scene, float, Error]:
    centres = np.array([(2.0 * i, 2.0 * k, 5.0) for i in range(7) for k in range(7)])
    return spheres(centres, 0.1, 10.0, friction=0.0, restitution=1.0), 20.0, energy


def heap(restitution: float) -> tl.Scene:
    """216 balls."""
    places = 0.21 * np.array([(i, j, k) for i in range(6) for j in range(6) for k in range(6)])
    shaken = places + np.random.default_rng(42).uniform(0.0, 1e-3, places.shape) + [0.0, 0.0, 1.101]
    return spheres(shaken, 0.1, 10.0, friction=0.0, restitution=restitution)


def balls() -> tuple[tl.Scene, float, Error]:
    def overlaps(run: tl.Trajectory) -> float:
        places = run.q.reshape(len(run.t), -1, 7)[:, :, :3]
        return float(np.mean([(np.fmax(0.2 - pdist(x), 0.0) ** 2).sum() + (np.fmax(0.1 - x[:, 2], 0.0) ** 2).sum()
                              for x in places]))  # fmt: skip

    return heap(0.0), 2.0, overlaps


def elastic() -> tuple[tl.Scene, float, Error]:
    return heap(1.0), 2.0, energy


TESTS = {one.__name__: one for one in (rolling, bouncing, balls, elastic)}


def main() -> None:
    given = options(__doc__, rest=Some(("published", *TESTS)), steps=(1e-2, 1e-3), problems=Path, results=Path)
    if given.results:
        write_results(given.results)
    if "published" in given.rest:
        given.rest.remove("published")
        compare()
        print()
    table = Table("test <12 | step s >8.0e | error >9.1e | s >8.3f | steps/s >9.0f | theirs <1")
    for name in given.rest:
        scene, duration, error = TESTS[name]()
        for step in given.steps:
            run = partial(tl.simulate, scene, duration, contact="stepped", step=step, verify=False)
            measured = error(run(samples_per_second=50.0))
            taken, _ = once(partial(run, samples_per_second=1.0), time.process_time)
            table.add(name, step, measured, taken, duration / step / taken, THEIRS[name].get(step, ""))
    for path in sorted(given.problems.glob("*.npz")) if given.problems else ():
        data = np.load(path, allow_pickle=False)
        problem = ContactProblem(data["G"], data["g"].reshape(-1, 3), data["mus"])
        taken, found = once(partial(solve_impulses, problem, np.zeros_like(problem.b)), time.process_time)
        print(f"{path.stem}: {len(data['mus'])} contacts, missed by {found.residual:.1e} m/s, {1e3 * taken:.2f} ms")


if __name__ == "__main__":
    main()
