"""Do the error bars hold? Random scenes whose exact motions are known, each simulated and compared.

    python scripts/honest_bars.py [--scenes 1000] [--seed 0] [--fresh]

The kinds of scenes and their truths are in `honest_scenes`. Error: as `simulate` defines it, max |difference(q,
q_exact)|, rad or m, of the run and of the best run of a refusal. A bar fails where one sample's error is above it.

Rows go to out/honest_bars-SEED.csv as they come. After Ctrl-C the same command goes on behind the last row; --fresh
starts again. Prints a table by kind, and each bar met or missed; ends 0 if all are met.
"""

import argparse
import csv
import os
import statistics
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from honest_scenes import KINDS, Case, Worlds, case, series

import twolink as tl
from twolink.errors import AccuracyError
from twolink.hard.truths import distance
from twolink.simulation.time_limit import OutOfTime, TimeLimit

OUT = Path(__file__).parents[1] / "out"
SAMPLES = 60
PATIENCE = 10.0  # seconds that a solution may take: fixed steps may be millions
KNOWN = 0.1  # of the bar: where the truth's own error is larger, it does not judge
OUTCOMES = ("kept", "refused", "broken", "unknown", "slow")
MAX_RATIO, MAX_COST = 3.0, 3.0


@dataclass(frozen=True)
class Row:
    """A scene and what came of it.

    outcome: kept (the run ended, and its true error is below the accuracy), refused (AccuracyError), broken (it ended,
    and its true error is not below the accuracy), unknown (the truth is too coarse to tell), slow (given up). samples:
    that were judged, worlds for `simulate_many`; failed: with a true error above the bar; worst: the largest true error
    over its bar. bar, true: at the end, the largest true error so far; 0 where they are not known. seconds: of solving;
    verify_seconds: of the second solutions; total_seconds: of the scene with its truth and all compiling.
    """

    scene: int
    kind: str
    what: str
    method: str
    accuracy: float
    outcome: str
    samples: int = 0
    failed: int = 0
    worst: float = 0.0
    bar: float = 0.0
    true: float = 0.0
    seconds: float = 0.0
    verify_seconds: float = 0.0
    total_seconds: float = 0.0

    @property
    def fails(self) -> bool:
        """Whether its bar fails, or the accuracy in silence."""
        return self.failed > 0 or self.outcome == "broken"


def check(number: int, seed: int) -> Row:
    """Simulate one scene, and compare it with its truth."""
    start, one = time.perf_counter(), case(number, seed)
    method = one.method if isinstance(one, Case) else "dop853"
    row = Row(number, KINDS[number % len(KINDS)], one.what, method, one.accuracy, "refused")
    try:
        row = _checked_worlds(row, one) if isinstance(one, Worlds) else _checked(row, one)
    except OutOfTime:
        row = replace(row, outcome="slow")
    return replace(row, total_seconds=round(time.perf_counter() - start, 3))


def _checked(row: Row, one: Case) -> Row:
    accuracy = one.accuracy
    if one.limit:
        best, _ = _run(one, 1e-12)
        if best is None or best.error is None:
            return row
        accuracy = min(1e-3, one.limit * float(best.error[-1]))
    run, refused = _run(one, accuracy)
    row = replace(row, accuracy=accuracy)
    if run is None or run.error is None or run.cost is None:
        return row
    times, states, bars = run.t, digits_of(run), run.error
    if one.samples:  # between samples the bar of the next one holds
        times = np.unique(np.concatenate([[0.0], np.random.default_rng(row.scene).uniform(0.0, run.t[-1], SAMPLES)]))
        states, bars = run.at(times)[0].astype(np.longdouble), run.error[np.searchsorted(run.t, times)]
    q, doubt = one.truth(times)
    true = distance(run.robot, states, q.astype(np.longdouble))
    row = replace(row, method=run.cost.method, seconds=run.cost.seconds, verify_seconds=run.cost.verify_seconds)
    return _judged(row, true[1:], bars[1:], doubt[1:], refused=refused)  # the start is not computed


def digits_of(run: tl.Trajectory) -> np.ndarray:
    """The configurations (n, nq) of a run with all digits that it has, as long doubles."""
    if run.precise is None:
        return run.q.astype(np.longdouble)
    every = run.precise[:, : run.robot.nq]
    leading = every.astype(float)  # there is no cast from quadruple to extended: add what a double leaves
    return leading.astype(np.longdouble) + (every - leading.astype(every.dtype)).astype(float)


def _run(one: Case, accuracy: float) -> tuple[tl.Trajectory | None, bool]:
    """The run, or the best one of a refusal; and whether it was refused. Near the limit of doubles, in doubles."""
    samples, precision = (one.samples or SAMPLES) / one.duration, "double" if one.limit else "auto"
    try:
        return tl.simulate(one.scene, one.duration, accuracy, method=one.method, samples=samples, precision=precision,
                           progress=TimeLimit(PATIENCE, time.process_time)), False  # fmt: skip
    except OutOfTime:
        raise
    except AccuracyError as error:
        return error.run, True


def _checked_worlds(row: Row, one: Worlds) -> Row:
    try:
        worlds = tl.simulate_many(one.scene, one.q, one.v, duration=one.duration, accuracy=one.accuracy,
                                  progress=TimeLimit(PATIENCE, time.process_time))  # fmt: skip
    except OutOfTime:
        raise
    except AccuracyError:
        return row
    assert worlds.error is not None
    ends = np.array([0.0, one.duration])
    truths = [series(tl.Scene(one.scene.robot, q, v, effects=one.scene.effects), ends)
              for q, v in zip(one.q, one.v, strict=True)]  # fmt: skip
    exact = np.array([q[-1] for q, _ in truths])
    true, doubt = distance(worlds.robot, worlds.q.astype(exact.dtype), exact), np.array([d[-1] for _, d in truths])
    row = replace(row, seconds=worlds.cost.seconds, verify_seconds=worlds.cost.verify_seconds)
    order = np.argsort(worlds.error)  # a world beyond the accuracy says so by its bar
    kept = bool(worlds.error.max() <= one.accuracy)
    return _judged(row, true[order], worlds.error[order], doubt[order], refused=not kept)


def _judged(row: Row, true: np.ndarray, bar: np.ndarray, doubt: np.ndarray, *, refused: bool) -> Row:
    sure = doubt <= KNOWN * bar
    ratio = true[sure] / bar[sure]
    ended = bool(sure[-1])
    kept = "kept" if true.max() <= row.accuracy else "broken"
    return replace(
        row, outcome="refused" if refused else kept if ended else "unknown", samples=len(ratio),
        failed=int((ratio > 1).sum()), worst=float(ratio.max(initial=0.0)), bar=float(bar[-1]) * ended,
        true=float(true.max()) * ended,
    )  # fmt: skip


def median(values: Sequence[float]) -> float:
    return statistics.median(values) if values else float("nan")


def ratios(rows: Sequence[Row]) -> list[float]:
    """Error bar at the end over the largest true error of the runs that ended, where there is an error."""
    return [row.bar / row.true for row in rows if row.outcome in ("kept", "broken") and row.true > 0]


def costs(rows: Sequence[Row]) -> list[float]:
    """Seconds of verification over those of solving."""
    return [row.verify_seconds / row.seconds for row in rows if row.seconds > 0]


def print_table(rows: Sequence[Row]) -> None:
    """The outcomes by kind."""
    print(f"{'kind':<10}{'scenes':>7}{''.join(f'{name:>9}' for name in OUTCOMES)}{'samples':>9}{'fails':>7}{'worst':>8}"
          f"{'bar/true':>10}{'cost':>7}{'s/scene':>9}")  # fmt: skip
    for kind in (*KINDS, "all"):
        some = [row for row in rows if kind in (row.kind, "all")]
        counts = "".join(f"{sum(row.outcome == name for row in some):>9}" for name in OUTCOMES)
        print(f"{kind:<10}{len(some):>7}{counts}{sum(row.samples for row in some):>9}"
              f"{sum(row.fails for row in some):>7}{max((row.worst for row in some), default=0):>8.2g}"
              f"{median(ratios(some)):>10.2f}{median(costs(some)):>7.2f}"
              f"{median([row.total_seconds for row in some]):>9.2f}")  # fmt: skip
    print("\nfails: runs whose bar fails; worst: largest true error over its bar; bar/true: error bar at the end over "
          "the\nlargest true error, median; cost: seconds of verification over those of solving, median\n")  # fmt: skip


def print_bars(rows: Sequence[Row]) -> bool:
    """Print each bar met or missed. Returns whether all are met."""
    fails, ratio, cost = sum(row.fails for row in rows), median(ratios(rows)), median(costs(rows))
    bars = [
        (fails == 0, f"runs whose bar fails: {fails} of {len(rows)} (bar: none)"),
        (ratio <= MAX_RATIO, f"median of error bar / true error: {ratio:.2f} (bar: at most {MAX_RATIO:g})"),
        (cost <= MAX_COST, f"median cost of verification: {cost:.2f} (bar: at most {MAX_COST:g} times the solution)"),
    ]
    for met, text in bars:
        print(f"{'met   ' if met else 'MISSED'}  {text}")
    return all(met for met, _ in bars)


def read_rows(path: Path) -> list[Row]:
    """The rows that an earlier run wrote; a last line that was cut off is left out."""
    if not path.exists():
        return []
    types: dict[str, Callable[[str], Any]] = {f.name: f.type for f in fields(Row)}  # type: ignore[misc]
    with path.open(newline="", encoding="utf-8") as file:
        whole = [line for line in csv.DictReader(file) if line["total_seconds"]]
    return [Row(**{name: types[name](text) for name, text in line.items()}) for line in whole]


def study(scenes: int, seed: int, path: Path) -> list[Row]:
    """Check the scenes that are not in the file yet, and append their rows to it."""
    kept = read_rows(path)
    rows = [row for row in kept if row.scene < scenes]
    done, start = {row.scene for row in rows}, time.perf_counter()
    path.parent.mkdir(exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:  # again, without what was cut off
        writer = csv.DictWriter(file, [f.name for f in fields(Row)], lineterminator="\n")
        writer.writeheader()
        writer.writerows(map(asdict, kept))
        for number in sorted(set(range(scenes)) - done):
            row = check(number, seed)
            writer.writerow(asdict(row))
            file.flush()
            rows.append(row)
            if row.fails:
                print(f"\n{row}", file=sys.stderr)
            print(f"\r{len(rows)}/{scenes} scenes, {time.perf_counter() - start:.0f} s, "
                  f"{sum(row.fails for row in rows)} fail  ", end="", file=sys.stderr)  # fmt: skip
    return rows


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--fresh", action="store_true", help="start again")
    options = parser.parse_args()
    os.environ["TWOLINK_CACHE"] = "off"
    path, interrupted = OUT / f"honest_bars-{options.seed}.csv", False
    if options.fresh:
        path.unlink(missing_ok=True)
    try:
        rows = study(options.scenes, options.seed, path)
    except KeyboardInterrupt:
        rows, interrupted = read_rows(path), True
    print(f"\r{len(rows)} scenes of seed {options.seed}; rows in {path}\n")
    print_table(rows)
    met = print_bars(rows)
    return 130 if interrupted else 0 if met else 1


if __name__ == "__main__":
    raise SystemExit(main())
