"""Scenes with contacts whose exact motions are known, in closed form from impact to impact.

billiard  balls of different masses between walls, with and without gravity and loss
spin      a spinning ball that bounces with friction, comes to rest on the ground, slides, and rolls
incline   a ball or a block that slides along a plane until it rolls, rests, or slides on
"""

import functools
import math
from dataclasses import dataclass

import mpmath as mp
import numpy as np

import twolink as tl
from scripts.studies.scenes.contact_parts import Case, accuracy_of, free_robot
from scripts.studies.scenes.robots import gravity, uniform
from twolink import effects as fx

DIGITS = 40


@dataclass
class _Ball:
    radius: mp.mpf
    mass: mp.mpf
    x: list[mp.mpf]
    v: list[mp.mpf]


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
        balls = [_Ball(mp.mpf(r), mp.mpf(m), [mp.mpf(float(a)) for a in x], [mp.mpf(float(a)) for a in v])
                 for r, m, x, v in zip(radii, masses, places, speeds, strict=True)]  # fmt: skip
        pull, t, out = [mp.mpf(0), mp.mpf(0), -mp.mpf(g)], mp.mpf(0), []
        wait, hit = _next_impact(balls, pull)
        for time in times:
            while t + wait <= time:
                _move(balls, pull, wait)
                t += wait
                _bounce(balls, hit, mp.mpf(e))
                wait, hit = _next_impact(balls, pull)
            later = mp.mpf(float(time)) - t
            out.append([float(x + v * later + a * later**2 / 2) for ball in balls
                        for x, v, a in zip(ball.x, ball.v, pull, strict=True)])  # fmt: skip
    return np.array(out)


def _next_impact(balls: list[_Ball], pull: list[mp.mpf]) -> tuple[mp.mpf, tuple[int, int]]:
    """How long until the next impact, and of what: (ball, ball), or (ball, -1 - axis)."""
    best, what = mp.inf, (0, 0)
    for i, ball in enumerate(balls):
        for axis in range(3):
            for side in (1, -1):
                gap, rate, a = 1 - side * ball.x[axis] - ball.radius, -side * ball.v[axis], -side * pull[axis]
                when = _falls_to_zero(a / 2, rate, gap)
                if when < best:
                    best, what = when, (i, -1 - axis)
        for k in range(i):
            other = balls[k]
            x = [p - q for p, q in zip(ball.x, other.x, strict=True)]
            v = [p - q for p, q in zip(ball.v, other.v, strict=True)]
            when = _falls_to_zero(sum(b * b for b in v), 2 * sum(p * b for p, b in zip(x, v, strict=True)),
                                  sum(p * p for p in x) - (ball.radius + other.radius) ** 2)  # fmt: skip
            if when < best:
                best, what = when, (i, k)
    return best, what


def _falls_to_zero(a: mp.mpf, b: mp.mpf, c: mp.mpf) -> mp.mpf:
    """The first t > 0 at which a t^2 + b t + c falls to 0; c >= 0 but for rounding."""
    if abs(c) < mp.mpf(10) ** (-DIGITS // 2):
        return -b / a if a < 0 < b else mp.inf
    square = b * b - 4 * a * c
    if square <= 0 or (a >= 0 and b >= 0):
        return mp.inf
    return 2 * c / (-b + mp.sqrt(square))


def _move(balls: list[_Ball], pull: list[mp.mpf], t: mp.mpf) -> None:
    for ball in balls:
        ball.x = [x + v * t + a * t * t / 2 for x, v, a in zip(ball.x, ball.v, pull, strict=True)]
        ball.v = [v + a * t for v, a in zip(ball.v, pull, strict=True)]


def _bounce(balls: list[_Ball], hit: tuple[int, int], e: mp.mpf) -> None:
    ball, k = balls[hit[0]], hit[1]
    if k < 0:
        ball.v[-1 - k] *= -e
        return
    other = balls[k]
    line = [p - q for p, q in zip(ball.x, other.x, strict=True)]
    length = mp.sqrt(sum(x * x for x in line))
    n = [x / length for x in line]
    rate = sum((p - q) * x for p, q, x in zip(ball.v, other.v, n, strict=True))
    push = -(1 + e) * rate / (1 / ball.mass + 1 / other.mass)
    ball.v = [v + push / ball.mass * x for v, x in zip(ball.v, n, strict=True)]
    other.v = [v - push / other.mass * x for v, x in zip(other.v, n, strict=True)]


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


def _spin(start: tuple, times: np.ndarray) -> np.ndarray:
    """Flights and impulses; then sliding against the slip, whose direction stays, and rolling."""
    with mp.workdps(DIGITS):
        radius, height, speed, turning, mass, moment, mu, e, g = start
        r, mu, e, g, mass, moment = (mp.mpf(float(x)) for x in (radius, mu, e, g, mass, moment))
        x, v = [mp.mpf(0), mp.mpf(0), mp.mpf(height) - r], [mp.mpf(float(a)) for a in speed]
        w, t, out = [mp.mpf(float(a)) for a in turning], mp.mpf(0), []
        resting, gain = False, 1 / mass + r * r / moment

        def slip() -> tuple[list[mp.mpf], mp.mpf]:
            s = [v[0] - r * w[1], v[1] + r * w[0]]
            return s, mp.sqrt(s[0] ** 2 + s[1] ** 2)

        def push(p: list[mp.mpf]) -> None:
            v[0], v[1] = v[0] + p[0] / mass, v[1] + p[1] / mass
            w[0], w[1] = w[0] + r * p[1] / moment, w[1] - r * p[0] / moment

        for time in times:
            time = mp.mpf(float(time))
            while not resting:
                wait = (v[2] + mp.sqrt(v[2] ** 2 + 2 * g * x[2])) / g
                if t + wait > time:
                    break
                x, v[2], t = [x[0] + v[0] * wait, x[1] + v[1] * wait, mp.mpf(0)], v[2] - g * wait, t + wait
                normal = mass * (1 + e) * -v[2]
                s, size = slip()
                most = min(mu * normal, size / gain)
                push([-most * a / size for a in s] if size else [mp.mpf(0)] * 2)
                v[2] *= -e
                resting = v[2] < mp.mpf(10) ** -25
            later = time - t
            if not resting:
                out.append([x[0] + v[0] * later, x[1] + v[1] * later, x[2] + v[2] * later - g * later**2 / 2 + r])
                continue
            s, size = slip()
            slides = min(later, size / (mu * g * mass * gain)) if mu else later
            unit = [a / size if size else mp.mpf(0) for a in s]
            out.append([*(x[k] + v[k] * later - mu * g * unit[k] * (slides**2 / 2 + slides * (later - slides))
                          for k in range(2)), r])  # fmt: skip
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
