"""Height fields: bodies rest on flat ones, slopes and ridges where planes say, and roll as on an incline."""

import itertools
import math

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import brentq

import twolink as tl
from tests.effects.bodies import ball, free_bodies
from tests.refusals import refusal
from twolink.geometry.distance import distance
from twolink.geometry.fields import surface_of
from twolink.geometry.on_fields import FieldBody

E = tl.effects
FLAT = E.HeightField(np.full((6, 6), 0.2), (0.1, 0.15), (-0.25, -0.4, 0.0))
VALLEY = E.HeightField(((0.5, 0.5), (0.0, 0.0), (0.5, 0.5)), (0.5, 1.0), (-0.5, -0.5, 0.0))
RIDGES = E.HeightField(np.array([[0.0, 0.1, 0.0, 0.1, 0.0]] * 3).T, (0.1, 0.4), (-0.2, -0.4, 0.0))
PEAKS = E.HeightField(np.pad([[0.1, 0.0, 0.1], [0.0, 0.0, 0.0], [0.1, 0.0, 0.1]], 2), (0.1, 0.1), (-0.3, -0.3, 0.0))


def run_of(
    shape: object, field: object, start: list[float], seconds: float, friction: float = 0.5, step: float = 1e-3, **more
):
    """A body of 1 kg over a field."""
    robot = free_bodies("a")
    contact = E.Contact((("a", field),), friction=friction, shapes={"a": (shape,)})
    scene = tl.Scene(robot, [*start[:3], *(start[3:] or [0, 0, 0, 1])], effects=[E.Gravity(), contact], **more)
    return tl.simulate(scene, seconds, contact="stepped", samples_per_second=50.0, step=step, verify=False)


CUBE = tuple((x, y, z) for x in (-0.1, 0.1) for y in (-0.1, 0.1) for z in (-0.1, 0.1))
SHAPES = {"sphere": E.Sphere(0.1), "capsule": E.Capsule(0.1, 0.3, rpy=(math.pi / 2, 0.0, 0.0)),
          "box": E.Box((0.3, 0.2, 0.2)), "hull": E.Convex(CUBE),
          "lying": E.Cylinder(0.1, 0.3, rpy=(math.pi / 2, 0.0, 0.0)), "cylinder": E.Cylinder(0.12, 0.2)}  # fmt: skip
MOVED = (
    "box",
    "lying",
    "capsule",
    "sphere",
    "hull",
    "cylinder",
)  # of the quick ones, one has corners, the other touches at two points


@pytest.mark.some(2)
@pytest.mark.parametrize("kind", MOVED)
def test_bodies_fall_and_rest_on_a_flat_field_as_on_a_plane(kind: str) -> None:
    runs = [
        run_of(SHAPES[kind], ground, [0.013, 0.021, 0.31], 0.4, step=2e-3) for ground in (FLAT, E.Plane(height=0.2))
    ]
    on_field, on_plane = (run.q[-1] for run in runs)
    assert on_field == pytest.approx(on_plane, abs=1e-9)
    assert on_field[2] == pytest.approx(0.3, abs=1e-6)


def test_a_box_slides_and_a_ball_rolls_over_the_edges_of_a_flat_field_as_on_a_plane() -> None:
    for shape in (E.Sphere(0.1), E.Box((0.3, 0.2, 0.2))):
        start = {"v": [1.0, 0.3, 0.0, 0.0, 0.0, 0.0]}
        field = E.HeightField(np.full((40, 40), 0.2), (0.05, 0.07), (-1.0, -1.4, 0.0))
        over, level = (
            run_of(shape, ground, [-0.5, 0.0, 0.3], 0.5, 0.2, 2e-3, **start) for ground in (field, E.Plane(height=0.2))
        )
        assert over.q == pytest.approx(level.q, abs=1e-7)


@pytest.mark.parametrize(("shape", "moments", "share", "options", "within"), [
    (E.Sphere(0.1), 0.004, 5.0 / 7.0, {}, 1e-4),
    (E.Cylinder(0.1, 0.2, rpy=(math.pi / 2, 0.0, 0.0)), (0.0075, 0.005, 0.0075), 2.0 / 3.0, {"step": 2e-3}, 1e-3),
])  # fmt: skip
def test_what_is_round_rolls_down_a_slope_by_its_share_of_g_sin_a(
    shape: object, moments: float | tuple[float, ...], share: float, options: dict[str, float], within: float
) -> None:
    slope = 0.2
    field = E.HeightField(np.outer(-slope * 0.1 * np.arange(30), np.ones(6)), (0.1, 0.1), (0.0, -0.25, 0.0))
    angle = math.atan(slope)
    place = np.array([0.33, 0.01, -slope * 0.33]) + 0.1 * np.array([math.sin(angle), 0.0, math.cos(angle)])
    effects = [E.Gravity(), E.Contact((("ball", field),), friction=0.9, shapes={"ball": (shape,)})]
    run = tl.simulate(tl.Scene(ball(1.0, moments), [*place, 0, 0, 0, 1], effects=effects), 1.0, contact="stepped",
                      samples_per_second=20.0, verify=False, **options)  # fmt: skip
    way = np.linalg.norm(run.q[:, :3] - place, axis=1)
    assert way == pytest.approx(0.5 * share * 9.81 * math.sin(angle) * run.t**2, abs=within)


def test_a_ball_lies_in_a_valley_and_a_box_on_two_ridges_and_on_peaks() -> None:
    run = run_of(E.Sphere(0.1), VALLEY, [0.0, 0.07, 0.1 * math.sqrt(2.0) + 0.01], 0.3)
    assert run.q[-1, :3] == pytest.approx([0.0, 0.07, 0.1 * math.sqrt(2.0)], abs=1e-6)
    for shape, step in itertools.product(
        (E.Box((0.3, 0.2, 0.2)), E.Convex(tuple((1.5 * x, y, z) for x, y, z in CUBE))), (3e-3, 1.5e-3, 7e-4)
    ):
        run = run_of(shape, RIDGES, [0.0, 0.0, 0.21], 0.3, step=step)
        assert run.q[-1] == pytest.approx([0.0, 0.0, 0.2, 0.0, 0.0, 0.0, 1.0], abs=1e-6)
    run = run_of(E.Capsule(0.05, 0.4, rpy=(0.0, math.pi / 2, 0.0)), RIDGES, [0.0, 0.0, 0.16], 0.3)
    assert run.q[-1, 2] == pytest.approx(0.15, abs=1e-6)
    run = run_of(E.Box((0.4, 0.4, 0.1)), PEAKS, [0.01, 0.0, 0.16], 0.3)
    assert run.q[-1, 2] == pytest.approx(0.15, abs=1e-6)


@pytest.mark.some(1)
@pytest.mark.parametrize("kind", MOVED)
def test_no_body_that_tumbles_over_rough_ground_gains_energy(kind: str) -> None:
    random = np.random.default_rng(1)
    gentle = ((0.0, 2e-3, 0.1), (0.3, 1e-3, 0.1), (0.8, 5e-4, 0.1))
    for friction, step, steep in (*gentle, (0.3, 1e-3, 0.6), (0.8, 1e-3, 0.6)):
        field = E.HeightField(random.uniform(0.0, steep, (21, 21)), (0.1, 0.12), (-1.0, -1.2, 0.0))
        turn = random.normal(size=4)
        start = [*random.uniform(-0.2, 0.2, 2), steep + 0.25, *(turn / np.linalg.norm(turn))]
        run = run_of(SHAPES[kind], field, start, 0.5, friction, step, v=random.normal(size=6))
        assert (run.energy - np.minimum.accumulate(run.energy)).max() < 1e-3  # J, of 1 kg
        assert run.q[:, 2].min() > 0.0


def thrown(kind: str, seed: int, high: float, seconds: float) -> tl.Trajectory:
    """A body that falls on random ground up to a height."""
    random = np.random.default_rng([seed, 5])
    field = E.HeightField(random.uniform(0.0, high, (21, 21)), (0.1, 0.12), (-1.0, -1.2, 0.0))
    turn = random.normal(size=4)
    start = [*random.uniform(-0.2, 0.2, 2), high + 0.25, *(turn / np.linalg.norm(turn))]
    return run_of(SHAPES[kind], field, start, seconds, 0.3, v=random.normal(size=6))


def test_a_peak_that_comes_below_a_face_from_beside_it_is_seen() -> None:
    assert thrown("box", 4, 0.3, 0.6).contact_record["overlap"] < 1e-5  # m; it was 1.5e-4


def test_a_capsule_that_rolls_from_its_end_onto_its_side_gains_no_energy() -> None:
    """On an edge the end and the side would be two points with nearly one normal, whose gaps cannot both be kept."""
    run = thrown("capsule", 13, 0.1, 0.46)
    assert (run.energy - np.minimum.accumulate(run.energy)).max() < 1e-4  # J; it was 0.028


@pytest.mark.parametrize("steep", [0.1, 0.6])
@pytest.mark.parametrize("kind", SHAPES)
def test_on_rough_ground_bodies_touch_where_coal_says(kind: str, steep: float) -> None:
    """20 random placements 10 um above the triangles or 1 um in them: the gap by Coal, which grows along the normal."""
    random = np.random.default_rng(3)
    field = E.HeightField(random.uniform(0.0, steep, (9, 9)), (0.1, 0.12), (-0.4, -0.48, 0.0))
    surface, solid, body = surface_of(field), SHAPES[kind].coal(), FieldBody(SHAPES[kind])
    prisms = [E.Convex((*map(tuple, top.tolist()), *((x, y, -1.0) for x, y, _ in top.tolist()))).coal()
              for top in surface.triangles.reshape(-1, 3, 3)]  # fmt: skip

    def apart(turn: np.ndarray, place: np.ndarray) -> float:
        return min(distance((solid, turn, place), (prism, np.eye(3), np.zeros(3)))[0] for prism in prisms)

    def missed(height: float, turn: np.ndarray, x: float, y: float, gap: float) -> float:
        return apart(turn, np.array([x, y, height])) - gap

    for gap in [1e-5, -1e-6] * 10:
        turn, (x, y) = pin.Quaternion(*random.normal(size=4)).normalized().matrix(), random.uniform(-0.15, 0.15, 2)
        place = np.array([x, y, brentq(missed, 0.0, 2.0, (turn, x, y, gap), xtol=1e-12)])
        least = min(body.touches(surface, turn, place, 1e-4), key=lambda touch: touch.gap)
        assert least.gap == pytest.approx(gap, abs=1e-7)
        assert apart(turn, place + (2e-5 - gap) * least.normal) == pytest.approx(2e-5, abs=1e-6)


@pytest.mark.parametrize("kind", SHAPES)
def test_points_keep_their_names_when_more_are_within_reach(kind: str) -> None:
    """Else the memory of one is taken for that of another one, at which forces then act at a distance."""
    random = np.random.default_rng(4)
    surface = surface_of(E.HeightField(random.uniform(0.0, 0.3, (9, 9)), (0.1, 0.12), (-0.4, -0.48, 0.0)))
    body = FieldBody(SHAPES[kind])
    for _ in range(8):
        turn, height = pin.Quaternion(*random.normal(size=4)).normalized().matrix(), 0.2
        while any(touch.gap < -5e-3 for touch in body.touches(surface, turn, np.array([0.0, 0.0, height]), 0.0)):
            height += 5e-3
        few, many = (body.touches(surface, turn, np.array([0.0, 0.0, height]), reach) for reach in (0.02, 0.06))
        named = {touch.name: touch.normal for touch in many}
        assert len(named) == len(many)
        for touch in few:
            assert named[touch.name] == pytest.approx(touch.normal, abs=1e-12)


@pytest.mark.parametrize(("field", "where", "part"), [
    (E.HeightField(((0.0, 1.0),)), "heights", "at least 2 x 2"),
    (E.HeightField(((0.0, 1.0), (0.0,))), "heights", "rows of one length"),
    (E.HeightField(((0.0, 1.0), (0.0, math.nan))), "heights", "finite"),
    (E.HeightField(((0.0, 1.0), (0.0, 0.0)), (0.0, 1.0)), "cell", "above 0"),
])  # fmt: skip
def test_fields_that_are_refused(field: object, where: str, part: str) -> None:
    with refusal(tl.errors.SceneError, part, where=f"effects[0].pairs[0][1].{where}"):
        tl.Scene(free_bodies("a"), effects=[E.Contact((("a", field),), shapes={"a": (E.Sphere(0.1),)})])


def test_a_cylinder_stands_on_peaks_and_ridges_and_lies_in_a_valley() -> None:
    run = run_of(E.Cylinder(0.2, 0.1), PEAKS, [0.01, 0.0, 0.16], 0.3)
    assert run.q[-1] == pytest.approx([0.01, 0.0, 0.15, 0.0, 0.0, 0.0, 1.0], abs=1e-6)
    run = run_of(E.Cylinder(0.15, 0.1), RIDGES, [0.0, 0.0, 0.16], 0.3)
    assert run.q[-1] == pytest.approx([0.0, 0.0, 0.15, 0.0, 0.0, 0.0, 1.0], abs=1e-6)
    run = run_of(SHAPES["lying"], VALLEY, [0.0, 0.07, 0.1 * math.sqrt(2.0) + 0.01], 0.3)
    assert run.q[-1, :3] == pytest.approx([0.0, 0.07, 0.1 * math.sqrt(2.0)], abs=1e-6)


@pytest.mark.parametrize("shape", [E.Box((0.6, 0.5, 0.1)), E.Cylinder(0.3, 0.1)])
def test_what_is_wider_than_a_field_rests_on_its_border(shape: object) -> None:
    run = run_of(shape, E.HeightField(np.full((3, 3), 0.2), (0.1, 0.1), (-0.1, -0.1, 0.0)), [0.01, 0.02, 0.26], 0.2)
    assert run.q[-1, 2:] == pytest.approx([0.25, 0.0, 0.0, 0.0, 1.0], abs=1e-6)


def test_located_contacts_on_fields_are_refused_by_name() -> None:
    scene = tl.Scene(free_bodies("a"), [0, 0, 1, 0, 0, 0, 1],
                     effects=[E.Contact((("a", FLAT),), shapes={"a": (E.Sphere(0.1),)})])  # fmt: skip
    with pytest.raises(tl.errors.SceneError, match="none for height fields"):
        tl.simulate(scene, 0.1, contact="located")


def test_a_saved_scene_keeps_its_field(tmp_path) -> None:
    robot = free_bodies("a")
    scene = tl.Scene(robot, [0, 0, 1, 0, 0, 0, 1],
                     effects=[E.Contact((("a", FLAT),), shapes={"a": (E.Sphere(0.1),)})])  # fmt: skip
    assert tl.load_scene(scene.save(tmp_path / "scene.toml")).effects == scene.effects
    assert "contacts are stepped" in (text := str(tl.explain(scene, duration=0.01)))
    assert "a - field" in text
