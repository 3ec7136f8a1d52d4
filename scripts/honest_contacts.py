"""Are answers about bodies that touch ever wrong in silence? Random scenes with contacts, each simulated and judged.

    python scripts/honest_contacts.py [--scenes 200] [--seed 0] [--first 0] [--laws] [--kinds ledge ...]

Scenes: `contact_scenes`. Three kinds have exact motions, and hulls on a large hull must move as on a plane; for the
others the reference is a run that is 1,000 times more accurate, whose own error bar counts as its doubt. With --laws
every answer is also held against the laws, by other code than the engine's: Coal's distances (no bodies overlap),
contact forces on planes (no pull, within the cone of friction), energy (contacts and dampers only take some).

exact, agrees: no sample is farther from the truth, or from the reference, than the error bar. WRONG: one is, or a law
is broken. refused: a named error, counted by code. HANG: no end after PATIENCE seconds of processor time. CRASH: an
error that is none of twolink's. Rows go to out/honest_contacts-SEED.csv. Ends 0 if nothing is wrong, hangs or crashes.
"""

import argparse
import collections
import csv
import itertools
import os
import signal
import sys
import time
import traceback
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
from contact_scenes import KINDS, Case, case

import twolink as tl
from twolink import effects as fx
from twolink.errors import TwolinkError
from twolink.geometry.pairs import Pair, Plane
from twolink.hard.truths import distance
from twolink.robots.collisions import Solid, collision_model

OUT = Path(__file__).parents[1] / "out"
SAMPLES, LOOKS = 60, 400  # of a run; at which laws are checked
PATIENCE = 90.0  # s of processor time for a scene, of which compiling takes most
FINER = 1e-3
OVERLAP = 1e-5  # m: Coal's own accuracy of curved shapes is 2e-7
LAW = 1e-5  # of the largest force, and of the largest energy
GOOD = ("exact", "agrees", "refused", "unknown")
BAD = ("WRONG", "HANG", "CRASH")


@dataclass(frozen=True)
class Row:
    """A scene and what came of it. worst: the largest error over its bar. why: the error's code, or the law."""

    scene: int
    kind: str
    what: str
    accuracy: float
    outcome: str = ""
    why: str = ""
    worst: float = 0.0
    events: int = 0
    seconds: float = 0.0


class HangError(Exception):
    """The processor time of a scene is up."""


def check(number: int, seed: int, *, laws: bool) -> Row:
    """Simulate one scene, and judge its answer."""
    one, start = case(number, seed), time.process_time()
    row = Row(number, KINDS[number % len(KINDS)], one.what, one.accuracy)
    signal.signal(signal.SIGPROF, _hang)
    signal.setitimer(signal.ITIMER_PROF, PATIENCE)
    try:
        row = _judged(row, one, laws=laws)
    except HangError:
        row = replace(row, outcome="HANG")
    except TwolinkError as error:
        row = replace(row, outcome="refused", why=error.code)
    except Exception as error:  # whatever it is, it has no place in an answer
        traceback.print_exc()
        row = replace(row, outcome="CRASH", why=repr(error)[:200])
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
    return replace(row, seconds=round(time.process_time() - start, 2))


def _hang(*_: object) -> None:
    raise HangError


def _judged(row: Row, one: Case, *, laws: bool) -> Row:
    run = tl.simulate(one.scene, one.duration, one.accuracy, samples=SAMPLES / one.duration, contact=one.way)
    assert run.error is not None
    row = replace(row, events=len(run.events))
    broken = broken_law(one, run) if laws else ""
    if broken:
        return replace(row, outcome="WRONG", why=broken)
    if one.truth is not None:
        try:
            exact = one.truth(run.t)
        except TwolinkError as failure:
            return replace(row, outcome="unknown", why=failure.code)
        columns = np.concatenate([np.arange(7 * k, 7 * k + 3) for k in range(exact.shape[1] // 3)])
        error = np.abs(run.q[:, columns] - exact).max(axis=1)
        bar, outcome = run.error + 4e-16 * np.abs(exact).max(), "exact"
    else:
        try:
            fine = tl.simulate(
                one.scene,
                one.duration,
                max(1e-11, FINER * one.accuracy),
                samples=SAMPLES / one.duration,
                contact=one.way,
            )
        except TwolinkError as failure:
            return replace(row, outcome="unknown", why=failure.code)
        assert fine.error is not None
        count = min(len(run.t), len(fine.t))
        error, bar = distance(run.robot, run.q[:count], fine.q[:count]), run.error[:count] + fine.error[:count]
        outcome = "agrees"
    worst = float((error[1:] / np.maximum(bar[1:], 1e-300)).max())
    return replace(
        row, outcome="WRONG" if worst > 1.0 else outcome, why="error bar" if worst > 1.0 else "", worst=worst
    )


def broken_law(one: Case, run: tl.Trajectory) -> str:
    """The law that an answer breaks, "" if none."""
    (effect,) = (effect for effect in one.scene.effects if isinstance(effect, fx.Contact))
    q, _ = run.at(np.linspace(0.0, float(run.t[-1]), LOOKS))
    pairs = effect.selected(run.robot).chosen
    overlap = -lowest_distance(run.robot, pairs, q)
    if overlap > OVERLAP:
        return f"overlap {overlap:.2g} m"
    energy = run.energy
    gain = float((energy - np.minimum.accumulate(energy)).max())
    if gain > LAW * (1.0 + np.abs(energy).max()):
        return f"energy grows by {gain:.2g} J"
    mu = effect.friction if effect.static is None else effect.static
    for pair in pairs:
        if isinstance(pair.second, Plane) and pair.name in run.contact_forces:
            n = np.array(pair.second.normal) / np.linalg.norm(pair.second.normal)
            force = run.contact_forces[pair.name]
            small, normal = LAW * (1.0 + np.abs(force).max()), force @ n
            across = np.linalg.norm(force - np.outer(normal, n), axis=1)
            if normal.min() < -small:
                return f"{pair.name} pulls with {-normal.min():.2g} N"
            if (across - mu * normal).max() > small:
                return f"friction of {pair.name} exceeds its cone by {(across - mu * normal).max():.2g} N"
    return ""


def lowest_distance(robot: tl.Robot, pairs: tuple[Pair, ...], q: np.ndarray) -> float:
    """Coal's smallest distance of any pair at configurations q (n, nq); negative where bodies overlap."""
    solids = list(dict.fromkeys(s for pair in pairs for s in (pair.first, pair.second) if isinstance(s, Solid)))
    geometry = collision_model(robot.model, solids)
    data, places = robot.model.createData(), geometry.createData()
    shapes = {solid: item.geometry for solid, item in zip(solids, geometry.geometryObjects, strict=True)}
    half = {plane: coal.Halfspace(np.array(plane.normal) / np.linalg.norm(plane.normal), plane.height)
            for pair in pairs for plane in (pair.second,) if isinstance(plane, Plane)}  # fmt: skip
    lowest = np.inf
    for state in q:
        pin.updateGeometryPlacements(robot.model, data, geometry, places, state)
        at: dict[Any, Any] = {
            s: coal.Transform3s(m.rotation, m.translation) for s, m in zip(solids, places.oMg, strict=True)
        }
        for pair in pairs:
            second = pair.second
            shape, place = (half[second], coal.Transform3s.Identity()) if isinstance(second, Plane) else (
                shapes[second], at[second])  # fmt: skip
            lowest = min(lowest, coal.distance(shapes[pair.first], at[pair.first], shape, place, coal.DistanceRequest(),
                                               coal.DistanceResult()))  # fmt: skip
    return float(lowest)


def print_table(rows: list[Row]) -> None:
    """Outcomes by kind, then refusals by code."""
    names = "".join(f"{name:>9}" for name in GOOD + BAD)
    print(f"{'kind':<10}{'scenes':>7}{names}{'events':>9}{'worst':>8}{'s/scene':>9}")
    for kind in (*KINDS, "all"):
        some = [row for row in rows if kind in (row.kind, "all")]
        counts = "".join(f"{sum(row.outcome == name for row in some):>9}" for name in GOOD + BAD)
        print(f"{kind:<10}{len(some):>7}{counts}{sum(row.events for row in some):>9}"
              f"{max((row.worst for row in some), default=0.0):>8.2g}"
              f"{np.mean([row.seconds for row in some] or [0.0]):>9.2f}")  # fmt: skip
    codes = collections.Counter(row.why for row in rows if row.outcome in ("refused", "unknown"))
    print("\nrefused: " + ", ".join(f"{count} {code}" for code, count in codes.most_common()))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="the first scene's number")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS, help="only these")
    parser.add_argument("--laws", action="store_true", help="hold answers against the laws too")
    options = parser.parse_args()
    os.environ.setdefault("TWOLINK_CACHE", "off")
    OUT.mkdir(exist_ok=True)
    rows: list[Row] = []
    with (OUT / f"honest_contacts-{options.seed}.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, [f.name for f in fields(Row)], lineterminator="\n")
        writer.writeheader()
        chosen = (n for n in itertools.count(options.first) if KINDS[n % len(KINDS)] in options.kinds)
        for number in itertools.islice(chosen, options.scenes):
            rows.append(row := check(number, options.seed, laws=options.laws))
            writer.writerow(asdict(row))
            file.flush()
            if row.outcome in BAD:
                print(f"{row}", file=sys.stderr, flush=True)
    print_table(rows)
    bad = sum(row.outcome in BAD for row in rows)
    print(f"{'met   ' if not bad else 'MISSED'}  wrong in silence, hangs, crashes: {bad} of {len(rows)} (bar: none)")
    return 0 if not bad else 1


if __name__ == "__main__":
    raise SystemExit(main())
