"""Equations: what a scene's effects make of its robot, x' = f(t, x), twice: Pinocchio's numbers and expressions."""

from __future__ import annotations

import copy
import functools
import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import msgspec
import numpy as np

from twolink.algorithms.functions import function
from twolink.algorithms.mechanism import Mechanism, mechanism
from twolink.algorithms.namespaces import Numbers
from twolink.algorithms.operation_count import Tape
from twolink.algorithms.recursions import composite_bodies, newton_euler, poses
from twolink.algorithms.sparse_factors import ldlt_solve
from twolink.algorithms.spatial import minus, plus, times
from twolink.dynamics import Robot
from twolink.effects import Effect
from twolink.effects.effect import plain
from twolink.effects.inputs import Slot, tables_of, with_pieces
from twolink.effects.loop import Loop
from twolink.effects.motion import Loads, Motion
from twolink.effects.switching import Switch
from twolink.errors import SceneError
from twolink.integrate import pinocchio_rate as reference
from twolink.integrate.assembly import assembled, independent_rows
from twolink.integrate.constraints import Loops, locked_matrix
from twolink.integrate.solution import Piece, Solution, joined
from twolink.integrate.state import Array, StateSpace
from twolink.io.fingerprints import kernel_key
from twolink.scenes import Scene

_E = TypeVar("_E", bound=Effect)
CLOSE = 1e-14  # relative: breaks nearer to each other than this are one, for no step resolves them


class _WithRows(StateSpace):
    """States (q, v, c): c are numbers that stand still within a piece, such as those that tables are made of."""

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
    assembled: how far q [rad, m] and v [per second] of the start were moved to close the loops.

    Between breaks a table of samples is one polynomial. Its coefficients ride along behind (q, v), in x[moving:], at
    rate 0: so that one compiled step serves all pieces of tables of any length. `in_pieces` sets them break by break.
    So do the numbers of modes: `slots` by name, and of each degree of freedom in `lockable`, which effects may hold at
    rest, whether it is `locked` (1 or 0) and the friction torque on it otherwise. `switches` are the effects of modes;
    what happens to them, and when, is not said here but in `integrate.events`.
    """

    def __init__(self, scene: Scene, parameters: Sequence[str] = ()) -> None:
        if scene.robot.has_mimic:
            raise SceneError("mimic joints cannot be simulated yet", where="robot", remedy="load it with mimic=False")
        self.scene = scene
        self.switches = tuple(e for e in scene.effects if isinstance(e, Switch))
        scene = _at_first(scene)
        self.robot = scene.robot
        self.effects = tuple(e for e in scene.effects if type(e).act is not Effect.act)
        loops = [e for e in scene.effects if isinstance(e, Loop)]
        self.tables = tuple({id(table): table for e in (*self.effects, *loops) for table in tables_of(e)}.values())
        self.lockable = tuple(sorted({k for e in self.switches for k in e.lockable(self.robot)}))
        self.locked = np.zeros(2 * len(self.lockable))
        self.slots: Mapping[str, float] = {}
        rows = sum(table.rows for table in self.tables) + len(self.locked)
        self.space = _WithRows(self.robot, rows) if rows else StateSpace(self.robot)
        self.moving = self.robot.nq + self.robot.nv
        self.parameters = tuple(parameters)
        self.start = np.concatenate([scene.q, scene.v, self.rows_at(0.0)])
        self.loops = Loops(self.space, loops, self.numbers) if loops else None
        self.assembled = (0.0, 0.0)
        if self.loops is not None:
            given = self.start[: self.moving].copy()
            self.start[: self.moving] = assembled(self.loops, given)
            self.loops.kept, self.loops.scales = independent_rows(self.loops, self.start[: self.space.nq])
            off = np.abs(self.start[: self.moving] - given)
            nq = self.space.nq
            self.assembled = float(off[:nq].max(initial=0.0)), float(off[nq:].max(initial=0.0))
            if not self.loops.kept:
                self.loops = None  # constraints that constrain nothing

    @functools.cached_property
    def kinks(self) -> tuple[str, ...]:
        """The names of what passes 0 where limits of effort begin to act."""
        x = self.start
        loads = self.loads(self.numbers, list(x[: self.space.nq]), list(x[self.space.nq : self.moving]), 0.0, Numbers,
                           self.now(self.effects, list(x[self.moving :])))  # fmt: skip
        return tuple(name for name, _ in loads.kinks)

    @property
    def analytic(self) -> bool:
        """Whether the equations are smooth to any order, as Taylor's method needs."""
        return self.loops is None and not self.switches and all(effect.analytic for effect in self.effects)

    def breaks(self, duration: float) -> tuple[float, ...]:
        """The times below the duration at which the equations are not smooth, increasing."""
        times = {t for effect in self.effects for t in effect.breaks(duration)}
        times.update(t for table in self.tables for t in table.times)
        times.update(t for switch in self.switches for t in switch.breaks(duration))
        found: list[float] = []
        for t in sorted(t for t in times if 0 < t < duration * (1.0 - CLOSE)):
            if not found or t > found[-1] * (1.0 + CLOSE):
                found.append(t)
        return tuple(found)

    def rows_at(self, t: float) -> Array:
        """The numbers that make the tables' pieces at a time, (size - moving,)."""
        numbers = ([self.slots.get(x.name, 0.0)] if isinstance(x, Slot) else x.rows_at(t) for x in self.tables)
        return np.concatenate([np.empty(0), *numbers, self.locked])

    def in_pieces(self, times: Array, solve: Callable[[Equations, Array], Solution]) -> Solution:
        """Solve from break to break for the samples `times` (n,): no step goes across one.

        Each piece is a solve of its own, by `solve(equations, times)`, from the state at its beginning.
        """
        start, end = float(times[0]), float(times[-1])
        self.require(start, end)
        edges = [start, *(t for t in self.breaks(end) if t > start), end]
        if len(edges) == 2 and not self.tables:
            return solve(self, times)
        parts: list[Solution] = []
        x: Any = self.start
        for begin, stop in itertools.pairwise(edges):
            first, after = np.searchsorted(times, [begin, stop], side="right")
            inside = times[first:after]
            extra = not inside.size or inside[-1] < stop  # the break is no sample
            grid = np.concatenate([[begin], inside, [stop] if extra else []])
            piece = self.beginning(x, 0.5 * (begin + stop))
            part = solve(piece, grid)
            x = part.x[:, -1] if part.precise is None else part.precise[-1]
            taken = slice(int(bool(parts)), len(part.t) - int(extra and len(part.t) == len(grid)))
            count = len(part.t[taken])
            pieces = (Piece(piece, begin, count),)
            parts.append(replace(part, t=part.t[taken], x=part.x[: self.moving, taken], pieces=pieces,
                                 precise=None if part.precise is None else part.precise[taken]))  # fmt: skip
            if part.interrupted:
                break
        return joined(parts)

    def require(self, start: float, end: float) -> None:
        """Require that tables reach so far. Raises SceneError."""
        for table in self.tables:
            if not isinstance(table, Slot):
                table.require(start, end)

    def beginning(
        self, x: Any, t: float, locked: Array | None = None, slots: Mapping[str, float] | None = None
    ) -> Equations:
        """The same equations from another state on, with the numbers of modes, and the tables' pieces of a time."""
        _ = self.numbers, self._formula, self._content  # found once: copies have what the original has
        piece = copy.copy(self)
        if locked is not None:
            piece.locked = locked
        if slots is not None:
            piece.slots = slots
        rows = piece.rows_at(t)
        piece.start = np.concatenate([x[: self.moving], rows.astype(x.dtype)]) if rows.size else x[: self.moving]
        return piece

    def free(self, rows: Sequence[Any]) -> list[Any]:
        """Of each degree of freedom, 0 where it is locked and 1 where not."""
        free: list[Any] = [1.0] * self.space.nv
        first = len(rows) - len(self.locked)
        for i, k in enumerate(self.lockable):
            free[k] = 1.0 - rows[first + i]
        return free

    def now(self, effects: Sequence[_E], rows: Sequence[Any]) -> Sequence[_E]:
        """The effects with polynomials of these coefficients in the place of their tables."""
        if not self.tables:
            return effects
        pieces: dict[int, Any] = {}
        at = 0
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
            acceleration[fine] = reference.accelerations(self, at, q[fine], v[fine], list(x[self.moving :, fine]))
        still = np.zeros((len(x) - self.moving, x.shape[1]))
        return np.concatenate([self.space.rate(x[:nq], x[nq:]), acceleration.T, still])

    def settled(self, x: Array, xp: Any, constants: Mapping[str, Any] | None = None) -> Array:
        """x back on its manifold: unit lengths, and closed loops."""
        x = self.space.normalized(x, xp)
        if self.loops is None:
            return x
        mech = self.numbers if xp is Numbers else mechanism(self.robot.model, constants)
        free = self.free(list(x[self.moving :]))
        return np.concatenate([self.loops.projected(mech, x[: self.moving], xp, free), x[self.moving :]])

    def rub(self, tau: list[Any], rows: Sequence[Any]) -> None:
        """Add the friction torques that ride along."""
        for k, value in zip(self.lockable, rows[len(rows) - len(self.lockable) :], strict=True):
            tau[k] = plus(tau[k], value)

    @functools.cached_property
    def numbers(self) -> Mechanism:
        """The robot's constants."""
        return mechanism(self.robot.model)

    def loop_pushes(self, mech: Mechanism, x: Array, xp: Any) -> list[list[Any]]:
        """What each kept row of the loops does to each degree of freedom."""
        if self.loops is None:
            return []
        q, v = x[: self.space.nq], x[self.space.nq : self.moving]
        jacobian = self.loops.jacobian(mech, q, xp)
        return self.loops.pushes(mech, q, v, xp, jacobian, self.now(self.loops.loops, list(x[self.moving :])))

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
        if self.loops is not None or self.lockable:
            return self.forces(mech, t, x, xp, effects)[0]
        nq = self.space.nq
        q, v = list(x[:nq]), list(x[nq : self.moving])
        loads = self.loads(mech, q, v, t, xp, self.now(effects, list(x[self.moving :])))
        given = {"q": q, "v": v, "tau": loads.tau, "f_ext": loads.wrenches}
        return list(function(self.robot.model, "forward_dynamics").variants[variant](mech, given, xp))

    def forces(
        self, mech: Mechanism, t: Any, x: Any, xp: Any, effects: Sequence[Effect]
    ) -> tuple[list[Any], list[Any], Loads]:
        """(a, the loops' multipliers, loads) under loops and locks."""
        nq, rows = self.space.nq, list(x[self.moving :])
        q, v = list(x[:nq]), list(x[nq : self.moving])
        loads = self.loads(mech, q, v, t, xp, self.now(effects, rows))
        self.rub(loads.tau, rows)
        free = self.free(rows)
        if self.loops is not None:
            loops = self.now(self.loops.loops, rows)
            whole = x if isinstance(x, np.ndarray) else _objects(x)  # curved joints take rows of a batch as they are
            a, multipliers = self.loops.accelerations(
                mech, whole[:nq], whole[nq : self.moving], loads.tau, loads.wrenches, xp, free, loops
            )
            return a, multipliers, loads
        at = poses(mech, q, xp)
        h = newton_euler(mech, at, v, [0.0] * mech.nv, loads.wrenches)
        mass = locked_matrix(composite_bodies(mech, at), free)
        right = [times(f, minus(tau, bias)) for f, tau, bias in zip(free, loads.tau, h, strict=True)]
        return ldlt_solve(mass, mech.dof_parents(), right, xp), [], loads

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
        effects = [
            f"{type(e).__module__}.{type(e).__qualname__} {msgspec.json.encode(e, enc_hook=plain)!r}"
            for e in everything
        ]
        kept = (self.loops.kept, self.loops.scales) if self.loops else ()
        return kernel_key(self.robot.model, ("equations", *effects, f"{kept} {self.lockable}", "|", *self.parameters))


def _objects(values: list[Any]) -> Array:
    """Scalars of any kind as an array."""
    out = np.empty(len(values), dtype=object)
    out[:] = values
    return out


def _at_first(scene: Scene) -> Scene:
    """The scene with what stands in the place of its switches when a run begins."""
    if not any(isinstance(e, Switch) and e.structural for e in scene.effects):
        return scene
    effects: list[Effect] = []
    for effect in scene.effects:
        effects += effect.at_first() if isinstance(effect, Switch) and effect.structural else [effect]
    return scene.with_effects(effects)


def equations_of(scene: Scene) -> Equations:
    """The equations of a scene, kept as long as the scene."""
    known: Equations | None = vars(scene).get("_equations")
    if known is None:
        known = vars(scene)["_equations"] = Equations(scene)
    return known
