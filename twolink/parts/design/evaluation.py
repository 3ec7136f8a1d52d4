"""Variables, and one evaluation at values of them: objective and constraints, with their derivatives.

The derivatives come from the sensitivities of the one run (`objectives`). Where there are none - a number that they
do not follow, a motion that only touches a limit, an objective that asks for more than samples - differences of runs
stand in, and the evaluation says so.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from numbers import Real
from typing import Any

import numpy as np

from twolink.dynamics.arguments import instance
from twolink.errors import AccuracyError, MissingExtraError, SceneError
from twolink.parts.design.objectives import NotFollowedError, Objective, value_of, variation_by
from twolink.scenes import Scene
from twolink.scenes.parameters import named_parameters, scene_with
from twolink.simulation.scene_run import simulate
from twolink.simulation.sensitivities import sensitivities
from twolink.simulation.sensitivity_names import wanted_of
from twolink.simulation.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Variables:
    """k numbers of a scene between bounds.

    names: as `scenes.parameters` has them. low, high (k,): bounds, SI units. own (k,):
    the values that the scene has.
    """

    scene: Scene
    names: tuple[str, ...]
    low: np.ndarray
    high: np.ndarray
    own: np.ndarray

    @property
    def width(self) -> np.ndarray:
        """high - low, (k,)."""
        return np.asarray(self.high - self.low)

    def named(self, x: np.ndarray) -> dict[str, float]:
        """Values (k,) by name."""
        return dict(zip(self.names, x.tolist(), strict=True))

    def scene_at(self, x: np.ndarray) -> Scene:
        """The scene with these values (k,)."""
        return scene_with(self.scene, self.named(x))


def variables_of(scene: Scene, wrt: Mapping[str, Sequence[float]]) -> Variables:
    """The variables that `wrt` names, with bounds. Raises SceneError."""
    instance(scene, Scene, "scene", SceneError)
    if not isinstance(wrt, Mapping) or not wrt:
        raise SceneError(f"expected bounds by name, got {wrt!r:.60}", argument="wrt",
                         remedy="such as {'v.elbow': (-1.0, 1.0)}", code="no-variables")  # fmt: skip
    own = np.array([parameter.nominal for parameter in named_parameters(scene, wrt, "wrt")])
    low, high = np.array([_bounds(name, pair) for name, pair in wrt.items()]).T
    found = Variables(scene, tuple(wrt), low, high, own)
    for corner in (low, high):
        found.scene_at(corner)  # refuses what cannot be
    return found


def _bounds(name: str, pair: Any) -> tuple[float, float]:
    """Two bounds. Raises SceneError."""
    numbers = isinstance(pair, Sequence | np.ndarray) and len(pair) == 2 and all(isinstance(x, Real) for x in pair)
    low, high = (float(bound) for bound in pair) if numbers else (math.nan, math.nan)
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise SceneError(f"expected finite bounds (low, high) with low < high, got {pair!r:.60}", argument="wrt",
                         where=f"wrt[{name!r}]", remedy="such as (-1.0, 1.0)", code="bounds")  # fmt: skip
    return low, high


LARGEST = 1e-3  # of the distance of the bounds: the largest change of a variable along a run
STEP = 1e-4  # of the distance of the bounds: of differences of runs
FAILURES = 3  # motions without derivatives, after which these are not tried any more
SHARPER = 1e-3  # of the accuracy: of a second try to tell the events of a motion apart
BY_SENSITIVITIES = "sensitivities"


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Objective and constraints at values x (k,) of the variables.

    values (1 + m,): the objective, then the constraints. gradients (1 + m, k). by: how these were found. simulations:
    runs that it took. seconds: of wall clock.
    """

    x: np.ndarray
    values: np.ndarray
    gradients: np.ndarray
    by: str
    simulations: int
    seconds: float


@dataclass
class ObjectiveEvaluator:
    """Evaluates functions of the runs of a scene, by name: the objective, then the constraints.

    times (n,): of the samples of a run, from its start to its end, s. derivatives: "auto", or "runs" for differences of
    runs. simulations: runs so far. failures: motions without derivatives so far. by_runs: variables whose derivatives
    are differences of runs, with the reason.
    """

    variables: Variables
    functions: Mapping[str, Objective]
    times: np.ndarray
    accuracy: float
    derivatives: str = "auto"
    simulations: int = 0
    failures: int = 0
    by_runs: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.derivatives == "runs":
            self.by_runs = dict.fromkeys(self.variables.names, "asked for")
        for name in self.variables.names if not self.by_runs else ():
            try:
                variation = wanted_of(self.variables.scene, [name]).variation
                if set(variation.constants) - {name} or variation.has_friction:
                    self.by_runs[name] = "energy and torques change with it, besides the motion"
            except SceneError as error:
                self.by_runs[name] = error.what

    def __call__(self, x: np.ndarray) -> Evaluation:
        """The evaluation at x (k,). Raises TwolinkError where the motion there cannot be simulated."""
        began, before, names = time.perf_counter(), self.simulations, self.variables.names
        scene, by = self.variables.scene_at(x), BY_SENSITIVITIES
        followed = [name for name in names if name not in self.by_runs]
        run, columns = None, dict[str, np.ndarray]()
        try:
            if followed:
                run, columns = self.along(scene, followed)
        except NotFollowedError as error:
            self.by_runs.update(dict.fromkeys(followed, error.what))
        except (AccuracyError, MissingExtraError, SceneError) as error:
            by = error.what  # of this motion; the next one may have derivatives
            self.failures += 1
            if self.failures == FAILURES:
                self.by_runs.update(dict.fromkeys(followed, error.what))
        values = self.values_of(self.run(scene) if run is None else run)
        if len(columns) < len(names):
            columns |= {name: self._difference(x, k) for k, name in enumerate(names) if name not in columns}
            reasons = self.by_runs.values() if by == BY_SENSITIVITIES else [by]
            by = f"differences of runs: {'; '.join(dict.fromkeys(reasons))}"
        gradients = np.array([columns[name] for name in names]).T
        return Evaluation(x, values, gradients, by, self.simulations - before, time.perf_counter() - began)

    def along(self, scene: Scene, names: Sequence[str], finer: float = 1.0) -> tuple[Trajectory, dict[str, np.ndarray]]:
        """A run, and the derivatives (1 + m,) of the functions along it by each of these variables.

        finer: times as accurate, and above 1 with a sample between each two. Where derivatives need a more accurate run
        to tell its events apart, that is it. Raises TwolinkError where there are none.
        """
        for accuracy in (self.accuracy / finer, self.accuracy / finer * SHARPER):
            self.simulations += 1
            try:
                s = sensitivities(scene, self.times[-1], wrt=names, accuracy=accuracy, t_eval=self._times(finer))
                break
            except AccuracyError as error:
                if error.code != "sensitivity-undefined" or accuracy < self.accuracy / finer:
                    raise
        _require_whole(s.run)
        functions = list(self.functions.values())
        largest = dict(zip(self.variables.names, LARGEST * self.variables.width, strict=True))
        return s.run, {parameter.name: variation_by(s, scene, parameter).derivative(functions, largest[parameter.name])
                       for parameter in named_parameters(scene, names, "wrt")}  # fmt: skip

    def run(self, scene: Scene, finer: float = 1.0, *, verify: bool = False) -> Trajectory:
        """A run. finer: as in `along`."""
        self.simulations += 1
        accuracy, times = self.accuracy / finer, self._times(finer)
        run = simulate(scene, self.times[-1], accuracy=accuracy, t_eval=times, verify=verify)
        _require_whole(run)
        return run

    def values_of(self, run: Trajectory) -> np.ndarray:
        """Objective and constraints of a run, (1 + m,). Raises SceneError where one is no finite number."""
        return np.array([value_of(function, run, name) for name, function in self.functions.items()])

    def _times(self, finer: float) -> np.ndarray:
        between = (self.times[1:] + self.times[:-1]) / 2
        return np.union1d(self.times, between) if finer > 1.0 else self.times

    def _difference(self, x: np.ndarray, k: int) -> np.ndarray:
        """The derivatives (1 + m,) by variable k as a difference of runs within the bounds."""
        variables = self.variables
        step = STEP * variables.width[k]
        low, high = max(x[k] - step, variables.low[k]), min(x[k] + step, variables.high[k])
        ends = []
        for value in (low, high):
            moved = x.copy()
            moved[k] = value
            ends.append(self.values_of(self.run(variables.scene_at(moved))))
        return np.asarray((ends[1] - ends[0]) / (high - low))


def _require_whole(run: Trajectory) -> None:
    """Require a run that Ctrl-C did not cut."""
    if run.interrupted:
        raise KeyboardInterrupt
