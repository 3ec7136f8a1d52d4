"""The energy balance of a run: what is stored, the work of each effect, what impacts took, and what is left over.

    stored(t) = stored(0) + sum of works(t) - lost(t),   work of an effect = integral of (tau . v + wrench . V) dt

Stored is kinetic and gravity's potential energy; springs are effects, and what they store is their work. The integrals
are Gauss's of order 12 over the run's own steps, split at samples and where the motion is not smooth.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from twolink.algorithms.motion import KinematicState
from twolink.algorithms.namespaces import Numbers
from twolink.algorithms.spatial import outward, spatial_dot
from twolink.contact.choice import choose_contact_method
from twolink.dynamics.arguments import instance
from twolink.effects.effect import Loads
from twolink.errors import AccuracyError, SceneError
from twolink.integrate.dense_output import DenseOutput
from twolink.integrate.hybrid.snapshot import Evaluator
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.formulas import effect_loads, motion_of
from twolink.integrate.motion.scene_equations import equations_of
from twolink.io.text import kebab_case
from twolink.scenes import Scene
from twolink.show.figure import Plotted, plot_lines
from twolink.simulation.sampling import duration_for
from twolink.simulation.scene_run import simulate
from twolink.simulation.text import BaseResult
from twolink.simulation.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NODES = 6  # of Gauss's quadrature between two edges
FINE = 1e-9  # rad or m
A_SECOND = 200.0  # edges, where a solver does not tell its steps


@dataclass(frozen=True, repr=False)
class EnergyBalance(BaseResult, Plotted):
    """The energy balance at the samples t (n,) [s]; all in J.

    run: the trajectory. stored (n,): kinetic and potential energy. work: of each effect since the start, by its name,
    (n,) each. lost (n,): what impacts took, and what left with what was released.
    """

    run: Trajectory
    t: np.ndarray
    stored: np.ndarray
    work: Mapping[str, np.ndarray]
    lost: np.ndarray

    @property
    def residual(self) -> np.ndarray:
        """The residual of the balance at each sample (n,), J."""
        works = sum(self.work.values(), np.zeros_like(self.stored))
        return np.asarray(self.stored - self.stored[0] - works + self.lost)

    def to_dict(self) -> dict[str, Any]:
        """The balance of the whole run for JSON, J.

        work: of each effect, by its name; stored: at the start and at the end; lost: in impacts and releases; residual:
        the largest at any sample.
        """
        return {
            "work": {name: float(work[-1]) for name, work in self.work.items()},
            "stored": [float(self.stored[0]), float(self.stored[-1])],
            "lost": float(self.lost[-1]),
            "residual": float(np.abs(self.residual).max()),
        }

    def _figure(self) -> Figure:
        lost = {"impacts and releases": -self.lost} if self.lost.any() else {}
        curves = {**self.work, **lost, "stored": self.stored - self.stored[0]}
        title = self.run.title or self.run.robot.name
        return plot_lines(title, ("t (s)", "energy since the start (J)"), self.t, curves, dashed=("stored",))

    def __str__(self) -> str:
        entries = {"stored, at first": self.stored[0], **{name: w[-1] for name, w in self.work.items()}}
        if self.lost.any():
            entries["impacts and releases"] = -self.lost[-1]
        entries["stored, at the end"] = self.stored[-1]
        width = max(map(len, entries))
        lines = [f"  {name:<{width}}  {value:+.9g} J" for name, value in entries.items()]
        return "\n".join([*lines, f"  {'residual':<{width}}  {np.abs(self.residual).max():.1e} J at most"])

    __repr__ = __str__


@dataclass(frozen=True)
class _Stretch:
    """Part of a run in one mode: its equations, states x (size, n) at times t (n,), their places among the times."""

    equations: Equations
    t: np.ndarray
    x: np.ndarray
    places: np.ndarray


def energy_book(scene: Scene, run: Trajectory | None = None) -> EnergyBalance:
    """The energy balance of a run of a scene.

    Parameters
    ----------
    scene : Scene
        The scene.
    run : Trajectory, optional
        Its run; by default one at accuracy 1e-9, or at 1e-6 where that cannot be kept.

    Returns
    -------
    EnergyBalance
        Stored energy, works and losses at the samples, J.

    Raises
    ------
    SceneError
        The run is a loaded trajectory, without equations of motion (code "no-equations"), is of another scene (code
        "other-scene"), or its contacts are stepped (code "stepped").
    """
    run = _accurate(scene) if run is None else _run_of(scene, run)
    edges = np.union1d(run.t, [event.t for event in run.events if event.t < run.t[-1]])
    edges = np.union1d(edges, equations_of(scene, ticks=True).breaks(float(run.t[-1])))
    edges = np.union1d(edges, np.concatenate([_dense(run).changes(), *_steps(run)]))
    edges = edges[(edges >= run.t[0]) & (edges <= run.t[-1])]
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    middle, half = 0.5 * (edges[1:] + edges[:-1]), 0.5 * np.diff(edges)
    inner = (middle[:, None] + half[:, None] * nodes).ravel()
    times = np.concatenate([edges[:1], inner, edges[-1:]])
    times = times[np.append(True, np.diff(times) > 0)]
    names = effect_names(scene)
    power: dict[str, np.ndarray] = {}
    for stretch in _stretches(run, times):
        for place, watts in _powers(scene, stretch):
            power.setdefault(names[place], np.zeros(len(times)))[stretch.places] += watts
    at = np.searchsorted(times, inner)
    kept = np.searchsorted(edges, run.t)
    work = {}
    for name, values in power.items():
        parts = (values[at].reshape(-1, NODES) * weights).sum(axis=1) * half
        work[name] = np.concatenate([[0.0], np.cumsum(parts)])[kept]
    lost = np.array([sum(event.energy for event in run.events if run.t[0] < event.t <= t) for t in run.t])
    return EnergyBalance(run, run.t, run.energy, work, lost)


def _steps(run: Trajectory) -> Iterator[np.ndarray]:
    """Times at which the run's steps ended, by segment, s."""
    segments = _dense(run).segments
    for segment, end in zip(segments, [*(one.begin for one in segments[1:]), run.t[-1]], strict=True):
        if segment.taken is not None:
            yield segment.taken[0]
        else:
            yield np.linspace(segment.begin, end, 2 + int(A_SECOND * (end - segment.begin)))


def loop_forces(scene: Scene, run: Trajectory) -> dict[str, np.ndarray]:
    """The multipliers of each loop's and contact's rows at the samples of a run.

    Parameters
    ----------
    scene : Scene
        The scene.
    run : Trajectory
        Its run.

    Returns
    -------
    dict of str to ndarray (n, rows)
        By the effect's name. A loop's rows are those of its equation: where they are differences of points, the
        multipliers are the force [N] on its link `a`, along the world's axes. Redundant rows have 0: rigid bodies do
        not determine their forces. A contact's are the normal force and, while it rolls or sticks, that along its
        tangents.

    Raises
    ------
    SceneError
        The run is a loaded trajectory, without equations of motion (code "no-equations"), or of another scene (code
        "other-scene").
    """
    run = _run_of(scene, run)
    names = effect_names(scene)
    tables: dict[str, np.ndarray] = {}
    for stretch in _stretches(run, run.t):
        constraints, motion = stretch.equations.constraints, _motion(stretch)
        for i, rows in enumerate(_multipliers(stretch)):
            loop = constraints.loops[i] if constraints is not None else None
            if loop is not None and (carrier := loop.carrier(motion)):
                rows[:3] = outward(motion.body(carrier), (rows[0], rows[1], rows[2]))
            width = max(len(rows), loop.max_rows if loop is not None else 0)
            name = names[stretch.equations.places[len(stretch.equations.effects) + i]]
            table = tables.setdefault(name, np.zeros((len(run.t), width)))
            table[stretch.places, : len(rows)] = rows.T
    return tables


def effect_names(scene: Scene) -> list[str]:
    """The name of each effect, numbered where there are several of a type."""
    kinds = [kebab_case(type(effect).__name__) for effect in scene.effects]
    return [f"{kind} [{i}]" if kinds.count(kind) > 1 else kind for i, kind in enumerate(kinds)]


def _accurate(scene: Scene) -> Trajectory:
    """A run of the scene, at accuracy FINE where that can be kept."""
    duration_for(scene, None)  # raises SceneError for what is no scene
    if choose_contact_method(scene).method == "stepped":
        raise _no_segments()
    try:
        return simulate(scene, accuracy=FINE)
    except AccuracyError:  # loops at singular positions, long chaotic motions
        return simulate(scene)


def _run_of(scene: Scene, run: Trajectory) -> Trajectory:
    """The run; raises SceneError for one of a scene with another robot or other effects."""
    instance(scene, Scene, "scene", SceneError)
    own = instance(run, Trajectory, "run", SceneError).scene
    if own not in (None, scene) and (own.robot.model, _content(own)) != (scene.robot.model, _content(scene)):
        raise SceneError("the run is of a scene with another robot or other effects", where="run", argument="run",
                         remedy="give the scene that was simulated: run.scene", code="other-scene")  # fmt: skip
    return run


def _content(scene: Scene) -> list[Any]:
    """The numbers of all effects. Of laws the types alone: those of a run from a pickle are other objects."""

    def kind(law: Any) -> str:
        return type(law).__qualname__

    return [(type(effect), msgspec.to_builtins(effect, enc_hook=kind)) for effect in scene.effects]


def _no_segments() -> SceneError:
    return SceneError("a run with stepped contacts has no smooth segments", where="run", argument="run",
                      remedy='a run with contact="located" has, where contacts can be', code="stepped")  # fmt: skip


def _dense(run: Trajectory) -> DenseOutput:
    """The solution of a run with equations of motion."""
    if run.solution is None:
        raise SceneError("a loaded trajectory has no equations of motion", where="run",
                         remedy="simulate it again with its scene", code="no-equations", argument="run")  # fmt: skip
    if not isinstance(run.solution, DenseOutput):
        raise _no_segments()
    return run.solution


def _stretches(run: Trajectory, times: np.ndarray) -> Iterator[_Stretch]:
    """The states of a run at other times, by its smooth segments."""
    solution = _dense(run)
    states = solution.states(times)
    for equations, places, numbers in solution.by_segment(times):
        yield _Stretch(equations, times[places], np.concatenate([states[:, places], numbers]), places)


def _multipliers(stretch: _Stretch) -> list[np.ndarray]:
    """The multipliers of each loop's rows (rows, n); 0 for redundant rows."""
    constraints = stretch.equations.constraints
    if constraints is None:
        return []
    every = constraints.all_multipliers(Evaluator(stretch.equations).by_numpy(stretch.t, stretch.x).multipliers)
    return np.split(every, np.cumsum(constraints.counts)[:-1])


def _motion(stretch: _Stretch) -> KinematicState:
    """The moving robot along a stretch."""
    return motion_of(stretch.equations, stretch.equations.mechanism, stretch.t, stretch.x, Numbers)


def _powers(scene: Scene, stretch: _Stretch) -> Iterator[tuple[int, np.ndarray]]:
    """The power of each effect that has one, W, by its place among the scene's effects."""
    equations, numbers = stretch.equations, list(stretch.x[stretch.equations.moving :])
    motion = _motion(stretch)
    for place, effect in zip(equations.places, equations.effects, strict=False):
        yield place, _power(motion, effect_loads(equations, motion, numbers, [effect]))
    switching = equations_of(scene, ticks=True).switching
    for place, lock in switching.locks if switching is not None else ():
        if lock.kinetic:
            yield place, -lock.kinetic * np.abs(motion.v[lock.dof])
    constraints = equations.constraints
    loops = equations.layout.with_numbers(constraints.loops, numbers) if constraints is not None else ()
    for i, (loop, rows) in enumerate(zip(loops, _multipliers(stretch), strict=True)):
        forces = loop.forces(motion, motion)  # of size 1: friction has power, ideal constraints have none
        if forces is not None:
            watts = sum((force * row for force, row in zip(forces, rows, strict=True)), np.zeros(len(stretch.t)))
            yield equations.places[len(equations.effects) + i], np.asarray(watts, dtype=float)


def _power(motion: KinematicState, loads: Loads) -> np.ndarray:
    """tau . v + wrench . V."""
    total = sum((tau * v for tau, v in zip(loads.tau, motion.v, strict=True)), np.zeros(1))
    for i, (x, y, z, *moment) in loads.wrenches.items():
        total = total + spatial_dot(motion.body_velocity(i), ((x, y, z), (moment[0], moment[1], moment[2])))
    return np.asarray(total, dtype=float)
