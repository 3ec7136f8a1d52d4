"""Do the error bars hold? Random scenes, each simulated with verify=True, against a reference of more digits.

    python scripts/honest_bars.py [--scenes 200] [--seed 0]

Robots: random chains and trees of 2 to 7 degrees of freedom with revolute, prismatic and continuous joints, some with
a floating base. Scenes: gravity mostly, easy and chaotic, 1 to 10 s. Asked: accuracies of 1e-3 to 1e-11, method "auto"
two times of three. Truth: Taylor's method in extended precision (19 digits); its own error is the distance to another
order and, in every tenth scene if it is small, to quadruple precision.
Error: as `simulate` says it, max |difference(q, q_exact)|, rad or m, taken here in extended precision.
Prints a table, and each bar met or missed; writes out/honest_bars.csv. Nothing is kept in the cache.
"""

from __future__ import annotations

import argparse
import csv
import os
import statistics
import sys
import time
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from random_robots import random_scene

import twolink as tl
from twolink.errors import AccuracyError, CertificationError, TwolinkError
from twolink.integrate import step_map, taylor
from twolink.integrate.equations import Equations
from twolink.integrate.scene_equations import equations_of
from twolink.scenes import Scene
from twolink.simulation.trajectory import Trajectory

OUT = Path(__file__).parents[1] / "out" / "honest_bars.csv"
SAMPLES = 20.0
# The finest accuracy asked of a method: beyond, it takes minutes, and says nothing new.
OTHERS = {
    "taylor": -11, "dop853": -11, "rk45": -9, "rk23": -6, "esdirk43": -6, "suzuki4": -5, "rk4": -6,
    "implicit-midpoint": -3.5, "midpoint": -4, "semi-implicit-euler": -3, "scipy-dop853": -9, "scipy-lsoda": -7,
}  # fmt: skip
QUAD_UP_TO = 3  # degrees of freedom: compiling in quadruple precision takes a minute for more
OUTCOMES = ("kept", "refused", "broken", "unknown", "uncertified", "slow")
PATIENCE = 15.0  # seconds of solving a scene may take: fixed steps may be millions
OFTEN = 2 / 3  # the share of scenes for method "auto"


NOTHING = (0, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # a row of a scene that came to nothing


class TooSlowError(Exception):
    """A scene took longer than anybody wants to wait."""


@dataclass(frozen=True)
class Row:
    """A scene and what came of it.

    outcome: kept (the run ended, and its true error is below the accuracy), refused (AccuracyError), broken (the run
    ended, and is not below the accuracy), unknown (the reference is too coarse to tell), uncertified (the compiled
    steps were refused: CertificationError), slow (given up). covered: samples with true
    error <= error bar, of `samples`; worst: the largest true error over its bar. bar, true: at the end.
    """

    scene: int
    robot: str
    nv: int
    duration: float
    method: str
    asked: str
    accuracy: float
    outcome: str
    samples: int
    covered: int
    worst: float
    bar: float
    true: float
    reference: float
    seconds: float
    verify_seconds: float


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    os.environ["TWOLINK_CACHE"] = "off"
    rows = []
    start = time.perf_counter()
    for k in range(options.scenes):
        rows.append(row := study(k, options.seed))
        print(f"\r{k + 1}/{options.scenes} scenes, {time.perf_counter() - start:.0f} s  ", end="", file=sys.stderr)
        taylor._pool.clear()  # the code of scenes that do not come again
        step_map._kept.clear()
        if row.outcome == "broken" or row.covered < row.samples:
            print(f"\n{row}", file=sys.stderr)
    OUT.parent.mkdir(exist_ok=True)
    with OUT.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, [f.name for f in fields(Row)], lineterminator="\n")
        writer.writeheader()
        writer.writerows(map(asdict, rows))
    print(f"\r{options.scenes} scenes of seed {options.seed} in {time.perf_counter() - start:.0f} s; rows in {OUT}\n")
    table(rows)
    met = [bar(*b) for b in bars(rows)]
    return 0 if all(met) else 1


def study(number: int, seed: int) -> Row:
    """One scene: simulated, and compared with its reference."""
    random = np.random.default_rng([seed, number])
    scene, name = random_scene(random)
    nv = scene.robot.nv
    duration = float(np.round(random.uniform(1, 10), 3))
    asked = "auto" if random.random() < OFTEN else str(random.choice(list(OTHERS)))
    accuracy = float(10 ** random.uniform(OTHERS.get(asked, -11), -3))
    refused, run, began = False, None, 0.0

    def patience(t: float) -> None:
        nonlocal began  # the first call, so that compiling does not count
        began = began or time.perf_counter()
        if time.perf_counter() - began > PATIENCE and t > 0:
            raise TooSlowError

    try:
        run = tl.simulate(scene, duration, accuracy, method=asked, samples=SAMPLES, progress=patience)
    except AccuracyError as error:
        refused, run = True, getattr(error, "run", None)
    except (CertificationError, TooSlowError) as error:
        print(f"\nscene {number}, {asked}: {error!r}", file=sys.stderr)
        outcome = "slow" if isinstance(error, TooSlowError) else "uncertified"
        return Row(number, name, nv, duration, asked, asked, accuracy, outcome, *NOTHING)
    about = (number, name, nv, duration, run.cost.method if run and run.cost else asked, asked, accuracy)
    if run is None or run.error is None or run.cost is None:
        return Row(*about, "refused", *NOTHING)
    true, reference = truth(run, scene, quad=number % 10 == 0 and nv <= QUAD_UP_TO)
    sure = reference <= 0.1 * run.error  # where the reference says nothing, nothing is said
    sure[0] = False  # the start is given, not computed; and no (cos, sin) of doubles has length 1 to more than rounding
    ended = bool(sure[-1])
    kept = "kept" if true.max() <= accuracy else "broken"
    outcome = "refused" if refused else kept if ended else "unknown"
    ratio = true[sure] / np.maximum(run.error[sure], 1e-300)
    ratio[true[sure] == 0] = 0.0
    return Row(*about, outcome, len(ratio), int((ratio <= 1).sum()), float(ratio.max()),
               float(run.error[-1]) if ended else 0.0, float(true[-1]) if ended else 0.0, float(reference[-1]),
               run.cost.seconds, run.cost.verify_seconds)  # fmt: skip


def truth(run: Trajectory, scene: Scene, quad: bool) -> tuple[np.ndarray, np.ndarray]:
    """The run's true error at each sample, and the reference's own (n,)."""
    equations = equations_of(scene)
    nq = equations.space.nq
    taylor.COMPACT_FROM, before = 0, taylor.COMPACT_FROM  # loops compile in a second, straight code in up to a minute
    best = taylor.solve(equations, run.t, 1e-19, precision="extended").precise[:, :nq]
    if quad:
        digits = taylor.solve(equations, run.t, 1e-22, precision="quad").precise[:, :nq]
        leading = digits.astype(float)  # and what doubles leave: there is no cast from quadruple to extended
        other = leading.astype(np.longdouble) + (digits - leading.astype(digits.dtype)).astype(float)
    else:
        other = taylor.solve(equations, run.t, 1e-17, precision="extended").precise[:, :nq]
    taylor.COMPACT_FROM = before
    own = np.maximum.accumulate(distances(equations, best, other))
    return distances(equations, run.q.astype(np.longdouble), best), own


def distances(equations: Equations, q: np.ndarray, other: np.ndarray) -> np.ndarray:
    """max |difference| of configurations (n, nq) in extended precision."""
    parts: list[Any] = [np.zeros(len(q), np.longdouble)]
    curved = {joint.q.start: joint for joint in equations.space.curved}
    column = 0
    while column < q.shape[1]:
        joint = curved.get(column)
        width = 1 if joint is None else joint.q.stop - joint.q.start
        a, b = q[:, column : column + width].T, other[:, column : column + width].T
        if joint is None:
            parts.append(np.abs(a[0] - b[0]))
        elif joint.kind == "cos-sin":
            parts.append(np.abs(np.arctan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1])))
        else:
            parts += [np.abs(a[:3] - b[:3]).max(axis=0), rotation_between(a[3:], b[3:])]
        column += width
    return np.max(parts, axis=0).astype(float)


def rotation_between(p: np.ndarray, r: np.ndarray) -> np.ndarray:
    """The largest component of the rotation vector between unit quaternions (4, n), (x, y, z, w)."""
    vector = p[3] * r[:3] - r[3] * p[:3] - np.cross(p[:3].T, r[:3].T).T
    scalar = (p * r).sum(axis=0)
    length = np.sqrt((vector * vector).sum(axis=0))
    angle = 2 * np.arctan2(length, np.abs(scalar))
    return np.abs(vector).max(axis=0) / np.where(length > 0, length, 1.0) * angle


def table(rows: list[Row]) -> None:
    """What came of the scenes, by the method that solved them."""
    print(f"{'method':<20}{'scenes':>7}{'kept':>6}{'refused':>9}{'broken':>8}{'unknown':>9}{'uncert.':>9}{'slow':>6}"
          f"{'samples':>9}{'covered':>9}{'worst':>9}{'bar/true':>10}{'overhead':>10}")  # fmt: skip
    for method in [*sorted({row.method for row in rows}), "all"]:
        of = [row for row in rows if method in (row.method, "all")]
        count = {name: sum(row.outcome == name for row in of) for name in OUTCOMES}
        samples = sum(row.samples for row in of)
        print(f"{method:<20}{len(of):>7}{count['kept']:>6}{count['refused']:>9}{count['broken']:>8}"
              f"{count['unknown']:>9}{count['uncertified']:>9}{count['slow']:>6}"
              f"{samples:>9}{sum(row.covered for row in of) / max(1, samples):>9.2%}"
              f"{max((row.worst for row in of), default=0):>9.2g}{median(sharpness(of)):>10.1f}"
              f"{median(overhead(of)):>10.2f}")  # fmt: skip
    print()


def bars(rows: list[Row]) -> list[tuple[str, float, float, bool]]:
    """Each bar: what, the figure, the bar, and whether the figure is to be above it."""
    known = [row for row in rows if row.outcome not in ("unknown", "uncertified", "slow")]
    seen = [row for row in rows if row.samples]
    auto = [row for row in rows if row.asked == "auto"]
    samples = sum(row.samples for row in rows)
    return [
        ("samples with true error <= run.error", sum(row.covered for row in rows) / samples, 0.99, True),
        ("runs with true error <= run.error at every sample", share(row.covered == row.samples for row in seen), 0.99,
         True),
        ("runs that keep the accuracy or say they do not", share(row.outcome != "broken" for row in known), 0.99, True),
        ("median of run.error / true error at the end", median(sharpness(rows)), 100.0, False),
        ("median of total / solving seconds, auto", median(overhead(auto)), 3.0, False),
        ("sum of total / sum of solving seconds, auto",
         sum(r.seconds + r.verify_seconds for r in auto) / max(1e-9, sum(r.seconds for r in auto)), 3.0, False),
    ]  # fmt: skip


def bar(what: str, figure: float, limit: float, above: bool) -> bool:
    """Print whether a bar is met."""
    met = figure >= limit if above else figure <= limit
    text = f"{figure:.2%} (bar: at least {limit:.0%})" if above else f"{figure:.2f} (bar: at most {limit:g})"
    print(f"{'met   ' if met else 'MISSED'}  {what}: {text}")
    return met


def share(found: Any) -> float:
    found = list(found)
    return sum(found) / max(1, len(found))


def sharpness(rows: list[Row]) -> list[float]:
    """Error bar over true error at the end of the runs that ended, where there is an error."""
    return [row.bar / row.true for row in rows if row.outcome in ("kept", "broken") and row.true > 0]


def overhead(rows: list[Row]) -> list[float]:
    return [(row.seconds + row.verify_seconds) / row.seconds for row in rows if row.seconds > 0]


def median(values: list[float]) -> float:
    return statistics.median(values) if values else float("nan")


if __name__ == "__main__":
    try:
        raise SystemExit(main())
    except TwolinkError as error:
        raise SystemExit(str(error)) from None
