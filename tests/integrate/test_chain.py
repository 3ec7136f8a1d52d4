"""Chains: several steps in one call are the steps that single calls make."""

import itertools
import os
from collections.abc import Callable

import numpy as np
import pytest

from tests.integrate.problems import arm, random_states
from twolink.integrate.motion.scene_equations import equations_of
from twolink.integrate.motion.state import Array
from twolink.integrate.steps import chain
from twolink.integrate.steps.chain import longest_chain, take_steps
from twolink.integrate.steps.methods import METHODS
from twolink.integrate.steps.step_map import StepMap, step_map
from twolink.integrate.steps.stepping import integrate, start_state

pytest.importorskip("heyoka")
COUNT = 20
needs_chains = pytest.mark.skipif(not hasattr(os, "memfd_create"), reason="chains need Linux")


def steps_of(name: str) -> StepMap:
    return step_map(equations_of(arm()), METHODS[name], whole=True)


def at_start(steps: StepMap, worlds: int, end: float = 50.0) -> Array:
    setting = 1e-9 if steps.method.adaptive else 0.01
    return start_state(steps, random_states(steps.equations.robot, worlds), 0.0, end, setting, span=8.0)[0]


def one_by_one(steps: StepMap, state: Array, count: int = COUNT) -> Array:
    states = np.empty((count + 1, *state.shape))
    states[0] = state
    for now, new in itertools.pairwise(states):
        steps(now, new)
    return states


@needs_chains
@pytest.mark.parametrize("worlds", [1, 16])
@pytest.mark.parametrize("name", ["dop853", "rk4"])
def test_a_chain_makes_the_bits_of_single_calls(name: str, worlds: int) -> None:
    steps = steps_of(name)
    call, state = steps.call(worlds), at_start(steps, worlds)
    at_once = steps.steps_at_once(worlds)
    if at_once == 1:
        pytest.skip("this processor's vectors are too short")
    for _ in range(2):  # what an earlier chain left in the memory has no say
        states = take_steps(call, steps.rows, state, COUNT, at_once)
        assert states is not None
        assert len(states) == 1 + at_once * -(-COUNT // at_once)
        np.testing.assert_array_equal(states[: COUNT + 1], one_by_one(steps, state))


@needs_chains
def test_a_chain_ends_with_the_arrival() -> None:
    steps = steps_of("dop853")
    states = take_steps(steps.call(1), steps.rows, at_start(steps, 1, end=0.02), 100, 3)
    assert states is not None
    t = states[:, steps.rows.time, 0]
    assert (np.diff(t) > 0).all()
    assert t[-1] == 0.02


def evaluated(order: slice) -> Callable[[Array, Array], None]:
    """A step x -> x + 1 that evaluates the columns one by one in this order."""

    def call(source: Array, target: Array) -> None:
        for k in range(source.shape[1])[order]:
            target[:, k] = source[:, k] + 1.0

    return call


def at_once(source: Array, target: Array) -> None:
    target[:] = source + 1.0


@needs_chains
def test_a_map_of_another_order_is_refused() -> None:
    rows = steps_of("rk4").rows
    state = np.zeros((max(rows) + 1, 1))
    state[rows.end] = 1e9
    states = take_steps(evaluated(slice(None)), rows, state, 8, 4)
    assert states is not None
    np.testing.assert_array_equal(states[:, 0, 0], np.arange(9.0))
    assert take_steps(evaluated(slice(None, None, -1)), rows, state, 8, 4) is None
    assert take_steps(at_once, rows, state, 8, 4) is None


@needs_chains
def test_single_calls_solve_where_chains_cannot(monkeypatch: pytest.MonkeyPatch) -> None:
    times = np.linspace(0, 2, 21)
    steps = steps_of("dop853")
    expected = integrate(steps, times, 1e-9).x

    def no_memory(_count: int) -> None:
        raise OSError

    monkeypatch.setattr(chain, "_mapped_twice", no_memory)
    chain._kept.rooms.clear()
    np.testing.assert_array_equal(integrate(steps, times, 1e-9).x, expected)


@needs_chains
def test_a_child_process_leaves_its_parents_memory_alone() -> None:
    rows = steps_of("rk4").rows
    state = np.full((max(rows) + 1, 1), 7.0)
    state[rows.end] = 1e9
    take_steps(evaluated(slice(None)), rows, state, 8, 4)
    before = chain._room(2, 4, *state.shape).read.copy()
    child = os.fork()
    if not child:
        take_steps(evaluated(slice(None)), rows, state + 1.0, 8, 4)
        os._exit(0)
    assert os.waitpid(child, 0)[1] == 0
    np.testing.assert_array_equal(chain._room(2, 4, *state.shape).read, before)


def test_how_long_a_chain_may_be() -> None:
    """One world's columns must not fill a vector; a batch's must fill vectors."""
    if hasattr(os, "memfd_create"):
        assert longest_chain(1, 8) == 7
        assert longest_chain(8, 8) > 1
    assert longest_chain(1, 1) == longest_chain(1, 2) == longest_chain(12, 8) == 1
