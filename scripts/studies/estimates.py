"""How good is the estimated error of stepped contacts? Random scenes, each stepped and held against its true motion.

    python scripts/honest_estimates.py [--scenes 100] [--seed 0] [--first 0]

Scenes: `contact_scenes`; every other arm gets stops and dry friction in its joints. The truth is the exact motion, or
a located run whose bar, of 1e-9, counts as doubt. Each scene is stepped twice: with a step from 1 to 10 ms, and with an
accuracy from 1e-3 to 1e-2.

A run is within its estimate if no sample is farther from the truth than estimated there. over: the true error over the
estimate where that is largest. Rows go to out/honest_estimates-SEED.csv.
"""

import argparse
import collections
import csv
import os
import signal
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from contact_scenes import KINDS, Case, case

import twolink as tl
from twolink import effects as fx
from twolink.errors import TwolinkError
from twolink.hard.truths import distance

OUT = Path(__file__).parents[1] / "out"
SAMPLES = 60  # of a run
PATIENCE = 60.0  # s of processor time for a run
LOCATED = 1e-9
FLOOR = 1e-9  # rad or m: errors below it count as none
WAYS = ("step", "accuracy")


@dataclass(frozen=True)
class Row:
    """A run and what came of it. asked: the step, s, or the accuracy. off, estimate: their largest, rad or m."""

    scene: int
    kind: str
    way: str
    asked: float
    outcome: str = ""
    over: float = 0.0
    off: float = 0.0
    estimate: float = 0.0


class HangError(Exception):
    """The processor time of a run is up."""


def jointed(one: Case, random: np.random.Generator) -> Case:
    """The scene of an arm with stops and dry friction in its joints."""
    q = one.scene.q
    stops = {f"j{k}": (x - random.uniform(0.2, 1.0), x + random.uniform(0.2, 1.0)) for k, x in enumerate(q.tolist())}
    friction = {name: float(random.uniform(0.05, 0.5)) for name in stops}
    joints = [fx.JointStops(stops, float(random.choice([0.0, 0.5]))), fx.DryFriction(friction)]
    return replace(one, scene=tl.Scene(one.scene.base, q, one.scene.v, [*one.scene.effects, *joints]))


def rows_of(number: int, seed: int) -> Iterator[Row]:
    """Step one scene in both ways, and judge the estimates."""
    random, kind, one = np.random.default_rng([seed, number, 1]), KINDS[number % len(KINDS)], case(number, seed)
    if kind == "arm" and number // len(KINDS) % 2:
        one, kind = jointed(one, random), "arm+"
    asked = {"step": float(10 ** random.uniform(-3, -2)), "accuracy": float(10 ** random.uniform(-3, -2))}
    known: Any = None
    for way in WAYS:
        row = Row(number, kind, way, asked[way])
        try:
            known = _located(one) if known is None else known
            run = _run(one, contact="stepped", **{way: asked[way]})
            count = min(len(run.t), len(known[0]))
            off = _off(run, known[0], one) if one.truth is None else _off(run, one.truth(run.t), one)
            yield _judged(row, off[:count], known[1][:count], run.error[:count])
        except HangError:
            yield replace(row, outcome="no truth" if known is None else "HANG")
        except TwolinkError as error:
            yield replace(row, outcome="no truth" if known is None else error.code)


def _located(one: Case) -> tuple[np.ndarray, np.ndarray]:
    """Configurations and their error bars; of an exact motion times."""
    if one.truth is not None:
        count = len(_times(one))
        return np.zeros(count), np.zeros(count)
    run = _run(one, contact="located", accuracy=LOCATED)
    assert run.error is not None
    return run.q, run.error


def _times(one: Case) -> np.ndarray:
    return np.linspace(0.0, one.duration, SAMPLES + 1)


def _off(run: tl.Trajectory, truth: np.ndarray, one: Case) -> np.ndarray:
    """The true error at each sample, rad or m."""
    if one.truth is None:
        count = min(len(run.q), len(truth))
        return distance(run.robot, run.q[:count], truth[:count])
    columns = np.concatenate([np.arange(7 * k, 7 * k + 3) for k in range(truth.shape[1] // 3)])
    return np.asarray(np.abs(run.q[:, columns] - truth).max(axis=1))


def _run(one: Case, **options: Any) -> tl.Trajectory:
    """A run within PATIENCE. Raises HangError."""
    signal.signal(signal.SIGPROF, _hang)
    signal.setitimer(signal.ITIMER_PROF, PATIENCE)
    try:
        return tl.simulate(one.scene, one.duration, samples=SAMPLES / one.duration, **options)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)


def _hang(*_: object) -> None:
    raise HangError


def _judged(row: Row, off: np.ndarray, doubt: np.ndarray, estimate: np.ndarray) -> Row:
    sure = np.maximum(off - doubt - FLOOR, 0.0)
    over = float((sure[1:] / np.maximum(estimate[1:], FLOOR)).max())
    outcome = next((name for name, most in (("within", 1.0), ("within 3", 3.0), ("within 10", 10.0)) if over <= most),
                   "beyond")  # fmt: skip
    return replace(row, outcome=outcome, over=over, off=float(off.max()), estimate=float(estimate.max()))


def print_table(rows: list[Row]) -> None:
    """Judged runs by kind, then what was refused."""
    names = ("within", "within 3", "within 10", "beyond")
    print(f"{'kind':<10}{'way':<10}{'judged':>7}" + "".join(f"{name:>11}" for name in names)
          + f"{'worst':>9}{'median size':>13}")  # fmt: skip
    for way in WAYS:
        for kind in (*KINDS, "arm+", "all"):
            some = [r for r in rows if kind in (r.kind, "all") and r.way == way and r.outcome in names]
            if not some:
                continue
            counts = "".join(f"{sum(r.outcome == name for r in some):>11}" for name in names)
            sizes = [r.estimate / r.off for r in some if r.off > FLOOR]
            print(f"{kind:<10}{way:<10}{len(some):>7}{counts}{max(r.over for r in some):>9.2g}"
                  f"{np.median(sizes or [np.nan]):>13.2g}")  # fmt: skip
    others = collections.Counter(f"{r.way} {r.outcome}" for r in rows if r.outcome not in names)
    print("\nnot judged: " + ", ".join(f"{count} {what}" for what, count in others.most_common()))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="the first scene's number")
    options = parser.parse_args()
    os.environ.setdefault("TWOLINK_CACHE", "off")
    OUT.mkdir(exist_ok=True)
    rows: list[Row] = []
    with (OUT / f"honest_estimates-{options.seed}.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, [f.name for f in fields(Row)], lineterminator="\n")
        writer.writeheader()
        for number in range(options.first, options.first + options.scenes):
            for row in rows_of(number, options.seed):
                rows.append(row)
                writer.writerow(asdict(row))
                file.flush()
    print_table(rows)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
