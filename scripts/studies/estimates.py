"""How good is the estimated error of stepped contacts? Random scenes, each stepped and held against its true motion.

    python -m scripts.studies.estimates [--scenes 100] [--seed 0] [--first 0]

Scenes: `scenes.contacts`; every other arm gets stops and dry friction in its joints. The truth is the exact motion, or
a located run whose bar, of 1e-9, counts as doubt. Each scene is stepped twice: with a step from 1 to 10 ms, and with an
accuracy from 1e-3 to 1e-2.

A run is within its estimate if no sample is farther from the truth than estimated there. worst: the true error over the
estimate where that is largest. Rows go to out/estimates-SEED.csv.
"""

import argparse
import collections
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import twolink as tl
from scripts.runner import Bars, Judged, OutOfTime, Table, processor_time, study
from scripts.studies.scenes.contacts import KINDS, case
from scripts.studies.scenes.robots import Case, free_positions
from twolink import effects as fx
from twolink.errors import TwolinkError
from twolink.hard.truths import distance

SAMPLES = 60  # of a run
PATIENCE = 60.0  # s of processor time for a run
LOCATED = 1e-9
FLOOR = 1e-9  # rad or m: errors below it count as none
WAYS = ("step", "accuracy")
JUDGED = {"within": 1.0, "within 3": 3.0, "within 10": 10.0, "beyond": np.inf}


@dataclass
class Row(Judged):
    """A run. asked: the step, s, or the accuracy. worst: over the estimate; off, estimate: their largest, rad or m."""

    way: str = ""
    asked: float = 0.0
    off: float = 0.0
    estimate: float = 0.0


def jointed(one: Case, random: np.random.Generator) -> Case:
    """The scene of an arm with stops and dry friction in its joints."""
    q = one.scene.q
    stops = {f"j{k}": (x - random.uniform(0.2, 1.0), x + random.uniform(0.2, 1.0)) for k, x in enumerate(q.tolist())}
    friction = {name: float(random.uniform(0.05, 0.5)) for name in stops}
    joints = [fx.JointStops(stops, float(random.choice([0.0, 0.5]))), fx.DryFriction(friction)]
    return replace(one, scene=tl.Scene(one.scene.base, q, one.scene.v, [*one.scene.effects, *joints]))


def rows_of(number: int, given: argparse.Namespace) -> Iterator[Row]:
    """Step one scene in both ways, and judge the estimates."""
    random = np.random.default_rng([given.seed, number, 1])
    kind, one = KINDS[number % len(KINDS)], case(number, given.seed)
    if kind == "arm" and number // len(KINDS) % 2:
        one, kind = jointed(one, random), "arm+"
    asked = {way: float(10 ** random.uniform(-3, -2)) for way in WAYS}
    located: tl.Trajectory | None = None
    for way in WAYS:
        row, known = Row(number, kind, way=way, asked=asked[way]), one.truth is not None or located is not None
        try:
            if not known:
                located, known = _run(one, contact="located", accuracy=LOCATED), True
            yield _judged(row, one, _run(one, contact="stepped", **{way: asked[way]}), located)
        except OutOfTime:
            yield replace(row, outcome="HANG" if known else "no truth")
        except TwolinkError as error:
            yield replace(row, outcome=error.code if known else "no truth")


def _run(one: Case, **options: Any) -> tl.Trajectory:
    with processor_time(PATIENCE):
        return tl.simulate(one.scene, one.duration, samples_per_second=SAMPLES / one.duration, **options)


def _judged(row: Row, one: Case, run: tl.Trajectory, located: tl.Trajectory | None) -> Row:
    """The true error at each sample beside its estimate, rad or m."""
    if located is None:
        assert one.truth is not None
        exact = one.truth(run.t)
        off, doubt = np.abs(free_positions(run.q, exact.shape[1]) - exact).max(axis=1), 0.0
    else:
        count = min(len(run.q), len(located.q))
        off, doubt = distance(run.robot, run.q[:count], located.q[:count]), located.error[:count]
    estimate = run.error[: len(off)]
    sure = np.maximum(off - doubt - FLOOR, 0.0)
    over = float((sure[1:] / np.maximum(estimate[1:], FLOOR)).max())
    outcome = next(name for name, most in JUDGED.items() if over <= most)
    return replace(row, outcome=outcome, worst=over, off=float(off.max()), estimate=float(estimate.max()))


def show(rows: list[Row], _given: argparse.Namespace) -> Bars:
    """Judged runs by kind, then what was refused."""
    table = Table("kind <9 | way <9 | judged >6 | " + "".join(f"{name} >10 | " for name in JUDGED)
                  + "worst >8.2g | median size >12.2g")  # fmt: skip
    for way in WAYS:
        for kind in (*KINDS, "arm+", "all"):
            some = [r for r in rows if kind in (r.kind, "all") and r.way == way and r.outcome in JUDGED]
            if some:
                sizes = [r.estimate / r.off for r in some if r.off > FLOOR]
                table.add(kind, way, len(some), *(sum(r.outcome == name for r in some) for name in JUDGED),
                          max(r.worst for r in some), np.median(sizes or [np.nan]))  # fmt: skip
    others = collections.Counter(f"{r.way} {r.outcome}" for r in rows if r.outcome not in JUDGED)
    print("\nnot judged: " + ", ".join(f"{count} {what}" for what, count in others.most_common()))
    return []


if __name__ == "__main__":
    raise SystemExit(study(__doc__, "estimates", Row, rows_of, show))
