"""Derivatives of a function of a run by its samples, and by constants that it uses besides."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from twolink.errors import SceneError
from twolink.integrate.effect_numbers import nominal_value
from twolink.optimization.neighbours import NotFollowedError, Unknown, beside, fourth_order
from twolink.optimization.objectives import Objective, value_of
from twolink.simulation.sensitivity_names import Wanted
from twolink.simulation.trajectory import Trajectory

Array = np.ndarray
Slopes = Callable[[Trajectory], tuple[Array, Array]]
SHARE = 1e-3  # of a constant: the step of differences by it
SMALL = 1e-3  # SI units: constants below it are moved as if they were so large


def by_samples(
    run: Trajectory, function: Objective, slopes: Slopes | None, step: float, samples: Array | None = None
) -> tuple[Array, Array]:
    """The samples (m,) on which a function depends, or those given, and its derivatives (m, 2 nv) by their states."""
    n, nv = run.v.shape
    if slopes is not None:
        of_q, of_v = (np.asarray(rows, dtype=float) for rows in slopes(run))
        if of_q.shape != (n, nv) or of_v.shape != (n, nv):
            raise SceneError(f"expected two arrays of shape {(n, nv)}, got {of_q.shape} and {of_v.shape}",
                             argument="slopes", remedy="return dF/dq and dF/dv by the samples")  # fmt: skip
        found = np.concatenate([of_q, of_v], axis=1)
        samples = np.flatnonzero(found.any(axis=1)) if samples is None else samples
        return samples, found[samples]
    if samples is None:
        samples = np.arange(n) if _depends_on_earlier(run, function, step) else np.array([n - 1])
    found = np.empty((len(samples), 2 * nv))
    for row, sample in enumerate(samples):
        for entry in range(2 * nv):

            def value(k: float, sample: int = sample, entry: int = entry) -> float:
                change = np.zeros((n, 2 * nv))
                change[sample, entry] = k
                return value_of(function, beside(run, change[:, :nv], change[:, nv:], {}))

            found[row, entry] = fourth_order(value, step)
    return samples, found


def _depends_on_earlier(run: Trajectory, function: Objective, step: float) -> bool:
    """Whether a function depends on other samples than the last."""
    n, nv = run.v.shape
    change = step * np.random.default_rng(0).uniform(-1.0, 1.0, (n, 2 * nv))
    change[-1] = 0.0
    return value_of(function, beside(run, change[:, :nv], change[:, nv:], {})) != value_of(function, run)


def by_constants(run: Trajectory, wanted: Wanted, function: Objective) -> Array:
    """The derivatives (k,) of a function by the constants that it uses besides the samples, by each column.

    Raises SceneError, code "gradient-objective", where constants that it uses change with a parameter indirectly.
    """
    names, neighbours = wanted.neighbours.names, wanted.neighbours
    at_rest, own = np.zeros_like(run.v), value_of(function, run)
    pieces = run.solution.pieces if run.solution else ()
    others = {name: nominal_value(pieces[0].equations, name) for name in neighbours.constants if name not in names}
    steps = {name: SHARE * max(abs((wanted.values | others)[name]), SMALL) for name in neighbours.constants}

    def used(changes: dict[str, float]) -> bool:
        return bool(changes) and value_of(function, beside(run, at_rest, at_rest, changes)) != own

    if used({name: step for name, step in steps.items() if name not in names}) or (
        neighbours.has_friction and _uses_torques(run, function)
    ):
        raise SceneError("energy or torques, which it uses, change with a parameter indirectly", argument="objective",
                         remedy="use samples only, or ask for physical constants and numbers of what acts",
                         code="gradient-objective")  # fmt: skip
    direct = {name: step for name, step in steps.items() if name in names}
    found = np.zeros(len(names))
    for name, step in direct.items() if used(direct) else ():

        def value(k: float, name: str = name) -> float:
            return value_of(function, beside(run, at_rest, at_rest, {name: k}))

        found[names.index(name)] = fourth_order(value, step)
    return np.asarray(found @ wanted.start[2 * run.v.shape[1] :])


def _uses_torques(run: Trajectory, function: Objective) -> bool:
    """Whether a function asks for torques or accelerations."""
    still = np.zeros_like(run.v)
    try:
        function(replace(beside(run, still, still, {}), solution=Unknown("a torque")))  # type: ignore[arg-type]
    except NotFollowedError:
        return True
    return False
