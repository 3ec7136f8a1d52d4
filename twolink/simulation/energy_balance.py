"""The energy book of a scene: what is stored, the work of each effect, what impacts took, and whether it adds up.

    stored(t) = stored(0) + sum of works(t) - lost(t),   work of an effect = integral of (tau . v + wrench . V) dt

Stored is kinetic and gravity's potential energy; springs are effects, and what they store is their work. The integrals
are Gauss's of order 12 between samples, split where the motion is not smooth, from states of a run of their own.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from twolink.algorithms.spatial import spatial_dot
from twolink.effects import Effect
from twolink.effects.dry_friction import DryFriction
from twolink.effects.motion import Loads, Motion
from twolink.effects.plane_contact import Touching
from twolink.effects.release import Release
from twolink.errors import SceneError
from twolink.integrate.hybrid.snapshot import Moment
from twolink.integrate.methods import METHODS
from twolink.integrate.scene_equations import equations_of
from twolink.integrate.solver import solve
from twolink.io.text import kebab_case
from twolink.scenes import Scene
from twolink.simulation.scene_run import simulate
from twolink.simulation.trajectory import Trajectory

NODES = 6  # of Gauss's quadrature between two samples


@dataclass(frozen=True)
class Book:
    """The energy book at the samples t (n,) [s]; all in J.

    run: the trajectory. stored (n,): kinetic and potential energy. work: of each effect since the start, by its name,
    (n,) each. lost (n,): what impacts took, and what left with what was let go.
    """

    run: Trajectory
    t: np.ndarray
    stored: np.ndarray
    work: Mapping[str, np.ndarray]
    lost: np.ndarray

    @property
    def residual(self) -> np.ndarray:
        """What does not add up at each sample (n,), J."""
        works = sum(self.work.values(), np.zeros_like(self.stored))
        return np.asarray(self.stored - self.stored[0] - works + self.lost)

    def __str__(self) -> str:
        entries = {"stored, at first": self.stored[0], **{name: w[-1] for name, w in self.work.items()}}
        if self.lost.any():
            entries["impacts and releases"] = -self.lost[-1]
        entries["stored, at the end"] = self.stored[-1]
        width = max(map(len, entries))
        lines = [f"  {name:<{width}}  {value:+.9g} J" for name, value in entries.items()]
        return "\n".join([*lines, f"  {'does not add up':<{width}}  {np.abs(self.residual).max():.1e} J at most"])


def energy_book(scene: Scene, run: Trajectory | None = None) -> Book:
    """The energy book of a run of a scene; of one at accuracy 1e-9 unless given. Solves it once more."""
    run = simulate(scene, accuracy=1e-9) if run is None else run
    edges = np.union1d(run.t, [event.t for event in run.events if event.t < run.t[-1]])
    edges = np.union1d(edges, equations_of(scene).breaks(float(run.t[-1])))
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    middle, half = 0.5 * (edges[1:] + edges[:-1]), 0.5 * np.diff(edges)
    inner = (middle[:, None] + half[:, None] * nodes).ravel()
    times = np.concatenate([edges[:1], inner, edges[-1:]])
    times = times[np.append(True, np.diff(times) > 0)]
    names = _named(scene)
    power: dict[str, np.ndarray] = {}
    for moment, place in moments(scene, run, times):
        for effect, value in _powers(scene, moment):
            power.setdefault(names[id(effect)], np.zeros(len(times)))[place] += value
    at = np.searchsorted(times, inner)
    kept = np.searchsorted(edges, run.t)
    work = {}
    for name, values in power.items():
        parts = (values[at].reshape(-1, NODES) * weights).sum(axis=1) * half
        work[name] = np.concatenate([[0.0], np.cumsum(parts)])[kept]
    lost = np.array([sum(e.energy for e in run.events if e.t < t) for t in run.t])
    return Book(run, run.t, run.energy, work, lost)


def loop_forces(scene: Scene, run: Trajectory) -> dict[str, np.ndarray]:
    """The multipliers of each loop's and contact's rows at the samples of a run, by the effect's name: (n, rows).

    A loop's rows are those of its equation: where they are differences of points, the multipliers are the force [N]
    on its link `a`, along the world's axes. Rows that say what others say already have 0: rigid bodies do not
    determine their forces. A contact's are the normal force and, while it rolls or sticks, that along its tangents.
    """
    names = _named(scene)
    found: dict[str, np.ndarray] = {}
    for moment, place in moments(scene, run, run.t):
        loops = moment.equations.constraints
        for loop in loops.loops if loops is not None else ():
            rows = moment.multipliers[id(loop)]
            name = names[id(loop.contact if isinstance(loop, Touching) else loop)]
            table = found.setdefault(name, np.zeros((len(run.t), 3 if isinstance(loop, Touching) else len(rows))))
            table[place, : len(rows)] = np.array(rows).T
    return found


def moments(scene: Scene, run: Trajectory, times: np.ndarray) -> Iterator[tuple[Moment, slice]]:
    """The states of a run at other times, by pieces: with the equations of each, and their place among the times."""
    if run.cost is None:
        raise SceneError("the run does not say how it was solved", where="run", remedy="simulate it again")
    whole = equations_of(scene)
    solution = solve(whole, METHODS[run.cost.method], times, run.cost.tolerance)
    first = 0
    for piece in solution.pieces:
        equations, count = piece.equations, piece.samples
        place = slice(first, first + count)
        rows = np.repeat(equations.start[equations.moving :, None], count, axis=1)
        yield Moment(equations, solution.t[place], np.concatenate([solution.x[:, place], rows])), place
        first += count


def _named(scene: Scene) -> dict[int, str]:
    """The name of each effect by its id, numbered where there are several of a type; also of what a release holds."""
    kinds = [kebab_case(type(effect).__name__) for effect in scene.effects]
    names: dict[int, str] = {}
    for i, (effect, kind) in enumerate(zip(scene.effects, kinds, strict=True)):
        names[id(effect)] = f"{kind} [{i}]" if kinds.count(kind) > 1 else kind
        if isinstance(effect, Release):
            names[id(effect.of)] = names[id(effect)]
    return names


def _powers(scene: Scene, moment: Moment) -> Iterator[tuple[Effect, np.ndarray]]:
    """The power of each effect that has one, W."""
    equations, motion = moment.equations, moment.motion
    for effect in equations.effects:
        (now,) = equations.layout.with_numbers([effect], list(moment.x[equations.moving :]))
        loads = Loads(motion)
        now.act(motion, loads)
        yield effect, _power(motion, loads)
    for effect in scene.effects:
        if isinstance(effect, DryFriction):
            levels = effect.levels(scene.robot).items()
            yield effect, -sum((kinetic * np.abs(moment.v[k]) for k, (_, kinetic) in levels), np.zeros(1))
    for loop in equations.constraints.loops if equations.constraints is not None else ():
        if isinstance(loop, Touching):
            yield loop.contact, _rubbing(moment, loop)


def _power(motion: Motion, loads: Loads) -> np.ndarray:
    """tau . v + wrench . V."""
    total = sum((tau * v for tau, v in zip(loads.tau, motion.v, strict=True)), np.zeros(1))
    for i, (x, y, z, *moment) in loads.wrenches.items():
        total = total + spatial_dot(motion.body_velocity(i), ((x, y, z), (moment[0], moment[1], moment[2])))
    return np.asarray(total, dtype=float)


def _rubbing(moment: Moment, loop: Touching) -> np.ndarray:
    """-mu N |c| of a contact that slides."""
    if loop.rolling:
        return np.zeros(1)
    slip = loop.contact.slip(moment.motion)
    along = [sum(a * b for a, b in zip(tangent, slip, strict=True)) for tangent in loop.contact.tangents()]
    return np.asarray(-loop.contact.friction * moment.multipliers[id(loop)][0] * np.hypot(*along), dtype=float)
