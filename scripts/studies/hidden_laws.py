"""Laws of controllers that remember something beside their state, in every place that Python has for it.

Each has a pure twin, whose memory is its state: `pure`. `HOLDERS` hide it; of those in `COPIED` each solution must
have its own, those in `HARMLESS` change no answer, and the others must be right or refused.
"""

import contextvars
import functools
import itertools
import random
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

Law = Callable[..., Any]
Step = Callable[[Any, float, np.ndarray], tuple[float, Any]]  # memory, t, q -> what is added to u, memory
KEPT: dict[str, Any] = {}
COUNT: Any = 0
LATEST: Any = None
VARIABLE: contextvars.ContextVar[Any] = contextvars.ContextVar("memory")


def behaviour(rng: np.random.Generator, ticks: int) -> tuple[Step, Any]:
    """What a memory does to the answers, and its start: a counter, a latch, a thermostat, a filter, the last value."""
    limit, edge = int(rng.integers(1, max(2, ticks))), rng.uniform(-0.5, 0.7)
    steps: tuple[tuple[Step, Any], ...] = (
        (lambda m, _t, _q: (3.0 if m > limit else 0.0, m + 1), 0),
        (lambda m, _t, q: (3.0 * (m or q[0] > edge), m or bool(q[0] > edge)), False),
        (lambda m, _t, q: (3.0 * (on := q[0] > edge or (m and q[0] > edge - 0.1)), bool(on)), False),
        (lambda m, _t, q: (-5.0 * m, 0.9 * m + 0.1 * float(q[0])), 0.0),
        (lambda m, _t, q: (-2.0 * (float(q[1]) - m), float(q[1])), 0.0),
    )
    return steps[rng.integers(len(steps))]


def pure(base: Law, step: Step) -> Law:
    """With the memory in the state."""

    def update(t: float, y: Any, state: Any) -> Any:
        own, memory = state
        added, memory = step(memory, t, y.q)
        u, own = base(t, y, own)
        return u + added, (own, memory)

    return update


def _plus(added: float, answer: tuple[Any, Any]) -> tuple[Any, Any]:
    """The torques and the state of a law, with something added to the torques."""
    u, state = answer
    return u + added, state


class _Object:
    """In an object."""

    def __init__(self, base: Law, step: Step, start: Any) -> None:
        self.base, self.step, self.memory = base, step, start

    def __call__(self, t: float, y: Any, state: Any) -> Any:
        added, self.memory = self.step(self.memory, t, y.q)
        return _plus(added, self.base(t, y, state))

    def method(self, t: float, y: Any, state: Any) -> Any:
        return self(t, y, state)


def _kept(get: Callable[[], Any], put: Callable[[Any], object], base: Law, step: Step) -> Law:
    def update(t: float, y: Any, state: Any) -> Any:
        added, memory = step(get(), t, y.q)
        put(memory)
        return _plus(added, base(t, y, state))

    return update


def _nonlocal(base: Law, step: Step, memory: Any) -> Law:
    def update(t: float, y: Any, state: Any) -> Any:
        nonlocal memory
        added, memory = step(memory, t, y.q)
        return _plus(added, base(t, y, state))

    return update


def _global(base: Law, step: Step, start: Any) -> Law:
    global COUNT
    COUNT = start

    def update(t: float, y: Any, state: Any) -> Any:
        global COUNT
        added, COUNT = step(COUNT, t, y.q)
        return _plus(added, base(t, y, state))

    return update


def _beside(box: list[Any], base: Law, step: Step) -> Law:
    return _kept(lambda: box[0], lambda m: box.__setitem__(0, m), base, step)


def _list(base: Law, step: Step, start: Any) -> Law:
    return _beside([start], base, step)


def _array(base: Law, step: Step, start: Any) -> Law:
    box = np.array([start], dtype=float)
    return _kept(lambda: box[0], lambda m: box.fill(m), base, step)


def _module_dict(base: Law, step: Step, start: Any) -> Law:
    KEPT["memory"] = start
    return _kept(lambda: KEPT["memory"], lambda m: KEPT.update(memory=m), base, step)


def _globals(base: Law, step: Step, start: Any) -> Law:
    globals()["COUNT"] = start
    return _kept(lambda: globals()["COUNT"], lambda m: globals().update(COUNT=m), base, step)


def _class_attribute(base: Law, step: Step, start: Any) -> Law:
    class Kept:
        memory = start

        def __call__(self, t: float, y: Any, state: Any) -> Any:
            added, type(self).memory = step(type(self).memory, t, y.q)
            return _plus(added, base(t, y, state))

    return Kept()


def _class_list(base: Law, step: Step, start: Any) -> Law:
    class Kept:
        memory: list[Any] = [start]  # noqa: RUF012 what the study is for

        def __call__(self, t: float, y: Any, state: Any) -> Any:
            added, self.memory[0] = step(self.memory[0], t, y.q)
            return _plus(added, base(t, y, state))

    return Kept()


def _default(base: Law, step: Step, start: Any) -> Law:
    def update(t: float, y: Any, state: Any, box: list[Any] = [start]) -> Any:  # noqa: B006
        added, box[0] = step(box[0], t, y.q)
        return _plus(added, base(t, y, state))

    return update


def _attribute(base: Law, step: Step, start: Any) -> Law:
    def update(t: float, y: Any, state: Any) -> Any:
        added, update.memory = step(update.memory, t, y.q)  # type: ignore[attr-defined]
        return _plus(added, base(t, y, state))

    update.memory = start  # type: ignore[attr-defined]
    return update


def _context(base: Law, step: Step, start: Any) -> Law:
    VARIABLE.set(start)
    return _kept(VARIABLE.get, VARIABLE.set, base, step)


def _thread(base: Law, step: Step, start: Any) -> Law:
    box = [start]

    def put(memory: Any) -> None:
        one = threading.Thread(target=lambda: box.__setitem__(0, memory))
        one.start()
        one.join()

    return _kept(lambda: box[0], put, base, step)


def _local(base: Law, step: Step, start: Any) -> Law:
    box = threading.local()
    box.memory = start
    return _kept(lambda: box.memory, lambda m: setattr(box, "memory", m), base, step)


def _file(base: Law, step: Step, start: Any) -> Law:
    path = Path(tempfile.mkdtemp()) / "memory"
    path.write_text(repr(float(start)))
    return _kept(lambda: float(path.read_text()), lambda m: path.write_text(repr(float(m))), base, step)


def _generator(base: Law, step: Step, start: Any) -> Law:
    def answers() -> Any:
        memory, given = start, (yield)
        while True:
            added, memory = step(memory, *given)
            given = yield added

    one = answers()
    next(one)

    def update(t: float, y: Any, state: Any) -> Any:
        answer = base(t, y, state)
        return _plus(one.send((t, y.q)), answer)

    return update


def _in_object(base: Law, step: Step, start: Any) -> Law:
    """In a closure that an object holds, which is not copied with it."""
    holder = _Object(base, step, start)
    holder.base, holder.step = _list(base, step, start), lambda m, _t, _q: (0.0, m)
    return holder


def _with_lock(base: Law, step: Step, start: Any) -> Law:
    """In an object that cannot be copied."""
    law = _Object(base, step, start)
    law.lock = threading.Lock()  # type: ignore[attr-defined]
    return law


def _by_time(known: dict[Any, Any], key: Callable[[float, Any], Any]) -> Callable[..., Law]:
    def make(base: Law, *_: Any) -> Law:
        known.clear()

        def update(t: float, y: Any, state: Any) -> Any:
            u, state = base(t, y, state)
            return known.setdefault(key(t, y), u), state

        return update

    return make


def _cached_helper(base: Law, *_: Any) -> Law:
    @functools.cache
    def at(t: float) -> Any:
        return LATEST[0](t, *LATEST[1:])

    def update(t: float, y: Any, state: Any) -> Any:
        global LATEST
        LATEST = base, y, state
        return at(t)

    return update


def _noise(draw: Callable[[], float]) -> Callable[..., Law]:
    return lambda base, *_: lambda t, y, state: (base(t, y, state)[0] + draw(), base(t, y, state)[1])


def _rng(base: Law, *_: Any) -> Law:
    return _noise(np.random.default_rng(1).normal)(base)


def _clock(base: Law, *_: Any) -> Law:
    begin = time.perf_counter()
    return _noise(lambda: time.perf_counter() - begin)(base)


def _calls(base: Law, *_: Any) -> Law:
    return _noise(itertools.count().__next__)(base)


def _log(base: Law, *_: Any) -> Law:
    seen: list[Any] = []

    def update(t: float, y: Any, state: Any) -> Any:
        seen.append((t, y.q))
        return base(t, y, state)

    return update


def _buffer(base: Law, *_: Any) -> Law:
    """The same array each time, and arguments that are written to."""
    out = np.zeros(8)

    def update(t: float, y: Any, state: Any) -> Any:
        u, state = base(t, y, state)
        out[: len(u)] = u
        y.q[:] = np.nan
        return out[: len(u)], state

    return update


def _memo(base: Law, *_: Any) -> Law:
    """A table by all that the answer depends on."""
    known: dict[Any, Any] = {}

    def update(t: float, y: Any, state: Any) -> Any:
        key = (t, *(np.asarray(one).tobytes() for one in vars(y).values()), repr(state))
        if key not in known:
            known[key] = base(t, y, state)
        return known[key]

    return update


COPIED: dict[str, Callable[..., Law]] = {
    "object": _Object,
    "method": lambda *parts: _Object(*parts).method,
    "partial": lambda base, step, start: functools.partial(_Object.__call__, _Object(base, step, start)),
    "class": lambda *parts: functools.partial(_Object, *parts),
}
HARMLESS = {"log": _log, "buffer": _buffer, "memo": _memo}
HOLDERS: dict[str, Callable[..., Law]] = {
    **COPIED, **HARMLESS, "nonlocal": _nonlocal, "global": _global, "list": _list, "array": _array,
    "module dict": _module_dict, "globals": _globals, "class attribute": _class_attribute, "class list": _class_list,
    "default": _default, "attribute": _attribute, "context": _context, "thread": _thread, "thread-local": _local,
    "file": _file, "generator": _generator, "closure in object": _in_object, "with lock": _with_lock,
    "table by time": _by_time({}, lambda t, _: t), "table by place": _by_time({}, lambda t, y: (t, *y.q.round(4))),
    "module table": _by_time(KEPT, lambda t, _: t), "cached helper": _cached_helper, "np.random":
    _noise(np.random.normal), "random": _noise(random.random), "generator of noise": _rng, "clock": _clock,
    "calls": _calls,
}  # fmt: skip
PLAIN = {"log", "buffer", "memo", "table by time", "table by place", "module table", "cached helper"}  # no memory
