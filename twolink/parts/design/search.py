"""The search: SciPy's SLSQP (Kraft 1988) from several starts, over the evaluations that are known so far.

Variables are scaled to [0, 1] by their bounds. The objective is scaled so that the first step is FIRST_STEP long. Every
evaluation is kept; one that a file holds is not computed again, so that a search that ended early goes on.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from twolink.errors import SceneError, TwolinkError
from twolink.io.files import write_atomic
from twolink.io.progress import Report
from twolink.parts.design.evaluation import BY_SENSITIVITIES, Evaluation, ObjectiveEvaluator
from twolink.simulation.text import as_data

ON_BOUND = 1e-9  # of the distance of the bounds: what is so near to a bound is moved onto it
FIRST_STEP = 0.1  # of the distance of the bounds
TOLERANCE = 1e-2  # times the accuracy: of the objective, relative to its size at the start
AGREEMENT = 0.02  # relative: of derivatives with a difference of runs, at the first evaluation
CHECKED = 1e-3  # of the distance of the bounds: the step of that difference
PENALTY = 100.0  # of a constraint that is not obeyed, relative to the objective, both scaled by their slopes


class _Ended(Exception):
    """The search has used up its evaluations."""


@dataclass
class MultiStart:
    """A search for the least value of the first of the evaluator's functions; the others are to be at least 0.

    sign: +1, or -1 for the greatest value. most: evaluations at most. out: a file that holds the evaluations, of a
    problem that is described by plain data. known: evaluations by the bytes of x. history: (start, evaluation) in
    order. ends: why each start ended. earlier: seconds of wall clock behind what the file held.
    """

    evaluate: ObjectiveEvaluator
    sign: float
    most: int
    out: Path | None
    problem: Mapping[str, Any]
    progress: Report | None = None
    known: dict[bytes, Evaluation] = field(default_factory=dict)
    history: list[tuple[int, Evaluation]] = field(default_factory=list)
    ends: list[str] = field(default_factory=list)
    earlier: float = 0.0
    interrupted: bool = False

    def __call__(self, starts: np.ndarray) -> None:
        """Search from starts (n, k) in [0, 1]. Raises the failure of the first evaluation of a start where all fail."""
        if self.out is not None and self.out.exists():
            self._read(self.out)
        failure: TwolinkError | None = None
        try:
            for start in starts:
                try:
                    self._from(start)
                except TwolinkError as error:
                    failure = failure or error
                    self.ends.append(f"failed: {error}")
        except KeyboardInterrupt:
            self.interrupted = True
            if not self.history:
                raise
        except _Ended:
            self.ends.append(f"{self.most} evaluations were not enough")
        if not self.history and failure is not None:
            raise failure

    def _from(self, start: np.ndarray) -> None:
        """Search from one start (k,)."""
        from scipy.optimize import minimize  # a second with the next one, which signatures do not need

        variables, place = self.evaluate.variables, len(self.ends)

        def at(u: np.ndarray) -> Evaluation:
            x = variables.low + u * variables.width
            x = np.where(u <= ON_BOUND, variables.low, np.where(u >= 1.0 - ON_BOUND, variables.high, x))
            return self._evaluation(x, place)

        first = at(start)
        scale = self.sign * float(np.linalg.norm(first.gradients[0] * variables.width) / FIRST_STEP or 1.0)
        size, sizes, limits = max(abs(first.values[0]), FIRST_STEP * abs(scale)), self._sizes()[1:], list[Any]()
        if len(sizes):
            limits = [{"type": "ineq", "fun": lambda u: at(u).values[1:] / sizes,
                       "jac": lambda u: at(u).gradients[1:] * variables.width / sizes[:, None]}]  # fmt: skip
        found = minimize(
            lambda u: at(u).values[0] / scale, start, jac=lambda u: at(u).gradients[0] * variables.width / scale,
            method="SLSQP", bounds=[(0.0, 1.0)] * len(start), constraints=limits,
            options={"ftol": TOLERANCE * self.evaluate.accuracy * size / abs(scale), "maxiter": self.most},
        )  # fmt: skip
        self.ends.append(str(found.message))

    def _evaluation(self, x: np.ndarray, start: int) -> Evaluation:
        """The evaluation at x, known or new."""
        key = x.tobytes()
        if key not in self.known:
            if len(self.known) >= self.most:
                raise _Ended
            best = self.best()
            self.report(f"start {start + 1}: {f'best {best.values[0]:.6g}' if best else 'the first run'}")
            found = self.evaluate(x)
            if not self.known and found.by == BY_SENSITIVITIES:
                found = self._checked(found)
            self.known[key] = found
            if self.out is not None:
                self._write(self.out)
        found = self.known[key]
        if not any(one is found for _, one in self.history):
            self.history.append((start, found))
        return found

    def report(self, label: str) -> None:
        """Tell how far the search is."""
        if self.progress is not None:
            self.progress(len(self.known), self.most, label)

    def best(self) -> Evaluation | None:
        """The best evaluation: the objective, and a penalty for each constraint that is not obeyed."""
        if not self.history:
            return None
        sizes = self._sizes()

        def merit(one: Evaluation) -> float:
            own = one.values / sizes
            return self.sign * float(own[0]) + PENALTY * float(np.maximum(-own[1:], 0.0).sum())

        return min((one for _, one in self.history), key=merit)

    def _sizes(self) -> np.ndarray:
        """Sizes (1 + m,) of the functions: their changes across the bounds, by the slopes of the first evaluation."""
        slopes = np.linalg.norm(self.history[0][1].gradients * self.evaluate.variables.width, axis=1)
        return np.where(slopes > 0.0, slopes, 1.0)

    def _checked(self, found: Evaluation) -> Evaluation:
        """The first evaluation, if its derivatives agree with a difference of runs along a direction.

        They do not where an objective uses what moves with the variable and is not in the samples.
        """
        evaluate, variables = self.evaluate, self.evaluate.variables
        inward = np.where(found.x - variables.low < 0.5 * variables.width, 1.0, -1.0)
        direction = inward * variables.width * np.random.default_rng(0).uniform(0.5, 1.0, len(inward))
        ends = [evaluate.values_of(evaluate.run(variables.scene_at(found.x + k * CHECKED * direction))) for k in (1, 2)]
        measured = (4.0 * ends[0] - ends[1] - 3.0 * found.values) / (2.0 * CHECKED)
        size = np.abs(found.gradients) @ np.abs(direction)
        noise = 10.0 * evaluate.accuracy * (1.0 + np.abs(found.values)) / CHECKED
        off = np.abs(found.gradients @ direction - measured)
        if (off <= AGREEMENT * size + noise).all():
            return found
        reason = "derivatives along a run do not agree with differences of runs: what the function uses is not smooth"
        evaluate.by_runs.update(dict.fromkeys(variables.names, reason))
        return evaluate(found.x)

    def _write(self, path: Path) -> None:
        rows = as_data([*self.known.values()])
        content = {"problem": self.problem, "by_runs": self.evaluate.by_runs, "evaluations": rows}
        write_atomic(path, lambda file: file.write(json.dumps(content).encode()), error=SceneError)

    def _read(self, path: Path) -> None:
        """The evaluations of a file. Raises SceneError where it is of another problem."""
        try:
            content = json.loads(path.read_bytes())
            problem, rows, by_runs = content["problem"], content["evaluations"], content["by_runs"]
        except (OSError, ValueError, KeyError, TypeError):
            raise _other(path, "it holds no search", "not-a-search") from None
        other = next((name for name, value in self.problem.items() if problem.get(name) != value), None)
        if other is not None:
            theirs, ours = problem.get(other), self.problem[other]
            raise _other(path, f"it holds another search: its {other} is {theirs!r}, not {ours!r}")
        self.evaluate.by_runs.update(by_runs)
        for row in rows:
            arrays = {name: np.array(value, dtype=float) for name, value in row.items() if isinstance(value, list)}
            one = Evaluation(**row | arrays)
            self.known[one.x.tobytes()] = one
            self.evaluate.simulations += one.simulations
            self.earlier += one.seconds
        if self.known:
            self._require_same(min(self.known.values(), key=lambda one: self.sign * one.values[0]), path)

    def _require_same(self, one: Evaluation, path: Path) -> None:
        """Require that the functions still give what a file has: their names do not tell what they compute."""
        evaluate, scene = self.evaluate, self.evaluate.variables.scene_at(one.x)
        run = evaluate.along(scene, evaluate.variables.names)[0] if one.by == BY_SENSITIVITIES else evaluate.run(scene)
        now = evaluate.values_of(run)
        if not np.abs(now - one.values).max() <= 10.0 * evaluate.accuracy * (1.0 + np.abs(one.values)).max():
            raise _other(path, f"it holds another search: its functions give {one.values.tolist()} where these give "
                         f"{now.tolist()}")  # fmt: skip


def _other(path: Path, what: str, code: str = "another-search") -> SceneError:
    """The error for a file of something else."""
    return SceneError(what, argument="out", where=str(path), remedy="give another file", code=code)


def starting_points(own: np.ndarray, count: int, seed: int) -> np.ndarray:
    """Points (count, k) in [0, 1]: the scene's own values, then a Latin hypercube."""
    from scipy.stats import qmc

    others = qmc.LatinHypercube(len(own), seed=seed).random(count - 1) if count > 1 else np.empty((0, len(own)))
    return np.concatenate([np.clip(own, 0.0, 1.0)[None], others])
