"""Motions with events and contacts in closed form, from impact to impact.

billiard  balls of different masses between walls, with and without gravity and loss
spin      a spinning ball that bounces with friction, comes to rest on the ground, slides, and rolls
incline   a ball or a block that slides along a plane until it rolls, rests, or slides on
"""

import functools
import math
from typing import Any

import mpmath as mp
import numpy as np

import twolink as tl
from scripts.studies.scenes.robots import Case, accuracy_of, free_robot, gravity, slider, uniform
from twolink import effects as fx


def elastic_ball(random: np.random.Generator) -> Case:
    """A ball that bounces without loss: parabolas."""
    height, g = uniform(random, 0.3, 2.0), float(random.integers(100, 165)) / 16

    def exact(t: np.ndarray) -> np.ndarray:
        fall = np.sqrt(2 * np.longdouble(height) / g)
        s = np.mod(t.astype(np.longdouble) + fall, 2 * fall) - fall
        return (height - g * s * s / 2)[:, None]

    scene = tl.Scene(slider(1.0), [height], effects=[gravity(g), fx.PlaneContact("body", restitution=1.0)])
    return Case("elastic ball", scene, uniform(random, 10, 200), 1e-6, exact)


def bouncing_ball(random: np.random.Generator) -> Case:
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
    return Case("bouncing ball", scene, min(30.0, rest * uniform(random, 0.3, 0.95)), 1e-6, exact)


def between_stops(random: np.random.Generator) -> Case:
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
    return Case("spring and stop", scene, uniform(random, 5, 100), 1e-6, exact)


def stick_slip(random: np.random.Generator) -> Case:
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
    return Case("stick and slip", scene, uniform(random, 2, 8 * float(half)), 1e-6, exact)


DIGITS = 40


in_digits = np.vectorize(lambda x: mp.mpf(float(x)), otypes=[object])


def billiard(random: np.random.Generator) -> Case:
    """Two or three balls in a box of 2 m: parabolas between impacts along the line of centres."""
    count = int(random.integers(1, 4))
    radii = [uniform(random, 0.02, 0.3) for _ in range(count)]
    masses = [uniform(random, 0.3, 3.0) for _ in range(count)]
    falls = random.random() < 0.5
    e = 1.0 if falls else uniform(random, 0.6, 1.0)
    g = 9.75 if falls else 0.0
    places = np.array([[-0.6, 0.0, 0.0], [0.6, 0.1, 0.2], [0.0, 0.6, -0.5]])[:count]
    places = np.round(places + random.uniform(-0.09, 0.09, (count, 3)), 3)
    speeds = np.round(random.uniform(-1, 1, (count, 3)) * 10 ** random.uniform(-0.5, 1.2), 3)
    names = [f"b{k}" for k in range(count)]
    robot = free_robot(*((n, m, (0.4 * m * r * r,) * 3) for n, m, r in zip(names, masses, radii, strict=True)))
    walls = [fx.Plane((s * x, s * y, s * z), -1.0) for x, y, z in np.eye(3).tolist() for s in (1.0, -1.0)]
    pairs = tuple((n, wall) for n in names for wall in walls) + (("self",) if count > 1 else ())
    contact = fx.Contact(pairs, restitution=e, shapes={n: (fx.Sphere(r),) for n, r in zip(names, radii, strict=True)})
    q = [x for place in places for x in (*map(float, place), 0.0, 0.0, 0.0, 1.0)]
    v = [x for speed in speeds for x in (*map(float, speed), 0.0, 0.0, 0.0)]
    scene = tl.Scene(robot, q, v, [*([gravity(g)] if g else []), contact])
    duration = uniform(random, 0.5, 3.0) if count > 1 else uniform(random, 1.0, 20.0)
    truth = functools.partial(_billiard, places, speeds, radii, masses, e, g)
    return Case(f"{count} balls, e = {e}, g = {g}", scene, duration, accuracy_of(random), truth)


def _billiard(places: np.ndarray, speeds: np.ndarray, radii: list[float], masses: list[float], e: float, g: float,
              times: np.ndarray) -> np.ndarray:  # fmt: skip
    with mp.workdps(DIGITS):
        x, v, radii, masses = map(in_digits, (places, speeds, radii, masses))
        pull, t, out = in_digits([0.0, 0.0, -g]), mp.mpf(0), []
        wait, hit = _next_impact(x, v, radii, pull)
        for time in times:
            while t + wait <= time:
                x, v, t = x + v * wait + pull * wait**2 / 2, v + pull * wait, t + wait
                _bounce(x, v, masses, hit, mp.mpf(e))
                wait, hit = _next_impact(x, v, radii, pull)
            later = mp.mpf(float(time)) - t
            out.append((x + v * later + pull * later**2 / 2).ravel().astype(float))
    return np.array(out)


def _next_impact(x: np.ndarray, v: np.ndarray, radii: np.ndarray, pull: np.ndarray) -> tuple[mp.mpf, tuple[int, int]]:
    """How long until the next impact, and of what: (ball, ball), or (ball, -1 - axis)."""
    found = []
    for i, radius in enumerate(radii):
        for axis in range(3):
            for side in (1, -1):
                wait = _falls_to_zero(-side * pull[axis] / 2, -side * v[i, axis], 1 - side * x[i, axis] - radius)
                found.append((wait, (i, -1 - axis)))
        for k in range(i):
            line, rate = x[i] - x[k], v[i] - v[k]
            wait = _falls_to_zero(rate @ rate, 2 * (line @ rate), line @ line - (radius + radii[k]) ** 2)
            found.append((wait, (i, k)))
    return min(found, key=lambda one: one[0])


def _falls_to_zero(a: mp.mpf, b: mp.mpf, c: mp.mpf) -> mp.mpf:
    """The first t > 0 at which a t^2 + b t + c falls to 0; c >= 0 but for rounding."""
    if abs(c) < mp.mpf(10) ** (-DIGITS // 2):
        return -b / a if a < 0 < b else mp.inf
    square = b * b - 4 * a * c
    if square <= 0 or (a >= 0 and b >= 0):
        return mp.inf
    return 2 * c / (-b + mp.sqrt(square))


def _bounce(x: np.ndarray, v: np.ndarray, masses: np.ndarray, hit: tuple[int, int], e: mp.mpf) -> None:
    i, k = hit
    if k < 0:
        v[i, -1 - k] *= -e
        return
    line = x[i] - x[k]
    n = line / mp.sqrt(line @ line)
    push = -(1 + e) * ((v[i] - v[k]) @ n) / (1 / masses[i] + 1 / masses[k])
    v[i], v[k] = v[i] + push / masses[i] * n, v[k] - push / masses[k] * n


def spin(random: np.random.Generator) -> Case:
    """A spinning ball falls on the ground, with Coulomb's friction at every impact."""
    radius, share, mass = uniform(random, 0.03, 0.3), uniform(random, 0.2, 0.66), uniform(random, 0.3, 3.0)
    mu, e = uniform(random, 0.02, 0.6), float(random.choice([0.0, uniform(random, 0.1, 0.8)]))
    height, g = uniform(random, 0.05, 1.0), 9.75
    v, w = np.round(random.uniform(-2, 2, 3), 3), np.round(random.uniform(-20, 20, 3), 3)
    moment = share * mass * radius**2
    robot = free_robot(("ball", mass, (moment,) * 3))
    contact = fx.Contact((("ball", "ground"),), mu, e, shapes={"ball": (fx.Sphere(radius),)})
    scene = tl.Scene(robot, [0, 0, radius + height, 0, 0, 0, 1], [*v, *w], [gravity(g), contact])
    start = radius, float(radius + height), v, w, mass, moment, mu, e, g
    duration = uniform(random, 0.4, 2.0)
    return Case(f"ball, mu = {mu}, e = {e}", scene, duration, accuracy_of(random), functools.partial(_spin, start))


def _spin(start: tuple[Any, ...], times: np.ndarray) -> np.ndarray:
    """Flights and impulses; then sliding against the slip, whose direction stays, and rolling."""
    with mp.workdps(DIGITS):
        r, height, v, w, mass, moment, mu, e, g = map(in_digits, start)
        x, t, out = in_digits([0.0, 0.0, 0.0]), mp.mpf(0), []
        x[2] = height - r
        resting, gain = False, 1 / mass + r * r / moment

        def slip() -> tuple[np.ndarray, mp.mpf]:
            """Its direction and size."""
            s = v[:2] + r * np.array([-w[1], w[0]])
            size = mp.sqrt(s @ s)
            return s / size if size else 0 * s, size

        for time in in_digits(times):
            while not resting:
                wait = (v[2] + mp.sqrt(v[2] ** 2 + 2 * g * x[2])) / g
                if t + wait > time:
                    break
                x[:2], x[2], v[2], t = x[:2] + v[:2] * wait, mp.mpf(0), v[2] - g * wait, t + wait
                unit, size = slip()
                push = -min(mu * mass * (1 + e) * -v[2], size / gain) * unit
                v[:2], w[:2] = v[:2] + push / mass, w[:2] + r / moment * np.array([push[1], -push[0]])
                v[2] *= -e
                resting = v[2] < mp.mpf(10) ** -25
            later, (unit, size) = time - t, slip()
            if resting:
                slides = min(later, size / (mu * g * mass * gain)) if mu else later
                lost = mu * g * (slides**2 / 2 + slides * (later - slides))
                out.append([*(x[:2] + v[:2] * later - lost * unit), r])
            else:
                out.append([*(x[:2] + v[:2] * later), x[2] + v[2] * later - g * later**2 / 2 + r])
        return np.array(out, dtype=float)


def incline(random: np.random.Generator) -> Case:
    """A ball or a block slides along the slope, a ball with spin across it."""
    ball = random.random() < 0.5
    angle, mu = uniform(random, 0.0, 0.7), uniform(random, 0.05, 0.9)
    mass, speed, g = uniform(random, 0.3, 3.0), uniform(random, -3.0, 3.0), 9.75
    normal, down = (math.sin(angle), 0.0, math.cos(angle)), np.array([math.cos(angle), 0.0, -math.sin(angle)])
    turned = [0.0, math.sin(angle / 2), 0.0, math.cos(angle / 2)]
    if ball:
        size, share, rate = uniform(random, 0.03, 0.3), uniform(random, 0.2, 0.66), uniform(random, -20.0, 20.0)
        moment, shape = share * mass * size**2, fx.Sphere(size)
        moments, gain, slip = (moment,) * 3, 1 + 1 / share, speed - size * rate
    else:
        edges_, rate = [uniform(random, 0.3, 0.6), uniform(random, 0.2, 0.6), uniform(random, 0.05, 0.1)], 0.0
        shape, size, gain, slip = fx.Box((edges_[0], edges_[1], edges_[2])), edges_[2] / 2, 1.0, speed
        x, y, z = (a * a for a in edges_)
        moments = (mass * (y + z) / 12, mass * (x + z) / 12, mass * (x + y) / 12)
    robot = free_robot(("body", mass, moments))
    contact = fx.Contact((("body", fx.Plane(normal)),), mu, shapes={"body": (shape,)})
    q = [size * normal[0], 0.0, size * normal[2], *turned]
    scene = tl.Scene(robot, q, [speed, 0, 0, 0, rate, 0], [gravity(g), contact])
    what = f"{'ball' if ball else 'block'}, {angle} rad, mu = {mu}"
    start = np.array(q[:3]), down, speed, slip, gain, g * math.sin(angle), mu * g * math.cos(angle)
    return Case(what, scene, uniform(random, 0.3, 1.5), accuracy_of(random), functools.partial(_incline, *start))


def _incline(place: np.ndarray, down: np.ndarray, speed: float, slip: float, gain: float, pull: float, most: float,
             t: np.ndarray) -> np.ndarray:  # fmt: skip
    """Friction against the slip; where that ends, what keeps it 0, or its most against the pull."""
    sign = math.copysign(1.0, slip) if slip else math.copysign(1.0, pull)
    change = pull - sign * gain * most
    end = -slip / change if slip * change < 0 else (0.0 if not slip else math.inf)
    s, late = np.minimum(t, end), np.maximum(t - end, 0.0)
    along = speed * s + (pull - sign * most) * s**2 / 2
    if math.isfinite(end):
        friction = pull / gain if pull <= gain * most else most
        along = along + (speed + (pull - sign * most) * end) * late + (pull - friction) * late**2 / 2
    return np.asarray(place + along[:, None] * down)
