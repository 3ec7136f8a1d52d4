"""Events: dry friction, stops, bounces without end, sliding and rolling, and friction that allows no motion."""

from __future__ import annotations

import math

import numpy as np

from twolink import effects as fx
from twolink.dynamics import load_robot
from twolink.errors import AccuracyError
from twolink.hard import truths
from twolink.hard.case import SCENES, Motion, Probe, Refusals, Truth, at
from twolink.scenes import Scene
from twolink.simulation.scene_run import simulate

GRAVITY = 9.81
METRES = "error of q [m]"


def _stiction(t: np.ndarray) -> np.ndarray:
    """Half cosines about F/k on either side, each shorter by 2 F/k, until the spring cannot move it any more."""
    w, reach = 10.0, 0.47 / 100.0
    half, out, amplitude = math.pi / w, np.empty(len(t)), 1.0
    last = math.ceil((1.0 - reach) / (2 * reach) - 1e-12)  # the half after which |x| <= F/k
    number = np.minimum(np.floor(t / half).astype(int), last)
    for n in range(last + 1):
        here = number == n
        amplitude = 1.0 - 2 * reach * n
        sign = (-1.0) ** n
        moving = amplitude - reach if n < last else 0.0
        rest = reach if n < last else amplitude
        out[here] = sign * (rest + moving * np.cos(w * (t[here] - n * half)))
    return out[:, None]


def _grazing(hit: bool) -> truths.Closed:
    """cos t, and after a hit at -1 + d with e = 0.5 a cosine of a slightly smaller amplitude, shifted."""
    stop, e = -1.0 + (1e-10 if hit else -1e-10), 0.5

    def closed(t: np.ndarray) -> np.ndarray:
        x, v, start, out = 1.0, 0.0, 0.0, np.empty(len(t))
        while True:
            amplitude, phase = math.hypot(x, v), math.atan2(-v, x)
            here = t >= start
            out[here] = amplitude * np.cos(t[here] - start + phase)
            if amplitude < -stop or not hit:
                return out[:, None]
            # x = amplitude cos(angle) falls to the stop at this angle of the turn
            angle = math.pi - math.acos(min(1.0, -stop / amplitude))
            wait = (angle - phase) % (2 * math.pi)
            if wait < 1e-9:
                wait += 2 * math.pi
            speed = math.sqrt(max(0.0, amplitude**2 - stop**2))
            start, x, v = start + wait, stop, e * speed
            if start > t[-1]:
                return out[:, None]

    return closed


def _bounces(t: np.ndarray) -> np.ndarray:
    """Parabolas, each half as fast as the one before; 0 from the end of them all on."""
    e, first = 0.5, math.sqrt(2 / GRAVITY)
    out = np.where(t <= first, 1.0 - GRAVITY * t**2 / 2, 0.0)
    start, speed = first, e * GRAVITY * first
    while speed > 1e-15:
        s = t - start
        inside = (s > 0) & (s <= 2 * speed / GRAVITY)
        out[inside] = (speed * s - GRAVITY * s**2 / 2)[inside]
        start, speed = start + 2 * speed / GRAVITY, e * speed
    return out[:, None]


def _two_stops(t: np.ndarray) -> np.ndarray:
    """cos 2t between -0.5 and 1, thrown back without loss: periodic with 2 pi / 3."""
    s = np.mod(t, 2 * math.pi / 3)
    s = np.where(s > math.pi / 3, 2 * math.pi / 3 - s, s)
    return np.repeat(np.cos(2 * s)[:, None], 2, axis=1)


def _slide(t: np.ndarray) -> np.ndarray:
    a = 3.924
    s = np.minimum(t, 3.0 / a)
    return np.asarray(3.0 * s - a * s**2 / 2)[:, None]


def _rolls(t: np.ndarray) -> np.ndarray:
    """Slides with -mu g and turns up with 5 mu g / 2 R until 2 v0 / (7 mu g), then rolls; as a pose."""
    v0, mu, radius = 2.0, 0.2, 0.1085
    inertia = 0.0329623 / (7.0 * radius**2)  # over m R^2: 0.4, but for the file's digits
    end = v0 / (mu * GRAVITY * (1.0 + 1.0 / inertia))
    s, after = np.minimum(t, end), np.maximum(t - end, 0.0)
    speed = v0 - mu * GRAVITY * end
    x = v0 * s - mu * GRAVITY * s**2 / 2 + speed * after
    angle = (mu * GRAVITY / (inertia * radius)) * s**2 / 2 + speed / radius * after
    zero = np.zeros_like(t)
    return np.stack([x, zero, zero + radius, zero, np.sin(angle / 2), zero, np.cos(angle / 2)], axis=1)


def painleve(mu: float) -> Scene:
    """A rod whose lower end slides on the ground towards where it leans, at 60 degrees."""
    robot = load_robot(SCENES / "rod.urdf")
    lean = math.pi / 3
    q = [0.0, 0.5 * math.sin(lean), lean]
    contact = fx.PlaneContact("rod", point=(-0.5, 0.0, 0.0), friction=mu)
    return Scene(robot, q, [-1.0, 0.0, 0.0], [fx.Gravity(), contact], 0.2)


CASES = (
    Motion(
        name="stiction-reversals", group="events",
        title="A mass on a spring reverses 106 times under dry friction, then sticks",
        why="Each reversal is a jump of the friction. After the last one the mass must stay for good, not creep or "
            "chatter.",
        scene="stiction", samples=20.0, peers=(),
        truth=Truth("closed form: half cosines", truths.of_configuration(_stiction), METRES, doubt=1e-12),
        settings=at(1e-3, 1e-6, 1e-9),
    ),
    Motion(
        name="grazing-hit", group="events", title="A stop that is hit at 1e-5 m/s, at the very turn of a swing",
        why="The gap is below 0 for 30 microseconds of a swing of 6 s: its sign between steps shows nothing.",
        scene="grazing-hit", samples=20.0, peers=(),
        truth=Truth("closed form: cosines", truths.of_configuration(_grazing(True)), METRES, doubt=1e-9),
        settings=at(1e-3, 1e-6, 1e-8),
    ),
    Motion(
        name="grazing-miss", group="events", title="A stop that is missed by 1e-10 m",
        why="What touches nothing must not be thrown back.",
        scene="grazing-miss", samples=20.0, peers=(),
        truth=Truth("closed form: cos t", truths.of_configuration(_grazing(False)), METRES, doubt=1e-12),
        settings=at(1e-3, 1e-6, 1e-9),
    ),
    Motion(
        name="zeno-bounces", group="events", title="A ball whose bounces pile up at 1.3546 s",
        why="There are infinitely many of them before that: the run must get past it, and end in rest.",
        scene="zeno", samples=50.0, peers=(),
        truth=Truth("closed form: parabolas that end at sqrt(2h/g)(1 + e)/(1 - e)", truths.of_configuration(_bounces),
                    METRES, doubt=1e-12),
        settings=at(1e-3, 1e-6, 1e-9),
    ),
    Motion(
        name="two-stops-at-once", group="events", title="Two stops are hit in the same instant, five times",
        why="Of two events at one time the first one handled may undo or hide the other.",
        scene="two-stops", samples=50.0, peers=(),
        truth=Truth("closed form: cos 2t thrown back", truths.of_configuration(_two_stops), METRES, doubt=1e-12),
        settings=at(1e-3, 1e-6, 1e-9),
    ),
    Motion(
        name="slide-to-rest", group="events", title="A block slides to rest",
        why="Where it stops friction must hold it, not push it back.",
        scene="slide-to-rest", samples=50.0, peers=(),
        truth=Truth("closed form: v^2 / (2 mu g), then still", truths.of_configuration(_slide), METRES, doubt=1e-12),
        settings=at(1e-3, 1e-6, 1e-9),
    ),
    Motion(
        name="slip-to-roll", group="events", title="A bowling ball slides, then rolls",
        why="Friction jumps from mu N to 0 where the slipping ends, and a constraint takes over.",
        scene="slip-to-roll", samples=50.0, peers=(),
        truth=Truth("closed form: rolls from 2 v0/(7 mu g) on at 5 v0/7", truths.of_configuration(_rolls),
                    "error of the pose [m, rad]", doubt=1e-11),
        settings=at(1e-3, 1e-6, 1e-9),
    ),
    Refusals(
        name="painleve", group="events", title="A rod that slides with more friction than rigid bodies allow",
        why="Above mu = 4/3 there are leans at which no normal force is consistent (Painleve 1895): a number would be "
            "made up.",
        probes={
            "mu = 2, 60 degrees": Probe(lambda: simulate(painleve(2.0)), AccuracyError, "no motion"),
            "mu = 0.5, 60 degrees": Probe(lambda: simulate(painleve(0.5), accuracy=1e-6), None),
        },
    ),
)  # fmt: skip
