"""Do the error bars hold? Random scenes whose exact motions are known, each simulated and compared.

    python -m scripts.studies.error_bars [--scenes 1000] [--seed 0] [--first 0] [--fresh] [--out FILE]

The kinds of scenes and their truths are in `scenes.exact`. Error: as `simulate` defines it, max |difference(q,
q_exact)|, rad or m, of the run and of the best run of a refusal. A bar fails where one sample's error is above it.

Rows go to out/error_bars-SEED.csv as they come. After Ctrl-C the same command goes on behind the last row; --fresh
starts again. Prints a table by kind, and each bar met or missed; ends 0 if all are met.
"""

import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

import twolink as tl
from scripts.runner import Bars, Table, study
from scripts.studies.scenes.exact import KINDS, Case, Worlds, case
from twolink.errors import AccuracyError
from twolink.hard.truths import distance, extended_reference
from twolink.simulation.time_limit import OutOfTime, TimeLimit

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
    return np.vectorize(np.longdouble)(every.astype(str))


def _run(one: Case, accuracy: float) -> tuple[tl.Trajectory | None, bool]:
    """The run, or the best one of a refusal; and whether it was refused. Near the limit of doubles, in doubles."""
    samples, precision = (one.samples or SAMPLES) / one.duration, "double" if one.limit else "auto"
    try:
        return tl.simulate(one.scene, one.duration, accuracy=accuracy, method=one.method, samples_per_second=samples,
                           precision=precision, progress=TimeLimit(PATIENCE, time.process_time)), False  # fmt: skip
    except OutOfTime:
        raise
    except AccuracyError as error:
        return error.run, True


def _checked_worlds(row: Row, one: Worlds) -> Row:
    try:
        worlds = tl.simulate_many(one.scene, q=one.q, v=one.v, duration=one.duration, accuracy=one.accuracy,
                                  progress=TimeLimit(PATIENCE, time.process_time))  # fmt: skip
    except OutOfTime:
        raise
    except AccuracyError:
        return row
    ends = np.array([0.0, one.duration])
    truths = [extended_reference(tl.Scene(one.scene.base, q, v, effects=one.scene.effects), ends)
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


def medians(rows: Sequence[Row]) -> tuple[float, float]:
    """Error bar at the end over the largest true error, where a run ended; seconds of verification over solving."""
    ratios = [row.bar / row.true for row in rows if row.outcome in ("kept", "broken") and row.true > 0]
    return median(ratios), median([row.verify_seconds / row.seconds for row in rows if row.seconds > 0])


def show(rows: Sequence[Row], _given: object = None) -> Bars:
    """Print the outcomes by kind."""
    outcomes = "".join(f"{name} >8 | " for name in OUTCOMES)
    table = Table(f"kind <9 | scenes >6 | {outcomes}samples >8 | fails >6 | worst >7.2g | bar/true >9.2f | "
                  "cost >6.2f | s/scene >8.2f")  # fmt: skip
    for kind in (*KINDS, "all"):
        some = [row for row in rows if kind in (row.kind, "all")]
        table.add(kind, len(some), *(sum(row.outcome == name for row in some) for name in OUTCOMES),
                  sum(row.samples for row in some), sum(row.fails for row in some),
                  max((row.worst for row in some), default=0.0), *medians(some),
                  median([row.total_seconds for row in some]))  # fmt: skip
    print("\nfails: runs whose bar fails; worst: largest true error over its bar; bar/true: error bar at the end over "
          "the\nlargest true error, median; cost: seconds of verification over those of solving, median\n")  # fmt: skip
    fails, (ratio, cost) = sum(row.fails for row in rows), medians(rows)
    return [
        (fails == 0, f"runs whose bar fails: {fails} of {len(rows)} (bar: none)"),
        (ratio <= MAX_RATIO, f"median of error bar / true error: {ratio:.2f} (bar: at most {MAX_RATIO:g})"),
        (cost <= MAX_COST, f"median cost of verification: {cost:.2f} (bar: at most {MAX_COST:g} times the solution)"),
    ]


if __name__ == "__main__":
    raise SystemExit(study(__doc__, "error_bars", Row, lambda n, given: [check(n, given.seed)], show, scenes=1000))
