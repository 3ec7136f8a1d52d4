"""Energy over many steps of one size: which methods drift.

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
"""

import functools
from typing import Any

import numpy as np
import pytest

import twolink as tl
from twolink.algorithms.tape import Tape
from twolink.errors import AccuracyError
from twolink.lagrange.check import arm_urdf
from twolink.native.machine import Program, trace

SYMMETRIC = ("implicit-midpoint", "suzuki4")
DRIFTING = ("rk4", "semi-implicit-euler")
CANONICAL = "implicit-midpoint in (q, p)"
SAMPLES, PARTS = 20_000, 50
STEPS, MANY_STEPS = 20_000, 1_000_000
SWEEPS = 14  # of fixed-point iteration in a canonical step; the step fails unless the last sweep changes nothing
G = 9.81


def motion(name: str) -> tuple[tl.Scene, float, float]:
    """The scene, the step [s] and the mass of the upper rod [kg]."""
    if name == "arm-swing":
        return tl.load_scene("arm-swing"), 0.01, 3.0
    return tl.Scene(tl.load_robot(arm_urdf(1, 1, 1, 1)), effects=[tl.effects.Gravity((0.0, 0.0, -G))]), 0.0025, 1.0


@functools.cache
def study(name: str, method: str, steps: int) -> tuple[float, float, float, float]:
    """Drift, its noise, the wander and von Neumann's ratio of a method on a motion; printed with -s."""
    scene, h, mass = motion(name)
    _, error = canonical(scene, h, steps, mass) if method == CANONICAL else ours(scene, method, h, steps)
    size, noise, wander, ratio = drift(error)
    print(f"{name:<12}{method:<30}{np.abs(error).max():>10.1e}{size:>10.1e}{noise:>10.1e}{wander:>10.1e}{ratio:>7.2f}")
    return size, noise, wander, ratio


@pytest.mark.parametrize("method", [*SYMMETRIC, CANONICAL])
def test_symmetric_methods_do_not_drift_on_a_nearly_periodic_motion(method: str) -> None:
    size, noise, _, ratio = study("arm-swing", method, STEPS)
    assert abs(size) <= 3 * noise
    assert ratio >= 1


@pytest.mark.parametrize("method", DRIFTING)
def test_other_methods_drift(method: str) -> None:
    size, noise, _, _ = study("arm-swing", method, STEPS)
    assert abs(size) > 3 * noise


def test_only_canonical_variables_keep_the_energy_of_a_chaotic_motion() -> None:
    size, noise, _, ratio = study("equal rods", CANONICAL, STEPS)
    assert abs(size) <= 3 * noise
    assert ratio >= 1
    size, noise, _, ratio = study("equal rods", "implicit-midpoint", STEPS)
    assert abs(size) > 3 * noise or ratio < 1


@pytest.mark.slow
@pytest.mark.parametrize("method", ["suzuki4", CANONICAL])
def test_a_million_steps_without_drift(method: str) -> None:
    size, noise, _, _ = study("arm-swing", method, MANY_STEPS)
    assert abs(size) <= 3 * noise


def ours(scene: tl.Scene, method: str, h: float, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """The samples' times and relative energy errors (n,) of twolink's method."""
    run = tl.simulate(scene, steps * h, method=method, step=h, verify=False, samples_per_second=SAMPLES / (steps * h))
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

    def formula(x: np.ndarray, xp: Tape) -> list[Any]:
        k = previous = hamilton(x, mass, xp)
        for _ in range(SWEEPS):
            k, previous = hamilton(x + k * (h / 2), mass, xp), k
        return [*(x + k * h), *(k - previous)]

    step = Program(trace(formula, 4))
    state, lost = np.concatenate([scene.q, scene.robot.mass_matrix(scene.q) @ scene.v]), np.zeros(4)
    every = max(1, steps // SAMPLES)
    kept = [state.copy()]
    for n in range(1, steps + 1):
        out = step(state)
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


def hamilton(x: np.ndarray, mass: float, xp: Tape) -> np.ndarray:
    """(q, p)' of the arm of two rods of 1 m: v = M^-1 p, p' = -dH/dq."""
    q1, q2, p1, p2 = x
    a, b, d = (mass / 3 + 1) + 1 / 3 + xp.cos(q2), 1 / 3 + 0.5 * xp.cos(q2), 1 / 3
    det = a * d - b * b
    v1, v2 = (d * p1 - b * p2) / det, (a * p2 - b * p1) / det
    second = 0.5 * G * xp.cos(q1 + q2)
    return np.array([v1, v2, -(mass / 2 + 1) * G * xp.cos(q1) - second, -0.5 * xp.sin(q2) * v1 * (v1 + v2) - second])
