"""What does an error bar cost? Verified over unverified runs of bundled scenes, robots from rest, and worlds.

    python scripts/bench_verification.py [--robots 12] [--rounds 5]

Median seconds after warm-up of `simulate` at the same accuracy with and without verification, and of the run that is
returned without its error bar (alone): its tolerance is smaller where the first one does not do. Rows go to
out/bench_verification.csv. Prints the table, and the bars for verified over alone: median at most 2, worst at most 3.
"""

import argparse
import csv
import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np

import twolink as tl
from twolink.errors import TwolinkError

OUT = Path(__file__).parents[1] / "out" / "bench_verification.csv"
MEDIAN, WORST = 2.0, 3.0
AT_LEAST = 0.2  # s: short runs are repeated for so long


@dataclass(frozen=True)
class Row:
    """A case. seconds; ratio: verified over unverified; alone_ratio: verified over the returned run alone."""

    kind: str
    what: str
    accuracy: float
    method: str
    setting: float
    unverified: float
    alone: float
    verified: float

    @property
    def ratio(self) -> float:
        return self.verified / self.unverified

    @property
    def alone_ratio(self) -> float:
        return self.verified / self.alone


def seconds(act: Callable[[], object], rounds: int) -> float:
    """Median seconds after warm-up."""
    for _ in range(3):  # code that is compiled later for speed is there then
        act()
    taken: list[float] = []
    while len(taken) < rounds or sum(taken) < AT_LEAST:
        start = time.perf_counter()
        act()
        taken.append(time.perf_counter() - start)
    return statistics.median(taken)


def of_run(kind: str, what: str, scene: tl.Scene, accuracy: float, rounds: int) -> Row:
    """The row of a scene."""

    def verified() -> tl.Trajectory:
        return tl.simulate(scene, accuracy=accuracy)

    run = verified()
    assert run.cost is not None
    cost = run.cost
    setting = {"tolerance": cost.tolerance} if cost.tolerance else {"step": cost.step}
    digits = {"precision": cost.precision} if cost.precision != "double" else {}

    def alone() -> tl.Trajectory:
        if cost.method == "stepped":
            return tl.simulate(scene, step=cost.step, verify=False)
        return tl.simulate(scene, accuracy=accuracy, method=cost.method, verify=False, **setting, **digits)

    return Row(kind, what, accuracy, cost.method + "".join(f", {d}" for d in digits.values()), cost.setting,
               seconds(lambda: tl.simulate(scene, accuracy=accuracy, verify=False), rounds), seconds(alone, rounds),
               seconds(verified, rounds))  # fmt: skip


def of_worlds(what: str, scene: tl.Scene, q: np.ndarray, accuracy: float, rounds: int) -> Row:
    """The row of many worlds."""
    both = [seconds(lambda verify=verify: tl.simulate_many(scene, q, accuracy=accuracy, verify=verify), rounds)
            for verify in (False, True)]  # fmt: skip
    return Row("worlds", what, accuracy, "dop853", 0.0, both[0], both[0], both[1])


def rows(robots: int, rounds: int) -> Iterator[Row]:
    """All rows that can be made."""
    names = [row[0] for row in tl.scenes().rows]
    for name in names:
        yield of_run("bundled", name, tl.load_scene(name), 1e-6, rounds)
    catalogue = [row[0] for row in tl.robots().rows]
    chosen = catalogue if robots >= len(catalogue) else catalogue[:: max(1, len(catalogue) // robots)][:robots]
    for name in chosen:
        try:
            robot = tl.load_robot(name)
            scene = tl.Scene(robot, effects=[tl.effects.Gravity()], duration=1.0)
            yield of_run("from rest", name, scene, 1e-6, rounds)
        except TwolinkError as error:
            print(f"{name}: {error}"[:160])
    arm = tl.load_scene("arm-swing")
    for accuracy in (1e-9, 1e-11, 1e-12):
        yield of_run("near rounding", "arm-swing", arm, accuracy, rounds)
    ur5 = tl.load_robot("ur5")
    for accuracy in (1e-10, 1e-12):
        scene = tl.Scene(ur5, effects=[tl.effects.Gravity()], duration=1.0)
        yield of_run("near rounding", "ur5", scene, accuracy, rounds)
    random = np.random.default_rng(0)
    for count, accuracy in ((64, 1e-6), (1024, 1e-6), (1024, 1e-10)):
        yield of_worlds(f"{count} arms", arm, random.uniform(-2, 2, (count, 2)), accuracy, rounds)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", type=int, default=12, help="of the catalogue, evenly")
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    done: list[Row] = []
    print(f"{'kind':<14}{'what':<24}{'accuracy':>9}  {'method':<18}{'unverified':>11}{'alone':>10}{'verified':>10}"
          f"{'ratio':>7}{'alone':>7}")  # fmt: skip
    for row in rows(options.robots, options.rounds):
        done.append(row)
        print(f"{row.kind:<14}{row.what:<24}{row.accuracy:>9.0e}  {row.method:<18}{1e3 * row.unverified:>8.2f} ms"
              f"{1e3 * row.alone:>7.2f} ms{1e3 * row.verified:>7.2f} ms{row.ratio:>7.2f}{row.alone_ratio:>7.2f}",
              flush=True)  # fmt: skip
    OUT.parent.mkdir(exist_ok=True)
    with OUT.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, [f.name for f in fields(Row)])
        writer.writeheader()
        writer.writerows(map(asdict, done))
    ratios = [row.alone_ratio for row in done]
    median, worst = statistics.median(ratios), max(ratios)
    print(
        f"\nverified over the same run alone: median {median:.2f} (bar {MEDIAN:g}), worst {worst:.2f} (bar {WORST:g})"
    )
    whole = [row.ratio for row in done]
    print(
        f"verified over unverified at the same accuracy: median {statistics.median(whole):.2f}, worst {max(whole):.2f}"
    )
    return 0 if median <= MEDIAN and worst <= WORST else 1


if __name__ == "__main__":
    raise SystemExit(main())
