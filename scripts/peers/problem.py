"""What all contestants are given: a model, an initial state, times; and what they are measured by: the reference."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

import twolink as tl
from twolink.algorithms.mechanism import mechanism
from twolink.algorithms.recursions import forward_dynamics_crba

INTERVALS = 20
FINGERS = {"panda_finger_joint1": 0.0, "panda_finger_joint2": 0.0}
UR5_START = (0.3, -0.8, 1.2, -0.7, 0.5, 0.2)
PANDA_START = (-0.7, 1.4, -0.4, -0.2, -0.8, 1.1, -0.7)
FINE, COARSE = 1e-19, 1e-17  # tolerances of the reference and of its check, both in long double

Accelerations = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""a (nv,) [rad/s^2] of q and v (nv,), without torques."""


class RefusedError(Exception):
    """A contestant cannot deliver at this setting, and says why."""


@dataclass(frozen=True)
class Answer:
    """q (21, nv) at the problem's times [rad], and how often the dynamics were evaluated, where that is known."""

    q: np.ndarray
    evaluations: int | None = None


@dataclass(frozen=True)
class Rung:
    """One setting of a contestant. `run` is what is timed; whatever can be built before is built."""

    setting: str
    run: Callable[[], Answer]


@dataclass(frozen=True)
class Contestant:
    """A name and a ladder of settings, cheap ones first."""

    name: str
    rungs: Iterable[Rung]


@dataclass(frozen=True)
class Problem:
    """A scene of revolute joints under gravity: `duration` seconds, answered at 21 equally spaced times."""

    name: str
    scene: tl.Scene
    duration: float

    @property
    def model(self) -> pin.Model:
        """Pinocchio's model, gravity included."""
        return self.scene.robot.model

    @property
    def interval(self) -> float:
        """Seconds between the times at which answers are compared."""
        return self.duration / INTERVALS

    @property
    def times(self) -> np.ndarray:
        """The 21 times [s]."""
        return np.linspace(0.0, self.duration, INTERVALS + 1)

    def aba(self) -> Accelerations:
        """Pinocchio's articulated-body algorithm, which all others are checked against."""
        model, data = self.model, self.model.createData()
        still = np.zeros(model.nv)
        return lambda q, v: pin.aba(model, data, q, v, still)


def problems() -> dict[str, Problem]:
    """The scenes. Joint limits and the floor play no part; masses, levers and inertias are the pin.Model's."""
    gravity = [tl.effects.Gravity()]
    ur5 = tl.Scene(tl.load_robot("ur5"), UR5_START, effects=gravity)
    panda = tl.Scene(tl.load_robot("panda", lock=FINGERS), PANDA_START, effects=gravity)
    found = [Problem("arm-swing", tl.load_scene("arm-swing"), 10.0), Problem("ur5", ur5, 2.0),
             Problem("panda", panda, 2.0)]  # fmt: skip
    return {p.name: p for p in found}


def axes(model: pin.Model) -> list[np.ndarray]:
    """The axis (3,) of every joint but the world's, in the joint's frame. ValueError unless all are revolute."""
    data = model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    subspaces = [np.asarray(joint.S).reshape(-1) for joint in list(data.joints)[1:]]
    if model.nq != model.nv or any(s.size != 6 or s[:3].any() for s in subspaces) or model.armature.any():
        raise ValueError(f"{model.name}: only revolute joints with an angle for q, and no armature, can be compared")
    return [s[3:] for s in subspaces]


def largest_difference(problem: Problem, other: Accelerations, states: int = 20) -> float:
    """max |a - a_aba| / max |a_aba|, the worst of some random states with |q| < 2 rad, |v| < 2 rad/s."""
    rng, worst, aba = np.random.default_rng(0), 0.0, problem.aba()
    for _ in range(states):
        q, v = rng.uniform(-2, 2, (2, problem.model.nv))
        a = aba(q, v)
        worst = max(worst, float(np.abs(other(q, v) - a).max() / np.abs(a).max()))
    return worst


class _Plain:
    """heyoka's own functions, exact in every precision, in the place of numpy for tracing."""

    def __init__(self, heyoka: Any) -> None:
        self.sin, self.cos, self.sqrt = heyoka.sin, heyoka.cos, heyoka.sqrt

    @staticmethod
    def reciprocal(x: Any) -> Any:
        return 1.0 / x


class Reference:
    """The trajectory that errors are measured from: Taylor series by heyoka in long double, tolerance 1e-19.

    q (21, nv) [rad]. doubt: its distance from the same with tolerance 1e-17, hence other orders and steps [rad].
    growth: how many times an error of the initial state grows, at most, in four random directions.
    """

    def __init__(self, problem: Problem) -> None:
        import heyoka

        n = problem.model.nv
        q, v = ([heyoka.expression(f"{name}{i}") for i in range(n)] for name in "qv")
        mech = mechanism(problem.model, regroup=False)
        a = forward_dynamics_crba(mech, q, v, [0.0] * n, None, _Plain(heyoka))
        self._compiled = heyoka.cfunc(a, vars=[*q, *v])
        self._problem, self._start = problem, np.concatenate([problem.scene.q, problem.scene.v]).astype(np.longdouble)
        fine, coarse = (
            heyoka.taylor_adaptive([*zip(q, v, strict=True), *zip(v, a, strict=True)], self._start,
                                   tol=np.longdouble(tol), fp_type=np.longdouble, compact_mode=n > 3)
            for tol in (FINE, COARSE)
        )  # fmt: skip
        self.q = self._solve(fine, self._start)
        self.doubt = float(np.abs(self._solve(coarse, self._start) - self.q).max())
        self.growth = self._growth(fine)

    def accelerations(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """The traced dynamics in double precision, for the check against pin.aba."""
        return np.asarray(self._compiled(np.concatenate([q, v])))

    def error(self, q: np.ndarray) -> float:
        """max |q - q_ref| over the 21 times and all joints, rad."""
        return float(np.abs(q - self.q).max())

    def _growth(self, integrator: Any, size: float = 1e-9) -> float:
        rng, worst = np.random.default_rng(0), 0.0
        for _ in range(4):
            push = rng.uniform(-1, 1, len(self._start))
            push *= size / np.abs(push).max()
            worst = max(worst, self.error(self._solve(integrator, self._start + push)) / size)
        return worst

    def _solve(self, integrator: Any, start: np.ndarray) -> np.ndarray:
        integrator.time = np.longdouble(0)
        integrator.state[:] = start
        times = self._problem.times.astype(np.longdouble)
        # From a symmetric state, such as rest with both rods horizontal, the last two coefficients of a series can
        # vanish for some orders, and with them the bound of the step: hence the longest step.
        longest = np.longdouble(self._problem.duration / 200)
        return np.array(integrator.propagate_grid(times, max_delta_t=longest)[-1])[:, : self._problem.model.nv]
