"""Stepping a scene from sample to sample, and what comes of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from twolink.contact.stepping import Record, Stepper
from twolink.integrate.joint_forces import accelerations_and_joint_torques
from twolink.integrate.solution import Piece, Progress
from twolink.integrate.state import Array

REPORT = 50  # steps


@dataclass(frozen=True, eq=False)
class SteppedSolution:
    """States at samples, and between them by interpolation.

    Parameters
    ----------
    pieces : tuple of Piece
        One: the equations without contacts.
    t : ndarray (n,)
        Times of the samples, s.
    q, v, a : ndarray (n, nq), (n, nv), (n, nv)
        Configurations, velocities, and the mean accelerations over the step before each sample.
    pressing : sequence of dict
        Of each sample by pair the points that pressed in the step before it, with their mean forces, N.
    record : Record
        What the steps were and how they obey the laws.
    overlap : float
        The largest overlap of bodies at a sample, m.
    step : float
        The longest step asked for, s.
    interrupted : bool
        Ctrl-C ended it.
    """

    pieces: tuple[Piece, ...]
    t: Array
    q: Array
    v: Array
    a: Array
    pressing: Sequence[dict[str, list[tuple[Array, Array]]]]
    record: Record
    overlap: float
    step: float
    interrupted: bool = False

    def states(self, times: Array) -> Array:
        """The states (nq + nv, m) at times (m,), interpolated between samples."""
        model = self.pieces[0].equations.robot.model
        after = np.clip(np.searchsorted(self.t, times, side="left"), 1, max(1, len(self.t) - 1))
        out = np.empty((self.q.shape[1] + self.v.shape[1], len(times)))
        for k, (i, t) in enumerate(zip(np.minimum(after, len(self.t) - 1).tolist(), times.tolist(), strict=True)):
            share = (t - self.t[i - 1]) / (self.t[i] - self.t[i - 1]) if i else 0.0
            q = pin.interpolate(model, self.q[i - 1], self.q[i], share)
            out[:, k] = np.concatenate([q, self.v[i - 1] + share * (self.v[i] - self.v[i - 1])])
        return out

    def accelerations_and_torques(self) -> tuple[Array, Array]:
        """Mean accelerations over the step before each sample (n, nv), and applied joint torques (n, nv)."""
        states = np.concatenate([self.q, self.v], axis=1).T
        return self.a, accelerations_and_joint_torques(self.pieces[0].equations, self.t, states)[1].T

    def forces_on_links(self) -> dict[str, tuple[Array, Array]]:
        """None: steps have no equations of motion."""
        return {}

    def contacts(self) -> dict[str, tuple[Array, Array]]:
        """As `DenseOutput.contacts`: points (n, k, 3) and forces (n, k, 3) by pair, means over the step before."""
        most: dict[str, int] = {}
        for found in self.pressing:
            for pair, rows in found.items():
                most[pair] = max(most.get(pair, 0), len(rows))
        out = {pair: np.full((2, len(self.t), k, 3), np.nan) for pair, k in most.items()}
        for sample, found in enumerate(self.pressing):
            for pair, rows in found.items():
                out[pair][:, sample, : len(rows)] = np.array(rows).swapaxes(0, 1)
        return {pair: (points, forces) for pair, (points, forces) in out.items()}


def solve_stepped(
    stepper: Stepper, times: Array, step: float, progress: Progress | None = None, halvings: int = 0
) -> SteppedSolution:
    """Step a scene for samples at times (n,), in steps of at most `step` [s]. Raises AccuracyError.

    Samples and breaks end a step. halvings: how often the steps between two of those are doubled in number, and one
    more: else many steps began at the same times, and an impact would fall on the same place within them.
    """
    equations, record = stepper.equations, Record()
    nq, own = equations.space.nq, stepper.bodies.own
    q, v = np.array(equations.start[:nq]), np.array(equations.start[nq : equations.moving])
    stepper.record, memory, interrupted = record, stepper.start(), False
    states, overlap = [(q, v, np.zeros_like(v))], stepper.overlap(q)[0]
    pressing: list[dict[str, list[tuple[Array, Array]]]] = [{}]
    v = own(q, v, -1.0)
    grid = np.union1d(times, equations.breaks(float(times[-1])))
    try:
        for begin, stop in zip(grid[:-1].tolist(), grid[1:].tolist(), strict=True):
            count = (max(1, int(np.ceil((stop - begin) / step - 1e-9))) + 1) * 2**halvings - 1
            h, numbers = (stop - begin) / count, equations.layout.numbers_at(0.5 * (begin + stop))
            for k in range(count):
                before, done = v, stepper.advance(begin + k * h, h, q, v, numbers, memory)
                q, v, memory = done.q, done.v, done.memory
                if progress is not None and record.steps % REPORT == 0:
                    progress(begin + k * h)
            if stop != times[len(states)]:
                continue
            pressing.append({})
            for pair, place, impulse in zip(done.pair.tolist(), done.place, done.impulse, strict=True):
                pressing[-1].setdefault(stepper.detector.names[pair], []).append((place, impulse / done.h))
            states.append((q, own(q, v), own(q, v - before) / h))
            overlap = max(overlap, stepper.overlap(q)[0])
    except KeyboardInterrupt:
        interrupted = True
    qs, vs, accelerations = (np.array(column) for column in zip(*states, strict=True))
    n = len(qs)
    return SteppedSolution((Piece(equations, float(times[0]), n),), times[:n], qs, vs, accelerations, pressing[:n],
                           record, overlap, step, interrupted)  # fmt: skip
