"""Compliant contact with a plane and ellipsoids on it, against closed forms and laws of conservation."""

import numpy as np
import pytest
from scipy.optimize import brentq

import twolink as tl
from tests.effects.bodies import solved
from tests.effects.cases import E
from tests.near import assert_near

R, M, G = 0.05, 0.2, 9.81
TOP = tl.load_robot("tippe_top", root="free")


def ball(q: list[float], v: list[float], *effects: tl.effects.Effect, gravity: bool = True) -> tl.Scene:
    one = tl.Scene(tl.load_robot("world")).with_object("ball").base
    return tl.Scene(one, [*q, 0, 0, 0, 1], v, [*([E.Gravity()] if gravity else []), *effects], 1.0)


def test_it_rests_as_deep_as_its_weight_presses_and_oscillates_about_that() -> None:
    k = 500.0
    depth, w = M * G / k, np.sqrt(k / M)
    run = tl.simulate(ball([0, 0, R - 0.5 * depth], [0] * 6, E.CompliantContact("ball", k, radius=R)), accuracy=1e-9)
    assert_near(run.q[:, 2], R - depth + 0.5 * depth * np.cos(w * run.t), 1e-9)
    assert np.ptp(run.energy + 0.5 * k * (R - run.q[:, 2]) ** 2) < 1e-9


@pytest.mark.parametrize("mass", [M, 3 * M])
def test_blows_rebound_as_hunt_and_crossley_say(mass: float) -> None:
    """dv/ds = -k s (1 + d v) / (m v): d v - ln(1 + d v) has the same value before and after."""
    d, v = 0.8, 1.5
    heavy = E.Constants({"ball.mass": mass})
    scene = ball(
        [0, 0, R + 0.1], [0, 0, -v, 0, 0, 0], E.CompliantContact("ball", 2e3, d, radius=R), heavy, gravity=False
    )
    after = tl.simulate(scene, accuracy=1e-8).v[-1, 2]
    kept = d * v - np.log1p(d * v)
    assert_near(after, brentq(lambda w: -d * w - np.log1p(-d * w) - kept, 0, 1 / d - 1e-12), 1e-7)


def test_spin_is_slowed_by_the_moment_of_the_patch() -> None:
    """Without slip M = -3 pi/16 mu N a (Hertz's pressure), so that w falls along a line until it ends."""
    mu, a, w, k = 0.4, 0.004, 30.0, 1e4
    contact = E.CompliantContact("ball", k, friction=mu, patch=a, radius=R, slip=1e-7)
    run = tl.simulate(ball([0, 0, R - M * G / k], [0, 0, 0, 0, 0, w], contact), 0.5, accuracy=1e-8)
    slowing = 3 * np.pi / 16 * mu * M * G * a / (0.4 * M * R**2)
    assert_near(run.v[:, 5], w - slowing * run.t, 1e-4)


def test_spin_takes_friction_from_slip() -> None:
    """Contensou: at |c| << a w friction is viscous, 3 pi/8 mu N c / (a w)."""
    mu, a, w, c, k = 0.4, 0.004, 100.0, 1e-3, 1e4
    contact = E.CompliantContact("ball", k, friction=mu, patch=a, radius=R, slip=1e-7)
    run = tl.simulate(ball([0, 0, R - M * G / k], [c, 0, 0, 0, 0, w], contact), 1e-3, accuracy=1e-9)
    assert run.acceleration[0, 0] == pytest.approx(-3 * np.pi / 8 * mu * G * c / (a * w), rel=2 * c / (a * w))
    fast = ball([0, 0, R - M * G / k], [2.0, 0, 0, 0, 0, 0], contact)
    assert tl.simulate(fast, 1e-3, accuracy=1e-9).acceleration[0, 0] == pytest.approx(-mu * G, rel=1e-6)


@pytest.mark.slow
def test_rolling_resistance_slows_a_ball() -> None:
    r, v, k = 1e-3, 0.5, 1e4
    contact = E.CompliantContact("ball", k, friction=1.0, rolling=r, radius=R, slip=1e-4)
    run = tl.simulate(ball([0, 0, R - M * G / k], [v, 0, 0, 0, v / R, 0], contact), accuracy=1e-7)
    assert_near(run.q[:, 0], v * run.t - r * G / (2.8 * R) * run.t**2, 2e-4)


def top(spin: float) -> tl.Trajectory:
    """A tippe top of Rauch-Wojciechowski and Rutstam with their friction, 0.3 s/m times N times the slip."""
    tilt, k = 0.1, 2e3
    contact = E.CompliantContact("top", k, 1.0, friction=0.3, slip=1.0, radius=0.02)
    start = [0, 0, 0.02 - 0.02 * G / k, 0, np.sin(tilt / 2), 0, np.cos(tilt / 2)]
    return solved(TOP, [E.Gravity(), contact], 8.0, start, [0, 0, 0, 0, 0, spin], accuracy=1e-5)


@pytest.mark.parametrize(("spin", "inverts"), [(155.0, True), (60.0, False)])
def test_a_tippe_top_inverts_above_its_threshold_and_keeps_jelletts_integral(spin: float, inverts: bool) -> None:
    """L . (R n - a e) is constant whatever the friction (Jellett 1872); the top inverts where it is above
    sqrt(m g R^3 I3 alpha) (1 + alpha)^2 / sqrt(1 + alpha - I1 / I3) (Rauch-Wojciechowski, Rutstam 2013)."""
    run = top(spin)
    body = TOP.model.inertias[1]
    turned = np.array([TOP.frame_pose(q, "top")[0] for q in run.q])
    momentum = np.einsum("nij,jk,nk->ni", turned, body.inertia, run.v[:, 3:])
    jellett = np.einsum("ni,ni->n", momentum, np.array([0, 0, 0.02]) + turned @ body.lever)
    assert np.ptp(jellett) < 1e-9 * jellett[0]
    alpha, (i1, _, i3) = 0.3, np.diag(body.inertia)
    threshold = np.sqrt(0.02 * G * 0.02**3 * i3 * alpha) * (1 + alpha) ** 2 / np.sqrt(1 + alpha - i1 / i3)
    assert (jellett[0] > threshold) == inverts
    assert (turned[-1, 2, 2] < -0.999) == inverts
    assert turned[-1, 2, 2] > -0.999 or run.energy[-1] < run.energy[0]


def test_an_ellipsoid_touches_with_its_lowest_point() -> None:
    """On a free ellipsoid that falls on a tilted plane: the gap at the impact by the points of its surface."""
    radii, normal = (0.05, 0.03, 0.02), np.array([0.1, -0.2, 1.0])
    contact = E.PlaneContact("ball", radii=radii, normal=tuple(normal), height=-0.2)
    one = tl.Scene(tl.load_robot("world")).with_object("ball").base
    q = one.normalize([0, 0, 0, 0.3, 0.1, -0.4, 0.8])
    run = solved(one, [E.Gravity(), contact], 0.3, q, [0, 0, 0, 1, 2, 3])
    q_hit, _ = run.at(run.events[0].t)
    turn, place = one.frame_pose(q_hit, "ball")
    u, w = np.meshgrid(np.linspace(0, np.pi, 801), np.linspace(0, 2 * np.pi, 1601))
    surface = np.stack([np.sin(u) * np.cos(w), np.sin(u) * np.sin(w), np.cos(u)], -1) * radii @ turn.T + place
    lowest = (surface @ (normal / np.linalg.norm(normal))).min()
    assert_near(lowest, -0.2, 1e-6)


@pytest.mark.slow
def test_an_ellipsoid_with_equal_radii_is_a_ball() -> None:
    q, v = [0, 0, R + 0.05], [0.3, 0, 0, 4, 0, 0]
    ends = [tl.simulate(ball(q, v, E.PlaneContact("ball", friction=0.3, restitution=0.4, **shape)), accuracy=1e-9)
            for shape in ({"radius": R}, {"radii": (R, R, R)})]  # fmt: skip
    assert_near(ends[0].q, ends[1].q, 1e-9)


def bounced(t: np.ndarray, height: float, k_over_m: float) -> np.ndarray:
    """The heights above touching of a ball that falls from `height` and bounces on a spring: exact, period by period.

    fall: h - g t^2/2;   in contact: z = (cos(w s) - 1) g/w^2 - (v/w) sin(w s),  v = sqrt(2 g h)
    """
    w, fall = np.sqrt(k_over_m), np.sqrt(2 * height / G)
    v = G * fall
    touching = 2 * (np.pi - np.arctan2(v / w, G / w**2)) / w  # until it is at z = 0 again
    since = np.mod(t, 2 * fall + touching)
    s, late = since - fall, np.minimum(since, 2 * fall + touching - since)
    return np.where(late < fall, height - 0.5 * G * late**2,
                    (np.cos(w * s) - 1.0) * G / w**2 - v / w * np.sin(w * s))  # fmt: skip


@pytest.mark.parametrize("accuracy", [1e-6, 1e-8, 1e-10])
@pytest.mark.parametrize("seed", range(4))
def test_kinks_that_are_not_located_are_not_taken_for_rounding(seed: int, accuracy: float) -> None:
    """Steps meet the kink of first contact by chance, and disturbed ones elsewhere: smaller tolerances still help."""
    random = np.random.default_rng(seed)
    k, height = float(random.uniform(1e4, 2e5)), float(random.uniform(0.01, 0.15))
    scene = ball([0, 0, R + height], [0] * 6, E.CompliantContact("ball", k, radius=R))
    run = tl.simulate(scene, 0.6, accuracy=accuracy, samples_per_second=50)
    off = np.abs(run.q[:, 2] - R - bounced(run.t, height, k / M))
    assert (off <= run.error + np.finfo(float).eps).all()
    assert run.error.max() <= accuracy
