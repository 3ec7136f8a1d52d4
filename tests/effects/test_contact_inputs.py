"""What Contact reads, refuses and says: shapes and planes that are given, and odd <collision> elements."""

import math
from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.effects.bodies import above, free_bodies, stepped
from tests.effects.cases import assert_refused
from tests.near import assert_near
from tests.urdf_text import joint, link

E = tl.effects
BALL = {"a": (E.Sphere(0.1),)}
# Two walls, whose convex hull is a box of 2 m.
WALLS = [(low, high) for low, high in (((-1, -1, -1), (-0.5, 1, 1)), ((0.5, -1, -1), (1, 1, 1)))]
SIDES = [(1, 2, 4, 3), (5, 6, 8, 7), (1, 2, 6, 5), (3, 4, 8, 7), (1, 3, 7, 5), (2, 4, 8, 6)]

BAD = [
    ({"shapes": {"a": E.Sphere(0.1)}}, "shapes.a", "expected a list"),
    ({"shapes": {"a": ("sphere",)}}, "shapes.a[0]", "expected one of Sphere"),
    ({"shapes": {"a": (E.Sphere(-0.1),)}}, "shapes.a[0].radius", "at least 0, got -0.1"),
    ({"shapes": {"a": (E.Box((0.1, -0.1, 0.1)),)}}, "shapes.a[0].size[1]", "at least 0, got -0.1"),
    ({"shapes": {"a": (E.Box((0.1, 0.1)),)}}, "shapes.a[0].size", "expected three"),
    ({"shapes": {"a": (E.Capsule(0.1, math.inf),)}}, "shapes.a[0].length", "got inf"),
    ({"shapes": {"a": (E.Cylinder(0.1, 0.2, rpy=(math.nan, 0, 0)),)}}, "shapes.a[0].rpy", "finite"),
    ({"shapes": {"a": (E.Convex(((0, 0, 0), (math.nan, 0, 0))),)}}, "shapes.a[0].vertices[1]", "finite"),
    ({"shapes": {"a": (E.Convex(()),)}}, "shapes.a[0].vertices", "no vertices"),
    ({"pairs": (("a", E.Plane((0, 0, 0))),), "shapes": BALL}, "pairs[0][1].normal", "its length is 0"),
    ({"pairs": (("a", E.Plane((0, 1))),), "shapes": BALL}, "pairs[0][1].normal", "expected three"),
    ({"pairs": (("a", E.Plane(height="low")),), "shapes": BALL}, "pairs[0][1].height", "got 'low'"),
    ({"pairs": (("a", 3),), "shapes": BALL}, "pairs[0][1]", "expected the name of a body"),
    ({"pairs": 3, "shapes": BALL}, "pairs", "expected pairs of bodies"),
    ({"pairs": (), "shapes": BALL}, "pairs", "no two bodies may touch"),
    ({"pairs": "self", "shapes": BALL}, "pairs", "no two bodies may touch"),
]


@pytest.mark.parametrize(("fields", "where", "part"), BAD)
def test_shapes_and_pairs_that_are_refused(fields: dict, where: str, part: str) -> None:
    assert_refused(free_bodies("a"), E.Contact(**{"pairs": "ground", **fields}), where, part)


def test_points_that_span_no_volume_touch_planes_alone() -> None:
    triangle = (E.Convex(((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))),)
    with pytest.raises(tl.errors.SceneError, match="3 vertices span no volume"):
        tl.explain(tl.Scene(free_bodies("a", "b"), above(3) + [0] * 6 + [1],
                            effects=[E.Contact("self", shapes={"a": triangle, "b": BALL["a"]})]),
                   duration=0.01)  # fmt: skip


def body(tmp_path: Path, *collisions: str) -> tl.Robot:
    path = tmp_path / "r.urdf"
    path.write_text(f'<robot name="r">{link("l", more="".join(collisions))}</robot>')
    return tl.load_robot(path, root="free")


@pytest.mark.parametrize(("collision", "part"), [
    ('<geometry><box size="1 1 1"/><sphere radius="3"/></geometry>', "it has 2 shapes, expected one"),
    ('<geometry><box size="1 1 1"/></geometry><geometry><sphere radius="3"/></geometry>', "2 shapes"),
    ('<origin xyz="0 0 1"/><origin xyz="0 0 2"/><geometry><box size="1 1 1"/></geometry>', "it has 2 origins"),
    ('<origin xzy="0 0 1"/><geometry><box size="1 1 1"/></geometry>', "'xzy'; did you mean 'xyz'"),
    ('<geometry><sphere radius="1" length="2"/></geometry>', "unknown attribute 'length'"),
    ('<geometry><sphere radius="0"/></geometry>', "radius is 0"),
    ("<geometry/>", "it has no shape"),
])  # fmt: skip
def test_collisions_that_mean_more_than_is_read_are_refused(tmp_path: Path, collision: str, part: str) -> None:
    robot = body(tmp_path, f'<collision name="c">{collision}</collision>')
    with pytest.raises(tl.errors.SceneError) as caught:
        tl.Scene(robot, effects=[E.Contact("ground")])
    assert str(caught.value).startswith("effects[0], robot 'r', link 'l', collision 'c': ")
    assert part in str(caught.value)


def walls(tmp_path: Path) -> None:
    corners = [f"v {x} {y} {z}" for a, b in WALLS for x in (a[0], b[0]) for y in (a[1], b[1]) for z in (a[2], b[2])]
    faces = ["f " + " ".join(str(8 * k + i) for i in side) for k in range(2) for side in SIDES]
    (tmp_path / "walls.obj").write_text("\n".join(corners + faces))


def test_a_mesh_with_hollows_counts_as_its_hull_and_report_and_explain_say_so(tmp_path: Path) -> None:
    walls(tmp_path)
    mesh = '<collision><geometry><mesh filename="walls.obj" scale="0.1 0.1 0.1"/></geometry></collision>'
    robot = body(tmp_path, mesh)
    assert robot.solids[0].hollow == pytest.approx(0.05)  # the inner sides of the walls
    assert "hollows of collision meshes (bodies touch at the convex hulls): l" in map(str, robot.report.ignored)
    explained = str(tl.explain(tl.Scene(robot, above(1), effects=[E.Contact("ground")]), duration=0.01))
    assert "1 meshes count as their convex hulls, below which their surfaces lie: l_0 0.05 m" in explained


def test_shapes_stand_in_for_a_mesh_that_is_missing_which_the_report_names(tmp_path: Path) -> None:
    lost = '<collision><geometry><mesh filename="lost.stl"/></geometry><surface><mu>1</mu></surface></collision>'
    robot = body(tmp_path, lost)
    ignored = " | ".join(map(str, robot.report.ignored))
    assert "shapes= to effects.Contact): lost.stl" in ignored
    assert "what <collision> has beside a shape and its origin: l" in ignored
    with pytest.raises(tl.errors.SceneError, match="or shapes= to Contact"):
        tl.Scene(robot, effects=[E.Contact("ground")])
    scene = tl.Scene(robot, above(1), effects=[E.Contact("ground", shapes={"l": (E.Sphere(0.1),)})])
    assert "1 pair may touch: l - ground" in str(tl.explain(scene, duration=0.01))


def test_a_links_name_goes_before_a_shapes() -> None:
    box, ball = '<box size="1 1 1"/>', '<sphere radius="0.1"/>'
    first = link("a", more=f'<collision name="b"><geometry>{box}</geometry></collision>')
    second = link("b", more=f"<collision><geometry>{ball}</geometry></collision>")
    hinge = joint("j", "continuous", "a", "b")
    robot = tl.load_robot(f'<robot name="r">{first}{second}{hinge}</robot>', root="free")
    (pair,) = E.Contact((("b", "ground"),)).selected(robot).chosen
    assert pair.first.link == "b"


def test_stepped_forces_and_accelerations_obey_newtons_law_at_every_sample() -> None:
    """m a = F + m g of a ball that falls and bounces, and of a box that slides to rest, from the first sample on."""
    shapes = {"a": (E.Sphere(0.1),), "b": (E.Box((0.2, 0.2, 0.2)),)}
    law = E.Contact((("a", "ground"), ("b", "ground")), friction=0.5, restitution=0.3, shapes=shapes)
    scene = tl.Scene(free_bodies("a", "b"), [0, 0, 0.2, 0, 0, 0, 1, 2, 0, 0.1, 0, 0, 0, 1],
                     [0, 0, 0, 0, 0, 0, 1.0, 0.3, 0, 0, 0, 0], [E.Gravity(), law])  # fmt: skip
    run = stepped(scene, 0.35, 2e-3, samples=40)
    forces = run.contact_forces
    smooth = np.abs(run.t - math.sqrt(0.2 / 9.81)) > 0.01  # where no step has the bounce
    for k, name in enumerate("ab"):  # neither turns, so that its velocity is along the world's axes
        a, weight = run.acceleration[:, 6 * k : 6 * k + 3], np.array([0, 0, -9.81])
        assert np.abs(a - forces[f"{name} - ground"] - weight)[smooth].max() < 1e-9
    assert_near(forces["a - ground"][0], [0, 0, 0], 1e-12)
    assert forces["b - ground"][0] == pytest.approx([*(-0.5 * 9.81 * np.array([1, 0.3]) / math.hypot(1, 0.3)), 9.81])


@pytest.mark.parametrize("contact", ["located", "stepped"])
def test_each_of_several_planes_has_a_force_of_its_own(contact: str) -> None:
    """A ball rests in a groove of two planes at 30 and 60 degrees: W cos 30 and W cos 60."""
    normals = [(math.sin(a), 0.0, math.cos(a)) for a in (-math.pi / 6, math.pi / 3)]
    robot = free_bodies("ball")
    r, w = 0.1, 9.81 * robot.mass
    at = r * np.sum(normals, axis=0)  # the distance r from both, which are at right angles
    pairs = [("ball", E.Plane(normal)) for normal in normals]
    scene = tl.Scene(robot, [*at, 0, 0, 0, 1], effects=[
        E.Gravity(), E.Contact(pairs, shapes={"ball": (E.Sphere(r),)})])  # fmt: skip
    forces = tl.simulate(scene, 0.1, contact=contact).contact_forces
    for name, n, share in zip(("ball - plane 1", "ball - plane 2"), normals, (math.cos(math.pi / 6), 0.5), strict=True):
        assert_near(forces[name][-1], w * share * np.array(n), 1e-8 * w)
