"""Events: dry friction, stops, infinitely many bounces, sliding and rolling, friction that allows no motion."""

import math

import numpy as np

from twolink import effects as fx
from twolink.dynamics import load_robot
from twolink.errors import AccuracyError
from twolink.hard import truths
from twolink.hard.case import SCENES as FOLDER
from twolink.hard.case import ErrorCheck
from twolink.scenes import Scene
from twolink.simulation.scene_run import simulate

GRAVITY = 9.81


def _stiction(t: np.ndarray) -> np.ndarray:
    """Half cosines about F/k on either side, each shorter by 2 F/k, until the spring is weaker than the friction."""
    w, reach = 10.0, 0.47 / 100.0
    half = math.pi / w
    last = math.ceil((1.0 - reach) / (2 * reach) - 1e-12)  # the half after which |x| <= F/k
    n = np.minimum(np.floor(t / half), last)
    amplitude, sign, moves = 1.0 - 2 * reach * n, (-1.0) ** n, n < last
    moving = (amplitude - reach) * np.cos(w * (t - n * half))
    return np.asarray(sign * np.where(moves, reach + moving, amplitude))[:, None]


def _grazing(*, hit: bool) -> truths.ExactMotion:
    """cos t; after each hit of the stop at -1 + 1e-10 with restitution 0.5 a slightly smaller, shifted cosine."""
    stop, restitution = -1.0 + (1e-10 if hit else -1e-10), 0.5

    def exact(t: np.ndarray) -> np.ndarray:
        amplitude, phase, start = 1.0, 0.0, 0.0
        out = np.cos(t)
        while hit and amplitude > -stop and start < t[-1]:
            angle = math.pi - math.acos(-stop / amplitude)  # of the cosine where it falls to the stop
            wait = (angle - phase) % (2 * math.pi)
            start += wait if wait > 1e-9 else wait + 2 * math.pi
            speed = restitution * math.sqrt(amplitude**2 - stop**2)
            amplitude, phase = math.hypot(stop, speed), math.atan2(-speed, stop)
            out = np.where(t >= start, amplitude * np.cos(t - start + phase), out)
        return np.asarray(out)[:, None]

    return exact


def _bounces(t: np.ndarray) -> np.ndarray:
    """Parabolas, each half as fast as the one before; 0 after the last."""
    restitution, first = 0.5, math.sqrt(2 / GRAVITY)
    out = np.where(t <= first, 1.0 - GRAVITY * t**2 / 2, 0.0)
    start, speed = first, restitution * GRAVITY * first
    while speed > 1e-15:
        s = t - start
        out = np.where((s > 0) & (s <= 2 * speed / GRAVITY), speed * s - GRAVITY * s**2 / 2, out)
        start, speed = start + 2 * speed / GRAVITY, restitution * speed
    return np.asarray(out)[:, None]


def _two_stops(t: np.ndarray) -> np.ndarray:
    """cos 2t between -0.5 and 1, reflected without loss: periodic with 2 pi / 3."""
    s = np.mod(t, 2 * math.pi / 3)
    return np.repeat(np.cos(2 * np.minimum(s, 2 * math.pi / 3 - s))[:, None], 2, axis=1)


def _slide(t: np.ndarray) -> np.ndarray:
    """3 m/s, decelerated by mu g = 3.924 m/s^2 until it rests."""
    s = np.minimum(t, 3.0 / 3.924)
    return np.asarray(3.0 * s - 3.924 * s**2 / 2)[:, None]


def _slip_to_roll(t: np.ndarray) -> np.ndarray:
    """Slides with -mu g and spins up with 5 mu g / 2 R until 2 v0 / (7 mu g), then rolls; as a pose."""
    v0, mu, radius = 2.0, 0.2, 0.1085
    inertia = 0.0329623 / (7.0 * radius**2)  # over m R^2: 0.4 up to the digits of the file
    end = v0 / (mu * GRAVITY * (1.0 + 1.0 / inertia))
    s, after = np.minimum(t, end), np.maximum(t - end, 0.0)
    speed = v0 - mu * GRAVITY * end
    x = v0 * s - mu * GRAVITY * s**2 / 2 + speed * after
    angle = (mu * GRAVITY / (inertia * radius)) * s**2 / 2 + speed / radius * after
    zero = np.zeros_like(t)
    return np.stack([x, zero, zero + radius, zero, np.sin(angle / 2), zero, np.cos(angle / 2)], axis=1)


def painleve(mu: float) -> Scene:
    """A rod at 60 degrees whose lower end slides on the ground towards the side it leans to."""
    robot = load_robot(FOLDER / "rod.urdf")
    lean = math.pi / 3
    q = [0.0, 0.5 * math.sin(lean), lean]
    contact = fx.PlaneContact("rod", point=(-0.5, 0.0, 0.0), friction=mu)
    return Scene(robot, q, [-1.0, 0.0, 0.0], [fx.Gravity(), contact], 0.2)


EXACT = {
    "stiction-reversals": _stiction,
    "grazing-hit": _grazing(hit=True),
    "grazing-miss": _grazing(hit=False),
    "zeno-bounces": _bounces,
    "two-stops-at-once": _two_stops,
    "slide-to-rest": _slide,
    "slip-to-roll": _slip_to_roll,
}
ERRORS = {name: truths.configuration_error(exact) for name, exact in EXACT.items()}
CHECKS = {
    "painleve": {
        "mu = 2, 60 degrees": ErrorCheck(lambda: simulate(painleve(2.0)), AccuracyError, "no motion"),
        "mu = 0.5, 60 degrees": ErrorCheck(lambda: simulate(painleve(0.5), accuracy=1e-6), None),
    }
}
