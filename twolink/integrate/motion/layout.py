"""Layout: what each row of a state is.

    x = (q, v, z, numbers)

z are the states of effects, by name. `numbers` are constant within a smooth piece: the coefficients of the polynomial
that a table of samples is there, the slots by name, then for each lockable degree of freedom whether it is locked (1
or 0), and the friction torque on it. They are rows of the state, so that one compiled step serves all pieces and
modes.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from twolink.dynamics import Robot
from twolink.effects import Effect
from twolink.effects.inputs import Sampled, Slot, tables_of, with_pieces
from twolink.integrate.motion.state import Array, StateSpace

_E = TypeVar("_E", bound=Effect)
NO_SLOTS: Mapping[str, float] = {}


@dataclass(frozen=True, eq=False)
class Layout:
    """The rows of the states of a scene.

    space: q and v, and how many rows there are. tables: what rides along as numbers, in order. lockable: degrees of
    freedom that an effect may hold at rest.
    """

    space: StateSpace
    tables: tuple[Sampled | Slot, ...]
    lockable: tuple[int, ...]

    @property
    def moving(self) -> int:
        """The number of rows of q, v and z."""
        return self.space.moving

    def numbers_at(self, t: float, slots: Mapping[str, float] = NO_SLOTS, locks: Array | None = None) -> Array:
        """The numbers of the piece at time t, (size - moving,). locks: locked (1 or 0), then friction torques."""
        if not self.tables and locks is not None:
            return locks
        parts = ([slots.get(x.name, 0.0)] if isinstance(x, Slot) else x.rows_at(t) for x in self.tables)
        return np.concatenate([np.empty(0), *parts, np.zeros(2 * len(self.lockable)) if locks is None else locks])

    def rows_of_tables(self) -> Iterator[tuple[slice, Sampled | Slot]]:
        """The rows of a state that each table has."""
        ends = itertools.accumulate((table.rows for table in self.tables), initial=self.moving)
        return zip(itertools.starmap(slice, itertools.pairwise(ends)), self.tables, strict=True)

    def rows_of_slots(self) -> dict[str, int]:
        """The row of a state that each slot is, by its name."""
        return {table.name: at.start for at, table in self.rows_of_tables() if isinstance(table, Slot)}

    def free(self, numbers: Sequence[Any]) -> list[Any]:
        """Of each degree of freedom, 0 where it is locked and 1 where not."""
        free: list[Any] = [1.0] * self.space.nv
        first = len(numbers) - 2 * len(self.lockable)
        for i, k in enumerate(self.lockable):
            free[k] = 1.0 - numbers[first + i]
        return free

    def moves(self, numbers: Array) -> Array:
        """Of each entry of (q, v, z), 0 where its joint is locked and 1 where not, (moving, n), by numbers (., n)."""
        moves = np.ones((self.moving, numbers.shape[1]))
        first = len(numbers) - 2 * len(self.lockable)
        for joint in self.space.robot.joints if self.lockable else ():
            if joint.v.start in self.lockable:
                free = 1.0 - numbers[first + self.lockable.index(joint.v.start)]
                moves[joint.q] = moves[joint.v.start + self.space.nq] = free
        return moves

    def friction(self, numbers: Sequence[Any]) -> list[tuple[int, Any]]:
        """The friction torque on each lockable degree of freedom."""
        return list(zip(self.lockable, numbers[len(numbers) - len(self.lockable) :], strict=True))

    def with_numbers(self, effects: Sequence[_E], numbers: Sequence[Any]) -> Sequence[_E]:
        """The effects with polynomials of these coefficients in place of their tables, and numbers for slots."""
        if not self.tables:
            return effects
        pieces: dict[int, Any] = {}
        at = 0
        for table in self.tables:
            pieces[id(table)] = table.piece_of(numbers[at : at + table.rows])
            at += table.rows
        return [with_pieces(effect, lambda table: pieces[id(table)]) for effect in effects]


def layout_of(robot: Robot, effects: Sequence[Effect], lockable: Sequence[int], states: tuple[str, ...] = ()) -> Layout:
    """The layout for a robot, the effects that act on it, and the names of their states."""
    tables = tuple({id(table): table for e in effects for table in tables_of(e)}.values())
    rows = sum(table.rows for table in tables) + 2 * len(lockable)
    return Layout(StateSpace(robot, rows, states), tables, tuple(lockable))
