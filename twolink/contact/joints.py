"""Stops, dry friction and loops in a step.

Stops and dry friction are points of the contact problem, three rows each as a contact has.

    stop       g = s (q_k - p),  U_n = s v_k       a contact without friction
    friction   |p| <= c_k h,     U_t = v_k         a contact that the known impulse c_k h presses

s: the side of the stop, p: its position. Rows that remain move nothing and are not coupled to the others.
Source: Acary, Brogliato: Numerical Methods for Nonsmooth Dynamical Systems, 2008, chapters 3 and 10.

Loops are rows B of the velocities that contacts do not change.

    B (v + v+) = B_0 v,   q+ moves back by M^-1 B^T (B M^-1 B^T)^-1 g_0

B: the rows at the middle of the step. B_0, g_0: the rows and the gaps of the loops at its begin. Where B_0 v = 0 the
mean velocity keeps the loops, whose forces then do no work; what is left of B_0 v and of g_0 is taken away. Contacts
see the inverse mass matrix of what the loops leave free,

    W = M^-1 - M^-1 B^T (B M^-1 B^T)^-1 B M^-1.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from twolink.algorithms.mechanism import mechanism
from twolink.algorithms.namespaces import Numbers
from twolink.contact.bodies import Multibody
from twolink.effects.contact import Contact
from twolink.effects.switching import JointLock, Stop
from twolink.geometry.detection import Detector
from twolink.geometry.points import Points, key_of
from twolink.integrate.motion.constraints import Constraints
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.state import Array
from twolink.native.machine import Program, trace
from twolink.native.programs import program_named, require_agreement


class Laws(NamedTuple):
    """Of each pair, stop and joint with dry friction, in this order: its numbers (n,).

    friction, static, restitution, threshold: of the contact. thickness: as of `Detector`. pressing: the force [N or
    N m] that presses a joint's friction, 0 for all else. of_joints: whether it is no pair of bodies.
    """

    names: list[str]
    friction: Array
    static: Array
    restitution: Array
    threshold: Array
    thickness: Array
    pressing: Array
    of_joints: Array


class JointPoints:
    """Stops and dry friction of a robot's joints. pairs: how many pairs of bodies the scene has, which come first."""

    def __init__(self, stops: Sequence[Stop], locks: Sequence[JointLock], pairs: int) -> None:
        self.stops, self.locks, self.pairs = stops, [lock for lock in locks if lock.greatest > 0.0], pairs
        self.entry = np.array([stop.entry for stop in stops], dtype=int)
        self.position = np.array([stop.position for stop in stops])
        self.side = np.array([stop.side for stop in stops])
        self.dof = np.array([*(stop.dof for stop in stops), *(lock.dof for lock in self.locks)], dtype=int)

    def __bool__(self) -> bool:
        return bool(len(self.dof))

    def notes(self) -> list[str]:
        """Notes on the stops and the joints with dry friction in the contact problem, for people."""
        counts = ((len(self.stops), "stops"), (len(self.locks), "joints with dry friction"))
        return [f"{count} {what} are in the contact problem" for count, what in counts if count]

    def laws(self, detector: Detector, effects: Sequence[Contact]) -> Laws:
        """The laws of a scene's pairs, each by its effect, and those of its joints behind them."""
        of_pairs = [(float(e.friction), float(e.friction if e.static is None else e.static), float(e.restitution),
                     float(e.threshold)) for e in effects]  # fmt: skip
        friction, static, restitution, threshold = np.array(of_pairs).reshape(-1, 4).T
        stops, count, none = self.stops, len(self.dof), np.zeros(len(self.stops))
        names = [*(f"stop of {stop.name}" for stop in stops), *(f"friction of dof {lock.dof}" for lock in self.locks)]
        kinetic = np.array([lock.kinetic / lock.greatest for lock in self.locks])
        return Laws(
            [*detector.names, *names],
            np.concatenate([friction, none, kinetic]),
            np.concatenate([static, none, np.ones(len(self.locks))]),
            np.concatenate([restitution, [stop.restitution for stop in stops], np.zeros(len(self.locks))]),
            np.concatenate([threshold, np.zeros(count)]),
            np.concatenate([detector.thickness, np.full(count, np.inf)]),
            np.concatenate([np.zeros(self.pairs), none, [lock.greatest for lock in self.locks]]),
            np.arange(self.pairs + count) >= self.pairs,
        )

    def gaps(self, q: Array) -> Array:
        """g of the stops (..., n) at q (..., nq), rad or m."""
        return np.asarray(self.side * (q[..., self.entry] - self.position))

    def points(self, q: Array) -> Points:
        """All of them, as points of the ground at its origin."""
        count, still = len(self.dof), len(self.locks)
        pair, ground, vectors = self.pairs + np.arange(count), np.zeros(count, dtype=int), np.zeros((count, 3))
        normal = np.tile([0.0, 0.0, 1.0], (count, 1))
        gap = np.concatenate([self.gaps(q), np.zeros(still)])
        return Points(pair, key_of(pair, 0), ground, ground, gap, normal, vectors)

    def of(self, points: Points) -> Array:
        """Mask of the points that are of these joints (n,)."""
        return np.asarray(points.pair >= self.pairs)

    def with_rows(self, jacobian: Any, points: Points) -> Any:
        """The Jacobian (3n, nv) of points with the rows of these, which are 0 in it."""
        rows = np.flatnonzero(self.of(points))
        k = points.pair[rows] - self.pairs
        signs = np.concatenate([self.side, np.ones(len(self.locks))])
        jacobian[3 * rows + np.where(k < len(self.stops), 2, 0), self.dof[k]] = signs[k]
        return jacobian


def complete(matrix: Array, b: Array, joints: Array, given: Array) -> None:
    """Make G (3n, 3n) and b (n, 3) of points those of a contact problem.

    Parameters
    ----------
    matrix, b : ndarray
        G and b of the rows alone. Changed: rows that are 0 get the size of the one that is not, so that their impulses
        are 0, and b the normal impulses that are given.
    joints : ndarray (m,)
        Which of the points are of joints.
    given : ndarray (n,)
        The normal impulse of each point, N s or N m s, 0 where it is sought.
    """
    for i in joints.tolist():
        own = np.arange(3 * i, 3 * i + 3)
        size = matrix[own, own].max()
        matrix[own, own] = size
        b[i, 2] -= size * given[i]


SINGULAR = 1e-10  # relative: singular values of B M^-1 B^T below it belong to positions where the loops are singular


class Kept(NamedTuple):
    """A step with its loops closed: v+ without contacts (nv,), W (nv, nv), and the change (nv,) that closes them."""

    free: Array
    inverse: Any
    closing: Array | float


class LoopRows:
    """The loops of a scene, from its equations with them."""

    def __init__(self, equations: Equations, constraints: Constraints) -> None:
        self.constraints = constraints
        self.function = _program(equations, constraints)

    def at(self, q: Array) -> tuple[Array, Array]:
        """g (m,) and B (m, nv) of the rows that are not redundant."""
        loops = self.constraints
        out, count = self.function(q), len(loops.kept)
        return out[:count], out[count:].reshape(count, -1)

    def keep(self, bodies: Multibody, q: Array, middle: Array, w: Array, free: Array) -> Kept:
        """A step from (q, w) by way of its middle, at which the bodies are. free: w+ without loops and contacts."""
        g, start = self.at(q)
        rows = bodies.turned(self.at(middle)[1])
        response = bodies.inverse @ rows.T
        solved = response @ np.linalg.pinv(rows @ response, rcond=SINGULAR, hermitian=True)
        wanted = start @ bodies.to_local_velocity(q, w) - rows @ w
        return Kept(free + solved @ (wanted - rows @ free), bodies.inverse - solved @ response.T, -solved @ g)


def _program(equations: Equations, loops: Constraints) -> Program:
    """The program of q for g and B."""

    def formula(q: Array, xp: Any) -> list[Any]:
        mech = mechanism(equations.robot.model)
        gaps, rows = loops.residuals(mech, list(q), xp), loops.jacobian(mech, q, xp)
        return [*(gaps[i] for i in loops.kept), *(entry for row in rows for entry in row)]

    def compare(program: Program) -> None:
        """With NumPy, at the start. Raises CertificationError."""
        q = equations.start[: equations.space.nq]
        residuals = loops.residuals(loops.mech, list(q), Numbers)
        theirs = np.concatenate([[float(residuals[i]) for i in loops.kept], loops.jacobian_at(q, loops.kept).ravel()])
        require_agreement("loops", program(q), theirs)

    return program_named(equations.key("loops"), lambda: trace(formula, equations.space.nq), compare)
