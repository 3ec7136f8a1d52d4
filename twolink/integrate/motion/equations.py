"""Equations of motion of a scene, x' = f(t, x), as frozen data. The formulas are functions in other modules.

formulas          what the machine runs and NumPy evaluates
pinocchio_rate    the same by Pinocchio, state by state
scene_equations   makes equations from a scene
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from twolink.algorithms.mechanism import Mechanism
from twolink.dynamics import Robot
from twolink.effects import Effect
from twolink.effects.inputs import SAME_TIME, Slot, require_curves
from twolink.effects.switching import Switching
from twolink.errors import SceneError
from twolink.integrate.motion.constraints import Constraints
from twolink.integrate.motion.state import NO_SLOTS, Array, Layout, StateSpace

if TYPE_CHECKING:
    from twolink.loop.sampled_loop import Sampling


@dataclass(frozen=True, eq=False)
class Equations:
    """Equations of motion: q' from v on the manifold, M v' + h = tau + J^T f_ext + B lambda.

    layout: the rows of a state. start: the initial state (size,). robot: with the constants that effects changed.
    mechanism: its constants as numbers. effects: those that act while it moves. constraints: of loops and contacts.
    parameters: physical constants kept as run-time inputs. switching: what effects with modes declare; None without.
    sampling: the controllers that are called at ticks; None without.
    places: of the effects, then of the constraints' loops, their places among the scene's effects.
    effort_limits: of the limits of effort, whose values pass 0 where they begin and cease to act, the place of the
    effect among the scene's and the name.
    sides: of each joint with a limit of effort, on which side of it the equations stay, -1 below, 0 within, 1 above;
    None: they follow the torque.
    variant: which formula of forward dynamics has the fewest operations, and `operations`, how many an evaluation has.
    steady: the rows of v and z whose rate is 0 whatever the state: no rounding changes them.
    numbers_as_inputs: whether compiled steps take the numbers of robot and effects as inputs, for scenes that
    differ in them.
    content: a digest of all this but the start and that.
    assembled: how far q [rad, m] and v [per second] of the start were moved to close the loops.
    """

    layout: Layout
    start: Array
    robot: Robot
    mechanism: Mechanism
    effects: tuple[Effect, ...]
    constraints: Constraints | None = None
    parameters: tuple[str, ...] = ()
    switching: Switching | None = None
    sampling: Sampling | None = None
    places: tuple[int, ...] = ()
    effort_limits: tuple[tuple[int, str], ...] = ()
    sides: tuple[Any, ...] | None = None
    variant: int = 0
    operations: int = 0
    steady: tuple[int, ...] = ()
    content: str = ""
    assembled: tuple[float, float] = (0.0, 0.0)
    numbers_as_inputs: bool = False

    @property
    def space(self) -> StateSpace:
        """The states x."""
        return self.layout.space

    @property
    def moving(self) -> int:
        """The number of rows of q, v and z in a state."""
        return self.layout.moving

    @property
    def analytic(self) -> bool:
        """True if the equations are smooth to any order, as Taylor's method needs."""
        return self.constraints is None and self.switching is None and all(e.analytic for e in self.effects)

    @property
    def has_events(self) -> bool:
        """True if modes change at events that must be located."""
        return self.switching is not None or bool(self.effort_limits)

    def breaks(self, duration: float) -> tuple[float, ...]:
        """The times below the duration at which the equations are not smooth, increasing."""
        times = {t for effect in self.effects for t in effect.breaks(duration)}
        times.update(t for table in self.layout.tables for t in table.times)
        times.update(() if self.switching is None else self.switching.times)
        distinct: list[float] = []
        for t in sorted(t for t in times if 0 < t < duration * (1.0 - SAME_TIME)):
            if not distinct or t > distinct[-1] * (1.0 + SAME_TIME):
                distinct.append(t)
        return tuple(distinct)

    def require_motion(self) -> None:
        """Require a degree of freedom. Raises SceneError."""
        if self.space.nv == 0:
            raise SceneError("nothing moves", where="robot", remedy="give a robot with joints that are not locked, or "
                             'load it with root="free"')  # fmt: skip

    def require(self, start: float, end: float) -> None:
        """Require that tables and curves reach so far. Raises SceneError."""
        for table in self.layout.tables:
            if not isinstance(table, Slot):
                table.require(start, end)
        for effect in self.effects if self.switching is None else self.switching.effects:
            require_curves(effect, end)

    def starting_at(
        self, x: Any, t: float, locks: Array | None = None, slots: Mapping[str, float] = NO_SLOTS
    ) -> Equations:
        """The equations from another state (q, v, z) on, with the numbers of the piece at time t."""
        numbers = self.layout.numbers_at(t, slots, locks)
        return replace(self, start=np.concatenate([x[: self.moving], numbers.astype(x.dtype)]))

    def full(self, x: Array) -> Array:
        """States (size, n) with the numbers of the start behind states of fewer rows."""
        return np.concatenate([x, np.repeat(self.start[len(x) :, None], x.shape[1], axis=1)])

    def key(self, *parts: str) -> str:
        """A name for what is made of these equations: the model, the effects, our code, versions and the parts."""
        return f"{self.content}-{'-'.join(parts)}"
