"""Bodies that touch, against independent answers: chains of blows, grips, coins, arms; and what is refused."""

import math

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp
from scipy.special import ellipk

import twolink as tl
from tests.command import printed_by
from tests.effects.bodies import (
    G,
    ball,
    ball_over_ball,
    free_bodies,
    grounded,
    planar,
    slider,
    sliders_in_a_row,
    solved,
    spheres,
    stepped,
    times,
)
from tests.near import assert_near, assert_within
from tests.refusals import refusal
from tests.urdf_text import joint, link, robot_of
from twolink.errors import AccuracyError, SceneError
from twolink.hard.cases.events import ERRORS, coin
from twolink.integrate.hybrid.state import RunState
from twolink.integrate.motion.scene_equations import equations_of

E = tl.effects


def cradle(impacts: str, e: float = 1.0) -> tl.Trajectory:
    """Five balls in a row; the first hits the others, which touch each other at rest."""
    pairs = tuple((f"b{k}", f"b{k + 1}") for k in range(4))
    contact = E.Contact(pairs, restitution=e, impacts=impacts, shapes=spheres(*(f"b{k}" for k in range(5))))
    start = 0.2 * np.arange(5)
    start[0] -= 0.3
    return solved(sliders_in_a_row(*[1.0] * 5), [contact], 0.5, start, [1, 0, 0, 0, 0], samples_per_second=10)


@pytest.mark.slow
def test_the_law_of_reflections_passes_a_blow_through_balls_that_touch() -> None:
    run = cradle("reflections")
    assert_near(run.v[-1], [0, 0, 0, 0, 1], 1e-12)
    assert_near(run.q[-1], [0, 0.2, 0.4, 0.6, 0.8 + 0.2], 1e-9)


@pytest.mark.slow
def test_newtons_law_gives_balls_that_touch_one_velocity() -> None:
    """The first contact reverses its rate, the others keep theirs: 4 u - 1 + u' = 0 with u - u' = 1."""
    run = cradle("newton")
    assert_near(run.v[-1], [-0.6, 0.4, 0.4, 0.4, 0.4], 1e-12)
    assert np.ptp(run.energy) < 1e-12


def hinged_cradle(count: int, angle: float) -> tl.Scene:
    """Balls of 1 kg on hinges 0.2 m apart, each 1 m below its own; the first one is raised, the others touch."""
    ball = '<collision><origin xyz="0 0 -1"/><geometry><sphere radius="0.1"/></geometry></collision>'
    robot = tl.load_robot(robot_of(*(
        link(f"b{k}", 1.0, 0.004, "0 0 -1", ball)
        + joint(f"j{k}", "revolute", "ground", f"b{k}", "0 -1 0", more=f'<origin xyz="{0.2 * k} 0 0"/>')
        for k in range(count))))  # fmt: skip
    contact = E.Contact("self", restitution=1.0, impacts="reflections")
    return tl.Scene(robot, [-angle] + [0] * (count - 1), effects=[E.Gravity(), contact])


@pytest.mark.slow
@pytest.mark.parametrize("count", [2, 4])
def test_balls_that_touch_at_rest_pass_the_blow_on(count: int) -> None:
    """I th'' = -m g l sin th of the first ball; from the bottom on it is the last ball's motion."""
    angle, stiff = 0.5, G / 1.004
    period = 4.0 * float(ellipk(math.sin(angle / 2) ** 2)) / math.sqrt(stiff)
    run = tl.simulate(hinged_cradle(count, angle), 0.9 * period, accuracy=1e-9, samples_per_second=20)
    swing = solve_ivp(lambda _, y: [y[1], -stiff * math.sin(y[0])], (0, run.t[-1]), [-angle, 0.0], "DOP853",
                      t_eval=run.t, rtol=1e-12, atol=1e-13).y[0]  # fmt: skip
    first = (run.t < period / 4) | (run.t > 3 * period / 4)
    assert_near(run.q[:, 0], np.where(first, swing, 0.0), 1e-8)
    assert_near(run.q[:, -1], np.where(first, 0.0, swing), 1e-8)
    assert np.abs(run.q[:, 1:-1]).max(initial=0.0) < 1e-8
    assert_near(times(run, "impact")[0], period / 4, 1e-9)


@pytest.mark.slow
def test_a_rod_slides_although_it_could_not_at_other_angles() -> None:
    """Until its other end meets the ground; steps are compared where the rod's sliding is not singular (Painleve)."""
    mu, inertia, start, speed = 1.4, 1.0 / 12.0, -0.395, 1.83
    ends = {"body": (E.Sphere(0.0, (1.0, 0.0, 0.0)), E.Sphere(0.0, (-1.0, 0.0, 0.0)))}
    effects = [E.Gravity(), E.Contact(("ground",), mu, 0.3, shapes=ends)]
    run = solved(planar(inertia), effects, 0.32, [0, -math.sin(start), start], [speed, 0, 0], samples_per_second=50)

    def rate(_: float, y: np.ndarray) -> list[float]:
        """z = -sin th, z'' = N - g, I th'' = N (cos th + mu sin th)."""
        c, s = math.cos(y[0]), math.sin(y[0])
        force = (G + s * y[1] ** 2) / (1.0 + c * (c + mu * s) / inertia)
        return [y[1], force * (c + mu * s) / inertia, y[3], -mu * force]

    def lands(_: float, y: np.ndarray) -> float:
        return float(y[0])

    lands.terminal = True
    truth = solve_ivp(rate, (0, 1), [start, 0, 0, speed], "DOP853", rtol=1e-12, atol=1e-13, events=lands,
                      dense_output=True)  # fmt: skip
    assert_near(times(run, "impact")[0], truth.t[-1], 1e-8)
    before = run.t < truth.t[-1]
    assert_near(run.q[before][:, [2, 0]], truth.sol(run.t[before])[[0, 2]].T, 1e-8)


def two_balls(far: float, speed: float) -> tl.Scene:
    """1 kg against 2 kg at rest, of 0.1 m, which bounce with 0.6."""
    effects = [E.Contact((("b0", "b1"),), restitution=0.6, shapes=spheres("b0", "b1"))]
    return tl.Scene(sliders_in_a_row(1.0, 2.0), [0, far], [speed, 0.0], effects)


@pytest.mark.parametrize("far", [105.0, 175.0, 200.0, 230.0])
def test_fast_bodies_do_not_pass_through_each_other(far: float) -> None:
    """At 400 m/s they pass within half a millisecond, in which no step ends."""
    run = tl.simulate(two_balls(far, 400.0), 1.0, accuracy=1e-6, samples_per_second=20)
    assert_near(times(run, "impact"), [(far - 0.2) / 400.0], 1e-9)
    assert run.v[-1] == pytest.approx([-0.2 / 3 * 400.0, 1.6 / 3 * 400.0], rel=1e-9)


def test_sensitivities_of_two_balls_that_collide_are_those_of_the_closed_form() -> None:
    """x_0 = (1 - a) (d - 2 r) + a v t and x_1 = d + b (v t - d + 2 r), with a = (1 - 2 e) / 3 and b = (1 + e) / 3."""
    d, v, e, t = 0.5, 1.0, 0.6, 1.0
    a, b, way = (1 - 2 * e) / 3, (1 + e) / 3, v * t - d + 0.2
    s = tl.sensitivities(
        two_balls(d, v), wrt=["v.j0", "q.j1", "effects.0.restitution"], duration=t, accuracy=1e-9, samples_per_second=4
    )
    truths = {"v.j0": [a * t, b * t], "q.j1": [1 - a, 1 - b], "effects.0.restitution": [-2 / 3 * way, way / 3]}
    for name, truth in truths.items():
        assert_near(s.q[name][-1].ravel(), truth, max(1e-8, float(s.error[name][-1])))
        assert s.error[name][-1] < 1e-6


@pytest.mark.parametrize("tilt", [0.0, 1e-6])
def test_a_cylinder_that_meets_a_wall_with_its_end(tilt: float) -> None:
    """It bounces off flat; tilted by so little that its lowest point is not determined it is stepped, or refused."""
    wall, shape = E.Plane((1.0, 0.0, 0.0)), E.Cylinder(0.1, 0.2, rpy=(0.0, math.pi / 2 + tilt, 0.0))
    contact = E.Contact((("x_link", wall),), restitution=0.5, shapes={"x_link": (shape,)})
    scene = tl.Scene(slider(), [0.3], [-1.0], [contact])
    if not tilt:
        run = tl.simulate(scene, 0.5, accuracy=1e-9)
        assert_near(times(run, "impact"), [0.2], 1e-9)
        assert_near(run.q[-1, 0], 0.1 + 0.5 * 0.3, 1e-9)
        return
    with refusal(AccuracyError, code="no-single-point", match="along a line, a flat side or an edge"):
        tl.simulate(scene, 0.5, contact="located")
    stepped = tl.simulate(scene, 0.5)
    assert "touch along a line, a flat side or an edge" in stepped.cost.why
    early = 0.1 * tilt  # points of the rim whose gaps differ by less than 1e-6 m are hit as one
    assert_near(stepped.q[-1, 0], 0.1 + early + 0.5 * (0.3 + early), 1e-6)


@pytest.mark.slow
def test_a_cylinder_stands_and_slides_until_its_load_tips_it() -> None:
    """x'' = k t - mu g to its rest, with a push at the ground; then one at a height h tips it at m g R = k t h."""
    mu, v0, radius, half, k, high = 0.4, 1.0, 0.15, 0.25, 4.0, 0.4
    shapes = {"body": (E.Cylinder(radius, 2 * half),)}
    push = E.FrameWrench("body", (E.Polynomial((0.0, k)), 0.0, 0.0), point=(0.0, 0.0, high - half))
    scene = grounded(planar(), [0, half, 0], [v0, 0, 0], friction=mu, shapes=shapes)
    run = tl.simulate(scene, 0.5, accuracy=1e-9, samples_per_second=20)
    t = np.fmin(run.t, v0 / (mu * G))
    assert_near(run.q, np.column_stack([v0 * t - mu * G * t**2 / 2, half + 0 * t, 0 * t]), 1e-9)
    force = run.contact_forces["body - ground"]
    assert_near(force[:, 2], G, 1e-9)
    tips = G * radius / (k * high)
    assert k * tips < mu * G
    with pytest.raises(AccuracyError, match="along a line, a flat side or an edge") as caught:
        solved(planar(), [*scene.effects, push], 2 * tips, [0, half, 0])
    assert_near(caught.value.data["t"], tips, 1e-3)


def test_a_cylinder_starts_upright_but_for_a_rounding(monkeypatch: pytest.MonkeyPatch) -> None:
    """The lowest point of its rim is rounding there, which compiled formulas and NumPy's do not share."""
    monkeypatch.setenv("TWOLINK_CACHE", "off")
    upright = [4.617861345417722e-16, -2.4588520612080807e-16, 0.8414537269122624, -0.5403291825040212]
    scene = grounded(free_bodies("c"), [0, 0, 0.2, *upright], friction=0.3, shapes={"c": (E.Cylinder(0.1, 0.3),)})
    state = RunState(equations_of(scene), 0.0)
    assert state.evaluate().contacts[:, 0, 0].min() == pytest.approx(0.05)


@pytest.mark.parametrize("offset", [0.0, 0.1])
def test_a_block_that_turns_on_its_corners_has_a_determined_motion_only_about_its_middle(offset: float) -> None:
    """There each corner has the same lever: its torque is mu m g r, however the corners share the weight."""
    mu, w0, a = 0.2, 2.0, 0.15
    robot = tl.load_robot(robot_of(
        '<link name="lift"/>', link("block", 2.0, (1.0, 1.0, 0.5)), joint("z", "prismatic", "ground", "lift"),
        joint("turn", "revolute", "lift", "block")))  # fmt: skip
    shapes = {"block": (E.Box((2 * a, 2 * a, 0.2), (offset, 0.0, 0.0)),)}
    scene = grounded(robot, [0.1, 0.0], [0.0, w0], friction=mu, shapes=shapes)
    e, fall, arm = 0.5, 0.02, a * math.sqrt(2)
    falling = grounded(robot, [0.1 + fall, 0.0], [0.0, w0], friction=mu, restitution=e, shapes=shapes)
    if offset:
        for one, what in ((scene, "the motion depends"), (falling, "velocities after it depend")):
            with refusal(AccuracyError, code="indeterminate-forces", match=f"{what} on the share of each") as caught:
                tl.simulate(one, 0.1, accuracy=1e-6)
            assert 'or contact="stepped" and step=1e-3' in str(caught.value)
        assert stepped(scene, 0.01, 1e-3, verify=True, samples=200).bound == "estimated"
        return
    run = tl.simulate(scene, 0.5, accuracy=1e-9)
    assert_near(run.v[-1, 1], w0 - mu * 2 * G * arm / 0.5 * 0.5, 1e-9)
    speed = math.sqrt(2 * G * fall)
    bounced = tl.simulate(falling, 1.5 * speed / G, accuracy=1e-9)
    assert_near(bounced.v[-1, 1], w0 - mu * 2 * (1 + e) * speed * arm / 0.5, 1e-9)


@pytest.mark.slow
def test_a_ball_slides_down_a_wedge_and_flies_off_its_edge() -> None:
    """As down a plane, with g sin; too fast to turn about the edge it leaves there, on a parabola."""
    angle, r = 0.5, 0.1
    n, down = np.array([-math.sin(angle), 0.0, math.cos(angle)]), -np.array([math.cos(angle), 0.0, math.sin(angle)])
    corners = tuple((x, y, z) for y in (-1.0, 1.0) for x, z in ((0.0, 0.0), (2.0, 2.0 * math.tan(angle)), (2.0, 0.0)))
    contact = E.Contact((("ball", "base"),), shapes={"base": (E.Convex(corners),)})
    way, t_edge = 0.4, math.sqrt(2 * 0.4 / (G * math.sin(angle)))
    start = [*(-way * down + r * n), 0, 0, 0, 1]
    run = solved(ball_over_ball(), [E.Gravity(), contact], t_edge + 0.1, start, accuracy=1e-8, samples_per_second=40)
    assert_near(times(run, "leave"), [t_edge], 1e-12)
    on, late = np.fmin(run.t, t_edge), np.fmax(run.t - t_edge, 0.0)
    along = G * math.sin(angle) * (on**2 / 2 + t_edge * late)
    truth = np.array(start[:3]) + np.outer(along, down) - np.outer(G * late**2 / 2, [0.0, 0.0, 1.0])
    assert run.error is not None
    assert_within(run.q[:, :3], truth, run.error)


@pytest.mark.parametrize(("apart", "meets"), [(0.1, True), (0.8, False)])  # along their axes, of capsules of 0.7 m
def test_capsules_that_meet_side_by_side_are_refused(apart: float, meets: bool) -> None:
    shapes = {"b0": (E.Capsule(0.1, 0.5),), "b1": (E.Capsule(0.1, 0.5, (0.0, 0.0, apart)),)}
    contact = E.Contact((("b0", "b1"),), shapes=shapes)
    scene = tl.Scene(sliders_in_a_row(1.0, 2.0), [0.0, 0.5], [1.0, 0.0], [contact])
    if not meets:  # they pass beside each other's ends
        assert not tl.simulate(scene, 1.0).events
        return
    with refusal(AccuracyError, code="no-single-point"):
        tl.simulate(scene, 1.0, accuracy=1e-6)
    run = tl.simulate(scene, 1.0)  # a blow that stops the lighter one, by halves of the momentum
    assert_near(run.v @ [1.0, 2.0], 1.0, 1e-9)


def test_points_without_a_radius_against_solids_are_refused() -> None:
    effects = [E.Contact((("a", "b"),), shapes={"a": (E.Sphere(0.0),), "b": (E.Box((0.1, 0.1, 0.1)),)})]
    with refusal(SceneError, code="no-located-contact"):
        tl.simulate(tl.Scene(free_bodies("a", "b"), effects=effects), 0.5, contact="located")


def test_forces_that_are_not_determined_obey_the_laws_all_the_same() -> None:
    """A slider is pressed along x onto a steep wall: N n_x + T t_x is determined, and N and T are not."""
    mu, n = 0.3, np.array([-0.5, 0.0, math.sqrt(0.75)])
    contact = E.Contact((("x_link", E.Plane(tuple(map(float, n)))),), mu, shapes=spheres("x_link"))
    scene = tl.Scene(slider(), [-0.2], effects=[E.Gravity((G, 0.0, 0.0)), contact])
    run = tl.simulate(scene, 0.5, samples_per_second=10)
    (force,) = run.contact_forces.values()
    normal = force @ n
    across = np.linalg.norm(force - np.outer(normal, n), axis=1)
    assert_near(force[:, 0], -G, 1e-6)
    assert (across < mu * normal).all()


def bodies_on_sliders(**axes: tuple[float, str, str]) -> tl.Robot:
    """Links by name: mass, the parent link, and the axis of the prismatic joint of the same name."""
    return tl.load_robot(robot_of(*(
        link(name, mass) + joint(name, "prismatic", parent, name, axis)
        for name, (mass, parent, axis) in axes.items())))  # fmt: skip


@pytest.mark.slow
def test_a_body_that_slides_across_a_slope_turns_downhill_as_it_stops() -> None:
    """After v0 (mu cos + sin d) / (g (mu^2 cos^2 - sin^2)), with the direction d downhill, which goes to 1."""
    angle, mu, v0, turn = 0.3, 0.35, 0.7, math.radians(40.0)
    steep, rough = math.sin(angle), mu * math.cos(angle)
    n = (-steep, 0.0, math.cos(angle))
    robot = bodies_on_sliders(a=(1e-9, "ground", "1 0 0"), b=(1e-9, "a", "0 1 0"), body=(1.0, "b", "0 0 1"))
    contact = E.Contact((("body", E.Plane(n)),), mu, shapes=spheres("body"))
    v = [-v0 * math.cos(turn) * math.cos(angle), v0 * math.sin(turn), -v0 * math.cos(turn) * math.sin(angle)]
    stops = v0 * (rough + steep * math.cos(turn)) / (G * (rough**2 - steep**2))
    scene = tl.Scene(robot, [0.1 * n[0], 0, 0.1 * n[2]], v, [E.Gravity(), contact])
    coarse, fine = (tl.simulate(scene, 1.2 * stops, accuracy=a, samples_per_second=10) for a in (1e-8, 1e-11))
    for run in (coarse, fine):  # friction turns the last slip, below accuracy^(2/3) m/s, less stiffly
        (event,) = run.events
        assert event.kind == "roll"
        assert abs(event.t - stops) < run.accuracy ** (2 / 3)
        assert_near(run.v[-1], 0.0, 1e-9)
    assert np.abs(coarse.q - fine.q).max() <= coarse.error.max() + fine.error.max()


@pytest.mark.slow
def test_a_peg_slips_when_its_fingers_press_at_the_edge_of_the_cone() -> None:
    """Pressed with F = F_0 - k t from both sides it slips where 2 mu F = m g, and falls with g - 2 mu F / m."""
    mu, first, k, mass = 0.4, 30.0, 20.0, 2.0
    robot = bodies_on_sliders(left=(0.5, "ground", "1 0 0"), right=(0.5, "ground", "1 0 0"),
                              cart=(1e-6, "ground", "1 0 0"), peg=(mass, "cart", "0 0 1"))  # fmt: skip
    squeeze = E.Torque({"left": E.Polynomial((first, -k)), "right": E.Polynomial((-first, k))})
    shapes = {"left": (E.Sphere(0.02),), "right": (E.Sphere(0.02),), "peg": (E.Box((0.1, 0.1, 1.0)),)}
    contact = E.Contact((("left", "peg"), ("right", "peg")), mu, shapes=shapes)
    scene = tl.Scene(robot, [0, 0, -0.07, 0.07], effects=[E.Gravity(), squeeze, contact])
    slips = (first - mass * G / (2 * mu)) / k
    run = tl.simulate(scene, slips + 0.2, accuracy=1e-9, samples_per_second=50)
    assert_near(times(run, "slide"), [slips] * len(times(run, "slide")), 1e-9)
    late = np.fmax(run.t - slips, 0.0)
    assert_near(run.q[:, 1] + 2 * mu * k / mass * late**3 / 6, 0.0, 1e-9)
    assert_near(run.q[:, [0, 2, 3]], [0, -0.07, 0.07], 1e-9)


@pytest.mark.slow
def test_a_block_that_is_set_on_a_moving_cart_is_taken_along() -> None:
    """Friction mu m g brings both to M v0 / (M + m), after v0 / (mu g (1 + m / M))."""
    mu, v0, mass, own = 0.3, 1.0, 2.0, 1.0
    robot = bodies_on_sliders(acart=(mass, "ground", "1 0 0"), bx=(1e-6, "ground", "1 0 0"), bz=(own, "bx", "0 0 1"))
    shapes = {"acart": (E.Box((2.0, 0.5, 0.2)),), "bz": (E.Box((0.4, 0.3, 0.2)),)}
    contact = E.Contact((("acart", "bz"),), mu, shapes=shapes)
    run = solved(robot, [E.Gravity(), contact], 0.5, [0, 0, 0.2], [v0, 0, 0], samples_per_second=20, contact="located")
    own += 1e-6  # with its cart, which friction takes along
    end = v0 / (mu * G / own + mu * G / mass)
    t, late = np.fmin(run.t, end), np.fmax(run.t - end, 0.0)
    assert_near(times(run, "roll"), end, 1e-9)
    common = mass * v0 / (mass + own)
    assert_near(run.q[:, 0], v0 * t - mu * G / mass * t**2 / 2 + common * late, 1e-9)
    assert_near(run.q[:, 1], mu * G / own * t**2 / 2 + common * late, 1e-9)
    assert_near(run.q[:, 2], 0.2, 1e-12)


def test_boxes_whose_edges_meet_bounce() -> None:
    """One is turned by 45 degrees about y and the other about z: their edges cross."""
    shapes = {"b0": (E.Box((0.2, 0.2, 0.2), rpy=(0.0, math.pi / 4, 0.0)),),
              "b1": (E.Box((0.2, 0.2, 0.2), rpy=(0.0, 0.0, math.pi / 4)),)}  # fmt: skip
    contact, d = E.Contact((("b0", "b1"),), restitution=0.5, shapes=shapes), 0.2 * math.sqrt(2.0)
    row = sliders_in_a_row(1.0, 2.0)
    run = solved(row, [contact], 1.0, [0.0, 0.5], [1.0, 0.0], samples_per_second=20, contact="located")
    assert_near(times(run, "impact"), [0.5 - d], 1e-12)
    after = np.fmax(run.t - 0.5 + d, 0.0)  # momentum, and half the speed back: 0 and 1/2 m/s
    assert_near(run.q, np.stack([np.fmin(run.t, 0.5 - d), 0.5 + 0.5 * after], axis=1), 1e-9)


@pytest.mark.slow
def test_a_stack_of_boxes_stays_at_rest() -> None:
    """Three boxes, each smaller than the one below: nothing creeps, and the ground gives the weight of all."""
    robot = bodies_on_sliders(a=(3.0, "ground", "0 0 1"), b=(2.0, "ground", "0 0 1"), c=(1.0, "ground", "0 0 1"))
    sizes = {"a": 0.4, "b": 0.3, "c": 0.2}
    shapes = {name: (E.Box((size, size, 0.2)),) for name, size in sizes.items()}
    contact = E.Contact((("a", "ground"), ("a", "b"), ("b", "c")), 0.5, shapes=shapes)
    run = solved(robot, [E.Gravity(), contact], 100.0, [0.1, 0.3, 0.5], samples_per_second=0.1, contact="located")
    assert_near(run.q, [0.1, 0.3, 0.5], 1e-12)
    forces = run.contact_forces
    assert [forces[pair][-1, 2] for pair in ("a - ground", "a - b", "b - c")] == pytest.approx([6 * G, -3 * G, -G])


def test_an_arm_that_hits_a_table_moves_as_an_independent_integration_does() -> None:
    """The paper's arm: SciPy to each impact, then v+ = v- - (1 + e) W J^T (J W J^T)^-1 J v-."""
    robot, e, height = tl.load_robot("two_link"), 0.8, -0.6
    contact = E.Contact((("forearm", E.Plane(height=height)),), restitution=e,
                        shapes={"forearm": (E.Sphere(0.0, (1.0, 0.0, 0.0)),)})  # fmt: skip
    run = solved(robot, [E.Gravity(), contact], 1.0, [0.3, -0.5], samples_per_second=40)
    model = run.robot.model
    data = model.createData()

    def rate(_: float, x: np.ndarray) -> np.ndarray:
        return np.concatenate([x[2:], pin.aba(model, data, x[:2], x[2:], np.zeros(2))])

    def gap(_: float, x: np.ndarray) -> float:
        return math.sin(x[0]) + math.sin(x[0] + x[1]) - height

    gap.terminal, gap.direction = True, -1
    t, x, q = 0.0, np.array([0.3, -0.5, 0.0, 0.0]), np.empty((len(run.t), 2))
    while t < run.t[-1]:
        part = solve_ivp(rate, (t, run.t[-1]), x, "DOP853", events=gap, dense_output=True, rtol=1e-13, atol=1e-13)
        later = (run.t >= t) & (run.t <= part.t[-1])
        q[later] = part.sol(np.append(run.t[later], t))[:2, :-1].T
        t, x = float(part.t[-1]), np.array(part.y[:, -1])
        far = math.cos(x[0] + x[1])
        row, inverse = np.array([math.cos(x[0]) + far, far]), np.linalg.inv(pin.crba(model, data, x[:2]))
        x[2:] -= (1 + e) * (row @ x[2:]) / (row @ inverse @ row) * inverse @ row
    assert len(times(run, "impact")) > 2
    assert_near(run.q, q, 1e-9)


@pytest.mark.slow
def test_a_coin_spins_as_its_equations_of_rolling_say() -> None:
    """The hard case at one accuracy: a thin cylinder rolls on its rim."""
    scene = coin()
    run = tl.simulate(scene, 1.0, accuracy=1e-9, samples_per_second=20)
    assert ERRORS["coin"](scene.robot, run).max() < 2e-9
    assert not run.events


def test_what_does_not_touch_costs_no_operation() -> None:
    """Between contacts the equations are those of the scene without any. That loads no engine of events."""
    robot, q = free_bodies("a", "b"), [0, 0, 1, 0, 0, 0, 1, 0, 0, 2, 0, 0, 0, 1]
    contact = E.Contact(("self", "ground"), shapes=spheres(*"ab"))
    without, beside = (equations_of(tl.Scene(robot, q, effects=effects))
                       for effects in ([E.Gravity()], [E.Gravity(), contact]))  # fmt: skip
    assert beside.operations == without.operations
    assert beside.key("steps") == without.key("steps")
    code = ("import sys, twolink as tl; tl.simulate(tl.load_scene('arm-swing'), 0.1); "
            "print(*(name for name in sys.modules if name.startswith('twolink')))")  # fmt: skip
    names = ("engine", "impacts", "locating")
    assert not {*printed_by(code).split()} & {f"twolink.integrate.hybrid.{name}" for name in names}


def test_a_slip_that_stops_while_it_turns_ends_there() -> None:
    """A ball off its centre slides over a capsule, sticks, slides and leaves: in tens of pieces, not in thousands."""
    inertias = {"a": (0.429, 0.0244626, 0.0244626, 0.0101939), "b": (0.972, 0.00144672, 0.00863564, 0.00863564)}
    robot = tl.load_robot(robot_of(*(
        link(name, mass, moments) + joint(f"{name}_joint", "floating", "ground", name)
        for name, (mass, *moments) in inertias.items())))  # fmt: skip
    shapes = {"a": (E.Capsule(0.218, 0.3),), "b": (E.Sphere(0.061, (0.086, 0.0, 0.0)),)}
    q = [0.0, 0.0, 0.978, 0.84076, 0.06002, -0.12973, 0.5222, -0.4574, 0.35062, 0.67314, 0.37921, -0.76094, -0.35607,
         -0.3878]  # fmt: skip
    v = [0.0, 0.0, 0.0, -1.54, -3.91073, 3.8817, -2.7439, -3.78232, -2.24705, -4.06483, -3.33301, 2.60199]
    effects = [E.Gravity((0.0, 0.0, -9.75)), E.Contact((("a", "b"),), friction=0.239, shapes=shapes)]
    run = tl.simulate(tl.Scene(robot, robot.normalize(np.array([q]))[0], v, effects), 0.303, tolerance=3e-7)
    kinds = [event.kind for event in run.events]
    assert kinds == ["impact", "slide", "roll", "slide", "leave"]
    assert run.solution is not None
    assert len(run.solution.segments) < 20
    assert run.error is not None
    assert run.error[-1] < 1e-4


def test_a_small_ball_bounces_and_turns_as_a_large_one() -> None:
    """A ball off its centre of mass, whose friction turns while it bounces, and its copy of 1.5e-3 of the size.

    Bounces too low to follow leave out more of the angle the smaller the ball is. All solutions left out the same.
    """
    runs = []
    for size in (1.0, 1.5e-3):
        r = 0.2 * size
        robot = ball(2.0, (0.032 * size**2, 0.092 * size**2, 0.092 * size**2))
        contact = E.Contact("ground", 0.517, 0.496, shapes={"ball": (E.Sphere(r, (0.09 * size, 0.0, 0.0)),)})
        v = np.array([-0.8, -0.6, -0.8, 4.0, -2.5, 1.1]) * size ** np.repeat([0.5, -0.5], 3)
        start = [0, 0, 0.28 * size, 0.1, 0.5, -0.3, math.sqrt(0.65)]
        end = 0.6 * math.sqrt(size)
        effects = [E.Gravity(), contact]
        runs.append(solved(robot, effects, end, start, v, accuracy=4e-9, samples_per_second=20 / end))
    large, small = runs
    assert_within(large.q[:, 3:], small.q[:, 3:], large.error + small.error)
    assert_within(1.5e-3 * large.q[:, :3], small.q[:, :3], large.error + small.error)


@pytest.mark.parametrize("friction", [0.1, 0.6])
def test_a_slip_that_turns_where_the_arm_is_stretched_goes_on(friction: float) -> None:
    """No forces let the tip roll there, where its tangent direction is lost for an instant; steps agree."""
    arm = tl.load_robot(robot_of(
        link("a", 0.5, 0.006, "0.2 0 0"), link("b", 0.5, 0.006, "0.2 0 0"),
        joint("d", "revolute", "ground", "a", "0 1 0"),
        joint("e", "revolute", "a", "b", "0 1 0", more='<origin xyz="0.4 0 0"/>')))  # fmt: skip
    drive = E.JointPD({"d": 0.6, "e": 0.3}, kp={"d": 8.0, "e": 2.0}, kd={"d": 0.5, "e": 0.1})
    ball = {"b": (E.Sphere(0.05, (0.4, 0, 0)),)}
    floor = E.Contact((("b", E.Plane(height=-0.5)),), friction, 0.3, shapes=ball)
    scene = tl.Scene(arm, [0.1, 0.05], [0.2, 0.1], [E.Gravity(), floor, drive])
    run = tl.simulate(scene, 1.5, contact="located")
    assert run.bound == "verified"
    steps = stepped(scene, 1.5, 1e-3, samples=200)
    assert_near(run.q, steps.q, 2e-3)  # of first order in the step
