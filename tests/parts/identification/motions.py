"""Smooth motions with known derivatives, and torques with noise."""

import numpy as np

import twolink as tl

FINGERS = {"panda_finger_joint1": 0.0, "panda_finger_joint2": 0.0}


def motion(robot: tl.Robot, n: int = 300, seed: int = 0, duration: float = 8.0) -> tuple[np.ndarray, ...]:
    """t (n,), and q, v, a (n, nv) of a Fourier series of five harmonics, for joints of one coordinate."""
    rng = np.random.default_rng(seed)
    t, base = np.linspace(0, duration, n), 2 * np.pi / duration
    k = base * np.arange(1, 6)[:, None]
    sines, cosines = rng.uniform(-0.5, 0.5, (2, 5, robot.nv))
    q = np.sin(k * t).T @ (sines / k) - np.cos(k * t).T @ (cosines / k)
    v = np.cos(k * t).T @ sines + np.sin(k * t).T @ cosines
    a = -np.sin(k * t).T @ (sines * k) + np.cos(k * t).T @ (cosines * k)
    return t, q, v, a


def noisy(values: np.ndarray, deviation: float | np.ndarray, seed: int = 1) -> np.ndarray:
    return values + deviation * np.random.default_rng(seed).standard_normal(values.shape)


def columns(**arrays: np.ndarray) -> dict[str, np.ndarray]:
    """The columns of arrays (n, k), with their numbers behind the names: q0, q1, ..."""
    return {f"{name}{k}": column for name, values in arrays.items() for k, column in enumerate(values.T)}
