"""The paper's release, from rest in the horizontal position: by hand-derived equations, and by URDF and Pinocchio.

The paper gives no lengths and masses. With equal lengths and m1 : m2 = 3 : 1 its motion comes out. Time scales with
sqrt(l), so that the length alone decides whether a cycle takes 3 s or 0.75 s.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from twolink.dynamics import load_robot
from twolink.effects import Gravity
from twolink.lagrange import Variant, formulas, two_link
from twolink.lagrange.check import arm_urdf
from twolink.scenes import Scene
from twolink.simulation.scene_run import simulate

G = 9.81  # m/s^2
CYCLES = 3
SAMPLES = 400  # a cycle
TOLERANCE = 1e-12  # of DOP853
ACCURACY = 1e-9  # rad, of the runs by URDF
MASSES = (3.0, 1.0)  # kg
Pair = tuple[float, float]


@dataclass(frozen=True)
class ArmMotion:
    """Angles theta [rad] and speeds dtheta [rad/s] (n, 2) at times t (n,) [s].

    length: of link 1, and of link 2 unless `ratio` (l2 / l1) is another [m]. masses: m1, m2 [kg].
    """

    t: np.ndarray
    theta: np.ndarray
    dtheta: np.ndarray
    length: float
    masses: Pair = MASSES
    ratio: float = 1.0

    def link_energies(self) -> tuple[np.ndarray, np.ndarray]:
        """Kinetic and potential energies (n, 2) [J] of links 1 and 2; potential ones are 0 at shoulder height.

        K1 = m1 l1^2 td1^2 / 6,  V1 = m1 g l1 sin(theta1) / 2,  K2 = K - K1,  V2 = V - V1
        """
        arm = two_link((self.length, self.ratio * self.length), self.masses, G)
        kinetic, potential = arm.energy(self.theta, self.dtheta)
        k1 = self.masses[0] * self.length**2 * self.dtheta[:, 0] ** 2 / 6
        v1 = self.masses[0] * G * self.length * np.sin(self.theta[:, 0]) / 2
        return np.stack([k1, kinetic - k1], axis=1), np.stack([v1, potential - v1], axis=1)


def rate_by_hand(
    lengths: Pair, masses: Pair, variant: Variant = "corrected"
) -> Callable[[float, np.ndarray], list[float]]:
    """x' = f(t, x) of the hand-derived equations without torques (eq. 22), in plain floats: x = (theta, dtheta)."""

    def rate(_t: float, x: np.ndarray) -> list[float]:
        angle1, angle2, w1, w2 = x.tolist()
        theta = angle1, angle2
        (a11, a12), (_, a22) = formulas.mass_entries(lengths, masses, theta, math)
        (b11, _), _ = formulas.product_entries(lengths, masses, theta, math)
        (_, c12), (c21, c22) = formulas.square_entries(lengths, masses, theta, math, variant)
        d1, d2 = formulas.gravity_entries(lengths, masses, G, theta, math)
        h1, h2 = b11 * w1 * w2 + c12 * w2 * w2 + d1, c21 * w1 * w1 + c22 * w2 * w2 + d2
        det = formulas.mass_determinant(lengths, masses, theta, math)
        return [w1, w2, (a12 * h2 - a22 * h1) / det, (a12 * h1 - a11 * h2) / det]

    return rate


def by_hand(
    length: float, seconds: float, masses: Pair = MASSES, variant: Variant = "corrected", ratio: float = 1.0
) -> ArmMotion:
    """The hand-derived model, released at rest in the horizontal position. ratio: l2 / l1."""
    from scipy.integrate import solve_ivp  # its import takes a third of a second

    times = np.linspace(0, seconds, CYCLES * SAMPLES + 1)
    rate = rate_by_hand((length, ratio * length), masses, variant)
    solution = solve_ivp(rate, (0, seconds), np.zeros(4), "DOP853", times, rtol=TOLERANCE, atol=TOLERANCE)
    return ArmMotion(times, solution.y[:2].T, solution.y[2:].T, length, masses, ratio)


def release(length: float, seconds: float) -> Scene:
    """A scene of the arm's release at rest in the horizontal position, from a URDF."""
    robot = load_robot(arm_urdf(length, length, *MASSES))
    return Scene(robot, effects=[Gravity()], duration=seconds)


def by_urdf(length: float, seconds: float) -> ArmMotion:
    """The motion of `release`, through Pinocchio. Its global error is below ACCURACY."""
    scene = release(length, seconds)
    run = simulate(scene, accuracy=ACCURACY, samples_per_second=CYCLES * SAMPLES / seconds)
    if run.interrupted:
        raise KeyboardInterrupt
    return ArmMotion(run.t, run.q, run.v, length)


def cycle_time(motion: ArmMotion) -> float:
    """The time of the first cycle [s]: theta1 is at its highest again, where its speed crosses zero downwards."""
    w = motion.dtheta[:, 0]
    i = int(np.flatnonzero((w[:-1] > 0) & (w[1:] <= 0))[0])
    return float(motion.t[i] + w[i] / (w[i] - w[i + 1]) * (motion.t[i + 1] - motion.t[i]))


def sign_changes(values: np.ndarray) -> np.ndarray:
    """Indices before which the values change their sign; the first sample, at rest, does not count."""
    return np.flatnonzero(np.diff(np.sign(values[1:])) != 0) + 1


def recurrence(motion: ArmMotion) -> float:
    """The nearest return of the state to its start after a fifth of the time, as a part of the state's own range."""
    state = np.hstack([motion.theta, motion.dtheta * np.sqrt(motion.length / G)])
    late = motion.t > motion.t[-1] / 5
    return float(np.abs(state[late]).max(axis=1).min() / np.ptp(state, axis=0).max())
