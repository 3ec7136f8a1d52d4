"""Shooting: motions from several starts within a period, their derivatives, and steps that join them.

gap_i = x(T / n; x_i) - x_(i+1),   i = 1 .. n, x_(n+1) = x_1
"""

from dataclasses import dataclass

import numpy as np

from twolink.errors import AccuracyError
from twolink.integrate.state import Array
from twolink.scenes import Scene
from twolink.simulation.sensitivities import Sensitivities, sensitivities

HALVINGS = 8  # of a step that does not bring the ends nearer
RANK = 1e-7  # relative: singular values below it belong to families of periodic motions


@dataclass(frozen=True, eq=False)
class Shots:
    """The motions from n starts (n, nq + nv), each over an equal part of the period, and the gaps (n, 2 nv)."""

    starts: Array
    period: float
    motions: tuple[Sensitivities, ...]
    gaps: Array

    @property
    def size(self) -> float:
        """The largest gap, rad, m, per second."""
        return float(np.abs(self.gaps).max())

    @property
    def scale(self) -> float:
        """1, or the largest velocity where that is larger."""
        return max(1.0, *(float(np.abs(s.run.v).max(initial=0.0)) for s in self.motions))

    @property
    def matrices(self) -> list[Array]:
        """The derivatives (2 nv, 2 nv) of each end by its start."""
        return [np.concatenate([np.concatenate([part[name][-1] for name in "qv"], axis=1) for part in (s.q, s.v)])
                for s in self.motions]  # fmt: skip

    @property
    def monodromy(self) -> Array:
        """Their product, the last first."""
        product = np.eye(self.gaps.shape[1])
        for matrix in self.matrices:
            product = matrix @ product
        return product

    @property
    def monodromy_error(self) -> float:
        """Bound on its error in the 2-norm, from those of the entries of each matrix."""
        exact, off = 1.0, 1.0
        for matrix, s in zip(self.matrices, self.motions, strict=True):
            norm = float(np.linalg.norm(matrix, 2))
            exact *= norm
            off *= norm + len(matrix) * max(float(s.error[name][-1]) for name in "qv")
        return off - exact


class Shooting:
    """How starts and the period may change: the first start along directions (2 nv, k), the others along all.

    free_period: the period too.
    """

    def __init__(self, scene: Scene, directions: Array, segments: int, accuracy: float, free_period: bool) -> None:
        self.scene, self.directions, self.segments = scene, directions, segments
        self.accuracy, self.free_period = accuracy, free_period

    def first(self, period: float) -> Shots:
        """From the scene's own start, and the states that a run from there has at the ends of the parts."""
        start = np.concatenate([self.scene.q, self.scene.v])
        starts = [start]
        for _ in range(self.segments - 1):
            s = self._shoot(starts[-1], period / self.segments)
            starts.append(np.concatenate([s.run.q[-1], s.run.v[-1]]))
        return self._shots(np.array(starts), period)

    def improved(self, shots: Shots) -> Shots | None:
        """The shots after a step of Newton's method, shortened until the gaps become smaller; None where none does."""
        step = -self.inverse(shots) @ shots.gaps.ravel()
        for halving in range(HALVINGS):
            factor = 0.5**halving
            try:
                after = self._moved(shots, factor * step)
            except AccuracyError:  # too far: the motion from there cannot be followed
                continue
            if np.linalg.norm(after.gaps) < np.linalg.norm(shots.gaps):
                return after
        return None

    def inverse(self, shots: Shots) -> Array:
        """The changes of what is free (k + (n - 1) 2 nv + 1, n 2 nv) by the gaps, without a shift in time."""
        n, size = self.segments, shots.gaps.shape[1]
        whole = np.zeros((n, size, n, size))
        for i, matrix in enumerate(shots.matrices):
            whole[i, :, i] += matrix
            whole[i, :, (i + 1) % n] -= np.eye(size)
        first, rest = whole[:, :, 0].reshape(-1, size), whole[:, :, 1:].reshape(n * size, -1)
        ends = [np.concatenate([s.run.v[-1], s.run.acceleration[-1]]) / n for s in shots.motions]
        late = np.concatenate(ends)[:, None] * self.free_period
        matrix = np.concatenate([first @ self.directions, rest, late], axis=1)
        run = shots.motions[0].run
        phase = np.zeros((1, matrix.shape[1]))
        if self.free_period:
            phase[0, : self.directions.shape[1]] = np.concatenate([run.v[0], run.acceleration[0]]) @ self.directions
        return np.asarray(np.linalg.pinv(np.concatenate([matrix, phase]), rcond=RANK)[:, :-1])

    def _moved(self, shots: Shots, step: Array) -> Shots:
        """The shots from changed starts and another period."""
        nv, k = self.scene.robot.nv, self.directions.shape[1]
        changes = np.concatenate([[self.directions @ step[:k]], step[k:-1].reshape(-1, 2 * nv)])
        nq = self.scene.robot.nq
        q = self.scene.robot.integrate(shots.starts[:, :nq], changes[:, :nv])
        v = shots.starts[:, nq:] + changes[:, nv:]
        period = shots.period + float(step[-1])
        if not period > 0.1 * shots.period:
            raise AccuracyError("the period becomes 0", code="no-periodic-motion")
        return self._shots(np.concatenate([q, v], axis=1), period)

    def _shots(self, starts: Array, period: float) -> Shots:
        robot, nq = self.scene.robot, self.scene.robot.nq
        motions = tuple(self._shoot(start, period / self.segments) for start in starts)
        ends = np.array([np.concatenate([s.run.q[-1], s.run.v[-1]]) for s in motions])
        following = np.roll(starts, -1, axis=0)
        gaps = np.concatenate([robot.difference(following[:, :nq], ends[:, :nq]), (ends - following)[:, nq:]], axis=1)
        return Shots(starts, period, motions, gaps)

    def _shoot(self, start: Array, duration: float) -> Sensitivities:
        return sensitivities(self.scene_from(start, duration), ["q", "v"], duration, self.accuracy)

    def scene_from(self, start: Array, duration: float) -> Scene:
        """The scene with another start and duration."""
        scene, nq = self.scene, self.scene.robot.nq
        return Scene(scene.base, start[:nq], start[nq:], scene.effects, duration, scene.title)
