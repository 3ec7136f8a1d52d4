"""Chains: several steps in one call of a compiled step map.

heyoka evaluates the columns of an array vector by vector, and the columns that fill no vector one by one. Each step's
columns are written here where those of the next step are read, so that one call makes several steps. From Python a
call takes 1.2 µs, three times as long as a step of a small robot. heyoka refuses arrays that overlap, and so the memory
is mapped twice, at two addresses.

heyoka does not document the order of evaluation. Therefore the counts of steps are set to NaN in all columns but those
of the start: a column that is read before it is written leaves no count in the last one, and the chain is refused.
"""

import mmap
import os
import threading

import numpy as np

from twolink.integrate.motion.state import Array
from twolink.integrate.steps.step_building import Map
from twolink.integrate.steps.step_control import Control

LONGEST = 8  # steps of a batch in one call
WORLDS = 32  # in a batch, at most: with more of them the time of a call does not count
MAX_KEPT = 16


def longest_chain(worlds: int, lanes: int) -> int:
    """How many steps of so many worlds one call can make, where whole vectors have so many lanes; 1: no chain.

    A single world's columns must be too few for a vector, and a batch's worlds must fill vectors.
    """
    if not hasattr(os, "memfd_create"):
        return 1
    if worlds == 1:
        return max(1, lanes - 1)
    return LONGEST if worlds % lanes == 0 and worlds <= WORLDS else 1


def take_steps(
    call: Map, rows: Control, state: Array, count: int, at_once: int, added: Array | None = None
) -> Array | None:
    """Attempt steps of each world.

    Parameters
    ----------
    call : Map
        The compiled step map.
    rows : Control
        The rows of the control.
    state : ndarray (rows, n)
        The state array.
    count : int
        The number of steps; up to `at_once` - 1 more are taken.
    at_once : int
        The number of steps in a call, as `longest_chain` allows.
    added : ndarray (calls, size, n), optional
        What is added to the first rows of the states before each call.

    Returns
    -------
    states : ndarray (k + 1, rows, n) or None
        From before the first step to after the last; fewer when half of the worlds have arrived. None where the map
        did not evaluate one step after the other, or the system gives no such memory.
    """
    try:
        room = _room(-(-count // at_once), at_once, *state.shape)
    except OSError:
        return None
    room.read[:, rows.accepted, state.shape[1] :] = np.nan
    last, end, calls = state, state[rows.end], 0
    first_end = float(end[0])
    for source, start, target, after in room.calls:
        start[:] = last
        if added is not None:
            start[: added.shape[1]] += added[calls]
        call(source, target)
        last, calls = after, calls + 1
        if len(end) == 1:  # most runs are of one world, and a reduction takes as long as a small step
            if after.item(rows.time, 0) >= first_end:
                break
        elif 2 * np.count_nonzero(after[rows.time] < end) < len(end):
            break
    if np.isnan(last[rows.accepted]).any():
        return None
    states = np.empty((calls * at_once + 1, *state.shape))
    states[0] = state
    states[1:].reshape(calls, at_once, *state.shape)[:] = room.written[:calls]
    if len(end) == 1:  # without the attempts after its arrival
        states = states[: 1 + np.searchsorted(states[:, rows.time, 0], first_end)]
    return states


class Room:
    """Memory for calls of a chain.

    calls: of each call what it reads, the columns of its start in that, what it writes, and the columns of its last
    step in that. read (calls, rows, columns): what all calls read. written (calls, steps, rows, n): what they write.
    """

    def __init__(self, calls: int, steps: int, rows: int, worlds: int) -> None:
        columns = steps * worlds
        first, second = (memory.reshape(calls, -1) for memory in _mapped_twice(calls * (rows * columns + worlds)))
        self.read = first[:, :-worlds].reshape(calls, rows, columns)
        written = second[:, worlds:].reshape(calls, rows, columns)
        self.calls = [(x, x[:, :worlds], y, y[:, -worlds:]) for x, y in zip(self.read, written, strict=True)]
        self.written = written.reshape(calls, rows, steps, worlds).swapaxes(1, 2)


class _Kept(threading.local):
    """The rooms of a thread by their shapes, kept from block to block."""

    def __init__(self) -> None:
        self.rooms: dict[tuple[int, ...], Room] = {}


_kept = _Kept()
if hasattr(os, "register_at_fork"):  # a child process must not write what its parent reads
    os.register_at_fork(after_in_child=lambda: _kept.rooms.clear())


def _room(*shape: int) -> Room:
    rooms = _kept.rooms
    if shape not in rooms:
        if len(rooms) >= MAX_KEPT:
            rooms.clear()
        rooms[shape] = Room(*shape)
    return rooms[shape]


def _mapped_twice(count: int) -> tuple[Array, Array]:
    """Two arrays (count,) of the same memory."""
    file = os.memfd_create("twolink-chain")
    try:
        os.ftruncate(file, 8 * count)
        first, second = (np.frombuffer(mmap.mmap(file, 8 * count), dtype=float) for _ in range(2))
    finally:
        os.close(file)
    return first, second
