"""Bodies that touch: closed forms of blocks, balls, ladders and chains of impacts."""

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad

import twolink as tl
from tests.effects.bodies import G, ball, ball_over_ball, free_bodies, kinds, planar, sliders_in_a_row, solved, times
from tests.near import assert_near

E = tl.effects
BLOCK = {"body": (E.Box((1.0, 0.3, 0.2)),)}  # in the plane of x and z, of 1 kg
ENDS = {"body": (E.Sphere(0.0, (0.5, 0.0, 0.0)), E.Sphere(0.0, (-0.5, 0.0, 0.0)))}
WALL = E.Plane((1.0, 0.0, 0.0))


@pytest.mark.slow
def test_a_block_slides_to_rest_on_its_corners_until_a_push_exceeds_static_friction(tmp_path: Path) -> None:
    """x'' = k t - mu g to its rest; from k t = static g on it slides again. The ground gives weight and friction."""
    mu, static, v0, k = 0.3, 0.5, 1.0, 4.0
    push = E.FrameWrench("body", (E.Polynomial((0.0, k)), 0.0, 0.0), point=(0.0, 0.0, -0.1))
    effects = [E.Gravity(), push, E.Contact([("body", "ground")], mu, static=static, shapes=BLOCK)]
    run = solved(planar(), effects, 1.4, [0, 0.1, 0], [v0, 0, 0], samples_per_second=30)
    rest, again = (mu * G - math.sqrt((mu * G) ** 2 - 2 * k * v0)) / k, static * G / k
    assert [(event.kind, event.t) for event in run.events] == [("roll", pytest.approx(rest, abs=1e-8)),
                                                               ("slide", pytest.approx(again, abs=1e-9))]  # fmt: skip
    t, late = np.fmin(run.t, rest), np.fmax(run.t - again, 0.0)
    x = v0 * t - mu * G * t**2 / 2 + k * t**3 / 6 + k * late**3 / 6 + (static - mu) * G * late**2 / 2
    assert_near(run.q[:, 0], x, 1e-9)
    assert_near(run.q[:, 1:], [0.1, 0], 1e-12)
    force, held = run.contact_forces["body - ground"], (run.t > rest) & (run.t < again)
    assert_near(force[:, 2], G, 1e-9)
    assert_near(force[:, 0], np.where(held, -k * run.t, -mu * G), 1e-9)
    again = tl.Trajectory.load(run.save(tmp_path / "x.npz"), run.robot)
    assert list(again.events) == list(run.events)
    assert np.array_equal(again.contact_forces["body - ground"], force)


def on_a_slope(angle: float, size: tuple[float, float, float], mu: float, speed: float = 0.0) -> tl.Scene:
    """A free block that lies on a slope, its x down it, with a speed along x."""
    n = (math.sin(angle), 0.0, math.cos(angle))
    contact = E.Contact((("block", E.Plane(n)),), mu, shapes={"block": (E.Box(size),)})
    q = [*(0.5 * size[2] * np.array(n)), 0.0, math.sin(angle / 2), 0.0, math.cos(angle / 2)]
    return tl.Scene(free_bodies("block"), q, [speed, 0, 0, 0, 0, 0], [E.Gravity(), contact])


def off_its_way(run: tl.Trajectory, angle: float, way: np.ndarray) -> float:
    """How far a block on a slope is from where it should be, by its way down."""
    down = np.array([math.cos(angle), 0.0, -math.sin(angle)])
    return float(np.abs(run.q[:, :3] - run.q[0, :3] - np.outer(way, down)).max())


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.95, 1.05])
def test_a_free_block_on_four_corners_slides_down_an_incline_that_exceeds_its_friction(share: float) -> None:
    angle, mu = 0.4, share * math.tan(0.4)
    run = tl.simulate(on_a_slope(angle, (0.4, 0.3, 0.2), mu), 0.5, accuracy=1e-9, samples_per_second=10)
    slope = max(0.0, math.sin(angle) - mu * math.cos(angle))
    assert off_its_way(run, angle, slope * G * run.t**2 / 2) < 1e-9
    assert_near(run.q[:, 3:], run.q[0, 3:], 1e-10)


@pytest.mark.slow
def test_a_free_block_slides_up_a_slope_and_down_again() -> None:
    """Where it stops, each corner has a slow slip of its own; down they slide in one direction."""
    angle, mu, v0 = 0.48, 0.442, 2.798
    steep, rough = G * math.sin(angle), mu * G * math.cos(angle)
    run = tl.simulate(on_a_slope(angle, (0.311, 0.479, 0.052), mu, -v0), 0.45, accuracy=1e-6, samples_per_second=20)
    t, back = np.fmin(run.t, v0 / (steep + rough)), np.fmax(run.t - v0 / (steep + rough), 0.0)
    way = (steep + rough) * t**2 / 2 + (steep - rough) * back**2 / 2 - v0 * t
    assert off_its_way(run, angle, way) < 1e-8


@pytest.mark.slow
def test_a_free_block_that_slides_to_rest_stops_with_all_corners() -> None:
    """Where it stops, rounding has given it a turn of 1e-8 rad/s: each corner still slides in its own direction."""
    angle, mu, v0 = 0.52, 0.878, 3.3
    run = tl.simulate(on_a_slope(angle, (0.334, 0.578, 0.089), mu, v0), 1.338, accuracy=1e-6, samples_per_second=20)
    slope = G * (math.sin(angle) - mu * math.cos(angle))
    t = np.fmin(run.t, -v0 / slope)
    assert off_its_way(run, angle, v0 * t + slope * t**2 / 2) < 1e-8
    assert run.error.max() <= 1e-6


@pytest.mark.slow
def test_a_block_that_is_pushed_high_tips() -> None:
    """Push P = k t at a height h over the ground: it tips at m g b / 2 h, before it would slide at mu m g."""
    mu, k, width, height = 0.5, 10.0, 0.4, 0.6
    shapes = {"body": (E.Box((width, 0.3, 0.8)),)}
    push = E.FrameWrench("body", (E.Polynomial((0.0, k)), 0.0, 0.0), point=(0.0, 0.0, height - 0.4))
    effects = [E.Gravity(), push, E.Contact(("ground",), friction=mu, shapes=shapes)]
    when = G * width / (2 * height * k)
    run = solved(planar(), effects, when + 0.05, [0, 0.4, 0], samples_per_second=20)
    assert run.events[0].kind == "leave"
    assert_near(run.events[0].t, when, 1e-9)
    assert run.q[-1, 2] < -1e-5
    assert_near(run.q[run.t < when, 2], 0.0, 1e-12)


@pytest.mark.slow
def test_a_free_cube_that_lands_flat_keeps_its_symmetry() -> None:
    """The four corners give mu times the normal impulse together; it slides on as a point would, and does not turn."""
    mu, height, v0 = 0.5, 1e-4, 1.0
    effects = [E.Gravity(), E.Contact("ground", friction=mu, shapes={"cube": (E.Box((0.2, 0.2, 0.2)),)})]
    robot = free_bodies("cube")
    run = solved(robot, effects, 0.5, [0, 0, 0.1 + height, 0, 0, 0, 1], [v0, 0, 0, 0, 0, 0], samples_per_second=20)
    fall = math.sqrt(2 * height / G)
    speed = v0 - mu * G * fall
    assert kinds(run) == ["impact", "slide", "roll"]
    assert_near(run.events[0].energy, (v0**2 - speed**2) / 2 + G * height, 1e-9)
    assert_near(run.q[-1, 0], v0 * fall + speed**2 / (2 * mu * G), 1e-9)
    assert_near(run.q[:, 1], 0.0, 1e-11)
    assert_near(run.q[:, 3:6], 0.0, 1e-10)
    assert repr(run.contact_forces) == "cube - ground  11 x 3, up to 10.97 N"


ROUND = {
    "contact": lambda n, mu: E.Contact((("ball", E.Plane(n)),), mu, shapes={"ball": (E.Sphere(0.1),)}),
    "plane contact": lambda n, mu: E.PlaneContact("ball", radius=0.1, normal=n, friction=mu),
}


@pytest.mark.parametrize("kind", ROUND)
@pytest.mark.parametrize("share", [pytest.param(0.95, marks=pytest.mark.slow), 1.05])
def test_a_ball_rolls_down_an_incline_if_friction_is_two_sevenths_of_its_tangent(kind: str, share: float) -> None:
    """With 5/7 g sin; else it slides."""
    angle, n = 0.5, (-math.sin(0.5), 0.0, math.cos(0.5))
    mu = share * 2 / 7 * math.tan(angle)
    effects = [E.Gravity(), ROUND[kind](n, mu)]
    run = solved(ball(), effects, 1.0, [*(0.1 * np.array(n)), 0, 0, 0, 1], samples_per_second=20)
    down = np.linalg.norm(run.q[:, :3] - run.q[0, :3], axis=1)
    slope = 5 / 7 * math.sin(angle) if share > 1 else math.sin(angle) - mu * math.cos(angle)
    assert_near(down, slope * G * run.t**2 / 2, 1e-9)


@pytest.mark.slow
def test_a_ladder_leaves_the_wall_when_it_has_fallen_by_a_third() -> None:
    """Without friction theta'^2 = 3 g (cos theta_0 - cos theta) for 1 m; it leaves at cos theta = 2/3 cos theta_0."""
    first = 0.3
    effects = [E.Gravity(), E.Contact(("ground", ("body", WALL)), shapes=ENDS)]
    start = [0.5 * math.sin(first), 0.5 * math.cos(first), -(math.pi / 2 - first)]  # the upper end at the wall
    leaves = math.acos(2 / 3 * math.cos(first))
    # theta = first + u^2: theta' is 0 at first.
    when = quad(lambda u: 2 * u / math.sqrt(3 * G * (math.cos(first) - math.cos(first + u * u))), 1e-9,
                math.sqrt(leaves - first), epsabs=1e-13, epsrel=1e-13)[0]  # fmt: skip
    run = solved(planar(1 / 12), effects, when + 0.1, start, samples_per_second=40)
    assert_near(times(run, "leave"), [when], 1e-8)
    held = run.t < when
    theta = math.pi / 2 + run.q[held, 2]
    assert_near(run.v[held, 2] ** 2, 3 * G * (math.cos(first) - np.cos(theta)), 1e-8)
    assert_near(run.v[~held, 0], run.v[~held, 0][0], 1e-9)  # nothing pushes along x any more
    assert np.ptp(run.energy) < 1e-8


@pytest.mark.parametrize("e", [0.0, 0.6, 1.0])
def test_two_spheres_collide_along_a_line(e: float) -> None:
    robot = sliders_in_a_row(1.0, 2.0)
    effects = [E.Contact((("b0", "b1"),), restitution=e, shapes={n: (E.Sphere(0.1),) for n in ("b0", "b1")})]
    run = solved(robot, effects, 1.0, [0, 0.5], [1.0, 0.0], samples_per_second=20)
    after = np.array([(1 - 2 * e) / 3, (1 + e) / 3])
    late = np.fmax(run.t - 0.3, 0)
    assert_near(run.q - np.column_stack([run.t - late, 0.5 + 0 * late]), np.outer(late, after), 1e-9)


def test_newtons_cradle_with_gaps_passes_the_speed_on() -> None:
    gap, count = 1e-3, 5
    robot = sliders_in_a_row(*[1.0] * count)
    pairs = tuple((f"b{k}", f"b{k + 1}") for k in range(count - 1))
    effects = [E.Contact(pairs, restitution=1.0, shapes={f"b{k}": (E.Sphere(0.1),) for k in range(count)})]
    start = np.arange(count) * (0.2 + gap)
    start[0] -= 0.3
    run = solved(robot, effects, 1.0, start, [1, 0, 0, 0, 0], samples_per_second=11)
    assert kinds(run) == ["impact"] * 4
    assert_near(run.v[-1], [0, 0, 0, 0, 1], 1e-12)
    last = start[-1] + 1.0 - 0.3 - 4 * gap
    assert_near(run.q[-1], [*(start[1:] - 0.2), last], 1e-9)


def test_two_free_spheres_collide_off_centre() -> None:
    """The part of the velocity along the line of centres is exchanged; without friction the rest stays."""
    robot, r, offset = free_bodies("a", "b"), 0.5, 0.6
    effects = [E.Contact((("a", "b"),), restitution=1.0, shapes={n: (E.Sphere(r),) for n in "ab"})]
    q = [-2.0, 0, 0, 0, 0, 0, 1, 0, offset, 0, 0, 0, 0, 1]
    run = solved(robot, effects, 3.0, q, [1.0] + [0] * 11, samples_per_second=10)
    n = np.array([0.8, 0.6, 0.0])
    assert_near(run.v[-1, :3], [1, 0, 0] - 0.8 * n, 1e-9)
    assert_near(run.v[-1, 6:9], 0.8 * n, 1e-9)
    assert_near(run.q[-1, 7:10], [0, offset, 0] + 0.8 * n * (3.0 - 1.2), 1e-9)


@pytest.mark.parametrize(("duration", "bounces"), [(20.0, 90), pytest.param(220.0, 1000, marks=pytest.mark.slow)])
def test_a_ball_in_a_box_keeps_its_energy_and_its_unfolded_path(duration: float, bounces: int) -> None:
    """Elastic walls at -1 and 1 on all sides: each coordinate is a triangular wave."""
    walls = [(tuple(s * float(k == i) for k in range(3)), -1.0) for i in range(3) for s in (1.0, -1.0)]
    pairs = tuple(("ball", E.Plane(n, h)) for n, h in walls)
    effects = [E.Contact(pairs, restitution=1.0, shapes={"ball": (E.Sphere(0.1),)})]
    v = np.array([3.0, 4.1, -2.3])
    run = solved(ball(), effects, duration, v=[*v, 0, 0, 0], samples_per_second=2)
    wave = np.abs((np.outer(run.t, v) - 0.9) % 3.6 - 1.8) - 0.9
    assert_near(run.q[:, :3], wave, 1e-9)
    assert len(run.events) > bounces
    assert np.ptp(run.energy) < 1e-9


def test_a_sphere_rolls_off_a_sphere_at_the_classical_angle() -> None:
    """Without friction it leaves at cos theta = 2/3 of the start."""
    robot, first = ball_over_ball(), 0.1
    effects = [E.Gravity(), E.Contact((("ball", "base"),))]
    start = [1.1 * math.sin(first), 0.0, 1.1 * math.cos(first), 0, 0, 0, 1]
    run = solved(robot, effects, 1.6, start, samples_per_second=200)
    leave = times(run, "leave")[0]
    where = run.at(leave)[0]
    assert_near(where[2] / 1.1, 2 / 3 * math.cos(first), 1e-8)
    held = run.t < leave
    assert_near(np.linalg.norm(run.q[held, :3], axis=1), 1.1, 1e-9)
