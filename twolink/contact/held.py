"""Steps in which the points that pressed in the step before do so again: one program.

    v+ = v_free + M^-1 J^T P,   G P = -(J v_free + c) where all stick, else by `cone_newton`

Where P obeys the laws and no other point closes, this is the step; else the contact problem is solved (`impulses`). For
few points of bodies on planes, such as feet. Many steps are computed one after the other, and then all are looked at:
those from the first that does not obey the laws on are thrown away.
"""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from twolink.algorithms.mechanism import mechanism
from twolink.contact.bodies import Multibody
from twolink.contact.held_step import held_step
from twolink.contact.impulses import EXACT, Impulses
from twolink.contact.joints import JointPoints, Laws
from twolink.contact.steps import STILL, Memory, Step, StepPlan, along
from twolink.geometry.detection import Detector, OnPlanes
from twolink.geometry.gaps import PlaneGap, axes_of
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.state import Array
from twolink.native.machine import Program, trace
from twolink.native.programs import arrays_named

FEW = 12  # points on planes, up to which they are compiled
SLIDERS = 4  # points that may slide, up to which they are: compiling takes as the cube of their number
MOST = 64  # steps that are looked at together


class HeldContacts(NamedTuple):
    """Points that press: the function of their steps, their keys and friction (k,), static where they stick, and
    their axes (k, 3, 3), the normal last. faces (k,): whether others of the pair press. slides: whether they may."""

    function: Program
    keys: Array
    mu: Array
    axes: Array
    faces: Array
    slides: bool


class HeldRun:
    """Steps of lengths h (n,) one after the other, up to the first that does not obey the laws.

    rows (n, ...): what the function says of each: w+, w' of it and of the step before, q+, P and U (k, 3), places
    (k, 3), by how much P misses the laws (k, 3), m/s, and the gaps of all points at the end, the pressing ones first.
    joints: whose stops are not met. before: the memory that the first begins with.
    """

    def __init__(
        self, held: HeldContacts, h: Array, rows: Array, nq: int, nv: int, joints: JointPoints, before: Memory
    ) -> None:
        self.held, self.h, k, self.unfollowed = held, h, len(held.keys), before.unfollowed
        cuts = list(itertools.accumulate((nv, 2 * nv, nq, 3 * k, 3 * k, 3 * k, 3 * k)))
        parts = [rows[:, a:b] for a, b in zip([0, *cuts], [*cuts, rows.shape[1]], strict=True)]
        self.v, changes, self.q, p, u, places, self.miss, ends = parts
        self.change = changes.reshape(len(h), 2, nv)
        self.p, self.u, self.places = (x.reshape(len(h), k, 3) for x in (p, u, places))
        self.on_first = np.einsum("nki,kij->nkj", self.p, held.axes)
        normal = self.p[:, :, 2]
        inside = (normal > 0.0) & (held.slides | ((self.p[:, :, :2] ** 2).sum(axis=2) <= (held.mu * normal) ** 2))
        free = (ends[:, k:] > 0.0).all(axis=1) & (joints.gaps(self.q) > 0.0).all(axis=1)
        obeys = inside.all(axis=1) & free & (np.abs(self.miss).max(axis=1) <= EXACT)
        self.overlap = np.maximum(-ends.min(axis=1), 0.0)
        self.length = len(h) if obeys.all() else int(obeys.argmin())
        self.ahead = min(2 * before.ahead, MOST) if obeys.all() else 0  # what ended it ends it again

    def __len__(self) -> int:
        return self.length

    def __getitem__(self, j: int) -> Step:
        """The step j."""
        h, held, mean = float(self.h[j]), self.held, self.change[j, 0]
        stuck, still = np.hypot(*self.u[j, :, :2].T) < STILL, np.abs(self.u[j, :, 2]) < STILL
        memory = Memory(held.keys, self.p[j] / h, stuck, still, self.change[j],
                        unfollowed=self.unfollowed, ahead=self.ahead)  # fmt: skip
        return Step(h, self.q[j], self.v[j], mean, memory, held.keys, self.places[j].copy(), self.on_first[j],
                    overlap=float(self.overlap[j]), slips=along(self.u[j, :, :2], held.axes[:, :2]))  # fmt: skip

    @property
    def impulses(self) -> Impulses:
        """Impulses of all steps, with their misses of the laws."""
        p, u = self.p[: self.length], self.u[: self.length]
        largest = float(np.abs(self.miss[: self.length]).max())
        slip = self.held.mu * p[:, :, 2] * np.hypot(u[:, :, 0], u[:, :, 1]) + (p[:, :, :2] * u[:, :, :2]).sum(axis=2)
        along = self.miss[: self.length].reshape(p.shape)[:, :, 2]
        power = max(float(np.abs(p[:, :, 2] * along).max()), float(np.abs(slip).max()))
        return Impulses(p, u, largest, power, largest, "held")


class HeldSteps:
    """Compiled steps of a scene by the points that press."""

    def __init__(self, bodies: Multibody, detector: Detector, joints: JointPoints, laws: Laws) -> None:
        self.equations, self.joints = bodies.equations, joints
        self.static, self.friction = laws.static, laws.friction
        group = detector.groups[0] if len(detector.groups) == 1 else None
        simple = type(bodies) is Multibody
        self.group = group if type(group) is OnPlanes and len(group.key) <= FEW and simple else None
        self._known: dict[tuple[bytes, bool], HeldContacts] = {}

    def of(self, memory: Memory) -> HeldContacts | None:
        """The steps in which the points that pressed do so again; None where they are not compiled."""
        group, keys, slides = self.group, memory.keys, not memory.stuck.all()
        presses = memory.forces[:, 2] > 0.0
        if not len(keys) or keys[-1] >= self.joints.first_key:  # a joint at its stop, or with friction
            return None
        if presses.any() and not presses.all():
            return None
        if group is None or 3 * len(keys) > self.equations.robot.nv:
            return None
        known = keys.tobytes(), slides
        if known not in self._known:
            order = np.argsort(group.key)
            chosen = order[np.searchsorted(group.key, keys, sorter=order)]
            pair = group.pair[chosen]
            faces = np.bincount(pair)[pair] > 1
            mu = self.static[pair]
            if slides and (len(keys) > SLIDERS or (mu != self.friction[pair]).any()):
                return None
            sliding = mu.tolist() if slides else []
            content = repr((group.gaps, chosen.tolist(), faces.tolist(), sliding))
            digest = hashlib.sha256(content.encode()).hexdigest()
            name = self.equations.key("held", digest[:32])  # of a file
            function = _program(name, self.equations, group.gaps, chosen, faces, sliding)
            normals = np.array([group.gaps[i].normal for i in chosen.tolist()])
            self._known[known] = HeldContacts(function, keys, mu, axes_of(normals), faces, slides)
        held = self._known[known]
        return held if memory.still[held.faces].all() else None

    def run(self, held: HeldContacts, plan: StepPlan, steps: slice, q: Array, w: Array, memory: Memory) -> HeldRun:
        """The steps of a plan from a state on."""
        h = plan.h[steps]
        moves = np.stack([~memory.stuck, ~memory.stuck, ~memory.still], axis=1)  # in place of U
        start = np.concatenate([w, memory.change.ravel(), q, h[0] * memory.forces.ravel(), moves.ravel()])
        state = slice(len(start))
        into = np.empty((len(h), len(start) + 2 + plan.numbers.shape[1]))
        into[0, state] = start
        into[:, state.stop] = plan.t[steps] + 0.5 * h
        into[:, state.stop + 1] = h
        into[:, state.stop + 2 :] = plan.numbers[plan.piece[steps]]
        rows = np.empty((len(h), held.function.outputs))
        rows[0] = held.function(into[0])
        for one, before, out in zip(into[1:], rows[:-1], rows[1:], strict=True):
            one[state] = before[state]
            out[:] = held.function(one)
        return HeldRun(held, h, rows, len(q), len(w), self.joints, memory)


def _program(
    name: str, equations: Equations, gaps: Sequence[PlaneGap], chosen: Array, faces: Array, mu: list[float]
) -> Program:
    """The program of (w, w' of two steps, q, P, U, t, h, numbers).

    It is compared with nothing before its first use: rounding decides among the forces of points that have more of them
    than motions, and each step is held against the laws before it counts.
    """
    space, mech = equations.space, mechanism(equations.robot.model)

    def formula(x: Array, xp: Any) -> list[Any]:
        return held_step(equations, mech, gaps, chosen, faces.tolist(), mu, list(x), xp)

    count = 2 + 2 * space.nv + 6 * len(chosen) + space.size
    return Program(arrays_named(name, lambda: trace(formula, count))[0])
