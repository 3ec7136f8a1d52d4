"""Along a solution: accelerations, torques of effects, friction and locks, forces on links, contact forces."""

from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np

from twolink.algorithms.motion import KinematicState
from twolink.algorithms.namespaces import Numbers
from twolink.algorithms.spatial import ZERO, Scalar, Vec, add, outward
from twolink.effects.effect import Loads
from twolink.integrate.hybrid.force_share import within_laws
from twolink.integrate.hybrid.snapshot import Evaluator
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.formulas import motion_of
from twolink.integrate.motion.state import Array
from twolink.io.text import kebab_case


def accelerations_and_joint_torques(equations: Equations, t: Array, x: Array) -> tuple[Array, Array]:
    """Accelerations and applied joint torques at states of one smooth segment.

        M(q) a + h(q, v) = tau + J^T f_ext + J_c^T lambda

    Without external wrenches f_ext and constraint forces lambda, tau is RNEA(q, v, a).

    Parameters
    ----------
    equations : Equations
        Equations of the segment; their start holds the numbers of the segment behind (q, v).
    t : ndarray (n,)
        Times, s.
    x : ndarray (nq + nv, n) or (size, n)
        States (q, v), with or without the numbers of the segment behind them.

    Returns
    -------
    a : ndarray (nv, n)
        Accelerations, in the tangent space, per s^2.
    tau : ndarray (nv, n)
        Joint torques and forces of effects, dry friction and locks, N m or N.
    """
    snapshot = Evaluator(equations).by_numpy(t, equations.full(x))
    tau = snapshot.tau.copy()
    tau[list(equations.layout.lockable)] += snapshot.locks
    return snapshot.a, tau


def contacts(equations: Equations, t: Array, x: Array) -> list[tuple[str, Array, Array]]:
    """The contacts of bodies at states x (nq + nv, n) of one segment.

    Where forces are not determined they are the smallest ones, or the share that obeys the laws where those do not.

    Returns
    -------
    list of (str, ndarray (3, n), ndarray (3, n))
        Of each, the pair of bodies, the point where it acts, m, and the force on the first body, N; world's axes.
    """
    constraints, found = equations.constraints, list[tuple[str, Array, Array]]()
    if constraints is None or not constraints.touching:
        return found
    states, motion, numbers = _moving(equations, t, x)
    every = constraints.all_multipliers(Evaluator(equations).by_numpy(t, states).multipliers)
    if len(constraints.kept) < len(constraints.all_rows):
        every = within_laws(equations, constraints.touching, t, states, np.array(every, dtype=float))
    loops = equations.layout.with_numbers(constraints.loops, numbers)
    for loop, rows in zip(loops, np.split(every, np.cumsum(constraints.counts)[:-1]), strict=True):
        contact = loop.contact_force(motion, list(rows))
        if contact is not None:
            pair, point, force = contact
            found.append((pair, _rows(point, len(t)), _rows(force, len(t))))
    return found


def contact_slips(equations: Equations, t: Array, x: Array) -> list[tuple[str, Array, Array]]:
    """As `contacts`, with slips in place of forces: the tangential velocity of the first body on the second, m/s."""
    (_, motion, numbers), found = _moving(equations, t, x), list[tuple[str, Array, Array]]()
    loops = equations.constraints.loops if equations.constraints else ()
    for loop in equations.layout.with_numbers(loops, numbers):
        contact = loop.contact_force(motion, (0.0,) * loop.max_rows)
        if contact is not None:
            found.append((contact[0], _rows(contact[1], len(t)), _rows(loop.contact_slip(motion), len(t))))
    return found


def _moving(equations: Equations, t: Array, x: Array) -> tuple[Array, KinematicState, list[Any]]:
    """States (size, n), the moving robot in them, and their numbers behind (q, v, z)."""
    states = equations.full(x)
    return states, motion_of(equations, equations.mechanism, t, states, Numbers), list(states[equations.moving :])


def _rows(vector: Vec, count: int) -> Array:
    """A vector whose entries are numbers or rows as (3, count)."""
    return np.array([np.broadcast_to(entry, count) for entry in vector])


class _WrenchesOnLinks(Loads):
    """Loads that note each force on a link, where it acts, and the moment about that point, along the world's axes."""

    def __init__(self, motion: KinematicState, sides: Sequence[Scalar] | None) -> None:
        super().__init__(motion, sides)
        self.noted: list[tuple[str, Vec, Vec, Vec]] = []

    def force(self, frame: str, force: Vec, moment: Vec = ZERO, point: Vec = ZERO, *, lever: Vec = ZERO,
              axes: Literal["world", "frame"] = "world") -> None:  # fmt: skip
        """Note a force and a moment at a point of a frame."""
        motion = self._motion
        if motion.frame(frame)[0] == 0:
            return
        if axes == "frame":
            force, moment, lever = (motion.direction(frame, one) for one in (force, moment, lever))
        self.noted.append((frame, add(motion.position(frame, point), lever), force, moment))

    def wrench(self, body: int, force: Vec, moment: Vec) -> None:
        """Note a force and a moment at the origin of a body's joint, which are along the body's axes."""
        place = self._motion.body(body)
        self.noted.append((self._motion.model.names[body], place.origin, outward(place, force), outward(place, moment)))


def wrenches_on_links(equations: Equations, t: Array, x: Array) -> list[tuple[str, Array, Array, Array]]:
    """The wrenches of effects on links at states x (nq + nv, n) of one segment, without gravity, contacts and loops.

    Returns
    -------
    list of (str, ndarray (3, n), ndarray (3, n), ndarray (3, n))
        Of each, the effect and the link, the point where it acts, m, the force, N, and the moment about the point, N m;
        world's axes.
    """
    (_, motion, numbers), found = _moving(equations, t, x), list[tuple[str, Array, Array, Array]]()
    for effect in equations.layout.with_numbers(equations.effects, numbers):
        loads = _WrenchesOnLinks(motion, equations.sides)
        effect.act(motion, loads)
        for link, point, force, moment in loads.noted:
            name = f"{kebab_case(type(effect).__name__)} on {link}"
            found.append((name, _rows(point, len(t)), _rows(force, len(t)), _rows(moment, len(t))))
    return found


Acting = Sequence[tuple[Any, ...]]  # of each its name, point and vectors (3, n)
MARKS: dict[str, Callable[[Equations, Array, Array], Acting]] = {
    "contacts": contacts, "contact_slips": contact_slips, "wrenches_on_links": wrenches_on_links,
}  # fmt: skip
