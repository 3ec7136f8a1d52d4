"""Steps that the native library has taken: of some of them, what a step is."""

from __future__ import annotations

import functools

import numpy as np

from twolink.contact.bodies import Multibody
from twolink.contact.impulses import Impulses
from twolink.contact.rest import resting
from twolink.contact.steps import EACH, HEAD, Blow, Memory, Record, Step, StepEnd, TakenSteps
from twolink.integrate.motion.state import Array
from twolink.native.contact import ContactScene, StepPlan, Told

AT_ONCE = 128  # steps a call, so that a run can be interrupted and tells how far it is
SOLVERS = ("newton", "proximal")
WHOLES, NUMBERS = 7, 5  # words of a step before its arrays: whole numbers, and numbers


def take_steps(
    scene: ContactScene, bodies: Multibody, plan: StepPlan, steps: range, q: Array, v: Array, memory: Memory
) -> CompiledSteps | None:
    """Steps of a plan from a state on, up to the first that the library does not find; None for none."""
    found = scene.run(plan, steps.start, min(len(steps), AT_ONCE), q, v, memory.words)
    return CompiledSteps(found, bodies, plan, steps.start) if found.taken else None


class CompiledSteps(TakenSteps):
    """Steps one after the other, of which those at samples and the last are known, the first of a run too.

    The last has the impacts of all, at times from the begin of the first on.
    """

    def __init__(self, told: Told, bodies: Multibody, plan: StepPlan, first: int) -> None:
        self._told, self._bodies, self._plan, self._first = told, bodies, plan, first

    @functools.cached_property
    def _at(self) -> dict[int, int]:
        """Places where the words of a step begin."""
        found, wholes, at, model = dict[int, int](), self._told.words.view(np.int64), 0, self._bodies.model
        while at < len(wholes):
            number, *_, known, count, of_joints = wholes[at : at + WHOLES].tolist()
            found[number] = at
            at += WHOLES + NUMBERS + HEAD + model.nq + (4 + of_joints) * model.nv + EACH * known + 10 * count
        return found

    def __len__(self) -> int:
        return self._told.taken

    @property
    def end(self) -> StepEnd:
        """The end of the last."""
        if self._told.rests:
            return super().end
        model, read = self._bodies.model, _Reader(self._told.words, self._told.last + WHOLES + NUMBERS)
        q, v, _ = read.numbers(model.nq), read.numbers(model.nv), read.numbers(model.nv)
        return StepEnd(q, v, read.memory(self._told.known, model.nv))

    def __getitem__(self, j: int) -> Step:
        """The step j."""
        step = self._read(self._at[j], self._blows() if j == len(self) - 1 else ())
        if j < len(self) - 1:
            return step
        return resting(self._bodies, self._plan, self._first + j, step) if self._told.rests else step

    def count_in(self, record: Record) -> None:
        """Count the steps."""
        steps, halved, softened, *solved, feasibility, complementarity = self._told.record
        record.steps += int(steps)
        record.halved += int(halved)
        record.softened += int(softened)
        for solver, count in zip(SOLVERS, solved, strict=True):
            if count:
                record.solvers[solver] = record.solvers.get(solver, 0) + int(count)
        record.feasibility = max(record.feasibility, feasibility)
        record.complementarity = max(record.complementarity, complementarity)

    def _read(self, at: int, blows: tuple[Blow, ...]) -> Step:
        """The step whose words begin at a place: `tell` of native/contact/run.c."""
        read = _Reader(self._told.words, at)
        _, touches, solver, softened, known, count, of_joints = read.wholes(WHOLES).tolist()
        h, overlap, feasibility, complementarity, residual = read.numbers(NUMBERS).tolist()
        nq, nv = self._bodies.model.nq, self._bodies.model.nv
        q, v, mean = read.numbers(nq), read.numbers(nv), read.numbers(nv)
        memory = read.memory(known, nv)
        keys = read.wholes(count)
        place, on_first, slips = (read.numbers(3 * count).reshape(-1, 3) for _ in range(3))
        joints = read.numbers(nv) if of_joints else None
        none = np.empty((0, 3))
        impulses = Impulses(none, none, feasibility, complementarity, residual, SOLVERS[solver]) if touches else None
        deepest = None if np.isnan(overlap) else overlap
        return Step(h, q, v, mean, memory, keys, place, on_first, impulses, deepest, joints, slips, blows,
                    softened=bool(softened))  # fmt: skip

    def _blows(self) -> tuple[Blow, ...]:
        """The impacts of all steps."""
        read, found = _Reader(self._told.blow_words, 0), []
        while read.at < len(self._told.blow_words):
            (count,), (late,) = read.wholes(1).tolist(), read.numbers(1).tolist()
            keys, on_first = read.wholes(count), read.numbers(3 * count).reshape(-1, 3)
            found.append(Blow(late, keys, on_first, read.numbers(self._bodies.model.nv)))
        return tuple(found)


class _Reader:
    """Words, read from a place on: numbers, or whole ones."""

    def __init__(self, words: Array, at: int) -> None:
        self._words, self._wholes, self.at = words, words.view(np.int64), at

    def numbers(self, count: int) -> Array:
        """The next numbers."""
        self.at += count
        return self._words[self.at - count : self.at]

    def wholes(self, count: int) -> Array:
        """The next whole numbers."""
        self.at += count
        return self._wholes[self.at - count : self.at]

    def memory(self, count: int, nv: int) -> Memory:
        """The next words as a memory of so many contacts."""
        return Memory(self.numbers(HEAD + 2 * nv + EACH * count))
