"""Mimic joints: what can be coupled moves as the free robot along the coupling, also pickled; the rest is refused."""

import pickle

import numpy as np
import pinocchio as pin
import pytest

import twolink as tl
from tests.refusals import refusal
from twolink.errors import QueryError, RobotError

LIMIT = '<limit lower="-9" upper="9" effort="1" velocity="1"/>'
INERTIAL = """<inertial><origin xyz="0.1 0.2 0.3"/><mass value="1"/>
<inertia ixx="0.1" iyy="0.12" izz="0.15" ixy="0.01" ixz="0" iyz="0"/></inertial>"""


def mimic(joint: str, multiplier: float = 1.0, offset: float = 0.0) -> str:
    return f'<mimic joint="{joint}" multiplier="{multiplier}" offset="{offset}"/>'


def chain(*joints: tuple[str, str], axis: str = "0.6 0 0.8") -> str:
    """A chain of links l0, l1, ...; each joint j1, j2, ... has a type and its <mimic>."""
    links = "".join(f'<link name="l{i}">{INERTIAL}</link>' for i in range(len(joints) + 1))
    parts = [
        f'<joint name="j{i + 1}" type="{kind}"><origin xyz="0.1 0 0.2"/><parent link="l{i}"/><child link="l{i + 1}"/>'
        f'<axis xyz="{"0 0 1" if kind == "planar" else axis}"/>{LIMIT}{more}</joint>'
        for i, (kind, more) in enumerate(joints)
    ]
    return f'<robot name="r">{links}{"".join(parts)}</robot>'


def loaded(text: str) -> tuple[tl.Robot, tl.Robot]:
    """The robot whose joints are coupled, and the free one."""
    return tl.load_robot(text, mimic=True), tl.load_robot(text)


COUPLED = {
    "revolute": ("revolute", "revolute", 2.0, 0.3),
    "prismatic follows revolute": ("revolute", "prismatic", -0.5, 0.1),
    "revolute follows prismatic": ("prismatic", "revolute", 3.0, 0.0),
    "continuous": ("continuous", "continuous", 2.0, 0.3),
    "multiplier 0": ("revolute", "revolute", 0.0, 0.7),
}


@pytest.mark.parametrize("case", COUPLED)
def test_coupled_joints_move_as_the_free_robot_along_the_coupling(case: str) -> None:
    """M = G^T M_free G, tau = G^T tau_free and J = J_free G for q_free = G q + c."""
    leader, follower, multiplier, offset = COUPLED[case]
    coupled, free = loaded(chain((leader, ""), ("revolute", ""), (follower, mimic("j1", multiplier, offset))))
    y, v, a = np.random.default_rng(5).uniform(-1, 1, (3, 2))
    G = np.array([[1, 0], [0, 1], [multiplier, 0]])
    full = G @ y + [0, 0, offset]

    def configuration(robot: tl.Robot, values: np.ndarray) -> np.ndarray:
        joints = [j for j in robot.joints if j.q.stop > j.q.start]
        return np.concatenate([j.entries("q", value) for j, value in zip(joints, values, strict=True)])

    q, q_free = configuration(coupled, y), configuration(free, full)
    exact = {"rtol": 0, "atol": 1e-12}
    np.testing.assert_allclose(coupled.frame_pose(q, "l3")[1], free.frame_pose(q_free, "l3")[1], **exact)
    np.testing.assert_allclose(coupled.mass_matrix(q), G.T @ free.mass_matrix(q_free) @ G, **exact)
    expected = G.T @ free.inverse_dynamics(q_free, G @ v, G @ a)
    np.testing.assert_allclose(coupled.inverse_dynamics(q, v, a), expected, **exact)
    np.testing.assert_allclose(coupled.forward_dynamics(q, v, expected, method="crba"), a, rtol=0, atol=1e-10)
    np.testing.assert_allclose(coupled.frame_jacobian(q, "l3"), free.frame_jacobian(q_free, "l3") @ G, **exact)
    np.testing.assert_allclose(coupled.energy(q, v), free.energy(q_free, G @ v), **exact)


def test_a_joint_follows_behind_and_before_ball_joints() -> None:
    """M = G^T M_free G, and the frame at the end; whose coordinates balls have moved, also pickled."""
    follower = ("revolute", mimic("j2", 2.0, 0.3))
    coupled, free = loaded(chain(("spherical", ""), ("revolute", ""), follower, ("spherical", "")))
    G = np.insert(np.eye(7), 4, 2.0 * np.eye(7)[3], axis=0)
    q = coupled.random_state(1, seed=3)[0][0]
    q_free = np.insert(q, 5, 2.0 * q[4] + 0.3)
    for one in (coupled, pickle.loads(pickle.dumps(coupled))):
        np.testing.assert_allclose(one.mass_matrix(q), G.T @ free.mass_matrix(q_free) @ G, rtol=0, atol=1e-12)
        np.testing.assert_allclose(one.frame_pose(q, "l4")[1], free.frame_pose(q_free, "l4")[1], rtol=0, atol=1e-12)


@pytest.mark.parametrize("case", COUPLED)
def test_followers_keep_their_limits_of_speed(case: str) -> None:
    """The free robot along the coupling is at a limit of speed."""
    leader, follower, multiplier, offset = COUPLED[case]
    coupled, free = loaded(chain((leader, ""), (follower, mimic("j1", multiplier, offset))))
    start, end = (coupled.joints[0].entries("q", angle) for angle in (0.0, 1.0))
    motion = tl.trapezoidal_motion(coupled, start, end, acceleration=50.0)
    limits = np.ravel([joint.velocity_limit for joint in free.joints])
    assert (np.abs(motion.v * [1.0, multiplier]).max(axis=0) / limits).max() == pytest.approx(1.0)


def test_a_follower_without_limits_leaves_its_leader_without() -> None:
    """A velocity of 1e30 is no limit: exported URDFs have it."""
    text = chain(("continuous", ""), ("continuous", mimic("j1", 2.0))).replace('velocity="1"', 'velocity="1e30"')
    robot, free = loaded(text)
    assert robot.joints[0].velocity_limit == free.joints[0].velocity_limit == (np.inf,)
    assert "narrowed" not in str(robot.report)


def test_a_joint_beside_the_coupled_ones_can_be_locked() -> None:
    text = chain(("revolute", ""), ("revolute", ""), ("revolute", mimic("j1", 2.0, 0.3)))
    locked, whole = tl.load_robot(text, mimic=True, lock={"j2": 0.4}), tl.load_robot(text, mimic=True)
    np.testing.assert_allclose(locked.mass_matrix([0.2]), whole.mass_matrix([0.2, 0.4])[:1, :1], rtol=0, atol=1e-12)


def narrow(multiplier: float, offset: float, limits: tuple[float, float]) -> str:
    """A joint j1 within +-9, and j2 that follows it, within other limits."""
    text = chain(("revolute", ""), ("revolute", mimic("j1", multiplier, offset)), axis="0 1 0")
    first, _, last = text.rpartition(LIMIT)
    return f'{first}<limit lower="{limits[0]}" upper="{limits[1]}" effort="1" velocity="1"/>{last}'


@pytest.mark.parametrize(("multiplier", "offset"), [(1.0, 0.0), (-2.0, 0.3)])
def test_a_follower_keeps_its_limits(multiplier: float, offset: float) -> None:
    """Random states, inverse kinematics and runs of the scene of the file; beyond them no configuration is found."""
    text, (lower, upper) = narrow(multiplier, offset, (-0.5, 0.7)), (-0.5, 0.7)
    robot, free = loaded(text)
    q = robot.random_state(100, seed=1)[0][:, 0]
    followed = multiplier * q + offset
    assert lower - 1e-12 <= followed.min() < 0.1 < followed.max() <= upper + 1e-12
    assert "narrowed to those of these: j1" in str(robot.report)
    for end in (lower + 0.01, upper - 0.01):
        leader = (end - offset) / multiplier
        pose = free.frame_pose([leader, end], "l2")[1]
        np.testing.assert_allclose(robot.inverse_kinematics("l2", pose), [leader], atol=1e-8)
    leader = (upper + 0.5 - offset) / multiplier
    with pytest.raises(QueryError, match="within the joints' limits"):
        robot.inverse_kinematics("l2", free.frame_pose([leader, upper + 0.5], "l2")[1])
    run = tl.simulate(tl.scene_of(text), 2.0)
    assert lower - 1e-6 <= run.q[:, 1].min()
    assert run.q[:, 1].max() <= upper + 1e-6
    np.testing.assert_allclose(run.q[:, 1], multiplier * run.q[:, 0] + offset, atol=1e-7)
    assert min(run.q[:, 1].min() - lower, upper - run.q[:, 1].max()) < 1e-6  # it comes to an end


def test_limits_of_a_follower_that_leave_no_room_are_named() -> None:
    text = narrow(-1.0, 0.0, (20.0, 30.0))
    for one in (tl.load_robot(text, mimic=True), tl.scene_of(text)):
        assert "which leave those no room: j2" in str(one.report)
    assert tl.load_robot(text, mimic=True).joints[0].upper == (9.0,)


REFUSED = {
    "itself": ([("revolute", mimic("j1"))], ["'j1', which is not another joint"]),
    "chain": (
        [("revolute", ""), ("revolute", mimic("j1", 2.0, 0.5)), ("revolute", mimic("j2", 3.0, 0.25))],
        ["joint 'j3'", '<mimic joint="j1" multiplier="6.0" offset="1.75"/>'],
    ),
    "circle": ([("revolute", mimic("j2")), ("revolute", mimic("j1"))], ["in a circle: 'j1', 'j2'"]),
    "fixed": ([("fixed", ""), ("revolute", mimic("j1")), ("revolute", "")], ["mimics 'j1', which is fixed"]),
    "floating": ([("floating", ""), ("revolute", mimic("j1"))], ["cannot mimic the floating joint 'j1'"]),
    "planar": ([("planar", ""), ("revolute", mimic("j1"))], ["cannot mimic the planar joint 'j1'"]),
    "floating follower": ([("revolute", ""), ("floating", mimic("j1"))], ["a floating joint cannot mimic"]),
    "planar follower": ([("revolute", ""), ("planar", mimic("j1"))], ["a planar joint cannot mimic"]),
    "continuous follower": ([("revolute", ""), ("continuous", mimic("j1"))], ["make both continuous"]),
    "continuous": ([("continuous", ""), ("prismatic", mimic("j1"))], ["cannot mimic the continuous joint"]),
    "a later joint": ([("revolute", mimic("j2")), ("revolute", "")], ["comes after it", "let 'j2' mimic 'j1'"]),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_coupled_is_refused_and_loads_uncoupled(case: str) -> None:
    joints, parts = REFUSED[case]
    text = chain(*joints)
    with refusal(RobotError, *parts, code="mimic-joints"):
        tl.load_robot(text, mimic=True)
    assert tl.load_robot(text).nv > 0


@pytest.mark.parametrize("name", ["j1", "j2"])
def test_coupled_joints_cannot_be_locked(name: str) -> None:
    text = chain(("revolute", ""), ("revolute", mimic("j1")), ("revolute", ""))
    with refusal(RobotError, "mimics 'j1', and one of them is locked", code="mimic-joints"):
        tl.load_robot(text, mimic=True, lock={name: 0.5})
    assert tl.load_robot(text, lock={"j1": 0.5, "j2": 0.5}).nv == 1


def test_the_remedy_for_a_chain_gives_the_motion_of_the_chain() -> None:
    joints = [("revolute", ""), ("revolute", mimic("j1", 2.0, 0.5)), ("revolute", mimic("j2", 3.0, 0.25))]
    coupled = tl.load_robot(chain(*joints[:2], ("revolute", mimic("j1", 6.0, 1.75))), mimic=True)
    free = tl.load_robot(chain(*joints))
    q1, q2 = 0.3, 2 * 0.3 + 0.5
    pose, expected = coupled.frame_pose([q1], "l3")[1], free.frame_pose([q1, q2, 3 * q2 + 0.25], "l3")[1]
    np.testing.assert_allclose(pose, expected, rtol=0, atol=1e-14)


def assert_same(one: pin.Model, other: pin.Model, seed: int = 0) -> None:
    rng = np.random.default_rng(seed)
    q = pin.integrate(one, pin.neutral(one), rng.uniform(-1, 1, one.nv))
    v, a = rng.uniform(-1, 1, (2, one.nv))
    for query, given in ((pin.rnea, (q, v, a)), (pin.crba, (q,))):
        np.testing.assert_array_equal(*(query(model, model.createData(), *given) for model in (one, other)))
    for index in one.mimicking_joints:
        assert str(other.joints[index].extract()) == str(one.joints[index].extract())


@pytest.mark.parametrize("kind", ["revolute", "prismatic", "continuous"])
@pytest.mark.parametrize("axis", ["1 0 0", "0 1 0", "0 0 -1", "0 0.6 0.8"])
@pytest.mark.parametrize("multiplier", [1.0, -2.0])
def test_mimic_joints_survive(kind: str, axis: str, multiplier: float) -> None:
    leader = kind if kind == "continuous" else "revolute"
    text = chain((leader, ""), (kind, mimic("j1", multiplier, 0.2)), ("revolute", ""), axis=axis)
    for root in ("fixed", "free"):
        robot = tl.load_robot(text, mimic=True, root=root)
        again = pickle.loads(pickle.dumps(robot))
        assert_same(robot.model, again.model)
        assert_same(robot.visuals.model, again.visuals.model)


def test_robots_of_the_catalogue_survive() -> None:
    for name, options in {
        "panda": {"mimic": True, "lock": {"panda_joint2": 0.3}}, "anymal": {"root": "free"}, "tiago": {"mimic": True},
    }.items():  # fmt: skip
        robot = tl.load_robot(name, **options)
        again = pickle.loads(pickle.dumps(robot))
        assert_same(robot.model, again.model)
        assert again.report == robot.report


def test_the_armature_of_a_follower_acts_on_its_leader() -> None:
    """M = G^T M_free G and the kinetic energy; the report names losses that the model has not."""
    rotor = '<dynamics damping="{}" friction="{}" armature="{}"/>'
    joints = [("revolute", rotor.format(0.3, 0.1, 0.05)), ("revolute", rotor.format(0.2, 0.4, 0.7)),
              ("revolute", mimic("j1", -2.0, 0.3) + rotor.format(0.6, 0.25, 0.5))]  # fmt: skip
    coupled, free = loaded(chain(*joints))
    G, q, v = np.array([[1.0, 0], [0, 1], [-2, 0]]), [0.4, -0.6], np.array([0.7, 0.9])
    q_free = G @ q + [0, 0, 0.3]
    for one in (coupled, pickle.loads(pickle.dumps(coupled))):
        np.testing.assert_allclose(one.mass_matrix(q), G.T @ free.mass_matrix(q_free) @ G, rtol=0, atol=1e-12)
        np.testing.assert_allclose(one.energy(q, v), free.energy(q_free, G @ v), rtol=0, atol=1e-12)
    named = {finding.what[:14]: finding.names for finding in coupled.report.ignored}
    assert named["joint damping "] == named["joint friction"] == ("j1", "j2")
    assert named["damping and fr"] == ("j3",)
