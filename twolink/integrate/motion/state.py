"""The state x = (q, v, z) of a robot and of its effects, its rate, its manifold, and what rides along.

q moves on a manifold: a quaternion or a (cos, sin) pair has length 1, which is why q' is not v:
    angle or length    q' = v
    (cos, sin)         c' = -s w, s' = c w
    planar             (x, y)' = R(cos, sin) (vx, vy), velocities being in the moving frame
    quaternion         p' = p * (w, 0) / 2, w in the moving frame
    free-flyer         r' = R(p) v, and the quaternion's rate

z are states of effects, such as the current of a motor.

Arrays are (size,) of one state or (size, n) of many, one state a column; entries are numbers or expressions.

    x = (q, v, z, numbers)

`numbers` are constant within a smooth piece: the coefficients of the polynomial that a table of samples is there, the
slots by name, then for each lockable degree of freedom whether it is locked (1 or 0), and the friction torque on it.
They are rows of the state, so that one compiled step serves all pieces and modes.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from twolink.dynamics import Robot
from twolink.dynamics.configurations import difference_rows
from twolink.effects import Effect
from twolink.effects.inputs import Sampled, Slot, tables_of, with_pieces

Array = np.ndarray[Any, np.dtype[Any]]


class StateSpace:
    """Packs and unpacks states, and knows rates, distances and normalisation."""

    def __init__(self, robot: Robot, numbers: int = 0, states: tuple[str, ...] = ()) -> None:
        self.robot, self.states = robot, states  # the names of z
        self.nq, self.nv = robot.nq, robot.nv
        self.moving = robot.nq + robot.nv + len(states)
        self.size = self.moving + numbers  # rows behind (q, v, z) that are constant within a piece
        self.v_rows, self.z_rows = slice(self.nq, self.nq + self.nv), slice(self.nq + self.nv, self.moving)
        self.tangent = 2 * self.nv + len(states)  # rows of a change: of q in the tangent space, of v and of z
        self.curved = [j for j in robot.joints if j.kind not in ("vector", "mimic")]
        flat = [j for j in robot.joints if j.kind == "vector"]
        self._flat_q = np.concatenate([np.arange(j.q.start, j.q.stop) for j in flat] or [np.empty(0, int)])
        self._flat_v = np.concatenate([np.arange(j.v.start, j.v.stop) for j in flat] or [np.empty(0, int)])
        # Entries whose errors count as they are: angles, lengths, unit vectors; a velocity's counts by its size.
        self.absolute = np.arange(self.size) < self.nq
        # Of each joint, its rows of q and of v.
        self.joint_rows = tuple((j.q, slice(j.v.start + self.nq, j.v.stop + self.nq))
                                for j in robot.joints if j.kind != "mimic")  # fmt: skip
        turning = [j for j in flat if j.unit == "rad"]
        self.angles = np.array([j.q.start for j in turning], dtype=int)

    def rows(self, x: Array) -> tuple[Array, Array]:
        """(q, v) as arrays (n, nq), (n, nv) of states (size, n), q back on its manifold."""
        q, v = np.ascontiguousarray(x[: self.nq].T), np.ascontiguousarray(x[self.v_rows].T)
        return (self.robot.normalize(q) if self.curved else q), v

    def rate(self, q: Array, v: Array) -> Array:
        """q' (nq, ...) for q (nq, ...) and v (nv, ...)."""
        if not self.curved:
            return v
        rate = np.empty_like(q)
        rate[self._flat_q] = v[self._flat_v]
        for joint in self.curved:
            rate[joint.q] = _curved_rate(joint.kind, q[joint.q], v[joint.v])
        return rate

    def normalized(self, x: Array, xp: Any) -> Array:
        """x with its quaternions and (cos, sin) pairs scaled to length 1."""
        units = [joint.normalized for joint in self.curved if joint.normalized is not None]
        if units:
            x = x.copy()
        for unit in units:
            part = x[unit]
            x[unit] = part / xp.sqrt((part * part).sum(axis=0))
        return x

    def distance(self, q: Array, other: Array) -> Array:
        """The distance of configurations, max |difference(q, other)| over the tangent space.

        Parameters
        ----------
        q, other : ndarray (n, nq)
            Configurations on their manifold.

        Returns
        -------
        distance : ndarray (n,)
            In rad or m.

        Notes
        -----
        Angles between (cos, sin) pairs are computed here: pin.difference gives exactly 0 for many below 1e-8.
        """
        if not self.curved:
            return np.asarray(np.abs(q - other).max(axis=-1, initial=0.0))
        return np.asarray(np.abs(difference_rows(self.robot, q, other)).max(axis=-1, initial=0.0))


def _curved_rate(kind: str, q: Array, v: Array) -> Array:
    if kind == "cos-sin":
        return np.array([-q[1] * v[0], q[0] * v[0]])
    if kind == "planar":
        c, s = q[2], q[3]
        return np.array([c * v[0] - s * v[1], s * v[0] + c * v[1], -s * v[2], c * v[2]])
    if kind == "quaternion":
        return _quaternion_rate(q, v)
    return np.concatenate([_rotated(q[3:], v[:3]), _quaternion_rate(q[3:], v[3:])])


def _quaternion_rate(p: Array, w: Array) -> Array:
    x, y, z, s = p
    a, b, c = w
    return 0.5 * np.array(
        [s * a + y * c - z * b, s * b + z * a - x * c, s * c + x * b - y * a, -(x * a + y * b + z * c)]
    )


def _rotated(p: Array, u: Array) -> Array:
    """R(p) u = u + 2 s (w x u) + 2 w x (w x u), with p = (w, s)."""
    w, s = p[:3], p[3]
    once = _cross(w, u)
    return np.asarray(2.0 * (np.array([s * x for x in once]) + _cross(w, once)) + u)  # p may be jets: they lead


def _cross(a: Array, b: Array) -> Array:
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


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
