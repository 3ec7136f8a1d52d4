"""Changes of coordinates q = T x + c, between the angles x of equations that somebody derived and those of a robot."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from twolink.dynamics import Robot
from twolink.dynamics.arguments import array
from twolink.dynamics.queries import Array
from twolink.errors import QueryError, require_known

WORDS = {"absolute": "absolute angles", "hanging": "angles from the downward vertical",
         "upright": "angles from the upward vertical"}  # fmt: skip
NAMES = ("own", "absolute", "vertical", "hanging", "upright")
_QUARTER = np.pi / 2
_TILT = 1e-6  # rad that digits of a file may make


@dataclass(frozen=True, eq=False)
class CoordinateChange:
    """Coordinates x with q = T x + c and v = T dx/dt, T (nv, nv), c (nv,); M and h are then T^T M T and T^T h."""

    words: str
    matrix: Array
    shift: Array

    def mass_matrix(self, robot: Robot, x: Array) -> Array:
        """T^T M(q) T, (n, nv, nv), for coordinates x (n, nv)."""
        return np.asarray(self.matrix.T @ robot.mass_matrix(self._q(robot, x), engine="pinocchio") @ self.matrix)

    def bias(self, robot: Robot, x: Array, v: Array) -> Array:
        """T^T h(q, T v), (n, nv), for coordinates x and their rates v, (n, nv) each."""
        return np.asarray(robot.bias(self._q(robot, x), v @ self.matrix.T, engine="pinocchio") @ self.matrix)

    def _q(self, robot: Robot, x: Array) -> Array:
        return robot.integrate(robot.neutral, x @ self.matrix.T + self.shift)

    @property
    def formula(self) -> str:
        """The change in symbols, such as "q[0] = x[0] - pi/2, q[1] = x[1] - x[0]"."""
        return ", ".join(f"q[{i}] = {_sum(row, c)}" for i, (row, c) in
                         enumerate(zip(self.matrix, self.shift, strict=True)))  # fmt: skip


def _sum(row: Array, constant: float) -> str:
    """A sum of multiples of x[0], x[1], ... and a constant."""
    parts = [(x, f"x[{i}]" if abs(x) == 1 else f"{abs(x):.6g} x[{i}]") for i, x in reversed(list(enumerate(row)))]
    parts.append((constant, "pi/2" if abs(constant) == _QUARTER else f"{abs(constant):.6g}"))
    joined = "".join(f" {'-' if x < 0 else '+'} {text}" for x, text in parts if x)
    return ("-" if joined.startswith(" -") else "") + joined[3:]


def coordinate_changes(robot: Robot, to: Any) -> list[CoordinateChange]:
    """The changes that `to` may mean, for a robot whose joints have one degree of freedom each.

    Parameters
    ----------
    robot : Robot
        The robot.
    to : None, str, iterable of str or array_like
        Names of NAMES, a matrix T (nv, nv), or (T c), (nv, nv + 1). None: all that have a name.

    Returns
    -------
    list of CoordinateChange
        The robot's own coordinates first, where they are among them.

    Raises
    ------
    QueryError
        An unknown name, a name that the robot has no such angles for, or a matrix of wrong shape or without inverse.
    """
    if to is None:
        signs = _signs(robot)
        ways = (False, True) if signs is not None and robot.nv > 1 else (False,)
        verticals = ("", *_verticals(robot, signs)) if signs is not None else ("",)
        return [_named(robot, absolute, vertical) for vertical in verticals for absolute in ways]
    if isinstance(to, Iterable) and not isinstance(to, str | np.ndarray):
        to = list(to)
    if isinstance(to, str) or (isinstance(to, list) and all(isinstance(name, str) for name in to)):
        names = re.findall(r"[\w-]+", to) if isinstance(to, str) else list(to)
        for name in names:
            require_known(name, NAMES, QueryError, argument="to")
        meant = [name for name in ("hanging", "upright") if name in names]
        meant = meant or (["hanging", "upright"] if "vertical" in names else [""])
        return [_named(robot, "absolute" in names, vertical) for vertical in meant]
    nv, given = robot.nv, array("to", to, None)
    if given.shape not in ((nv, nv), (nv, nv + 1)):
        what, remedy = f"expected shape {(nv, nv)} or {(nv, nv + 1)}, got {given.shape}", "q = T x + c: give T or (T c)"
        raise QueryError(what, argument="to", remedy=remedy)
    matrix, shift = given[:, :nv], given[:, nv] if given.shape[1] > nv else np.zeros(nv)
    if not np.linalg.cond(matrix) < 1e12:
        raise QueryError("the matrix has no inverse", argument="to", remedy="each angle must follow from the others")
    return [CoordinateChange("the coordinates that were given", matrix, shift)]


def _named(robot: Robot, absolute: bool, vertical: str) -> CoordinateChange:
    """The change by its names."""
    matrix, shift = np.eye(robot.nv), np.zeros(robot.nv)
    if not absolute and not vertical:
        return CoordinateChange("the robot's own coordinates", matrix, shift)
    signs, parents = _signs(robot), _parents(robot)
    if signs is None:
        raise QueryError(f"robot {robot.name!r} is no planar chain of joints that turn", argument="to",
                         remedy="leave it out, or give a matrix: q = T x")  # fmt: skip
    if vertical:
        angles = _verticals(robot, signs)
        if vertical not in angles:
            raise QueryError(f"robot {robot.name!r} is not horizontal at q = 0", argument="to",
                             remedy="give a matrix with a column more, (T c): q = T x + c")  # fmt: skip
        shift = np.where(parents < 0, signs * angles[vertical], 0.0)
    if absolute:
        matrix = np.diag(signs)
        for i, parent in enumerate(parents):
            matrix[i, parent] -= signs[i] if parent >= 0 else 0.0
    words = WORDS[vertical] if vertical else WORDS["absolute"]
    return CoordinateChange(f"absolute {words}" if vertical and absolute else words, matrix, shift)


def _parents(robot: Robot) -> Array:
    """The degree of freedom that each hangs on; -1 for the world."""
    model = robot.model
    found = np.full(robot.nv, -1)
    for j in range(1, model.njoints):
        found[model.idx_vs[j]] = model.idx_vs[model.parents[j]] if model.parents[j] else -1
    return found


def _signs(robot: Robot) -> Array | None:
    """Each joint's sense of turning, 1 or -1, by the first one's; None unless all turn about parallel axes."""
    axes = np.array(pin.computeJointJacobians(robot.model, robot.data, robot.neutral)).reshape(6, robot.nv)[3:].T
    along = axes @ axes[0] if robot.nv else np.zeros(1)
    return np.sign(along) if np.all(np.abs(np.abs(along) - 1) < 1e-9) else None


def _verticals(robot: Robot, signs: Array) -> dict[str, float]:
    """The shifts by a quarter turn from q = 0 that let the robot hang, or stand upright; empty where neither does."""
    roots, still = np.where(_parents(robot) < 0, signs, 0.0), np.zeros(robot.nv)
    turned = {c: robot.integrate(robot.neutral, c * roots) for c in (_QUARTER, -_QUARTER)}
    heights = {c: robot.energy(q, still)[1] for c, q in turned.items()}
    low, high = sorted(heights, key=lambda c: float(heights[c]))
    weight = robot.mass * float(np.linalg.norm(robot.gravity))
    torque = max(float(np.abs(robot.gravity_torque(q) * roots).max()) for q in turned.values())
    least = max(1e-9 * weight, torque / _TILT)  # hanging and upright, no torque turns it
    return {"hanging": low, "upright": high} if heights[high] - heights[low] > least else {}
