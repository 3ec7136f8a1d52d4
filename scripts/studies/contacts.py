"""Are answers about bodies that touch ever wrong in silence? Random scenes with contacts, each simulated and judged.

    python -m scripts.studies.contacts [--scenes 200] [--seed 0] [--first 0] [--laws]
        [--ways auto,stepped,step,accuracy] [--kinds ledge,plate]

Scenes: `scenes.contacts`. Three kinds have exact motions, and hulls on a large hull must move as on a plane; for the
others the reference is a run that is 1,000 times more accurate, whose own error bar counts as its doubt. Ways: auto, as
the scene asks for, by default; stepped as well as STEPPING seconds allow; stepped with a step of 1 to 10 ms, or with an
accuracy of 1e-3 to 1e-2. With --laws every answer is also held against the laws, by other code than the engine's:
Coal's distances (no bodies overlap), contact forces on planes (no pull, within the cone of friction), energy (contacts
and dampers only take some). A stepped run is so as long as its estimate is below 0.1 rad or m; its energy may be off by
the share that it estimates, and bodies overlap as far as its record says.

exact, agrees: no sample is farther from the truth, or from the reference, than the error bar. WRONG: one is, or a law
is broken. beyond: a stepped one is farther than its estimate. refused: a named error, counted by code. unknown: no
truth. HANG: no end after PATIENCE seconds of processor time. CRASH: an error that is none of twolink's. size: of the
bar over the error, each the largest of its samples, the median. Rows go to out/contacts-SEED.csv. Ends 0 if nothing is
wrong, hangs or crashes, and estimates cover 95 %.
"""

import argparse
import collections
import functools
import itertools
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import coal
import numpy as np
import pinocchio as pin

import twolink as tl
from scripts.runner import Bars, Judged, OutOfTime, Some, Table, processor_time, study
from scripts.studies.scenes.contacts import KINDS, case
from scripts.studies.scenes.robots import Case, free_positions
from twolink import effects as fx
from twolink.errors import TwolinkError
from twolink.geometry.pairs import Pair, Plane
from twolink.hard.truths import distance
from twolink.robots.collisions import Solid, collision_model

SAMPLES, LOOKS = 60, 400  # of a run; at which laws are checked
PATIENCE = 90.0  # s of processor time for a scene, of which compiling takes most
FINER = 1e-3
OVERLAP = 1e-5  # m: Coal's own accuracy of curved shapes is 2e-7
FLOOR = 1e-9  # rad or m: errors of stepped runs below it count as none
LAW = 1e-5  # of the largest force, and of the largest energy
STEPPING = 10.0  # s, of the best effort
COVERED = 0.95
TELLS = 0.1  # rad or m: where an estimate is larger, a stepped run says itself that it tells nothing of the motion
GOOD = ("exact", "agrees", "beyond", "refused", "unknown")
BAD = ("WRONG", "HANG", "CRASH")


@dataclass
class Row(Judged):
    """A scene, solved in a way, and what came of it. size: the largest bar over the largest error."""

    way: str = ""
    size: float = 0.0
    events: int = 0


def check(number: int, given: argparse.Namespace) -> Iterator[Row]:
    """Simulate one scene in some ways, and judge the answers."""
    one, random = case(number, given.seed), np.random.default_rng([given.seed, number, 1])
    asked = {way: float(10 ** random.uniform(-3, -2)) for way in ("step", "accuracy")}
    options: dict[str, dict[str, Any]] = {
        "auto": {"contact": one.way, "accuracy": one.accuracy}, "stepped": {"contact": "stepped", "patience": STEPPING},
        **{way: {"contact": "stepped", way: value} for way, value in asked.items()}}  # fmt: skip
    reference = functools.cache(functools.partial(run_of, one, contact=one.way,
                                                  accuracy=max(1e-11, FINER * one.accuracy)))  # fmt: skip
    for way in given.ways:
        row, start = Row(number, KINDS[number % len(KINDS)], one.what, way=way), time.process_time()
        try:
            run = run_of(one, **options[way])
        except Exception as error:
            row = replace(row, **_failed(error))
        else:
            row = _judged(replace(row, events=len(run.events)), one, run, reference, laws=given.laws)
        yield replace(row, seconds=round(time.process_time() - start, 2))


def run_of(one: Case, **options: Any) -> tl.Trajectory:
    """The run of a case. Raises OutOfTime."""
    with processor_time(PATIENCE):
        return tl.simulate(one.scene, one.duration, samples_per_second=SAMPLES / one.duration, **options)


def _failed(error: Exception) -> dict[str, str]:
    """The outcome of a run that ends in an error."""
    if isinstance(error, OutOfTime):
        return {"outcome": "HANG"}
    if isinstance(error, TwolinkError):
        return {"outcome": "refused", "why": error.code}
    traceback.print_exception(error)
    return {"outcome": "CRASH", "why": repr(error)[:200]}


def _judged(row: Row, one: Case, run: tl.Trajectory, reference: Callable[[], tl.Trajectory], *, laws: bool) -> Row:
    broken = broken_law(one, run) if laws else ""
    if broken:
        return replace(row, outcome="WRONG", why=broken)
    assert run.error is not None
    bar, outcome = run.error + FLOOR * run.estimated, "agrees"
    try:
        if one.truth is not None:
            exact = one.truth(run.t)
            error = np.abs(free_positions(run.q, exact.shape[1]) - exact).max(axis=1)
            bar, outcome = bar + 4e-16 * np.abs(exact).max(), "exact"
        elif (fine := reference()).estimated:
            return replace(row, outcome="unknown", why="only stepped")
        else:
            count = min(len(run.t), len(fine.t))
            error, bar = distance(run.robot, run.q[:count], fine.q[:count]), bar[:count] + fine.error[:count]
    except (TwolinkError, OutOfTime) as failure:
        return replace(row, outcome="unknown", why=getattr(failure, "code", "HANG"))
    worst = float((error[1:] / np.maximum(bar[1:], 1e-300)).max())
    outcome = outcome if worst <= 1.0 else "beyond" if run.estimated else "WRONG"
    return replace(row, outcome=outcome, worst=worst, size=float(bar.max() / max(error.max(), FLOOR)))


def broken_law(one: Case, run: tl.Trajectory) -> str:
    """The law that an answer breaks, "" if none."""
    (effect,) = (effect for effect in one.scene.effects if isinstance(effect, fx.Contact))
    told = slice(None) if run.error is None or not run.estimated else slice(max(1, int((run.error <= TELLS).sum())))
    q = run.q[told] if run.estimated else run.at(np.linspace(0.0, float(run.t[-1]), LOOKS))[0]
    pairs = effect.selected(run.robot).chosen
    overlap = -lowest_distance(run.robot, pairs, q)
    said = run.contact_record["overlap"] if run.estimated and run.contact_record else 0.0
    if overlap > OVERLAP + said:
        return f"overlap {overlap:.2g} m"
    energy = run.energy[told]
    gain = energy - np.minimum.accumulate(energy)
    off = 0.0 if not run.estimated or run.error is None else run.error[told]
    if (gain > (LAW + off) * (1.0 + np.abs(energy).max())).any():
        return f"energy grows by {gain.max():.2g} J"
    mu = effect.friction if effect.static is None else effect.static
    named = collections.Counter(pair.name for pair in pairs)  # several planes share a name, and their forces add up
    for pair in pairs:
        if isinstance(pair.second, Plane) and pair.name in run.contact_forces and named[pair.name] == 1:
            n = np.array(pair.second.normal) / np.linalg.norm(pair.second.normal)
            force = run.contact_forces[pair.name][told]
            small, normal = LAW * (1.0 + np.abs(force).max()), force @ n
            across = np.linalg.norm(force - np.outer(normal, n), axis=1)
            if normal.min() < -small:
                return f"{pair.name} pulls with {-normal.min():.2g} N"
            if (across - mu * normal).max() > small:
                return f"friction of {pair.name} exceeds its cone by {(across - mu * normal).max():.2g} N"
    return ""


def lowest_distance(robot: tl.Robot, pairs: tuple[Pair, ...], q: np.ndarray) -> float:
    """Coal's smallest distance of any pair at configurations q (n, nq); negative where bodies overlap."""
    bodies = list(dict.fromkeys(body for pair in pairs for body in (pair.first, pair.second)))
    solids = [body for body in bodies if isinstance(body, Solid)]
    geometry, numbers = collision_model(robot.model, solids), {solid: k for k, solid in enumerate(solids)}
    for plane in (body for body in bodies if isinstance(body, Plane)):
        half = coal.Halfspace(np.array(plane.normal) / np.linalg.norm(plane.normal), plane.height)
        ground = pin.GeometryObject(f"plane {len(numbers)}", 0, pin.SE3.Identity(), half)
        numbers[plane] = geometry.addGeometryObject(ground)
    for pair in pairs:
        geometry.addCollisionPair(pin.CollisionPair(numbers[pair.first], numbers[pair.second]))
    data, places, lowest = robot.model.createData(), geometry.createData(), np.inf
    for state in q:
        pin.computeDistances(robot.model, data, geometry, places, state)
        lowest = min(lowest, *(result.min_distance for result in places.distanceResults))
    return float(lowest)


def show(rows: list[Row], given: argparse.Namespace) -> Bars:
    """Outcomes by way and kind, then refusals by code."""
    table = Table("way <9 | kind <9 | scenes >6 | " + "".join(f"{name} >8 | " for name in GOOD + BAD)
                  + "events >8 | worst >7.2g | size >7.2g | s/scene >8.2f")  # fmt: skip
    for way, kind in itertools.product(given.ways, (*given.kinds, "all")):
        some = [row for row in rows if kind in (row.kind, "all") and row.way == way]
        judged = [row for row in some if row.outcome in GOOD[:3]]
        counts = (sum(row.outcome == name for row in some) for name in GOOD + BAD)
        table.add(way, kind, len(some), *counts, sum(row.events for row in some),
                  max((row.worst for row in judged), default=0.0), median(row.size for row in judged),
                  mean(row.seconds for row in some))  # fmt: skip
    codes = collections.Counter(row.why for row in rows if row.outcome in ("refused", "unknown"))
    print("\nrefused: " + ", ".join(f"{count} {code}" for code, count in codes.most_common()))
    bad, bars = sum(row.fails for row in rows), Bars()
    for way in (way for way in given.ways if way != "auto"):
        judged = [row for row in rows if row.way == way and row.outcome in GOOD[:3]]
        covered, of = sum(row.worst <= 1.0 for row in judged), len(judged)
        bars.append((covered >= COVERED * of, f"{way}: estimates cover {covered} of {of} (bar: {COVERED:.0%})"))
    return [*bars, (not bad, f"wrong in silence, hangs, crashes: {bad} of {len(rows)} (bar: none)")]


def median(values: Iterable[float]) -> float:
    return float(np.median([*values] or [np.nan]))


def mean(values: Iterable[float]) -> float:
    return float(np.mean([*values] or [np.nan]))


def numbers(given: argparse.Namespace) -> list[int]:
    """The numbers of the scenes of the chosen kinds."""
    chosen = (n for n in itertools.count(given.first) if KINDS[n % len(KINDS)] in given.kinds)
    return list(itertools.islice(chosen, given.scenes))


if __name__ == "__main__":
    raise SystemExit(study(__doc__, "contacts", Row, check, show, numbers, scenes=200, laws=False, ways=("auto",),
                           kinds=Some(KINDS)))  # fmt: skip
