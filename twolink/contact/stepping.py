"""One step in time of bodies that touch, and the run from step to step.

    q_m = q + h/2 v
    M (v+ - v) = h (tau - h_m) + J^T P        all at q_m
    0 <= P_n,  0 <= U_n+ + c,  P_n (U_n+ + c) = 0,   |P_t| <= mu P_n against U_t+
    c = 2 max(g_m, 0) / h,  at an impact  e U_n
    q+ = q_m + h/2 v+ + M^-1 J^T (s P + nu)

This is Moreau and Jean's method with theta = 1/2 and with the gaps g_m at the middle of the step: what is open there
closes at most to the end. Points that were closed have c = 0 on a face, or where g_m is below 1e-6 m. The impulse of
an impact that no lasting contact passes on acts from when in the step the bodies meet, s before its middle; nu removes
from the positions what overlap is left, and what contacts that last have drifted (`positions`; Acary, Brogliato:
Numerical Methods for Nonsmooth Dynamical Systems, 2008, chapter 10).

Contact impulses have the work P . (U- + U+) / 2, which is not positive where bodies close or slide and do not bounce.
Where bodies that bounce would create energy, they bounce by less (`step_law`), and the record counts it.
A contact that sticks begins a step with U- = h J' v, of any sign. The motion M^-1 J^T nu against its slip h/2 U- has
the work -P . U- / 2 - U- . G^-1 U- / 2, so that the energy does not grow but by terms of order h^3. The method is of
first order in h, and of second order where impacts are single and between them: so is the angular momentum about a
normal without friction, for what acts behind an impact acts at the velocity there. Stops and dry friction of joints are
points of the same problem (`joints`); loops leave it fewer motions (`loops`).

A step whose impulses do not obey the laws is taken as two, and refused where these are too small. So is one within
which points of a pair bounce one after the other: as one impact they would leave in another way.
"""

from __future__ import annotations

import copy
import functools
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from twolink.contact.bodies import Multibody, bodies_of
from twolink.contact.compiled import compiled
from twolink.contact.compiled_steps import take_steps
from twolink.contact.joints import JointPoints, Kept, LoopRows
from twolink.contact.positions import correction
from twolink.contact.rest import at_rest, steps_at_rest
from twolink.contact.step_law import StepLaw, rows_of
from twolink.contact.steps import STILL, Blow, Memory, OneStep, Record, Step, TakenSteps, along
from twolink.effects.contact import Contact
from twolink.effects.switching import JointLock, Stop
from twolink.errors import AccuracyError
from twolink.geometry.detection import Detector
from twolink.geometry.gaps import axes_of
from twolink.geometry.points import CLOSED, Places, Points, joined
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.state import Array
from twolink.integrate.steps.failures import failure
from twolink.native.contact import StepPlan

DEEPEST = 0.25  # of half the bodies' thickness: a step that brings bodies deeper into each other is taken as two
FARTHEST = 0.5  # of it: so is one half of which they move farther against each other, for they could pass through
HALVINGS = 10
FIRST_PART = 0.45  # of a step that is taken as two: halves of long steps would be the steps of a finer run
APART, APART_HALVINGS = 1e-6, 20  # of a step within which points of a pair bounce one after the other: it is halved
UNSEEN, UNSEEN_HALVINGS = 0.01, 6  # of the reach of a step: one after which hulls overlap by so much more is halved
POINTS_IN_PYTHON, IN_PYTHON = 10.0, 100.0  # times as long: steps whose points Python finds; those of NumPy


class ContactStepper:
    """Steps of a scene: its equations without contacts, its contact effects, and its joints' stops and friction.

    A step depends on the state and the memory that it begins with; of other steps there is only the record.
    """

    def __init__(
        self,
        equations: Equations,
        effects: Sequence[Contact],
        stops: Sequence[Stop] = (),
        locks: Sequence[JointLock] = (),
        loops: LoopRows | None = None,
    ) -> None:
        self.equations, self.model = equations, equations.robot.model
        pairs = [(pair, effect) for effect in effects for pair in effect.selected(equations.robot).chosen]
        self.detector = Detector(equations.robot, [pair for pair, _ in pairs])
        self.joints = JointPoints(stops, locks, len(self.detector.names))
        self.laws = self.joints.laws(self.detector, [effect for _, effect in pairs])
        self.loops, self.record = loops, Record()
        self.bodies = self._own_bodies()
        self.native = compiled(self.bodies, self.detector, self.joints, self.laws, loops)

    def _own_bodies(self) -> Multibody:
        return bodies_of(self.equations) if self.loops is None else Multibody(self.equations)

    @property
    def price(self) -> float:
        """About how many times as long a step takes as one that the native library takes alone."""
        return IN_PYTHON if self.native is None else POINTS_IN_PYTHON if self.native.uses_python else 1.0

    def another(self) -> ContactStepper:
        """A stepper of the same scene, for another motion and thread."""
        other = copy.copy(self)
        other.bodies, other.record = self._own_bodies(), Record()
        return other

    def starting_at(self, q: Array, v: Array) -> ContactStepper:
        """A stepper from another state on, of a scene without loops: they would have to be closed there."""
        other = self.another()
        other.equations = self.equations.starting_at(np.concatenate([q, v]), 0.0)
        for at_begin in ("begin", "overlap_at_begin"):
            vars(other).pop(at_begin, None)
        return other

    @functools.cached_property
    def begin(self) -> tuple[Array, Array, Memory]:
        """q, w and the memory at the start of a run: what touches and does not slip sticks."""
        q, local = self.equations.space.rows(self.equations.start)
        v = self.bodies.to_local_velocity(q, local, -1)
        points = self._points(self.bodies.places(q, local)[0], CLOSED, q)
        if not len(points.gap):
            return q, v, Memory.empty(np.zeros((2, len(v))))
        # The Jacobian takes the configuration of this.
        self.bodies.free_acceleration(0.0, q, v, self.equations.layout.numbers_at(0.0))
        speeds = (self._rows(points, axes_of(points.normal)) @ v).reshape(-1, 3)
        keys = np.sort(points.key[(points.gap < CLOSED) & (np.abs(speeds).max(axis=1) < STILL)])
        every = np.ones(len(keys), bool)
        return q, v, Memory.of(keys, np.zeros((len(keys), 3)), every, every, np.zeros((2, len(v))))

    @functools.cached_property
    def overlap_at_begin(self) -> tuple[float, str]:
        """`overlap` at the start of a run."""
        return self.overlap(self.begin[0])

    def overlap(self, q: Array) -> tuple[float, str]:
        """The largest overlap of bodies, m, or of joints with their stops, rad or m, and the pair; or gap of a loop."""
        deepest, pair = self.detector.overlap(self.bodies.places(q, np.zeros(self.model.nv))[0])
        joints = self.joints.points(q)
        if joints.gap.min(initial=0.0) < -deepest:
            deepest, pair = -float(joints.gap.min()), int(joints.pair[joints.gap.argmin()])
        open_ = 0.0 if self.loops is None else float(np.abs(self.loops.at(q)[0]).max())
        return (open_, "loops") if open_ >= deepest else (deepest, self.laws.names[pair])

    def normals(self, q: Array, reach: float) -> Array:
        """The rows (n, nv) of the rates of gaps below a reach, m."""
        still = np.zeros(self.model.nv)
        points = self._points(self.bodies.places(q, still)[0], reach, q)
        self.bodies.free_acceleration(0.0, q, still, self.equations.layout.numbers_at(0.0))  # the Jacobian is at its q
        rows = self._rows(points, axes_of(points.normal))
        return np.asarray(rows.toarray() if hasattr(rows, "toarray") else rows)[2::3]

    def notes(self) -> list[str]:
        """Notes on the rows in the contact problem besides pairs of bodies."""
        loops = [] if self.loops is None else [f"{len(self.loops.constraints.kept)} rows of loops hold at each step"]
        return [*self.joints.notes(), *loops]

    def _points(self, places: Places, reach: float, q: Array) -> Points:
        """The points with gaps below the reach, and behind them those of the joints."""
        points = self.detector.points(places, reach)
        return joined([points, self.joints.points(q)]) if self.joints else points

    def _rows(self, points: Points, axes: Array) -> Any:
        """J (3n, nv) of the points."""
        rows = self.bodies.jacobian(points, axes)
        return self.joints.with_rows(rows, points) if self.joints else rows

    def run(self, plan: StepPlan, steps: range, q: Array, v: Array, memory: Memory) -> TakenSteps:
        """One or more of the steps of a plan with these numbers: at rest, by the native library, or one.

        Raises as `advance`.
        """
        resting = steps_at_rest(self.bodies, plan, steps, memory)
        if resting is not None and resting.rest.step.impulses is not None:
            self.record.add(replace(resting.rest.step.impulses, solver="rest"), len(resting))
            return resting
        if self.native is not None:
            found = take_steps(self.native, self.bodies, plan, steps, q, v, memory)
            if found is not None:
                found.count_in(self.record)
                return found
        first = steps.start
        numbers = plan.numbers[plan.piece[first]]
        step = self.advance(float(plan.t[first]), float(plan.h[first]), q, v, numbers, memory)
        return OneStep(at_rest(self.bodies, plan, first, q, v, step, memory))

    @np.errstate(over="ignore", invalid="ignore")  # what steps that are too long give is refused ("step-too-large")
    def advance(
        self, t: float, h: float, q: Array, v: Array, numbers: Array, memory: Memory, depth: int = 0, bounces: int = 0
    ) -> Step:
        """One step, or two, where its laws are not reached or a pair bounces at two times within it.

        depth, bounces: how often a longer step was taken as two for the one reason, and for the other.
        Raises AccuracyError where steps are too small for their laws, or velocities are not finite.
        """
        step = self.step(t, h, q, v, numbers, memory)
        apart = step is not None and step.apart > APART and bounces < APART_HALVINGS
        if step is not None and not apart:
            _require_finite(step.v, t, h)
            step = self._checked(step, memory, halve=depth < UNSEEN_HALVINGS)
            if step is not None:
                self.record.add(step.impulses)
                self.record.softened += step.softened
                return step
        if not apart and depth == HALVINGS:
            raise AccuracyError("no impulses obey the laws of contact and friction within a step, at speeds up to "
                                f"{np.abs(v).max():.3g}", where=f"t = {t:.6g} s", code="contact-not-solved", t=t,
                                remedy="smaller steps, for forces may be too stiff for these; less friction; or shapes "
                                       "that do not start overlapping")  # fmt: skip
        self.record.halved += 1
        first, counts = FIRST_PART * h, (depth + (not apart), bounces + apart)
        one = self.advance(t, first, q, v, numbers, memory, *counts)
        return one.with_next(self.advance(t + first, h - first, one.q, one.v, numbers, one.memory, *counts))

    def _checked(self, step: Step, memory: Memory, *, halve: bool) -> Step | None:
        """The step with what hulls overlap at its end; None where it is to be halved for a contact that it has missed.

        A corner that comes in from beside a face is no point of the contact problem until it is over the face.
        """
        if self.detector.sees_all:
            return step
        places, speeds = self.bodies.places(step.q, self.bodies.to_local_velocity(step.q, step.v))
        overlap = self.detector.overlap(places)[0]
        if halve and overlap - memory.overlap > UNSEEN * self._reach(step.h, speeds):
            return None
        return replace(step, memory=step.memory.with_overlap(overlap))

    def _reach(self, h: float, speeds: Array) -> float:
        """The gap below which points count in a step, m: more than bodies move. speeds: of the joints (joints, 2)."""
        return 3.0 * h * float((speeds[:, 0] + speeds[:, 1] * self.detector.extent).max(initial=0.0)) + 100.0 * h * h

    def step(self, t: float, h: float, q: Array, v: Array, numbers: Array, memory: Memory) -> Step | None:
        """One step; None where its laws are not reached."""
        middle = self.bodies.moved(q, 0.5 * h * v)
        places, speeds = self.bodies.places(middle, self.bodies.to_local_velocity(middle, v))
        # By the mean of two steps: with that of the last alone, drag d is stable up to h d = 1 only, now up to 2.
        # The viscosity of joints is not in it: `bodies` takes it at the mean velocity of this step.
        change = 0.5 * h * memory.change.mean(axis=0)
        a = self.bodies.free_acceleration(t + 0.5 * h, middle, v + change, numbers, h, change)
        kept = self._kept(t, h, q, middle, v, a)
        free, a = kept.free, (kept.free - v) / h
        points = self._points(places, self._reach(h, speeds), middle)
        if not len(points.gap):
            none = Memory.empty(memory.changes(a, smooth=not len(memory.keys)), memory.unfollowed)
            end = self.bodies.moved(middle, 0.5 * h * free + kept.closing)
            return Step(h, end, free, a, none, points.key, points.position, np.empty((0, 3)))
        if (-points.gap > DEEPEST * self.laws.thickness[points.pair]).any():
            return None
        found = self._with_contacts(h, middle, v, kept, points, memory)
        if found is None or not found[0].blows:
            return None if found is None else found[0]
        step, law = found
        mean = self._mean_behind(t, h, middle, v, a, numbers, step)
        again = self._with_contacts(h, middle, v, self._kept(t, h, q, middle, v, mean), points, memory, law)
        return again[0] if again else step

    def _mean_behind(self, t: float, h: float, middle: Array, v: Array, a: Array, numbers: Array, step: Step) -> Array:
        """The mean w' of a step with an impact but for contacts: a before it, and behind it that at the velocity there.

        An impact at the time s before the middle has impulses that turn with the body from then on, s omega x tau.
        Without both, each impact changes the angular momentum about the normal by a part of h, without friction too.
        """
        blow = step.blows[0]
        behind = self.bodies.free_acceleration(t + 0.5 * h, middle, step.v, numbers, h, step.v - v)
        turned = self.bodies.inverse @ self.bodies.turning(v, blow.on_joints)
        return np.asarray((blow.late * a + (h - blow.late) * behind) / h + (0.5 - blow.late / h) * turned)

    def _kept(self, t: float, h: float, q: Array, middle: Array, v: Array, a: Array) -> Kept:
        """The end of a step without contacts, in which w' is a, with what loops leave."""
        free = v + h * a
        _require_finite(free, t, h)
        if self.loops is None:
            return Kept(free, self.bodies.inverse, 0.0)
        return self.loops.keep(self.bodies, q, middle, v, free)

    def _with_contacts(
        self, h: float, middle: Array, v: Array, kept: Kept, points: Points, memory: Memory,
        last: StepLaw | None = None,
    ) -> tuple[Step, StepLaw] | None:  # fmt: skip
        """The step and its law; None where that is not reached. last: the law of the same points to begin with."""
        axes, free = axes_of(points.normal), kept.free
        rows = self._rows(points, axes)
        before, after = ((rows @ x).reshape(-1, 3) for x in (v, free))
        if (0.5 * h * np.linalg.norm(before, axis=1) > FARTHEST * self.laws.thickness[points.pair]).any():
            return None
        law = StepLaw(self.laws, points, before, after, h, memory)
        if last is not None:
            law.guess, law.active = last.guess, law.active | (last.guess[:, 2] > 0.0)
        solution = law.without_gain(rows, kept.inverse, free)
        if solution is None:
            return None
        active, response, impulses, ends = solution
        u = (rows @ ends).reshape(-1, 3)
        pressing, shift = impulses.p[:, 2] > 0.0, response @ (law.late[active, None] * impulses.p).ravel()
        if np.abs((rows @ shift)[2::3][active][pressing & law.known[active]]).max(initial=0.0) > CLOSED:
            shift = np.zeros_like(shift)  # what lasts passes the impact on, and would act at another time than it
        move = 0.5 * h * ends + shift + kept.closing
        off = np.empty_like(before)
        off[:, :2] = 0.5 * h * (before + u)[:, :2]
        off[:, 2] = points.gap + (rows @ move).reshape(-1, 3)[:, 2]
        stuck = np.hypot(*impulses.u[:, :2].T) < STILL
        lasts = np.zeros(off.shape, dtype=bool)
        lasts[active, 2] = pressing & law.known[active] & law.rests[active]
        lasts[active, :2] = (lasts[active, 2] & stuck & law.stuck[active] & ~law.of_joints[active])[:, None]
        push = correction(kept.inverse, rows, off, lasts, law.rests)
        if push is None:
            return None
        move = move + push
        still = np.abs(u[active, 2]) < STILL
        closed = pressing | still & (np.abs(off[:, 2] + (rows @ push)[2::3])[active] < CLOSED)
        chosen, own = active[closed], impulses.p[closed]
        order, mean = np.argsort(points.key[chosen]), (ends - v) / h
        unfollowed = max(memory.unfollowed, law.unfollowed(rows, response, active, impulses.p))
        keys = points.key[chosen][order]
        smooth = np.array_equal(keys, memory.keys) and not law.hits[chosen].any()
        passed = Memory.of(keys, own[order] / h, stuck[closed][order], still[closed][order],
                           memory.changes(mean, smooth=smooth), unfollowed=unfollowed)  # fmt: skip
        pressed, blow = rows[rows_of(active[pressing])], law.blow(active[pressing], impulses.p[pressing])
        joints, chosen, p = self._of_joints(rows, law, active[pressing], impulses.p[pressing])
        blows = () if blow is None else (Blow(blow[0], points.key[blow[1]], along(blow[2], axes[blow[1]]),
                                              rows[rows_of(blow[1])].T @ blow[2].ravel()),)  # fmt: skip
        step = Step(h, self.bodies.moved(middle, move), ends, mean, passed, points.key[chosen], points.position[chosen],
                    along(p, axes[chosen]), impulses, joints=joints, slips=along(u[chosen, :2], axes[chosen, :2]),
                    blows=blows, rows=pressed, softened=law.share < 1.0, apart=law.apart(active[pressing]))  # fmt: skip
        return step, law

    def _of_joints(self, rows: Any, law: StepLaw, chosen: Array, p: Array) -> tuple[Array | None, Array, Array]:
        """The impulses on joints (nv,) of points with impulses, and what are points of bodies, with theirs."""
        if not self.joints:
            return None, chosen, p
        own = law.of_joints[chosen]
        return rows[rows_of(chosen[own])].T @ p[own].ravel(), chosen[~own], p[~own]


def _require_finite(v: Array, t: float, h: float) -> None:
    """Stiff forces are taken explicitly: steps that are too long for them let velocities grow beyond all numbers."""
    if not np.isfinite(v).all():
        raise failure("step-too-large", t, step=h)
