"""Moment: what guards and laws see of a state, or of many at once: its motion, accelerations and forces."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from twolink.dynamics.recursions import newton_euler, poses
from twolink.effects.motion import Loads, Motion
from twolink.integrate.equations import Equations
from twolink.integrate.namespaces import Numbers
from twolink.integrate.state import Array


class Moment:
    """States x (size, n) at times t (n,) of equations in one mode."""

    def __init__(self, equations: Equations, t: Array, x: Array) -> None:
        self.equations, self.t, self.x = equations, t, x
        nq = equations.space.nq
        self.q, self.v = list(x[:nq]), list(x[nq : equations.moving])

    @functools.cached_property
    def motion(self) -> Motion:
        """The moving robot."""
        return Motion(self.equations.robot.model, self.equations.numbers, self.q, self.v, self.t, Numbers)

    @functools.cached_property
    def _forces(self) -> tuple[list[Any], list[Any], Loads]:
        with np.errstate(all="ignore"):
            a, multipliers, loads = self.equations.forces(
                self.equations.numbers, self.t, self.x, Numbers, self.equations.effects
            )
        return [np.asarray(x, dtype=float) for x in a], [np.asarray(x, dtype=float) for x in multipliers], loads

    @property
    def accelerations(self) -> list[Any]:
        """v', by degree of freedom."""
        return self._forces[0]

    @property
    def largest_load(self) -> float:
        """The largest torque that effects give a joint, N m or N, by which forces are judged."""
        return max((float(np.abs(tau).max()) for tau in self._forces[2].tau), default=0.0)

    @functools.cached_property
    def kinks(self) -> list[tuple[str, Any]]:
        """What passes 0 where limits of effort begin to act, with its name."""
        equations = self.equations
        rows = list(self.x[equations.moving :])
        effects = equations.now(equations.effects, rows)
        return equations.loads(equations.numbers, self.q, self.v, self.t, Numbers, effects).kinks

    @functools.cached_property
    def multipliers(self) -> dict[int, list[Any]]:
        """The multipliers of each loop's rows, by the loop's id."""
        loops = self.equations.loops
        if loops is None:
            return {}
        return {id(loop): rows for loop, rows in zip(loops.loops, loops.by_loop(self._forces[1]), strict=True)}

    @functools.cached_property
    def holding(self) -> list[Any]:
        """The torque of the lock on each degree of freedom: M a + h - tau - B lambda."""
        equations, mech = self.equations, self.equations.numbers
        a, multipliers, loads = self._forces
        needed = newton_euler(mech, poses(mech, self.q, Numbers), self.v, a, loads.wrenches)
        held = [x - tau for x, tau in zip(needed, loads.tau, strict=True)]
        if equations.loops is not None:
            for row, size in zip(equations.loop_pushes(self.x), multipliers, strict=True):
                held = [x - size * entry for x, entry in zip(held, row, strict=True)]
        return [np.asarray(x, dtype=float) for x in held]
