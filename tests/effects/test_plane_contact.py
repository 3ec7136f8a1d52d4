"""Contact with a plane: bouncing, sliding, rolling, sticking, tipping and leaving, against closed forms."""

import math

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

import twolink as tl
from tests.effects.bodies import G, above, ball, bouncing, kinds, planar, solved, times
from tests.effects.cases import E
from tests.near import assert_near, assert_within

R = 0.1


@pytest.mark.some(1)
@pytest.mark.parametrize("accuracy", [1e-3, 1e-6, 1e-9])
def test_a_bouncing_point_comes_to_rest_when_the_series_ends(accuracy: float) -> None:
    run = solved(planar(), [E.Gravity(), E.PlaneContact("body", restitution=0.5)], 2.0, [0, 1.0, 0], accuracy=accuracy)
    assert_within(run.q[:, 1], bouncing(run.t, 1.0, 0.5), run.error)
    assert run.error[-1] <= accuracy
    (rest,) = times(run, "rest")
    assert_near(rest, 3 * math.sqrt(2 / G), 1e-9 if accuracy == 1e-9 else 1e-2)
    assert_near(run.q[run.t > rest], 0.0, 1e-12)
    assert np.abs(run.v[run.t > rest]).max() == 0.0
    assert_near(sum(e.energy for e in run.events), G, 10 * accuracy)


def test_pairs_are_named_as_those_of_contact() -> None:
    """The ground bears the ball's weight, and takes its impulse; the same scene by `Contact` has the same names."""
    planes = E.PlaneContact("ball", radius=R, friction=0.3), E.Contact(["ground"], 0.3, shapes={"ball": (E.Sphere(R),)})
    for plane in planes:
        scene = tl.Scene(ball(), above(R + 0.2), effects=[E.Gravity(), plane], duration=0.5)
        forces = tl.simulate(scene, accuracy=1e-9).contact_forces
        assert list(forces) == list(forces.slips) == list(forces.impulses) == ["ball - ground"]
        assert_near(forces.on("ball")[-1], [0.0, 0.0, 2.0 * G], 1e-9)
        assert_near(forces.on("ground")[-1], [0.0, 0.0, -2.0 * G], 1e-9)
        assert forces.impulses["ball - ground"].p.sum(axis=0)[2] == pytest.approx(2.0 * math.sqrt(2 * G * 0.2))


def test_an_elastic_ball_bounces_for_ever() -> None:
    effects = [E.Gravity(), E.PlaneContact("body", restitution=1.0)]
    run = solved(planar(), effects, 200.0, [0, 10.0, 0], accuracy=1e-6, samples_per_second=10)
    assert len(times(run, "impact")) == 70
    assert_within(run.q[:, 1], bouncing(run.t, 10.0, 1.0), run.error + 1e-15)
    assert np.ptp(run.energy) < 1e-6


def test_far_from_the_origin() -> None:
    """A plane at 10 km: its rounding is no event."""
    effects = [E.Gravity(), E.PlaneContact("body", height=1e4, restitution=1.0)]
    run = solved(planar(), effects, 20.0, [0, 1e4 + 10, 0], accuracy=1e-6)
    assert_near(run.q[:, 1] - 1e4, bouncing(run.t, 10.0, 1.0), 1e-6)


def test_without_restitution_it_stays_down() -> None:
    run = solved(planar(), [E.Gravity(), E.PlaneContact("body")], 1.0, [0, 1.0, 0], [0.5, 0, 0])
    assert_near(run.q[:, 1], bouncing(run.t, 1.0, 0.0), 1e-9)
    assert_near(run.q[:, 0], 0.5 * run.t, 1e-9)
    assert kinds(run) == ["impact", "rest"]


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.0, 0.2])
def test_without_gravity_nothing_presses_and_nothing_rubs(friction: float) -> None:
    effects = [E.PlaneContact("body", friction=friction)]
    run = solved(planar(), effects, 2.0, v=[0.5, 0, 0])
    assert_near(run.q, np.outer(run.t, [0.5, 0, 0]), 1e-12)
    hit = solved(planar(), effects, 3.0, [0, 1, 0], [0.5, -1, 0])
    assert_near(hit.q[-1], [1.5 - 2 * friction, 0, 0], 1e-9)  # the impact rubs: mu times 1 N s


def test_a_bounce_off_an_inclined_plane() -> None:
    """The reflection of the velocity at the normal; and then a flight."""
    angle, fall = 0.4, math.sqrt(2 / G)
    n = np.array([-math.sin(angle), math.cos(angle)])
    effects = [E.Gravity(), E.PlaneContact("body", normal=(float(n[0]) * 3, 0.0, float(n[1]) * 3), restitution=1.0)]
    run = solved(planar(), effects, fall + 0.3, [0, 1.0, 0])
    v = np.array([0.0, -G * fall])
    v -= 2 * (v @ n) * n
    assert_near(run.q[-1, :2], [0.3 * v[0], 0.3 * v[1] - 0.5 * G * 0.09], 1e-9)


def test_the_impact_of_a_rod_with_friction_keeps_momentum() -> None:
    """A leaning rod hits with its end: M dv = J^T p, p in the cone, the end rebounds with e."""
    body, angle, e, mu = planar(), 0.7, 0.5, 0.15
    arm = 0.5 * np.array([math.cos(angle), math.sin(angle)])
    contact = E.PlaneContact("body", point=(-0.5, 0.0, 0.0), restitution=e, friction=mu)
    height = float(arm[1])
    effects = [E.Gravity(), contact]
    run = solved(body, effects, 1e-7, [0, height, angle], [4.0, -2.0, 0.3], accuracy=1e-10, samples_per_second=1e7)
    hit = run.events[0]
    before, after = np.array([4.0, -2.0, 0.3]), run.v[-1]
    # The end is at (x, z) - arm: its velocity is (vx + arm_z w, vz - arm_x w).
    tangent, normal = np.array([1, 0, arm[1]]), np.array([0, 1, -arm[0]])
    mass = np.diag([1.0, 1.0, 0.1])
    p = mass @ (after - before)
    assert hit.kind == "impact"
    assert_near(normal @ after, -e * (normal @ before), 1e-5)
    assert_near(p[2], p[0] * tangent[2] + p[1] * normal[2], 1e-5)
    assert_near(p[0], -mu * p[1], 1e-5)  # it slides on
    assert tangent @ after > 0
    assert_near(hit.energy, (before @ mass @ before - after @ mass @ after) / 2, 1e-5)


@pytest.mark.some(1)
@pytest.mark.parametrize("accuracy", [1e-3, 1e-6, 1e-9])
def test_a_sliding_ball_begins_to_roll(accuracy: float) -> None:
    """At t = 2 v0 / (7 mu g), with 5/7 of its speed."""
    mu, v0 = 0.2, 3.0
    effects = [E.Gravity(), E.PlaneContact("ball", radius=R, friction=mu)]
    run = solved(ball(), effects, 1.0, above(R), [v0, 0, 0, 0, 0, 0], accuracy=accuracy)
    rolls = 2 * v0 / (7 * mu * G)
    sliding, late = np.fmin(run.t, rolls), np.fmax(run.t - rolls, 0)
    x = v0 * sliding - mu * G * sliding**2 / 2 + 5 / 7 * v0 * late
    assert_within(run.q[:, 0], x, run.error)
    assert_near(times(run, "roll"), [rolls], accuracy)
    assert_near(run.v[-1, 4], 5 / 7 * v0 / R, 100 * accuracy)


@pytest.mark.slow
@pytest.mark.parametrize("duration", [0.8, 0.9, 1.2])
def test_a_ball_whose_sliding_turns_begins_to_roll_whatever_the_steps(duration: float) -> None:
    """Drag turns the direction of sliding: it ends beside no sliding, by the error of a step, and goes on from there.

    Once it has ended, the sliding cannot become faster again.
    """
    contact = E.PlaneContact("ball", radius=R, friction=0.2, restitution=0.3)
    effects = [E.Gravity(), E.AirDrag("ball", 0.03), contact]
    scene = tl.Scene(ball(), above(0.3), [3, 1, 0, 5, -20, 7], effects)
    run = tl.simulate(scene, duration, tolerance=1e-9, method="dop853", verify=False)
    assert_near(times(run, "roll")[-1], 0.75434026768, 1e-5)
    turn = pin.Quaternion(*run.q[-1, [6, 3, 4, 5]]).toRotationMatrix()
    slip = turn @ run.v[-1, :3] + np.cross(turn @ run.v[-1, 3:], [0, 0, -R])
    assert_near(slip, 0.0, 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.98, 1.02])
def test_a_block_on_two_feet_slides_if_the_slope_exceeds_its_friction(share: float) -> None:
    """How the feet share the friction is not determined; whether the block slides is, and how."""
    angle = 0.3
    n, mu = (-math.sin(angle), 0.0, math.cos(angle)), share * math.tan(angle)
    feet = [E.PlaneContact("body", point=(x, 0.0, -0.1), normal=n, height=-0.1, friction=mu) for x in (0.5, -0.5)]
    run = solved(planar(), [E.Gravity(), *feet], 1.0, [0, 0, angle], samples_per_second=20)
    slope = max(0.0, math.sin(angle) - mu * math.cos(angle))
    expected = -slope * G * run.t**2 / 2
    assert_near(run.q[:, 0], expected * math.cos(angle), 1e-9)
    assert_near(run.q[:, 2], angle, 1e-9)


@pytest.mark.slow
def test_a_block_beyond_the_edge_of_its_feet_tips() -> None:
    """Feet at 0.1 and 0.5 to one side: it turns about the nearer as a pendulum, and lifts the other at once."""
    feet = [E.PlaneContact("body", point=(x, 0.0, -0.1), friction=5.0) for x in (0.5, 0.1)]
    run = solved(planar(), [E.Gravity(), *feet], 0.25, [0, 0.1, 0])
    angle, lever = run.q[:, 2], 0.1 * math.sqrt(2)
    inertia = 0.1 + lever**2
    height = 0.1 * np.cos(angle) - 0.1 * np.sin(angle)  # of the centre over the foot, at (-0.1, 0.1) from it
    assert_near(inertia * run.v[:, 2] ** 2 / 2, G * (0.1 - height), 1e-8)
    assert angle[-1] > 0.1
    assert_near(run.q[:, 1], height, 1e-9)


def falling_rod(theta: float, first: float) -> tuple[float, float, float]:
    """(theta'^2, F, N) of a rod of 1 kg and 1 m that falls about its foot from rest at `first` off the vertical."""
    square, turn = 3 * G * (math.cos(first) - math.cos(theta)), 1.5 * G * math.sin(theta)
    force = 0.5 * (turn * math.cos(theta) - square * math.sin(theta))
    return square, force, G - 0.5 * (turn * math.sin(theta) + square * math.cos(theta))


@pytest.mark.slow
def test_a_falling_rod_slips_when_its_foot_needs_more_than_friction() -> None:
    """It sticks till F = mu N, after t = int d theta / theta'."""
    first, mu = 0.2, 0.3
    slips = brentq(lambda a: falling_rod(a, first)[1] - mu * falling_rod(a, first)[2], 0.3, 0.7, xtol=1e-15)
    # From rest theta' is 0: with theta = first + u^2 the integrand is smooth.
    when = quad(lambda u: 2 * u / math.sqrt(falling_rod(first + u * u, first)[0]), 1e-9, math.sqrt(slips - first),
                epsabs=1e-13, epsrel=1e-13)[0]  # fmt: skip
    foot = E.PlaneContact("body", point=(-0.5, 0.0, 0.0), friction=mu)
    start = [0.5 * math.sin(first), 0.5 * math.cos(first), math.pi / 2 - first]
    run = solved(planar(1 / 12), [E.Gravity(), foot], when + 0.05, start)
    slide = times(run, "slide")
    assert_near(slide, [when], 2e-8)
    held = run.t < when
    assert_near(run.q[held, 0], 0.5 * np.cos(run.q[held, 2]), 1e-9)
    assert run.q[-1, 0] - 0.5 * math.cos(run.q[-1, 2]) < -1e-5  # backwards


@pytest.mark.slow
def test_a_rod_falling_without_friction_keeps_its_centre_over_the_same_point() -> None:
    foot = E.PlaneContact("body", point=(-0.5, 0.0, 0.0))
    run = solved(planar(1 / 12), [E.Gravity(), foot], 0.5, [0, 0.5 * math.sin(1.3), 1.3])
    assert_near(run.q[:, 0], 0.0, 1e-12)
    assert_near(run.q[:, 1], 0.5 * np.sin(run.q[:, 2]), 1e-9)
    assert np.ptp(run.energy) < 1e-8


@pytest.mark.slow
def test_what_is_lifted_leaves() -> None:
    """Pulled up by m g t: off at t = 1, then g (t - 1)^3 / 6."""
    effects = [E.Gravity(), E.FrameWrench("body", (0.0, 0.0, E.Polynomial((0.0, G)))), E.PlaneContact("body")]
    run = solved(planar(), effects, 2.0)
    assert_near(run.q[:, 1], G * np.fmax(run.t - 1, 0) ** 3 / 6, 1e-9)
    assert [(e.kind, e.t) for e in run.events] == [("leave", pytest.approx(1.0, abs=1e-9))]


@pytest.mark.slow
def test_the_same_contact_twice_is_one_contact() -> None:
    contacts = (E.PlaneContact("body", friction=0.2) for _ in range(2))
    run = solved(planar(), [E.Gravity(), *contacts], 1.0, v=[1.0, 0, 0])
    assert_near(run.q[-1, 0], 1 / (2 * 0.2 * G), 1e-9)


@pytest.mark.slow
def test_a_box_on_four_feet_rests() -> None:
    """One more than determines their forces."""
    feet = [E.PlaneContact("ball", point=(x, y, -R)) for x in (0.5, -0.5) for y in (0.5, -0.5)]
    run = solved(ball(), [E.Gravity(), *feet], 1.0, above(R), samples_per_second=10)
    assert_near(run.q, run.q[0], 1e-12)
    assert not run.events


@pytest.mark.slow
@pytest.mark.parametrize(("friction", "speed"), [(0.5, -2.0), (1.2, -2.0), (2.0, -2.0), (2.0, 2.0)])
def test_painleves_rod_has_an_answer_or_a_named_error(friction: float, speed: float) -> None:
    """No normal force stops the end where friction turns the rod into the ground: said so. Else energy falls."""
    lean = 1.0
    foot = E.PlaneContact("body", point=(-1.0, 0.0, 0.0), friction=friction)
    start = [0, math.sin(lean), lean]
    scene = tl.Scene(planar(1 / 3), start, [speed, 0, 0], [E.Gravity(), foot])
    # The end's acceleration along z is N (1 + 3 cos a (cos a + s mu sin a)) - g, s the sign of sliding.
    bracket = 1 + 3 * math.cos(lean) * (math.cos(lean) + math.copysign(friction, speed) * math.sin(lean))
    if bracket < 0:
        with pytest.raises(tl.errors.AccuracyError, match="Painlev"):
            tl.simulate(scene, 0.2, accuracy=1e-6)
        return
    run = tl.simulate(scene, 0.2, accuracy=1e-6)
    assert np.isfinite(run.q).all()
    assert np.all(np.diff(run.energy) < 1e-9)
    assert_near(run.q[:, 1], np.sin(run.q[:, 2]), 1e-6)


def test_a_start_below_the_plane_is_refused() -> None:
    with pytest.raises(tl.errors.SceneError, match="below the plane") as caught:
        tl.simulate(tl.Scene(planar(), [0, -1e-6, 0], effects=[E.Gravity(), E.PlaneContact("body")]), 1.0)
    assert caught.value.where == "q"
