"""Equations: what a scene's effects make of its robot, x' = f(t, x), twice: Pinocchio's numbers and expressions."""

from __future__ import annotations

import contextlib
import copy
import functools
import itertools
import weakref
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np
import pinocchio as pin

from twolink.dynamics import Robot, cache
from twolink.dynamics.counting import Tape
from twolink.dynamics.functions import function
from twolink.dynamics.mechanism import Mechanism, mechanism
from twolink.effects import Effect
from twolink.effects.inputs import tables_of, with_pieces
from twolink.effects.loop import Loop
from twolink.effects.motion import Loads, Motion
from twolink.errors import QueryError, SceneError
from twolink.integrate.loops import Loops
from twolink.integrate.namespaces import Numbers
from twolink.integrate.solution import Solution, joined
from twolink.integrate.state import Array, StateSpace
from twolink.scenes import Scene

NUDGE = 1e-15  # relative: about what a few roundings change
CLOSE = 1e-14  # relative: breaks nearer to each other than this are one, for no step resolves them


class _WithRows(StateSpace):
    """States (q, v, c): c are the numbers that tables are made of at the time. They stand still within a piece."""

    def __init__(self, robot: Robot, rows: int) -> None:
        super().__init__(robot)
        self.size += rows
        self.absolute = np.arange(self.size) < self.nq

    def rows(self, x: Array) -> tuple[Array, Array]:
        return super().rows(x[: self.nq + self.nv])

    def rate(self, q: Array, v: Array) -> Array:
        return super().rate(q, v[: self.nv])


class Equations:
    """The equations of motion of a scene of smooth forces: q' from v on the manifold, v' = M^-1 (tau - h + J^T f).

    space: the states x = (q, v). start: the initial one (size,). effects: those that act on the moving robot; what
    changes its constants is in the robot already. parameters: physical constants kept as run-time inputs.
    assembled: how far the start was moved to close the loops, rad, m or per second.

    Between breaks a table of samples is one polynomial. Its coefficients ride along behind (q, v), in x[moving:], at
    rate 0: so that one compiled step serves all pieces of tables of any length. `in_pieces` sets them break by break.
    """

    def __init__(self, scene: Scene, parameters: Sequence[str] = ()) -> None:
        self.robot = scene.robot
        if self.robot.has_mimic:
            raise SceneError("mimic joints cannot be simulated yet", where="robot", remedy="load it with mimic=False")
        self.effects = tuple(e for e in scene.effects if type(e).act is not Effect.act)
        self.tables = tuple({id(table): table for e in self.effects for table in tables_of(e)}.values())
        rows = sum(table.rows for table in self.tables)
        self.space = _WithRows(self.robot, rows) if rows else StateSpace(self.robot)
        self.moving = self.robot.nq + self.robot.nv
        self.parameters = tuple(parameters)
        self.start = np.concatenate([scene.q, scene.v, self.rows_at(0.0)])
        self._tau = np.zeros(self.robot.nv)
        loops = [e for e in scene.effects if isinstance(e, Loop)]
        self.loops = Loops(self.space, loops, self._numbers) if loops else None
        self.assembled = 0.0
        if self.loops is not None:
            given = self.start[: self.moving].copy()
            self.start[: self.moving] = self.loops.assembled(given)
            self.assembled = float(np.abs(self.start[: self.moving] - given).max(initial=0.0))
            if not self.loops.kept:
                self.loops = None  # constraints that constrain nothing

    @property
    def analytic(self) -> bool:
        """Whether the equations are smooth to any order, as Taylor's method needs."""
        return self.loops is None and all(effect.analytic for effect in self.effects)

    def breaks(self, duration: float) -> tuple[float, ...]:
        """The times below the duration at which the equations are not smooth, increasing."""
        times = {t for effect in self.effects for t in effect.breaks(duration)}
        times.update(t for table in self.tables for t in table.times)
        found: list[float] = []
        for t in sorted(t for t in times if 0 < t < duration * (1.0 - CLOSE)):
            if not found or t > found[-1] * (1.0 + CLOSE):
                found.append(t)
        return tuple(found)

    def rows_at(self, t: float) -> Array:
        """The numbers that make the tables' pieces at a time, (size - moving,)."""
        return np.concatenate([np.empty(0), *(table.rows_at(t) for table in self.tables)])

    def in_pieces(self, times: Array, solve: Callable[[Equations, Array], Solution]) -> Solution:
        """Solve from break to break for the samples `times` (n,): no step goes across one.

        Each piece is a solve of its own, by `solve(equations, times)`, from the state at its beginning.
        """
        start, end = float(times[0]), float(times[-1])
        for table in self.tables:
            table.require(start, end)
        edges = [start, *(t for t in self.breaks(end) if t > start), end]
        if len(edges) == 2 and not self.tables:
            return solve(self, times)
        if len(edges) > 2:  # found once for all pieces: copies have what the original had
            _ = self._numbers, self._formula, self._content
        parts: list[Solution] = []
        x: Any = self.start
        for begin, stop in itertools.pairwise(edges):
            first, after = np.searchsorted(times, [begin, stop], side="right")
            inside = times[first:after]
            extra = not inside.size or inside[-1] < stop  # the break is no sample
            grid = np.concatenate([[begin], inside, [stop] if extra else []])
            part = solve(self._from(x, 0.5 * (begin + stop)), grid)
            x = part.x[:, -1] if part.precise is None else part.precise[-1]
            taken = slice(int(bool(parts)), len(part.t) - int(extra and len(part.t) == len(grid)))
            parts.append(replace(part, t=part.t[taken], x=part.x[: self.moving, taken],
                                 precise=None if part.precise is None else part.precise[taken]))  # fmt: skip
            if part.interrupted:
                break
        return joined(parts)

    def nudged(self) -> Equations:
        """The same equations from a start some roundings away: what becomes of those, rounding does on the way too."""
        moved = copy.copy(self)
        moved.start = self.start.copy()
        signs = np.where(np.arange(self.moving) % 2, -1.0, 1.0)
        moved.start[: self.moving] += NUDGE * signs * np.fmax(1.0, np.abs(self.start[: self.moving]))
        return moved

    def _from(self, x: Any, t: float) -> Equations:
        """The same equations from another state on, with the tables' pieces of a time within."""
        if not self.tables and x is self.start:
            return self
        piece = copy.copy(self)
        rows = self.rows_at(t)
        piece.start = np.concatenate([x[: self.moving], rows.astype(x.dtype)]) if rows.size else x
        return piece

    def _now(self, effects: Sequence[Effect], rows: Sequence[Any]) -> Sequence[Effect]:
        """The effects with polynomials of these coefficients in the place of their tables."""
        if not self.tables:
            return effects
        pieces, at = {}, 0
        for table in self.tables:
            pieces[id(table)] = table.piece_of(rows[at : at + table.rows])
            at += table.rows
        return [with_pieces(effect, lambda table: pieces[id(table)]) for effect in effects]

    def loads(self, mech: Mechanism, q: Any, v: Any, t: Any, xp: Any, effects: Sequence[Effect] | None = None) -> Loads:
        """What the effects add up to: torques and wrenches. Of one effect: effects=[it], for its work, say."""
        motion = Motion(self.robot.model, mech, q, v, t, xp)
        loads = Loads(motion)
        for effect in self.effects if effects is None else effects:
            effect.act(motion, loads)
        return loads

    def rate(self, t: Any, x: Array) -> Array:
        """x' (size, n) of states x (size, n), by Pinocchio. NaN where a state is not finite."""
        nq = self.space.nq
        q, v = self.space.rows(x)
        with np.errstate(all="ignore"):
            fine = np.isfinite(x).all(axis=0)
        acceleration = np.full_like(v, np.nan)
        if fine.any():
            at = t if np.ndim(t) == 0 else t[fine]
            acceleration[fine] = self._accelerations(at, q[fine], v[fine], list(x[self.moving :, fine]))
        still = np.zeros((len(x) - self.moving, x.shape[1]))
        return np.concatenate([self.space.rate(x[:nq], x[nq:]), acceleration.T, still])

    def settled(self, x: Array, xp: Any, constants: Mapping[str, Any] | None = None) -> Array:
        """x back on its manifold: unit lengths, and closed loops."""
        x = self.space.normalized(x, xp)
        if self.loops is None:
            return x
        mech = self._numbers if xp is Numbers else mechanism(self.robot.model, constants)
        return np.concatenate([self.loops.projected(mech, x[: self.moving], xp), x[self.moving :]])

    def _accelerations(self, t: Any, q: Array, v: Array, rows: Sequence[Array]) -> Array:
        if self.loops is not None:
            return self._looped(self.loops, t, q, v, rows)
        if not self.effects:
            with contextlib.suppress(QueryError):  # one state that overflows: the others are answered one by one
                return np.asarray(self.robot.forward_dynamics(q, v, self._tau, engine="pinocchio"))
        with np.errstate(all="ignore"):  # what is not finite is said below
            effects = self._now(self.effects, rows)
            loads = self.loads(self._numbers, list(q.T), list(v.T), t, Numbers, effects)
        tau = np.zeros(v.shape)
        for k, value in enumerate(loads.tau):
            tau[:, k] = value
        model, data, out = self.robot.model, self.robot.data, np.empty_like(v)
        wrenches = {i: np.stack(np.broadcast_arrays(*w, q[:, 0])[:6], axis=1) for i, w in loads.wrenches.items()}
        forces = pin.StdVec_Force()
        forces.extend(pin.Force.Zero() for _ in range(model.njoints))
        for row in range(len(q)):
            for i, wrench in wrenches.items():
                forces[i] = pin.Force(wrench[row])
            out[row] = pin.aba(model, data, q[row], v[row], tau[row], forces)
        return out

    def _looped(self, loops: Loops, t: Any, q: Array, v: Array, rows: Sequence[Array]) -> Array:
        model, data, out = self.robot.model, self.robot.data, np.empty_like(v)
        times = np.broadcast_to(t, len(q))
        for row in range(len(q)):
            effects = self._now(self.effects, [values[row] for values in rows])
            loads = self.loads(self._numbers, list(q[row]), list(v[row]), float(times[row]), Numbers, effects)
            forces = pin.StdVec_Force()
            forces.extend(pin.Force.Zero() for _ in range(model.njoints))
            for i, wrench in loads.wrenches.items():
                forces[i] = pin.Force(np.array(wrench, dtype=float))
            bias = pin.rnea(model, data, q[row], v[row], self._tau, forces)
            out[row] = loops.reference_acceleration(q[row], v[row], np.array(loads.tau, dtype=float), bias)
        return out

    @functools.cached_property
    def _numbers(self) -> Mechanism:
        return mechanism(self.robot.model)

    def traced_rate(self, t: Any, x: Array, xp: Any, constants: Mapping[str, Any] | None = None) -> Array:
        """x' (size,) as expressions of x (size,), traced over the robot's constants."""
        nq = self.space.nq
        # Stages stray from unit lengths: there the acceleration is that of the nearest configuration, as in `rate`.
        unit = self.space.normalized(x, xp)
        acceleration = self._traced(mechanism(self.robot.model, constants), self._formula[0], t, unit, xp, self.effects)
        still = [0.0] * (self.space.size - self.moving)
        lifted = np.array([xp.lift(a) for a in (*acceleration, *still)], dtype=object)
        return np.concatenate([self.space.rate(x[:nq], x[nq:]), lifted])

    def _traced(self, mech: Mechanism, variant: int, t: Any, x: Any, xp: Any, effects: Sequence[Effect]) -> list[Any]:
        nq = self.space.nq
        q, v = list(x[:nq]), list(x[nq : self.moving])
        loads = self.loads(mech, q, v, t, xp, self._now(effects, list(x[self.moving :])))
        if self.loops is not None:
            return self.loops.accelerations(mech, _objects(q), _objects(v), loads.tau, loads.wrenches, xp)[0]
        given = {"q": q, "v": v, "tau": loads.tau, "f_ext": loads.wrenches}
        return list(function(self.robot.model, "forward_dynamics").variants[variant](mech, given, xp))

    def counts(self, variant: int, effects: Sequence[Effect]) -> dict[str, int]:
        """The operations of one evaluation of the accelerations with these effects, by kind."""
        tape = Tape()
        x = [tape.variable() for _ in range(self.space.size)]
        mech = mechanism(self.robot.model, {name: tape.variable() for name in self.parameters})
        return tape.count(self._traced(mech, variant, tape.variable(), x, tape, effects))

    @functools.cached_property
    def _formula(self) -> tuple[int, int]:
        """Which formula of forward dynamics has the fewest operations, and how many."""
        variants = len(function(self.robot.model, "forward_dynamics").variants)
        totals = [sum(self.counts(i, self.effects).values()) for i in range(variants)]
        return totals.index(min(totals)), min(totals)

    @property
    def operations(self) -> int:
        """Operations of one evaluation."""
        return self._formula[1]

    def shares(self) -> dict[int, int]:
        """What each acting effect adds to the operations of one evaluation, by its place among `effects`."""
        variant, total = self._formula
        without = {i: self.counts(variant, self.effects[:i] + self.effects[i + 1 :]) for i in range(len(self.effects))}
        return {i: total - sum(count.values()) for i, count in without.items()}

    def key(self, *parts: str) -> str:
        """A name for what is made of these equations: the model, the effects, our code, versions, the given parts."""
        return f"{self._content}-{'-'.join(parts)}"

    @functools.cached_property
    def _content(self) -> str:
        everything = (*self.effects, *(self.loops.loops if self.loops else ()))
        effects = [f"{type(e).__module__}.{type(e).__qualname__} {msgspec.json.encode(e)!r}" for e in everything]
        kept = self.loops.kept if self.loops else []
        return cache.key(self.robot.model, ("equations", *effects, str(kept), "|", *self.parameters))


def _objects(values: list[Any]) -> Array:
    """Scalars of any kind as an array."""
    out = np.empty(len(values), dtype=object)
    out[:] = values
    return out


_made: weakref.WeakKeyDictionary[Scene, Equations] = weakref.WeakKeyDictionary()


def equations_of(scene: Scene) -> Equations:
    """The equations of a scene, kept as long as the scene."""
    if scene not in _made:
        _made[scene] = Equations(scene)
    return _made[scene]
