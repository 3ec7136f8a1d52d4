"""Are the native library's steps with contacts those of the law in NumPy? Random scenes of all that they know.

    python -m scripts.studies.steps [--scenes 500] [--seed 0] [--first 0]

Scenes: `scenes.everything`, and every third of `scenes.contacts`. Each step, of 1 to 8 ms, is taken by both from the
same state and memory, those of NumPy. A step agrees where q and v differ by less than 1e-11, relative to the largest
velocity; worst: of these. other: steps that differ by up to `far`, of which both obey the laws: contacts with friction
may have several solutions. WRONG: one that does not obey them. Rows go to out/steps-SEED.csv. Ends 0 if nothing is
wrong or crashes, and at most 1 % of all steps are others.
"""

import argparse
import traceback
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

import twolink as tl
from scripts.runner import Bars, Judged, Table, study
from scripts.studies.scenes import contacts, everything
from twolink.contact.compiled_steps import take_steps
from twolink.contact.impulses import EXACT
from twolink.contact.solver import stepper_of
from twolink.contact.stepping import ContactStepper
from twolink.contact.steps import Step, plan_steps
from twolink.errors import TwolinkError

SAME = 1e-11  # m, rad, and of the speed
STEPS = 60
OTHERS = 0.01  # of all steps


@dataclass
class Row(Judged):
    """A scene, and its steps: how many there are, touch, and differ."""

    steps: int = 0
    touch: int = 0
    other: int = 0
    far: float = 0.0


def pairs_of_steps(stepper: ContactStepper, h: float, count: int) -> Iterator[tuple[Step, Step]]:
    """A step by NumPy and the same one by the library, one after the other from NumPy's ends."""
    plan = plan_steps(stepper.equations, np.array([0.0, count * h]), h, 0)
    q, v, memory = stepper.begin
    for k, (t, length) in enumerate(zip(plan.t.tolist(), plan.h.tolist(), strict=True)):
        one = stepper.advance(t, length, q, v, plan.numbers[plan.piece[k]], memory)
        found = take_steps(stepper.native, stepper.bodies, plan, range(k, k + 1), q, v, memory)
        if found is not None and (other := found[0]).memory.rest is None:
            yield one, other
        q, v, memory = one.q, one.v, one.memory._replace(rest=None)


def difference(one: Step, other: Step) -> float:
    """How far the ends of two steps differ, m, rad, and of the speed."""
    apart = max(float(np.abs(one.q - other.q).max()), float(np.abs(one.v - other.v).max()))
    return apart / max(1.0, float(np.abs(one.v).max()))


def scene_of(seed: int, number: int) -> tuple[str, tl.Scene]:
    """The kind of a scene, and the scene."""
    if number % 3:
        return "everything", everything.scene_of(seed, number)
    one = contacts.case(number // 3, seed)
    return contacts.KINDS[number // 3 % len(contacts.KINDS)], one.scene


def check(number: int, given: argparse.Namespace) -> Row:
    """The steps of one scene."""
    h = float(10 ** np.random.default_rng([given.seed, number, 1]).uniform(-3.0, -2.1))
    kind, scene = scene_of(given.seed, number)
    row = Row(number, kind, f"h = {h:.3g} s, {', '.join(type(one).__name__ for one in scene.effects)}", "agrees")
    try:
        stepper = stepper_of(scene)
        for one, other in pairs_of_steps(stepper, h, STEPS):
            apart = difference(one, other)
            row.steps += 1
            row.touch += one.impulses is not None
            if apart < SAME:
                row.worst = max(row.worst, apart)
            else:
                row.other, row.far = row.other + 1, max(row.far, apart)
                if other.impulses is None or not other.impulses.residual <= EXACT:
                    row.outcome, row.why = "WRONG", f"step {row.steps}"
    except TwolinkError as error:
        return replace(row, outcome="refused", why=error.code)
    except Exception as error:
        traceback.print_exception(error)
        return replace(row, outcome="CRASH", why=repr(error)[:200])
    return row


def show(rows: list[Row], _given: argparse.Namespace) -> Bars:
    """Outcomes by kind."""
    table = Table("kind <12 | scenes >6 | steps >6 | touch >6 | worst >8.1e | other >6 | far >8.1e | refused >7 | "
                  "fail >6")  # fmt: skip
    for kind in ("everything", *contacts.KINDS, "all"):
        some = [row for row in rows if kind in (row.kind, "all")]
        if some:
            table.add(kind, len(some), *(sum(getattr(row, name) for row in some) for name in ("steps", "touch")),
                      max(row.worst for row in some), sum(row.other for row in some), max(row.far for row in some),
                      sum(row.outcome == "refused" for row in some), sum(row.fails for row in some))  # fmt: skip
    other, steps, bad = (sum(getattr(row, name) for row in rows) for name in ("other", "steps", "fails"))
    return [(other <= OTHERS * steps, f"other solutions: {other} of {steps} steps (bar: {OTHERS:.0%})"),
            (not bad, f"wrong, crashes: {bad} of {len(rows)} (bar: none)")]  # fmt: skip


if __name__ == "__main__":
    raise SystemExit(study(__doc__, "steps", Row, check, show, scenes=500))
