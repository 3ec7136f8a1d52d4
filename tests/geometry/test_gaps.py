"""Gaps as formulas against Coal's distances, their rates against differences; which pairs may touch."""

import math

import coal
import numpy as np
import pinocchio as pin
import pytest

import twolink as tl
from tests.effects.bodies import free_bodies
from tests.refusals import refusal
from tests.urdf_text import joint, link
from twolink.algorithms.mechanism import mechanism
from twolink.algorithms.motion import KinematicState
from twolink.algorithms.namespaces import Numbers
from twolink.effects.contact_pairs import select_pairs, solids_of
from twolink.geometry.features import HullFeatures
from twolink.geometry.gaps import Gap, StandGap
from twolink.geometry.pairs import Plane, gaps_of
from twolink.robots.collisions import collision_model

E = tl.effects
TURNED = {"point": (0.02, -0.05, 0.03), "rpy": (0.3, -0.7, 1.1)}
CUBE = tuple((float(x), float(y), float(z)) for x in (-0.1, 0.1) for y in (-0.2, 0.2) for z in (-0.3, 0.3))
STONE = ((0.1, 0.0, 0.3), (-0.2, 0.1, 0.1), (0.0, -0.3, -0.2), (0.2, 0.2, -0.1), (-0.1, 0.3, -0.3), (0.3, -0.1, 0.1),
         (-0.2, -0.2, 0.2))  # fmt: skip
SHAPES = {
    "sphere": E.Sphere(0.1, (0.02, -0.05, 0.03)),
    "box": E.Box((0.2, 0.4, 0.6), **TURNED),
    "cylinder": E.Cylinder(0.15, 0.5, **TURNED),
    "capsule": E.Capsule(0.1, 0.5, **TURNED),
    "convex": E.Convex(CUBE, **TURNED),
    "stone": E.Convex(STONE, **TURNED),
}
PAIRS = [("sphere", "sphere"), ("sphere", "capsule"), ("capsule", "sphere"), ("capsule", "capsule"), ("sphere", "box"),
         ("capsule", "box"), ("sphere", "convex"), ("sphere", "stone"), ("capsule", "stone"),
         ("cylinder", "sphere"), *((name, "plane") for name in SHAPES)]  # fmt: skip


def states(robot: tl.Robot, seed: int):
    """Random states whose bodies are a few tenths of a metre apart."""
    random = np.random.default_rng(seed)
    for _ in range(40):
        q = pin.integrate(robot.model, robot.neutral, random.uniform(-1, 1, robot.nv) * (2 * ([0.7] * 3 + [2.0] * 3)))
        yield robot.normalize(q), random.uniform(-1, 1, robot.nv)


def motion(robot: tl.Robot, q: np.ndarray, v: np.ndarray) -> KinematicState:
    return KinematicState(robot.model, mechanism(robot.model), list(q), list(v), 0.0, Numbers)


def distance(robot: tl.Robot, shapes: dict, q: np.ndarray, plane: Plane | None) -> float:
    """Coal's distance."""
    model = collision_model(robot.model, solids_of(robot, shapes))
    data, places = robot.model.createData(), model.createData()
    pin.updateGeometryPlacements(robot.model, data, model, places, q)
    bodies = [(o.geometry, coal.Transform3s(p.rotation, p.translation))
              for o, p in zip(model.geometryObjects, places.oMg, strict=True)]  # fmt: skip
    if plane is not None:
        half = coal.Halfspace(np.array(plane.normal) / np.linalg.norm(plane.normal), plane.height)
        bodies = [bodies[0], (half, coal.Transform3s.Identity())]
    (a, p), (b, r) = bodies
    return float(coal.distance(a, p, b, r, coal.DistanceRequest(), coal.DistanceResult()))


@pytest.mark.some(5)
@pytest.mark.parametrize("kinds", PAIRS, ids=lambda kinds: "-".join(kinds))
def test_gaps_are_coals_distances_and_their_rates_those_of_the_nearest_points(kinds: tuple[str, str]) -> None:
    robot, plane = free_bodies("a", "b"), None
    shapes = {"a": (SHAPES[kinds[0]],)}
    if kinds[1] == "plane":
        plane = Plane((0.3, -0.2, 1.0), -1.0)
    else:
        shapes["b"] = (SHAPES[kinds[1]],)
    (pair,) = select_pairs(robot, solids_of(robot, shapes), [("a", plane or "b")]).chosen
    gaps, compared = [gap for gap in gaps_of(pair) if not isinstance(gap, StandGap)], 0  # those are for flat discs
    for q, v in states(robot, 4):
        true = distance(robot, shapes, q, plane)
        if true < 1e-3:
            continue
        compared += 1
        here = [gap.value(motion(robot, q, v)) for gap in gaps]
        assert min(here) == pytest.approx(true, abs=2e-7)  # Coal's own accuracy of curved shapes
        for gap in gaps:
            assert_that_it_moves_as_its_points(robot, gap, q, v)
    assert compared > 10


def assert_that_it_moves_as_its_points(robot: tl.Robot, gap: Gap, q: np.ndarray, v: np.ndarray) -> None:
    """Its rate is that of its value, its axes are orthonormal, its points as far apart and as fast as it says."""
    here, step = motion(robot, q, v), 1e-6
    beside = [gap.value(motion(robot, pin.integrate(robot.model, q, s * step * v), v)) for s in (1, -1)]
    rate, *slip = gap.velocity(here)
    assert rate == pytest.approx((beside[0] - beside[1]) / (2 * step), abs=1e-8)
    near = gap.nearest(here)
    axes = np.array(near.axes)
    assert axes @ axes.T == pytest.approx(np.eye(3), abs=1e-12)
    if near.second.frame != "universe":
        line = np.subtract(near.first.position(here), near.second.position(here))
        assert line == pytest.approx(gap.value(here) * axes[0], abs=1e-12)
    moved = np.subtract(near.first.velocity(here), near.second.velocity(here))
    assert axes @ moved == pytest.approx([rate, *slip], abs=1e-12)


@pytest.mark.parametrize("kinds", [("box", "box"), ("stone", "box"), ("stone", "stone")], ids="-".join)
def test_features_of_hulls_are_apart_where_coal_says_so(kinds: tuple[str, str]) -> None:
    """The smallest gap is the distance where a corner over a face or two edges are nearest, and never below it."""
    robot, equal, overlaps = free_bodies("a", "b"), 0, 0
    shapes = {name: (SHAPES[kind],) for name, kind in zip("ab", kinds, strict=True)}
    (pair,) = select_pairs(robot, solids_of(robot, shapes), [("a", "b")]).chosen
    features = HullFeatures(pair.first, pair.second)
    for q, v in states(robot, 5):
        here = motion(robot, q, v)
        gap, apart, true = features.gaps(here).item(), features.separation(here), distance(robot, shapes, q, None)
        overlaps += true < 0.0
        if true < 0.0:  # along the best of these directions they overlap least
            assert gap == pytest.approx(apart, abs=1e-15)  # computed along the best axis alone
            assert apart == pytest.approx(true, abs=1e-6)
        else:
            assert apart <= true + 1e-9 <= gap + 2e-9
            equal += abs(gap - true) < 1e-9
    assert equal > 5
    assert overlaps > 3


def test_formulas_of_features_have_the_rates_of_their_points() -> None:
    robot = free_bodies("a", "b")
    shapes = dict.fromkeys("ab", (SHAPES["stone"],))
    (pair,) = select_pairs(robot, solids_of(robot, shapes), [("a", "b")]).chosen
    features, kinds = HullFeatures(pair.first, pair.second), set[tuple[str, bool]]()
    for q, v in states(robot, 5):
        here = motion(robot, q, v)
        for one in (one for group in features.touching(here, 0.1) for one in group):
            gap = one.gap
            kinds.add((type(gap).__name__, getattr(gap, "second", False) is True))
            assert_that_it_moves_as_its_points(robot, gap, q, v)
    assert kinds == {("FaceGap", False), ("FaceGap", True), ("EdgeGap", False)}


def chain(radii: list[float]) -> tl.Robot:
    """Links l0, l1, ... 1 m apart along x on hinges, each with a sphere."""
    parts = [link(f"l{k}", 1.0, 0.1, more=f'<collision><geometry><sphere radius="{r}"/></geometry></collision>')
             for k, r in enumerate(radii)]  # fmt: skip
    parts += [joint(f"j{k}", "revolute", f"l{k - 1}", f"l{k}", "0 1 0", more='<origin xyz="1 0 0"/>')
              for k in range(1, len(radii))]  # fmt: skip
    return tl.load_robot(f'<robot name="chain">{"".join(parts)}</robot>', root="free")


def test_self_leaves_out_adjacent_links_and_those_that_overlap_at_rest() -> None:
    robot = chain([0.3, 0.3, 1.8, 0.3])
    pairs = select_pairs(robot, solids_of(robot, {}), ["self"])
    assert {pair.name for pair in pairs.chosen} == {"l0 - l3", "l1 - l3"}
    assert dict(pairs.excluded) == {"l0 - l1": "adjacent", "l1 - l2": "adjacent", "l2 - l3": "adjacent",
                                    "l0 - l2": "overlap at rest"}  # fmt: skip
    scene = tl.Scene(robot, [0, 0, 5, 0, 0, 0, 1, 0, 0, 0], effects=[E.Contact(("self", "ground"))])
    explained = str(tl.explain(scene, duration=0.01))
    assert "6 pairs may touch: l0 - l3, l1 - l3, l0 - ground" in explained
    assert "1 pair left out (overlap at rest): l0 - l2" in explained


def test_self_leaves_out_those_within_a_margin_at_rest() -> None:
    robot = chain([0.3, 0.3, 0.4, 0.3])  # l0 and l2 are 1.3 m apart, l1 and l3 1.4 m, l0 and l3 2.4 m
    for margin, left in ((1.2, {"l0 - l2", "l1 - l3", "l0 - l3"}), (1.35, {"l1 - l3", "l0 - l3"}), (1.5, {"l0 - l3"})):
        pairs = E.Contact("self", margin=margin).selected(robot)
        assert {pair.name for pair in pairs.chosen} == left
        assert [why for _, why in pairs.excluded].count(f"within {margin:g} m at rest") == 3 - len(left)


def test_free_bodies_may_touch_though_their_neutral_places_overlap() -> None:
    robot = free_bodies("a", "b")
    shapes = {"a": (E.Sphere(0.1), E.Sphere(0.1, (1.0, 0.0, 0.0))), "b": (E.Sphere(0.1),)}
    pairs = select_pairs(robot, solids_of(robot, shapes), ["self"])
    assert [pair.name for pair in pairs.chosen] == ["a_0 - b", "a_1 - b"]
    assert not pairs.excluded


def test_the_shapes_of_a_urdf_are_read_with_their_places() -> None:
    origin = '<origin xyz="0.1 0.2 0.3" rpy="0.4 0.5 0.6"/>'
    shapes = ['<sphere radius="0.1"/>', '<box size="0.1 0.2 0.3"/>', '<cylinder radius="0.1" length="0.4"/>',
              '<capsule radius="0.1" length="0.4"/>']  # fmt: skip
    names = ["", ' name="foot"', "", ""]
    collisions = "".join(f"<collision{name}>{origin}<geometry>{shape}</geometry></collision>"
                         for name, shape in zip(names, shapes, strict=True))  # fmt: skip
    robot = tl.load_robot(f'<robot name="r" version="1.2">{link("l", more=collisions)}</robot>', root="free")
    assert [solid.name for solid in robot.solids] == ["l_0", "foot", "l_2", "l_3"]
    place = {"point": (0.1, 0.2, 0.3), "rpy": (0.4, 0.5, 0.6)}
    assert [solid.shape for solid in robot.solids] == [
        E.Sphere(0.1, place["point"]), E.Box((0.1, 0.2, 0.3), **place), E.Cylinder(0.1, 0.4, **place),
        E.Capsule(0.1, 0.4, **place)]  # fmt: skip


def test_a_mesh_is_its_convex_hull(tmp_path) -> None:
    corners = [f"v {x} {y} {z}" for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    inside = ["v 0.5 0.5 0.5"]
    faces = ["f 1 2 3", "f 2 3 4", "f 5 6 7", "f 6 7 8", "f 1 5 9"]
    (tmp_path / "cube.obj").write_text("\n".join(corners + inside + faces))
    mesh = '<collision><geometry><mesh filename="cube.obj" scale="1 2 3"/></geometry></collision>'
    path = tmp_path / "r.urdf"
    path.write_text(f'<robot name="r">{link("l", more=mesh)}</robot>')
    (solid,) = tl.load_robot(path, root="free").solids
    assert sorted(solid.shape.vertices) == sorted((x, 2 * y, 3 * z) for x in (0, 1) for y in (0, 1) for z in (0, 1))
    path.write_text(f'<robot name="r">{link("l", more=mesh.replace("cube", "other"))}</robot>')
    robot = tl.load_robot(path, root="free")
    with pytest.raises(tl.errors.RobotError, match=r"other\.obj"):
        _ = robot.solids


def test_a_saved_scene_keeps_its_shapes(tmp_path) -> None:
    robot = chain([0.3, 0.2])
    effect = E.Contact((("l1", "ground"), ("l0", E.Plane((1.0, 0.0, 0.0), -2.0))), friction=0.5,
                       shapes={"l0": (E.Box((0.1, 0.2, 0.3)),)})  # fmt: skip
    scene = tl.load_scene(tl.Scene(robot, effects=[effect]).save(tmp_path / "scene.toml"))
    assert scene.effects == (effect,)
    assert scene.robot.solids == robot.solids


BAD = [
    (E.Contact(("foot",)), "pairs[0]", "expected two bodies"),
    (E.Contact((("l5", "ground"),)), "pairs[0][0]", "did you mean 'l"),
    (E.Contact((("l0", "l0"),)), "pairs[0]", "do not move against each other"),
    (E.Contact((("ground", E.Plane()),)), "pairs[0]", "two planes"),
    (E.Contact(friction=-1.0), "friction", "at least 0"),
    (E.Contact(restitution=2.0), "restitution", "from 0 to 1"),
    (E.Contact(shapes={"l9": (E.Sphere(0.1),)}), "shapes.l9", "l"),
]


@pytest.mark.parametrize(("effect", "where", "part"), BAD)
def test_contacts_that_are_refused(effect: object, where: str, part: str) -> None:
    with refusal(tl.errors.SceneError, part, where=f"effects[0].{where}"):
        tl.Scene(chain([0.3, 0.3]), effects=[effect])


def test_a_robot_without_shapes_is_refused() -> None:
    with pytest.raises(tl.errors.SceneError, match="no link of the robot has a collision shape"):
        tl.Scene(free_bodies("a"), effects=[E.Contact()])


def test_a_pair_without_a_formula_is_named() -> None:
    shapes = {"a": (E.Box((1.0, 1.0, 1.0)),), "b": (E.Cylinder(0.1, 0.2),)}
    scene = tl.Scene(free_bodies("a", "b"), effects=[E.Contact(("self",), shapes=shapes)])
    with pytest.raises(tl.errors.SceneError, match="a - b cannot be located: there is no formula for box and cylinder"):
        tl.simulate(scene, 0.1, contact="located")


def test_a_mesh_of_many_faces_has_no_formula() -> None:
    cloud = np.random.default_rng(0).normal(size=(60, 3))
    stone = E.Convex(tuple(tuple(map(float, p / np.linalg.norm(p))) for p in cloud))
    scene = tl.Scene(free_bodies("a", "b"), [0, 0, 3, 0, 0, 0, 1] + [0] * 6 + [1],
                     effects=[E.Contact(("self",), shapes={"a": (stone,), "b": (E.Sphere(0.1),)})])  # fmt: skip
    assert "contacts are stepped" in str(tl.explain(scene, duration=0.01))
    with refusal(tl.errors.SceneError, "there is none for meshes of more than 40 faces", 'contact="stepped"'):
        tl.simulate(scene, 0.1, contact="located")


def test_a_flat_disc_touches_with_points_and_a_tilted_one_with_its_rim() -> None:
    robot = free_bodies("a")
    (pair,) = select_pairs(robot, solids_of(robot, {"a": (E.Cylinder(0.2, 0.6),)}), ["ground"]).chosen
    for tilt, stands in ((0.0, True), (1e-10, True), (1e-8, False), (0.3, False)):
        q = np.array([0, 0, 0.5, math.sin(tilt / 2), 0, 0, math.cos(tilt / 2)])
        here = motion(robot, q, np.zeros(6))
        low = [gap for gap in gaps_of(pair) if gap.value(here) < 0.5]
        assert {isinstance(gap, StandGap) for gap in low} == {stands}
        assert min(gap.value(here) for gap in low) == pytest.approx(
            0.5 - 0.3 * math.cos(tilt) - 0.2 * math.sin(tilt), abs=1e-8)  # fmt: skip
