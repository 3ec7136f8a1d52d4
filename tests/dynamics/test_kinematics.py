"""Frames, centre of mass, momentum and derivatives: identities, and finite differences along the motion."""

import numpy as np
import pinocchio as pin
import pytest

import twolink as tl
from tests.dynamics.robots import of_every_kind
from tests.dynamics.states import close
from twolink.errors import QueryError

ROBOTS = of_every_kind()
STEP = 1e-6


SIMILAR = ("panda", "anymal")  # to the chain and Kinova's arm, and to Talos
KINDS = [pytest.param(name, marks=pytest.mark.slow) if name in SIMILAR else name for name in ROBOTS]


@pytest.fixture(scope="module", params=KINDS)
def robot(request: pytest.FixtureRequest) -> tl.Robot:
    return ROBOTS[request.param]


@pytest.fixture
def state(robot: tl.Robot) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    q, v = robot.random_state(4, seed=3)
    return q, 2 * v, np.random.default_rng(4).uniform(-5, 5, v.shape)


def ahead_and_behind(robot: tl.Robot, q: np.ndarray, v: np.ndarray) -> list[np.ndarray]:
    return [robot.integrate(q, s * STEP * v) for s in (1, -1)]


def vee(skew: np.ndarray) -> np.ndarray:
    """w of the matrices [w x]."""
    return np.stack([skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]], axis=-1)


def test_frame_velocity_is_the_rate_of_the_pose(robot: tl.Robot, state: tuple) -> None:
    """p' is the linear part; R' R^T = [w x] in the world's axes and R^T R' = [w x] in the frame's own."""
    q, v, _ = state
    for frame in robot.frame_names[-2:]:
        (r1, p1), (r0, p0) = (robot.frame_pose(x, frame) for x in ahead_and_behind(robot, q, v))
        rotation, _ = robot.frame_pose(q, frame)
        turning, shift = (r1 - r0) / (2 * STEP), (p1 - p0) / (2 * STEP)
        spin = vee(turning @ np.swapaxes(rotation, -1, -2))
        aligned = robot.frame_velocity(q, v, frame)
        close(aligned, np.concatenate([shift, spin], axis=-1), 1e-7)
        inwards = np.swapaxes(rotation, -1, -2)
        local = [(inwards @ x[..., None])[..., 0] for x in (aligned[..., :3], aligned[..., 3:])]
        close(robot.frame_velocity(q, v, frame, axes="local"), np.concatenate(local, axis=-1))


@pytest.mark.parametrize("axes", ["aligned", "local"])
def test_jacobian_times_velocity_is_the_frame_velocity(robot: tl.Robot, state: tuple, axes: str) -> None:
    q, v, _ = state
    for frame in (robot.frame_names[0], robot.frame_names[-1]):
        jacobian = robot.frame_jacobian(q, frame, axes)
        assert jacobian.shape == (4, 6, robot.nv)
        close(np.einsum("nij,nj->ni", jacobian, v), robot.frame_velocity(q, v, frame, axes))


def test_inverse_dynamics_derivatives_are_those_of_the_tangent_space(robot: tl.Robot, state: tuple) -> None:
    q, v, a = state
    by_q, by_v, by_a = robot.inverse_dynamics_derivatives(q, v, a)
    step = 10 * STEP  # the torques are large: their rounding weighs more than the truncation
    assert by_q.shape == by_v.shape == by_a.shape == (4, robot.nv, robot.nv)
    for k, unit in enumerate(np.eye(robot.nv)):
        turned, faster = (
            (robot.inverse_dynamics(*state[0]) - robot.inverse_dynamics(*state[1])) / (2 * step)
            for state in (
                [(x, v, a) for x in ahead_and_behind(robot, q, 10 * unit)],
                [(q, v + s * step * unit, a) for s in (1, -1)],
            )
        )
        close(by_q[..., k], turned, 1e-7)
        close(by_v[..., k], faster, 1e-7)
    close(by_a, robot.mass_matrix(q))


def test_forward_dynamics_derivatives_invert_those_of_the_inverse(robot: tl.Robot, state: tuple) -> None:
    """a(q, v, tau(q, v, a)) = a: da/dx = -M^-1 dtau/dx at that acceleration, da/dtau = M^-1."""
    q, v, a = state
    inertia = robot.mass_matrix(q)
    tolerance = 1e-14 * np.linalg.cond(inertia).max() + 1e-11
    by_q, by_v, _ = robot.inverse_dynamics_derivatives(q, v, a)
    expected = [-np.linalg.solve(inertia, by_q), -np.linalg.solve(inertia, by_v), np.linalg.inv(inertia)]
    tau = robot.inverse_dynamics(q, v, a)
    for ours, theirs in zip(robot.forward_dynamics_derivatives(q, v, tau), expected, strict=True):
        close(ours, theirs, tolerance)


def test_derivatives_take_in_the_rotors_inertia() -> None:
    def geared(model: pin.Model) -> None:
        model.armature[:] = [0.3, 0.0]

    robot = ROBOTS["two_link"].changed(geared)
    q, v = robot.random_state(3)
    close(robot.inverse_dynamics_derivatives(q, v, v)[2], robot.mass_matrix(q))
    close(robot.forward_dynamics_derivatives(q, v, v)[2], np.linalg.inv(robot.mass_matrix(q)), 1e-11)


def bodies(robot: tl.Robot, q: np.ndarray, v: np.ndarray) -> list[tuple[float, np.ndarray, np.ndarray, np.ndarray]]:
    """Mass, centre, its velocity, and I w about the centre, of each moving body, along the world's axes."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q, v)
    out = []
    for j in range(1, robot.model.njoints):
        body, pose = robot.model.inertias[j], data.oMi[j]
        spin = pose.rotation @ data.v[j].angular
        speed = pose.rotation @ data.v[j].linear + np.cross(spin, pose.rotation @ body.lever)
        out.append((body.mass, pose.act(body.lever), speed, pose.rotation @ body.inertia @ data.v[j].angular))
    return out


def test_centre_of_mass_and_momentum_are_sums_over_the_bodies(robot: tl.Robot, state: tuple) -> None:
    q, v, _ = state
    centre, momentum = robot.centre_of_mass(q), robot.momentum(q, v)
    assert centre.shape == (4, 3)
    assert momentum.shape == (4, 6)
    for i in range(4):
        parts = bodies(robot, q[i], v[i])
        close(centre[i], sum(m * c for m, c, _, _ in parts) / robot.mass)
        close(momentum[i, :3], sum(m * speed for m, _, speed, _ in parts))
        close(momentum[i, 3:], sum(np.cross(c - centre[i], m * speed) + own for m, c, speed, own in parts))


def test_momentum_is_mass_times_the_rate_of_the_centre(robot: tl.Robot, state: tuple) -> None:
    q, v, _ = state
    ahead, behind = (robot.centre_of_mass(x) for x in ahead_and_behind(robot, q, v))
    close(robot.momentum(q, v)[:, :3], robot.mass * (ahead - behind) / (2 * STEP), 1e-6)


def test_batches_are_their_single_states(robot: tl.Robot, state: tuple) -> None:
    q, v, w = state
    frame = robot.frame_names[-1]
    queries = {
        "frame_pose": lambda q: robot.frame_pose(q, frame), "frame_jacobian": lambda q: robot.frame_jacobian(q, frame),
        "frame_velocity": lambda q, v: robot.frame_velocity(q, v, frame), "centre_of_mass": robot.centre_of_mass,
        "momentum": robot.momentum, "forward": robot.forward_dynamics_derivatives,
        "inverse": robot.inverse_dynamics_derivatives,
    }  # fmt: skip
    takes = {"frame_velocity": 2, "momentum": 2, "forward": 3, "inverse": 3}
    for name, query in queries.items():
        arguments = (q, v, w)[: takes.get(name, 1)]
        whole = query(*(x.reshape(2, 2, -1) for x in arguments))
        single = [query(*(x[i].tolist() for x in arguments)) for i in range(4)]
        quick = [query(*(x[i] for x in arguments)) for i in range(4)]
        for part in (
            range(3) if isinstance(whole, tuple) and len(whole) == 3 else range(2) if name == "frame_pose" else [None]
        ):
            pick = (lambda x: x) if part is None else (lambda x, part=part: x[part])
            assert pick(whole).shape[:2] == (2, 2)
            for i in range(4):
                assert np.array_equal(pick(single[i]), pick(quick[i]))
                close(pick(whole)[i // 2, i % 2], pick(single[i]), 1e-11)  # programs answer batches


def test_the_jacobian_of_one_joint_has_one_column() -> None:
    """Pinocchio returns a matrix of one column without its second axis."""
    robot = tl.load_robot("friction_pendulum")
    link = robot.frame_names[-1]
    q, v = robot.random_state(3)
    jacobian = robot.frame_jacobian(q, link)
    assert jacobian.shape == (3, 6, 1)
    assert robot.frame_jacobian(q[0], link, axes="local").shape == (6, 1)
    close((jacobian @ v[..., None])[..., 0], robot.frame_velocity(q, v, link))


def test_answers_are_copies() -> None:
    """Pinocchio returns views of its data; the next call must not change an earlier answer."""
    robot = ROBOTS["panda"]
    (q, v), frame = robot.random_state(2), "panda_hand_tcp"
    for query in (
        lambda i: robot.frame_pose(q[i], frame), lambda i: robot.frame_jacobian(q[i], frame),
        lambda i: robot.frame_velocity(q[i], v[i], frame), lambda i: robot.centre_of_mass(q[i]),
        lambda i: robot.momentum(q[i], v[i]), lambda i: robot.forward_dynamics_derivatives(q[i], v[i], v[i]),
        lambda i: robot.inverse_dynamics_derivatives(q[i], v[i], v[i]),
    ):  # fmt: skip
        first = query(0)
        copy = [np.array(x) for x in first]
        query(1)
        assert all(np.array_equal(x, y) for x, y in zip(first, copy, strict=True))


@pytest.mark.parametrize("query", ["forward_dynamics_derivatives", "inverse_dynamics_derivatives", "frame_jacobian",
                                   "frame_pose"])  # fmt: skip
def test_compiled_answers_equal_pinocchios(query: str) -> None:
    robot = ROBOTS["two_link"]
    q, v = robot.random_state(30)
    arguments = (q, "tip") if query.startswith("frame") else (q, v, v)
    both = [getattr(robot, query)(*arguments, engine=engine) for engine in ("compiled", "pinocchio")]
    parts = zip(*both, strict=True) if isinstance(both[0], tuple) else [both]
    for ours, theirs in parts:
        close(ours, theirs, 1e-10)


@pytest.mark.parametrize("call", [
    lambda r: r.frame_pose(r.neutral, "tpi"), lambda r: r.frame_jacobian(r.neutral, "tpi"),
    lambda r: r.frame_velocity(r.neutral, np.zeros(2), "tpi"), lambda r: r.frame_pose(r.neutral, "tpi", "compiled"),
])  # fmt: skip
def test_an_unknown_frame_is_refused_with_the_nearest_name(call) -> None:
    with pytest.raises(QueryError, match="did you mean 'tip'") as caught:
        call(ROBOTS["two_link"])
    assert (caught.value.code, caught.value.argument) == ("unknown-frame", "frame")


def test_wrong_arguments_are_refused() -> None:
    robot = ROBOTS["two_link"]
    zero = np.zeros(2)
    with pytest.raises(QueryError, match="did you mean 'aligned'"):
        robot.frame_jacobian(zero, "tip", axes="alined")
    with pytest.raises(QueryError, match=r"q: expected shape \(\.\.\., 2\)"):
        robot.centre_of_mass([0.0, 0.0, 0.0])
    with pytest.raises(QueryError, match="v: expected finite numbers"):
        robot.momentum(zero, [np.nan, 0.0])
    with pytest.raises(QueryError, match="not finite"):
        robot.inverse_dynamics_derivatives(zero, np.full(2, 1e200), zero)


def test_frame_names_are_the_links() -> None:
    robot = ROBOTS["panda"]
    assert "panda_hand_tcp" in robot.frame_names
    assert len(set(robot.frame_names)) == len(robot.frame_names)
    for frame in robot.frame_names:
        assert robot.frame_pose(robot.neutral, frame)[0].shape == (3, 3)


def test_the_new_queries_need_no_native_library(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("twolink.dynamics.robot.library", lambda: None)
    robot = tl.load_robot("two_link")
    q, v = robot.random_state(2_000)
    assert robot.forward_dynamics_derivatives(q, v, v)[0].shape == (2_000, 2, 2)
    assert robot.frame_jacobian(q, "tip").shape == (2_000, 6, 2)
