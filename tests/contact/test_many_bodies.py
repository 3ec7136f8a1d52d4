"""Many bodies in one scene: they need no pin.Data of the whole, and move as few do."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import scipy.sparse as sparse

import twolink as tl
from tests.effects.bodies import G, free_bodies, grounded, spheres, stepped
from tests.near import assert_near
from tests.refusals import refusal
from twolink.contact import bodies as sparse_bodies
from twolink.contact.positions import solve_normal
from twolink.io.fingerprints import joint_poses, model_digest, trees_of
from twolink.robots import model as robot_model

E = tl.effects
COUNT, R = 40, 0.05  # spheres in 4 towers


@pytest.fixture(scope="module")
def towers() -> tl.Trajectory:
    """Spheres that stand on each other within rounding, and then fall apart."""
    names = [f"s{k}" for k in range(COUNT)]
    places = np.array([[0.5 * (k % 4), 0.02 * (k % 3), R + 2.05 * R * (k // 4)] for k in range(COUNT)])
    q = np.concatenate([places, np.tile([0, 0, 0, 1.0], (COUNT, 1))], axis=1).ravel()
    effects = [E.Gravity(), E.Contact(("self", "ground"), 0.3, shapes=spheres(*names, radius=R))]
    scene = tl.Scene(free_bodies(*names), q, effects=effects)
    return stepped(scene, 0.1, 5e-3, samples=200)


def test_bodies_beyond_the_memory_of_a_whole_fall_without_overlap_or_gain_of_energy(towers: tl.Trajectory) -> None:
    assert not towers.robot.is_whole
    assert towers.contact_record["overlap"] < 1e-6
    assert np.diff(towers.energy).max() < 1e-9 * towers.energy[0]
    assert towers.energy[-1] < towers.energy[0]
    ground = sum(force[-1, 2] for pair, force in towers.contact_forces.items() if "ground" in pair)
    assert ground > 0.1 * COUNT * G


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 5, 8])
@pytest.mark.parametrize("h", [5e-3, 1.25e-3])
def test_spheres_in_a_box_come_to_rest_without_overlap_or_gain_of_energy(seed: int, h: float) -> None:
    """They hold each other in rings, in which forces are not determined. One may spin on its place.

    The energy grows by no more than terms of order h^3.
    """
    names, wide = [f"s{k}" for k in range(27)], 3.6 * R
    grid = np.stack(np.meshgrid(*[np.arange(3.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    shift = np.random.default_rng(seed).uniform(-0.1, 0.1, grid.shape)
    places = R * (2.4 * (grid - [1, 1, 0]) + [0, 0, 1.5] + shift)
    q = np.concatenate([places, np.tile([0, 0, 0, 1.0], (27, 1))], axis=1).ravel()
    walls = [E.Plane(n, -wide) for n in ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0))]
    pairs = ("self", "ground", *((name, wall) for name in names for wall in walls))
    contact = E.Contact(pairs, 0.3, shapes=spheres(*names, radius=R))
    scene = tl.Scene(free_bodies(*names, inertia=0.4 * R**2), q, effects=[E.Gravity(), contact])
    run = stepped(scene, 2.0, h, samples=200)
    assert run.contact_record["overlap"] < 1e-8
    assert run.contact_record["halved"] == 0
    assert np.diff(run.energy).max() < 5.0 * h**3 * run.energy[0]
    assert_near(run.v[-1].reshape(-1, 6)[:, :3], 0.0, 2e-2)


def test_their_energy_is_that_of_each_body(towers: tl.Trajectory) -> None:
    robot, q, v = towers.robot, towers.q.reshape(-1, COUNT, 7), towers.v.reshape(-1, COUNT, 6)
    body = robot.model.inertias[1]
    potential = body.mass * G * q[..., 2].sum(axis=1)
    kinetic = 0.5 * np.einsum("nbi,ij,nbj->n", v, body.matrix(), v)
    assert towers.energy == pytest.approx(kinetic + potential, rel=1e-12)


def test_they_are_explained_and_saved(towers: tl.Trajectory, tmp_path: Path) -> None:
    again = tl.Trajectory.load(towers.save(tmp_path / "run.npz"), towers.robot)
    assert np.array_equal(again.q, towers.q)


def test_what_needs_the_data_of_the_whole_is_refused(towers: tl.Trajectory) -> None:
    with refusal(tl.errors.QueryError, code="too-large", match="0 GB"):
        towers.robot.mass_matrix(towers.q[0])


def test_trees_answer_as_the_whole_does(monkeypatch: pytest.MonkeyPatch) -> None:
    """A free body and an arm."""
    arm = ('<link name="upper"><inertial><mass value="2"/><origin xyz="0 0.1 0.2"/><inertia ixx="0.1" iyy="0.1" '
           'izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="shoulder" type="revolute"><parent '
           'link="ground"/><child link="upper"/><axis xyz="0 1 0"/><origin xyz="1 0 0"/><limit lower="-9" upper="9" '
           'effort="9" velocity="9"/></joint>')  # fmt: skip
    text = free_bodies("a", "b").visuals.text.replace("</robot>", f"{arm}</robot>")
    whole = tl.load_robot(text)
    monkeypatch.setattr(robot_model, "LARGEST", 0)
    parts = tl.load_robot(text)
    assert len(parts.trees) == 3
    q, v = whole.random_state(4)
    assert np.array(parts.energy(q, v)) == pytest.approx(np.array(whole.energy(q, v)), rel=1e-12)
    for query in ("forward_dynamics", "inverse_dynamics"):
        assert getattr(parts, query)(q, v, v) == pytest.approx(getattr(whole, query)(q, v, v), rel=1e-9)
    assert parts.bias(q[0], v[0]) == pytest.approx(whole.bias(q[0], v[0]), rel=1e-9)
    assert model_digest(whole.model) == model_digest(parts.model)
    pin.forwardKinematics(whole.model, whole.data, q[0])
    for pose, expected in zip(joint_poses(whole.model, q[0]), whole.data.oMi, strict=True):
        assert_near(pose.homogeneous, expected.homogeneous, 1e-14)


def test_the_trees_of_one_arm_are_its_model() -> None:
    model = tl.load_robot("arm").model
    assert [tree.model for tree in trees_of(model)] == [model]


def test_bodies_whose_joints_are_placed_elsewhere_are_not_taken_for_those_at_the_origin(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    text = free_bodies("a", "b").visuals.text.replace(
        '<parent link="ground"/>', '<origin xyz="0 0 1"/><parent link="ground"/>'
    )
    monkeypatch.setattr(sparse_bodies, "MANY", 1)
    scene = grounded(tl.load_robot(text), [0, 0, -0.9, 0, 0, 0, 1, 1, 0, 0, 0, 0, 0, 1], shapes=spheres(*"ab"))
    run = stepped(scene, 0.1, 0.01, samples=10)
    assert_near(run.q[-1, 2], -0.9, 1e-9)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("redundant", [False, True])
def test_contacts_without_friction_obey_their_law(seed: int, redundant: bool) -> None:
    random = np.random.default_rng(seed)
    rows = random.standard_normal((30, 12 if redundant else 40))
    matrix, b = rows @ rows.T, rows @ random.standard_normal(rows.shape[1])
    for given in (matrix, sparse.csr_array(matrix)):
        p = solve_normal(given, b)
        opening = matrix @ p + b
        assert p.min() >= 0.0
        assert opening.min() > -1e-8
        assert_near(p * opening, 0.0, 1e-7)


def test_too_many_degrees_of_freedom_that_hang_together_are_refused() -> None:
    text = free_bodies(*(f"s{k}" for k in range(51))).visuals.text
    with refusal(tl.errors.RobotError, code="urdf", match="312 degrees of freedom"):
        tl.load_robot(text, root="free")
