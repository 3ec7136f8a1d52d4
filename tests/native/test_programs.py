"""Programs: the native library, NumPy and the tape agree; a column has the same bits in every width and place."""

import threading
from dataclasses import replace

import numpy as np
import pytest

from tests.native.tapes import OPERATIONS, evaluated, random_tape
from twolink.algorithms.tape import Tape
from twolink.errors import TwolinkError
from twolink.native import machine
from twolink.native.differentiation import jacobian
from twolink.native.machine import Program, assembled, trace
from twolink.native.programs import SPENT, once

COUNTS = (1, 2, 4, 5, 8, 11, 16, 100)


@pytest.mark.parametrize("seed", range(20))
def test_a_program_computes_what_its_tape_says(seed: int) -> None:
    """Random formulas of every operation, over NumPy by the tape's own list of operations."""
    tape, inputs, outputs = random_tape(seed)
    x = np.random.default_rng(seed).uniform(-2.0, 2.0, (len(inputs), 37))
    expected = evaluated(tape, inputs, outputs, x)
    found = Program(assembled(tape, inputs, outputs))(x)
    scale = 1.0 + np.abs(np.nan_to_num(expected, posinf=0.0, neginf=0.0)).max(axis=1, keepdims=True)
    finite = np.isfinite(expected)
    assert np.array_equal(finite, np.isfinite(found))
    assert (np.abs(found - expected)[finite] <= (1e-12 * np.broadcast_to(scale, found.shape))[finite]).all()


def test_every_operation_is_in_the_random_formulas() -> None:
    seen = {what for seed in range(20) for what, *_ in random_tape(seed)[0].operations}
    assert seen >= set(OPERATIONS)


@pytest.mark.parametrize("seed", range(5))
def test_a_column_has_the_same_bits_in_every_width_and_place(seed: int) -> None:
    tape, inputs, outputs = random_tape(seed)
    program = Program(assembled(tape, inputs, outputs))
    x = np.random.default_rng(seed).uniform(-2.0, 2.0, (len(inputs), 100))
    every = program(x)
    for count in COUNTS:
        np.testing.assert_array_equal(program(x[:, :count]), every[:, :count])
        np.testing.assert_array_equal(program(x[:, -count:]), every[:, -count:])
    for i in range(10):
        np.testing.assert_array_equal(program(x[:, i]), every[:, i])
    rows = np.ascontiguousarray(x.T)
    np.testing.assert_array_equal(program(rows.T, np.empty((100, program.outputs)).T), every)


def test_neighbours_change_nothing() -> None:
    """Angles beyond the reach of the polynomials, infinities and NaN leave the columns beside them as they are."""
    program = Program(trace(lambda x, xp: [xp.sin(x[0]), xp.cos(x[0]), xp.exp(x[0]) * 0.5], 1))
    angles = np.array([[0.3, -1.7, 2e6, 5.0, np.inf, 1e300, np.nan, -3.0]])
    found = program(angles)
    for i, angle in enumerate(angles[0]):
        np.testing.assert_array_equal(program(np.array([angle])), found[:, i])
    with np.errstate(invalid="ignore"):
        np.testing.assert_allclose(found[:2], [np.sin(angles[0]), np.cos(angles[0])], rtol=0, atol=4e-16)


@pytest.mark.parametrize("seed", range(8))
def test_derivatives_are_those_of_differences(seed: int) -> None:
    """On the tape, against fourth-order central differences of the tape's own values, where no kink is near."""
    tape, inputs, outputs = random_tape(seed, smooth=True)
    places, values = jacobian(tape, outputs, inputs)
    x = np.random.default_rng(seed).uniform(0.5, 1.5, (len(inputs), 5))
    dense = np.zeros((len(outputs), len(inputs), 5))
    found = evaluated(tape, inputs, values, x)
    for (row, column), value in zip(places, found, strict=True):
        dense[row, column] = value
    h = 1e-3
    for column in range(len(inputs)):
        moved = [x + k * h * np.eye(len(inputs))[:, [column]] for k in (-2, -1, 1, 2)]
        a, b, c, d = (evaluated(tape, inputs, outputs, one) for one in moved)
        expected = (8.0 * (c - b) - (d - a)) / (12.0 * h)
        np.testing.assert_allclose(dense[:, column], expected, rtol=1e-6, atol=1e-6 * (1.0 + np.abs(expected).max()))


def test_without_the_library_numpy_runs_the_same_program(monkeypatch: pytest.MonkeyPatch) -> None:
    tape, inputs, outputs = random_tape(4)
    arrays = assembled(tape, inputs, outputs)
    x = np.random.default_rng(4).uniform(-2.0, 2.0, (len(inputs), 9))
    native = Program(arrays)(x)
    monkeypatch.setattr(machine, "library", lambda: None)
    by_numpy = Program(arrays)
    assert by_numpy.handle is None
    finite = np.isfinite(native)
    np.testing.assert_allclose(by_numpy(x)[finite], native[finite], rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(by_numpy(x[:, 3]), by_numpy(x)[:, 3])


def test_a_program_takes_constants_for_its_last_inputs() -> None:
    arrays = trace(lambda x, _xp: [x[0] * x[2] + x[1] * x[3]], 4)
    found = Program(arrays, np.array([3.0, -2.0]))(np.array([[1.0, 5.0], [2.0, 7.0]]))
    np.testing.assert_array_equal(found, [[1.0 * 3.0 - 2.0 * 2.0, 5.0 * 3.0 - 7.0 * 2.0]])


def test_an_index_that_does_not_exist_is_refused() -> None:
    arrays = trace(lambda x, _xp: [x[0] + x[1]], 2)
    with pytest.raises(TwolinkError, match="an index that does not exist"):
        Program(replace(arrays, code=np.full_like(arrays.code, 65_535)))


def test_a_constant_is_not_the_operation_of_its_number() -> None:
    """1.0 / x and x1 / x are two operations, though 1.0 == 1; so are choices between them."""
    tape = Tape()
    _, one, x = (tape.variable() for _ in range(3))
    outputs = [one / x, 1.0 / x, tape.where(x, one, 2.0), tape.where(x, 1.0, 2.0), tape.where(x, 1.0, x)]
    inputs = [tape.variable(), one, x]
    found = Program(assembled(tape, inputs, outputs))(np.array([[0.0], [5.0], [4.0]]))
    np.testing.assert_array_equal(found[:, 0], [1.25, 0.25, 5.0, 1.0, 1.0])


def test_wrong_numbers_of_inputs_are_refused() -> None:
    program = Program(trace(lambda x, _xp: [x[0] + x[1]], 2))
    for shape in ((1, 3), (3,), (3, 4)):
        with pytest.raises(TwolinkError, match="a program of 2 inputs got"):
            program(np.ones(shape))
    assert program(np.ones((2, 0))).shape == (1, 0)


def test_seconds_of_programs_are_those_of_the_own_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TWOLINK_CACHE", "off")
    monkeypatch.setattr("twolink.native.programs._kept", {})
    before, waited = SPENT.seconds, threading.Event()
    other = threading.Thread(target=once, args=("another thread's", lambda: waited.wait(0.01)))
    other.start()
    other.join()
    assert SPENT.seconds == before
    once("the own", lambda: waited.wait(0.01))
    assert SPENT.seconds >= before + 0.005
