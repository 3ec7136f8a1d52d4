"""Motions with events in closed form: balls that bounce, a mass between a spring and a stop, dry friction."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

import twolink as tl
from scripts.studies.scenes.robots import gravity, slider, uniform
from twolink import effects as fx


class Motion(NamedTuple):
    """A scene, its duration [s], and its configurations (n, nq) at times (n,)."""

    what: str
    scene: tl.Scene
    duration: float
    exact: Callable[[np.ndarray], np.ndarray]


def elastic_ball(random: np.random.Generator) -> Motion:
    """A ball that bounces without loss: parabolas."""
    height, g = uniform(random, 0.3, 2.0), float(random.integers(100, 165)) / 16

    def exact(t: np.ndarray) -> np.ndarray:
        fall = np.sqrt(2 * np.longdouble(height) / g)
        s = np.mod(t.astype(np.longdouble) + fall, 2 * fall) - fall
        return (height - g * s * s / 2)[:, None]

    scene = tl.Scene(slider(1.0), [height], effects=[gravity(g), fx.PlaneContact("body", restitution=1.0)])
    return Motion("elastic ball", scene, uniform(random, 10, 200), exact)


def bouncing_ball(random: np.random.Generator) -> Motion:
    """A ball that loses speed at each bounce, until shortly before it rests."""
    height, g, e = uniform(random, 0.3, 2.0), float(random.integers(100, 165)) / 16, uniform(random, 0.5, 0.95)
    fall = math.sqrt(2 * height / g)

    def exact(t: np.ndarray) -> np.ndarray:
        out, real = np.zeros(len(t), np.longdouble), np.longdouble
        start, speed, t = -np.sqrt(2 * real(height) / g), np.sqrt(2 * real(height) * g), t.astype(real)
        while start < t[-1]:
            s = t - start
            out = np.where((s >= 0) & (s <= 2 * speed / g), speed * s - g * s * s / 2, out)
            start, speed = start + 2 * speed / g, e * speed
        return out[:, None]

    rest = fall * (1 + e) / (1 - e)
    scene = tl.Scene(slider(1.0), [height], effects=[gravity(g), fx.PlaneContact("body", restitution=e)])
    return Motion("bouncing ball", scene, min(30.0, rest * uniform(random, 0.3, 0.95)), exact)


def between_stops(random: np.random.Generator) -> Motion:
    """A mass on a spring that a stop reflects: a cosine without the part below the stop."""
    mass, stiffness = (float(random.integers(8, 32)) / 16 for _ in range(2))
    start, stop = uniform(random, 0.5, 1.5), -uniform(random, 0.05, 0.45)

    def exact(t: np.ndarray) -> np.ndarray:
        w = np.sqrt(np.longdouble(stiffness) / mass)
        half = np.arccos(np.longdouble(stop) / start) / w  # from the turning point to the stop
        s = np.mod(t.astype(np.longdouble), 2 * half)
        return (start * np.cos(w * np.minimum(s, 2 * half - s)))[:, None]

    stops = fx.JointStops({"joint": (stop, math.inf)}, restitution=1.0)
    scene = tl.Scene(slider(mass), [start], effects=[fx.JointSpring({"joint": stiffness}), stops])
    return Motion("spring and stop", scene, uniform(random, 5, 100), exact)


def stick_slip(random: np.random.Generator) -> Motion:
    """A mass on a spring with dry friction: half cosines about F / k on either side, until the spring is weaker."""
    w, reach = float(random.integers(4, 40)) / 4, uniform(random, 0.01, 0.2)
    half = np.longdouble(math.pi) / w + np.longdouble(1.2246467991473532e-16) / w

    def exact(t: np.ndarray) -> np.ndarray:
        last = math.ceil((1.0 - reach) / (2 * reach) - 1e-12)
        n = np.minimum(np.floor(t / half), last)
        amplitude, sign = 1.0 - 2 * reach * n, (-1.0) ** n
        moving = reach + (amplitude - reach) * np.cos(w * (t - n * half))
        return (sign * np.where(n < last, moving, amplitude))[:, None]

    friction = fx.DryFriction({"joint": reach * w * w})
    scene = tl.Scene(slider(1.0), [1.0], effects=[fx.JointSpring({"joint": w * w}), friction])
    return Motion("stick and slip", scene, uniform(random, 2, 8 * float(half)), exact)
