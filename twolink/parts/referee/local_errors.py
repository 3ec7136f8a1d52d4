"""Local defects of a trajectory: by how much it does not obey the equations from sample to sample.

From each sample the exact motion to the next one's time is computed; what the trajectory differs by there is its local
defect. The same with other laws of motion, or by the steps of another method.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from twolink.algorithms.namespaces import Numbers
from twolink.dynamics import Robot
from twolink.effects import Effect
from twolink.effects.forces import JointDamping, SmoothFriction
from twolink.effects.joint_switches import DryFriction, JointStops
from twolink.effects.switching import Stop, SwitchingEffect
from twolink.effects.triggers import Watch
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.pinocchio_rate import rate
from twolink.integrate.motion.scene_equations import equations_of
from twolink.integrate.motion.state import Array
from twolink.integrate.steps.methods import METHODS, Tableau
from twolink.integrate.steps.step_formulas import explicit_step, semi_implicit_step
from twolink.parts.referee.trajectory_log import TrajectoryLog
from twolink.scenes import Scene

SLIPS = 1e-9  # rad/s, m/s: the width of smooth friction, which is Coulomb's at any speed that is looked at
STUDIED = 300  # intervals, at most
EXACT, FINEST = 1, 32  # steps of order 8 an interval, at first and at most
CONVERGED = 1e-10  # of the speed
EULER, IMPLICIT_DAMPING = "semi-implicit Euler", "semi-implicit Euler with implicit damping"
IMPLICIT = "semi-implicit Euler, implicit in the velocity"
STEPPERS = {EULER: None, IMPLICIT_DAMPING: None, IMPLICIT: None, "explicit Euler": Tableau(((),), (1.0,), 1),
            "Runge-Kutta of order 4": METHODS["rk4"].tableau, "": METHODS["dop853"].tableau}  # fmt: skip
"""The way of stepping by its name; "" is the exact one. Those with implicit damping are MuJoCo's Euler and implicit."""
Check = Callable[[float], None]
"""Called now and then; raises OutOfTime when the time is up."""


@dataclass(frozen=True, eq=False)
class Intervals:
    """Neighbouring samples between which the motion is smooth: the first of each pair, and the second."""

    scene: Scene
    start: TrajectoryLog
    end: TrajectoryLog
    check: Check = lambda _: None

    @property
    def h(self) -> np.ndarray:
        """Their lengths, s."""
        return np.asarray(self.end.t - self.start.t)

    def defects(self, flow: Flow) -> np.ndarray:
        """(dq / h, dv) by which the second samples differ from where a flow takes the first ones, (n, 2 nv)."""
        with np.errstate(all="ignore"):  # steps that are too long for a stiff law
            q, v = flow(self.start, self.h)
            good = np.isfinite(q).all(axis=1) & np.isfinite(v).all(axis=1)
        out = np.full((len(q), 2 * v.shape[1]), np.nan)
        dq = self.scene.robot.difference(q[good], self.end.q[good])
        out[good] = np.concatenate([dq / self.h[good, None], self.end.v[good] - v[good]], axis=1)
        return out

    def exact_for(self, scene: Scene) -> np.ndarray:
        """The defects under the laws of a scene: by steps that are halved until that changes nothing; else NaN."""
        found, rows, steps = self.defects(flow_of(scene, check=self.check)), np.arange(len(self.h)), EXACT
        while len(rows) and steps < FINEST:
            steps *= 2
            finer = self.part(rows).defects(flow_of(scene, substeps=steps, check=self.check))
            change = np.abs(finer - found[rows]).max(axis=1)
            found[rows] = finer
            rows = rows[~(change <= CONVERGED * (1.0 + np.abs(self.end.v[rows]).max(axis=1)))]
        found[rows] = np.nan
        return found

    @functools.cached_property
    def exact(self) -> np.ndarray:
        """The local defects."""
        return self.exact_for(self.scene)

    def part(self, rows: Array) -> Intervals:
        """Some of them."""
        return replace(self, start=self.start.part(rows), end=self.end.part(rows))

    def known(self) -> Intervals:
        """The intervals whose defects are known."""
        found = np.isfinite(self.exact).all(axis=1)
        return self if found.all() else self.part(found)


Flow = Callable[[TrajectoryLog, np.ndarray], tuple[np.ndarray, np.ndarray]]


def intervals_of(scene: Scene, log: TrajectoryLog, check: Check) -> Intervals | None:
    """Some intervals without an event; None where the scene has other events than of stops and dry friction that change
    its motion, or states beside q and v, or the log no velocities."""
    if not log.has_velocities:
        return None
    switching = [effect for effect in scene.effects if isinstance(effect, SwitchingEffect)]
    sampled = any(effect.sampled is not None for effect in scene.effects)
    known = (isinstance(effect, DryFriction | JointStops) or (isinstance(effect, Watch) and effect.then is None)
             for effect in switching)  # fmt: skip
    if sampled or not all(known):
        return None
    if _smooth_equations(scene).space.states:
        return None
    smooth = np.diff(log.t) > 0
    speed = np.abs(log.v[:-1]) + np.abs(log.v[1:])
    for effect in switching:
        for mode in effect.modes(scene.base):
            if isinstance(mode, Stop):
                gap = mode.side * (log.q[:, mode.entry] - mode.position)
                reach = 1.5 * np.diff(log.t) * speed[:, mode.dof] + 1e-5
                smooth &= np.minimum(gap[:-1], gap[1:]) > reach
            elif isinstance(effect, DryFriction):
                k = getattr(mode, "dof", 0)
                smooth &= log.v[:-1, k] * log.v[1:, k] > 1e-12
    rows = np.flatnonzero(smooth)
    most = STUDIED if equations_of(scene).constraints is None else STUDIED // 5  # which are solved one by one
    rows = rows[:: max(1, -(-len(rows) // most))]
    return Intervals(scene, log.part(rows), log.part(rows + 1), check) if len(rows) > 2 else None


def flow_of(scene: Scene, stepper: str = "", substeps: int = EXACT, *, check: Check) -> Flow:
    """The motion by a scene's smooth equations: exact, from break to break; or by steps of another method."""
    equations = _smooth_equations(scene)
    space, tableau, law = equations.space, STEPPERS[stepper], functools.partial(rate, equations)

    def flow(start: TrajectoryLog, h: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        end, numbers = start.t + h, np.repeat(equations.start[space.moving :, None], len(h), axis=1)
        x, edges = np.concatenate([start.q.T, start.v.T, numbers]), [start.t, end]
        if not stepper:
            edges[1:1] = _breaks_between(equations, start.t, end)
        for begin, until in itertools.pairwise(edges):
            t, small = begin, (until - begin) / substeps
            implicit = functools.partial(_implicit_rate, scene, equations, stepper == IMPLICIT, small)
            for _ in range(substeps):
                check(0.0)
                if equations.layout.tables:  # by their middle: an end may round to the other side of a knot
                    x[space.moving :] = np.array([equations.layout.numbers_at(s) for s in t + small / 2]).T
                if tableau is None:
                    x = semi_implicit_step(space, law if stepper == EULER else implicit, t, x, small)[0]
                else:
                    x = explicit_step(tableau, law, t, x, small)[0]
                t = t + small
        return space.rows(space.normalized(x, Numbers))

    return flow


def _breaks_between(equations: Equations, start: Array, end: Array) -> list[Array]:
    """The first, second, ... break of the equations in each interval (n,); its end where it has fewer."""
    breaks = np.append(equations.breaks(float(end.max())), np.inf)
    first = np.searchsorted(breaks, start, side="right")
    most = int((np.searchsorted(breaks, end) - first).max())
    return [np.minimum(breaks[np.minimum(first + k, len(breaks) - 1)], end) for k in range(most)]


def _implicit_rate(scene: Scene, equations: Equations, whole: bool, h: Array, t: Any, x: Array) -> Array:
    """x' whose accelerations are (M + h (D - dtau/dv))^-1 M a: damping D implicit, and, as a whole, the bias too.

    MuJoCo's documentation, Computation, "Numerical integration": Euler and implicitfast; implicit as a whole.
    """
    rates, (q, v) = rate(equations, t, x), equations.space.rows(x)
    mass, rows = scene.robot.mass_matrix(q), equations.space.v_rows
    right = np.einsum("nij,jn->ni", mass, rates[rows])
    left = mass + h[:, None, None] * np.diag(viscosity(scene))
    if whole:
        left -= h[:, None, None] * (mass @ scene.robot.forward_dynamics_derivatives(q, v, np.zeros_like(v))[1])
    rates[rows] = np.linalg.solve(left, right[..., None])[..., 0].T
    return rates


def viscosity(scene: Scene) -> np.ndarray:
    """The damping of a scene's joints, (nv,)."""
    found = np.zeros(scene.robot.nv)
    for effect in scene.effects:
        if isinstance(effect, JointDamping):
            given = effect.viscosity(scene.robot)
            for joint in scene.robot.joints:
                found[joint.v] += given.get(joint.name, 0.0)
    return found


@functools.lru_cache(8)  # several ways of stepping are tried with each
def _smooth_equations(scene: Scene) -> Equations:
    effects = [_smooth(effect, scene.base) for effect in scene.effects]
    return equations_of(scene.with_effects([effect for effect in effects if effect is not None]))


def _smooth(effect: Effect, robot: Robot) -> Effect | None:
    """The effect between its events, in a smooth form; None where it gives none."""
    if isinstance(effect, DryFriction):
        names = {joint.v.start: joint.name for joint in robot.joints}
        return SmoothFriction({names[hold.dof]: hold.kinetic for hold in effect.modes(robot)}, SLIPS)
    return None if isinstance(effect, SwitchingEffect) or effect.is_sensor else effect
