"""What everyday calls cost beside other versions of the package: is anything slower than it was?

    python -m scripts.benchmarks.before CHECKOUT [CHECKOUT ...] [--rounds 3] [--limit 300] [--quick]

CHECKOUT is a folder with another version, as `git worktree add` makes it, which runs in this environment. Every call
runs in a new process of each version in turn, once from an empty cache, then `--rounds` times from what that left.
Milliseconds of processor time: first, of the very first call; later, the least of all calls behind the first three.
Scenes, verified to 1e-6, are those that all versions have. ratio: ours over the fastest other version's. Writes
out/before.csv. Ends 0 where no later call is more than 1.2 times slower and 0.2 ms.
--quick: the first three calls.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from scripts.runner import TOP, Table, new_process, options, print_bars

SCENES = "import twolink as tl\nprint(*[one['name'] for one in tl.scenes().to_records()])"
ROBOT = "robot = tl.load_robot(%r)\n"
STATES = "q, v = robot.random_state(%d, seed=1)\n"
CALLS = {
    **{f"{function}, {n} of {name}": ROBOT % name + STATES % n + f"call = lambda: robot.{function}(q, v, v)"
       for function in ("forward_dynamics", "inverse_dynamics") for name in ("arm", "ur5", "panda")
       for n in (1, 100, 10_000)},
    **{f"verified fall of {name}": ROBOT % name + "scene = tl.Scene(robot, np.linspace(0.3, 0.9, robot.nq), effects=["
       "tl.effects.Gravity()], duration=2.0)\ncall = lambda: tl.simulate(scene, accuracy=1e-6)"
       for name in ("arm", "ur5")},
    "Simulation.step of arm-swing": "one = tl.Simulation(tl.load_scene('arm-swing'))\ncall = lambda: one.step(1e-5)",
    "sensitivities of arm-swing": "scene = tl.load_scene('arm-swing')\n"
    "call = lambda: tl.sensitivities(scene, wrt=['q', 'v'], accuracy=1e-9)",
    "100 worlds of arm-swing": "scene = tl.load_scene('arm-swing')\n"
    "q = np.asarray(scene.q) + 1e-3 * np.arange(100)[:, None]\ncall = lambda: tl.simulate_many(scene, q=q)",
    "linearize arm-swing": "scene = tl.load_scene('arm-swing')\ncall = lambda: tl.linearize(scene)",
    "load_robot of ur5": "call = lambda: tl.load_robot('ur5')",
}  # fmt: skip
SCENE = "scene = tl.load_scene(%r)\ncall = lambda: tl.simulate(scene, accuracy=1e-6)"
TIMED = """
import sys, time, warnings, numpy as np, twolink as tl
warnings.simplefilter("ignore")
%s
taken, begin = [], time.process_time()
while len(taken) < 5 or (len(taken) < 200 and time.process_time() - begin < 1.0):
    start = time.process_time()
    call()
    taken.append(time.process_time() - start)
print(taken[0], min(taken[3:]))
"""


def seconds(folder: Path, code: str, cache: str, limit: float) -> tuple[float, float]:
    """First and later call in a new process of a version; nan where it has no such call."""
    try:
        done = new_process(TIMED % code, cache=cache, timeout=limit, cwd=folder)
        first, later = map(float, done.stdout.split())
    except (subprocess.TimeoutExpired, ValueError):
        return float("nan"), float("nan")
    return first, later


def main() -> int:
    given = options(__doc__, rest=(), rounds=3, limit=300.0, quick=False)
    os.environ["TWOLINK_THREADS"] = "1"
    folders = [TOP, *(Path(one).resolve() for one in given.rest)]
    common = set.intersection(*(set(new_process(SCENES, cwd=folder).stdout.split()) for folder in folders))
    calls = {**CALLS, **{f"scene {name}": SCENE % name for name in sorted(common)}}
    heads = "".join(f" | first {one.name} >12.2f | later {one.name} >12.3f" for one in folders)
    table, slower = Table(f"call <32{heads} | ratio >7.2f"), []
    for name, code in list(calls.items())[: 3 if given.quick else None]:
        with tempfile.TemporaryDirectory() as top:
            caches = [tempfile.mkdtemp(dir=top) for _ in folders]
            rounds = [[seconds(*one, given.limit) for one in zip(folders, [code] * len(folders), caches, strict=True)]
                      for _ in range(1 + given.rounds)]  # fmt: skip
        first = [a for a, _ in rounds[0]]
        later = [min(each) for each in zip(*([b for _, b in one] for one in rounds), strict=True)]
        others = [one for one in later[1:] if one == one]
        ratio = later[0] / min(others) if others else float("nan")
        table.add(name, *(1e3 * t for pair in zip(first, later, strict=True) for t in pair), ratio)
        if ratio > 1.2 and later[0] - min(others) > 2e-4:
            slower.append(name)
    table.save("before")
    return not print_bars([(not slower, f"{len(slower)} calls are slower than before: {', '.join(slower)}")])


if __name__ == "__main__":
    sys.exit(main())
