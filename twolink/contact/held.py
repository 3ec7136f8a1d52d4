"""Steps in which the points that pressed and stuck in the step before do so again: one compiled function.

    v+ = v_free + M^-1 J^T P,   J v+ + c = 0,   G P = -(J v_free + c)

Where P is within the cones of friction and no other point closes, this obeys the laws; else the contact problem is
solved (`impulses`). For few points of bodies on planes, such as feet. Many steps are computed one after the other, and
then all are looked at: those from the first that does not obey the laws on are thrown away.
"""

from __future__ import annotations

import hashlib
import itertools
from typing import Any, NamedTuple

import numpy as np

from twolink.algorithms.mechanism import mechanism
from twolink.algorithms.namespaces import Expressions
from twolink.contact.detection import Detector
from twolink.contact.formulas import OnPlanes
from twolink.contact.held_step import held_step
from twolink.contact.impulses import EXACT, Impulses
from twolink.contact.joints import JointPoints
from twolink.contact.multibody import Multibody, axes_of
from twolink.contact.plan import Plan
from twolink.contact.points import CLOSED
from twolink.contact.step import Memory, Step
from twolink.dynamics.kernels import heyoka
from twolink.integrate.compile_time import UNOPTIMIZED, compiling_seconds, is_reproducible
from twolink.integrate.compiled_functions import compiled_function, is_at_hand
from twolink.integrate.equations import Equations
from twolink.integrate.first_steps import count, spent
from twolink.integrate.state import Array

FEW = 12  # points on planes, up to which they are compiled
STEP = 1.5e-3  # s of a step that is not compiled, roughly
SIZE = 1.5  # of the compiled step, in evaluations of the equations of motion that compile as slowly


class Held(NamedTuple):
    """Points that stick: the function of their steps, their keys, pairs and static friction (k,), and their axes
    (k, 3, 3), the normal last."""

    function: Any
    keys: Array
    pair: Array
    static: Array
    axes: Array


class HeldRun:
    """Steps of lengths h (n,) one after the other, up to the first that does not obey the laws.

    rows (n, ...): what the function says of each: w+, w', q+, P and U (k, 3), places (k, 3), gaps (k,), nu (k,), which
    removes overlap, and the gaps of all points at the end, those that stick first. joints: whose stops are not met.
    """

    def __init__(self, held: Held, h: Array, rows: Array, nq: int, nv: int, joints: JointPoints) -> None:
        self.held, self.h, k = held, h, len(held.keys)
        cuts = list(itertools.accumulate((nv, nv, nq, 3 * k, 3 * k, 3 * k, k, k)))
        parts = [rows[:, a:b] for a, b in zip([0, *cuts], [*cuts, rows.shape[1]], strict=True)]
        self.v, self.mean, self.q, p, u, places, gaps, nu, ends = parts
        self.p, self.u, self.places = (x.reshape(len(h), k, 3) for x in (p, u, places))
        self.impulse = np.einsum("nki,kij->nkj", self.p, held.axes)
        normal = self.p[:, :, 2]
        inside = (normal > 0.0) & ((self.p[:, :, :2] ** 2).sum(axis=2) <= (held.static * normal) ** 2)
        apart = (gaps.min(axis=1) >= -CLOSED) | (nu.min(axis=1) >= 0.0)
        free = (ends[:, k:] > 0.0).all(axis=1) & (joints.gaps(self.q) > 0.0).all(axis=1)
        obeys = inside.all(axis=1) & apart & free & (np.abs(u).max(axis=1) <= EXACT)
        self.overlap = np.maximum(-ends.min(axis=1), 0.0)
        self.length = len(h) if obeys.all() else int(obeys.argmin())

    def __len__(self) -> int:
        return self.length

    def __getitem__(self, j: int) -> Step:
        """The step j."""
        h, held, mean = float(self.h[j]), self.held, self.mean[j]
        memory = Memory(held.keys, self.p[j] / h, np.ones(len(held.keys), dtype=bool), mean)
        return Step(h, self.q[j], self.v[j], mean, memory, held.pair, self.places[j].copy(), self.impulse[j],
                    overlap=float(self.overlap[j]))  # fmt: skip

    @property
    def worth(self) -> Impulses:
        """How far the impulses of all steps miss the laws."""
        p, u = self.p[: self.length], self.u[: self.length]
        largest = float(np.abs(u).max())
        return Impulses(p, u, largest, float(np.abs(p * u).max()), largest, "held")


class HeldSteps:
    """Compiled steps of a scene by the points that stick."""

    def __init__(self, bodies: Multibody, detector: Detector, joints: JointPoints) -> None:
        self.equations, self.static, self.joints = bodies.equations, detector.static, joints
        group = detector.groups[0] if len(detector.groups) == 1 else None
        simple = type(bodies) is Multibody and heyoka() is not None
        self.group = group if isinstance(group, OnPlanes) and len(group.key) <= FEW and simple else None
        self._known: dict[bytes, Held] = {}

    def of(self, keys: Array) -> Held | None:
        """The steps in which the points with these keys stick; None where they are not compiled."""
        group = self.group
        if not len(keys) or keys[-1] >= self.joints.first_key:  # a joint at its stop, or with friction
            return None
        if group is None or 3 * len(keys) > self.equations.robot.nv or is_reproducible():
            return None
        content = keys.tobytes()
        if content not in self._known:
            order = np.argsort(group.key)
            chosen = order[np.searchsorted(group.key, keys, sorter=order)]
            points = (group.joint, group.local, group.radius, group.normal, group.height, chosen)
            digest = hashlib.sha256(repr([x.tolist() for x in points]).encode()).hexdigest()
            name = self.equations.key("held", digest[:32])  # of a file
            if not is_at_hand(name) and spent(name) < compiling_seconds(SIZE * self.equations.operations):
                count(name, STEP)
                return None
            function = compiled_function(name, lambda: _compiled(self.equations, group, chosen))[0]
            pair = group.pair[chosen]
            self._known[content] = Held(function, keys, pair, self.static[pair], axes_of(group.normal[chosen]))
        return self._known[content]

    def run(self, held: Held, plan: Plan, steps: slice, q: Array, w: Array, change: Array) -> HeldRun:
        """The steps of a plan from a state on."""
        h, nq, nv = plan.h[steps], len(q), len(w)
        into = np.empty((len(h), 2 * nv + nq + 2 + plan.numbers.shape[1]))
        state = slice(2 * nv + nq)
        into[0, state] = np.concatenate([w, change, q])
        into[:, state.stop] = plan.t[steps] + 0.5 * h
        into[:, state.stop + 1] = h
        into[:, state.stop + 2 :] = plan.numbers[plan.piece[steps]]
        rows = np.empty((len(h), held.function.nouts))
        held.function(into[0], outputs=rows[0])
        for one, before, out in zip(into[1:], rows[:-1], rows[1:], strict=True):
            one[state] = before[state]
            held.function(one, outputs=out)
        with np.errstate(over="ignore", invalid="ignore"):  # as steps that are too long
            return HeldRun(held, h, rows, nq, nv, self.joints)


def _compiled(equations: Equations, group: OnPlanes, chosen: Array) -> Any:
    """heyoka's function of (w, w', q, t, h, numbers)."""
    module = heyoka()
    xp, space = Expressions(module), equations.space
    x = [module.expression(f"x{i}") for i in range(2 + space.nq + 2 * space.nv + space.size - space.moving)]
    values = held_step(equations, mechanism(equations.robot.model), group, chosen, x, xp)
    return module.cfunc([xp.lift(value) for value in values], vars=x, **UNOPTIMIZED)
