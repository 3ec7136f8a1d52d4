"""Are answers about bodies that touch ever wrong in silence? Random scenes with contacts, each simulated and judged.

    python -m scripts.studies.contacts [--scenes 200] [--seed 0] [--first 0] [--laws] [--kinds ledge,plate]

Scenes: `scenes.contacts`. Three kinds have exact motions, and hulls on a large hull must move as on a plane; for the
others the reference is a run that is 1,000 times more accurate, whose own error bar counts as its doubt. With --laws
every answer is also held against the laws, by other code than the engine's: Coal's distances (no bodies overlap),
contact forces on planes (no pull, within the cone of friction), energy (contacts and dampers only take some).

exact, agrees: no sample is farther from the truth, or from the reference, than the error bar. WRONG: one is, or a law
is broken. refused: a named error, counted by code. HANG: no end after PATIENCE seconds of processor time. CRASH: an
error that is none of twolink's. Rows go to out/contacts-SEED.csv. Ends 0 if nothing is wrong, hangs or crashes.
"""

import argparse
import collections
import itertools
import time
import traceback
from dataclasses import dataclass, replace

import coal
import numpy as np
import pinocchio as pin

import twolink as tl
from scripts.runner import Bars, OutOfTime, Some, Table, processor_time, study
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

    @property
    def fails(self) -> bool:
        return self.outcome in BAD


def check(number: int, seed: int, *, laws: bool) -> Row:
    """Simulate one scene, and judge its answer."""
    one, start = case(number, seed), time.process_time()
    row = Row(number, KINDS[number % len(KINDS)], one.what, one.accuracy)
    try:
        with processor_time(PATIENCE):
            row = _judged(row, one, laws=laws)
    except OutOfTime:
        row = replace(row, outcome="HANG")
    except TwolinkError as error:
        row = replace(row, outcome="refused", why=error.code)
    except Exception as error:  # whatever it is, it has no place in an answer
        traceback.print_exc()
        row = replace(row, outcome="CRASH", why=repr(error)[:200])
    return replace(row, seconds=round(time.process_time() - start, 2))


def _judged(row: Row, one: Case, *, laws: bool) -> Row:
    def run_at(accuracy: float) -> tl.Trajectory:
        return tl.simulate(
            one.scene, one.duration, accuracy=accuracy, samples_per_second=SAMPLES / one.duration, contact=one.way
        )

    run = run_at(one.accuracy)
    row = replace(row, events=len(run.events))
    broken = broken_law(one, run) if laws else ""
    if broken:
        return replace(row, outcome="WRONG", why=broken)
    try:
        if one.truth is not None:
            exact = one.truth(run.t)
            error = np.abs(free_positions(run.q, exact.shape[1]) - exact).max(axis=1)
            bar, outcome = run.error + 4e-16 * np.abs(exact).max(), "exact"
        else:
            fine = run_at(max(1e-11, FINER * one.accuracy))
            count = min(len(run.t), len(fine.t))
            error, bar = distance(run.robot, run.q[:count], fine.q[:count]), run.error[:count] + fine.error[:count]
            outcome = "agrees"
    except TwolinkError as failure:
        return replace(row, outcome="unknown", why=failure.code)
    worst = float((error[1:] / np.maximum(bar[1:], 1e-300)).max())
    if worst > 1.0:
        return replace(row, outcome="WRONG", why="error bar", worst=worst)
    return replace(row, outcome=outcome, worst=worst)


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


def show(rows: list[Row], _given: argparse.Namespace) -> Bars:
    """Outcomes by kind, then refusals by code."""
    table = Table("kind <9 | scenes >6 | " + "".join(f"{name} >8 | " for name in GOOD + BAD)
                  + "events >8 | worst >7.2g | s/scene >8.2f")  # fmt: skip
    for kind in (*KINDS, "all"):
        some = [row for row in rows if kind in (row.kind, "all")]
        table.add(kind, len(some), *(sum(row.outcome == name for row in some) for name in GOOD + BAD),
                  sum(row.events for row in some), max((row.worst for row in some), default=0.0),
                  float(np.mean([row.seconds for row in some] or [0.0])))  # fmt: skip
    codes = collections.Counter(row.why for row in rows if row.outcome in ("refused", "unknown"))
    print("\nrefused: " + ", ".join(f"{count} {code}" for code, count in codes.most_common()))
    bad = sum(row.fails for row in rows)
    return [(not bad, f"wrong in silence, hangs, crashes: {bad} of {len(rows)} (bar: none)")]


def numbers(given: argparse.Namespace) -> list[int]:
    """The numbers of the scenes of the chosen kinds."""
    chosen = (n for n in itertools.count(given.first) if KINDS[n % len(KINDS)] in given.kinds)
    return list(itertools.islice(chosen, given.scenes))


if __name__ == "__main__":
    raise SystemExit(study(__doc__, "contacts", Row, lambda n, given: [check(n, given.seed, laws=given.laws)], show,
                           numbers, scenes=200, laws=False, kinds=Some(KINDS)))  # fmt: skip
