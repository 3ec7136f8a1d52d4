"""Derivatives of functions of a run by a variable p, along the sensitivities of the run: no other run is solved.

    dF/dp = lim (F(run + h S) - F(run - h S)) / 2 h,   S = d(q, v)/dp

run + h S is the run to first order beside it: q moved along the tangent direction h dq/dp, v by h dv/dp; energy,
torques and accelerations are those of the moved states. A run that an event ends has another end: with the guard g that
passes 0 there, it comes dt = -(g_x S + g_p) / g' later, and the state at the end moves by S + x' dt.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np

from twolink.algorithms.mechanism import mechanism, nominal, parameter_names, with_nominal
from twolink.algorithms.motion import Motion
from twolink.algorithms.namespaces import Numbers
from twolink.dynamics import Robot
from twolink.effects.triggers import Watch
from twolink.errors import SceneError
from twolink.integrate.dense_output import DenseOutput
from twolink.integrate.effect_numbers import effect_numbers, nominal_value, physical
from twolink.integrate.joint_forces import accelerations_and_joint_torques
from twolink.integrate.neighbours import shifted
from twolink.optimization.objectives import Objective
from twolink.optimization.variables import derivative_of, scene_with, values_of
from twolink.scenes import Scene
from twolink.simulation.sensitivities import Sensitivities
from twolink.simulation.trajectory import Trajectory

STEP = 1e-3  # rad, m, per second: the largest change of a run; the error of differences is its fourth power
SMALLEST = 1e-3  # of the distance of the bounds: the largest change of a variable


class NotFollowedError(SceneError):
    """A function of a run asks for what is not known beside it; differences of runs tell its derivatives."""


class Unknown:
    """In place of what is not known beside a run: any use of it fails."""

    def __init__(self, what: str) -> None:
        self._what = what

    def _fail(self, *_: Any) -> Any:
        raise NotFollowedError(f"{self._what} beside a run is not known", argument="objective",
                               remedy="use its samples, energy, torques or accelerations")  # fmt: skip

    __len__ = __iter__ = __getitem__ = __bool__ = __contains__ = __getattr__ = _fail


class _Beside(Unknown):
    """The dense output of a run beside another: torques and accelerations at its samples."""

    def __init__(self, run: Trajectory, base: Trajectory, changes: dict[str, float]) -> None:
        super().__init__("the state between samples")
        self.t, self._run, self._base, self._changes = run.t, run, base, changes

    def accelerations_and_torques(self) -> tuple[np.ndarray, np.ndarray]:
        """As `DenseOutput.accelerations_and_torques`."""
        x = np.concatenate([self._run.q, self._run.v], axis=1).T
        a, tau = np.empty_like(self._run.v), np.empty_like(self._run.v)
        solution = self._base.solution
        for equations, places in solution.by_piece(self._base.t) if isinstance(solution, DenseOutput) else ():
            own = {name: nominal_value(equations, name) + change for name, change in self._changes.items()}
            found = accelerations_and_joint_torques(shifted(equations, own), self.t[places], x[:, places])
            a[places], tau[places] = found[0].T, found[1].T
        return a, tau


class Neighbours:
    """The runs beside the run of a scene, along one of its variables, to first order."""

    def __init__(self, s: Sensitivities, scene: Scene, name: str, width: float) -> None:
        of, column = derivative_of(scene, name)
        self.run, self.scene, self.name = s.run, scene, name
        self.dq, self.dv = s.q[of][:, :, column], s.v[of][:, :, column]
        self._constant = name in parameter_names(scene.robot.model) or name in effect_numbers(scene)
        self.later, place = 0.0, watch_at_end(scene, s.run)
        if place is not None:
            v, a = s.run.v[-1], s.run.acceleration[-1]
            self.later = self._end_shift(place, v, a)
            self.dq, self.dv = self.dq.copy(), self.dv.copy()
            self.dq[-1] += self.later * v
            self.dv[-1] += self.later * a
        largest = max(float(np.abs(change).max(initial=0.0)) for change in (self.dq, self.dv))
        self.step = min(SMALLEST * width, STEP / largest if largest else np.inf)

    def derivative(self, functions: Sequence[Objective]) -> np.ndarray:
        """The derivatives (m,) of functions of the run. Raises NotFollowedError."""
        return np.asarray(fourth_order(lambda h: np.array([f(self.at(h)) for f in functions], dtype=float), self.step))

    def at(self, h: float) -> Trajectory:
        """The run where the variable is h more."""
        changes = {self.name: h} if self._constant else {}
        return beside(self.run, h * self.dq, h * self.dv, changes, h * self.later)

    def _end_shift(self, place: int, v: np.ndarray, a: np.ndarray) -> float:
        """How much later the run ends, per unit of the variable. place: of the effect that ends it."""
        robot, q, t = self.run.robot, self.run.q[-1], float(self.run.t[-1])
        dq, dv = self.dq[-1], self.dv[-1]
        rate, change = (STEP / max(1.0, float(np.abs(np.concatenate(pair)).max())) for pair in ((v, a), (dq, dv)))

        def guard(q: np.ndarray, v: np.ndarray, t: float, h: float = 0.0) -> float:
            scene = self.scene
            if h and not self.name.startswith(("q.", "v.")):
                scene = scene_with(scene, {self.name: values_of(scene)[self.name] + h})
            watch, model = cast(Watch, scene.effects[place]), scene.robot.model
            value = watch.function if watch.when is None else watch.when.distance
            return float(np.squeeze(value(Motion(model, mechanism(model), q.tolist(), v.tolist(), t, Numbers))))

        in_time = fourth_order(lambda h: guard(robot.integrate(q, h * v), v + h * a, t + h), rate)
        across = fourth_order(lambda h: guard(robot.integrate(q, h * dq), v + h * dv, t, h), change)
        return float(-across / in_time)


def beside(
    run: Trajectory, dq: np.ndarray, dv: np.ndarray, changes: dict[str, float], later: float = 0.0
) -> Trajectory:
    """The run moved by (dq, dv) (n, nv), with other constants by name, which ends so much later [s]."""

    def moved(robot: Robot) -> Robot:
        def change(model: Any) -> None:
            for name, by in physical(changes).items():
                with_nominal(model, name, nominal(model, name) + by)

        return robot.changed(change) if physical(changes) else robot

    q, rows = run.q.copy(), dq.any(axis=1)
    q[rows] = run.robot.integrate(run.q[rows], dq[rows])
    other = replace(run, t=np.append(run.t[:-1], run.t[-1] + later), q=q, v=run.v + dv,
                    robot=moved(run.robot), error=None, cost=None, precise=None, recorded_energy=None,
                    robots=[(moved(robot), count) for robot, count in run.robots],
                    events=Unknown("what happens"))  # type: ignore[arg-type]  # fmt: skip
    return replace(other, solution=_Beside(other, run, changes))  # type: ignore[arg-type]


def watch_at_end(scene: Scene, run: Trajectory) -> int | None:
    """The place of the effect whose condition ends the run; None where none does."""
    last = {event.effect for event in run.events if event.t == run.t[-1]}
    return next((place for place, effect in enumerate(scene.effects) if place in last and isinstance(effect, Watch)
                 and effect.stop and effect.at is None), None)  # fmt: skip


def fourth_order(value: Callable[[float], Any], step: float) -> Any:
    """The derivative at 0 by differences, whose error is the fourth power of the step."""
    near, far = (value(k * step) - value(-k * step) for k in (1, 2))
    return (8.0 * near - far) / (12.0 * step)
