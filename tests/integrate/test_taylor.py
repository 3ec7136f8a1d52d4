"""Taylor's method: the trap of symmetric rest, motions that are polynomials, unit quaternions, and more digits."""

import math

import mpmath as mp
import numpy as np
import pytest

import twolink as tl
from tests.integrate.problems import BOX, GRAVITY, box, one_joint, rods
from twolink.integrate.digits import decimals
from twolink.integrate.motion.scene_equations import equations_of
from twolink.integrate.solvers import taylor
from twolink.scenes import Scene

ARM_END = [-0.2229716591521448578, 0.74849218369550184904, -1.7501856681930279048, 1.9141077912878002342]


def tolerance_of(order: int) -> float:
    """A tolerance that calls for this order."""
    tolerance = math.exp(0.5 - 2 * (order - 1))
    assert taylor.order_of(tolerance) == order
    return tolerance


@pytest.mark.parametrize("order", range(3, 25))
def test_every_order_leaves_symmetric_rest(order: int) -> None:
    """Released from rest at theta = 0, odd coefficients vanish: with the last two of some orders the step is endless.
    The end after 10 s was computed by an independent program."""
    tolerance = tolerance_of(order)
    found = taylor.solve(equations_of(tl.load_scene("arm-swing")), np.array([0, 10.0]), tolerance)
    error = np.abs(found.x[:, -1] - ARM_END).max()
    assert error < max(20 * tolerance, 2e-13)
    assert 300 < found.steps < 600


@pytest.mark.parametrize("tolerance", [1e-3, 1e-9, 1e-15])
def test_what_is_at_rest_stays(tolerance: float) -> None:
    """A pendulum hanging straight, and a body in space without gravity: not a bit changes, in any time."""
    times = np.linspace(0, 100, 11)
    for scene in (Scene(one_joint("revolute"), effects=GRAVITY), Scene(tl.load_robot(BOX, root="free"))):
        equations = equations_of(scene)
        found = taylor.solve(equations, times, tolerance)
        np.testing.assert_array_equal(found.x, np.repeat(equations.start[:, None], 11, axis=1))


@pytest.mark.parametrize("tolerance", [1e-3, 1e-9, 1e-15])
def test_free_fall_on_a_slide_is_a_parabola(tolerance: float) -> None:
    """All coefficients above the second are zero: no step size follows from them."""
    times = np.linspace(0, 3, 31)
    slide = one_joint("prismatic", "0 0 1")
    x = taylor.solve(equations_of(Scene(slide, v=[4.0], effects=GRAVITY)), times, tolerance).x
    np.testing.assert_allclose(x, [4 * times - 9.81 / 2 * times**2, 4 - 9.81 * times], rtol=0, atol=1e-13)


def test_quaternions_stay_unit_for_long() -> None:
    """1000 s of tumbling: length, energy and the size of the angular momentum, which nothing restores, keep too."""
    scene = box()
    x = taylor.solve(equations_of(scene), np.linspace(0, 1000, 2001), 1e-15).x
    np.testing.assert_allclose(np.linalg.norm(x[3:7], axis=0), 1, rtol=0, atol=1e-13)
    inertia = np.array([0.80833333333333333, 0.68333333333333333, 0.14166666666666667])[:, None]
    w = x[10:]
    momentum, energy = np.linalg.norm(inertia * w, axis=0), (inertia * w * w).sum(axis=0) / 2
    np.testing.assert_allclose(momentum, momentum[0], rtol=1e-11)
    np.testing.assert_allclose(energy, energy[0], rtol=1e-11)


def series(x: list, constants: tuple, terms: int) -> list:
    """Taylor coefficients of two rods' motion in absolute angles from the horizontal, by recurrences from Lagrange's
    equations: A a1 + B cos(d) a2 = -B sin(d) w2^2 - P cos(t1), B cos(d) a1 + C a2 = B sin(d) w1^2 - Q cos(t2)."""
    a, b, c, p, q = constants
    t1, t2, w1, w2 = ([value] for value in x)
    c1, s1, c2, s2 = [mp.cos(x[0])], [mp.sin(x[0])], [mp.cos(x[1])], [mp.sin(x[1])]
    cd, sd, u1, u2, a1, a2 = [], [], [], [], [], []

    def conv(f: list, g: list, n: int) -> mp.mpf:
        return mp.fdot(f[: n + 1], g[n::-1])

    for n in range(terms):
        cd.append(conv(c1, c2, n) + conv(s1, s2, n))
        sd.append(conv(s1, c2, n) - conv(c1, s2, n))
        u1.append(conv(w1, w1, n))
        u2.append(conv(w2, w2, n))
        # Of cos(d) a the terms with a's new coefficient are unknown: two equations for the two of them.
        known1 = mp.fdot(cd[1:], a2[::-1]) if n else mp.mpf(0)
        known2 = mp.fdot(cd[1:], a1[::-1]) if n else mp.mpf(0)
        r1 = -b * conv(sd, u2, n) - p * c1[n] - b * known1
        r2 = b * conv(sd, u1, n) - q * c2[n] - b * known2
        det = a * c - (b * cd[0]) ** 2
        a1.append((c * r1 - b * cd[0] * r2) / det)
        a2.append((a * r2 - b * cd[0] * r1) / det)
        m = n + 1
        new = (w1[n] / m, w2[n] / m, a1[n] / m, a2[n] / m)
        for w, co, si in ((w1, c1, s1), (w2, c2, s2)):  # cos' = -w sin, sin' = w cos
            co_n, si_n = -conv(w, si, n) / m, conv(w, co, n) / m
            co.append(co_n)
            si.append(si_n)
        for f, value in zip((t1, t2, w1, w2), new, strict=True):
            f.append(value)
    return [t1, t2, w1, w2]


def independent(duration: float, digits: int, terms: int, h: str) -> list:
    """The rods after `duration` from rest in the horizontal, by mpmath, with the doubles that Pinocchio holds."""
    with mp.workdps(digits):
        mass, centre, inertia, length, g = (mp.mpf(value) for value in (1.0, 0.5, 1 / 12, 1.0, 9.81))
        a = inertia + mass * centre**2 + mass * length**2
        constants = (a, mass * length * centre, inertia + mass * centre**2,
                     (mass * centre + mass * length) * g, mass * centre * g)  # fmt: skip
        x, step = [mp.mpf(0)] * 4, mp.mpf(h)
        for _ in range(round(duration / float(h))):
            x = [mp.polyval(f[::-1], step) for f in series(x, constants, terms)]
        return x


@pytest.mark.slow
def test_quadruple_precision_against_an_independent_integration() -> None:
    """Equations by Lagrange in other coordinates, recurrences by hand, mpmath's numbers: 20 digits agree."""
    found = decimals(taylor.solve(equations_of(rods()), np.array([0, 0.5]), 1e-26, precision="quad").precise[-1])
    with mp.workdps(30):
        q1, q2, v1, v2 = (mp.mpf(str(value)) for value in found)
        expected = independent(0.5, 30, 40, "0.03125")
        finer = independent(0.5, 30, 40, "0.015625")
        assert max(abs(a - b) for a, b in zip(expected, finer, strict=True)) < mp.mpf(10) ** -22
        off = [abs(a - b) for a, b in zip((q1, q1 + q2, v1, v1 + v2), finer, strict=True)]
        assert max(off) < mp.mpf(10) ** -20


@pytest.mark.slow
def test_quadruple_precision_of_the_chaotic_rods_at_ten_seconds() -> None:
    """The reference has 1/12 and 9.81 themselves, our model their doubles, and the motion multiplies that by 1e4."""
    run = tl.simulate(rods(), 10.0, accuracy=1e-12, precision="quad", samples_per_second=1)
    q1, q2, v1, v2 = run.precise[-1].astype(float)
    truth = [-0.74440708850904112, -14.345719734713967, -4.0351713204933709, 4.8968140781735982]
    found = [q1 + np.pi / 2, q1 + q2 + np.pi / 2, v1, v1 + v2]
    np.testing.assert_allclose(found, truth, rtol=0, atol=1e-11)
    assert run.error[-1] <= 1e-12


def test_verification_at_1e_13() -> None:
    """Close to the end of a double's digits the bar comes from more of them: a better run is within it, and so is the
    independent end but for what its constants, decimals in place of our model's doubles, move it by."""
    run, better = (tl.simulate(tl.load_scene("arm-swing"), 10.0, accuracy=accuracy, samples_per_second=5)
                   for accuracy in (1e-13, 1e-20))  # fmt: skip
    assert run.error[-1] <= 1e-13
    assert (np.abs(run.precise - better.precise)[:, :2].max(axis=1).astype(float) <= run.error).all()
    assert np.abs(run.q[-1] - ARM_END[:2]).max() <= run.error[-1] + 5.1e-16


@pytest.mark.parametrize("acting", [False, True])
def test_a_table_that_does_not_move_the_robot_changes_nothing(acting: bool) -> None:
    """A moment about an axis across the joints' axes, as the only table and behind one that acts."""
    across = tl.effects.Sampled((0.0, 0.3, 1.0), (1.0, -2.0, 1.5))
    effects = [*GRAVITY]
    if acting:
        effects.append(tl.effects.Torque({"shoulder": tl.effects.Sampled((0.0, 0.5), (2.0, 1.0))}))
    idle = tl.effects.FrameWrench("forearm", moment=(across, 0.0, 0.0))
    robot = tl.load_robot("two_link")
    run, without = (tl.simulate(Scene(robot, [0.3, 0.2], effects=e), 0.4, accuracy=1e-10, method="taylor")
                    for e in ([*effects, idle], effects))  # fmt: skip
    np.testing.assert_allclose(run.q, without.q, rtol=0, atol=2e-10)
