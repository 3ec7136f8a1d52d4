"""Closed loops: what they must keep, what they must equal, and what must be refused."""

import numpy as np
import pinocchio as pin
import pytest

import twolink as tl
from tests.effects.bodies import sliders
from tests.scenes.linkages import hanging_four_bars, pendulum_of_row, rod, row_of_four_bars
from tests.urdf_text import joint, robot_of
from twolink.algorithms.namespaces import Numbers
from twolink.effects.loops import Loop
from twolink.errors import AccuracyError, SceneError
from twolink.hard.case import StateHistory
from twolink.hard.cases.loops import four_bars
from twolink.integrate.motion.assembly import assembled
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.pinocchio_rate import constrained_acceleration
from twolink.integrate.motion.scene_equations import equations_of

E = tl.effects


# The bundled two-link arm with its forearm on joints of its own: along x, along z, and about -y.
PIECES = robot_of(
    rod("upper", 3.0), rod("lower", 1.0), '<link name="x"/><link name="z"/>',
    joint("shoulder", "revolute", "ground", "upper", "0 -1 0"), joint("along_x", "prismatic", "ground", "x", "1 0 0"),
    joint("along_z", "prismatic", "x", "z"), joint("turn", "revolute", "z", "lower", "0 -1 0"))  # fmt: skip


def rows(equations: Equations, q: np.ndarray) -> np.ndarray:
    loops = equations.constraints
    return np.array([float(g) for g in loops.residuals(loops.mech, list(q), Numbers)])


def in_pieces(loop: Loop) -> tl.Scene:
    robot = tl.load_robot(PIECES)
    named = {"along_x": 1.0}
    return tl.Scene(robot, [named.get(n, 0.0) for n in robot.joint_names], effects=[E.Gravity(), loop])


def column(run: tl.Trajectory, name: str) -> np.ndarray:
    return np.asarray(run.columns()[f"q.{name}"])


@pytest.mark.slow
def test_a_hinge_loop_is_a_revolute_joint() -> None:
    ends = {"point_a": (1.0, 0.0, 0.0), "axis_a": (0.0, 1.0, 0.0), "axis_b": (0.0, -3.0, 0.0)}
    run = tl.simulate(in_pieces(E.HingeLoop(a="upper", b="lower", **ends)), 2.0, accuracy=1e-10)
    tree = tl.simulate(tl.Scene(tl.load_robot("two_link"), effects=[E.Gravity()]), 2.0, accuracy=1e-11)
    np.testing.assert_allclose(column(run, "shoulder"), tree.q[:, 0], rtol=0, atol=1e-10)
    np.testing.assert_allclose(column(run, "turn"), tree.q.sum(axis=1), rtol=0, atol=1e-10)


def test_a_weld_loop_is_a_fixed_joint() -> None:
    run = tl.simulate(in_pieces(E.WeldLoop(a="upper", b="lower", point_a=(1.0, 0.0, 0.0))), 2.0, accuracy=1e-10)
    fixed = tl.load_robot("two_link", lock={"elbow": 0.0})
    tree = tl.simulate(tl.Scene(fixed, effects=[E.Gravity()]), 2.0, accuracy=1e-11)
    for name in ("shoulder", "turn"):
        np.testing.assert_allclose(column(run, name), tree.q[:, 0], rtol=0, atol=1e-10)


@pytest.mark.parametrize(("axis", "angle"), [((0, 0, 1), 0.4), ((0, 0, 1), np.pi), ((1, 0, 0), np.pi), ((0, 1, 0), 2.0),
                                             ((-1, -1, -1), 2 * np.pi / 3)])  # fmt: skip
def test_a_weld_has_the_orientation_that_it_says_or_is_refused(axis: tuple[float, ...], angle: float) -> None:
    """Its rows are 0 also at half a turn about an axis, and at a third of a turn about all three."""
    scene = tl.Scene(tl.load_robot("two_link"), {"shoulder": 0.3}, effects=[E.Gravity()])
    scene = scene.with_object("box", (3.0, 0.0, 0.5))
    scene = scene.with_effects([E.WeldLoop("box", "forearm", point_b=(0.5, 0.0, 0.0), rpy=(0.2, 0.1, 0.0))])
    wanted = pin.rpy.rpyToMatrix(0.2, 0.1, 0.0)

    def turned(start: tl.Scene) -> np.ndarray:
        """R of the box as the forearm sees it, where a run begins."""
        q = tl.simulate(start, 0.01).q[0]
        return start.base.frame_pose(q, "forearm")[0].T @ start.base.frame_pose(q, "box")[0]

    q, (rotation, position) = scene.q.copy(), scene.base.frame_pose(scene.q, "forearm")
    start = rotation @ wanted @ pin.exp3(angle * np.array(axis) / np.linalg.norm(axis))
    box = next(joint.q for joint in scene.base.joints if joint.name == "box")
    q[box] = [*(position + rotation @ [0.5, 0.0, 0.0]), *pin.Quaternion(start).coeffs()]
    if angle < 1.0:
        np.testing.assert_allclose(turned(scene.with_start(q, scene.v)), wanted, rtol=0, atol=1e-9)
        return
    with pytest.raises(SceneError, match=r"turned by 1[28]0 degrees from the rpy of its weld") as caught:
        tl.simulate(scene.with_start(q, scene.v), 0.01)
    rpy = tuple(map(float, str(caught.value).rpartition("rpy=(")[2].rstrip(")").split(",")))
    other = scene.with_effects([E.WeldLoop("box", "forearm", point_b=(0.5, 0.0, 0.0), rpy=rpy)])
    np.testing.assert_allclose(turned(other.with_start(q, scene.v)), pin.rpy.rpyToMatrix(*rpy), rtol=0, atol=1e-9)


@pytest.mark.parametrize("ratio", [-2.5, 1.0])
def test_coupled_masses(ratio: float) -> None:
    """q_one = r q_two + c with a force on one: q_two'' = r f / (m_two + r^2 m_one)."""
    effects = [E.Coupling("one", "two", ratio, 0.2), E.Torque({"one": 0.7})]
    scene = tl.Scene(sliders(0.3, 2.0), {"one": 0.2, "two": 0.0}, effects=effects)
    run = tl.simulate(scene, 2.0, accuracy=1e-10)
    expected = ratio * 0.7 / (2.0 + ratio**2 * 0.3) * run.t**2 / 2
    np.testing.assert_allclose(column(run, "two"), expected, rtol=0, atol=1e-10)
    np.testing.assert_allclose(column(run, "one"), ratio * expected + 0.2, rtol=0, atol=1e-10)


@pytest.mark.parametrize(
    ("name", "kept"), [("crankshaft", [0, 1]), ("four-bar", [0, 1, 3, 4]), ("squeezer", [0, 1, 3, 4, 6, 7])]
)
def test_rows_across_the_plane_are_dropped(name: str, kept: list[int]) -> None:
    loops = equations_of(tl.load_scene(name)).constraints
    assert list(loops.kept) == kept


def test_loops_that_cannot_meet_are_refused() -> None:
    given = tl.load_scene("crankshaft")
    scene = tl.Scene(given.base, given.q, effects=[E.PointLoop(a="rod", point_a=(0.3, 0, 0), point_b=(0.9, 0, 0))])
    # the end of the rod reaches 0.4 m; the point is at 0.9 m
    with pytest.raises(SceneError, match=r"cannot be closed: 5\.00e-01 m or rad is left.*nearer to a closed position"):
        tl.simulate(scene, 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["scipy-dop853", "scipy-radau", "rk4", "esdirk43", "taylor"])
def test_every_kind_of_method_keeps_a_coupling(method: str) -> None:
    scene = tl.Scene(tl.load_robot("two_link"), effects=[E.Gravity(), E.Coupling("elbow", "shoulder", 1.0)])
    truth = tl.simulate(scene, 1.0, accuracy=1e-10).q[-1]
    run = tl.simulate(scene, 1.0, accuracy=1e-6, method=method)
    np.testing.assert_allclose(run.q[-1], truth, rtol=0, atol=1e-6)


def test_worlds_start_on_their_loops_and_a_run_says_that_its_start_was_moved() -> None:
    coupling = E.Coupling("elbow", "shoulder", 1.0, offset=2.0)
    scene = tl.Scene(tl.load_robot("two_link"), effects=[E.Gravity(), coupling], duration=1.0)
    run, worlds = tl.simulate(scene, accuracy=1e-9), tl.simulate_many(scene, accuracy=1e-9)
    np.testing.assert_allclose(worlds.q[0], run.q[-1], rtol=0, atol=1e-8)
    assert "moved" in str(run.events[0])


def test_a_joint_coupled_to_itself_is_refused() -> None:
    with pytest.raises(SceneError, match="joint 'elbow' is coupled to itself"):
        tl.Scene(tl.load_robot("two_link"), effects=[E.Coupling("elbow", "elbow", 1.0)])


def test_an_open_start_is_closed_and_its_velocity_made_to_fit() -> None:
    given = tl.load_scene("crankshaft")
    q, v = {"crank_joint": 0.7, "rod_joint": -0.9, "slide": 0.37}, {"crank_joint": 3.0}
    names = given.robot.joint_names
    scene = tl.Scene(given.base, [q[n] for n in names], [v.get(n, 0.0) for n in names], given.effects)
    assert np.abs(rows(equations_of(scene), scene.q)).max() > 1e-3
    run = tl.simulate(scene, 0.01, accuracy=1e-9)
    assert np.abs(rows(equations_of(scene), run.q[0])).max() < 1e-12
    theta, rate = column(run, "crank_joint")[0], run.columns()["v.crank_joint"][0]
    along = np.sqrt(0.09 - (0.1 * np.sin(theta)) ** 2)
    assert column(run, "slide")[0] == pytest.approx(0.1 * np.cos(theta) + along, abs=1e-12)
    slope = -0.1 * np.sin(theta) - 0.01 * np.sin(theta) * np.cos(theta) / along
    assert run.columns()["v.slide"][0] == pytest.approx(slope * rate, abs=1e-12)
    assert np.abs(run.q[0] - scene.q).max() < 0.05


def point_rows(scene: tl.Scene, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(J, J' v) of the scene's point loops by Pinocchio: classical accelerations of frames at the points, a = 0."""
    model, world = scene.robot.model.copy(), pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    ends = []
    for k, loop in enumerate(e for e in scene.effects if isinstance(e, E.PointLoop)):
        for name, point in ((loop.a, loop.point_a), (loop.b, loop.point_b)):
            body = model.frames[model.getFrameId(name, pin.FrameType.BODY)]
            place = body.placement * pin.SE3(np.eye(3), np.array(point, dtype=float))
            frame = pin.Frame(f"{name} {k}", body.parentJoint, 0, place, pin.FrameType.OP_FRAME)
            ends.append(model.addFrame(frame))
    data = model.createData()
    pin.forwardKinematics(model, data, q, v, np.zeros(model.nv))
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    jacobians = [pin.getFrameJacobian(model, data, i, world)[:3] for i in ends]
    terms = [pin.getFrameClassicalAcceleration(model, data, i, world).linear for i in ends]
    differences = [(jacobians[i] - jacobians[i + 1], terms[i] - terms[i + 1]) for i in range(0, len(ends), 2)]
    return np.vstack([d[0] for d in differences]), np.concatenate([d[1] for d in differences])


def by_the_whole_system(scene: tl.Scene, q: np.ndarray, v: np.ndarray, tau: np.ndarray, kept: list[int]) -> tuple:
    """(a, lambda) of M a + h = tau + J^T lambda, J a = -J' v of the kept rows, as one dense system by Pinocchio."""
    model, (jacobian, terms) = scene.robot.model, (rows[kept] for rows in point_rows(scene, q, v))
    data = model.createData()
    mass, h = pin.crba(model, data, q), pin.nonLinearEffects(model, data, q, v)
    whole = np.block([[mass, -jacobian.T], [jacobian, np.zeros((len(terms), len(terms)))]])
    solution = np.linalg.lstsq(whole, np.concatenate([tau - h, -terms]), rcond=1e-12)[0]
    return solution[: model.nv], solution[model.nv :]


@pytest.mark.parametrize("name", ["crankshaft", "four-bar", "squeezer"])
def test_accelerations_and_multipliers_solve_the_whole_system(name: str) -> None:
    scene = tl.load_scene(name)
    equations = equations_of(scene)
    loops, model = equations.constraints, scene.robot.model
    random = np.random.default_rng(5)
    for _ in range(5):
        x = equations.start + 0.2 * random.standard_normal(equations.moving)
        x = assembled(loops, x)
        q, v, tau = x[: model.nq], x[model.nq :], random.standard_normal(model.nv)
        assert np.abs(point_rows(scene, q, v)[0][list(loops.kept)] @ v).max() < 1e-12 * (1 + np.abs(v).max())
        expected = by_the_whole_system(scene, q, v, tau, list(loops.kept))
        found = loops.accelerations(loops.mech, x, list(tau), {}, Numbers, np.ones(model.nv), loops.loops)
        data = model.createData()
        mass, h = pin.crba(model, data, q), pin.nonLinearEffects(model, data, q, v)
        reference = constrained_acceleration(loops, q, v, tau - h, mass, np.ones(model.nv), loops.loops)
        for ours, theirs in (*zip(found, expected, strict=True), (reference, expected[0])):
            assert np.abs(np.array(ours, dtype=float) - theirs).max() < 1e-9 * (1 + np.abs(theirs).max())


@pytest.mark.parametrize(
    "scene", [row_of_four_bars(3, 1.2), hanging_four_bars(3, right_length=0.7)], ids=["row", "hang"]
)
def test_loops_cost_what_they_cost_alone(scene: tl.Scene) -> None:
    """Rows depend on the joints of their own loop only, and accelerations are those of Pinocchio's whole system."""
    equations = equations_of(scene)
    loops, model = equations.constraints, scene.robot.model
    assert all(len(support) == 3 for row, support in enumerate(loops.supports) if row in loops.kept)
    assert len(loops._column_groups) <= 4
    x = equations.start
    q, v = x[: model.nq], 0.3 * np.random.default_rng(1).standard_normal(model.nv)
    jacobian = loops.jacobian_at(q, loops.kept)
    v = v - np.linalg.lstsq(jacobian, jacobian @ v, rcond=None)[0]
    expected, _ = by_the_whole_system(scene, q, v, np.zeros(model.nv), list(range(3 * len(loops.loops))))
    args = loops.mech, np.concatenate([q, v]), [0.0] * model.nv, {}, Numbers, np.ones(model.nv), loops.loops
    a = np.array(loops.accelerations(*args)[0], dtype=float)
    assert np.abs(a - expected).max() < 1e-10 * (1.0 + np.abs(expected).max())


def test_a_row_of_loops_moves_as_one_pendulum() -> None:
    """Exact by a robot of one joint."""
    number, angle = 4, -1.1
    scene = row_of_four_bars(number, angle, 0.5)
    run = tl.simulate(scene, 1.0, accuracy=1e-8)
    exact = tl.simulate(pendulum_of_row(number, angle, 0.5), 1.0, accuracy=1e-11)
    signs = np.array([1.0 if name.startswith("j") else -1.0 for name in scene.robot.joint_names])
    assert np.all(np.abs(run.q - exact.q * signs).max(axis=1) <= run.error + 1e-11)
    assert run.error[-1] <= 1e-8


@pytest.mark.slow
def test_a_four_bar_of_ones_own_passes_its_singular_position_again_and_again() -> None:
    """20 s at 1e-6, exact by an elliptic function; and what cannot be reached is said with its cause."""
    scene = row_of_four_bars(1)
    run = tl.simulate(scene, 20.0, accuracy=1e-6, samples_per_second=50)
    assert run.error[-1] <= 1e-6
    assert np.all(four_bars(1)(scene.robot, StateHistory(run.t, run.q, run.v)) <= run.error)
    with pytest.raises(AccuracyError) as caught:
        tl.simulate(scene, 20.0, accuracy=1e-10, samples_per_second=50)
    assert caught.value.code in ("loops-singular", "accuracy-limit")
    assert "esdirk43" not in caught.value.remedy
