"""periodic_motion: a motion that repeats itself exactly, by shooting, and its Floquet multipliers.

There are several starts within a period; derivatives of the motions between them give steps that join these:

    gap_i = x(T / n; x_i) - x_(i+1),   i = 1 .. n, x_(n+1) = x_1
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np

from twolink.dynamics.arguments import Positive, instance, positive, texts, whole
from twolink.effects.inputs import SAME_TIME
from twolink.errors import AccuracyError, SceneError
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.scene_equations import equations_of, require_no_states
from twolink.integrate.motion.state import Array
from twolink.io.text import Table
from twolink.parts.design.eigenvalues import eigenvalues
from twolink.parts.design.smooth import PHASES, depends_on_time, require_repeating
from twolink.scenes import Scene
from twolink.scenes.scene import accuracy_of
from twolink.show.figure import Plotted, plot_eigenvalues
from twolink.simulation.scene_run import simulate
from twolink.simulation.sensitivities import Sensitivities, sensitivities
from twolink.simulation.sensitivity_names import wanted_of
from twolink.simulation.text import BaseResult
from twolink.simulation.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HALVINGS = 8  # of a step that does not bring the ends nearer
SHORTEST = 0.1  # of the guess: periods
RANK = 1e-7  # relative: singular values below it belong to families of periodic motions
FAMILY, ENOUGH = 1e-2, 0.1  # relative: such values near a family, along which no step is needed that leaves little
ROUNDS = 30  # of Newton's method
AT_REST = 1e3  # times the accuracy: velocities below it are none
CLOSED = 10.0  # times the accuracy, by which the ends of a period may miss each other

Kind = Literal["asymptotically stable", "neutral", "unstable", "unknown"]


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


@dataclass(frozen=True, eq=False)
class Shooting:
    """A shooting problem whose first start changes along directions (2 nv, k), and the others along all.

    period: the guess of it, s. free_period: it changes too, but does not become 0, where nothing moves.
    """

    scene: Scene
    directions: Array
    segments: int
    accuracy: float
    period: float
    free_period: bool

    def first(self) -> Shots:
        """From the scene's own start, and the states that a run from there has at the ends of the parts."""
        start = np.concatenate([self.scene.q, self.scene.v])
        starts = [start]
        for _ in range(self.segments - 1):
            s = self._shoot(starts[-1], self.period / self.segments)
            starts.append(np.concatenate([s.run.q[-1], s.run.v[-1]]))
        return self._shots(np.array(starts), self.period)

    def improved(self, shots: Shots) -> Shots | None:
        """The shots after a step of Newton's method, shortened until the gaps become smaller; None where none does."""
        trials = [(FAMILY, 1.0, ENOUGH), *((RANK, 0.5**halving, 1.0) for halving in range(HALVINGS))]
        for rank, factor, share in trials:
            step = -factor * self.inverse(shots, rank) @ shots.gaps.ravel()
            try:
                after = self._moved(shots, step)
            except (AccuracyError, SceneError):  # too far: beyond a stop, or it cannot be followed from there
                continue
            if np.linalg.norm(after.gaps) < share * np.linalg.norm(shots.gaps):
                return after
        return None

    def inverse(self, shots: Shots, rank: float = RANK) -> Array:
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
        return np.linalg.pinv(np.concatenate([matrix, phase]), rcond=rank)[:, :-1]

    def _moved(self, shots: Shots, step: Array) -> Shots:
        """The shots from changed starts and another period."""
        nv, k = self.scene.robot.nv, self.directions.shape[1]
        changes = np.concatenate([[self.directions @ step[:k]], step[k:-1].reshape(-1, 2 * nv)])
        nq = self.scene.robot.nq
        q = self.scene.robot.integrate(shots.starts[:, :nq], changes[:, :nv])
        v = shots.starts[:, nq:] + changes[:, nv:]
        period = shots.period + float(step[-1])
        if not period > SHORTEST * self.period:
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
        s = sensitivities(self.scene_from(start, duration), duration, accuracy=self.accuracy)
        if s.run.end < duration * (1.0 - SAME_TIME):
            raise AccuracyError(f"an event ends the motion at {s.run.end:.6g} s, before a period is over",
                                where="scene", remedy="leave the effect that ends it out",
                                code="no-periodic-motion")  # fmt: skip
        return s

    def scene_from(self, start: Array, duration: float) -> Scene:
        """The scene with another start and duration."""
        scene, nq = self.scene, self.scene.robot.nq
        return Scene(scene.base, start[:nq], start[nq:], scene.effects, duration, scene.title)


@dataclass(frozen=True, eq=False, repr=False)
class PeriodicMotion(BaseResult, Plotted):
    """A motion with x(T) = x(0), and how small deviations from it grow in a period: dx(T) = M dx(0).

    Parameters
    ----------
    scene : Scene
        The scene, with the start of the motion and the duration of a period.
    period, period_error : float
        T and an estimate of its error, s.
    run : Trajectory
        One period.
    residual : float
        max |x(T) - x(0)|, rad, m, per second.
    start_error : float
        An estimate of the error of the start, from the residual and the error bar of the run.
    monodromy : ndarray (2 nv, 2 nv)
        M, in the tangent space.
    error : float
        Bound on the error of M in the 2-norm: by the error bar of its entries, and what the last step of Newton's
        method has changed.
    autonomous : bool
        Whether forces do not depend on time. Then one multiplier is 1: that of a shift in time.
    """

    scene: Scene
    period: float
    period_error: float
    run: Trajectory
    residual: float
    start_error: float
    monodromy: np.ndarray
    error: float
    autonomous: bool

    @cached_property
    def _eigenvalues(self) -> tuple[np.ndarray, np.ndarray]:
        values, errors = eigenvalues(self.monodromy, self.error)
        order = np.argsort(-np.abs(values), kind="stable")
        return values[order], errors[order]

    @property
    def multipliers(self) -> np.ndarray:
        """Floquet multipliers (2 nv,), the eigenvalues of M, the largest first."""
        return self._eigenvalues[0]

    @property
    def multiplier_errors(self) -> np.ndarray:
        """Bounds on their errors (2 nv,); about the root of that of M where two coincide."""
        return self._eigenvalues[1]

    @property
    def stability(self) -> Kind:
        """Of the motion as a whole, shifts in time apart.

        "asymptotically stable": all other multipliers are inside the unit circle. "unstable": one is outside.
        "neutral": all are on it as far as their errors tell, as of conservative scenes, or 0, as of what loops close.
        "unknown": else.
        """
        sizes, errors = np.abs(self.multipliers), self.multiplier_errors
        if (sizes - errors > 1.0).any():
            return "unstable"
        if self.autonomous:
            shift = int(np.argmin(np.abs(self.multipliers - 1.0)))
            sizes, errors = np.delete(sizes, shift), np.delete(errors, shift)
        if (sizes + errors < 1.0).all():
            return "asymptotically stable"
        return "neutral" if (np.minimum(np.abs(sizes - 1.0), sizes) <= errors).all() else "unknown"

    def table(self) -> Table:
        """The multipliers: real and imaginary part, size, error."""
        rows = tuple((float(z.real), float(z.imag), float(abs(z)), float(error))
                     for z, error in zip(self.multipliers, self.multiplier_errors, strict=True))  # fmt: skip
        return Table(("real", "imaginary", "size", "error"), rows)

    def _figure(self) -> Figure:
        title = f"{self.scene.robot.name}: Floquet multipliers, period {self.period:.6g} s"
        return plot_eigenvalues(title, {"": (self.multipliers, self.multiplier_errors)}, unit_circle=True)

    def __str__(self) -> str:
        start = ", ".join(f"{x:.9g}" for x in (*self.scene.q, *self.scene.v))
        return "\n".join([
            f"{self.scene.robot.name}: {self.stability}",
            f"period {self.period:.12g} s (error about {self.period_error:.1e})",
            f"start {start} (error about {self.start_error:.1e}); the ends differ by {self.residual:.1e}",
            f"Floquet multipliers, from a monodromy matrix within {self.error:.1e}:",
            str(self.table()),
        ])  # fmt: skip

    __repr__ = __str__


def periodic_motion(
    scene: Scene, period: Positive, vary: Sequence[str] = ("q", "v"), *, segments: int = 1, accuracy: Positive = 1e-9
) -> PeriodicMotion:
    """A motion near the scene's own that repeats itself exactly, by shooting, and its Floquet multipliers.

        x(T; x0) - x0 = 0,   by Newton's method with the monodromy matrix M = dx(T)/dx0

    Parameters
    ----------
    scene : Scene
        Its start is the guess. Impacts, stick and slip may occur: `sensitivities` go on through events.
    period : float
        The guess of T, s; T itself where forces depend on time, which must repeat after it.
    vary : sequence of str
        What of the start may change: names as `sensitivities` takes them ("q", "v", "q.elbow"); nothing else does.
        With ["q"] a motion released from rest stays one.
    segments : int
        Parts of the period that begin from states of their own (multiple shooting), for unstable motions.
    accuracy : float
        Of the motion and its derivatives, as in `sensitivities`.

    Returns
    -------
    PeriodicMotion

    Raises
    ------
    SceneError
        An argument does not fit; forces depend on time and do not repeat after the period, or something happens at a
        time (code "depends-on-time").
    AccuracyError
        There is no periodic motion near (code "no-periodic-motion"); or as `sensitivities`.

    Notes
    -----
    A step is the shortest that solves the linear equations, along no shift in time. So where periodic motions form a
    family, as those of different energy do, the one near the guess is found.

    References
    ----------
    Nayfeh and Balachandran: Applied Nonlinear Dynamics, 1995, chapter 5.
    """
    period = positive(period, "period", SceneError, "such as 2.5", expected="a time above 0 s")
    equations, accuracy = equations_of(instance(scene, Scene, "scene", SceneError)), accuracy_of(accuracy)
    equations.require_motion()
    require_no_states(equations, "periodic_motion")
    for trigger in equations.switching.timed if equations.switching else ():
        if trigger.changes:
            raise SceneError(f"{trigger.name!r} happens once, at {trigger.at:g} s: no motion repeats itself",
                             where="effects", remedy="leave it out: scene.without(index)",
                             code="depends-on-time")  # fmt: skip
    autonomous = not depends_on_time(equations)
    segments = whole(segments, "segments", SceneError, "such as 4", 1, 1000)
    if not autonomous:
        require_repeating(equations, period, np.tile(equations.start[: equations.moving], (len(PHASES), 1)))
        if segments > 1:
            raise SceneError("forces depend on time, and runs begin at t = 0", argument="segments",
                             remedy="leave it at 1", code="depends-on-time")  # fmt: skip
    shooting = Shooting(scene, _directions(scene, vary), segments, accuracy, period, autonomous)
    shots, change = shooting.first(), 0.0
    for _ in range(ROUNDS):  # a round more than is needed shows what is left
        done = shots.size <= CLOSED * accuracy * shots.scale
        after = shooting.improved(shots)
        if after is not None:
            change = float(np.linalg.norm(after.monodromy - shots.monodromy, 2))
            shots = after
        if done or after is None:
            break
    if not done:
        raise AccuracyError(f"no periodic motion was found near: after {shots.period:.6g} s the ends differ by "
                            f"{shots.size:.1e}", where="start", code="no-periodic-motion", period=shots.period,
                            remedy="give a nearer guess, vary more of the start, or use more segments")  # fmt: skip
    if max(float(np.abs(s.run.v).max(initial=0.0)) for s in shots.motions) <= AT_REST * accuracy:
        raise AccuracyError("only an equilibrium was found near, where nothing moves", where="start",
                            remedy="start farther from it; with damping a motion needs a drive",
                            code="no-periodic-motion", period=shots.period, residual=shots.size)  # fmt: skip
    found = _result(shooting, shots, change)
    _require_same_forces(equations, found)
    return found


def _result(shooting: Shooting, shots: Shots, change: float) -> PeriodicMotion:
    """The motion, with what its errors may be."""
    scene = shooting.scene_from(shots.starts[0], shots.period)
    run = simulate(scene, shots.period, accuracy=shooting.accuracy) if shooting.segments > 1 else shots.motions[0].run
    bar = max(float(s.run.error.max()) for s in shots.motions if s.run.error is not None)
    moved = np.abs(shooting.inverse(shots)) @ np.full(shots.gaps.size, shots.size + bar)
    start = np.abs(shooting.directions) @ moved[: shooting.directions.shape[1]]
    return PeriodicMotion(scene, shots.period, float(moved[-1]), run, shots.size, float(start.max(initial=0.0)),
                          shots.monodromy, shots.monodromy_error + change, shooting.free_period)  # fmt: skip


def _directions(scene: Scene, vary: Sequence[str]) -> Array:
    """The directions (2 nv, k) of the start that `vary` names."""
    states, names = 2 * scene.robot.nv, texts(vary, "vary", SceneError, 'such as ["q"] or ["q.elbow", "v"]')
    if not names:
        return np.zeros((states, 0))
    try:
        wanted = wanted_of(scene, names)
    except SceneError as error:
        raise error.at("vary", SceneError, argument="vary") from None
    if wanted.variation.names:
        raise SceneError(f"{wanted.variation.names[0]!r} is not of the start", argument="vary",
                         remedy='such as ["q"] or ["q.elbow", "v"]')  # fmt: skip
    return wanted.start[:states]


def _require_same_forces(equations: Equations, found: PeriodicMotion) -> None:
    """Require a motion whose forces are the same in the next period."""
    for event in found.run.events:
        if event.kind in ("engage", "release"):
            raise AccuracyError(f"{event.what!r} begins or ceases to act at {event.t:.6g} s, once: no motion repeats "
                                "itself", where="effects", remedy="leave it out: scene.without(index)",
                                code="no-periodic-motion")  # fmt: skip
    if not found.autonomous:
        require_repeating(equations, found.period, np.hstack(found.run.at(found.period * PHASES)))
