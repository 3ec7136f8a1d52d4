"""periodic_motion: closed forms of pendulums and a ball, Liouville's formula, the paper's cycle, and what has none."""

import msgspec
import numpy as np
import pytest
from scipy.special import ellipe, ellipk

import twolink as tl
from tests.refusals import refusal
from twolink.errors import AccuracyError, SceneError

E = tl.effects


def require_within(found: tl.PeriodicMotion, monodromy: np.ndarray, period: float) -> None:
    """The monodromy matrix within its bound, that bound being small, and the period."""
    assert np.linalg.norm(found.monodromy - monodromy, 2) <= found.error
    assert found.error <= 1e-5 * np.linalg.norm(monodromy, 2)
    assert abs(found.period - period) <= found.period_error <= 1e-8


@pytest.mark.parametrize("angle", [0.5, 2.5])
def test_a_pendulum_has_the_period_of_the_elliptic_integral(pendulum_urdf: str, angle: float) -> None:
    """T = 4 sqrt(l / g) K(k), k = sin(angle / 2); M = [[1, 0], [-a T', 1]], for M f = f and M e1 + f T' = e1."""
    k, length = np.sin(angle / 2), 0.5
    unit = 4 * np.sqrt(length / 9.81)
    slope = unit * (ellipe(k * k) / (k * (1 - k * k)) - ellipk(k * k) / k) * np.cos(angle / 2) / 2
    scene = tl.Scene(tl.load_robot(pendulum_urdf), [angle], effects=[E.Gravity()])
    found = tl.periodic_motion(scene, 1.02 * unit * ellipk(k * k), vary=[])
    a = -9.81 / length * np.sin(angle)
    require_within(found, np.array([[1.0, 0.0], [-a * slope, 1.0]]), unit * ellipk(k * k))
    assert found.stability == "neutral"
    assert (np.abs(found.multipliers - 1.0) <= found.multiplier_errors).all()


@pytest.fixture(scope="module")
def bouncing() -> tl.PeriodicMotion:
    """A ball that bounces without loss, from 1 m."""
    ball = tl.load_scene("bouncing-ball")
    effects = [msgspec.structs.replace(e, restitution=1.0) if isinstance(e, E.PlaneContact) else e
               for e in ball.effects]  # fmt: skip
    return tl.periodic_motion(tl.Scene(ball.base, ball.q, ball.v, effects), 0.9, vary=[])


def test_an_elastic_ball_has_the_period_of_free_fall(bouncing: tl.PeriodicMotion) -> None:
    """Through an impact: T = 2 sqrt(2 h / g), h = 1; M as that of the pendulum."""
    period = 2 * np.sqrt(2 / 9.81)
    require_within(bouncing, np.array([[1.0, 0.0], [9.81 * period / 2, 1.0]]), period)
    assert bouncing.run.events


def driven() -> tl.Scene:
    effects = [E.Gravity(), E.JointDamping({"shoulder": 0.8, "elbow": 0.5}), E.Torque({"shoulder": E.Sine(4.0, 5.0)})]
    return tl.Scene(tl.load_robot("two_link"), [-np.pi / 2, 0.0], effects=effects)


def test_liouvilles_formula_holds_for_a_driven_arm() -> None:
    """det M = exp(integral of trace A): over a period the trapezoidal rule is exact to the smoothness of the motion."""
    period = 2 * np.pi / 5.0
    found = tl.periodic_motion(driven(), period)
    assert found.period == period
    assert found.stability == "asymptotically stable"
    times = np.linspace(0.0, period, 64, endpoint=False)
    q, v = found.run.at(times)
    trace = np.trace(tl.linearize(found.scene, q, v, t=times).A, axis1=1, axis2=2).mean() * period
    product = np.prod(found.multipliers)
    assert abs(product - np.exp(trace)) <= 1e-8 * np.exp(trace)
    twice = tl.simulate(found.scene, 3 * period, accuracy=1e-10)
    assert np.abs(twice.q[-1] - found.scene.q).max() <= 1e-8


def test_the_papers_cycle_made_exact() -> None:
    """From rest with the upper arm horizontal: multipliers in pairs (mu, 1 / mu), and a cycle that closes."""
    found = tl.periodic_motion(tl.load_scene("arm-swing"), 2.5, ["q.elbow"])
    assert not found.scene.v.any()
    assert found.scene.q[0] == 0.0
    assert abs(found.period - 2.47954) < 1e-5
    assert abs(found.scene.q[1] - 0.240735) < 1e-6
    again = tl.simulate(found.scene, found.period, accuracy=1e-12)
    assert np.abs(again.q[-1] - found.scene.q).max() <= found.start_error + found.residual + 1e-11
    turning = np.abs(found.multipliers.imag) > 0.5  # a pair of its own, beside the two of shifts in time and in energy
    assert turning.sum() == 2
    assert abs(found.multipliers[turning].prod() - 1.0) <= found.multiplier_errors[turning].sum()
    assert (np.abs(found.multipliers - 1.0) <= found.multiplier_errors)[~turning].all()
    assert found.stability == "neutral"
    assert abs(again.at(found.period / 2)[1]).max() < 1e-8  # at rest again after half of it


def test_parallel_links_swing_as_a_pendulum_does() -> None:
    """Without another motion of the family: T = 4 K(sin(A / 2)) / omega, omega being that of small swings."""
    scene = tl.load_scene("four-bar")
    hanging = np.pi / 2 * np.array([0.0, -1.0, -1.0, 1.0, -1.0])
    omega = float(tl.linearize(scene, hanging).eigenvalues[0].imag)
    start = tl.Scene(scene.base, hanging + 0.3 * np.array([0.0, 1.0, 1.0, -1.0, 1.0]), effects=scene.effects)
    found = tl.periodic_motion(start, 2 * np.pi / omega, ["q"], accuracy=1e-8)
    amplitude = found.scene.q[1] + np.pi / 2
    assert abs(amplitude - 0.3) < 0.01
    period = 4 * ellipk(np.sin(amplitude / 2) ** 2) / omega
    assert abs(found.period - period) <= 1e-8
    assert found.stability == "neutral"


def test_segments_find_the_same_motion() -> None:
    scene = tl.load_scene("arm-swing")
    one, many = (tl.periodic_motion(scene, 2.5, ["q.elbow"], segments=n, accuracy=1e-8) for n in (1, 3))
    assert abs(one.period - many.period) <= one.period_error + many.period_error
    assert np.linalg.norm(one.monodromy - many.monodromy, 2) <= one.error + many.error


def test_steps_that_lead_beyond_a_stop_are_shortened() -> None:
    stops = tl.effects.JointStops({"elbow": (-1.0, 1.0)}, restitution=1.0)
    scene = tl.Scene(tl.load_robot("two_link"), [-0.3, 0.4], effects=[tl.effects.Gravity(), stops])
    with refusal(AccuracyError, code="no-periodic-motion", match="no periodic motion was found near"):
        tl.periodic_motion(scene, 1.4, ["q"], accuracy=1e-7)


def test_what_has_no_periodic_motion_is_named(pendulum_urdf: str) -> None:
    robot = tl.load_robot(pendulum_urdf)
    damped = tl.Scene(robot, [0.5], effects=[E.Gravity(), E.JointDamping({"hinge": 0.5})])
    for vary in (["q", "v"], []):
        with refusal(AccuracyError, code="no-periodic-motion"):
            tl.periodic_motion(damped, 1.4, vary)
    with pytest.raises(AccuracyError, match=r"after 0\.07"):  # in a period of 0 every motion repeats itself
        tl.periodic_motion(tl.scene_of("two_link"), 0.7)
    pushed = tl.Scene(robot, [0.5], effects=[E.Gravity(), E.Torque({"hinge": E.Sine(1.0, 3.0)})])
    with refusal(SceneError, code="depends-on-time", match="repeat"):
        tl.periodic_motion(pushed, 1.0)
    with pytest.raises(SceneError, match="mass") as caught:
        tl.periodic_motion(damped, 1.0, ["bob.mass"])
    assert caught.value.argument == "vary"
    with pytest.raises(SceneError, match="vary: expected texts, got 5"):
        tl.periodic_motion(damped, 1.0, 5)


HINGE = {"hinge": 2.0}
ONCE = {
    "a torque begins": E.Engage(E.Torque(HINGE), at=0.5),
    "a torque ceases": E.Release(E.Torque(HINGE), at=9.0),
    "a kick": E.Watch("kick", at=0.5, then=lambda q, v: (q, v + 1.0)),
}


@pytest.mark.parametrize("what", ONCE)
def test_what_happens_at_a_time_does_not_repeat(pendulum_urdf: str, what: str) -> None:
    scene = tl.Scene(tl.load_robot(pendulum_urdf), [0.5], effects=[E.Gravity(), ONCE[what]])
    with refusal(SceneError, code="depends-on-time", match="once"):
        tl.periodic_motion(scene, 1.5)


def test_forces_that_repeat_at_the_start_alone_do_not_repeat(pendulum_urdf: str) -> None:
    """A vertical force has no torque where the pendulum hangs. It repeats after 2 pi / 9 s."""
    shaken = [E.Gravity(), E.FrameWrench("bob", (0.0, 0.0, E.Sine(8.0, 9.0)), point=(0.0, 0.0, -0.5))]
    scene = tl.Scene(tl.load_robot(pendulum_urdf), [0.0], [3.0], effects=shaken)
    with refusal(SceneError, code="depends-on-time", match="repeat"):
        tl.periodic_motion(scene, 1.7)


def test_what_begins_at_a_condition_is_not_of_a_motion_that_repeats(pendulum_urdf: str) -> None:
    """The state after one period is that of the start, but a spring acts from then on."""
    spring = E.Engage(E.JointSpring({"hinge": 8.0}), when=E.JointReaches("hinge", 0.1))
    effects = [E.Gravity(), E.JointDamping({"hinge": 0.4}), E.Torque({"hinge": E.Sine(1.0, 5.0)}), spring]
    with refusal(AccuracyError, code="no-periodic-motion", match="once"):
        tl.periodic_motion(tl.Scene(tl.load_robot(pendulum_urdf), [0.0], [0.5], effects), 2 * np.pi / 5)


def test_a_motion_that_an_event_ends_has_no_period(pendulum_urdf: str) -> None:
    """One that is watched and goes on has that of the pendulum."""
    robot = tl.load_robot(pendulum_urdf)
    plain = tl.Scene(robot, [0.5], effects=[E.Gravity()])
    reached = {"name": "reached", "when": E.JointReaches("hinge", 0.3)}
    free, watched = (tl.periodic_motion(scene, 1.4, [], accuracy=1e-8)
                     for scene in (plain, plain.with_effects([E.Gravity(), E.Watch(**reached)])))  # fmt: skip
    assert abs(free.period - watched.period) <= free.period_error + watched.period_error
    for stop in (E.Watch(**reached, stop=True), E.Watch("end", at=1.0, stop=True)):
        with refusal(AccuracyError, code="no-periodic-motion", match="ends the motion"):
            tl.periodic_motion(plain.with_effects([E.Gravity(), stop]), 1.4)


def test_multipliers_are_drawn(tmp_path, bouncing: tl.PeriodicMotion) -> None:
    assert bouncing.plot(tmp_path / "m.svg").read_text("utf-8").startswith("<?xml")
