"""One evaluation: objective and constraints at values of the variables, with their derivatives.

The derivatives come from the sensitivities of the one run (`run_variation`). Where there are none - a number that they
do not follow, a motion that only touches a limit, an objective that asks for more than samples - differences of runs
stand in, and the evaluation says so.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from twolink.errors import AccuracyError, MissingExtraError, SceneError
from twolink.optimization.objectives import Objective, value_of
from twolink.optimization.run_variation import NotFollowedError, variation_by
from twolink.optimization.variables import Variables
from twolink.scenes import Scene
from twolink.scenes.parameters import named_parameters
from twolink.simulation.scene_run import simulate
from twolink.simulation.sensitivities import sensitivities
from twolink.simulation.sensitivity_names import wanted_of
from twolink.simulation.trajectory import Trajectory

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
class Evaluator:
    """Evaluates functions of the runs of a scene, by name: the objective, then the constraints.

    derivatives: "auto", or "runs" for differences of runs. simulations: runs so far. failures: motions without
    derivatives so far. by_runs: variables whose derivatives are differences of runs, with the reason.
    """

    variables: Variables
    functions: Mapping[str, Objective]
    duration: float | None
    accuracy: float
    samples: float
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

        finer: times as accurate, and with twice the samples above 1. Where derivatives need a more accurate run to
        tell its events apart, that is it. Raises TwolinkError where there are none.
        """
        for accuracy in (self.accuracy / finer, self.accuracy / finer * SHARPER):
            self.simulations += 1
            try:
                s = sensitivities(scene, names, self.duration, accuracy, samples=self._samples(finer))
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
        run = simulate(scene, self.duration, self.accuracy / finer, samples=self._samples(finer), verify=verify)
        _require_whole(run)
        return run

    def values_of(self, run: Trajectory) -> np.ndarray:
        """Objective and constraints of a run, (1 + m,). Raises SceneError where one is no finite number."""
        return np.array([value_of(function, run, name) for name, function in self.functions.items()])

    def _samples(self, finer: float) -> float:
        return self.samples * (2.0 if finer > 1.0 else 1.0)

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
