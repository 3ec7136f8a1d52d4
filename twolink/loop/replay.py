"""Replay: the ticks of solutions, repeated from the start, show what laws remember beside their states.

Each solution is repeated with laws that no solution has called. Functions are copied, once as they were before the
first tick and once as they are now, so that nobody sees these calls. What laws keep in classes, modules and files may
change no answer on this motion, but those on the next one: so they are asked the same before the first tick and now,
beside the motion. Answers must have the same bits.
"""

import copy
import itertools
import warnings
from collections.abc import Callable, Iterator, Mapping

import numpy as np

from twolink.effects.sampled_control import Controller
from twolink.errors import ControllerError
from twolink.loop.copies import Watched
from twolink.loop.laws import (
    Array,
    Given,
    Measured,
    Own,
    answer,
    copied_laws,
    failure,
    is_function,
    laws_apart,
    name_of,
)

Tick = tuple[int, float, Given, Array]  # the place, the time, what was given, and the answers (n, m)
MOST = 2**17  # ticks of a simulation that goes on without an end: what is behind them is not repeated
ASKED, TOGETHER, SEED = 15, 3, 1  # questions beside the motion, how many a copy is asked, and of their random numbers
SPREAD = (
    0.0,
    3.0,
    1.0,
    0.3,
    0.1,
)  # the first of the start, as the run asks; how far they are from the start, in rad, m and their rates
CROSSED = 8  # ticks at which laws are asked what they were asked at other ones
REMEDY = ("return what it keeps as the state, or make the law an object of a class that keeps it in itself, which is "
          "copied for each solution; take noise from sensors of the scene, and no time but t")  # fmt: skip


class Replay:
    """The ticks so far of laws that may remember something; none: all are seen to remember nothing.

    Parameters
    ----------
    controllers : mapping of int to Controller
    joints : mapping of int to tuple of str
        What each drives.
    t : float
        The time of the start, s.
    start : callable
        The place -> what is given at the start (n, ...).
    """

    def __init__(
        self,
        controllers: Mapping[int, Controller],
        joints: Mapping[int, tuple[str, ...]],
        t: float,
        start: Callable[[int], Given],
    ) -> None:
        self._looked = controllers
        self._joints = joints
        self._before = laws_apart(self._looked)
        self._start = [(place, t, start(place)) for place in self._looked]
        self._watched = Watched([one.law for one in self._before.values()])
        self._answers = self._beside(self._before)
        self._asked_again = False
        self._functions = [place for place, one in self._looked.items() if is_function(one.update)]
        self._ticks: list[Tick] = []
        self._checked, self._full = 0, False

    def asked(self, place: int, law: Callable[[float, int, Given], Array], t: float, tick: int, given: Given) -> Array:
        """The answers (n, m) of a law, which may write to what it is given; they are noted if it is asked again."""
        if place not in self._looked or self._full:
            return law(t, tick, given)
        if not self._asked_again:  # else the questions themselves would change the motion
            self._asked_again = True
            self._require_answers(self._before, "when it is asked again")
        noted = {name: values.copy() for name, values in given.items()}
        u = law(t, tick, given)
        self._ticks.append((place, t, noted, u))
        return u

    def saved(self) -> tuple[list[Tick], int, bool]:
        """The state of the replay, for `restore`."""
        return self._ticks.copy(), self._checked, self._full

    def restore(self, saved: tuple[list[Tick], int, bool]) -> None:
        """Go on from there."""
        ticks, self._checked, self._full = saved
        self._ticks = ticks.copy()

    def now_and_then(self) -> None:
        """Require the same answers whenever the ticks are twice as many as the last time."""
        if len(self._ticks) >= 2 * self._checked + 1:
            self.require()
        if len(self._ticks) > MOST:
            self._ticks, self._full = [], True

    def require(self) -> None:
        """Require the same answers as before. Raises ControllerError, code "controller-not-repeatable"."""
        if len(self._ticks) == self._checked:
            return
        self._checked, count = len(self._ticks), len(self._ticks[0][3])
        if changed := self._watched.changed():
            place, t, *_ = self._ticks[0]
            raise self._refusal(place, t, f"changes {changed}, which is not one solution's own")
        self._require_answers(laws_apart(self._looked), "after the motion")
        for i in range(count):
            self._repeat(i, copied_laws(self._before, self._looked))
        if self._functions:
            self._repeat(0, laws_apart(self._looked))
            self._cross()

    def _repeat(self, i: int, laws: dict[int, Own]) -> None:
        """Repeat the ticks of solution i."""
        for place, t, given, u in self._ticks:
            if i and self._looked[place].vectorized:
                continue
            new, before = self._asked(place, t, self._part(place, given, i), laws[place]), self._of(place, u, i)
            if not _same(new, before):
                self._refuse(place, t, f"{_text(new)} for {_text(before)} when its ticks are repeated from the start")

    def _questions(self) -> Iterator[tuple[int, Measured, float]]:
        """The place, what is given and the time of each question beside the motion."""
        random = np.random.default_rng(SEED)
        for _, spread in zip(range(ASKED), itertools.cycle(SPREAD), strict=False):
            for place, t, given in self._start:
                off = {name: values[:1] + spread * random.standard_normal(values[:1].shape)
                       for name, values in given.items()}  # fmt: skip
                yield place, self._part(place, off, 0), t

    def _beside(self, laws: dict[int, Own]) -> list[Array | str]:
        """The answers to them, or that there is none; of copies that were asked no more than a few."""
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            answers, own = [], dict[int, Own]()
            for k, (place, y, t) in enumerate(self._questions()):
                own = copied_laws(laws, self._looked) if k % TOGETHER == 0 else own
                answers.append(self._asked(place, t, y, own[place]))
            return answers

    def _require_answers(self, laws: dict[int, Own], when: str) -> None:
        """Require the answers that were given before the motion."""
        for (place, _, t), one, other in zip(self._questions(), self._answers, self._beside(laws), strict=True):
            if not _same(one, other):
                self._refuse(place, t, f"{_text(other)} for {_text(one)} {when}")

    def _cross(self) -> None:
        """Ask functions, as they were and as they are, at some times what they were asked at others.

        A table of answers by time gives those back that the motion got.
        """
        count, laws = len(self._ticks), (copied_laws(self._before, self._looked), laws_apart(self._looked))
        for k in np.unique(np.linspace(0, count - 1, min(CROSSED, count)).astype(int)).tolist():
            place, t, *_ = self._ticks[k]
            given = next(one[2] for one in self._ticks[-1 - k :] + self._ticks if one[0] == place)
            if place in self._functions:
                before, now = (self._asked(place, t, self._part(place, given, 0), each[place]) for each in laws)
                if not _same(before, now):
                    self._refuse(place, t, f"{_text(now)} for {_text(before)} after the motion")

    def _asked(self, place: int, t: float, y: Measured, own: Own) -> Array | str:
        """The answer (m,), or why there is none."""
        rows = len(next(iter(vars(y).values()))) if self._looked[place].vectorized else 0
        try:
            return answer(place, self._joints[place], own, t, y, rows).copy()  # a law may write to it again
        except ControllerError as error:
            return error.what

    def _of(self, place: int, values: Array, i: int) -> Array:
        """The values of solution i; of a law that takes rows, all."""
        return values if self._looked[place].vectorized else values[i]

    def _part(self, place: int, given: Given, i: int) -> Measured:
        return Measured(**{name: self._of(place, values, i).copy() for name, values in given.items()})

    def _refuse(self, place: int, t: float, how: str) -> None:
        raise self._refusal(place, t, f"gives another answer, {how}: it keeps something beside its state")

    def _refusal(self, place: int, t: float, what: str) -> ControllerError:
        law = name_of(self._looked[place].update)
        return failure(place, t, f"its law {law} {what}", remedy=REMEDY, code="controller-not-repeatable")


def repeated_once(own: Own, y: Measured) -> tuple[Own, Measured] | None:
    """Copies of a law and of what it is about to be asked; None where they cannot be copied."""
    try:
        return copy.deepcopy((own, y))
    except Exception:  # of a user's own class any; its ticks are repeated later
        return None


def _same(one: Array | str, other: Array | str) -> bool:
    if isinstance(one, str) or isinstance(other, str):
        return isinstance(one, str) and isinstance(other, str)
    return one.tobytes() == other.tobytes() or np.array_equal(one, other, equal_nan=True)


def _text(answer: Array | str) -> str:
    return f"an error ({answer})" if isinstance(answer, str) else np.array2string(answer, precision=6, threshold=6)
