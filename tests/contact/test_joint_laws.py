"""Contacts that are stepped on robots whose joints have stops and dry friction."""

import math

import numpy as np
import pytest

import twolink as tl
from tests.effects.bodies import G, planar, spheres, stepped, times
from tests.near import assert_near, assert_within

E = tl.effects
BLOCK = {"body": (E.Box((0.2, 0.2, 0.2)),)}
SMOOTH = E.Contact(("ground",), shapes=BLOCK)


def on_ground(speed: float, *effects: tl.effects.Effect, contact: tl.effects.Effect = SMOOTH) -> tl.Scene:
    """A block of 1 kg on the ground, with a joint along it and one about an axis across."""
    return tl.Scene(planar(), [0, 0.1, 0], [speed, 0, 0], [E.Gravity(), contact, *effects])


def test_a_block_slides_to_rest_by_friction_of_its_joint_and_of_the_ground() -> None:
    """Over v0^2 / (2 a) with a = mu g + c / m, and rests."""
    mu, c, v0, h = 0.2, 1.0, 2.0, 0.01
    friction = E.Contact(("ground",), mu, shapes=BLOCK)
    run = stepped(on_ground(v0, E.DryFriction({"x": c}), contact=friction), 1.0, h)
    a = mu * G + c
    t = np.fmin(run.t, v0 / a)
    assert_near(run.q[:, 0], v0 * t - a * t**2 / 2, a * h**2 / 2)
    assert_near(run.q[:, 1:], [0.1, 0.0], 1e-12)
    assert_near(run.v[-1], 0.0, 1e-12)
    slides = (run.t > 0.0) & (run.t < v0 / a - h)
    assert run.tau[slides, 0] == pytest.approx(np.full(slides.sum(), -c), rel=1e-9)


@pytest.mark.parametrize(("push", "moves"), [(2.9, False), (3.1, True)])
def test_static_friction_of_a_joint_holds_it_until_more_is_needed(push: float, moves: bool) -> None:
    """From the first step on; a joint that slips is braked by the kinetic friction."""
    kinetic, static = 1.0, 3.0
    run = stepped(on_ground(0.0, E.DryFriction({"x": kinetic}, {"x": static}), E.Torque({"x": push})), 1.0, 0.02)
    a = push - kinetic if moves else 0.0
    assert_near(run.q[:, 0], a * run.t**2 / 2, 1e-12)
    assert_near(run.tau[1:, 0], a, 1e-9)


@pytest.mark.parametrize("steep", [0.35, 0.55])
def test_static_friction_of_a_contact_holds_from_the_start(steep: float) -> None:
    """A block on an incline between the angles of kinetic and static friction, and beyond both."""
    mu, static, tan = 0.3, 0.5, math.tan(steep)
    gravity = E.Gravity((-G * math.sin(steep), 0.0, -G * math.cos(steep)))
    contact = E.Contact(("ground",), mu, static=static, shapes=BLOCK)
    run = stepped(tl.Scene(planar(), [0, 0.1, 0], effects=[gravity, contact]), 0.5, 0.01)
    a = G * (mu * math.cos(steep) - math.sin(steep)) if tan > static else 0.0
    assert_near(run.q[:, 0], a * run.t**2 / 2, 1e-10)


def test_stops_and_friction_alone_are_stepped_as_they_are_located() -> None:
    """An arm that falls on its stops without anything to touch: the estimate covers the distance to the located run."""
    arm = tl.load_robot("two_link")
    stops = E.JointStops({"shoulder": (-1.0, 1.0), "elbow": (-0.5, 0.7)}, restitution=0.3)
    scene = tl.Scene(arm, [0.5, 0.3], effects=[E.Gravity(), stops, E.DryFriction({"shoulder": 0.4, "elbow": 0.4})])
    exact = tl.simulate(scene, 2.0, samples_per_second=20)
    assert {event.kind for event in exact.events} >= {"impact", "rest"}
    for step in (5e-3, 5e-4):
        run = stepped(scene, 2.0, step, verify=True)
        off = np.abs(run.q - exact.q).max(axis=1)
        assert (off <= run.error + exact.error).all()
        assert 1e-3 * step < off.max() < 2.0 * step
    simulation = tl.Simulation(scene, contact="stepped", step=5e-4)
    simulation.step(2.0)
    assert_near(simulation.state.q, run.q[-1], 1e-12)


def test_stops_with_restitution_send_a_block_back_and_forth() -> None:
    """Between -0.3 and 0.5 m with e = 0.5: 2 m/s, then 1, then 0.5."""
    run = stepped(on_ground(2.0, E.JointStops({"x": (-0.3, 0.5)}, 0.5)), 2.0, 0.01)
    first, second = 0.25, 0.25 + 0.8
    exact = np.where(
        run.t < first, 2.0 * run.t, np.where(run.t < second, 0.5 - (run.t - first), 0.5 * (run.t - second) - 0.3)
    )
    assert_near(run.q[:, 0], exact, 1e-12)


def test_a_stop_holds_a_joint_under_load_until_it_is_pulled_away() -> None:
    """A force 5 - 7 t against the stop at 0: x = -7/6 (t - 5/7)^3 after 5/7 s."""
    scene = on_ground(0.0, E.JointStops({"x": (-1.0, 0.0)}), E.Torque({"x": E.Polynomial((5.0, -7.0))}))
    run = stepped(scene, 1.0, 0.01)
    assert_near(run.q[:, 0] + 7 / 6 * np.fmax(run.t - 5 / 7, 0.0) ** 3, 0.0, 2e-4)
    assert_near(run.q[run.t < 0.7, 0], 0.0, 1e-12)
    held = (run.t > 0.0) & (run.t < 0.7)
    assert_near(run.tau[held, 0], 0.0, 7 * 0.01)


def arm(*, contact: bool) -> tl.Scene:
    """A swinging arm with dry friction in its shoulder, whose elbow falls on a stop; the ground is far below."""
    effects = [E.Gravity(), E.JointStops({"elbow": (-1.0, 0.5)}, 0.5), E.DryFriction({"shoulder": 1.0})]
    far = E.Contact((("forearm", E.Plane(height=-9.0)),), shapes=spheres("forearm"))
    return tl.Scene(tl.load_robot("two_link"), [0.4, -0.5], [0.0, 3.0], [*effects, *([far] if contact else [])])


@pytest.fixture(scope="module")
def located() -> tl.Trajectory:
    return tl.simulate(arm(contact=False), 1.0, accuracy=1e-9, samples_per_second=100)


def test_half_the_step_has_half_the_error_where_a_joint_hits_its_stop(located: tl.Trajectory) -> None:
    """At 3/4 of the run, a quarter into a step of each run."""
    hit = times(located, "impact")[0]
    end, counts = hit / 0.75, (11, 23, 43, 87)
    runs = [stepped(arm(contact=True), end, end / n, samples=1 / end) for n in counts]
    errors = [np.abs(run.q[-1] - located.at(end)[0]).max() for run in runs]
    order = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert_near(order, 1.0, 0.2)


def test_stops_and_friction_keep_their_laws_and_take_energy(located: tl.Trajectory) -> None:
    run = stepped(arm(contact=True), 1.0, 0.005, verify=True, samples=100)
    assert run.bound == "estimated"
    assert_within(run.q, located.q, run.error)
    assert np.diff(run.energy).max() < 1e-3 * (run.energy[0] - run.energy[-1])
    record = run.contact_record
    assert sum(record["solvers"].values()) == 200
    assert record["feasibility"] < 1e-10
    assert record["complementarity"] < 1e-10
    assert record["overlap"] < 1e-9


def test_explain_counts_stops_and_friction() -> None:
    text = repr(tl.explain(arm(contact=True), duration=0.1, contact="stepped"))
    assert "2 stops are in the contact problem" in text
    assert "1 joints with dry friction are in the contact problem" in text


def test_a_joint_beyond_its_stop_is_refused() -> None:
    with pytest.raises(tl.errors.SceneError, match=r"stop of x .* by 0\.1 .* at the start"):
        stepped(on_ground(0.0, E.JointStops({"x": (0.1, 1.0)})), 0.1, 0.01)


def test_a_ball_rolls_until_its_joint_meets_its_stop() -> None:
    """A ball that rolls with 2/3 g sin down an incline, until its joint is at 0.3 m, and rests there."""
    gravity = E.Gravity((G * math.sin(0.3), 0.0, -G * math.cos(0.3)))
    contact = E.Contact(("ground",), 0.5, shapes=spheres("body"))
    effects = [gravity, contact, E.JointStops({"x": (-1.0, 0.3)})]
    run = stepped(tl.Scene(planar(0.005), [0, 0.1, 0], effects=effects), 1.0, 0.01)
    assert run.contact_record["overlap"] < 1e-9
    exact = np.fmin(G * math.sin(0.3) / 1.5 * run.t**2 / 2, 0.3)
    assert_near(run.q[:, 0], exact, 1e-9)


def test_a_quadruped_with_stops_and_dry_friction_falls_on_its_feet_and_rests() -> None:
    """Dry friction takes the last of its motion; its feet carry its weight."""
    robot = tl.load_robot("solo12", root="free")
    q, target = robot.neutral, dict[str, float]()
    for joint in robot.joints[1:]:
        side = -1.0 if "H" in joint.name[:2] else 1.0  # the hind legs bend the other way
        q[joint.q] = target[joint.name] = side * {"HAA": 0.0, "HFE": 0.8, "KFE": -1.6}[joint.name[-3:]]
    feet = [name for name in robot.frame_names if name.endswith("FOOT")]
    q[2] = 0.0265 - min(float(robot.frame_pose(q, foot)[1][2]) for foot in feet)
    ground = E.Contact(tuple((foot, "ground") for foot in feet), 0.6, shapes=spheres(*feet, radius=0.0165))
    stops = E.JointStops({name: (x - 0.1, x + 0.1) for name, x in target.items()})
    friction = E.DryFriction(dict.fromkeys(target, 0.05), dict.fromkeys(target, 0.08))
    control = E.JointPD(target, dict.fromkeys(target, 5.0), dict.fromkeys(target, 0.1))
    run = stepped(tl.Scene(robot, q, effects=[E.Gravity(), control, ground, stops, friction]), 1.0, 0.004)
    assert_near(run.v[-1], 0.0, 1e-9)
    weight = sum(inertia.mass for inertia in robot.model.inertias) * G
    assert sum(force[-1, 2] for force in run.contact_forces.values()) == pytest.approx(weight, rel=1e-6)
    assert np.diff(run.energy).max() < 1e-9
    assert run.contact_record["overlap"] < 1e-9
