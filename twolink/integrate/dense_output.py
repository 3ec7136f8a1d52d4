"""Dense output: a solution at any time, as exact as at its samples, and the accelerations and torques at samples.

The state at a time t is computed from the last stored state before t within the same smooth segment, a sample or the
end of one of the solution's own steps, by the method of the solution. At an event, t belongs to the segment after it.
"""

import collections
import functools
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from twolink.errors import AccuracyError
from twolink.integrate.joint_forces import MARKS, accelerations_and_joint_torques
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.state import Array
from twolink.integrate.solution import Impulse, Segment
from twolink.integrate.solver import is_stepping, solve
from twolink.integrate.solvers.taylor import Precision
from twolink.integrate.steps.methods import METHODS
from twolink.integrate.steps.step_map import step_map

# A SciPy solver begins at low order and with a guessed step: between samples its tolerance is divided by this, so that
# the step from a stored state adds nothing to that state's error.
FINER_BETWEEN = 100.0


class _Group(NamedTuple):
    """Asked times (k,) of one segment: their places, and the stored states before them with their times.

    The states are (nq + nv, k), or (size, k) where the numbers behind them change from tick to tick.
    """

    segment: Segment
    places: Array
    t: Array
    stored_t: Array
    stored_x: Array


@dataclass(frozen=True, eq=False, repr=False)
class DenseOutput:
    """A solution between its samples.

    Parameters
    ----------
    segments : tuple of Segment
        The smooth parts of the solution.
    t : ndarray (n,)
        Times of the stored states, s.
    x : ndarray (nq + nv, n)
        The stored states.
    method : str
        Name of the method.
    setting : float
        The tolerance of the method, or its step, s.
    precision : {"double", "extended", "quad"}
        Of the numbers.
    impulses : tuple of Impulse
        Those of impacts at contacts.
    """

    segments: tuple[Segment, ...]
    t: Array
    x: Array
    method: str
    setting: float
    precision: Precision = "double"
    impulses: tuple[Impulse, ...] = ()

    def __repr__(self) -> str:
        """A line, as its arrays are long."""
        return (f"<DenseOutput by {self.method} at {self.setting:.2g}, {self.precision}: {len(self.segments)} parts, "
                f"{len(self.t)} states to {self.t[-1]:g} s>")  # fmt: skip

    def states(self, times: Array) -> Array:
        """The states at times within the solution.

        Parameters
        ----------
        times : ndarray (m,)
            From the first to the last stored time, in any order, s.

        Returns
        -------
        x : ndarray (nq + nv, m)

        Raises
        ------
        AccuracyError
            The method cannot reach a time; code "no-dense-output".
        """
        out = np.empty((len(self.x), len(times)))
        for group in self._groups(times):
            self._fill(group, out)
        return out

    def states_of(self, segment: int, times: Array) -> Array:
        """The states (nq + nv, m) at times (m,) from the begin of a segment to its end, where the next one begins."""
        out = np.empty((len(self.x), len(times)))
        self._fill(self._group(segment, np.arange(len(times)), times), out)
        return out

    def _fill(self, group: _Group, out: Array) -> None:
        """Write the states of a group to their places."""
        out[:, group.places] = group.stored_x[: len(out)]
        late = group.t > group.stored_t
        if late.any():
            group = _Group(group.segment, *(values[..., late] for values in group[1:]))
            taken = group.segment.taken if is_stepping(METHODS[self.method]) else None
            out[:, group.places] = self._solved(group) if taken is None else self._stepped(group, *taken)

    def accelerations_and_torques(self) -> tuple[Array, Array]:
        """Accelerations (n, nv) and applied joint torques (n, nv) at the stored times."""
        nv = self.segments[0].equations.space.nv
        a, tau = np.empty((len(self.t), nv)), np.empty((len(self.t), nv))
        for group in self._groups(self.t):
            at_group = accelerations_and_joint_torques(group.segment.equations, group.t, group.stored_x)
            a[group.places], tau[group.places] = at_group[0].T, at_group[1].T
        return a, tau

    def marks(self, what: Literal["contacts", "contact_slips", "wrenches_on_links"]) -> dict[str, tuple[Array, ...]]:
        """By name the points (n, k, 3) where something acts at some stored time, m, and vectors (n, k, 3); NaN if less.

        what: the contacts of each pair of bodies with the forces on the first, N, or with its slips on the second, m/s;
        or the forces of each effect on a link, N, with the moments about the points, N m.
        """
        found: dict[str, list[Array]] = {}
        for group in self._groups(self.t):
            count = collections.Counter[str]()
            for pair, *vectors in MARKS[what](group.segment.equations, group.t, group.stored_x):
                columns = found.setdefault(pair, [])
                if count[pair] == len(columns):
                    columns.append(np.full((len(vectors), len(self.t), 3), np.nan))
                columns[count[pair]][:, group.places] = [vector.T for vector in vectors]
                count[pair] += 1
        return {pair: tuple(np.stack(columns, axis=2)) for pair, columns in found.items()}

    def by_segment(self, times: Array) -> Iterator[tuple[Equations, Array, Array]]:
        """Of each segment that has some of the times (m,), its equations, the places of those, and its numbers then."""
        for group in self._groups(times):
            yield group.segment.equations, group.places, group.segment.numbers(group.t)

    def changes(self) -> Array:
        """Times at which numbers behind the states change, as held torques do at ticks."""
        found = [np.empty(0)]
        for segment in self.segments:
            if segment.held is not None and segment.taken is not None:
                found.append(segment.taken[0][1:][(np.diff(segment.held, axis=0) != 0.0).any(axis=1)])
        return np.concatenate(found)

    def _groups(self, times: Array) -> Iterator[_Group]:
        """The times by segments; a time at which a segment begins belongs to that segment."""
        number = np.searchsorted([segment.begin for segment in self.segments], times, side="right") - 1
        for i in np.unique(number):
            yield self._group(int(i), np.flatnonzero(number == i), times)

    def _group(self, number: int, places: Array, times: Array) -> _Group:
        """The group of the times at these places, which are all within one segment."""
        stored_t, stored_x = self._stored[number]
        before = np.searchsorted(stored_t, times[places], side="right") - 1
        segment = self.segments[number]
        x = stored_x[:, before]
        if segment.held is not None:
            x = np.append(x, segment.numbers(stored_t[before]), axis=0)
        return _Group(segment, places, times[places], stored_t[before], x)

    @functools.cached_property
    def _stored(self) -> list[tuple[Array, Array]]:
        """Of each segment, times (k,) and states (nq + nv, k): its begin, its samples, and where steps ended."""
        every, end = [], 0
        for segment in self.segments:
            inside, end = slice(end, end + segment.samples), end + segment.samples
            start = np.asarray(segment.equations.start[: len(self.x)], dtype=float)
            t, x = np.append(segment.begin, self.t[inside]), np.concatenate([start[:, None], self.x[:, inside]], axis=1)
            if segment.taken is not None:
                t, first = np.unique(np.concatenate([t, segment.taken[0]]), return_index=True)
                x = np.concatenate([x, segment.taken[1].T], axis=1)[:, first]
            every.append((t, x))
        return every

    def _stepped(self, group: _Group, ends: Array, states: Array) -> Array:
        """By a step map: each time by one step, which is a part of one that the solution took from one of `ends`."""
        equations = group.segment.equations
        x, by = equations.full(group.stored_x), step_map(equations, METHODS[self.method])
        out = by.partial(x, group.stored_t, group.t)
        lost = ~np.isfinite(out).all(axis=0)
        if lost.any():
            # A stage of a short step from beside a singular instant meets it more often than one of the run's own step.
            begin = np.searchsorted(ends, group.t[lost], side="right") - 1
            x = np.concatenate([states[begin].T, x[states.shape[1] :, lost]])
            out[:, lost] = by.partial(x, ends[begin], group.t[lost])
            lost = ~np.isfinite(out).all(axis=0)
        if lost.any():
            raise AccuracyError("the state between two samples cannot be computed",
                                where=f"t = {float(group.t[lost][0]):.6g} s",
                                remedy="simulate with more samples a second", code="no-dense-output")  # fmt: skip
        return out[: len(self.x)]

    def _solved(self, group: _Group) -> Array:
        """By a solver of single worlds: the times after each stored state at once."""
        out = np.empty((len(self.x), len(group.t)))
        method = METHODS[self.method]
        setting = self.setting / FINER_BETWEEN if method.kind == "scipy" else self.setting
        for begin in np.unique(group.stored_t):
            chosen = np.flatnonzero(group.stored_t == begin)
            grid, places = np.unique(group.t[chosen], return_inverse=True)
            whole = group.segment.equations
            equations = replace(whole, start=whole.full(group.stored_x[:, chosen[:1]])[:, 0], sampling=None)
            solution = solve(equations, method, np.append(begin, grid), setting, None, self.precision)
            out[:, chosen] = solution.x[: len(self.x), 1 + places]
        return out
