"""A solution whose contacts are located up to a time, and stepped from there; states beside that one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from twolink.contact.solver import stepper_of
from twolink.contact.stepped_solution import SteppedSolution
from twolink.contact.steps import Record
from twolink.integrate.dense_output import DenseOutput
from twolink.integrate.motion.state import Array
from twolink.integrate.solution import Impulse, Segment
from twolink.scenes import Scene

NEAR = 10.0  # of a displacement: the gaps of what counts as touching
Marks = Mapping[str, tuple[Array, ...]]  # points and vectors (n, k, 3) by name


@dataclass(frozen=True, eq=False)
class SplicedSolution:
    """Both parts; the second begins at the last time and state of the first. Its methods are those of the parts."""

    located: DenseOutput
    stepped: SteppedSolution

    @property
    def segments(self) -> tuple[Segment, ...]:
        """The smooth parts."""
        return (*self.located.segments, *self.stepped.segments)

    @property
    def t(self) -> Array:
        """Times of the samples, s."""
        return np.concatenate([self.located.t, self.stepped.t[1:]])

    @property
    def impulses(self) -> tuple[Impulse, ...]:
        """Impulses of the impacts."""
        return (*self.located.impulses, *self.stepped.impulses)

    @property
    def record(self) -> Record:
        """The record of the steps, with the largest misses of the laws."""
        return self.stepped.record

    @property
    def overlap(self) -> float:
        """The largest overlap of bodies at a sample that was stepped to, m."""
        return self.stepped.overlap

    def states(self, times: Array) -> Array:
        """The states (nq + nv, m) at times (m,)."""
        early = times <= self.located.t[-1]
        out = np.empty((self.stepped.q.shape[1] + self.stepped.v.shape[1], len(times)))
        out[:, early], out[:, ~early] = self.located.states(times[early]), self.stepped.states(times[~early])
        return out

    def accelerations_and_torques(self) -> tuple[Array, Array]:
        """Accelerations (n, nv) and applied joint torques (n, nv) at the samples."""
        parts = zip(self.located.accelerations_and_torques(), self.stepped.accelerations_and_torques(), strict=True)
        a, tau = (np.concatenate([first, second[1:]]) for first, second in parts)
        return a, tau

    def marks(self, what: Literal["contacts", "contact_slips", "wrenches_on_links"]) -> Marks:
        """As `DenseOutput.marks`, of both parts; NaN where one has none."""
        parts = self.located.marks(what), self.stepped.marks(what)
        first = len(self.located.t)
        found: dict[str, tuple[Array, ...]] = {}
        for name, vectors in {**parts[0], **parts[1]}.items():
            most = max(part[name][0].shape[1] for part in parts if name in part)
            rows = np.full((len(vectors), len(self.t), most, 3), np.nan)
            for part, place, skipped in zip(parts, (slice(first), slice(first, None)), (0, 1), strict=True):
                if name in part:
                    own = np.stack(part[name])[:, skipped:]
                    rows[:, place, : own.shape[2]] = own
            found[name] = tuple(rows)
        return found


def displaced(scene: Scene, size: float, rate: float) -> tuple[Array, Array]:
    """The start of a scene moved in a direction along which bodies that touch stay in touch.

    Parameters
    ----------
    scene : Scene
        With contacts that can be stepped.
    size : float
        By how much, rad or m.
    rate : float
        By how much the velocity is changed, of the size, 1/s.

    Returns
    -------
    q, v : ndarray (nq,), (nv,)
    """
    stepper, direction = stepper_of(scene), np.random.default_rng(0).normal(size=scene.robot.nv)
    rows = stepper.normals(scene.q, NEAR * size)
    direction -= np.linalg.pinv(rows) @ (rows @ direction)
    move = size * direction / max(float(np.abs(direction).max()), 1.0)
    local = stepper.bodies.to_local_velocity
    return stepper.bodies.moved(scene.q, move), scene.v + rate * local(scene.q, move)


Solved = DenseOutput | SteppedSolution | SplicedSolution
