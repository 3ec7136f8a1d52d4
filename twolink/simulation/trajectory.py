"""Trajectory: what simulating a scene gives. Times, states, energy, error bar and cost; saving and loading."""

from __future__ import annotations

import functools
import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from twolink.dynamics import Robot
from twolink.dynamics.named_queries import joint_columns
from twolink.dynamics.saved_robot import find_robot, require_same, robot_notes
from twolink.errors import SceneError, ShowError
from twolink.io.tables import read_table, write_table


@dataclass(frozen=True)
class Cost:
    """What a run cost: the method, its steps and evaluations of the dynamics, and seconds of wall clock.

    tolerance: of the method, or the step [s] of one with fixed steps. seconds: solving alone; verify_seconds: the more
    accurate solutions behind the error bar; compile_seconds: compiling or loading. rejected: steps that were tried in
    vain. compiled: whether the steps were compiled ones. why: the reason for the method.
    """

    method: str
    tolerance: float
    steps: int
    evaluations: int
    seconds: float
    verify_seconds: float = 0.0
    compile_seconds: float = 0.0
    rejected: int = 0
    compiled: bool = False
    why: str = ""


@dataclass(frozen=True)
class Trajectory:
    """A motion: t (n,) [s], q (n, nq), v (n, nv), energy (n,) [J], and how far it can be trusted.

    error: the estimated global error at each sample, max |difference(q, q_exact)|, rad or m, (n,); None when the run
    was not verified. accuracy: what was asked for. events: what happened on the way. interrupted: Ctrl-C ended it
    early, samples so far are kept. precise: (q, v) at each sample (n, nq + nv) with more digits than a double has, of
    runs in higher precision. robots: the robot of each piece of a motion in which payloads are let go, and how many
    samples the piece has.
    """

    robot: Robot
    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    error: np.ndarray | None
    cost: Cost | None
    events: Sequence[Any] = field(default=())
    interrupted: bool = False
    accuracy: float | None = None
    precise: Any = None
    robots: Sequence[tuple[Robot, int]] = ()

    @functools.cached_property
    def energy(self) -> np.ndarray:
        """Kinetic and potential energy at each sample (n,), J: of a payload too, until it is let go."""
        found, first = [np.empty(0)], 0
        for robot, count in self.robots or ((self.robot, len(self.t)),):
            kinetic, potential = robot.energy(self.q[first : first + count], self.v[first : first + count])
            found.append(kinetic + potential)
            first += count
        return np.concatenate(found)

    @property
    def trusted_until(self) -> float | None:
        """The last sample's time [s] up to which the error bar is below the accuracy asked for; None: not known."""
        if self.error is None or self.accuracy is None:
            return None
        beyond = self.error > self.accuracy
        return float(self.t[max(0, int(np.argmax(beyond)) - 1)] if beyond.any() else self.t[-1])

    def columns(self) -> dict[str, np.ndarray]:
        """The samples by name: t, q.JOINT, v.JOINT (numbered where a joint has several), energy, error."""
        table = {"t": self.t}
        for name, values in (("q", self.q), ("v", self.v)):
            for (column, joint), numbers in zip(joint_columns(self.robot.joints, name), values.T, strict=True):
                if column in table:
                    what = f"two columns are named {column!r}"
                    raise SceneError(what, where=f"joint {joint!r}", remedy="rename the joint in the URDF")
                table[column] = numbers
        table["energy"] = self.energy
        if self.error is not None:
            table["error"] = self.error
        return table

    def _named(self, letter: str) -> dict[str, np.ndarray]:
        """The columns of q or v by the joint's name, without the letter."""
        columns = self.columns().items()
        return {name.removeprefix(f"{letter}."): x for name, x in columns if name.startswith(f"{letter}.")}

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the samples to .csv, .parquet or .npz; all keep every digit. Returns the path."""
        return write_table(Path(path), self.columns(), robot_notes(self.robot))

    @classmethod
    def load(cls, path: str | os.PathLike[str], robot: Robot | None = None) -> Trajectory:
        """Read a saved trajectory.

        .npz and .parquet files say which robot it is of: one from the catalogue is loaded again as it was then; any
        other must be given, and must be the same. A .csv holds the samples alone, so give its robot. Raises
        SceneError for another robot, and for what is not a trajectory.
        """
        label = str(path)
        columns, notes = read_table(Path(path))
        same = find_robot(notes, label) if robot is None else require_same(robot, notes, label)
        return cls._from_columns(columns, same, label)

    @classmethod
    def _from_columns(cls, columns: Mapping[str, np.ndarray], robot: Robot, label: str) -> Trajectory:
        table = _numbers(columns, label)
        n = len(table["t"]) if "t" in table else 0
        empty = cls(robot, np.empty(n), np.empty((n, robot.nq)), np.empty((n, robot.nv)), None, None)
        vars(empty)["energy"] = np.empty(n)  # as it was saved
        wanted = empty.columns()
        lacking = [name for name in wanted if name not in table]
        unknown = [name for name in table if name not in wanted and name != "error"]
        if lacking or unknown:
            what = f"column {lacking[0]!r} is not in it" if lacking else f"column {unknown[0]!r} is unknown"
            raise SceneError(what, where=label, remedy=f"it is not a trajectory of robot {robot.name!r}")
        for name, place in wanted.items():
            place[:] = table[name]
        if np.any(np.diff(empty.t) <= 0):
            row = int(np.argmax(np.diff(empty.t) <= 0)) + 1
            raise SceneError(f"t does not increase at sample {row}", where=label, remedy="sort its samples by time")
        run = cls(robot, empty.t, empty.q, empty.v, table.get("error"), None)
        vars(run)["energy"] = empty.energy
        return run

    def plot(self, path: str | os.PathLike[str]) -> Path:
        """Draw q, v, energy and the error bar over time into a .png, .svg or .pdf."""
        from twolink.show.trajectory_plot import plot_trajectory

        title = f"{self.robot.name}: {self.t[-1]:g} s"
        q, v = self._named("q"), self._named("v")
        return plot_trajectory(Path(path), title, self.t, q, v, self.energy, self.error)

    def playback(
        self, path: str | os.PathLike[str], *, speed: float = 1.0, on_skipped: Callable[[list[str]], None] | None = None
    ) -> Path:
        """Write a standalone page that plays the motion in 3D in any browser, offline. Returns the path.

        on_skipped: called with the names of the shapes that cannot be drawn, if any; the page names them too.
        """
        from twolink.show.playback import write_playback

        visuals = self._visuals()
        model, title = self.robot.model, self.robot.name
        return write_playback(
            model, visuals, self.t, self.q, Path(path), title=title, speed=speed, on_skipped=on_skipped
        )

    def play(
        self,
        *,
        speed: float = 1.0,
        open_browser: bool = True,
        on_url: Callable[[str], None] | None = None,
        on_skipped: Callable[[list[str]], None] | None = None,
    ) -> None:
        """Play the motion live in the browser, at true speed times `speed`; returns when it has ended.

        on_url, on_skipped: called with the page's address, and with the names of the shapes that cannot be drawn, if
        any; both are printed unless given.
        """
        from twolink.show.live import play_live

        play_live(
            self.robot.model,
            self._visuals(),
            self.t,
            self.q,
            speed=speed,
            open_browser=open_browser,
            on_url=on_url or _print_url,
            on_skipped=on_skipped or _print_skipped,
        )

    def _visuals(self) -> Any:
        """The shapes to draw. Raises ShowError with the mesh that cannot be read."""
        try:
            return self.robot.visual_model()
        except (ValueError, RuntimeError) as error:
            named = re.search(r"resource (.+)", str(error))
            what = f"the mesh {named.group(1)!r} cannot be read" if named else " ".join(str(error).split())
            remedy = "repair that file, or take it out of the URDF"
            raise ShowError(what, where=f"robot {self.robot.name!r}", remedy=remedy) from None

    def __repr__(self) -> str:
        error = "not verified" if self.error is None else f"error <= {self.error.max():.1e}"
        return f"<Trajectory of {self.robot.name!r}: {self.t[-1]:g} s, {len(self.t)} samples, {error}>"


def _print_url(url: str) -> None:
    print(f"playing at {url} (Ctrl-C ends it)", flush=True)


def _print_skipped(names: list[str]) -> None:
    print(f"not drawn: {', '.join(names)}", flush=True)


def _numbers(columns: Mapping[str, np.ndarray], label: str) -> dict[str, np.ndarray]:
    """The columns as finite floats (n,), equally long, n > 0."""
    table = {}
    for name, values in columns.items():
        if np.ndim(values) != 1 or np.asarray(values).dtype.kind not in "fiu":
            raise SceneError(f"column {name!r} is not a row of numbers", where=label, remedy="save it again")
        table[name] = np.asarray(values, dtype=float)
    lengths = {name: len(values) for name, values in table.items()}
    odd = next((name for name in lengths if lengths[name] != lengths.get("t", lengths[name])), None)
    if odd is not None:
        what = f"column {odd!r} has {lengths[odd]} samples, t has {lengths['t']}"
        raise SceneError(what, where=label, remedy="save it again")
    if not any(lengths.values()) or not all(np.isfinite(values).all() for values in table.values()):
        raise SceneError("it has no samples, or some that are not finite", where=label, remedy="save it again")
    return table
