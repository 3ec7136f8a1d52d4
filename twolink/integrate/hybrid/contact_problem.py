"""The contact problem: accelerations and forces of all that touches or rests, at once.

    a = a_0 + W J^T p,   c' = J a + J' v
    normal:   p_n >= 0,  c'_n >= 0,  p_n c'_n = 0
    tangent, without slip:   |p_t| <= mu p_n,   c'_t = 0, or |p_t| = mu p_n against c'_t
    tangent, with slip:      p_t = -mu p_n c_t / |c_t|
    joint at rest:           least <= p <= greatest,   c' = 0, or p at its limit against c'

a_0: without these forces. W: the inverse of M for what loops allow. J: rows of the gaps' rates and slips c, and units
of joints that stops and dry friction lock. Solved by sweeps over them (projected Gauss-Seidel) until the laws hold, or
by Newton's method from there. Which press, slide or stick is read from the accelerations: they are determined where
the forces are not.
Source: Jourdan, Alart, Jean, Comput. Methods Appl. Mech. Engrg. 155 (1998) 31-47.
"""

import math
from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from twolink.algorithms.dual_numbers import Jet, JetNamespace, coefficient
from twolink.algorithms.friction_cone import cone_derivative, onto_cone
from twolink.algorithms.motion import KinematicState
from twolink.algorithms.namespaces import Numbers
from twolink.errors import AccuracyError
from twolink.integrate.hybrid.modes import ModeState
from twolink.integrate.motion.state import Array

FIRST, SWEEPS = 32, 5_000  # of the first look for a solution, and of the last
NORMAL_LAST, NORMAL_FIRST = [1, 2, 0], [2, 0, 1]
NEWTON, SHORTEST = 50, 1e-3  # steps, and the shortest share of one
RANK = 1e-10  # relative: a gain below it is 0
UNCHANGED = 1e-13  # relative to the largest acceleration: what breaks no law
MOVES = 1e-9  # relative to the largest acceleration: what begins to move
FOLLOWS = 1e-7  # rows of loops below it are 0
Limits = tuple[float, float]  # (least, greatest) of a torque, N m or N


@dataclass(frozen=True)
class Rows:
    """A contact that touches. rows: J, the normal one and with friction two tangential ones (1 or 3, nv).

    bias: J' v of each row. friction, static: mu while it slides and while it does not. slip: the
    direction of sliding (2,); None where it does not slide.
    """

    rows: Array
    bias: Array
    friction: float
    static: float
    slip: Array | None


@dataclass(frozen=True)
class LockedJoint:
    """A joint at rest. rows: J (1, nv). least, greatest: of torques that lock it; kinetic: of friction in motion."""

    rows: Array
    least: float
    greatest: float
    kinetic: float
    bias: Array = field(default_factory=lambda: np.zeros(1))


class Outcome(NamedTuple):
    """The accelerations a (nv,), the force on each, and the accelerations of its rows, 0 where they are small."""

    a: Array
    forces: list[Array]
    rates: list[Array]


def solve_contacts(free: Array, inverse: Array, contacts: Sequence[Rows | LockedJoint]) -> Outcome | None:
    """The motion of a_0 (nv,) and W (nv, nv) under the forces of contacts and joints at rest; None without any."""
    if not contacts:
        return Outcome(free, [], [])
    laws, scale = _Laws(free, inverse, contacts), 1.0 + float(np.abs(free).max(initial=0.0))
    p, sweeps, found = np.zeros(len(laws.at_rest)), FIRST, None
    while found is None:
        if sweeps > SWEEPS or not laws.sweep(p, sweeps):
            return None
        found = laws.by_newton(p, UNCHANGED * scale)
        sweeps *= 2
    a = free + inverse @ laws.rows.T @ found
    rates = [contact.rows @ a + contact.bias for contact in contacts]
    return Outcome(a, [found[place] for place in laws.places],
                   [np.where(np.abs(rate) > MOVES * scale, rate, 0.0) for rate in rates])  # fmt: skip


class _Laws:
    """The laws p = proj(p - r c') of forces p (m,), with c' = D p + c'_0.

    The projection is that of `friction_cone`, or between the limits of a joint.
    """

    def __init__(self, free: Array, inverse: Array, contacts: Sequence[Rows | LockedJoint]) -> None:
        ends = np.cumsum([len(contact.rows) for contact in contacts])
        self.places = [slice(end - len(contact.rows), end) for end, contact in zip(ends, contacts, strict=True)]
        self.contacts, self.rows = contacts, np.concatenate([contact.rows for contact in contacts])
        self.gain = self.rows @ inverse @ self.rows.T
        self.at_rest = self.rows @ free + np.concatenate([contact.bias for contact in contacts])
        own = np.diag(self.gain)
        self.moves = own > RANK * own.max()
        self.r = np.where(self.moves, 1.0 / np.where(self.moves, own, 1.0), 0.0)

    def sweep(self, p: Array, count: int) -> bool:
        """Better forces, in place: one contact after the other; False where a `_force` has none."""
        for _ in range(count):
            before = p.copy()
            for contact, place in zip(self.contacts, self.places, strict=True):
                rates = self.gain[place] @ p + self.at_rest[place]
                better = (
                    _projection(contact, p[place] - self.r[place] * rates)[0]
                    if isinstance(contact, LockedJoint)
                    else _force(contact, self.gain[place, place], rates, p[place])
                )
                if better is None:
                    return False
                p[place] = better
            if (p == before).all():
                break
        return True

    def by_newton(self, p: Array, small: float) -> Array | None:
        """The forces from ones near them; None where Newton's method does not find them.

        Where sweeps creep, for forces that undo each other or are at the edge of their cone, a few steps suffice.
        """
        left, slopes = self._residual(p)
        size = self._size(left)
        for _ in range(NEWTON):
            step, share = np.linalg.lstsq(slopes, -left, rcond=RANK)[0], 1.0
            while True:
                left, slopes = self._residual(p + share * step)
                if self._size(left) < (1.0 - 0.1 * share) * size:
                    break
                share *= 0.5
                if share < SHORTEST or size <= small:
                    return p if size <= small else None
            p, size = p + share * step, self._size(left)
            if size == 0.0:
                break
        return p if size <= small else None

    def _size(self, left: Array) -> float:
        """The size of a residual as an acceleration."""
        return float((np.abs(left) * np.diag(self.gain)).max())

    def _residual(self, p: Array) -> tuple[Array, Array]:
        """p - proj(p - r c') and its derivative by p."""
        rates, left, slopes = self.gain @ p + self.at_rest, np.empty_like(p), np.zeros_like(self.gain)
        for contact, place in zip(self.contacts, self.places, strict=True):
            r = float(self.r[place.start])
            target, by_z = _projection(contact, p[place] - r * rates[place])
            left[place] = p[place] - target
            slopes[place, place] += np.eye(len(target)) - by_z
            slopes[place] += r * by_z @ self.gain[place]
        return left, slopes


def _projection(contact: Rows | LockedJoint, z: Array) -> tuple[Array, Array]:
    """proj(z), and its derivative by z = p - r c'; beyond what holds, kinetic friction acts."""
    size = len(z)
    if isinstance(contact, LockedJoint):
        if contact.least <= z[0] <= contact.greatest:
            return z, np.eye(1)
        return np.array([math.copysign(contact.kinetic, z[0] - contact.least)]), np.zeros((1, 1))
    if z[0] <= 0.0:
        return np.zeros(size), np.zeros((size, size))
    if size == 1:
        return z, np.eye(1)
    if contact.slip is not None:
        along = np.append(1.0, -contact.friction * contact.slip)
        by_z = np.zeros((3, 3))
        by_z[:, 0] = along
        return z[0] * along, by_z
    given, order = z[None, NORMAL_LAST], np.ix_(NORMAL_FIRST, NORMAL_FIRST)
    friction, static = np.array([contact.friction]), np.array([contact.static])
    return (onto_cone(given, friction, static)[0, NORMAL_FIRST], cone_derivative(given, friction, static)[0][order])


def _force(contact: Rows, gain: Array, rates: Array, before: Array) -> Array | None:
    """One contact's force, those of the others as they are; None where its friction drives what it should stop."""
    out = np.array(before)
    sliding = contact.slip is not None and len(out) > 1
    along = np.eye(len(out))[0]
    if contact.slip is not None and sliding:
        along[1:] = -contact.friction * contact.slip
    own = float(gain[0] @ along)
    if not own > 0.0:
        return out if gain[0, 0] <= 0.0 else None
    normal = max(0.0, before[0] - rates[0] / own)
    if sliding:
        return np.asarray(normal * along)
    rates = rates + gain[:, 0] * (normal - before[0])
    out[0] = normal
    if len(out) > 1:
        wanted = gain[1:, 1:] @ before[1:] - rates[1:]
        out[1:] = friction_force(gain[1:, 1:], wanted, contact.static * normal)
        if contact.static > contact.friction and math.hypot(*out[1:]) >= contact.static * normal:
            out[1:] = friction_force(gain[1:, 1:], wanted, contact.friction * normal)
    return out


def friction_force(gain: Array, wanted: Array, greatest: float) -> Array:
    """The force p (2,) that stops the slip c = G p - wanted, or of the greatest size against the slip that is left.

    The latter is (G + s) p = wanted with s > 0, found by Newton's method for 1 / |p| (More, Sorensen 1983).
    """
    e, axes = np.linalg.eigh(gain)
    w, limit = axes.T @ wanted, RANK * max(1e-300, float(e[-1]))
    p = np.where(e > limit, w / np.where(e > limit, e, 1.0), 0.0)
    size, s = math.hypot(*p), 0.0
    if size <= greatest:
        return np.asarray(axes @ p)
    e = np.maximum(e, 0.0)
    s = math.hypot(*w) / max(greatest, 1e-300) - float(e[-1])  # not beyond the solution
    s = max(s, limit)
    for _ in range(NEWTON):
        p = w / (e + s)
        size = math.hypot(*p)
        change = (size / max(greatest, 1e-300) - 1.0) * size * size / float((p * p / (e + s)).sum() or 1.0)
        s += change
        if abs(change) <= 1e-15 * s:
            break
    p = w / (e + s)
    return np.asarray(axes @ p * (greatest / math.hypot(*p)))


def sliding_of(friction: float, slip: Array | None, rates: Array) -> tuple[float, float] | None:
    """The direction in which a contact that presses slides or begins to, from its accelerations; None: it sticks."""
    if not friction:
        return 0.0, 0.0
    direction = rates[1:] if slip is None else slip
    size = math.hypot(*direction)
    return (float(direction[0] / size), float(direction[1] / size)) if size > 0.0 else None


def contact_rows(state: ModeState, i: int) -> Array:
    """The rows J of contact i, (3, nv): its velocities are linear in v, so they are those of unit velocities."""
    nq, nv = state.system.nq, len(state.v)
    states = np.repeat(state.full_state()[:, None], nv, axis=1)
    states[nq : nq + nv] = np.eye(nv)
    return state.own.evaluate(np.full(nv, state.t), states).contacts[i, 1:4]


def contact_bias(state: ModeState, i: int) -> Array:
    """J' v of contact i, (3,): the derivative of its velocities with v constant."""
    equations, nq = state.own.equations, state.system.nq
    q, v = state.x[:nq], state.v
    jets = [Jet(pair) for pair in zip(q, equations.space.rate(q, v), strict=True)]
    moving = KinematicState(equations.robot.model, equations.mechanism, jets, list(v), state.t, JetNamespace(Numbers))
    return np.array([float(coefficient(row, 1)) for row in state.system.contacts[i].velocity(moving)])


def mass_matrix(state: ModeState) -> Array:
    """M(q), by Pinocchio, with what acts in the mode."""
    robot = state.own.equations.robot
    return np.array(pin.crba(robot.model, robot.data, state.x[: state.system.nq]))


def loop_rows(state: ModeState) -> Array:
    """The rows of constraints that are no contacts, (m, nv)."""
    constraints = state.own.equations.constraints
    if constraints is None:
        return np.empty((0, len(state.v)))
    of_contacts = {row for rows in state.own.rows.values() for row in rows}
    kept = [number for row, number in enumerate(constraints.kept) if row not in of_contacts]
    return constraints.jacobian_at(state.x[: state.system.nq], kept)


def lock_limits(state: ModeState) -> dict[int, Limits]:
    """The torques (least, greatest) that can lock each joint that is locked, with what `shared_limits` adds.

    Raises AccuracyError, code "indeterminate-forces", where a joint at rest follows several locked ones, and it matters
    in which order they give way, as static friction is above the kinetic.
    """
    system, mode = state.system, state.mode
    limits = {k: system.torque_range(k, state.x) for k in system.lockable if not mode.slip.get(k) or k in mode.locked}
    if len(limits) == len(mode.locked) or state.own.equations.constraints is None:
        return limits
    found, several = shared_limits(loop_rows(state), limits, mode.locked)
    if (k := next((k for k in several if system.static(k) > system.kinetic[k]), None)) is not None:
        raise AccuracyError(f"loops share the static friction of joint {system.names[k]!r} with several others at rest",
                            where=f"t = {state.t:.9g} s", code="indeterminate-forces", t=state.t,
                            remedy="static friction as the kinetic one, or of fewer joints")  # fmt: skip
    return found


def shared_limits(
    loops: Array, limits: Mapping[int, Limits], locked: AbstractSet[int]
) -> tuple[dict[int, Limits], set[int]]:
    """The limits of the torques that lock joints, with those of joints at rest that move as one of them does.

    Loops make the locks of these redundant: v_j = b v_k for all that the loops (m, nv) and the other locks allow, and a
    torque of joint j does what b times that does at joint k. Also the joints of which one follows several of the
    locked; there nothing is added.
    """
    order, several = sorted(locked), set[int]()
    out, rows = {k: limits[k] for k in order}, np.concatenate([loops, np.eye(loops.shape[1])[order]])
    for j in (j for j in limits.keys() - locked if any(limits[j])):
        unit = np.eye(loops.shape[1])[j]
        factors = np.linalg.lstsq(rows.T, unit, rcond=None)[0]
        if np.abs(rows.T @ factors - unit).max() > FOLLOWS:
            continue
        follows = [(k, b) for k, b in zip(order, factors[len(loops) :].tolist(), strict=True) if abs(b) > FOLLOWS]
        if len(follows) > 1:
            several |= {j, *(k for k, _ in follows)}
            continue
        for k, b in follows:
            ends = sorted(b * end for end in limits[j])
            out[k] = out[k][0] + ends[0], out[k][1] + ends[1]
    return out, several


def inverse_under(mass: Array, fixed: Array) -> Array:
    """The inverse of M for motions that rows (m, nv) allow: W = M^-1 - M^-1 G^T (G M^-1 G^T)^+ G M^-1."""
    inverse = np.linalg.inv(mass)
    if len(fixed):
        gain = fixed @ inverse @ fixed.T
        inverse = inverse - inverse @ fixed.T @ np.linalg.pinv(gain, rcond=1e-10) @ fixed @ inverse
    return np.asarray(inverse)
