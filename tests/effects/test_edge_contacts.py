"""Boxes and convex meshes that touch each other at corners, sides and edges, located, against independent answers."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

import twolink as tl
from tests.effects.bodies import G, ball_over_ball, bouncing, kinds, times
from tests.effects.edge_truths import Block, Edge, Free, block_over_edge, falls_on_edge
from tests.near import assert_near
from twolink.robots.collisions import AnyShape

E = tl.effects
MASS, INERTIA = 2.0, 0.008  # of the free body, "ball"; the other one, "base", is fixed
DIAGONAL = math.sqrt(0.5)
SIDE = 0.2
ROOF = (0.0, 0.0, -SIDE * DIAGONAL)  # of a box that is turned by 45 degrees, whose upper edge is at z = 0
CUBE = E.Box((SIDE, SIDE, SIDE))
TABLE = E.Box((1.0, 1.0, 0.4), (-0.5, 0.0, -0.2))  # its upper side ends at x = 0
FLOOR = E.Box((8.0, 8.0, 1.0), (0.0, 0.0, -0.5))
Shapes = AnyShape | tuple[AnyShape, ...]


def meshed(shape: E.Box) -> E.Convex:
    """A box as a convex mesh."""
    x, y, z = (0.5 * size for size in shape.size)
    return E.Convex(tuple(itertools.product((x, -x), (y, -y), (z, -z))), shape.point, shape.rpy)


def turned(shape: E.Box | E.Convex, turn: Rotation) -> E.Box | E.Convex:
    """A shape of the fixed body in a turned world."""
    rotation = turn.as_matrix() @ pin.rpy.rpyToMatrix(*shape.rpy)
    point = tuple(map(float, turn.apply(shape.point)))
    first = shape.size if isinstance(shape, E.Box) else shape.vertices
    return type(shape)(first, point, tuple(map(float, pin.rpy.matrixToRpy(rotation))))


def pose(x: Sequence[float], turn: Rotation | None = None) -> np.ndarray:
    """A configuration of the free body."""
    return np.concatenate([x, [0, 0, 0, 1] if turn is None else turn.as_quat()])


def scene(base: Shapes, ball: Shapes, q: np.ndarray, v: object = None, *, law: tuple[float, float] = (0.0, 0.0),
          static: float | None = None, swapped: bool = False, world: Rotation | None = None,
          pull: Sequence[float] = (0.0, 0.0, 0.0)) -> tl.Scene:  # fmt: skip
    """The free body over the fixed one. law: e and mu. world: everything is turned by it. pull: a force on it."""
    shapes = {
        "base": base if isinstance(base, tuple) else (base,),
        "ball": ball if isinstance(ball, tuple) else (ball,),
    }
    weight, force = np.array([0.0, 0.0, -G]), np.array(pull)
    if world is not None:
        shapes["base"] = tuple(turned(shape, world) for shape in shapes["base"])
        q = np.concatenate([world.apply(q[:3]), (world * Rotation.from_quat(q[3:])).as_quat()])
        weight, force = world.apply(weight), world.apply(force)
    pair = ("base", "ball") if swapped else ("ball", "base")
    effects = [E.Gravity(tuple(map(float, weight))),
               E.Contact((pair,), law[1], law[0], static, shapes=shapes)]  # fmt: skip
    if force.any():
        effects.append(E.FrameWrench("ball", tuple(map(float, force))))
    return tl.Scene(ball_over_ball(), q, v, effects)


def solve(what: tl.Scene, duration: float, samples: float = 50, accuracy: float = 1e-9) -> tl.Trajectory:
    return tl.simulate(what, duration, accuracy=accuracy, samples_per_second=samples, contact="located")


def in_plane(run: tl.Trajectory) -> np.ndarray:
    """x, z and the turn about y, of a motion in the plane of x and z."""
    assert_near(run.q[:, [1, 3, 5]], 0.0, 1e-9)
    return np.stack([run.q[:, 0], run.q[:, 2], np.unwrap(2 * np.arctan2(run.q[:, 4], run.q[:, 6]))], axis=1)


# --- edges that cross ---------------------------------------------------------------------------------------------

ROOF_X = E.Box((1.0, SIDE, SIDE), ROOF, (math.pi / 4, 0.0, 0.0))  # its upper edge is along x
ABOUT_Y = Rotation.from_euler("y", math.pi / 4)  # turns a cube so that its lower edge is along y
LOWER = Edge(SIDE / 2 * np.array([1.0, 0.0, -1.0]), np.array([0.0, 1.0, 0.0]))  # that edge in its own axes
UPPER = Edge(np.zeros(3), np.array([1.0, 0.0, 0.0]))


@pytest.mark.some(1)
@pytest.mark.parametrize("mesh", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_cube_bounces_on_an_edge_until_it_rests_on_it(mesh: bool) -> None:
    """Upon crossing edges, v -> -e v: the bounces end after (1 + e) / (1 - e) times the fall."""
    fall, e, low = 0.1, 0.5, SIDE * DIAGONAL
    ball, base = (meshed(CUBE), meshed(ROOF_X)) if mesh else (CUBE, ROOF_X)
    start = pose([0.0, 0.0, low + fall], ABOUT_Y)
    first = math.sqrt(2 * fall / G)
    end = first * (1 + e) / (1 - e)
    run = solve(scene(base, ball, start, law=(e, 0.0)), 1.1 * end)
    assert_near(times(run, "impact")[:3], [first, 2 * first, 2.5 * first], 1e-9)
    before = run.t < 0.9 * end
    assert_near(run.q[before, 2] - low, bouncing(run.t, fall, e)[before], 1e-9)
    assert_near(run.q[:, 2] - low, bouncing(run.t, fall, e), 1e-6)
    assert_near(run.q[:, :2], 0.0, 1e-6)
    assert_near(run.contact_forces["ball - base"][-1], [0, 0, MASS * G], 1e-6)


BLOWS = {  # of a cube with a spin: turns about x and z; where it starts, its velocities, e and mu
    "off centre": ((0.0, 0.0), (0.02, 0.03), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.5, 0.0)),
    "at a slant": ((0.2, 0.6), (0.03, -0.04), (0.1, 0.0, -0.5), (0.0, 0.0, 0.0), (0.5, 0.0)),
    "spinning": ((0.1, 0.4), (0.01, 0.02), (0.2, -0.1, 0.0), (1.0, -1.5, 2.0), (0.7, 0.0)),
    "sticks": ((0.0, 0.0), (0.0, 0.03), (0.0, 0.1, 0.0), (0.0, 0.0, 0.0), (0.5, 0.9)),
    "slips": ((0.0, 0.0), (0.0, -0.13), (0.0, 1.5, 0.0), (0.0, 0.0, 0.0), (0.5, 0.2)),
    "sticks at a slant": ((0.15, 0.5), (0.02, 0.03), (0.3, 0.2, 0.0), (1.0, 2.0, -1.0), (0.4, 1.5)),
    "slips at a slant": ((0.15, 0.5), (0.02, 0.03), (1.5, -0.7, 0.0), (1.0, 2.0, -1.0), (0.4, 0.15)),
}


def blow(name: str) -> tuple[Free, tuple[float, float]]:
    """Its start, and the law."""
    (about_x, about_z), (x, y), v, w, law = BLOWS[name]
    turn = Rotation.from_euler("xyz", [about_x, 0.0, about_z]) * ABOUT_Y
    return Free(0.0, np.array([x, y, SIDE]), turn, np.array(v), np.array(w)), law


def own_velocity(body: Free) -> np.ndarray:
    """The velocities of a body along its own axes."""
    return body.turn.inv().apply([body.v, body.w]).ravel()


def struck(states: list[Free], t: np.ndarray) -> tuple[np.ndarray, list[Rotation]]:
    """The middles and turns at times t."""
    at = [[body for body in states if body.t <= now][-1].at(now) for now in t]
    return np.array([body.x for body in at]), [body.turn for body in at]


def assert_moves_as(run: tl.Trajectory, states: list[Free], tolerance: float, until: float = np.inf) -> None:
    now = run.t < until
    x, turns = struck(states, run.t[now])
    assert_near(run.q[now, :3], x, tolerance)
    away = [(Rotation.from_quat(q[3:]).inv() * turn).magnitude() for q, turn in zip(run.q[now], turns, strict=True)]
    assert max(away) < 2 * tolerance


@pytest.mark.parametrize("name", BLOWS)
def test_a_cube_hits_an_edge_with_an_edge(name: str) -> None:
    """One point's impulse with Newton's and Coulomb's law: p = -(1 + e) g' / (n . W n) without friction."""
    start, law = blow(name)
    states = falls_on_edge(start, LOWER, UPPER, MASS, np.full(3, INERTIA), law, 1)
    v = own_velocity(start)
    run = solve(scene(ROOF_X, CUBE, pose(start.x, start.turn), v, law=law), states[1].t + 0.02, samples=200)
    assert_near(times(run, "impact")[:1], [states[1].t], 1e-9)
    assert_moves_as(run, states, 1e-9)
    last = states[1].at(float(run.t[-1]))
    assert_near(run.v[-1], own_velocity(last), 1e-8)


@pytest.mark.slow
def test_an_edge_hits_an_edge_in_a_turned_world_and_with_roles_exchanged() -> None:
    start, law = blow("slips at a slant")
    v = own_velocity(start)
    q = pose(start.x, start.turn)
    plain = solve(scene(ROOF_X, CUBE, q, v, law=law), 0.15)
    for mesh, swapped, world in ((True, False, None), (False, True, None),
                                 (False, False, Rotation.from_euler("xyz", [0.7, -1.2, 2.1])),
                                 (True, True, Rotation.from_euler("xyz", [2.0, 0.4, -0.3]))):  # fmt: skip
        base, ball = (meshed(ROOF_X), meshed(CUBE)) if mesh else (ROOF_X, CUBE)
        run = solve(scene(base, ball, q, v, law=law, swapped=swapped, world=world), 0.15)
        back = Rotation.identity() if world is None else world.inv()
        assert_near(back.apply(run.q[:, :3]), plain.q[:, :3], 1e-9)
        assert_near(run.v, plain.v, 1e-7)
        assert_near(times(run, "impact"), times(plain, "impact"), 1e-9)


def test_a_body_of_three_moments_of_inertia_hits_an_edge_with_an_edge() -> None:
    """It falls without spin; the normal's impulse depends on all of its inertia."""
    moments = (0.004, 0.01, 0.012)
    start, law = blow("at a slant")
    states = falls_on_edge(start, LOWER, UPPER, MASS, np.array(moments), law, 1)
    v = own_velocity(start)
    plain = scene(ROOF_X, CUBE, pose(start.x, start.turn), v, law=law)
    run = solve(tl.Scene(ball_over_ball(moments), plain.q, plain.v, plain.effects), states[1].t + 0.01)
    after, late = states[1], 1e-9
    _, v = run.at(np.array([after.t + late]))
    assert_near(v[0, :3], start.turn.inv().apply(after.v), 2 * G * late)
    assert_near(v[0, 3:], start.turn.inv().apply(after.w), 1e-6)


def test_a_cube_hits_a_free_one_edge_on_edge() -> None:
    """In their middles: each takes its share of the blow, (m_a v_a + m_b v_b) stays."""
    from tests.effects.bodies import free_bodies

    q = np.concatenate([pose([0, 0, 0.0], Rotation.from_euler("x", math.pi / 4)), pose([0, 0, 0.5], ABOUT_Y)])
    v = np.zeros(12)
    v[6:9] = ABOUT_Y.inv().apply([0.0, 0.0, -2.0])
    contact = E.Contact((("a", "b"),), restitution=0.6, shapes={"a": (CUBE,), "b": (CUBE,)})
    run = solve(tl.Scene(free_bodies("a", "b"), q, v, [contact]), 0.5)
    meets = (0.5 - 2 * SIDE * DIAGONAL) / 2.0
    assert_near(times(run, "impact"), [meets], 1e-9)
    late = np.fmax(run.t - meets, 0.0)
    assert_near(run.q[:, 2] + 0.8 * 2.0 * late, 0.0, 1e-9)
    assert_near(run.q[:, 9], 0.5 - 2.0 * run.t + 0.8 * 2.0 * late, 1e-9)
    assert_near(run.q[:, [0, 1, 7, 8]], 0.0, 1e-9)


# --- over the edge of a table -------------------------------------------------------------------------------------

LONG, HIGH = 0.4, 0.1
PLATE = E.Box((LONG, 0.2, HIGH))


PLATES = [(0.0, -0.1, 0.5, 0.42), (0.0, -0.3, 1.0, 0.45), (0.3, -0.1, 1.0, 0.30), (0.3, -0.1, 0.5, 0.4)]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("width", "mu", "s", "ds", "end"),  # the narrow one crosses the edge of the table, the wide one its ends too
    [(0.2, *PLATES[0]), *(pytest.param(width, *plate, marks=pytest.mark.slow) for width in (0.2, 1.4)
                          for plate in PLATES[width < 1.0 :])],
)  # fmt: skip
def test_a_plate_slides_over_the_edge_of_a_table(width: float, mu: float, s: float, ds: float, end: float) -> None:
    """It slides, tips when its middle passes the edge, or mu h before it, slides down about it, and flies."""
    block = Block(MASS, INERTIA, HIGH / 2, mu)
    count = 60
    truth, when = block_over_edge(block, s, ds, end, count)
    plate = E.Box((LONG, width, HIGH))
    run = solve(scene(TABLE, plate, pose([s, 0, HIGH / 2]), [ds, 0, 0, 0, 0, 0], law=(0.0, mu)), end, count / end)
    assert_near(in_plane(run), truth, 1e-9)
    assert when.get("s", 0.0) < LONG / 2
    for name, kind in (("tips", "leave"), ("flies", "leave"), ("stops", "roll")):
        if name in when:
            assert np.abs(times(run, kind) - when[name]).min() < 1e-6
    if "flies" in when:
        assert_near(times(run, "leave").max(), when["flies"], 1e-6)
        assert not np.any(run.contact_forces["ball - base"][-1])


@pytest.mark.slow
def test_a_plate_slides_over_an_edge_in_a_turned_world_as_a_mesh_and_with_roles_exchanged() -> None:
    mu, s, ds, end, count = 0.3, -0.1, 1.0, 0.30, 30
    truth, _ = block_over_edge(Block(MASS, INERTIA, HIGH / 2, mu), s, ds, end, count)
    q, v = pose([s, 0, HIGH / 2]), [ds, 0, 0, 0, 0, 0]
    for mesh, swapped, angles in ((False, True, None), (True, False, None), (False, False, (0.7, -1.2, 2.1)),
                                  (True, True, (0.0, 0.0, 1.0))):  # fmt: skip
        base, ball = (meshed(TABLE), meshed(PLATE)) if mesh else (TABLE, PLATE)
        world = Rotation.from_euler("xyz", angles) if angles else None
        run = solve(scene(base, ball, q, v, law=(0.0, mu), swapped=swapped, world=world), end, count / end)
        x = run.q[:, :3] if world is None else world.inv().apply(run.q[:, :3])
        assert_near(x[:, [0, 2]], truth[:, :2], 1e-9)
        assert_near(x[:, 1], 0.0, 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("share", "mesh"),
    [(0.0, False), (0.49, False),
     *(pytest.param(*case, marks=pytest.mark.slow) for case in ((0.51, False), (0.6, False), (0.0, True), (0.49, True),
                                                                (0.51, True), (0.6, True)))],
)  # fmt: skip
def test_a_cube_that_overhangs_stays_or_tips_over_the_edge(share: float, mesh: bool) -> None:
    """Beyond one half it pivots about the edge, slips where friction ends, and flies off."""
    mu, end, count = 0.6, {0.51: 0.55, 0.6: 0.3}.get(share, 10.0), 40
    s, h = (share - 0.5) * SIDE, SIDE / 2
    ball, base = (meshed(CUBE), meshed(TABLE)) if mesh else (CUBE, TABLE)
    run = solve(scene(base, ball, pose([s, 0, h]), law=(0.0, mu)), end, count / end)
    if share < 0.5:
        assert_near(run.q, pose([s, 0, h]), 1e-12)
        assert_near(run.contact_forces["ball - base"], np.tile([0, 0, MASS * G], (count + 1, 1)), 1e-9)
        return
    truth, when = block_over_edge(Block(MASS, INERTIA, h, mu), s, 0.0, end, count)
    assert "slips" in when
    assert_near(in_plane(run), truth, 1e-9)
    assert np.abs(times(run, "slide") - when["slips"]).min() < 1e-8
    if "flies" in when:
        assert_near(times(run, "leave").max(), when["flies"], 1e-6)


# --- planks across beams ------------------------------------------------------------------------------------------

PLANK = E.Box((1.0, 0.1, 0.04))


def beam(x: float, *, roof: bool) -> E.Box:
    """Along y under z = 0, flat or with an edge up."""
    return (E.Box((SIDE, 0.6, SIDE), (x, 0.0, -SIDE * DIAGONAL), (0.0, math.pi / 4, 0.0)) if roof
            else E.Box((SIDE, 0.6, SIDE), (x, 0.0, -SIDE / 2)))  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(
    ("beams", "mu"), [((0.05,), 0.0), *(pytest.param(x, 0.5, marks=pytest.mark.slow) for x in ((0.05,), (-0.3, 0.4)))]
)
@pytest.mark.parametrize("slant", [0.0, pytest.param(0.3, marks=pytest.mark.slow)])  # of the plank across the beam
def test_a_plank_rests_on_flat_beams(beams: tuple[float, ...], mu: float, slant: float) -> None:
    """Its edges cross those of the beams; nothing creeps, and the beams carry its weight."""
    start = pose([0, 0, 0.02], Rotation.from_euler("z", slant))
    base = tuple(beam(x, roof=False) for x in beams)
    run = solve(scene(base, PLANK, start, law=(0.0, mu)), 10.0, 1)
    assert_near(run.q, start, 1e-11)
    total = sum(run.contact_forces.values())
    assert_near(total, np.tile([0, 0, MASS * G], (len(run.t), 1)), 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("slant", [0.3, pytest.param(0.0, marks=pytest.mark.slow)])
def test_a_plank_rests_on_two_edges_by_its_levers(slant: float) -> None:
    """F_a + F_b = m g and F_a a = F_b b, with the edges at -a and b along the plank."""
    start = pose([0, 0, 0.02], Rotation.from_euler("z", slant))
    run = solve(scene((beam(-0.2, roof=True), beam(0.3, roof=True)), PLANK, start, law=(0.0, 0.5)), 10.0, 1)
    assert_near(run.q, start, 1e-12)
    for pair, share in (("ball - base_0", 0.6), ("ball - base_1", 0.4)):
        assert_near(run.contact_forces[pair][:, 2], share * MASS * G, 1e-9)


@pytest.mark.slow
def test_a_plank_on_one_edge_rocks_about_it() -> None:
    """Held by friction, its middle rolls as its lower side turns on the edge: without slip it is a pendulum's ODE."""
    s, h, mu, end = 0.01, 0.02, 2.0, 0.2
    run = solve(scene(beam(0.0, roof=True), PLANK, pose([s, 0, h]), law=(0.0, mu)), end, 100)
    truth, when = block_over_edge(Block(MASS, INERTIA, h, mu), s, 0.0, end, round(100 * end))
    assert "slips" not in when
    assert truth[-1, 2] < math.pi / 4  # beyond it lies on the other side of the beam's edge
    assert_near(in_plane(run), truth, 1e-9)


@pytest.mark.slow
def test_a_plank_tips_about_a_beams_edge_when_its_load_grows() -> None:
    """P = k t at its end, down: it tips about the beam's edge at b where P (a - b) = m g b."""
    a, b, k = 0.5, SIDE / 2, 20.0
    tips = MASS * G * b / (k * (a - b))
    plain = scene(beam(0.0, roof=False), PLANK, pose([0, 0, 0.02]), law=(0.0, 0.8))
    load = E.FrameWrench("ball", (0.0, 0.0, E.Polynomial((0.0, -k))), point=(a, 0.0, 0.0))
    run = solve(tl.Scene(plain.robot, plain.q, effects=[*plain.effects, load]), tips + 0.05, 200)
    assert_near(times(run, "leave")[:1], [tips], 1e-6)
    still = run.t < tips
    assert_near(run.q[still], plain.q, 1e-12)
    assert_near(run.contact_forces["ball - base"][still, 2], MASS * G + k * run.t[still], 1e-9)
    assert np.ptp(np.hypot(run.q[:, 0] - b, run.q[:, 2])) < 1e-9


# --- a large hull is a plane --------------------------------------------------------------------------------------

OCTAHEDRON = E.Convex(tuple(tuple(0.15 * s * float(k == i) for k in range(3)) for i in range(3) for s in (1, -1)))
TETRAHEDRON = E.Convex(((0.15, 0.15, 0.15), (0.15, -0.15, -0.15), (-0.15, 0.15, -0.15), (-0.15, -0.15, 0.15)))
PRISM = E.Convex(tuple((0.15 * math.cos(a), 0.15 * math.sin(a), z) for a in (0.3, 2.5, 4.4) for z in (-0.1, 0.12)))
BODIES = {"cube": CUBE, "octahedron": OCTAHEDRON, "tetrahedron": TETRAHEDRON, "prism": PRISM}
GROUNDS = {"box": FLOOR, "mesh": meshed(FLOOR), "turned": E.Box((8.0, 8.0, 1.0), (0.0, 0.0, -0.5), (0.0, 0.0, 0.4))}


def on_plane(what: tl.Scene) -> tl.Scene:
    """The scene with the ground as a plane."""
    gravity, old = what.effects
    shapes = {"ball": old.shapes["ball"]}
    contact = E.Contact((("ball", E.Plane()),), old.friction, old.restitution, shapes=shapes)
    return tl.Scene(what.robot, what.q, what.v, [gravity, contact])


def assert_as_on_a_plane(what: tl.Scene, duration: float, tolerance: float = 1e-9) -> tl.Trajectory:
    run = solve(what, duration)
    plane = solve(on_plane(what), duration)
    assert_near(run.q, plane.q, max(tolerance, 2 * float((run.error + plane.error).max())))
    assert float((run.error + plane.error).max()) < 1e-8
    assert kinds(run) == kinds(plane)
    assert len(run.contact_forces) == len(plane.contact_forces)
    for here, there in zip(run.contact_forces.values(), plane.contact_forces.values(), strict=True):
        assert_near(here, there, 1e-5 * (1.0 + np.abs(there).max()))
    return run


@pytest.mark.some(1)
@pytest.mark.parametrize(
    ("name", "ground"),
    [pytest.param(name, ground, marks=[pytest.mark.slow] if (i + k) % len(GROUNDS) else [])
     for i, name in enumerate(BODIES) for k, ground in enumerate(GROUNDS)],
)  # fmt: skip
def test_a_body_tumbles_on_a_large_hull_as_on_a_plane(name: str, ground: str) -> None:
    random = np.random.default_rng([0, list(BODIES).index(name)])
    start = pose([0.2, 0.1, 0.35], Rotation.random(random_state=int(random.integers(99))))
    what = scene(GROUNDS[ground], BODIES[name], start, random.uniform(-1, 1, 6) * ([1] * 3 + [4] * 3), law=(0.5, 0.3))
    run = assert_as_on_a_plane(what, 0.2 if name == "tetrahedron" else 0.4)
    assert len(times(run, "impact")) >= 2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("e", "mu"), [(0.0, 0.0), (0.5, 0.0), pytest.param(0.0, 0.4, marks=pytest.mark.slow), (0.4, 0.4)]
)
def test_a_cube_falls_on_a_box_with_an_edge_first(e: float, mu: float) -> None:
    """Two corners hit at once; then it rocks."""
    start = pose([0, 0, 0.25], Rotation.from_euler("y", 0.4))
    assert_as_on_a_plane(scene(FLOOR, CUBE, start, law=(e, mu)), 0.35)


@pytest.mark.slow
def test_a_cube_falls_flat_on_a_box_and_rests() -> None:
    what = scene(FLOOR, CUBE, pose([0, 0, 0.2]), [0.3, 0.1, 0, 0, 0, 0], law=(0.5, 0.3))
    run = assert_as_on_a_plane(what, 0.8, 1e-6)
    assert_near(run.v[-1], 0.0, 1e-9)
    assert_near(run.contact_forces["ball - base"][-1, 2], MASS * G, 1e-9)
