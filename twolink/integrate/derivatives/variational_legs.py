"""Legs: the smooth segments of a solution, and the derivatives of its states by those at the begin of each leg.

The states come from the solution, by whatever method it was solved. Between them stand the matrices of
`variational_steps`; where the error of a matrix is not within the tolerance, its step is divided.
"""

from dataclasses import dataclass

import numpy as np

from twolink.errors import AccuracyError
from twolink.integrate.dense_output import DenseOutput
from twolink.integrate.derivatives.variational_steps import METHOD, VariationalSteps
from twolink.integrate.motion.state import Array

ROUNDS, MOST_PARTS = 10, 64  # of dividing steps
MOST_STEPS = 1_000  # more than 8 times as many as at first: dividing does not help then
SMOOTH = 3  # times that a step is divided as its error estimate says; beyond that it is beside a corner, as of a limit
NODES = 6  # of an interpolation, which is of order 12
UNEVEN = 8.0  # the largest ratio of steps between them
NEAR = 0.2  # of a step
NEARLY = 0.9  # of a step that the estimate admits


@dataclass(frozen=True)
class Leg:
    """The states x (nq + nv, m) of a segment of a solution at times t (m,), with the matrices between them.

    matrices (m - 1, 2 nv, 2 nv + p): the derivatives of each next state by the one before, and by the parameters.
    """

    steps: VariationalSteps
    t: Array
    x: Array
    matrices: Array

    def along(self, start: Array) -> Array:
        """S (m, 2 nv + p, k) at the leg's times from S at its begin; the rows of the parameters stay as they are."""
        states, count = self.steps.states, len(self.matrices)
        out = np.empty((len(self.t), *start.shape))
        out[:] = start
        # Blocks of steps, each multiplied from its own begin, all at once: a tenth of the calls.
        length = max(1, round(count**0.5))
        first = np.arange(0, count, length)
        steps = np.tile(np.eye(len(start)), (len(first) * length, 1, 1))
        steps[:count, :states] = self.matrices
        blocks = steps.reshape(len(first), length, *steps.shape[1:])
        for i in range(1, length):
            blocks[:, i] = blocks[:, i] @ blocks[:, i - 1]
        before = start
        for block, i in zip(blocks, first, strict=True):
            after = block[: count - i] @ before
            out[1 + i : 1 + i + len(after)] = after
            before = after[-1]
        return out

    def at(self, times: Array, s: Array, *, interpolating: bool = False) -> Array:
        """S (n, 2 nv, k) at times (n,) within the leg, from S (m, 2 nv + p, k) at its own times.

        interpolating: between nodes, where the space is flat, there are enough and no numbers change at them, else by
        steps from those before.
        """
        step = np.searchsorted(self.t, times, side="right") - 1
        out = s[step, : self.steps.states]
        first, even = _nodes(self.t, step)
        late = times > self.t[step]
        among = late & even & (interpolating and not self.steps.space.curved and self.steps.numbers is None)
        beside = late & ~among
        if among.any():
            slopes = self.steps.rates(self.t, self.x, np.ascontiguousarray(s.transpose(2, 1, 0))).transpose(2, 1, 0)
            out[among] = _interpolated(self.t, s[:, : self.steps.states], slopes, first[among], times[among])
        if beside.any():
            begin = step[beside]
            seeds = np.ascontiguousarray(s[begin].transpose(2, 1, 0))
            found, _ = self.steps.derivatives(self.t[begin], self.x[:, begin], times[beside], seeds)
            out[beside] = found.transpose(2, 1, 0)
        return out


def _nodes(t: Array, step: Array) -> tuple[Array, Array]:
    """The first of the nodes (n,) around steps, and whether the nodes are about evenly spaced."""
    if len(t) < NODES:
        return np.zeros(len(step), dtype=int), np.zeros(len(step), dtype=bool)
    lengths = np.lib.stride_tricks.sliding_window_view(np.diff(t), NODES - 1)
    even = UNEVEN * lengths.min(axis=1) >= lengths.max(axis=1)
    first = np.clip(step - (NODES // 2 - 1), 0, len(t) - NODES)
    return first, even[first]


def _interpolated(t: Array, values: Array, slopes: Array, first: Array, times: Array) -> Array:
    """Hermite's interpolation at times (n,): values and slopes (m, ...) at t (m,), on NODES from `first`."""
    nodes = np.lib.stride_tricks.sliding_window_view(t, NODES)
    inverse = 1.0 / (nodes[:, :, None] - nodes[:, None, :] + np.eye(NODES))  # 1 on the diagonal
    since = times[:, None] - nodes[first]
    lagrange = inverse.prod(axis=2)[first] * (since.prod(axis=1)[:, None] / since)
    square = lagrange * lagrange
    by_value = (1.0 - 2.0 * since * (inverse.sum(axis=2) - 1.0)[first]) * square
    by_slope, shape = since * square, (len(t), -1)
    flat, flat_slopes = values.reshape(shape), np.ascontiguousarray(slopes).reshape(shape)
    out = np.zeros((len(times), flat.shape[1]))
    for j in range(NODES):
        out += by_value[:, j : j + 1] * flat[first + j] + by_slope[:, j : j + 1] * flat_slopes[first + j]
    return out.reshape(len(times), *values.shape[1:])


def leg_of(steps: VariationalSteps, solution: DenseOutput, number: int, times: Array, tolerance: float) -> Leg:
    """The leg of a segment of a solution, at these times or more.

    times (m,): from the begin of the segment to its end. Raises AccuracyError where dividing has no end, code
    "sensitivities-steps".
    """
    t, x = times, solution.states_of(number, times)
    found, square = steps.matrices(t[:-1], x[:, :-1], t[1:], tolerance)
    for trial in range(ROUNDS):
        late = ~(square <= 1.0)
        if not late.any():
            return Leg(steps, t, x, found)
        parts = np.ones(len(square), dtype=int)
        wanted = np.nan_to_num(square[late], nan=np.inf) ** (0.5 / METHOD.error_order) / NEARLY
        parts[late] = np.clip(np.ceil(wanted), 2, MOST_PARTS) if trial < SMOOTH else MOST_PARTS
        if parts.sum() > MOST_STEPS + 8 * len(times) or not np.isfinite(found).all():
            break
        before = np.repeat(np.arange(len(parts)), parts)
        share = np.arange(len(before)) - np.repeat(np.cumsum(parts) - parts, parts)
        t = _at_stored(np.append(t[before] + share * (np.diff(t) / parts)[before], t[-1]), share, solution.t)
        x = np.concatenate([x[:, before], x[:, -1:]], axis=1)
        inner = np.flatnonzero(share)
        x[:, inner] = solution.states_of(number, t[inner])
        found, square, again = found[before], square[before], np.flatnonzero(late[before])
        found[again], square[again] = steps.matrices(t[again], x[:, again], t[again + 1], tolerance)
    raise too_short(float(t[int(np.argmax(~(square <= 1.0)))]))


def too_short(t: float) -> AccuracyError:
    """The error where the steps of derivatives do not get past a time [s]."""
    return AccuracyError("the sensitivities cannot be solved so accurately: their steps become too short",
                         where=f"t = {t:.6g} s", remedy="ask for less accuracy", code="sensitivities-steps",
                         t=t)  # fmt: skip


def _at_stored(t: Array, share: Array, stored: Array) -> Array:
    """Times t (m,), where those within a step are moved to stored ones near by, whose states are known."""
    inner, out = np.flatnonzero(share), t.copy()
    before = np.clip(np.searchsorted(stored, t[inner]), 1, len(stored) - 1)
    nearest = np.where(t[inner] - stored[before - 1] < stored[before] - t[inner], stored[before - 1], stored[before])
    near = np.abs(nearest - t[inner]) <= NEAR * np.minimum(np.diff(t)[inner], np.diff(t)[inner - 1])
    out[inner[near]] = nearest[near]
    return out


def leg_at(steps: VariationalSteps, solution: DenseOutput, number: int, times: Array) -> Leg:
    """The leg of a segment of another solution, at these times (m,)."""
    x = solution.states_of(number, times)
    found, _ = steps.matrices(times[:-1], x[:, :-1], times[1:], np.inf)
    return Leg(steps, times, x, found)


def with_middles(times: Array) -> Array:
    """Times (m,) and their middles, (2 m - 1,)."""
    every = np.empty(2 * len(times) - 1)
    every[::2], every[1::2] = times, 0.5 * (times[:-1] + times[1:])
    return every
