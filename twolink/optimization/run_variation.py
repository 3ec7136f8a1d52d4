"""Derivatives of functions of a run by a parameter p, along the sensitivities of the run: no other run is solved.

    dF/dp = lim (F(run + h S) - F(run - h S)) / 2 h,   S = d(q, v)/dp

run + h S is the run to first order beside it: q moved along the tangent direction h dq/dp, v by h dv/dp; energy,
torques and accelerations are those of the moved states. A run that an event ends has another end: with the guard g that
passes 0 there, it comes dt = -(g_x S + g_p) / g' later, and the state at the end moves by S + x' dt.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from twolink.algorithms.differences import derivative
from twolink.algorithms.mechanism import mechanism, nominal, with_nominal
from twolink.algorithms.motion import Motion
from twolink.algorithms.namespaces import Numbers
from twolink.dynamics import Robot
from twolink.effects.triggers import Watch
from twolink.errors import SceneError
from twolink.integrate.dense_output import DenseOutput
from twolink.integrate.effect_numbers import nominal_value, physical
from twolink.integrate.joint_forces import accelerations_and_joint_torques
from twolink.integrate.parameter_variation import shifted
from twolink.optimization.objectives import Objective
from twolink.scenes import Scene
from twolink.scenes.parameters import Parameter, scene_with
from twolink.simulation.sensitivities import Sensitivities
from twolink.simulation.trajectory import Trajectory

STEP = 1e-3  # rad, m, per second: the largest change of a run; the error of differences is its fourth power


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


@dataclass(frozen=True, eq=False)
class RunVariation:
    """The runs beside a run along a parameter, to first order.

    dq, dv (n, nv): derivatives of the samples. constants: those of constants that functions of the run use besides, by
    name. later: that of the end, s.
    """

    run: Trajectory
    dq: np.ndarray
    dv: np.ndarray
    constants: Mapping[str, float]
    later: float = 0.0

    def derivative(self, functions: Sequence[Objective], largest: float = np.inf, change: float = STEP) -> np.ndarray:
        """The derivatives (m,) of functions of the run. Raises NotFollowedError.

        largest: change of the parameter; change: of a sample, rad, m, per second.
        """
        size = max(float(np.abs(rows).max(initial=0.0)) for rows in (self.dq, self.dv))
        step = min(largest, change / size if size else np.inf)
        return np.asarray(derivative(lambda k: np.array([f(self.at(k * step)) for f in functions], dtype=float), step))

    def at(self, h: float) -> Trajectory:
        """The run where the parameter is h more."""
        changes = {name: h * rate for name, rate in self.constants.items()}
        return beside(self.run, h * self.dq, h * self.dv, changes, h * self.later)


def variation_by(s: Sensitivities, scene: Scene, parameter: Parameter) -> RunVariation:
    """The variation of the run of a scene by one of its parameters, also of an end at an event."""
    name, run = parameter.name, s.run
    dq, dv = s.q[name][:, :, 0], s.v[name][:, :, 0]
    place, later = watch_at_end(scene, run), 0.0
    if place is not None:
        v, a = run.v[-1], run.acceleration[-1]
        later = _end_shift(scene, run, parameter, place, (v, a), (dq[-1], dv[-1]))
        dq, dv = dq.copy(), dv.copy()
        dq[-1] += later * v
        dv[-1] += later * a
    return RunVariation(run, dq, dv, {name: 1.0} if parameter.acts else {}, later)


def _end_shift(
    scene: Scene, run: Trajectory, parameter: Parameter, place: int, rates: tuple[np.ndarray, np.ndarray],
    along: tuple[np.ndarray, np.ndarray],
) -> float:  # fmt: skip
    """How much later a run ends, per unit of a parameter. place: of the effect that ends it."""
    robot, q, v, t = run.robot, run.q[-1], run.v[-1], float(run.t[-1])
    in_time, across = (STEP / max(1.0, float(np.abs(np.concatenate(pair)).max())) for pair in (rates, along))

    def guard(direction: tuple[np.ndarray, np.ndarray], h: float, later: float, by: float) -> float:
        other = scene if parameter.kind in ("q", "v") or not by else (
            scene_with(scene, {parameter.name: parameter.nominal + by}))  # fmt: skip
        watch, model = cast(Watch, other.effects[place]), other.robot.model
        value, x = watch.function if watch.when is None else watch.when.distance, robot.integrate(q, h * direction[0])
        motion = Motion(model, mechanism(model), x.tolist(), (v + h * direction[1]).tolist(), t + later, Numbers)
        return float(np.squeeze(value(motion)))

    by_time = derivative(lambda k: guard(rates, k * in_time, k * in_time, 0.0), in_time)
    by_parameter = derivative(lambda k: guard(along, k * across, 0.0, k * across), across)
    return float(-by_parameter / by_time)


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
