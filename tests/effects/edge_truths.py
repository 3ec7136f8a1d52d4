"""Motions of hulls that touch with edges, in closed form or by small equations of motion, without the package."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

G = 9.81
FINE = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-15, "dense_output": True}


class Block(NamedTuple):
    """A block whose lower side slides on the edge of a table in the plane of x and z.

    The edge is at 0. s: of the block's middle past the edge, along its lower side. th: forward, about y. h: half its
    height. With t = (cos th, -sin th), n = (sin th, cos th) the middle is at s t + h n, and

        m (s'' + h th'' - s th'^2) = m g sin th + T
        I th'' = N s - T h
        N = m (g cos th - th' (2 s' + h th') - s th'')
    """

    mass: float
    inertia: float
    h: float
    mu: float = 0.0

    def turning(self, s: float, th: float, ds: float, w: float, sign: float) -> tuple[float, float, float]:
        """(s'', th'', N) where it slides with T = -sign mu N."""
        m, h, mu = self.mass, self.h, sign * self.mu
        lever = s + mu * h  # I th'' = N (s + mu h)
        alone = G * math.cos(th) - w * (2 * ds + h * w)
        ddth = m * alone * lever / (self.inertia + m * s * lever)
        force = m * (alone - s * ddth)
        return s * w * w + G * math.sin(th) - mu * force / m - h * ddth, ddth, force

    def pivoting(self, s: float, th: float, w: float) -> tuple[float, float, float]:
        """(th'', N, T) where the edge holds it."""
        m, h = self.mass, self.h
        ddth = m * G * (s * math.cos(th) + h * math.sin(th)) / (self.inertia + m * (s * s + h * h))
        return ddth, m * (G * math.cos(th) - h * w * w - s * ddth), m * (h * ddth - s * w * w - G * math.sin(th))

    def middle(self, s: np.ndarray, th: np.ndarray) -> np.ndarray:
        """x, z and th."""
        sin, cos = np.sin(th), np.cos(th)
        return np.stack([s * cos + self.h * sin, self.h * cos - s * sin, th], axis=-1)


def block_over_edge(block: Block, s: float, ds: float, end: float, count: int) -> tuple[np.ndarray, dict[str, float]]:
    """x, z, th at count + 1 times, and when it "stops", "tips", "slips" and "flies".

    It starts flat: at rest past the edge, s > 0, where it pivots; else with ds > 0, and slides.
    """
    times, out, when = np.linspace(0.0, end, count + 1), np.empty((count + 1, 3)), dict[str, float]()
    slow = block.mu * G
    if ds > 0.0:
        way = -block.mu * block.h - s  # to where it tips
        if slow and ds * ds / (2 * slow) < way:
            when["stops"] = ds / slow
            t = np.fmin(times, when["stops"])
            return block.middle(s + ds * t - slow * t**2 / 2, 0 * t), when
        tips = when["tips"] = 2 * way / (ds + math.sqrt(ds * ds - 2 * slow * way))
        early = times <= tips
        out[early] = block.middle(s + ds * times[early] - slow * times[early] ** 2 / 2, 0 * times[early])
        state, t0 = [s + way, 0.0, ds - slow * tips, 0.0], tips
    else:

        def held(_: float, y: np.ndarray) -> list[float]:
            return [y[1], block.pivoting(s, *y)[0]]

        def slips(_: float, y: np.ndarray) -> float:
            _, force, across = block.pivoting(s, *y)
            return block.mu * force - abs(across)

        slips.terminal = True
        part = solve_ivp(held, (0.0, end), [0.0, 0.0], events=slips, **FINE)
        t0 = float(part.t[-1])
        early = times <= t0
        out[early] = block.middle(np.full(early.sum(), s), part.sol(times[early])[0])
        if not len(part.t_events[0]):
            return out, when
        when["slips"] = t0
        th, w = part.y[:, -1]
        state = [s, th, 0.0, w]
        assert block.pivoting(s, th, w)[2] < 0.0  # which pushes it back: it slides forward

    def sliding(_: float, y: np.ndarray) -> list[float]:
        dds, ddth, _ = block.turning(*y, 1.0)  # type: ignore[call-arg]
        return [y[2], y[3], dds, ddth]

    def flies(_: float, y: np.ndarray) -> float:
        return block.turning(*y, 1.0)[2]  # type: ignore[call-arg]

    flies.terminal = True
    if t0 < end:
        part = solve_ivp(sliding, (t0, end), state, events=flies, **FINE)
        later = (times > t0) & (times <= part.t[-1])
        if later.any():
            y = part.sol(times[later])
            assert (y[2] > -1e-12).all()
            out[later] = block.middle(y[0], y[1])
        if len(part.t_events[0]):
            when["flies"] = t0 = float(part.t[-1])
            s, th, ds, w = part.y[:, -1]
            sin, cos = math.sin(th), math.cos(th)
            along, off = ds + block.h * w, -s * w
            v = np.array([along * cos + off * sin, off * cos - along * sin, w])
            late = times > t0
            t = (times[late] - t0)[:, None]
            out[late] = block.middle(np.array(s), np.array(th)) + v * t - [0.0, G / 2, 0.0] * t**2
            when["s"] = s
    return out, when


class Edge(NamedTuple):
    """A straight edge: a point of it and its direction."""

    point: np.ndarray
    way: np.ndarray


class Free(NamedTuple):
    """A free body at time t: middle, rotation, velocity and angular velocity in the world."""

    t: float
    x: np.ndarray
    turn: Rotation
    v: np.ndarray
    w: np.ndarray

    def at(self, t: float) -> Free:
        """In free fall, with its three moments of inertia the same or without spin."""
        late = t - self.t
        fall = np.array([0.0, 0.0, -G])
        return Free(t, self.x + self.v * late + fall * late**2 / 2, Rotation.from_rotvec(self.w * late) * self.turn,
                    self.v + fall * late, self.w)  # fmt: skip


def crossing(body: Free, own: Edge, fixed: Edge) -> tuple[float, np.ndarray, np.ndarray]:
    """The gap of two edges, the normal that points up, and the point of the fixed edge where they cross."""
    point, way = body.x + body.turn.apply(own.point), body.turn.apply(own.way)
    n = np.cross(fixed.way, way)
    n *= np.sign(n[2]) / np.linalg.norm(n)
    line = np.linalg.lstsq(np.stack([fixed.way, -way, n], axis=1), point - fixed.point, rcond=None)[0]
    return float(n @ (point - fixed.point)), n, fixed.point + line[0] * fixed.way


def hit(body: Free, at: np.ndarray, n: np.ndarray, mass: float, moments: np.ndarray, law: tuple[float, float]) -> Free:
    """After an impact at one point: p_n from v_n+ = -e v_n-; it sticks, or p_t = -mu p_n against the slip that is left.

    law: e and mu.
    """
    e, mu = law
    arm = at - body.x
    s = np.cross(n, [1.0, 0.0, 0.0] if abs(n[0]) < 0.9 else [0.0, 1.0, 0.0])
    s /= np.linalg.norm(s)
    axes = np.stack([n, s, np.cross(n, s)])
    turn = body.turn.as_matrix()
    inverse = turn @ np.diag(1.0 / moments) @ turn.T
    levers = np.cross(arm, axes)
    inverse_mass = np.eye(3) / mass + levers @ inverse @ levers.T
    before = axes @ (body.v + np.cross(body.w, arm))

    def impulse(angle: float) -> np.ndarray:
        way = np.array([1.0, -mu * math.cos(angle), -mu * math.sin(angle)])
        return way * -(1 + e) * before[0] / (inverse_mass[0] @ way)

    def beside(angle: float) -> float:
        slip = (before + inverse_mass @ impulse(angle))[1:]
        return float(slip[1] * math.cos(angle) - slip[0] * math.sin(angle))

    p = np.linalg.solve(inverse_mass, [-(1 + e) * before[0], -before[1], -before[2]])
    if not mu:
        p = impulse(0.0)
    elif np.linalg.norm(p[1:]) > mu * p[0]:
        angles = np.linspace(-math.pi, math.pi, 721)
        values = [beside(angle) for angle in angles]
        roots = [brentq(beside, a, b, xtol=1e-15) for a, b, x, y in
                 zip(angles, angles[1:], values, values[1:], strict=False) if x * y <= 0]  # fmt: skip
        found = [impulse(r) for r in roots]
        slips = [(before + inverse_mass @ p)[1:] for p in found]
        (p,) = [p for p, slip, r in zip(found, slips, roots, strict=True)
                if slip @ [math.cos(r), math.sin(r)] > 0 and p[0] > 0][:1]  # fmt: skip
    world = p @ axes
    return body._replace(v=body.v + world / mass, w=body.w + inverse @ np.cross(arm, world))


def falls_on_edge(start: Free, own: Edge, fixed: Edge, mass: float, moments: np.ndarray, law: tuple[float, float],
                  blows: int) -> list[Free]:  # fmt: skip
    """The body at its start and after each of its first impacts of two edges."""
    states = [start]
    for _ in range(blows):
        body = states[-1]

        def gap(t: float, body: Free = body) -> float:
            return crossing(body.at(t), own, fixed)[0]

        t = body.t + np.linspace(1e-4, 3.0, 3000)
        k = next(k for k in range(len(t) - 1) if gap(t[k]) > 0 >= gap(t[k + 1]))
        now = body.at(brentq(gap, t[k], t[k + 1], xtol=1e-15, rtol=1e-15))
        _, n, at = crossing(now, own, fixed)
        states.append(hit(now, at, n, mass, moments, law))
    return states
