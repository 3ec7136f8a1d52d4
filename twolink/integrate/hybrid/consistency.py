"""Consistent modes: which joints are held and which contacts press, slide or roll, so that the laws hold.

Everything that may be at rest is tried at rest. The force that breaks its law most is given up, one at a time, until
none does; what then would move the wrong way is tried at rest again. Where this finds no mode for the contacts, their
forces are solved for at once (`contact_problem`), and the modes are those of the accelerations.
"""

import math

import numpy as np

from twolink.errors import AccuracyError
from twolink.integrate.hybrid.contact_problem import Rows, solve_contacts
from twolink.integrate.hybrid.contact_rows import contact_bias, contact_rows, inverse_under, loop_rows, mass_matrix
from twolink.integrate.hybrid.force_share import ForceShare
from twolink.integrate.hybrid.modes import Mode, Situation
from twolink.integrate.hybrid.snapshot import Snapshot
from twolink.integrate.state import Array

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
SHARE: tuple[str, int] = ("share", 0)  # of the forces of contacts on more points than determine them
SAME = 1e-7  # relative: accelerations of two ways to compute them
Key = tuple[str, int]  # ("joint", degree of freedom), ("contact", number), ("roll", number)


def still_speed(v: Array) -> float:
    """The speed below which a velocity is 0."""
    return TINY * (1.0 + float(np.abs(v).max(initial=0.0)))


def different(v: Array, slips: Array) -> float:
    """Relative: how far forces along directions of slip (n, 2) differ by more than the rounding of the velocities v."""
    slowest = max(SLOWEST_SLIP, float(np.linalg.norm(slips, axis=1).min(initial=math.inf)))
    return DIFFERENT + ROUNDING * (1.0 + float(np.abs(v).max(initial=0.0))) / slowest


def consistent(here: Situation, opened: frozenset[Key] = frozenset()) -> Situation:
    """The same state in the mode that is consistent there, with 0 for velocities of what is at rest.

    opened: what an event has just freed; it is not tried at rest again unless it would move the wrong way.
    Raises AccuracyError where no mode is consistent.
    """
    still = still_speed(here.v)
    here, indeterminate = _with_joints_at_rest(here, still, opened), False
    for slow in (SLOW, SLOWEST):
        found = _with_consistent_contacts(here, still, opened, slow)
        if found is not None and _is_determined(found):
            return found
        indeterminate |= found is not None
    if indeterminate:
        raise AccuracyError("bodies slide on more points than determine their forces, and the motion depends on the "
                            "share of each", where=f"t = {here.t:.9g} s", remedy="let them touch at three points",
                            code="indeterminate-forces", t=here.t)  # fmt: skip
    raise AccuracyError("friction and contact allow no motion, or several: no consistent forces exist",
                        where=f"t = {here.t:.9g} s", remedy="less friction, or smooth friction",
                        code="no-consistent-mode", t=here.t)  # fmt: skip


def _with_consistent_contacts(here: Situation, still: float, opened: frozenset[Key], slow: float) -> Situation | None:
    """The situation in the mode that is consistent; None where none is found. slow: see SLOW."""
    here = here.in_mode(_with_closed_contacts(here, still, opened, slow))
    tried: set[Key] = set(opened)
    for _ in range(20 + 6 * (len(here.system.names) + len(here.system.contacts))):
        here = here.in_mode(_without_redundant_locks(here))
        mode, key = _improved(here, tried)
        here = here.in_mode(mode)
        if key is None and not _overlapping(here, still):
            return here
        if key is None or key == SHARE:
            break
        tried.add(key)
    return _by_contact_problem(here, still, slow)


def freed(here: Situation, k: int, torque: float) -> Mode:
    """The mode with a joint freed that this torque would hold: it slips where the load drives it."""
    if k not in here.system.has_friction:
        return here.mode.freeing(k, 0.0)
    return here.mode.freeing(k, 1.0 if torque < here.system.torque_range(k, here.x)[0] or torque < 0.0 else -1.0)


def sliding(mode: Mode, i: int, forces: Array) -> Mode:
    """The mode with contact i sliding against the force (normal, two tangential) that would hold it."""
    size = math.hypot(forces[1], forces[2])
    return mode.with_contact(i, "sliding", (float(-forces[1] / size), float(-forces[2] / size)))


def _with_joints_at_rest(here: Situation, still: float, opened: frozenset[Key]) -> Situation:
    """Every joint locked that is at rest and can be held; velocities of joints at rest are 0."""
    system, mode, x, _ = here
    x = np.array(x)
    for k in system.lockable:
        v = x[system.nq + k]
        moving = abs(v) > still
        mode = mode.freeing(k, math.copysign(1.0, v) if moving and k in system.has_friction else mode.slip.get(k, 0.0))
        if moving:
            continue
        x[system.nq + k] = 0.0
        if ("joint", k) not in opened and system.holds(k, x):
            mode = mode.locking(k)
    return here._replace(mode=mode, x=x)


def _with_closed_contacts(here: Situation, still: float, opened: frozenset[Key], slow: float) -> Mode:
    """The mode with every contact closed that touches and does not part."""
    mode = here.mode
    if not mode.contacts:
        return mode
    rows = here.look().contacts[:, :, 0]
    for i, contact in enumerate(here.system.contacts):
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


def _without_redundant_locks(here: Situation) -> Mode:
    """The mode without locks of joints that constraints hold already: their friction is not determined."""
    constraints, mode = here.own.equations.constraints, here.mode
    if constraints is None or not mode.locked:
        return mode
    jacobian = constraints.jacobian_at(here.x[: here.system.nq], constraints.kept)
    wanted = np.linalg.matrix_rank(jacobian, tol=RANK)
    free = np.ones(jacobian.shape[1])
    for k in sorted(mode.locked):
        free[k] = 0.0
        if np.linalg.matrix_rank(jacobian * free, tol=RANK) < wanted:
            free[k] = 1.0
            mode = mode.freeing(k, 0.0)
    return mode


def _improved(here: Situation, tried: set[Key]) -> tuple[Mode, Key | None]:
    """The mode without the force that breaks its law most, and what that was; None if all laws hold."""
    system, mode, x, t = here
    own, snapshot = here.own, here.look()
    if not np.isfinite(snapshot.a).all():
        raise AccuracyError("contact or friction allows no motion here: the forces are not determined, or friction "
                            "drives what it should stop (Painleve's paradox)", where=f"t = {t:.9g} s",
                            remedy="less friction, or smooth friction", code="no-consistent-mode", t=t)  # fmt: skip
    allowed = ALLOWED * own.largest_load(snapshot)
    torques = {k: float(snapshot.locks[i, 0]) for i, k in enumerate(system.lockable) if k in mode.locked}
    breaches: list[tuple[float, Key]] = []
    for k, torque in torques.items():
        least, greatest = system.torque_range(k, x)
        breaches.append((max(torque - greatest, least - torque) - allowed, ("joint", k)))
    if own.redundant:
        margin = float(ForceShare(own, mode, system.static).best(snapshot).margin[0])
        breaches.append((-margin - allowed, SHARE))
    forces = (
        {}
        if own.redundant
        else {i: own.contact_forces(snapshot, i)[:, 0] for i, kind in enumerate(mode.contacts) if kind != "free"}
    )
    for i, force in forces.items():
        breaches.append((-force[0] - allowed, ("contact", i)))
        if mode.contacts[i] == "rolling":
            friction = system.contacts[i].static
            breaches.append((math.hypot(*force[1:]) - friction * force[0] - allowed, ("roll", i)))
    # A contact that pulls is opened before one whose friction is too large: where several press, the share of each in
    # the friction is not determined.
    size, key = max(breaches, key=lambda breach: (breach[0] > 0.0 and breach[1][0] == "contact", breach),
                    default=(0.0, ("", 0)))  # fmt: skip
    if not size > 0.0:
        return _wrong_way(here, snapshot, tried, allowed)
    if key == SHARE:
        return mode, key
    if key[0] == "joint":
        return freed(here, key[1], torques[key[1]]), key
    if key[0] == "contact":
        return mode.with_contact(key[1], "free"), key
    return sliding(mode, key[1], forces[key[1]]), key


def _is_determined(here: Situation) -> bool:
    """Whether friction has the same effect for all shares of the normal forces."""
    own, mode = here.own, here.mode
    slides = [i for i, kind in enumerate(mode.contacts) if kind == "sliding" and here.system.contacts[i].friction]
    if not (own.redundant and slides):
        return True
    look = here.look()
    sizes = np.linalg.svd(ForceShare(own, mode, here.system.static).columns(look)[0], compute_uv=False)
    kept = sum(row is not None for rows in own.rows.values() for row in rows)
    return bool((sizes > different(here.v, look.contacts[slides, 2:4, 0]) * sizes[0]).sum() <= kept)


def _touching(here: Situation, still: float) -> list[int]:
    """The contacts that touch and do not part or approach."""
    if not here.system.contacts:
        return []
    gap, rate = here.look().contacts[:, :2, 0].T
    return np.flatnonzero((gap <= NEAR) & (np.abs(rate) <= still)).tolist()


def _overlapping(here: Situation, still: float) -> bool:
    """Whether an open contact that touches begins to overlap."""
    snapshot = here.look()
    small = OVERLAPS * (1.0 + float(np.abs(snapshot.a).max(initial=0.0)))
    return any(here.mode.contacts[i] == "free" and snapshot.contacts[i, 4, 0] < -small for i in _touching(here, still))


def _by_contact_problem(here: Situation, still: float, slow: float) -> Situation | None:
    """The mode in which the contacts that touch do what the solution of the contact problem says; None without one."""
    touching = _touching(here, still)
    here = _without_slow_slips(here, touching, max(still, slow))
    without = here
    for i in touching:
        without = without.in_mode(without.mode.with_contact(i, "free"))
    locked = np.eye(len(here.v))[sorted(here.mode.locked)]
    inverse = inverse_under(mass_matrix(without), np.concatenate([loop_rows(without), locked]))
    look, contacts = without.look(), list[Rows]()
    for i in touching:
        contact, slip = here.system.contacts[i], look.contacts[i, 2:4, 0]
        count, speed = 3 if contact.friction else 1, float(np.linalg.norm(slip))
        contacts.append(Rows(contact_rows(without, i)[:count], contact_bias(without, i)[:count], contact.friction,
                             contact.static, slip / speed if speed > still else None))  # fmt: skip
    solution = solve_contacts(look.a[:, 0], inverse, contacts)
    if solution is None:
        return None
    mode = without.mode
    for i, does in zip(touching, solution[1], strict=True):
        if not does.opens:
            mode = mode.with_contact(i, "rolling" if does.slides is None else "sliding", does.slides)
    here = here.in_mode(mode)
    difference = np.abs(here.look().a[:, 0] - solution[0]).max()
    return here if difference <= SAME * (1.0 + np.abs(solution[0]).max()) else None


def _without_slow_slips(here: Situation, touching: list[int], slow: float) -> Situation:
    """The same situation, if all that touches slips slowly: without these slips, by the impulses that stop them.

    Where a body stops, its points have slips in all directions, though they begin to slide in one.
    """
    rough = [i for i in touching if here.system.contacts[i].friction]
    if not rough or np.linalg.norm(here.look().contacts[rough, 2:4, 0], axis=1).max() > slow:
        return here
    rows = np.concatenate([contact_rows(here, i)[: 3 if i in rough else 1] for i in touching])
    locked = np.eye(len(here.v))[sorted(here.mode.locked)]
    inverse = inverse_under(mass_matrix(here), np.concatenate([loop_rows(here), locked]))
    change = inverse @ rows.T @ np.linalg.pinv(rows @ inverse @ rows.T, rcond=RANK) @ rows @ here.v
    return here._replace(x=np.concatenate([here.x[: here.system.nq], here.v - change]))


def _wrong_way(here: Situation, snapshot: Snapshot, tried: set[Key], allowed: float) -> tuple[Mode, Key | None]:
    """The mode with a joint held again that would start against its own slip, or into its stop."""
    system, mode, x, _ = here
    for k in system.lockable:
        if k in mode.locked or x[system.nq + k] != 0.0 or ("held", k) in tried:
            continue
        a = float(snapshot.a[k, 0])
        slip = mode.slip.get(k, 0.0) if k in system.has_friction else 0.0
        least, greatest = system.torque_range(k, x)
        into_stop = (greatest == math.inf and a < -allowed) or (least == -math.inf and a > allowed)
        if slip * a < -allowed or into_stop:
            return mode.locking(k), ("held", k)
        if k in system.has_friction and not slip and abs(a) > allowed:  # constraints held it, and do no more
            return mode.freeing(k, math.copysign(1.0, a)), ("held", k)
    return mode, None
