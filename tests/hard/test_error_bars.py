"""Error bars hold on random scenes, against a reference of more digits.

Robots: random chains and trees of 2 to 7 degrees of freedom with revolute, prismatic and continuous joints, some with
a floating base. Scenes: gravity mostly, easy and chaotic, 1 to 10 s. Asked: accuracies of 1e-3 to 1e-11, method "auto"
two times of three. Truth: Taylor's method in extended precision (19 digits); its own error is the distance to another
order and, in every tenth scene if it is small, to quadruple precision.
Error: as `simulate` defines it, max |difference(q, q_exact)|, rad or m, taken here in extended precision.

The slow test has 200 scenes and takes about half an hour; with -s it prints a table by method.
"""

import os
import statistics
import sys
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import pytest

import twolink as tl
from tests.hard.random_robots import random_scene
from twolink.accuracy.time_limit import OverBudget, TimeLimit
from twolink.errors import AccuracyError, CertificationError
from twolink.hard.extended_precision import extended_reference
from twolink.hard.truths import distance

SCENES, SEED = 200, 0
SAMPLES = 20.0
# The finest accuracy asked of a method: beyond, it takes minutes, and says nothing new.
FINEST = {
    "taylor": -11, "dop853": -11, "rk45": -9, "rk23": -6, "esdirk43": -6, "suzuki4": -5, "rk4": -6,
    "implicit-midpoint": -3.5, "midpoint": -4, "semi-implicit-euler": -3, "scipy-dop853": -9, "scipy-lsoda": -7,
}  # fmt: skip
QUAD_UP_TO = 3  # degrees of freedom: compiling in quadruple precision takes a minute for more
OUTCOMES = ("kept", "refused", "broken", "unknown", "uncertified", "slow")
PATIENCE = 15.0  # seconds of solving a scene may take: fixed steps may be millions
AUTO = 2 / 3  # the share of scenes for method "auto"


@dataclass(frozen=True)
class Checked:
    """A scene and what came of it.

    outcome: kept (the run ended, and its true error is below the accuracy), refused (AccuracyError), broken (the run
    ended, and its true error is not below the accuracy), unknown (the reference is too coarse to tell), uncertified
    (the compiled steps were refused: CertificationError), slow (given up). covered: samples with true error <= error
    bar, of `samples`; worst: the largest true error over its bar. bar, true: at the end.
    """

    scene: int
    robot: str
    nv: int
    duration: float
    asked: str
    accuracy: float
    method: str
    outcome: str
    samples: int = 0
    covered: int = 0
    worst: float = 0.0
    bar: float = 0.0
    true: float = 0.0
    reference: float = 0.0
    seconds: float = 0.0
    verify_seconds: float = 0.0


def check(number: int, seed: int) -> Checked:
    """Simulate one scene, and compare it with its reference."""
    random = np.random.default_rng([seed, number])
    scene, name = random_scene(random)
    duration = float(np.round(random.uniform(1, 10), 3))
    asked = "auto" if random.random() < AUTO else str(random.choice(list(FINEST)))
    accuracy = float(10 ** random.uniform(FINEST.get(asked, -11), -3))
    row = Checked(number, name, scene.robot.nv, duration, asked, accuracy, asked, "refused")
    refused = False
    try:
        run = tl.simulate(scene, duration, accuracy, method=asked, samples=SAMPLES, progress=TimeLimit(PATIENCE))
    except AccuracyError as error:
        refused, run = True, error.run
    except (CertificationError, OverBudget) as error:
        print(f"\nscene {number}, {asked}: {error!r}", file=sys.stderr)
        return replace(row, outcome="slow" if isinstance(error, OverBudget) else "uncertified")
    if run is None or run.error is None:
        return row
    true, reference = true_error(run, scene, quad=number % 10 == 0 and row.nv <= QUAD_UP_TO)
    sure = reference <= 0.1 * run.error  # elsewhere the reference is too coarse
    sure[0] = False  # the start is not computed; and no (cos, sin) of doubles has length 1 to more than rounding
    ended = bool(sure[-1])
    kept = "kept" if true.max() <= accuracy else "broken"
    ratio = np.where(true == 0, 0.0, true / np.maximum(run.error, 1e-300))[sure]
    return replace(
        row, outcome="refused" if refused else kept if ended else "unknown", method=run.cost.method,
        samples=len(ratio), covered=int((ratio <= 1).sum()), worst=float(ratio.max(initial=0.0)),
        bar=float(run.error[-1]) * ended, true=float(true[-1]) * ended, reference=float(reference[-1]),
        seconds=run.cost.seconds, verify_seconds=run.cost.verify_seconds,
    )  # fmt: skip


def true_error(run: tl.Trajectory, scene: tl.Scene, *, quad: bool) -> tuple[np.ndarray, np.ndarray]:
    """The run's true error at each sample, and the reference's own (n,)."""
    reference, doubt = extended_reference(scene, run.t, quad=quad)
    return distance(scene.robot, run.q.astype(np.longdouble), reference), doubt


def print_table(checked: list[Checked]) -> None:
    """The outcomes by the method that solved the scenes."""
    print(f"{'method':<20}{'scenes':>7}{''.join(f'{name:>12}' for name in OUTCOMES)}{'samples':>9}{'covered':>9}"
          f"{'worst':>9}{'bar/true':>10}{'overhead':>10}")  # fmt: skip
    for method in [*sorted({c.method for c in checked}), "all"]:
        rows = [c for c in checked if method in (c.method, "all")]
        counts = "".join(f"{sum(c.outcome == name for c in rows):>12}" for name in OUTCOMES)
        samples = sum(c.samples for c in rows)
        print(f"{method:<20}{len(rows):>7}{counts}{samples:>9}{sum(c.covered for c in rows) / max(1, samples):>9.2%}"
              f"{max(c.worst for c in rows):>9.2g}{median(sharpness(rows)):>10.1f}"
              f"{median(overhead(rows)):>10.2f}")  # fmt: skip
    print()


def print_bars(checked: list[Checked]) -> bool:
    """Print each bar met or missed. Returns whether all are met."""
    seen = [c for c in checked if c.samples]
    judged = [c for c in checked if c.outcome in ("kept", "refused", "broken")]
    auto = [c for c in checked if c.asked == "auto" and c.seconds]
    total = sum(c.seconds + c.verify_seconds for c in auto) / max(1e-9, sum(c.seconds for c in auto))
    shares = {
        "samples with true error <= run.error": sum(c.covered for c in seen) / sum(c.samples for c in seen),
        "runs with true error <= run.error at every sample": statistics.mean(c.covered == c.samples for c in seen),
        "runs that keep the accuracy or say they do not": statistics.mean(c.outcome != "broken" for c in judged),
    }
    ratios = {
        "median of run.error / true error at the end": (median(sharpness(checked)), 100.0),
        "median of total / solving seconds, auto": (median(overhead(auto)), 3.0),
        "sum of total / sum of solving seconds, auto": (total, 3.0),
    }
    met = [(share >= 0.99, f"{what}: {share:.2%} (bar: at least 99%)") for what, share in shares.items()]
    met += [(x <= limit, f"{what}: {x:.2f} (bar: at most {limit:g})") for what, (x, limit) in ratios.items()]
    for good, text in met:
        print(f"{'met   ' if good else 'MISSED'}  {text}")
    return all(good for good, _ in met)


def sharpness(checked: Iterable[Checked]) -> list[float]:
    """Error bar over true error at the end of the runs that ended, where there is an error."""
    return [c.bar / c.true for c in checked if c.outcome in ("kept", "broken") and c.true > 0]


def overhead(checked: Iterable[Checked]) -> list[float]:
    return [(c.seconds + c.verify_seconds) / c.seconds for c in checked if c.seconds > 0]


def median(values: list[float]) -> float:
    return statistics.median(values) if values else float("nan")


@pytest.mark.parametrize("seed", range(15))
def test_the_error_bar_holds_at_every_sample(seed: int) -> None:
    """2 degrees of freedom, sometimes 3; 1 to 4 s, method "auto"; the best run of a refusal has a true bar as well."""
    random = np.random.default_rng([77, seed])
    scene, name = random_scene(random, {2: 0.87, 3: 0.13}, floating=0.0)
    accuracy = float(10 ** random.uniform(-10, -3))
    try:
        run = tl.simulate(scene, float(random.uniform(1, 4)), accuracy, samples=20)
    except AccuracyError as error:
        run = error.run
    else:
        assert run.error is not None
        assert run.error[-1] <= accuracy
    true, reference = true_error(run, scene, quad=False)
    assert run.error is not None
    sure = reference <= 0.1 * run.error
    sure[0] = False  # the start is not computed
    assert sure[1:].mean() > 0.9, name
    assert np.all(true[sure] <= run.error[sure]), (name, (true[1:] / run.error[1:]).max())


@pytest.mark.slow
def test_error_bars_of_many_random_scenes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(os.environ, "TWOLINK_CACHE", "off")
    checked = [check(number, SEED) for number in range(SCENES)]
    print_table(checked)
    missed = [one for one in checked if one.outcome == "broken" or one.covered < one.samples]
    assert print_bars(checked), missed
