"""A measured motion of a scene: positions and velocities of some joints at times, from a table or a file."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from twolink.dynamics import Robot
from twolink.dynamics.arguments import array, configuration
from twolink.errors import QueryError, require_known
from twolink.parts.identification.measurements import checked_times, table_columns
from twolink.parts.identification.units import DEGREE, Guesses, beyond_reach, check_units, in_degrees, wrong_units
from twolink.robots.joint_layout import joint_columns, read_columns
from twolink.simulation.trajectory_tables import coordinate_names

# By the ratio of what was measured to the scene's.
GUESSES: Guesses = {
    1 / DEGREE: ("is it in degrees?", "", DEGREE),
    DEGREE: ("are the scene's angles in degrees?", "", None),
    1e3: ("is it in millimetres?", "", 1e-3),
}
_ALIKE = 0.9  # correlation with the scene's motion from which a ratio of sizes tells units


@dataclass(frozen=True)
class MeasuredMotion:
    """Samples at times t (n,), which count from the start of the scene.

    q (n, nq), v (n, nv): neutral and 0 where a joint was not measured. of_q, of_v: the degrees of freedom whose
    positions and velocities were. channels: their names, positions first.
    """

    robot: Robot
    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    of_q: np.ndarray
    of_v: np.ndarray

    @property
    def channels(self) -> tuple[str, ...]:
        """The names q.JOINT and v.JOINT of what was measured, a number behind those of several degrees of freedom."""
        names = coordinate_names(self.robot, "v")
        return (*(f"q.{names[k]}" for k in self.of_q), *(f"v.{names[k]}" for k in self.of_v))

    @property
    def values(self) -> np.ndarray:
        """The measured values (n, c), positions from the neutral one on."""
        return self._taken(self.robot.difference(self.robot.neutral, self.q), self.v)

    def _taken(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """The channels (n, c) of q, v (n, nv)."""
        return np.hstack([q[:, self.of_q], v[:, self.of_v]])

    def residuals(self, q: np.ndarray, v: np.ndarray, rows: slice) -> np.ndarray:
        """Measured minus simulated (m, c) at some samples, positions in the tangent space."""
        return self._taken(self.robot.difference(q, self.q[rows]), self.v[rows] - v)

    def derivatives(self, q: np.ndarray, by: np.ndarray, rows: slice) -> np.ndarray:
        """Derivatives (m, c, k) of what is simulated there, of derivatives (m, 2 nv, k) of its state."""
        nv = self.robot.nv
        of_q = by[:, :nv]
        if any(joint.v.stop - joint.v.start > 1 for joint in self.robot.joints):
            model = self.robot.model
            first = [pin.dDifference(model, *pair, pin.ARG0) for pair in zip(q, self.q[rows], strict=True)]
            of_q = -np.stack(first) @ of_q
        return np.concatenate([of_q[:, self.of_q], by[:, nv:][:, self.of_v]], axis=1)

    def require_units(self, q: np.ndarray, v: np.ndarray) -> None:
        """Refuse a channel that is a multiple of the scene's own motion q, v. Raises QueryError (code "units")."""
        pairs = ((self.robot.difference(x[:1], x), y) for x, y in ((q, v), (self.q, self.v)))
        ours, theirs = ((x - x.mean(axis=0)).T for x in (self._taken(*pair) for pair in pairs))
        for name, x, y in zip(self.channels, ours, theirs, strict=True):
            sizes = float(np.linalg.norm(x)), float(np.linalg.norm(y))
            ratio = sizes[1] / max(sizes[0], 1e-300)
            guess = any(abs(np.log(max(ratio, 1e-300) / scale)) < 0.5 for scale in GUESSES)
            if guess and x @ y > _ALIKE * sizes[0] * sizes[1]:
                raise wrong_units(f"{name} moves {ratio:.4g} times as far as in the scene", "measurements", ratio, name,
                                  GUESSES)  # fmt: skip
        self._require_same_start(q[0])

    def _require_same_start(self, q: np.ndarray) -> None:
        """Refuse angles whose first are the scene's q (nq,) in degrees. Raises QueryError (code "units")."""
        for joint in self.robot.joints:
            given, ours = float(self.q[0, joint.q.start]), float(q[joint.q.start])
            if joint.kind == "vector" and joint.unit == "rad" and joint.v.start in self.of_q:
                apart = abs(given - ours)
                if apart > 0.1 and abs(given * DEGREE - ours) < 1e-2 * apart:
                    why = f"from {given:.4g} on, and the scene's from {ours:.4g} rad on"
                    raise in_degrees(self.robot, self.q, joint, why)


def measured_motion(robot: Robot, measurements: Any) -> MeasuredMotion:
    """Read and check a measured motion.

    Parameters
    ----------
    robot : Robot
    measurements : mapping, DataFrame, str or path
        Columns t (s, from the scene's start), q.JOINT and v.JOINT (q.JOINT.0, ... where a joint has several
        coordinates; a continuous joint also its angle), or whole arrays t (n,), q (n, nq), v (n, nv); or a .csv,
        .parquet or .npz file of them. Joints may be missing. Other columns are left.

    Raises
    ------
    QueryError
        A column is missing or unknown (code "column-missing"), values are not finite; codes "times", "constant-data",
        "units".
    TwolinkError
        The file cannot be read.
    """
    content = table_columns(measurements)
    if "t" not in content:
        raise _missing("t", content)
    t = checked_times(content["t"])
    if t[0] < 0:
        raise QueryError(f"t[0] = {t[0]:.9g} s is before the scene's start", argument="measurements", code="times",
                         remedy="count t from the start of the scene, which is 0")  # fmt: skip
    q, of_q = _read(robot, content, "q", len(t))
    v, of_v = _read(robot, content, "v", len(t))
    if not of_q.size and not of_v.size:
        raise _missing(f"q.{robot.joint_names[0]}", content)
    if np.ptp(q, axis=0).max() == 0.0 and np.ptp(v, axis=0).max() == 0.0:
        raise QueryError("nothing moves: all samples are the same", argument="measurements", code="constant-data",
                         remedy="measure a motion")  # fmt: skip
    check_units(robot, t, q, v)
    if found := beyond_reach(robot, t, q):
        raise in_degrees(robot, q, *found)
    return MeasuredMotion(robot, t, q, v, of_q, of_v)


def _read(robot: Robot, content: Mapping[str, np.ndarray], letter: str, count: int) -> tuple[np.ndarray, np.ndarray]:
    """The values (n, nq or nv) of q or v, and the degrees of freedom (c,) that were measured."""
    of_q = letter == "q"
    size = robot.nq if of_q else robot.nv
    for name in content:
        if name.startswith(f"{letter}."):
            known = [*(column for column, _ in joint_columns(robot.joints, letter)),
                     *(f"{letter}.{joint.name}" for joint in robot.joints)]  # fmt: skip
            require_known(name, known, QueryError, "there is no column {!r}", argument="measurements",
                          code="column-missing")  # fmt: skip
    table = {name: _column(name, values, count) if name != letter else values for name, values in content.items()
             if name.partition(".")[0] == letter or (name[:1] == letter and name[1:].isdigit())}  # fmt: skip
    whole, lacking = read_columns(table, robot.joints, letter)
    if lacking and f"{letter}0" in table:
        raise _missing(lacking[0], content)
    out = np.tile(robot.neutral if of_q else np.zeros(size), (count, 1)) if whole is None else whole
    dofs = list(range(robot.nv)) if whole is not None else []
    for joint in robot.joints if whole is None else ():
        own, lacking = read_columns(table, [joint], letter)
        part = joint.q if of_q else joint.v
        if own is not None:
            out[:, part] = own
            dofs += range(joint.v.start, joint.v.stop)
        elif len(lacking) < part.stop - part.start:
            raise _missing(lacking[0], content)
    checked = configuration("q", out, size, robot.joints) if of_q else array("v", out, size)
    if checked.shape != (count, size):
        raise QueryError(f"expected shape ({count}, {size}), got {checked.shape}", argument=letter,
                         remedy="give one row for each of the times t")  # fmt: skip
    return checked, np.array(dofs, dtype=int)


def _column(name: str, given: np.ndarray, count: int) -> np.ndarray:
    values = array(name, given, None)
    if values.shape != (count,):
        raise QueryError(f"expected {count} values, one for each time, got shape {values.shape}", argument=name,
                         remedy="give one for each of the times t")  # fmt: skip
    return values


def _missing(column: str, content: Mapping[str, np.ndarray]) -> QueryError:
    what = f"column {column!r} is missing; there are {', '.join(list(content)[:12]) or 'none'}"
    return QueryError(what, argument="measurements", code="column-missing",
                      remedy="name the columns t, q.JOINT and v.JOINT, or q0, q1, ... and v0, ...")  # fmt: skip
