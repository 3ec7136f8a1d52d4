"""Contacts that are stepped: closed forms, order, energy, what is reported and what is refused."""

import itertools
import math
import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import twolink as tl
from tests.effects.bodies import G, above, ball, bouncing, free_bodies, grounded, planar, spheres, stepped
from tests.near import assert_agree, assert_near, assert_within
from tests.refusals import refusal
from twolink.contact import bodies as sparse_bodies
from twolink.contact.solver import SteppedSolution
from twolink.contact.stepping import ContactStepper
from twolink.geometry.hulls import hull_of, touching
from twolink.integrate.hybrid import engine
from twolink.simulation import stepped_run
from twolink.simulation.stepped_run import simulate_stepped

E = tl.effects
SPHERE = spheres("ball")
ENDS = {"body": (E.Sphere(0.0, (0.5, 0.0, 0.0)), E.Sphere(0.0, (-0.5, 0.0, 0.0)))}
BLOCK = {"body": (E.Box((1.0, 0.3, 0.2)),)}


L, START, SPIN = 0.5, (0.6, 0.8), 0.5  # of a rod of 1 kg and 0.1 kg m^2: half its length; height and angle; rad/s
END = 0.4  # s: before the other end falls on the ground
HIT = brentq(lambda t: START[0] - G * t**2 / 2 - L * math.sin(START[1] + SPIN * t), 0.0, 1.0)  # s


def rod(friction: float = 0.0) -> tl.Scene:
    """It falls on one end, on which it slides."""
    return grounded(planar(), [0, *START], [0, 0, SPIN], friction=friction, shapes=ENDS)


def rod_angle(t: np.ndarray) -> np.ndarray:
    """th'' = -l cos th m (g - l sin th th'^2) / (I + m l^2 cos^2 th) after an impact without friction and bounce."""
    at = START[1] + SPIN * HIT
    impulse = (G * HIT + L * math.cos(at) * SPIN) / (1.0 + L**2 * math.cos(at) ** 2 / 0.1)

    def rate(_: float, y: np.ndarray) -> list[float]:
        c, s = math.cos(y[0]), math.sin(y[0])
        return [y[1], -L * c * (G - L * s * y[1] ** 2) / (0.1 + L**2 * c**2)]

    after = solve_ivp(rate, (HIT, t[-1]), [at, SPIN - L * math.cos(at) * impulse / 0.1], "DOP853", rtol=1e-11,
                      atol=1e-12, dense_output=True).sol  # fmt: skip
    return np.where(t < HIT, START[1] + SPIN * t, after(np.fmax(t, HIT))[0])


def test_a_ball_rolls_down_an_incline_as_its_closed_form() -> None:
    """5/7 g sin, with mu above 2/7 tan."""
    angle = 0.3
    n = (-math.sin(angle), 0.0, math.cos(angle))
    effects = [E.Gravity(), E.Contact((("ball", E.Plane(n)),), 0.2, shapes=SPHERE)]
    run = stepped(tl.Scene(ball(), [0.1 * n[0], 0, 0.1 * n[2], 0, 0, 0, 1], effects=effects), 1.0, 0.02)
    down = np.linalg.norm(run.q[:, :3] - run.q[0, :3], axis=1)
    assert_near(down, 5 / 7 * G * math.sin(angle) * run.t**2 / 2, 1e-12)
    assert run.contact_forces["ball - plane"][1:] @ n == pytest.approx(np.full(20, 2 * G * math.cos(angle)), rel=1e-9)


def test_a_block_slides_to_rest() -> None:
    """Over v0^2 / (2 mu g). Only the step in which it stops has an error: of second order, and below mu g h^2 / 2."""
    mu, v0, h = 0.3, 2.0, 0.01
    run = stepped(grounded(planar(), [0, 0.1, 0], [v0, 0, 0], friction=mu, shapes=BLOCK), 1.0, h)
    t = np.fmin(run.t, v0 / (mu * G))
    assert_near(run.q[:, 0], v0 * t - mu * G * t**2 / 2, mu * G * h**2 / 2)
    assert_near(run.q[:, 1:], [0.1, 0.0], 1e-12)


def test_a_ball_that_bounces_keeps_to_its_parabolas() -> None:
    """Impacts act when the ball meets the ground, not where a step ends. Bounces within a step are not followed."""
    h, e = 0.01, 0.7
    run = stepped(grounded(ball(), above(1.1), restitution=e, shapes=SPHERE), 3.0, h)
    off = np.abs(run.q[:, 2] - 0.1 - bouncing(run.t, 1.0, e))
    assert off[run.t < 2.0].max() < 1e-11
    assert off.max() < G * h**2 / 2
    assert off[-1] < 1e-12


def test_half_the_step_has_half_the_error() -> None:
    """Of a rod that falls on its end at 3/4 of the run, a quarter into a step of each run."""
    end, counts = HIT / 0.75, (11, 23, 43, 87)
    runs = [stepped(rod(), end, end / n, samples=1 / end) for n in counts]
    errors = [abs(run.q[-1, 2] - rod_angle(run.t)[-1]) for run in runs]
    order = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert_near(order, 1.0, 0.2)


def test_the_end_of_a_rod_that_sticks_stays_where_it_is() -> None:
    """It tips over. That its tip has no velocity at the end of each step does not keep it in place to first order."""
    scene = grounded(planar(), [L * math.cos(1.2), L * math.sin(1.2), 1.2], friction=2.0, shapes=ENDS)
    drifts = []
    for step in (0.02, 0.01):
        run = stepped(scene, END, step)
        drifts.append(np.abs(run.q[:, 0] - L * np.cos(run.q[:, 2])).max())
        assert np.diff(run.energy).max() < 1e-9
    assert drifts[0] < 2e-4
    assert drifts[1] < 0.4 * drifts[0]


@pytest.fixture(scope="module")
def falling() -> tl.Trajectory:
    return stepped(rod(), END, 0.005, verify=True, samples=200)


def test_the_energy_does_not_grow_and_bodies_do_not_overlap(falling: tl.Trajectory) -> None:
    assert np.diff(falling.energy).max() < 1e-9
    assert falling.energy[-1] < falling.energy[0] - 0.1
    assert falling.contact_record["overlap"] < 1e-6


def test_each_step_has_a_certificate(falling: tl.Trajectory) -> None:
    record = falling.contact_record
    assert sum(record["solvers"].values()) > 10
    assert record["feasibility"] < 1e-10
    assert record["complementarity"] < 1e-10


def test_the_error_is_estimated_and_says_so(falling: tl.Trajectory) -> None:
    off = np.abs(falling.q[:, 2] - rod_angle(falling.t))
    assert (off <= falling.error).all()
    assert falling.error.max() < 10 * off.max()
    assert falling.bound == "estimated"
    assert "estimated" in repr(falling)


def test_a_saved_estimate_stays_an_estimate(falling: tl.Trajectory, tmp_path: object) -> None:
    path = falling.save(f"{tmp_path}/run.npz")
    assert tl.Trajectory.load(path, planar()).bound == "estimated"


def test_an_accuracy_is_reached_by_smaller_steps_or_refused() -> None:
    run = tl.simulate(rod(), END, accuracy=0.02, contact="stepped", samples_per_second=20)
    assert_near(run.q[:, 2], rod_angle(run.t), 0.02)
    assert run.error.max() <= 0.02
    with refusal(tl.errors.AccuracyError, code="too-many-steps", match="first order") as failure:
        tl.simulate(rod(), END, accuracy=1e-9, contact="stepped", samples_per_second=20)
    assert 'contact="located"' in failure.value.remedy
    assert failure.value.run.bound == "estimated"


def test_two_runs_do_not_share_the_error_of_an_impact() -> None:
    """Balls that meet obliquely near the middle between two samples, where steps of both runs could have one middle."""
    shapes = spheres(*"ab")
    q = [0, 0, 0, 0, 0, 0, 1, 0.5, 0.1, 0, 0, 0, 0, 1]
    scene = tl.Scene(free_bodies("a", "b"), q, [1.0, *[0] * 11], [E.Contact(("self",), restitution=1.0, shapes=shapes)])
    meets = 0.5 - math.sqrt(0.04 - 0.01)  # s
    exact = tl.simulate(scene, 0.6, contact="located", accuracy=1e-10, t_eval=[0.6])
    for share in (0.4, 0.45, 0.6):
        times = [meets + (k - share) * 0.008 for k in range(-3, 9)]
        run = simulate_stepped(scene, np.array([0.0, *times, 0.6]), None, None, None, verify=True, patience=1e-9)
        off = np.abs(run.q[-1] - exact.q[-1])[[0, 1, 7, 8]].max()
        assert 1e-6 < off < run.error[-1]


@pytest.mark.slow
def test_without_an_accuracy_the_best_effort_is_returned_with_its_estimate() -> None:
    """A rod whose error is of first order: steps become smaller while there is time.

    Where in a step the impact falls is chance, and so is the share of the estimate that the error has: 0.04 to 1.6 over
    the steps that a time may lead to. `scripts.studies.contacts` counts them over many scenes.
    """
    times = np.linspace(0.0, END, 9)
    run = simulate_stepped(rod(), times, None, None, None, verify=True, patience=4.0)
    assert (run.bound, run.accuracy) == ("estimated", None)
    assert_within(run.q[:, 2], rod_angle(times), 2.0 * run.error + 1e-12)
    quick = simulate_stepped(rod(), times, None, None, None, verify=True, patience=1e-9)
    assert run.error[-1] < 0.2 * quick.error[-1]


def test_how_small_steps_become_is_no_matter_of_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without an accuracy steps are as many on a machine that is 1,000 s from one look at its clock to the next."""
    monkeypatch.setattr(stepped_run, "WORK", 1e5)
    scene = tl.load_scene("dominoes")
    one, *others = (tl.simulate(scene, 0.1, patience=patience) for patience in (10.0, 1000.0, None))
    monkeypatch.setattr(stepped_run, "time", SimpleNamespace(perf_counter=itertools.count(0.0, 1000.0).__next__))
    for other in (*others, tl.simulate(scene, 0.1)):
        assert one.cost.why == other.cost.why
        np.testing.assert_array_equal(one.q, other.q)


def test_finer_runs_that_are_elsewhere_refute_an_estimate(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two runs of long steps agree by chance; every one of shorter steps ends elsewhere, as where motion is chaotic."""
    solve, ends = stepped_run.solve_stepped, itertools.count(1)

    def parted(stepper: ContactStepper, times: np.ndarray, step: float, *more: Any) -> SteppedSolution:
        solution = solve(stepper, times, step, *more)
        moved = solution.q.copy()
        moved[-1, 0] += 0.3 * next(ends) * (solution.step < 2e-3)
        return replace(solution, q=moved)

    monkeypatch.setattr(stepped_run, "solve_stepped", parted)
    run = simulate_stepped(rod(0.3), np.linspace(0.0, END, 9), None, None, None, verify=True, patience=3.0)
    assert run.error[-1] > 0.5


def test_located_events_without_end_are_stepped_where_nothing_was_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """A ball that bounces more often than events are followed keeps to its parabolas, and its cost says what was."""
    bounces = E.Contact(("ground",), restitution=0.5, shapes=spheres("ball"))
    scene = tl.Scene(ball(), above(0.6), effects=[E.Gravity((0.0, 0.0, -10.0)), bounces])
    free = tl.simulate(scene, 1.0, samples_per_second=20)
    monkeypatch.setattr(engine, "MAX_EVENTS", 1)
    run = tl.simulate(scene, 1.0, samples_per_second=20)
    assert (free.bound, run.bound) == ("verified", "estimated")
    assert_within(run.q[:, 2], free.q[:, 2], run.error + 1e-6)
    assert "events follow each other without end" in run.cost.why
    assert "estimate" in run.cost.why
    for asked in ({"accuracy": 1e-3}, {"contact": "located"}):
        with refusal(tl.errors.AccuracyError, code="events-without-end"):
            tl.simulate(scene, 1.0, **asked)


@pytest.mark.slow
def test_a_box_that_slides_and_turns_on_four_corners_is_stepped() -> None:
    """The share of the corners, on which the motion depends, is not determined: the answer says so, and carries m g."""
    shapes = {"a": (E.Box((0.2, 0.3, 0.1)),)}
    scene = grounded(free_bodies("a"), above(0.05), [0.5, 0, 0, 0, 0, 1], friction=0.5, shapes=shapes)
    with pytest.raises(tl.errors.AccuracyError, match='contact="stepped"'):
        tl.simulate(scene, 0.2, contact="located")
    run = tl.simulate(scene, 0.2, samples_per_second=50, patience=5.0)
    assert run.bound == "estimated"
    assert "stepped, for located at t = 0 s" in run.cost.why
    force = run.contact_forces["a - ground"]
    assert_near(force[:, 2], G, 1e-8)
    assert (np.hypot(*force.T[:2]) <= 0.5 * force[:, 2] + 1e-8).all()
    assert_near(run.v[-1], 0.0, 1e-9)
    assert np.diff(run.energy).max() < 1e-9


def test_what_an_accuracy_is_refused_for_can_be_asked_for() -> None:
    with pytest.raises(tl.errors.AccuracyError) as failure:
        simulate_stepped(rod(), np.linspace(0.0, END, 9), 1e-9, None, None, verify=True)
    offered = re.search(r"accuracy=(\S+),", failure.value.remedy)
    run = tl.simulate(rod(), END, accuracy=float(offered[1]), contact="stepped", samples_per_second=20)
    assert run.error[-1] <= float(offered[1])


@pytest.mark.slow
@pytest.mark.parametrize(("stiff", "accuracy"), [(1e5, None), (1e5, 2e-2), (1e7, None)])
def test_steps_too_long_for_a_stiff_spring_are_made_smaller(stiff: float, accuracy: float | None) -> None:
    """x'' = -k x of a block that slides without friction: steps of 0.01 s grow without end for k > 4e4 / s^2."""
    scene = grounded(planar(), [0.01, 0.1, 0], None, E.JointPD({"x": 0.0}, {"x": stiff}), shapes=BLOCK)
    times = np.linspace(0.0, 0.2, 9)
    run = simulate_stepped(scene, times, accuracy, None, None, verify=True, patience=None if accuracy else 3.0)
    assert_within(run.q[:, 0], 0.01 * np.cos(math.sqrt(stiff) * times), run.error + 1e-12)
    assert run.error[-1] < 0.1


def test_a_pile_of_balls_rests() -> None:
    """Four on the ground and one on top, held apart by friction: nothing moves in 2 s."""
    r, names = 0.1, ("a", "b", "c", "d", "top")
    shapes = spheres(*names, radius=r)
    effects = [E.Gravity(), E.Contact(("ground", "self"), 0.8, shapes=shapes)]
    robot = free_bodies(*names)
    places = [(x, y, r) for x in (-r, r) for y in (-r, r)] + [(0.0, 0.0, r + math.sqrt(2) * r)]
    q = np.concatenate([[*place, 0, 0, 0, 1] for place in places])
    run = stepped(tl.Scene(robot, q, effects=effects), 2.0, 0.02)
    assert_near(run.q, q, 1e-9)
    ground = sum(force[-1, 2] for pair, force in run.contact_forces.items() if "ground" in pair)
    assert ground == pytest.approx(5 * G, rel=1e-9)


def test_a_stack_of_boxes_rests_and_leans_on_its_faces() -> None:
    """Three boxes, the middle one shifted to the side and turned: each point of a face has a force of its own."""
    names = ("a", "b", "c")
    effects = [
        E.Gravity(),
        E.Contact(("ground", "self"), 0.5, shapes={name: (E.Box((0.2, 0.2, 0.2)),) for name in names}),
    ]
    turned = [math.sin(0.2), math.cos(0.2)]
    q = [0, 0, 0.1, 0, 0, 0, 1, 0.06, 0, 0.3, 0, 0, *turned, 0, 0, 0.5, 0, 0, 0, 1]
    run = stepped(tl.Scene(free_bodies(*names), q, effects=effects), 1.0, 0.02)
    assert_near(run.q, q, 1e-10)
    assert run.contact_forces["b - c"][-1, 2] == pytest.approx(-G, rel=1e-6)
    assert run.contact_forces["a - ground"][-1, 2] == pytest.approx(3 * G, rel=1e-9)


def test_boxes_that_cross_touch_where_their_edges_do() -> None:
    """Two boxes on edge, crosswise above each other: they touch at one point, midway."""
    a = hull_of(E.Box((1.0, 0.2, 0.2)))
    c = math.cos(math.pi / 4)
    on_edge = np.array([[1, 0, 0], [0, c, -c], [0, c, c]])
    across = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]]) @ on_edge
    half, gap = 0.1 * math.sqrt(2), 1e-3
    lower, upper = a.placed(on_edge, np.zeros(3)), a.placed(across, np.array([0.1, 0.2, 2 * half + gap]))
    ((_, found, normal, middle),) = touching(upper, lower, 0.01)
    assert found == pytest.approx(gap)
    assert normal == pytest.approx([0, 0, 1])
    assert middle == pytest.approx([0.1, 0.0, half + gap / 2])


def test_a_ball_meets_a_convex_mesh_where_coal_says() -> None:
    """Of equal masses, without restitution and gravity: they touch, and go on at half the speed."""
    corners = tuple((x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.1, 0.1))
    effect = E.Contact((("b", "a"),), shapes={"a": (E.Convex(corners),), "b": (E.Sphere(0.1),)})
    q = [0, 0, 0, 0, 0, 0, 1, 0, 0, 0.25, 0, 0, 0, 1]
    run = stepped(tl.Scene(free_bodies("a", "b"), q, [0] * 8 + [-1, 0, 0, 0], [effect]), 0.2, 0.01)
    assert_near(run.q[-1, 9] - run.q[-1, 2], 0.2, 1e-9)
    assert run.v[-1, [2, 8]] == pytest.approx([-0.5, -0.5])


def test_the_way_follows_the_scene_and_is_explained() -> None:
    scene = rod()
    assert "contacts are located" in repr(tl.explain(scene, duration=0.1))
    text = repr(tl.explain(scene, duration=0.1, contact="stepped"))
    assert "contacts are stepped: asked for" in text
    assert "estimated" in text


@pytest.mark.parametrize(("change", "words"), [
    ({"contact": "guessed"}, "located"),
    ({"method": "rk4"}, "method of their own"),
    ({"tolerance": 1e-6}, "method of their own"),
    ({"step": -1.0}, "step"),
])  # fmt: skip
def test_what_does_not_fit_is_refused(change: dict[str, object], words: str) -> None:
    with pytest.raises(tl.errors.TwolinkError, match=words):
        tl.simulate(rod(), 0.1, **{"contact": "stepped", **change})


def test_what_cannot_be_stepped_is_refused() -> None:
    robot = planar()
    with pytest.raises(tl.errors.SceneError, match="no contact, stops or dry friction"):
        tl.simulate(tl.Scene(robot, effects=[E.Gravity()]), 0.1, contact="stepped")
    contact = E.Contact(("ground",), restitution=1.0, impacts="reflections", shapes=BLOCK)
    with pytest.raises(tl.errors.SceneError, match=r'"reflections" is not stepped.*contact="located"'):
        tl.simulate(tl.Scene(robot, [0, 1, 0], effects=[contact]), 0.1, contact="stepped")
    effects = [E.Detent("x", 1.0), E.Contact(("ground",), shapes=BLOCK)]
    with pytest.raises(tl.errors.SceneError, match="effects that switch"):
        tl.simulate(tl.Scene(robot, [0, 1, 0], effects=effects), 0.1, contact="stepped")
    with pytest.raises(tl.errors.SceneError, match=r"overlap by 0\.05 m"):
        tl.simulate(tl.Scene(robot, [0, 0.05, 0], effects=effects[1:]), 0.1, contact="stepped")


def test_many_free_bodies_move_as_few_do(monkeypatch: pytest.MonkeyPatch) -> None:
    """By sparse matrices, of bodies that spin with their centres of mass beside their origins, and touch."""
    body = ('<link name="{0}"><inertial><origin xyz="0.02 -0.01 0.03"/><mass value="2"/><inertia ixx="0.01" iyy="0.02" '
            'izz="0.025" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="{0}_joint" type="floating"><parent '
            'link="ground"/><child link="{0}"/></joint>')  # fmt: skip
    robot = tl.load_robot(f'<robot name="two"><link name="ground"/>{body.format("a")}{body.format("b")}</robot>')
    effects = [E.Gravity(), E.Contact(("ground", "self"), 0.4, shapes=spheres(*"ab"))]
    q = [0, 0, 0.11, 0, 0, 0, 1, 0.05, 0, 0.32, 0, 0, 0, 1]
    scene = tl.Scene(robot, q, [0, 0, 0, 3, 1, 2, 0, 0, 0, -2, 1, 4], effects)
    few = stepped(scene, 0.4, 0.01)
    monkeypatch.setattr(sparse_bodies, "MANY", 1)
    many = stepped(scene, 0.4, 0.01)
    assert_near(many.q, few.q, 1e-9)
    assert few.contact_forces.keys() >= {"a - ground", "a - b"}


def test_balls_that_fall_on_each_other_do_not_overlap_and_gain_no_energy() -> None:
    """What is left of overlap is removed (else 1e-2 m), and what moves apart two must not push one into a third."""
    names, r, random = [f"s{k}" for k in range(4)], 0.05, np.random.default_rng(0)
    x, y = random.uniform(-0.03, 0.03, 4), random.uniform(-0.03, 0.03, 4)
    q = np.concatenate([[x[k], y[k], 0.06 + 0.105 * k, 0, 0, 0, 1] for k in range(4)])
    effects = [E.Gravity(), E.Contact(("self", "ground"), 0.3, shapes=spheres(*names, radius=r))]
    run = stepped(tl.Scene(free_bodies(*names), q, effects=effects), 0.3, 0.01, samples=100)
    assert run.contact_record["overlap"] < 1e-6
    assert np.diff(run.energy).max() < 1e-10 * run.energy[0]


def test_damping_is_stable_for_steps_of_less_than_two_over_its_rate() -> None:
    """x'' = -d x' while a ball slides on the ground: also for 1 < h d, where accelerations alternate."""
    scene = grounded(planar(), [0.0, 0.1, 0], [1.0, 0, 0], E.JointDamping({"x": 150.0}), shapes=spheres("body"))
    run = stepped(scene, 0.5, 0.01, samples=100)
    assert abs(run.v[-1, 0]) < 1e-3


def test_steps_too_long_for_a_stiff_controller_end_with_an_error() -> None:
    """Explicit steps of x'' = -k x grow without end for h sqrt(k) > 2."""
    scene = grounded(planar(), [0.01, 0.1, 0], None, E.JointPD({"x": 0.0}, {"x": 1e6}), friction=0.5, shapes=BLOCK)
    with refusal(tl.errors.AccuracyError, code="step-too-large", match="take steps smaller than"):
        stepped(scene, 10.0, 0.01)


@pytest.mark.parametrize("controlled", [False, True])
def test_damping_is_stable_in_any_step_and_of_second_order(controlled: bool) -> None:
    """v' = -d v of 1 kg that flies above the ground: v_{n+1} / v_n = (1 - h d / 2) / (1 + h d / 2)."""

    def end(d: float, h: float) -> float:
        drag: E.Effect = E.JointPD({"x": 0.0}, {"x": 0.0}, {"x": d}) if controlled else E.JointDamping({"x": d})
        contact = E.Contact((("body", "ground"),), shapes=BLOCK)
        scene = tl.Scene(planar(), [0.0, 5.0, 0.0], [1.0, 0.0, 0.0], [drag, contact])
        return float(stepped(scene, 0.2, h).v[-1, 0])

    assert end(1e4, 0.025) == pytest.approx((124 / 126) ** 8, rel=1e-9)
    off = [abs(end(5.0, h) - np.exp(-1.0)) for h in (0.025, 0.0125)]
    assert off[0] / off[1] == pytest.approx(4.0, rel=0.05)


def test_accelerations_are_rates_of_velocities_along_axes_that_turn() -> None:
    """A free body that spins about y falls: v' = R^T g - omega x v, and no force is left over."""
    for robot in (ball(), free_bodies("a", "ball")):
        count = robot.nv // 6
        q, v = above(5) * count, [3.0, 0, 0, 0, 4, 0] * count
        run = stepped(grounded(robot, q, v, friction=0.3, shapes=spheres("ball")), 0.5, 0.01)
        for q, v, a in zip(run.q, run.v, run.acceleration, strict=True):
            turn = np.asarray(pin.Quaternion(q[3:7]).toRotationMatrix())
            assert a[:3] == pytest.approx(turn.T @ [0, 0, -G] - np.cross(v[3:6], v[:3]))
            assert_near(robot.inverse_dynamics(q, v, a), 0.0, 1e-9)


@pytest.mark.parametrize("plate", ["cylinder", "convex"])
def test_nothing_passes_through_a_thin_plate(plate: str) -> None:
    """A disc, and a plate that lies askew in its own axes, 2 mm thick, under a small box at 60 m/s."""
    turn, height = pin.rpy.rpyToMatrix(0.7, 0.6, 0.3), 0.91
    corners = np.array(list(itertools.product((-0.5, 0.5), (-0.5, 0.5), (-0.001, 0.001)))) @ turn.T
    askew = tuple(pin.Quaternion(turn.T).coeffs())
    shape, pose = {"cylinder": (E.Cylinder(0.5, 0.002), (0, 0, 0)),
                   "convex": (E.Convex(tuple(map(tuple, corners))), (0, 0, 0, *askew))}[plate]  # fmt: skip
    base = tl.Scene(tl.load_robot("world"), effects=[]).with_object(shape, pose, name="plate")
    both = base.with_object(E.Box((0.01,) * 3), (0.1, 0.05, height), name="box", mass=0.1)
    effects = [E.Gravity(), E.Contact((("box", "plate"),), 0.3)]
    scene = tl.Scene(both.base, both.q, [0, 0, -60.0, 0, 0, 0], effects)
    run = tl.simulate(scene, 2 * height / 60, contact="stepped", t_eval=[0, 2 * height / 60])
    assert run.q[-1, 2] >= 0.006 - 1e-6


def test_a_tables_time_that_differs_from_a_samples_by_rounding_makes_no_step() -> None:
    """A ball that rests under a growing load: what presses at samples is its mean over whole steps."""
    table, times = tuple(k / 10 for k in range(11)), np.append(np.arange(10) * 0.1, 1.0)
    assert (times != table).any()
    push = E.FrameWrench("ball", (0.0, 0.0, E.Sampled(table, tuple(-10.0 * t for t in table))))
    scene = grounded(ball(), above(0.1), None, push, shapes=spheres("ball"))
    run = tl.simulate(scene, 1.0, t_eval=times, contact="stepped", step=0.01, verify=False)
    assert run.contact_forces["ball - ground"][1:, 2] == pytest.approx(2.0 * G + 10.0 * (times[1:] - 0.005))
    assert run.cost.steps == 100


def test_sensors_read_the_ends_of_steps_not_lines_between_samples() -> None:
    """A ball on a parabola that is sampled twice."""
    sensor = E.PoseSensor("ball", period=0.05)
    run = tl.simulate(
        grounded(ball(), above(5), None, sensor, shapes=spheres("ball")),
        0.5,
        t_eval=[0, 0.5],
        contact="stepped",
    )
    t, values = run.sensors["pose_sensor"]
    assert_near(values[:, 2], 5 - 0.5 * G * t**2, 1e-6)


def test_forces_on_links_are_shown_of_steps_too() -> None:
    push = E.FrameWrench("ball", force=(2.0, 0, 0), moment=(0, 0, 1.0))
    scene = grounded(ball(), above(0.3), None, push, friction=0.3, shapes=spheres("ball"))
    located, steps = (tl.simulate(scene, 0.15, contact=way, accuracy=None) for way in ("located", "stepped"))
    assert located.wrenches_on_links.keys() == steps.wrenches_on_links.keys() != set()
    for one, other in zip(located.wrenches_on_links.values(), steps.wrenches_on_links.values(), strict=True):
        assert_near(np.array(one), np.array(other), 1e-6)


def test_a_pair_has_one_law() -> None:
    shapes = spheres("ball")
    every, own = E.Contact("ground", 0.1, shapes=shapes), E.Contact((("ball", "ground"),), 0.3, shapes=shapes)
    with pytest.raises(tl.errors.SceneError, match=r"another Contact has ball - ground too; exclude="):
        tl.Scene(ball(), effects=[every, own])
    apart = (
        E.Contact("ground", 0.1, shapes={"a": shapes["ball"]}),
        E.Contact("ground", 0.3, shapes={"b": shapes["ball"]}),
    )
    tl.Scene(free_bodies("a", "b"), effects=apart)


@pytest.mark.parametrize("tilt", [1e-6, 1e-3])
def test_corners_that_bounce_one_after_the_other_are_not_one_impact(tilt: float) -> None:
    """A cube falls with a small tilt, and leaves with a spin: steps of 5 ms against located impacts, 4e-8 s apart."""
    q = [0, 0, 0.3, np.sin(tilt / 2), 0, 0, np.cos(tilt / 2)]
    cube = E.Contact("ground", restitution=0.3, shapes={"ball": (E.Box((0.1,) * 3),)})
    scene = tl.Scene(ball(0.5, 0.0008), q, effects=[E.Gravity(), cube])
    located = tl.simulate(scene, 0.3, contact="located", accuracy=1e-6)
    assert abs(located.v[-1, 3]) > 0.5
    run = stepped(scene, 0.3, 0.005, verify=True, samples=200)
    assert_agree(run, located)
    assert run.error.max() < 0.01
    plastic = tl.Scene(scene.base, q, effects=[E.Gravity(), msgspec.structs.replace(cube, restitution=0.0)])
    still, steps = (tl.simulate(plastic, 0.3, **way) for way in ({}, {"contact": "stepped", "step": 0.005}))
    assert_agree(still, steps)
    flat = tl.Scene(scene.base, above(0.3), effects=scene.effects)
    assert_near(stepped(flat, 0.3, 0.005).v[-1, 3:], 0.0, 1e-9)
