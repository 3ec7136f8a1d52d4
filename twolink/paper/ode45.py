"""ode45 at its default tolerances on the paper's release: how wrong the curves are, and what right digits cost.

The paper integrates with MATLAB's ode45, the pair of Dormand and Prince 5(4) at rtol 1e-3, atol 1e-6, which draws three
more points in each step (Refine 4). SciPy's RK45 has the same pair and the same continuous extension. Its step control
differs in details: the norm of the error estimate (root mean square, there the maximum), the first step and the safety
factor. MaxStep is a tenth of the interval, as there.

Source: Dormand and Prince, J. Computational and Applied Mathematics 6, 1980; Shampine and Reichelt, The MATLAB ODE
Suite, SIAM J. Scientific Computing 18, 1997.
"""

import time
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from twolink.paper.motions import MASSES, ArmMotion, rate_by_hand, release
from twolink.scenes import Scene
from twolink.simulation.scene_run import simulate

RTOL, ATOL, REFINE = 1e-3, 1e-6, 4  # ode45's defaults
TIGHTER = (1e-3, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12)  # rtol; atol a thousandth of it
ACCURACIES = (1e-3, 1e-6, 1e-9)  # rad
REPEATS = 5
BEST = 1e-12  # rad: of the solution that errors are measured against
BLUE, ORANGE = "#0072B2", "#D55E00"


@dataclass(frozen=True)
class SolverCost:
    """A solution's error in theta1 and theta2 at the end [rad], the seconds of solving, and the evaluations.

    setting: rtol, or for a verified run the accuracy asked for [rad]; bar: its error bar [rad], else None.
    compile_seconds: of tracing once, beside them.
    """

    setting: float
    error: tuple[float, float]
    seconds: float
    evaluations: int
    bar: float | None = None
    compile_seconds: float = 0.0

    @property
    def largest(self) -> float:
        """The larger error [rad]."""
        return max(self.error)


@dataclass(frozen=True)
class DefaultsStudy:
    """ode45 at its defaults against the solution, on links of `length` [m] over three cycles.

    drawn: ode45's points, four a step. off (n, 2): their errors [rad]; known to `known` [rad]. pair: by rtol. verified:
    `tl.simulate` by the accuracy asked for.
    """

    length: float
    drawn: ArmMotion
    right: ArmMotion
    off: np.ndarray
    known: float
    pair: tuple[SolverCost, ...]
    verified: tuple[SolverCost, ...]


def defaults_study(length: float, seconds: float) -> DefaultsStudy:
    """Solve by ode45's pair at its defaults and tighter, and by `tl.simulate`, and measure errors and times."""
    scene = release(length, seconds)
    truth = simulate(scene, accuracy=BEST, samples_per_second=200.0)
    if truth.interrupted or truth.error is None:
        raise KeyboardInterrupt
    solution = _solved(length, seconds, RTOL)[0]
    steps = solution.t
    times = np.append(np.concatenate([np.linspace(a, b, REFINE, endpoint=False)
                                      for a, b in pairwise(steps)]), steps[-1])  # fmt: skip
    x = solution.sol(times).T
    off = np.abs(x[:, :2] - truth.at(times)[0])
    pair = []
    for rtol in TIGHTER:
        found, taken = _solved(length, seconds, rtol)
        one, two = (float(e) for e in np.abs(found.y[:2, -1] - truth.q[-1]))
        pair.append(SolverCost(rtol, (one, two), taken, found.nfev))
    verified = [_verified(scene, accuracy, truth.q[-1]) for accuracy in ACCURACIES]
    right = ArmMotion(truth.t, truth.q, truth.v, length)
    drawn = ArmMotion(times, x[:, :2], x[:, 2:], length)
    return DefaultsStudy(length, drawn, right, off, float(truth.error.max()), tuple(pair), tuple(verified))


def _verified(scene: Scene, accuracy: float, end: np.ndarray) -> SolverCost:
    """The cost of `tl.simulate` for an accuracy, the least of several runs, and its errors at the end (2,) [rad]."""
    taken, compiling, found = [], [], []
    for _ in range(REPEATS):
        run = simulate(scene, accuracy=accuracy, samples_per_second=200.0)
        if run.interrupted or run.cost is None or run.error is None:
            raise KeyboardInterrupt
        taken.append(run.cost.seconds + run.cost.verify_seconds)
        compiling.append(run.cost.compile_seconds)
        found.append((run.cost.evaluations, float(run.error.max()), np.abs(run.q[-1] - end).tolist()))
    evaluations, bar, (one, two) = found[-1]
    return SolverCost(accuracy, (one, two), min(taken), evaluations, bar, max(compiling))


def _solved(length: float, seconds: float, rtol: float) -> tuple[Any, float]:
    """SciPy's solution by the pair of ode45, and the least seconds of solving."""
    from scipy.integrate import solve_ivp

    rate, taken = rate_by_hand((length, length), MASSES), []
    for _ in range(REPEATS):
        begin = time.perf_counter()
        solution = solve_ivp(rate, (0.0, seconds), np.zeros(4), "RK45", rtol=rtol, atol=rtol * ATOL / RTOL,
                             max_step=seconds / 10, dense_output=rtol == RTOL)  # fmt: skip
        taken.append(time.perf_counter() - begin)
    return solution, min(taken)


def draw_defaults(study: DefaultsStudy, axes: Any) -> None:
    """The curves of ode45 and the right ones, its error over time, and error against time of computing."""
    curves, errors, costs = axes
    curves.plot(study.right.t, study.right.theta[:, 1], color="0.62", linewidth=3.2, label="right digits")
    curves.plot(study.drawn.t, study.drawn.theta[:, 1], color="0.0", linewidth=1.1, label="ode45 at its defaults")
    curves.set(title="Fig. 7 as ode45 draws it", xlabel="time t (s)", ylabel="$\\theta_2$ (rad)", ylim=(-1.8, 1.3))
    curves.legend(loc="lower left", frameon=False)
    for link, colour in enumerate((BLUE, ORANGE)):
        largest = np.maximum.accumulate(study.off[1:, link])
        errors.semilogy(study.drawn.t[1:], largest, color=colour, label=f"$\\theta_{link + 1}$")
    errors.set(title="largest error of ode45's defaults so far", xlabel="time t (s)", ylabel="error (rad)",
               ylim=(1e-6, 1.0))  # fmt: skip
    errors.legend(loc="lower right", frameon=False)
    for rows, colour, marker, name in ((study.pair, ORANGE, "o", "ode45's pair (SciPy), by rtol"),
                                       (study.verified, BLUE, "s", "tl.simulate with its error bar")):  # fmt: skip
        costs.loglog([row.largest for row in rows], [1e3 * row.seconds for row in rows], marker=marker, color=colour,
                     label=name)  # fmt: skip
        for row in rows:
            costs.annotate(f"{row.setting:.0e}".replace("e-0", "e-"), (row.largest, 1e3 * row.seconds), fontsize=7,
                           xytext=(3, -9), textcoords="offset points", color=colour)  # fmt: skip
    costs.invert_xaxis()
    costs.set(
        title="what right digits cost, after a first run", xlabel="error after three cycles (rad)", ylabel="time (ms)"
    )
    costs.legend(loc="upper left", frameon=False)
