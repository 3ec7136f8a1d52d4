"""Trajectory: what simulating a scene gives. Times, states, energy, error bar and cost; saving and loading."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from twolink.dynamics import Robot, load_robot
from twolink.errors import SceneError
from twolink.files import read_table, write_table


@dataclass(frozen=True)
class Cost:
    """What a run cost: the method, its steps and evaluations of the dynamics, and seconds of wall clock.

    seconds: solving alone; verify_seconds: the second solution behind the error bar; compile_seconds: compiling.
    """

    method: str
    tolerance: float
    steps: int
    evaluations: int
    seconds: float
    verify_seconds: float = 0.0
    compile_seconds: float = 0.0


@dataclass(frozen=True)
class Trajectory:
    """A motion: t (n,) [s], q (n, nq), v (n, nv), energy (n,) [J], and how far it can be trusted.

    error: the estimated global error at each sample, max |difference(q, q_exact)|, rad or m, (n,); None when the run
    was not verified. events: what happened on the way. interrupted: Ctrl-C ended it early, samples so far are kept.
    """

    robot: Robot
    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    energy: np.ndarray
    error: np.ndarray | None
    cost: Cost | None
    events: Sequence[Any] = field(default=())
    interrupted: bool = False

    def columns(self) -> dict[str, np.ndarray]:
        """The samples by name: t, q.JOINT, v.JOINT (numbered where a joint has several), energy, error."""
        table = {"t": self.t}
        for name, values in (("q", self.q), ("v", self.v)):
            for joint in self.robot.joints:
                part = joint.q if name == "q" else joint.v
                several = part.stop - part.start > 1
                for k in range(part.start, part.stop):
                    table[f"{name}.{joint.name}" + (f".{k - part.start}" if several else "")] = values[:, k]
        table["energy"] = self.energy
        if self.error is not None:
            table["error"] = self.error
        return table

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the samples to .csv, .parquet or .npz; all keep every digit. Returns the path."""
        return write_table(Path(path), self.columns(), {"robot": self.robot.name})

    @classmethod
    def load(cls, path: str | os.PathLike[str], robot: Robot | None = None) -> Trajectory:
        """Read a saved trajectory. A robot from the catalogue is found by the name in the file (.npz, .parquet)."""
        columns, notes = read_table(Path(path))
        if robot is None:
            if "robot" not in notes:
                raise SceneError("the file does not name its robot", where=str(path), remedy="give it: robot=...")
            robot = load_robot(notes["robot"])
        return cls._from_columns(columns, robot, str(path))

    @classmethod
    def _from_columns(cls, columns: Mapping[str, np.ndarray], robot: Robot, label: str) -> Trajectory:
        n = len(columns["t"]) if "t" in columns else 0
        empty = cls(robot, np.empty(n), np.empty((n, robot.nq)), np.empty((n, robot.nv)), np.empty(n), None, None)
        wanted = empty.columns()
        lacking = [name for name in wanted if name not in columns]
        if lacking:
            raise SceneError(
                f"column {lacking[0]!r} is not in it",
                where=label,
                remedy=f"it is not a trajectory of robot {robot.name!r}",
            )
        for name, place in wanted.items():
            place[:] = columns[name]
        if n == 0 or not all(np.isfinite(place).all() for place in wanted.values()):
            raise SceneError("it has no samples, or some that are not finite", where=label, remedy="save it again")
        error = np.asarray(columns["error"]) if "error" in columns else None
        return cls(robot, empty.t, empty.q, empty.v, empty.energy, error, None)

    def plot(self, path: str | os.PathLike[str]) -> Path:
        """Draw q, v, energy and the error bar over time into a .png, .svg or .pdf."""
        from twolink.show.plots import plot_trajectory

        return plot_trajectory(self, Path(path))

    def playback(self, path: str | os.PathLike[str], *, speed: float = 1.0) -> Path:
        """Write a standalone page that plays the motion in 3D in any browser, offline."""
        from twolink.show.playback import write_playback

        visuals = self.robot.visual_model()
        return write_playback(self.robot.model, visuals, self.t, self.q, Path(path), title=self.robot.name, speed=speed)

    def play(self, *, speed: float = 1.0, open_browser: bool = True) -> None:
        """Play the motion live in the browser, at true speed times `speed`; returns when it has ended."""
        from twolink.show.live import play_live

        play_live(
            self.robot.model,
            self.robot.visual_model(),
            self.t,
            self.q,
            speed=speed,
            open_browser=open_browser,
        )

    def __repr__(self) -> str:
        error = "not verified" if self.error is None else f"error <= {self.error.max():.1e}"
        return f"<Trajectory of {self.robot.name!r}: {self.t[-1]:g} s, {len(self.t)} samples, {error}>"
