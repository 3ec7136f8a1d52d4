"""How far a trajectory is from obeying the equations from sample to sample, and what would explain that.

From each sample the exact motion to the next one's time is computed; what the trajectory differs by there is its local
defect. A cause is another law of motion, or another way of stepping, under which less is left over.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from twolink.algorithms.namespaces import Numbers
from twolink.dynamics import Robot
from twolink.effects import Effect
from twolink.effects.forces import SmoothFriction
from twolink.effects.joint_switches import DryFriction, JointStops
from twolink.effects.switching import Stop, SwitchingEffect
from twolink.effects.triggers import Watch
from twolink.errors import TwolinkError
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.pinocchio_rate import rate
from twolink.integrate.motion.scene_equations import equations_of
from twolink.integrate.motion.state import Array
from twolink.integrate.steps.methods import METHODS
from twolink.integrate.steps.step_formulas import explicit_step, semi_implicit_step
from twolink.integrate.steps.tableau import Tableau
from twolink.io.text import kebab_case
from twolink.scenes import Scene

SLIPS = 1e-9  # rad/s, m/s: the width of smooth friction, which is Coulomb's at any speed that is looked at
LOOKED_AT, STUDIED = 2_000, 300  # intervals, at most: whose defects are computed, in which causes are looked for
SUBSTEPS = (1, 2, 4, 5, 8, 10, 20)
EXACT, FINEST = 1, 256  # steps of order 8 an interval, at first and at most
CONVERGED = 1e-10  # of the speed
_STEPPERS = {"semi-implicit Euler": None, "explicit Euler": Tableau(((),), (1.0,), 1),
             "Runge-Kutta of order 4": METHODS["rk4"].tableau, "": METHODS["dop853"].tableau}  # fmt: skip


@dataclass(frozen=True)
class Cause:
    """What may be wrong, and the share of the local defects, or of the distance, that it leaves unexplained."""

    what: str
    unexplained: float

    def __str__(self) -> str:
        return f"{self.what} (leaves {100 * self.unexplained:.2g} % unexplained)"


@dataclass(frozen=True, eq=False)
class Log:
    """A trajectory: t (n,), q (n, nq), v (n, nv)."""

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray

    def part(self, rows: Array) -> Log:
        """Some of its samples."""
        return Log(self.t[rows], self.q[rows], self.v[rows])


@dataclass(frozen=True, eq=False)
class Intervals:
    """Neighbouring samples between which the motion is smooth: the first of each pair, and the second."""

    scene: Scene
    start: Log
    end: Log

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
        found, rows, steps = self.defects(flow_of(scene)), np.arange(len(self.h)), EXACT
        while len(rows) and steps < FINEST:
            steps *= 2
            finer = self.part(rows).defects(flow_of(scene, substeps=steps))
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
        return Intervals(self.scene, self.start.part(rows), self.end.part(rows))

    def spread(self) -> Intervals:
        """At most STUDIED of those whose defects are known."""
        known = np.flatnonzero(np.isfinite(self.exact).all(axis=1))
        return self.part(known[:: max(1, -(-len(known) // STUDIED))])


Flow = Callable[[Log, np.ndarray], tuple[np.ndarray, np.ndarray]]


def intervals_of(scene: Scene, log: Log) -> Intervals | None:
    """The intervals without an event; None where the scene has other events than of stops and dry friction, or states
    beside q and v."""
    switching = [effect for effect in scene.effects if isinstance(effect, SwitchingEffect)]
    sampled = any(effect.sampled is not None for effect in scene.effects)
    if sampled or not all(isinstance(effect, DryFriction | JointStops | Watch) for effect in switching):
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
    most = LOOKED_AT if equations_of(scene).constraints is None else STUDIED // 5  # which are solved one by one
    rows = rows[:: max(1, -(-len(rows) // most))]
    return Intervals(scene, log.part(rows), log.part(rows + 1)) if len(rows) > 2 else None


def flow_of(scene: Scene, stepper: str = "", substeps: int = EXACT) -> Flow:
    """The motion by a scene's smooth equations: exact, or by steps of another method."""
    equations = _smooth_equations(scene)
    space, tableau, law = equations.space, _STEPPERS[stepper], functools.partial(rate, equations)

    def flow(start: Log, h: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        numbers = np.repeat(equations.start[space.moving :, None], len(h), axis=1)
        t, x, small = start.t, np.concatenate([start.q.T, start.v.T, numbers]), h / substeps
        for _ in range(substeps):
            if tableau is None:
                x = semi_implicit_step(space, law, t, x, small)[0]
            else:
                x = explicit_step(tableau, law, t, x, small)[0]
            t = t + small
        return space.rows(space.normalized(x, Numbers))

    return flow


def _smooth_equations(scene: Scene) -> Equations:
    effects = [_smooth(effect, scene.base) for effect in scene.effects]
    return equations_of(scene.with_effects([effect for effect in effects if effect is not None]))


def _smooth(effect: Effect, robot: Robot) -> Effect | None:
    """What an effect is between its events."""
    if isinstance(effect, DryFriction):
        names = {joint.v.start: joint.name for joint in robot.joints}
        return SmoothFriction({names[hold.dof]: hold.kinetic for hold in effect.modes(robot)}, SLIPS)
    return None if isinstance(effect, SwitchingEffect) or effect.is_sensor else effect


def causes_of(intervals: Intervals) -> list[Cause]:
    """What would explain the local defects, best first."""
    few = intervals.spread()
    if len(few.h) < 3:
        return []
    found = [*_steppers(few), *_left_out(few), *_other_numbers(few)]
    return sorted(found, key=lambda cause: cause.unexplained)


def _share(left: np.ndarray, before: np.ndarray) -> float:
    """What is left of the defects."""
    size = float(np.linalg.norm(before))
    return float(np.linalg.norm(left)) / size if np.isfinite(left).all() and size > 0 else np.inf


def _steppers(few: Intervals, without: str = "", scene: Scene | None = None) -> Iterator[Cause]:
    """Other ways of stepping, with steps that the samples are multiples of; the best of each."""
    h, also = float(np.median(few.h)), f", and {without} is left out" if without else ""
    for name in filter(None, _STEPPERS):
        best = Cause("", np.inf)
        for count in SUBSTEPS:
            share = _share(few.defects(flow_of(scene or few.scene, name, count)), few.exact)
            if share < best.unexplained:
                best = Cause(f"{name} with steps of {1e3 * h / count:.4g} ms{also}", share)
        yield best


def _left_out(few: Intervals) -> Iterator[Cause]:
    """The scene without one of its effects, alone or with another way of stepping."""
    for i, effect in enumerate(few.scene.effects):
        if isinstance(effect, JointStops | Watch):
            continue
        name = _WORDS.get(type(effect).__name__, kebab_case(type(effect).__name__).replace("-", " "))
        try:
            scene = few.scene.without(i)
            share = _share(few.exact_for(scene), few.exact)
        except TwolinkError:  # without it the scene is none
            continue
        yield Cause(f"{name} is left out", share)
        if 1e-3 < share < 0.7:
            yield from _steppers(few, name, scene)


_WORDS = {"JointDamping": "damping", "DryFriction": "friction", "SmoothFriction": "friction", "JointSpring": "a spring"}


def _other_numbers(few: Intervals) -> Iterator[Cause]:
    """Other gravity, damping, friction or inertias: the torques M dv / h are fitted by what those would add."""
    robot = few.scene.robot
    if equations_of(few.scene).constraints is not None or robot.has_mimic:
        return
    missing = np.einsum("nij,nj->ni", robot.mass_matrix(few.start.q), few.exact[:, robot.nv :] / few.h[:, None])
    if not np.any(missing):
        return
    for words, names, columns in _laws(few):
        flat = columns.reshape(-1, columns.shape[2])
        scale = np.linalg.norm(flat, axis=0)
        scale[scale <= 1e-9 * scale.max(initial=0.0)] = np.inf  # what this motion does not show
        found = np.linalg.lstsq(flat / scale, missing.ravel(), rcond=1e-9)[0]
        numbers = found / scale
        told = [f"{name} {x:+.3g}" for name, x in zip(names, numbers, strict=False)
                if abs(x) > 1e-2 * np.abs(numbers).max()]  # fmt: skip
        left = _share(missing.ravel() - flat / scale @ found, missing)
        yield Cause(": ".join([words, *filter(None, [", ".join(told)])]), left)


def _laws(few: Intervals) -> Iterator[tuple[str, list[str], np.ndarray]]:
    """Torques (n, nv, k) that numbers of size 1 would add: what differs, the numbers' names, the columns."""
    robot, nv = few.scene.robot, few.scene.robot.nv
    q = robot.integrate(few.start.q, 0.5 * robot.difference(few.start.q, few.end.q))
    v, a = 0.5 * (few.start.v + few.end.v), (few.end.v - few.start.v) / few.h[:, None]
    pull = -np.stack([robot.with_gravity(g).gravity_torque(q) for g in np.eye(3)], axis=2)
    yield "gravity differs [m/s^2]", ["x", "y", "z"], pull
    joints = [joint for joint in robot.joints if joint.v.stop - joint.v.start == 1]
    for what, law in (("damping differs [N m s or N s/m]", -v), ("friction differs [N m or N]", -np.sign(v))):
        columns = np.zeros((len(v), nv, len(joints)))
        for k, joint in enumerate(joints):
            columns[:, joint.v.start, k] = law[:, joint.v.start]
        yield what, [joint.name for joint in joints], columns
    regressor, names = robot.regressor(q, v, a), robot.parameter_names
    for link in (name.removesuffix(".mass") for name in names if name.endswith(".mass")):
        own = [i for i, name in enumerate(names) if name.startswith(f"{link}.")][:10]
        yield f"the mass or inertia of link {link} differs", [], -regressor[:, :, own]
