"""Consistent modes: which joints are locked and which contacts press, slide or roll, so that the laws hold.

Everything that may be at rest is tried at rest. Where a force breaks its law there, all forces are solved for at once
(`contact_problem`), and the modes are those of the accelerations.
"""

import math
from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from dataclasses import replace

import numpy as np

from twolink.errors import AccuracyError
from twolink.integrate.hybrid.contact_problem import (
    LockedJoint,
    Outcome,
    Rows,
    contact_bias,
    contact_rows,
    inverse_under,
    lock_limits,
    loop_rows,
    mass_matrix,
    sliding_of,
    solve_contacts,
)
from twolink.integrate.hybrid.force_share import share_of
from twolink.integrate.hybrid.modes import ContactMode, Mode, ModeState
from twolink.integrate.motion.state import Array

TINY = 1e-11  # relative: velocities that are 0
SLOW = 1e-8  # m/s: a sliding contact so slow is tried at rest, which it would reach at once
SLOWEST = 1e-6  # m/s: such ones are tried where no mode is consistent or determined: they stop within 1e-12 m
ALLOWED = 1e-10  # relative: forces at the edge of a law
NEAR = 1e-9  # m: a gap that is closed
OPEN = 1e-6  # m: a gap at which a closed contact is open
RANK = 1e-7  # singular values of constraint rows below it are 0
DIFFERENT = 1e-9  # relative: generalized forces that are not the same
ROUNDING, SLOWEST_SLIP = 1e-15, 1e-10  # of velocities, relative; m/s, of one whose direction counts
OVERLAPS = 1e-8  # relative: an acceleration with which a gap becomes negative
SAME = 1e-7  # relative: accelerations of two ways to compute them
Key = tuple[str, int]  # ("joint", degree of freedom), ("contact", number), ("roll", number)


def still_speed(v: Array) -> float:
    """The speed below which a velocity is 0."""
    return TINY * (1.0 + float(np.abs(v).max(initial=0.0)))


def different(v: Array, slips: Array) -> float:
    """Relative: how far forces along directions of slip (n, 2) differ by more than the rounding of the velocities v."""
    slowest = max(SLOWEST_SLIP, float(np.linalg.norm(slips, axis=1).min(initial=math.inf)))
    return DIFFERENT + ROUNDING * (1.0 + float(np.abs(v).max(initial=0.0))) / slowest


def consistent(state: ModeState, opened: frozenset[Key] = frozenset(), slow: float = SLOW) -> ModeState:
    """Put a state into the mode that is consistent there, with 0 for velocities of what is at rest.

    opened: what an event has just freed; it is not tried at rest again unless it would move the wrong way. slow: the
    speed of slips that are tried at rest, m/s.
    Raises AccuracyError where no mode is consistent.
    """
    still = still_speed(state.v)
    state, indeterminate = _with_joints_at_rest(state, still, opened), False
    for speed in (slow, max(slow, SLOWEST)):
        found = _with_consistent_contacts(state, still, opened, speed)
        if found is not None and _is_determined(found):
            return _with_contacts_at_rest(state.mode, found, still)
        indeterminate |= found is not None
    if indeterminate:
        raise AccuracyError("bodies slide on more points than determine their forces, and the motion depends on the "
                            "share of each", where=f"t = {state.t:.9g} s", remedy="let them touch at three points",
                            code="indeterminate-forces", t=state.t)  # fmt: skip
    raise AccuracyError("friction and contact allow no motion, or several: no consistent forces exist, as where "
                        "friction drives what it should stop (Painleve's paradox)",
                        where=f"t = {state.t:.9g} s", remedy="less friction, or smooth friction",
                        code="no-consistent-mode", t=state.t)  # fmt: skip


def _with_consistent_contacts(state: ModeState, still: float, opened: frozenset[Key], slow: float) -> ModeState | None:
    """The state in the mode that is consistent; None where none is found. slow: see SLOW."""
    state = state.in_mode(_with_closed_contacts(state, still, opened, slow))
    state = state.in_mode(_without_redundant_locks(state))
    return state if _is_lawful(state, still) else _by_contact_problem(state, still, opened, slow)


def _with_joints_at_rest(state: ModeState, still: float, opened: frozenset[Key]) -> ModeState:
    """Every joint locked that is at rest and can be locked; velocities of joints at rest are 0."""
    system, mode, x = state.system, state.mode, np.array(state.x)
    for k in system.lockable:
        v = x[system.nq + k]
        moving = abs(v) > still
        mode = mode.freeing(k, math.copysign(1.0, v) if moving and k in system.has_friction else mode.slip.get(k, 0.0))
        if moving:
            continue
        x[system.nq + k] = 0.0
        if ("joint", k) not in opened and system.locks(k, x):
            mode = mode.locking(k)
    return state.in_mode(mode, x)


def _with_contacts_at_rest(before: Mode, state: ModeState, still: float) -> ModeState:
    """The state without the slips of contacts that slid before and stick now: those are small, but no rounding."""
    stuck = [i for i, (old, new) in enumerate(zip(before.contacts, state.mode.contacts, strict=True))
             if (old, new) == ("sliding", "rolling")]  # fmt: skip
    if not stuck or np.abs(state.evaluate().contacts[stuck, 2:4, 0]).max() <= still:
        return state
    return state.in_mode(state.mode, state.closed())


def _with_closed_contacts(state: ModeState, still: float, opened: frozenset[Key], slow: float) -> Mode:
    """The mode with every contact closed that touches and does not part."""
    mode = state.mode
    if not mode.contacts:
        return mode
    rows = state.evaluate().contacts[:, :, 0]
    for i, contact in enumerate(state.system.contacts):
        gap, rate, *slip = rows[i, :4]
        free = mode.contacts[i] == "free"
        impact_to_come = rate < -still and free
        if gap > (NEAR if free else OPEN) or rate > still or impact_to_come or ("contact", i) in opened:
            mode = mode.with_contact(i, "free")
            continue
        speed = math.hypot(*slip)
        direction = (float(slip[0] / speed), float(slip[1] / speed)) if speed > still else None
        if not contact.friction:
            mode = mode.with_contact(i, "sliding", (0.0, 0.0))
        elif speed <= (slow if mode.contacts[i] == "sliding" else still) and ("roll", i) not in opened:
            mode = mode.with_contact(i, "rolling")
        else:
            mode = mode.with_contact(i, "sliding", direction)
    return mode


def _without_redundant_locks(state: ModeState) -> Mode:
    """The mode without locks of joints that loops lock already: their friction is not determined."""
    mode = state.mode
    loops = loop_rows(state) if mode.locked else np.empty((0, 0))
    wanted, free = np.linalg.matrix_rank(loops, tol=RANK) if len(loops) else 0, np.ones(len(state.v))
    for k in sorted(mode.locked) if wanted else ():
        free[k] = 0.0
        if np.linalg.matrix_rank(loops * free, tol=RANK) < wanted:
            free[k] = 1.0
            mode = mode.freeing(k, 0.0)
    return mode


def _is_lawful(state: ModeState, still: float) -> bool:
    """True if all that is locked, and that presses, does so within its law, and nothing else begins the wrong way."""
    system, mode, own, snapshot = state.system, state.mode, state.own, state.evaluate()
    if not np.isfinite(snapshot.a).all():  # no forces keep it so
        return False
    allowed = ALLOWED * own.largest_load(snapshot)
    if own.redundant:
        lawful = float(share_of(state).best(snapshot).margin[0]) >= -allowed
    else:
        lawful = all(least - allowed <= snapshot.locks[system.lockable.index(k), 0] <= greatest + allowed
                     for k, (least, greatest) in lock_limits(state).items())  # fmt: skip
        for i, kind in enumerate(mode.contacts):
            if kind != "free":
                normal, *across = own.contact_forces(snapshot, i)[:, 0]
                limit = system.contacts[i].static * normal if kind == "rolling" else math.inf
                lawful &= normal >= -allowed and math.hypot(*across) - limit <= allowed
    small = OVERLAPS * (1.0 + float(np.abs(snapshot.a).max(initial=0.0)))
    return (
        lawful
        and not _wrong_joints(state, snapshot.a[:, 0], small)
        and not any(mode.contacts[i] == "free" and snapshot.contacts[i, 4, 0] < -small for i in _touching(state, still))
    )


def _wrong_joints(state: ModeState, a: Array, small: float) -> list[int]:
    """The joints at rest that nothing locks and that begin to move into a stop, or not as their friction says."""
    system, mode, x, wrong = state.system, state.mode, state.x, list[int]()
    for k in system.lockable:
        if k in mode.locked or x[system.nq + k] != 0.0 or abs(a[k]) <= small:
            continue
        least, greatest = system.torque_range(k, x)
        into_stop = (greatest == math.inf and a[k] < 0.0) or (least == -math.inf and a[k] > 0.0)
        if into_stop or (k in system.has_friction and mode.slip.get(k, 0.0) * a[k] <= 0.0):
            wrong.append(k)
    return wrong


def _is_determined(state: ModeState) -> bool:
    """True if friction has the same effect for all shares of the normal forces."""
    own, mode = state.own, state.mode
    slides = [i for i, kind in enumerate(mode.contacts) if kind == "sliding" and state.system.contacts[i].friction]
    if not (own.redundant and slides):
        return True
    snapshot = state.evaluate()
    sizes = np.linalg.svd(share_of(state).columns(snapshot)[0], compute_uv=False)
    constraints = own.equations.constraints
    kept = 0 if constraints is None else len(constraints.kept)
    return bool((sizes > different(state.v, snapshot.contacts[slides, 2:4, 0]) * sizes[0]).sum() <= kept)


def _touching(state: ModeState, still: float) -> list[int]:
    """The contacts that touch and do not part or approach."""
    if not state.system.contacts:
        return []
    gap, rate = state.evaluate().contacts[:, :2, 0].T
    return np.flatnonzero((gap <= NEAR) & (np.abs(rate) <= still)).tolist()


def _by_contact_problem(state: ModeState, still: float, opened: frozenset[Key], slow: float) -> ModeState | None:
    """The mode in which all that touches and rests does what the contact problem says; None without a solution.

    What an event has just opened, or set sliding, is in the problem only where it would begin the wrong way.
    """
    state = _without_slow_slips(state, _touching(state, still), max(still, slow))
    touching, problem = _touching(state, still), ModeProblem(state, still)
    contacts = {i for i in touching if ("contact", i) not in opened}
    sticking = {i for i in touching if ("roll", i) not in opened and problem.slip(i) is None}
    joints = set(state.mode.locked)
    for _ in range(2 + len(touching) + len(state.system.lockable)):
        outcome = problem.solved(sorted(contacts), sorted(joints), sticking)
        if outcome is None:
            return None
        found, a = problem.mode_state(outcome, sorted(contacts), sorted(joints), sticking), outcome.a
        small = OVERLAPS * (1.0 + float(np.abs(a).max()))
        snapshot = found.evaluate()
        if not np.abs(snapshot.a[:, 0] - a).max() <= SAME * (1.0 + np.abs(a).max()):
            return None
        wrong = {k for k in _wrong_joints(found, a, small) if k not in joints}
        overlap = {i for i in touching if i not in contacts and snapshot.contacts[i, 4, 0] < -small}
        back = {i for i in contacts - sticking if problem.slip(i) is None and problem.turns_back(found, i, small)}
        if not (wrong or overlap or back):
            return found
        joints, contacts, sticking = joints | wrong, contacts | overlap, sticking | back
    return None


class ModeProblem:
    """The contact problem of a state: of contacts that touch and of joints at rest, as they are asked for."""

    def __init__(self, state: ModeState, still: float) -> None:
        self.state, self.still, self.mass = state, still, mass_matrix(state)
        self.slips = state.evaluate().contacts[:, 2:4, 0] if state.system.contacts else np.empty((0, 2))
        self.inverse = inverse_under(self.mass, loop_rows(state))
        free: tuple[ContactMode, ...] = tuple("free" for _ in state.mode.contacts)
        self._open = replace(state.mode, contacts=free)

    def slip(self, i: int) -> Array | None:
        """The direction in which contact i slides; None where it does not."""
        speed = float(np.linalg.norm(self.slips[i]))
        return self.slips[i] / speed if speed > self.still else None

    def turns_back(self, found: ModeState, i: int, small: float) -> bool:
        """True if contact i, set sliding, begins to slide the other way."""
        ahead = contact_rows(found, i) @ found.evaluate().a[:, 0] + contact_bias(found, i)
        return float(ahead[1:] @ found.mode.directions[i]) < -small

    def gain(self, contact: bool, number: int) -> float:
        """The acceleration of a contact's gap, or of a joint, by a force of size 1 there."""
        row = contact_rows(self.state, number)[0] if contact else np.eye(len(self.state.v))[number]
        return float(row @ self.inverse @ row)

    def solved(self, contacts: Sequence[int], joints: Sequence[int], sticking: AbstractSet[int]) -> Outcome | None:
        """The motion with these contacts and joints; those that stick, and do not begin to slide as an event says."""
        system, mode = self.state.system, self._open
        for k in {*joints, *mode.locked}:
            mode = mode.freeing(k, 0.0)
        without = self.state.in_mode(mode)
        locked = [LockedJoint(np.eye(len(self.state.v))[[k]], *system.torque_range(k, self.state.x), system.kinetic[k])
                for k in joints]  # fmt: skip
        rows = [self._rows(without, i, sticking) for i in contacts]
        return solve_contacts(without.evaluate().a[:, 0], self.inverse, [*rows, *locked])

    def mode_state(
        self, outcome: Outcome, contacts: Sequence[int], joints: Sequence[int], sticking: AbstractSet[int]
    ) -> ModeState:
        """The state in the mode of a solution."""
        system, mode = self.state.system, self._open
        for i, rates in zip(contacts, outcome.rates, strict=False):
            if not rates[0] > 0.0:
                slides = sliding_of(system.contacts[i].friction, self._direction(i, sticking), rates)
                mode = mode.with_contact(i, "rolling" if slides is None else "sliding", slides)
        for k, (rate,) in zip(joints, outcome.rates[len(contacts) :], strict=True):
            slip = float(np.sign(rate)) if k in system.has_friction else 0.0
            mode = mode.freeing(k, slip) if rate else mode.locking(k)
        return self.state.in_mode(_without_redundant_locks(self.state.in_mode(mode)))

    def without_rates(self, contacts: Sequence[int], joints: Sequence[int]) -> Array:
        """The velocities with the rates of contacts, and of joints, stopped by the forces that act there."""
        rows, forces = [np.eye(len(self.state.v))[list(joints)]], [np.eye(len(self.state.v))[list(joints)]]
        for i in contacts:
            every, friction, slip = (contact_rows(self.state, i), self.state.system.contacts[i].friction, self.slip(i))
            sticks = friction > 0.0 and slip is None
            rows.append(every if sticks else every[:1])
            forces.append(every if sticks or slip is None else every[:1] - friction * slip @ every[1:])
        j, b = np.concatenate(rows), np.concatenate(forces)
        stopping = np.linalg.pinv(j @ self.inverse @ b.T, rcond=RANK) @ j @ self.state.v
        new = self.state.v - self.inverse @ b.T @ stopping
        new[list(joints)] = 0.0
        return np.asarray(new)

    def _direction(self, i: int, sticking: AbstractSet[int]) -> Array | None:
        """The direction in which contact i slides, or begins to as an event says; None where it sticks."""
        slip = self.slip(i)
        return slip if slip is not None or i in sticking else np.array(self.state.mode.directions[i])

    def _rows(self, without: ModeState, i: int, sticking: AbstractSet[int]) -> Rows:
        """The rows of contact i."""
        contact, count = self.state.system.contacts[i], 3 if self.state.system.contacts[i].friction else 1
        return Rows(contact_rows(without, i)[:count], contact_bias(without, i)[:count], contact.friction,
                    contact.static, self._direction(i, sticking))  # fmt: skip


def _without_slow_slips(state: ModeState, touching: list[int], slow: float) -> ModeState:
    """Remove the slips of a state, if all that touches slips slowly, by the impulses that stop them.

    Where a body stops, its points have slips in all directions, though they begin to slide in one.
    """
    rough = [i for i in touching if state.system.contacts[i].friction]
    if not rough or np.linalg.norm(state.evaluate().contacts[rough, 2:4, 0], axis=1).max() > slow:
        return state
    rows = np.concatenate([contact_rows(state, i)[: 3 if i in rough else 1] for i in touching])
    locked = np.eye(len(state.v))[sorted(state.mode.locked)]
    inverse = inverse_under(mass_matrix(state), np.concatenate([loop_rows(state), locked]))
    change = inverse @ rows.T @ np.linalg.pinv(rows @ inverse @ rows.T, rcond=RANK) @ rows @ state.v
    x = state.x.copy()
    x[state.system.whole.space.v_rows] -= change
    return state.in_mode(state.mode, x)
