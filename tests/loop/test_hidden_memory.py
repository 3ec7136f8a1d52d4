"""What a law remembers beside its state: each solution has its own, or it is refused, by name."""

import functools
import math
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import twolink as tl
from scripts.studies.hidden_laws import COPIED, HARMLESS, HOLDERS, PLAIN, pure
from tests.loop.loops import slider
from twolink.errors import ControllerError, SceneError
from twolink.loop.plain_functions import seen

E = tl.effects
GAIN = np.array([[2.0]])
CALLS = 0


def base(t: float, y: Any, state: Any) -> Any:
    return -2.0 * y.q - 0.5 * y.v * (1.0 + 0.1 * math.sin(t)), state


def latch(memory: Any, _: float, q: np.ndarray) -> tuple[float, Any]:
    """A push for ever, once past 0.3 m."""
    memory = bool(memory or q[0] > 0.3)
    return 1.5 * memory, memory


def late(memory: Any, *_: Any) -> tuple[float, Any]:
    """A push that begins after 12 calls."""
    return 1.5 * (memory >= 12), memory + 1


def scene_of(law: Any, *, events: bool = False, **fields: Any) -> tl.Scene:
    watch = (E.Watch("far", when=E.JointReaches("rail", 50.0)),) if events else ()
    return tl.Scene(slider(), v=[1.0], effects=[E.Controller(law, period=0.05, **fields), *watch], duration=1.0)


def motion(step: Callable[..., Any], start: Any) -> tl.Trajectory:
    """With the memory as the state."""
    return tl.simulate(scene_of(pure(base, step), state=(None, start)), accuracy=1e-8)


@pytest.mark.parametrize(("step", "start", "events"), [
    (latch, False, False), (late, 0, True), pytest.param(latch, False, True, marks=pytest.mark.slow),
    pytest.param(late, 0, False, marks=pytest.mark.slow),
])  # fmt: skip
@pytest.mark.parametrize("holder", HOLDERS)
def test_hidden_memory_is_a_solutions_own_or_refused(holder: str, step: Any, start: Any, events: bool) -> None:
    scene = scene_of(HOLDERS[holder](base, step, start), events=events)
    if holder not in {*COPIED, *HARMLESS}:  # on this motion they give other answers
        with pytest.raises(SceneError) as refused:
            tl.simulate(scene, accuracy=1e-8)
        assert refused.value.code in ("controller-not-repeatable", "controller-not-copied")
        assert "class" in refused.value.remedy
        return
    run = tl.simulate(scene, accuracy=1e-8)
    meant = tl.simulate(scene_of(base), accuracy=1e-8) if holder in PLAIN else motion(step, start)
    assert np.abs(run.q - meant.q).max() <= run.error.max() + meant.error.max()


def test_worlds_and_accuracies_begin_with_the_law_as_it_was_given() -> None:
    """Only world 0 passes 0.3 m; a tighter accuracy solves anew."""
    law, v = COPIED["object"](base, latch, False), np.array([[1.0], [0.2], [0.1]])
    worlds = tl.simulate_many(scene_of(law), q=np.zeros((3, 1)), v=v, accuracy=1e-8)
    same = tl.simulate_many(scene_of(pure(base, latch), state=(None, False)), q=np.zeros((3, 1)), v=v, accuracy=1e-8)
    assert worlds.q == pytest.approx(same.q, abs=1e-12)
    assert np.abs(worlds.q[1:]).max() < 0.3
    tight = tl.simulate(scene_of(law), accuracy=1e-13)
    assert np.abs(tight.q[-1] - worlds.q[0]).max() <= tight.error[-1] + worlds.error[0]
    assert law.memory is False


def test_steps_saved_and_restored_keep_the_memory_of_objects() -> None:
    sim = tl.Simulation(scene_of(COPIED["method"](base, latch, False)), verify=True)
    sim.step(0.2)
    saved = sim.save()
    end = sim.step(0.8).q[0]
    sim.restore(saved)
    assert sim.step(0.8).q[0] == end
    sim.set_state([0.0], [1.0], 0.0)
    assert abs(sim.step(1.0).q[0] - motion(latch, False).q[-1, 0]) <= sim.error + 1e-8
    hidden = tl.Simulation(scene_of(HOLDERS["nonlocal"](base, latch, False)))
    hidden.step(0.6)
    with pytest.raises(ControllerError, match="after the motion"):
        hidden.set_state([0.0], [0.1], 0.0)


def test_controllers_keep_what_they_have_in_common() -> None:
    """A plan at 10 Hz that a faster law follows: two methods of one object."""

    class Brain:
        aim = 0.0

        def plan(self, t: float, _: Any, state: Any) -> Any:
            self.aim = math.sin(3.0 * t)
            return [0.0], state

        def follow(self, _: float, y: Any, state: Any) -> Any:
            return 4.0 * (self.aim - y.q) - 2.0 * y.v, state

    def whole(t: float, y: Any, state: Any) -> Any:
        return 4.0 * (math.sin(3.0 * (round(50.0 * t) // 5 / 10.0)) - y.q) - 2.0 * y.v, state

    brain = Brain()
    two = [E.Controller(brain.plan, period=0.1), E.Controller(brain.follow, period=0.02)]
    run = tl.simulate(tl.Scene(slider(), [0.2], effects=two), 1.0, accuracy=1e-8)
    one = tl.simulate(tl.Scene(slider(), [0.2], effects=[E.Controller(whole, period=0.02)]), 1.0, accuracy=1e-8)
    assert run.q == pytest.approx(one.q, abs=1e-12)
    cells = np.zeros(1)
    apart = [E.Controller(lambda t, _, s: (cells.fill(math.sin(3.0 * t)), ([0.0], s))[1], period=0.1),
             E.Controller(lambda _, y, s: (4.0 * (cells - y.q) - 2.0 * y.v, s), period=0.02)]  # fmt: skip
    with pytest.raises(ControllerError, match=r"effects\[1\].* after the motion"):
        tl.simulate(tl.Scene(slider(), [0.2], effects=apart), 1.0, accuracy=1e-8)


def test_a_class_makes_a_law_for_each_solution() -> None:
    class Made:
        def __init__(self, gain: float = 2.0) -> None:
            self.lock, self.gain, self.on = threading.Lock(), gain, False

        def __call__(self, _: float, y: Any, state: Any) -> Any:
            self.on = self.on or bool(y.q[0] > 0.3)
            return [1.5 * self.on - self.gain * y.q[0]], state

    def stated(_: float, y: Any, on: bool) -> Any:
        on = on or bool(y.q[0] > 0.3)
        return [1.5 * on - 2.0 * y.q[0]], on

    meant = tl.simulate(scene_of(stated, state=False), accuracy=1e-8)
    for law in (Made, functools.partial(Made, 2.0)):
        assert tl.simulate(scene_of(law), accuracy=1e-8).q == pytest.approx(meant.q, abs=1e-12)
    with pytest.raises(SceneError, match="Made and what it refers to cannot be copied"):
        tl.simulate(scene_of(Made()), accuracy=1e-8)
    with pytest.raises(SceneError, match="cannot be called") as refused:
        tl.simulate(scene_of(dict))
    assert refused.value.code == "controller-not-made"
    with pytest.raises(SceneError, match="cannot be copied") as refused:
        tl.simulate(scene_of(base, state=threading.Lock()))
    assert refused.value.code == "controller-not-copied"


def test_plain_functions_are_those_that_cannot_remember() -> None:
    def counting(_: float, __: Any, state: Any) -> Any:
        global CALLS
        CALLS += 1
        return CALLS, state

    for law in (base, lambda t, y, s: (-GAIN @ y.q + math.sin(t), s), lambda t, y, s: base(t, y, s),
                lambda t, y, s: (np.clip(GAIN @ np.sin(y.q), -1.0, np.where(y.v > t, 1.0, 2.0)), s)):  # fmt: skip
        assert seen(law, None)
    for law in (counting, lambda _, __, s: (np.random.default_rng().normal(), s),
                lambda _, __, s: (np.add(GAIN, 1.0, GAIN), s),
                lambda _, y, s: (np.clip(y.q, -1.0, 1.0, GAIN), s), lambda _, y, s: (y.q.dot(y.v, GAIN), s),
                lambda _, y, s: (np.add(*[GAIN, y.q, GAIN]), s), lambda _, __, s: (np.add.at(GAIN, 0, 1.0), s),
                lambda _, __, s: (GAIN.__setitem__(0, 1.0), s), lambda _, y, s: (np.dot(y.q, y.v, GAIN), s),
                lambda _, y, s: (np.sin(y.q, GAIN), s), lambda _, y, s: (np.sin(y.q, out=GAIN), s),
                COPIED["object"](base, latch, False), *(HOLDERS[name](base, latch, False) for name in
                ("nonlocal", "list", "default", "attribute", "generator", "clock", "random"))):  # fmt: skip
        assert not seen(law, None)
    assert not seen(base, threading.Lock())


@pytest.mark.parametrize("holder", ["class attribute", "class list", "nonlocal", "module dict", "context"])
def test_memory_that_acts_in_the_next_world_alone_is_found_in_the_first(holder: str) -> None:
    """World 0 begins beyond the latch, which changes nothing there; world 1 does not reach it."""
    scene = scene_of(HOLDERS[holder](base, latch, False))
    with pytest.raises(ControllerError, match="world 0, ") as refused:
        tl.simulate_many(scene, q=[[0.4], [0.0]], v=[[0.0], [0.1]], accuracy=1e-8)
    assert refused.value.code == "controller-not-repeatable"
