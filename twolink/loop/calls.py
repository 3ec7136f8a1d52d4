"""Calls: how a law is asked at a tick for all solutions.

By its program, where it is traced; by one call with rows, where it takes them; else by a call for each. The first two
are held against calls for each: beside the motion before the run, and at ticks 1, 2, 4, ... and every 256th.
"""

import copy
import itertools
import warnings
import weakref
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from twolink.effects.sampled_control import Controller
from twolink.errors import ControllerError, SceneError
from twolink.loop.laws import (
    Array,
    Given,
    Measured,
    Own,
    UntracedError,
    answer,
    failure,
    leaves_of,
    name_of,
    numbers_of,
    rebuilt,
    row_of,
    stacked,
    with_numbers,
)
from twolink.loop.plain_functions import LawCode
from twolink.loop.replay import REMEDY, repeated_once
from twolink.loop.tracing import traced
from twolink.native.library import library
from twolink.native.machine import Program, SmallBatch

OFTEN = 256  # ticks, of which one is repeated to see whether the answer is the same, as are the 2nd, 4th, 8th
QUESTIONS, SPREAD, SEED = 20, (0.0, 3.0, 1.0, 0.3, 0.1), 2  # beside the motion, how far from its start, and their seed
LATER = 10.0  # s: how much later they are
ROUNDING = 1e-11  # of the largest numbers so far: what a program may be off
ALONE = 1e-9  # of the largest torque: what a row may be off that is asked for alone
# What may see rows of other solutions, also where no answer shows it, beside NumPy's functions that are not by entry.
MIXING = {"@", "[]", "T", "flatten", "item", "len", "linalg", "sorted", "tolist"}
BY_ENTRY = {"array", "asarray", "clip", "float64", "interp", "nan_to_num", "ones_like", "round", "where", "zeros_like"}
MEMORY = "it may remember something beside its state"
_single = weakref.WeakSet[Any]()  # laws that answered otherwise in one call for all solutions


class DiffersError(Exception):
    """The reason to solve again: a law answers otherwise in one call for all solutions than in one for each."""


@dataclass(eq=False)
class Asked:
    """A law in a run.

    own: the law and the state of each solution; one for all of them where it is traced or takes rows. how: "traced",
    "in rows" or "for each"; why: the reason. largest: numbers of its program so far.
    """

    place: int
    controller: Controller
    joints: tuple[str, ...]
    own: list[Own]
    plain: bool
    again: bool
    how: str = "for each"
    why: str = ""
    program: Program | None = None
    batch: SmallBatch | None = None
    divides: bool = False
    largest: Array = field(default_factory=lambda: np.zeros(0))

    def __call__(self, t: float, tick: int, given: Given) -> Array:
        """The torques (n, m) of n solutions."""
        often = is_often(tick)
        if self.how == "for each":
            return self._for_each(t, given, often=often)
        if not often:
            return self._by_program(t, given) if self.how == "traced" else self._in_rows(t, given)
        before = Own(self.own[0].law, self.own[0].state) if self.plain else copy.deepcopy(self.own[0])
        u = self._by_program(t, given) if self.how == "traced" else self._in_rows(t, given)
        self.require(t, given, before, u)
        return u

    def require(self, t: float, given: Given, before: Own, u: Array) -> None:
        """Require the answers u, and the state by now, from calls for solutions alone."""
        if what := self._differs(t, given, before, u):
            raise self.refused(t, what)

    @property
    def guessed(self) -> bool:
        """True if a run in which the way of asking shows to be wrong begins anew, with calls for each solution."""
        asked_for = self.controller.vectorized or self.controller.traced is True
        return self.again and not asked_for and self.how != "for each"

    def refused(self, t: float, what: str) -> Exception:
        """The error of a law that answers otherwise alone, or has no sound answer."""
        if self.guessed:
            _single.add(self.controller.update)
            return DiffersError(what)
        return failure(self.place, t, what, code="law-differs",
                       remedy="leave traced and vectorized as they are by default")  # fmt: skip

    def _for_each(self, t: float, given: Given, *, often: bool) -> Array:
        every = [Measured(**dict(zip(given, row, strict=True))) for row in zip(*given.values(), strict=True)]
        again = repeated_once(self.own[0], every[0]) if often and not self.plain else None
        u = np.empty((len(self.own), len(self.joints)))
        for i, (y, own) in enumerate(zip(every or [Measured()] * len(u), self.own, strict=True)):
            u[i] = self._alone(own, t, y)
        if again is not None and not np.array_equal(self._alone(again[0], t, again[1]), u[0], equal_nan=True):
            raise failure(self.place, t, "it gives another answer to the same t, y and state", remedy=REMEDY,
                          code="controller-not-repeatable")  # fmt: skip
        return u

    def _alone(self, own: Own, t: float, y: Measured) -> Array:
        return answer(self.place, self.joints, own, t, y)

    def _in_rows(self, t: float, given: Given) -> Array:
        count = len(next(iter(given.values())))
        return answer(self.place, self.joints, self.own[0], t, Measured(**given), count)

    def _by_program(self, t: float, given: Given) -> Array:
        batch, own = self.batch, self.own[0]
        if batch is None:
            raise UntracedError("there is no program")
        batch.inputs[0][:] = t
        for to, values in zip(batch.inputs[1:], (*given.values(), own.state), strict=True):
            to[:] = values.reshape(to.shape)
        batch.run(len(own.state))
        if self.divides and batch.outputs[2].any():
            raise self.refused(t, "its program divides by 0")
        own.state = batch.outputs[1].copy()
        return batch.outputs[0].copy()

    def _differs(self, t: float, given: Given, before: Own, u: Array) -> str:
        """The difference that is found by asking for solutions alone; "": nothing."""
        if self.how == "traced":
            meant = self._meant(t, given, before)
            return self._off(np.append(u[0], self.own[0].state[0]), meant)
        rows = {name: values.copy() for name, values in given.items()}
        if self.controller.vectorized:
            own = Own(before.law, _first(before.state, len(u)))
            alone = answer(self.place, self.joints, own, t, Measured(**{k: one[:1] for k, one in rows.items()}), 1)
            return "a row depends on other rows" if np.abs(alone - u[:1]).max() > ALONE * np.abs(u).max() else ""
        try:
            for i in range(len(u)):
                own = Own(before.law, row_of(before.state, i, self.controller.state))
                alone = self._alone(own, t, Measured(**{name: values[i] for name, values in rows.items()}))
                after = row_of(self.own[0].state, i, self.controller.state)
                states = numbers_of(own.state), numbers_of(after)
                if alone.tobytes() != u[i].tobytes() or states[0].tobytes() != states[1].tobytes():
                    return "rows have other bits than calls for each"
        except (ControllerError, UntracedError, ValueError, TypeError, IndexError) as error:
            return f"calls for each differ: {error}"
        return ""

    def _meant(self, t: float, given: Given, before: Own) -> Array | str:
        """The law's own torques and new numbers (m + k,) for the first solution, or why there are none."""
        state = with_numbers(self.controller.state, before.state[0])
        own, y = Own(before.law, state), Measured(**{name: values[0].copy() for name, values in given.items()})
        try:
            with np.errstate(all="ignore"), warnings.catch_warnings():
                warnings.simplefilter("ignore")
                meant = np.append(self._alone(own, t, y), numbers_of(own.state))
        except (ControllerError, UntracedError) as error:
            return f"its program answers where {error}"
        if meant.shape != self.largest.shape:
            return "its state changes its form"
        self.largest = np.fmax(self.largest, np.where(np.isfinite(meant), np.abs(meant), 0.0))
        return meant

    def _off(self, found: Array, meant: Array | str) -> str:
        """The difference of a program's numbers from the law's own; "": nothing."""
        if isinstance(meant, str):
            return meant
        near = np.abs(found - meant) <= ROUNDING * self.largest
        fine = near | (found == meant) | (np.isnan(found) & np.isnan(meant))
        return "" if fine.all() else f"its program gives {found[~fine][0]:.9g} for {meant[~fine][0]:.9g}"


def is_often(tick: Any) -> Any:
    """True if answers are looked at twice at a tick, or at each of some."""
    return (tick % OFTEN == 0) | (tick & (tick - 1) == 0)


def asked(
    place: int, one: Controller, joints: tuple[str, ...], owns: list[Own], found: LawCode | None, given: Given,
    t: float, *, again: bool,
) -> Asked:  # fmt: skip
    """The way of asking a law. owns: of each solution; found: of a plain law; given: at the start, at a time t [s].

    again: whether a run that finds it wrong can begin anew. Raises SceneError, code "law-not-traced".
    """
    law = Asked(place, one, joints, owns, found is not None, again)
    known = found is not None and one.update not in _single
    if one.traced is True or (one.traced == "auto" and again and known and not one.vectorized):
        law.why = _trace(law, found, given, t)
        if law.how == "traced":
            return law
        if one.traced is True:
            raise SceneError(f"the law {name_of(one.update)} cannot be traced: {law.why}",
                             where=f"effects[{place}].update", code="law-not-traced",
                             remedy='functions of NumPy, such as np.where; or traced="auto"')  # fmt: skip
    elif not known:
        law.why = MEMORY if found is None else "in one call for all it answered otherwise"
    if one.vectorized:
        law.how, law.own = "in rows", owns[:1]
    elif known and again and len(owns) > 1:
        _let_take_rows(law, found, given, t)
    return law


def _trace(law: Asked, seen: LawCode | None, given: Given, t: float) -> str:
    """Let a law be traced, or say why it is not."""
    if seen is None:
        return MEMORY
    if library() is None:
        return "there is no native library"
    one, own, count = law.controller, law.own[0], len(law.own)
    try:
        made = traced(own.law, {name: values.shape[1:] for name, values in given.items()}, own.state, len(law.joints))
    except UntracedError as error:
        return str(error)
    state = numbers_of(own.state)
    sizes = [1, *(values[0].size for values in given.values()), len(state)]
    law.program = made.program
    law.batch = SmallBatch(made.program, count, sizes, [len(law.joints), len(state), 1])
    law.largest, law.how, pairs = np.zeros(len(law.joints) + len(state)), "traced", []
    random = np.random.default_rng(SEED)
    for k, (at, y) in enumerate(_questions(given, t)):
        noise = random.standard_normal(len(state)) * SPREAD[k % len(SPREAD)]
        numbers = np.repeat(numbers_of(with_numbers(one.state, state + noise))[None], count, axis=0)
        law.own, law.divides = [Own(own.law, numbers)], False
        u = law._by_program(at, y)
        pairs.append((np.append(u[0], law.own[0].state[0]), law._meant(at, y, Own(own.law, numbers))))
    for found, meant in pairs:  # now that it is known how large numbers are
        if what := law._off(found, meant):
            law.own, law.how = [Own(own.law, copy.deepcopy(one.state)) for _ in range(count)], "for each"
            return what
    law.own, law.divides = [Own(own.law, np.repeat(state[None], count, axis=0))], made.divides
    return f"{made.operations} operations"


def _let_take_rows(law: Asked, found: LawCode | None, given: Given, t: float) -> None:
    """Let a plain law take rows if it gives the bits of calls for each; its state has rows then."""
    if found is None or not _is_by_entry(found.names):
        return
    start, own, count = law.controller.state, law.own, len(law.own)
    try:
        state, law.how = stacked(start, count), "in rows"
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            for k, (at, y) in enumerate(_questions(given, t)):
                random = np.random.default_rng((SEED, k))
                before = rebuilt(state, iter([x + SPREAD[k % len(SPREAD)] * random.standard_normal(x.shape)
                                              if x.dtype.kind == "f" else x for x in leaves_of(state)]))  # fmt: skip
                law.own = [Own(own[0].law, before)]
                u = law._in_rows(at, {name: values.copy() for name, values in y.items()})
                if law._differs(at, y, Own(own[0].law, before), u):
                    break
            else:
                law.own = [Own(own[0].law, state)]
                return
    except (ControllerError, UntracedError):
        pass
    law.how, law.own = "for each", own


def _is_by_entry(names: set[str]) -> bool:
    """True if what code names computes entry by entry."""
    functions = {name: getattr(np, name) for name in names - BY_ENTRY if callable(getattr(np, name, None))}
    return not names & MIXING and all(isinstance(one, np.ufunc) for one in functions.values())


def _questions(given: Given, t: float) -> Iterator[tuple[float, Given]]:
    """Times, and what is given to each solution then, beside the motion."""
    random = np.random.default_rng(SEED)
    for _, spread in zip(range(QUESTIONS), itertools.cycle(SPREAD), strict=False):
        yield t + LATER * spread * random.random(), {name: values + spread * random.standard_normal(values.shape)
                                                     for name, values in given.items()}  # fmt: skip


def _first(state: Any, count: int) -> Any:
    """The rows of the first solution in a state."""
    try:
        leaves = leaves_of(state)
    except UntracedError:
        return state
    return rebuilt(state, iter([one[:1] if np.ndim(one) and len(one) == count else one for one in leaves]))
