"""Energy over a million steps of one size: which methods drift.

    python scripts/energy_drift.py [--steps 1000000]

Two motions: the paper's arm from its release (arm-swing, nearly periodic) with steps of 10 ms, and the double pendulum
of equal rods from the horizontal (chaotic) with steps of 2.5 ms. Methods: implicit-midpoint and suzuki4, both in
(q, v), against rk4 and semi-implicit-euler; and implicit-midpoint in canonical (q, p = M v), written out here for the
planar arm, which theory calls symplectic (Hairer, Lubich, Wanner: Geometric Numerical Integration, VI.4).
Error: (E - E(0)) over the range of the potential energy that the motion passes through.
Drift: the slope of a line through the means of 50 parts of the run, times its duration; its noise is the standard error
of that slope, from the scatter of the means about the line. A drift of less than 3 times its noise counts as none.
Wander: the scatter of the means about the line. It is a random walk, not an oscillation, where neighbouring means are
nearer to each other than means at large: the mean square of their differences over their variance (von Neumann's ratio)
is 2 for independent means and far less for a random walk, which has no bound in time. Below 1 it counts as one.
Writes out/energy_drift.png and out/energy_drift.csv.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from typing import Any

import heyoka as hy
import numpy as np
from _common import OUT, write_records

import twolink as tl
from twolink.errors import AccuracyError
from twolink.lagrange.pinocchio_arm import arm_urdf
from twolink.show.trajectory_plot import COLOURS, new_figure, save_figure

METHODS = ("implicit-midpoint", "suzuki4", "rk4", "semi-implicit-euler")
CANONICAL = "implicit-midpoint in (q, p)"
SAMPLES, PARTS = 20_000, 50
SWEEPS = 14  # of fixed-point iteration in a canonical step; the step fails unless the last sweep changes nothing
G = 9.81


@dataclass(frozen=True)
class Drift:
    """The energy error of a method on a motion, relative; NaN where the method failed. See the top for the words."""

    motion: str
    method: str
    seconds: float
    largest: float = float("nan")
    drift: float = float("nan")
    noise: float = float("nan")
    wander: float = float("nan")
    ratio: float = float("nan")

    @property
    def verdict(self) -> str:
        return "drifts" if abs(self.drift) > 3 * self.noise else "wanders" if self.ratio < 1 else "no drift"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=1_000_000, help="of each run (1,000,000)")
    steps = parser.parse_args().steps
    rods = tl.Scene(tl.load_robot(arm_urdf(1, 1, 1, 1)), effects=[tl.effects.Gravity((0.0, 0.0, -G))])
    motions = {"arm-swing, steps of 10 ms": (tl.load_scene("arm-swing"), 0.01, 3.0),
               "equal rods (chaotic), steps of 2.5 ms": (rods, 0.0025, 1.0)}  # fmt: skip
    figure, axes = new_figure(1, 2, size=(13, 5.2), sharey=True)
    rows = []
    for (motion, (scene, h, mass)), ax in zip(motions.items(), axes[0], strict=True):
        print(f"\n{motion}\n{'method':<30}{'seconds':>9}{'largest':>11}{'drift':>11}{'noise':>10}{'wander':>10}"
              f"{'ratio':>7}  verdict")  # fmt: skip
        for method, colour in zip((*METHODS, CANONICAL), COLOURS, strict=False):
            rows.append(study(motion, scene, method, h, steps, mass, ax, colour))
        ax.set(title=motion, xlabel="simulated time (s)", yscale="log", ylim=(1e-11, 3))
        ax.legend(loc="lower right", fontsize=9)
    axes[0, 0].set_ylabel("largest |energy error| so far, relative")
    figure.suptitle(f"Energy over {steps:,} steps: level is no loss, a slope is drift")
    write_records("energy_drift.csv", rows)
    print(f"\n{save_figure(figure, OUT / 'energy_drift.png')}")


def study(motion: str, scene: tl.Scene, method: str, h: float, steps: int, mass: float, ax: Any, colour: str) -> Drift:
    """Run a method, draw its error and print a line of the table."""
    start = time.perf_counter()
    try:
        t, error = canonical(scene, h, steps, mass) if method == CANONICAL else ours(scene, method, h, steps)
    except AccuracyError as failure:
        seconds = time.perf_counter() - start
        print(f"{method:<30}{seconds:>9.1f}  failed: {failure.where}")
        ax.plot([], [], color=colour, label=f"{method}: failed at {failure.where}")
        return Drift(motion, method, seconds)
    row = Drift(motion, method, time.perf_counter() - start, float(np.abs(error).max()), *drift(error))
    print(f"{method:<30}{row.seconds:>9.1f}{row.largest:>11.1e}{row.drift:>11.1e}{row.noise:>10.1e}"
          f"{row.wander:>10.1e}{row.ratio:>7.2f}  {row.verdict}", flush=True)  # fmt: skip
    ax.plot(t[1:], np.maximum.accumulate(np.abs(error))[1:], color=colour, label=f"{method}: {row.verdict}",
            linestyle="--" if method == CANONICAL else "-")  # fmt: skip
    return row


def ours(scene: tl.Scene, method: str, h: float, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """The samples' times and relative energy errors (n,) of twolink's method."""
    run = tl.simulate(scene, steps * h, method=method, step=h, verify=False, samples=SAMPLES / (steps * h))
    return run.t, (run.energy - run.energy[0]) / np.ptp(scene.robot.energy(run.q, run.v)[1])


def drift(error: np.ndarray) -> tuple[float, float, float, float]:
    """The rise of the line through the parts' means over the run and its standard error, the scatter of the means about
    the line, and von Neumann's ratio of it."""
    means = np.array([part.mean() for part in np.array_split(error[1:], PARTS)])
    x = (np.arange(PARTS) + 0.5) / PARTS
    slope, offset = np.polyfit(x, means, 1)
    left = means - offset - slope * x
    variance = left @ left / (PARTS - 2)
    noise = np.sqrt(variance / ((x - x.mean()) ** 2).sum())
    return float(slope), float(noise), float(np.sqrt(variance)), float(np.mean(np.diff(left) ** 2) / variance)


def canonical(scene: tl.Scene, h: float, steps: int, mass: float) -> tuple[np.ndarray, np.ndarray]:
    """The same by the implicit midpoint rule on Hamilton's equations of two rods of 1 m, of `mass` and 1 kg."""
    x = np.array(hy.make_vars("q1", "q2", "p1", "p2"))
    k = previous = hamilton(x, mass)
    for _ in range(SWEEPS):
        k, previous = hamilton(x + k * (h / 2), mass), k
    step = hy.cfunc([*(x + k * h), *(k - previous)], vars=list(x))
    state, out, lost = np.concatenate([scene.q, scene.robot.mass_matrix(scene.q) @ scene.v]), np.empty(8), np.zeros(4)
    every = max(1, steps // SAMPLES)
    kept = [state.copy()]
    for n in range(1, steps + 1):
        step(state, outputs=out)
        increment = (out[:4] - state) - lost  # compensated sums: the study is not about rounding
        new = state + increment
        lost = (new - state) - increment
        state = new
        if n % every == 0:
            kept.append(state.copy())
            if not np.abs(out[4:]).max() < 1e-6:
                raise AccuracyError("the iteration does not converge", where=f"t = {n * h:g} s", remedy="smaller steps")
    states = np.array(kept)
    q, v = states[:, :2], np.linalg.solve(scene.robot.mass_matrix(states[:, :2]), states[:, 2:, None])[..., 0]
    kinetic, potential = scene.robot.energy(q, v)
    energy = kinetic + potential
    return np.arange(len(states)) * every * h, (energy - energy[0]) / np.ptp(potential)


def hamilton(x: np.ndarray, mass: float) -> np.ndarray:
    """(q, p)' of the arm of two rods of 1 m: v = M^-1 p, p' = -dH/dq."""
    q1, q2, p1, p2 = x
    a, b, d = (mass / 3 + 1) + 1 / 3 + hy.cos(q2), 1 / 3 + 0.5 * hy.cos(q2), 1 / 3
    det = a * d - b * b
    v1, v2 = (d * p1 - b * p2) / det, (a * p2 - b * p1) / det
    second = 0.5 * G * hy.cos(q1 + q2)
    return np.array([v1, v2, -(mass / 2 + 1) * G * hy.cos(q1) - second, -0.5 * hy.sin(q2) * v1 * (v1 + v2) - second])


if __name__ == "__main__":
    main()
