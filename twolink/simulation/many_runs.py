"""Worlds: what simulate_many returns."""

from __future__ import annotations

import html
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from twolink.dynamics import Robot
from twolink.errors import SceneError, import_extra
from twolink.integrate.solution import Event
from twolink.io.files import path_to_write
from twolink.io.tables import write_table
from twolink.io.text import Table
from twolink.scenes import Scene
from twolink.scenes.parameters import scene_with
from twolink.show.figure import Plotted
from twolink.simulation.cost import Cost
from twolink.simulation.text import BaseResult, as_data
from twolink.simulation.trajectory import Trajectory
from twolink.simulation.trajectory_tables import EXTRA, coordinate_names

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False, repr=False)
class Worlds(BaseResult, Plotted):
    """The ends of many worlds. `len` is their number; `worlds[i]` is the run of one of them, at the samples kept.

    Parameters
    ----------
    robot : Robot
    t : float
        The end, s.
    q : ndarray (n, nq)
        The configurations at the end; NaN for a world that was lost: its step size collapsed, or its state stopped
        being finite.
    v : ndarray (n, nv)
        The velocities at the end.
    error : ndarray (n,) or None
        Bound on the global error of each world, rad or m, or an estimate of it; NaN for a lost one; None: not verified.
    accuracy : float
        The accuracy asked for, rad or m.
    steps : ndarray (n,)
        Steps of each world.
    cost : Cost
        Of all worlds together.
    samples_t : ndarray (m,)
        The times of the samples that were asked for, s.
    samples_q : ndarray (m, n, nq)
        The configurations there.
    samples_v : ndarray (m, n, nv)
        The velocities there.
    events : tuple of tuple of Event
        What happened in each world, where the scene has events. A world that an event ended has its state at that event
        in q and v, and NaN in the samples behind it. Of worlds in a batch there are none: when limits of effort are
        reached is told by `simulate`, and by sweeps that are asked for events.
    ends : ndarray (n,)
        When each world ended, s: t, or before it at an event.
    scene : Scene
        The scene that they have in common.
    start_q : ndarray (n, nq)
        The configurations at the start.
    start_v : ndarray (n, nv)
        The velocities at the start.
    parameters : mapping of str to ndarray (n,)
        The values by which the worlds differ from the scene.
    estimated : bool
        Whether errors are estimates, as those of stepped contacts are.
    """

    robot: Robot
    t: float
    q: np.ndarray
    v: np.ndarray
    error: np.ndarray | None
    accuracy: float
    steps: np.ndarray
    cost: Cost
    samples_t: np.ndarray
    samples_q: np.ndarray
    samples_v: np.ndarray
    events: tuple[tuple[Event, ...], ...]
    ends: np.ndarray
    scene: Scene
    start_q: np.ndarray
    start_v: np.ndarray
    parameters: Mapping[str, np.ndarray] = field(default_factory=dict)
    estimated: bool = False

    @property
    def bound(self) -> Literal["verified", "estimated", ""]:
        """Kind of errors, as of `Trajectory.bound`."""
        return "" if self.error is None else "estimated" if self.estimated else "verified"

    @property
    def within_accuracy(self) -> np.ndarray | None:
        """True where a world's error bar is below the accuracy asked for (n,); None where it is not verified."""
        return None if self.error is None else self.error <= self.accuracy

    def __len__(self) -> int:
        return len(self.q)

    def __iter__(self) -> Iterator[Trajectory]:
        return (self[i] for i in range(len(self)))

    def __getitem__(self, i: int) -> Trajectory:
        """The run of world i at the samples that were kept, with its error bar, to plot, play, film or save.

        Where something is released, the energy is not known (NaN).

        Raises
        ------
        IndexError
            There is no world i.
        SceneError
            No samples were kept (code "no-samples"), or the world was lost (code "lost-world").
        """
        from twolink.effects import Release  # only where it is asked for

        i = range(len(self))[i]
        remedy = f"tl.simulate(worlds.scene_of({i})) runs it alone, with its equations"
        if not len(self.samples_t):
            raise SceneError("no samples were kept", where=f"worlds[{i}]", code="no-samples",
                             remedy=f"simulate_many(..., samples_per_second=100) keeps them; {remedy}")  # fmt: skip
        if not np.isfinite(self.q[i]).all():
            raise SceneError("the world was lost", where=f"worlds[{i}]", remedy=remedy, code="lost-world")
        scene = self.scene_of(i)
        before = self.samples_t < self.ends[i]
        t, q, v = (np.concatenate([samples[before], [end]]) for samples, end in
                   ((self.samples_t, self.ends[i]), (self.samples_q[:, i], self.q[i]),
                    (self.samples_v[:, i], self.v[i])))  # fmt: skip
        error = None if self.error is None else np.full(len(t), self.error[i])
        title = f"{self.scene.title or self.robot.name}, world {i}"
        events = self.events[i] if self.events else ()
        changes = any(isinstance(effect, Release) for effect in scene.effects)  # of the robot, and so of its energy
        energy = np.full(len(t), np.nan) if changes else None
        return Trajectory(scene.robot, t, q, v, error, None, events, accuracy=self.accuracy, title=title,
                          recorded_energy=energy, scene=scene, estimated=self.estimated)  # fmt: skip

    def scene_of(self, i: int) -> Scene:
        """The scene of world i: its start and its parameters. `tl.simulate` gives its run with equations of motion."""
        i, scene = range(len(self))[i], self.scene
        values = {name: float(numbers[i]) for name, numbers in self.parameters.items()}
        own = scene_with(scene, values) if values else scene
        return Scene(own.base, self.start_q[i], self.start_v[i], own.effects, self.t, own.title)

    def varied(self) -> dict[str, np.ndarray]:
        """Values at the start that differ between the worlds (n,), by name: parameters, and coordinates as q.elbow."""
        starts = {f"{letter}.{name}": column for letter, values in (("q", self.start_q), ("v", self.start_v))
                  for name, column in zip(coordinate_names(self.robot, letter), values.T, strict=True)}  # fmt: skip
        return {name: values for name, values in {**self.parameters, **starts}.items() if np.ptp(values) > 0.0}

    def columns(self) -> dict[str, np.ndarray]:
        """One row a world: what differs at the start, end.q.JOINT, end.v.JOINT, t, error and steps."""
        ends = {f"end.{letter}.{name}": column for letter, values in (("q", self.q), ("v", self.v))
                for name, column in zip(coordinate_names(self.robot, letter), values.T, strict=True)}  # fmt: skip
        bars = {} if self.error is None else {"error": self.error}
        return {**self.varied(), **ends, "t": self.ends, **bars, "steps": self.steps}

    def to_pandas(self) -> Any:
        """The columns as a pandas.DataFrame. Raises MissingExtraError where pandas is not installed."""
        return import_extra("pandas", EXTRA).DataFrame(self.columns())

    def to_dict(self) -> dict[str, Any]:
        """The columns, the events of each world and what they have in common, for JSON; samples are left out."""
        common = {"scene": self.scene, "robot": self.robot, "duration": self.t, "accuracy": self.accuracy,
                  "bound": self.bound, "events": self.events}  # fmt: skip
        return {**as_data({**common, "cost": self.cost}), "columns": as_data(self.columns())}

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the columns, one row a world, to .csv, .parquet or .npz; all keep every digit. Returns the path."""
        return write_table(path_to_write(path), self.columns(), {"title": self.scene.title, "robot": self.robot.name})

    def _figure(self) -> Figure:
        from twolink.show.world_plots import plot_worlds

        before = self.samples_t < self.t
        t = np.append(self.samples_t[before], self.t)
        q, v = (np.concatenate([samples[before], end[None]])
                for samples, end in ((self.samples_q, self.q), (self.samples_v, self.v)))  # fmt: skip
        if len(self.samples_t):
            q[-1, self.ends < self.t] = np.nan  # of an earlier time
        title = self.scene.title or self.robot.name
        return plot_worlds(self.robot, title, t, q, v, self.varied(), self.error)

    def __repr__(self) -> str:
        met = self.within_accuracy
        state = "not verified" if met is None else f"{int(met.sum())} within {self.accuracy:g}"
        state += " by estimates" if met is not None and self.estimated else ""
        return f"<Worlds of {self.robot.name!r}: {len(self.q)} at {self.t:g} s, {state}>"

    def _repr_html_(self) -> str:
        rows = [(name, *(float(f"{share:.6g}") for share in np.nanquantile(values, [0.0, 0.5, 1.0])))
                for name, values in self.columns().items() if np.isfinite(values).any()]  # fmt: skip
        table = Table(("", "least", "median", "largest"), tuple(rows))._repr_html_()
        return f"<p>{html.escape(repr(self)[1:-1])}</p>{table}"
