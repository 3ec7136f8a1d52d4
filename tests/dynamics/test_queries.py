"""Queries: identities of the equations of motion, second ways to a number, batches, wrenches, threads, errors."""

import dataclasses
import itertools
import multiprocessing
import threading
from collections.abc import Callable
from typing import Literal

import mujoco
import numpy as np
import pinocchio as pin
import pytest

import twolink as tl
from tests.dynamics.states import close, states
from twolink.dynamics.queries import ALGORITHMS
from twolink.errors import QueryError
from twolink.robots.catalogue import our_urdfs

ROBOTS = {"two_link": "fixed", "panda": "fixed", "kinova": "fixed", "anymal": "free", "talos": "free"}


@pytest.fixture(scope="module", params=[name if name not in ("panda", "anymal") else
                                        pytest.param(name, marks=pytest.mark.slow) for name in ROBOTS])  # fmt: skip
def robot(request: pytest.FixtureRequest) -> tl.Robot:
    return tl.load_robot(request.param, root=ROBOTS[request.param])


def test_equation_of_motion_holds(robot: tl.Robot) -> None:
    q, v, tau = states(robot, 20)
    a = robot.forward_dynamics(q, v, tau)
    left = np.einsum("nij,nj->ni", robot.mass_matrix(q), a) + robot.bias(q, v)
    close(left, tau, 1e-11)
    close(robot.inverse_dynamics(q, v, a), tau, 1e-11)


def test_aba_and_crba_agree(robot: tl.Robot) -> None:
    q, v, tau = states(robot, 20)
    condition = np.linalg.cond(robot.mass_matrix(q)).max()
    both = robot.forward_dynamics(q, v, tau), robot.forward_dynamics(q, v, tau, method="crba")
    close(both[0], both[1], 1e-15 * condition + 1e-13)


def test_bias_is_coriolis_and_gravity(robot: tl.Robot) -> None:
    q, v, _ = states(robot, 20)
    velocity_terms = np.einsum("nij,nj->ni", robot.coriolis(q, v), v)
    close(robot.bias(q, v), velocity_terms + robot.gravity_torque(q), 1e-12)


def test_mass_matrix_rate_minus_twice_coriolis_is_skew(robot: tl.Robot) -> None:
    q, v, _ = states(robot, 5)
    step = 1e-6
    ahead, behind = (
        robot.mass_matrix(np.array([pin.integrate(robot.model, a, s * step * b) for a, b in zip(q, v, strict=True)]))
        for s in (1, -1)
    )
    odd = (ahead - behind) / (2 * step) - 2 * robot.coriolis(q, v)
    close(odd, -np.swapaxes(odd, -1, -2), 1e-7)


def test_mass_matrix_is_symmetric_positive_definite_and_gives_kinetic_energy(robot: tl.Robot) -> None:
    q, v, _ = states(robot, 20)
    inertia = robot.mass_matrix(q)
    assert np.array_equal(inertia, np.swapaxes(inertia, -1, -2))
    assert np.linalg.eigvalsh(inertia).min() > 0
    close(robot.energy(q, v)[0], np.einsum("ni,nij,nj->n", v, inertia, v) / 2, 1e-13)


def test_power_is_the_rate_of_energy(robot: tl.Robot) -> None:
    """d(T + V)/dt = v . tau along the motion, by central differences."""
    q, v, tau = states(robot, 5)
    a = robot.forward_dynamics(q, v, tau)
    step = 1e-6

    def energy(s: float) -> np.ndarray:
        ahead = np.array(
            [pin.integrate(robot.model, x, s * y + s * s / 2 * z) for x, y, z in zip(q, v, a, strict=True)]
        )
        return sum(robot.energy(ahead, v + s * a))

    rate = (energy(step) - energy(-step)) / (2 * step)
    close(rate, np.einsum("ni,ni->n", v, tau), 1e-5)


@pytest.mark.parametrize("name", ["two_link", "arm", "double_pendulum_simple"])
def test_mujoco_gives_the_same_accelerations(name: str) -> None:
    """An engine that shares no code with Pinocchio, on the same file."""
    robot = tl.load_robot(name)
    path = our_urdfs() / f"{name}.urdf" if name in ("two_link", "arm") else None
    text = (
        path.read_text() if path else robot.visuals.text.replace("<visual", "<ignored").replace("</visual", "</ignored")
    )
    text = text.replace('ixx="0"', 'ixx="0.1"')  # MuJoCo wants rods with thickness; in a plane it has no effect
    other = mujoco.MjModel.from_xml_string(text)
    other.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    other.dof_damping[:] = 0
    other.dof_frictionloss[:] = 0
    data = mujoco.MjData(other)
    q, v, tau = states(robot, 50)
    tau = tau / 20
    for i in range(50):
        data.qpos[:], data.qvel[:], data.qfrc_applied[:] = q[i], v[i], tau[i]
        mujoco.mj_forward(other, data)
        close(robot.forward_dynamics(q[i], v[i], tau[i]), data.qacc, 1e-10)


def test_batches_broadcast_and_equal_single_states(robot: tl.Robot) -> None:
    q, v, tau = states(robot, 6)
    shaped = q.reshape(2, 3, -1), v.reshape(2, 3, -1), tau.reshape(2, 3, -1)
    queries: list[tuple[Callable[..., np.ndarray], int]] = [
        (robot.forward_dynamics, 3), (lambda *x: robot.forward_dynamics(*x, method="crba"), 3),
        (robot.inverse_dynamics, 3), (robot.bias, 2), (robot.coriolis, 2), (robot.mass_matrix, 1),
        (robot.gravity_torque, 1), (lambda *x: robot.energy(*x)[0], 2), (lambda *x: robot.energy(*x)[1], 2),
    ]  # fmt: skip
    for query, count in queries:
        batch = query(*shaped[:count])
        single = [query(*(x[i] for x in (q, v, tau)[:count])) for i in range(6)]
        expected = np.array(single)  # programs answer batches: the same to rounding
        np.testing.assert_allclose(batch.reshape(expected.shape), expected, rtol=0, atol=1e-12 * np.abs(expected).max())
        assert batch.shape[:2] == (2, 3)
        if count > 1:  # one configuration, many velocities
            wide = query(shaped[0][:, :1], *shaped[1:count])
            assert wide.shape[:2] == (2, 3)
            np.testing.assert_allclose(wide[0, 0], batch[0, 0], rtol=1e-14, atol=1e-13)


def test_large_batches_take_the_parallel_way_to_the_same_numbers(robot: tl.Robot) -> None:
    q, v, tau = states(robot, 300)
    many = robot.forward_dynamics(q, v, tau), robot.inverse_dynamics(q, v, tau)
    assert many[0].flags.c_contiguous
    tolerance = 1e-15 * np.linalg.cond(robot.mass_matrix(q)).max() + 1e-13
    for i in (0, 137, 299):  # not bit for bit: Pinocchio's parallel loop is compiled apart
        close(many[0][i], robot.forward_dynamics(q[i], v[i], tau[i]), tolerance)
        close(many[1][i], robot.inverse_dynamics(q[i], v[i], tau[i]), 1e-13)


@pytest.mark.parametrize("axes", ["frame", "world"])
def test_wrenches_are_the_jacobians_transpose(robot: tl.Robot, axes: str) -> None:
    """J^T w enters the equation of motion, J the frame's Jacobian in the wrench's axes."""
    q, v, tau = states(robot, 4)
    name = [f.name for f in robot.model.frames if f.type == pin.FrameType.BODY][-1]
    wrench = np.random.default_rng(1).uniform(-5, 5, (4, 6))
    given = {name: tl.Wrench(wrench, axes=axes)}
    inertia, bias = robot.mass_matrix(q), robot.bias(q, v)
    reference = pin.LOCAL if axes == "frame" else pin.LOCAL_WORLD_ALIGNED
    data = robot.model.createData()
    force = np.array(
        [
            pin.computeFrameJacobian(robot.model, data, q[i], robot.model.getFrameId(name), reference).T @ wrench[i]
            for i in range(4)
        ]
    )
    a = np.linalg.solve(inertia, (tau - bias + force)[..., None])[..., 0]
    tolerance = 1e-15 * np.linalg.cond(inertia).max() + 1e-12
    close(robot.forward_dynamics(q, v, tau, given), a, tolerance)
    close(robot.forward_dynamics(q, v, tau, given, method="crba"), a, tolerance)
    close(robot.inverse_dynamics(q, v, a, given), tau, 1e-10)
    if axes == "frame":
        close(robot.forward_dynamics(q, v, tau, {name: wrench}), a, tolerance)


def test_a_batch_of_wrenches_on_one_state() -> None:
    robot = tl.load_robot("two_link")
    wrenches = np.zeros((3, 6))
    wrenches[:, 2] = [0.0, 1.0, 2.0]
    tau = robot.inverse_dynamics([0.0, 0.0], [0.0, 0.0], [0.0, 0.0], {"tip": tl.Wrench(wrenches, axes="world")})
    # a force F upwards at the tip, 2 m and 1 m from the joints, takes 2 F and F off the holding torques
    np.testing.assert_allclose(tau[0] - tau, np.outer([0, 1, 2], [2.0, 1.0]), atol=1e-13)
    moved = robot.inverse_dynamics([0.0, 0.0], [0.0, 0.0], np.zeros((5, 1, 2)), {"tip": wrenches})
    assert moved.shape == (5, 3, 2)


def test_mimic_robots_are_the_constrained_ones() -> None:
    """With q = G y, M(y) = G^T M(q) G and tau_y = G^T tau_q; the full robot and G are the independent way."""
    follow, full = tl.load_robot("panda", mimic=True), tl.load_robot("panda")
    leader, follower = (full.joint_names.index(f"panda_finger_joint{i}") for i in (1, 2))
    coupling = np.delete(np.eye(9), follower, axis=1)
    coupling[follower, leader] = 1.0
    rng = np.random.default_rng(2)
    q, v, a = rng.uniform(-1, 1, (3, 8))
    whole = coupling @ q, coupling @ v, coupling @ a
    close(follow.mass_matrix(q), coupling.T @ full.mass_matrix(whole[0]) @ coupling, 1e-13)
    close(follow.inverse_dynamics(q, v, a), coupling.T @ full.inverse_dynamics(*whole), 1e-13)
    close(follow.forward_dynamics(q, v, follow.inverse_dynamics(q, v, a), method="crba"), a, 1e-10)
    np.testing.assert_allclose(follow.energy(q, v), full.energy(*whole[:2]), rtol=1e-13)
    with pytest.raises(QueryError, match='use method="crba"'):
        follow.forward_dynamics(q, v, a)
    with pytest.raises(QueryError, match="mimic"):
        follow.coriolis(q, v)


MIMICS = """<robot name="r"><link name="base"/>{links}
<joint name="a" type="continuous"><parent link="base"/><child link="a"/><axis xyz="0 1 0"/></joint>
<joint name="b" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0.3 0 0"/><axis xyz="1 0 0"/>
<limit lower="-9" upper="9" effort="1" velocity="1"/></joint>
<joint name="c" type="revolute"><parent link="b"/><child link="c"/><origin xyz="0 0.2 0"/><axis xyz="0 0 1"/>
<limit lower="-9" upper="9" effort="1" velocity="1"/><mimic joint="b" multiplier="-2" offset="0.3"/></joint>
<joint name="d" type="revolute"><parent link="c"/><child link="d"/><origin xyz="0 0.2 0.1"/><axis xyz="0 1 0"/>
<limit lower="-9" upper="9" effort="1" velocity="1"/></joint></robot>"""


def test_a_mimic_chain_gives_the_same_mass_matrix_every_time() -> None:
    """Pinocchio 4.1's crba adds to what the data held before when joints mimic one another along a chain."""
    inertial = ('<inertial><origin xyz="0.1 0.05 0.2"/><mass value="1.5"/><inertia ixx="0.02" iyy="0.03" izz="0.025" '
                'ixy="0.001" ixz="0" iyz="0.002"/></inertial>')  # fmt: skip
    text = MIMICS.format(links="".join(f'<link name="{name}">{inertial}</link>' for name in "abcd"))
    follow, full = tl.load_robot(text, mimic=True), tl.load_robot(text)
    q, v = np.array([np.cos(0.4), np.sin(0.4), 0.7, -0.5]), np.array([0.5, -1.2, 0.8])
    whole_q, whole_v = np.r_[q[:3], -2 * q[2] + 0.3, q[3]], np.r_[v[:2], -2 * v[1], v[2]]
    coupling = np.array([[1.0, 0, 0], [0, 1, 0], [0, -2, 0], [0, 0, 1]])
    expected = coupling.T @ full.mass_matrix(whole_q) @ coupling
    for _ in range(3):
        close(follow.mass_matrix(q), expected, 1e-13)
        np.testing.assert_allclose(follow.energy(q, v), full.energy(whole_q, whole_v), rtol=1e-13)
        a = follow.forward_dynamics(q, v, [0.1, 0.2, 0.3], method="crba")
        close(follow.inverse_dynamics(q, v, a), np.array([0.1, 0.2, 0.3]), 1e-12)


BRANCHES = """<robot name="branches"><link name="base"/>{links}
<joint name="one" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
<limit lower="-9" upper="9" effort="1" velocity="1"/></joint>
<joint name="two" type="revolute"><parent link="base"/><child link="b"/><axis xyz="0 1 0"/>
<limit lower="-9" upper="9" effort="1" velocity="1"/><mimic joint="one" multiplier="1.7"/></joint>
<joint name="three" type="revolute"><parent link="b"/><child link="c"/><origin xyz="0 0.2 0"/><axis xyz="1 0 0"/>
<limit lower="-9" upper="9" effort="1" velocity="1"/></joint>
<joint name="four" type="revolute"><parent link="b"/><child link="d"/><origin xyz="0 0.2 0.1"/><axis xyz="0 0 1"/>
<limit lower="-9" upper="9" effort="1" velocity="1"/></joint></robot>"""


def test_two_branches_behind_a_mimic_joint_keep_their_couplings() -> None:
    """M(y) = G^T M(G y) G of the robot without mimic joints; Pinocchio 4.1's crba drops entries of it."""
    inertial = ('<inertial><origin xyz="0.1 0.05 0.2"/><mass value="1.5"/><inertia ixx="0.02" iyy="0.03" izz="0.025" '
                'ixy="0.001" ixz="0" iyz="0.002"/></inertial>')  # fmt: skip
    text = BRANCHES.format(links="".join(f'<link name="{name}">{inertial}</link>' for name in "abcd"))
    follow, full = tl.load_robot(text, mimic=True), tl.load_robot(text)
    coupling = np.zeros((4, 3))
    for joint, leader, factor in (("one", "one", 1), ("two", "one", 1.7), ("three", "three", 1), ("four", "four", 1)):
        column = next(j.v.start for j in follow.joints if j.name == leader)
        coupling[full.joint_names.index(joint), column] = factor
    rng = np.random.default_rng(1)
    for q, v, tau in rng.uniform(-2, 2, (5, 3, 3)):
        inertia = coupling.T @ full.mass_matrix(coupling @ q) @ coupling
        close(follow.mass_matrix(q), inertia, 1e-13)
        close(follow.mass_matrix(q[None], engine="compiled")[0], inertia, 1e-13)
        close(follow.energy(q, v)[0], v @ inertia @ v / 2, 1e-13)
        a = follow.forward_dynamics(q, v, tau, method="crba")
        close(follow.inverse_dynamics(q, v, a), tau, 1e-12)
        close(follow.momentum(q, v), full.momentum(coupling @ q, coupling @ v), 1e-13)
        frame = follow.frame_names[-1]
        close(follow.frame_jacobian(q, frame), full.frame_jacobian(coupling @ q, frame) @ coupling, 1e-13)
    with pytest.raises(QueryError, match="not available for mimic joints") as caught:
        follow.inverse_dynamics_derivatives(q, v, a)
    assert caught.value.code == "mimic-joints"


def test_free_fall_of_a_free_robot() -> None:
    """Whatever its shape, its centre of mass falls with g and nothing turns: a_root = (0, 0, -g, 0, 0, 0)."""
    robot = tl.load_robot("anymal", root="free")
    a = robot.forward_dynamics(robot.neutral, np.zeros(robot.nv), np.zeros(robot.nv))
    close(a, np.r_[0, 0, -9.81, np.zeros(robot.nv - 3)], 1e-11)


def test_many_threads_at_once(robot: tl.Robot) -> None:
    q, v, tau = states(robot, 200)
    expected = [robot.forward_dynamics(*state) for state in zip(q, v, tau, strict=True)]
    together = robot.forward_dynamics(q, v, tau)
    wrong: list[int] = []

    def work(offset: int) -> None:
        for i in range(offset, 200, 8):
            if not np.array_equal(robot.forward_dynamics(q[i], v[i], tau[i]), expected[i]):
                wrong.append(i)
        if not np.array_equal(robot.forward_dynamics(q, v, tau), together):
            wrong.append(-1)

    threads = [threading.Thread(target=work, args=(k,)) for k in range(8)]
    for t in threads:
        t.start()
    for t in threads:
        t.join()
    assert wrong == []


def test_strided_integer_and_list_arguments_are_read_rightly() -> None:
    robot = tl.load_robot("panda")
    table = np.arange(27.0).reshape(9, 3) / 10
    expected = robot.forward_dynamics(table[:, 0].copy(), table[:, 1].copy(), table[:, 2].copy())
    assert np.array_equal(robot.forward_dynamics(table[:, 0], table[:, 1], table[:, 2]), expected)
    assert np.array_equal(robot.forward_dynamics(*table.T.tolist()), expected)
    assert np.array_equal(robot.mass_matrix(np.ones(9, int)), robot.mass_matrix(np.ones(9)))
    reversed_rows = np.ascontiguousarray(table[::-1, 0])[::-1]
    assert np.array_equal(robot.forward_dynamics(reversed_rows, table[:, 1], table[:, 2]), expected)


def test_answers_are_the_callers_own() -> None:
    robot = tl.load_robot("two_link")
    zero = np.zeros(2)
    first = robot.forward_dynamics(zero, zero, zero)
    kept = first.copy()
    robot.forward_dynamics(zero + 1, zero + 1, zero)
    assert np.array_equal(first, kept)
    matrix, turning = robot.mass_matrix(zero), robot.coriolis(zero, zero + 1)
    copies = matrix.copy(), turning.copy()
    robot.mass_matrix(zero + 1), robot.coriolis(zero + 1, zero + 1)
    assert np.array_equal(matrix, copies[0])
    assert np.array_equal(turning, copies[1])


Z2, Z9 = [0.0, 0.0], np.zeros(9)
ERRORS = {
    "too long": (lambda r: r.bias([0, 0, 0], Z2), ["q: expected shape (..., 2), got (3,)"]),
    "transposed": (lambda r: r.bias(np.zeros((2, 5)), Z2), ["got (2, 5)", "transpose"]),
    "scalar": (lambda r: r.mass_matrix(1.0), ["expected shape (..., 2), got ()"]),
    "v": (lambda r: r.forward_dynamics(Z2, [1.0], Z2), ["v: expected shape (..., 2), got (1,)"]),
    "tau": (lambda r: r.forward_dynamics(Z2, Z2, [[1.0]]), ["tau: expected shape (..., 2), got (1, 1)"]),
    "a": (lambda r: r.inverse_dynamics(Z2, Z2, [np.nan, 0]), ["a: expected finite numbers, got nan at [0]"]),
    "NaN": (lambda r: r.forward_dynamics(np.array([0, np.nan]), np.zeros(2), np.zeros(2)), ["q", "nan at [1]"]),
    "NaN where M does not look": (lambda r: r.mass_matrix(np.array([np.nan, 0])), ["q", "nan at [0]"]),
    "inf": (lambda r: r.bias(np.zeros(2), np.array([0, np.inf])), ["v", "inf at [1]"]),
    "NaN in a batch": (lambda r: r.bias([[0, 0], [0, np.nan]], Z2), ["q", "nan at [1, 1]"]),
    "ragged": (lambda r: r.mass_matrix([[0, 0], [0]]), ["q: expected an array"]),
    "words": (lambda r: r.mass_matrix(["a", "b"]), ["q: expected real numbers"]),
    "None": (lambda r: r.bias(Z2, None), ["v: expected numbers, got None; give the array"]),
    "mask": (lambda r: r.mass_matrix(np.ma.masked_array([0.0, 1.0], [0, 1])), ["q", "mask"]),
    "complex": (lambda r: r.mass_matrix([1j, 0]), ["q: expected real numbers, got complex128"]),
    "batches": (lambda r: r.bias(np.zeros((3, 2)), np.zeros((4, 2))), ["do not broadcast", "(3, 2)", "(4, 2)"]),
    "method": (lambda r: r.forward_dynamics(Z2, Z2, Z2, method="abba"), ["method", "did you mean 'aba'"]),
    "f_ext frame": (lambda r: r.forward_dynamics(Z2, Z2, Z2, {"tpi": [0] * 6}), ["'tpi'", "mean 'tip'"]),
    "f_ext shape": (lambda r: r.forward_dynamics(Z2, Z2, Z2, {"tip": [0] * 3}), ["f_ext['tip']", "(..., 6)"]),
    "f_ext type": (lambda r: r.forward_dynamics(Z2, Z2, Z2, [0] * 6), ["f_ext: expected a mapping"]),
    "f_ext axes": (
        lambda r: r.forward_dynamics(Z2, Z2, Z2, {"tip": tl.Wrench([0] * 6, "body")}), ["'body' is unknown"]),
    "f_ext batch": (
        lambda r: r.forward_dynamics(np.zeros((3, 2)), Z2, Z2, {"tip": np.zeros((4, 6))}), ["do not broadcast"]),
    "overflow": (lambda r: r.forward_dynamics(Z2, [1e200, 0.0], Z2), ["not finite", "'two_link'"]),
    "overflow in a batch": (lambda r: r.bias(np.zeros((3, 2)), [[0, 0], [1e300, 0], [0, 0]]), ["state 1 of the batch"]),
}  # fmt: skip


@pytest.mark.parametrize("case", ERRORS)
def test_errors_name_the_argument_expected_and_got(case: str) -> None:
    call, parts = ERRORS[case]
    with pytest.raises(QueryError) as caught:
        call(tl.load_robot("two_link"))
    for part in parts:
        assert part in str(caught.value)


@pytest.mark.parametrize("batch", [(), (70,)])
@pytest.mark.parametrize(
    ("name", "entry", "words"),
    [
        ("anymal", slice(3, 7), "quaternion (x, y, z, w) of joint 'root_joint', entries 3:7"),
        ("kinova", slice(0, 2), "(cos, sin) of joint 'j2s6s200_joint_1', entries 0:2"),
    ],
)
def test_units_are_required_and_normalize_gives_them(name: str, entry: slice, words: str, batch: tuple) -> None:
    robot = tl.load_robot(name, root="free" if name == "anymal" else "fixed")
    q = np.tile(robot.neutral, (*batch, 1))
    v = np.zeros((*batch, robot.nv))
    q[..., entry] *= 1 + 1e-7
    for query in (robot.bias, lambda *x: robot.forward_dynamics(*x, v), lambda x, _: robot.mass_matrix(x)):  # type: ignore[call-arg]
        with pytest.raises(QueryError) as caught:
            query(q, v)
        assert words in str(caught.value)
        assert "1.0000001" in str(caught.value)
        assert np.isfinite(query(robot.normalize(q), v)).all()


def test_values_near_overflow_still_get_their_answer() -> None:
    """The quick finiteness check overflows at 1e160; the answer itself does not."""
    robot = tl.load_robot("two_link", gravity=(0, 0, 0))
    a = robot.forward_dynamics(np.zeros(2), np.zeros(2), np.array([1e160, 0.0]))
    np.testing.assert_allclose(a, 1e160 * robot.forward_dynamics(np.zeros(2), np.zeros(2), np.array([1.0, 0.0])))


def _in_a_child(n: int) -> list[float]:
    robot = tl.load_robot("panda")
    q, v = robot.random_state(n)
    return robot.forward_dynamics(q, v, v, engine="pinocchio").ravel().tolist()


def test_a_forked_child_answers_batches() -> None:
    """OpenMP's threads do not survive a fork: a child that waited for them would wait for ever."""
    here = _in_a_child(200)
    with multiprocessing.get_context("fork").Pool(2) as pool:
        there = pool.map_async(_in_a_child, [200, 200]).get(timeout=60)
    assert there == [here, here]  # bit for bit: the algorithm does not depend on the number of threads


@pytest.mark.parametrize("query", ["forward_dynamics", "inverse_dynamics"])
def test_pinocchios_threads_are_for_large_batches_and_change_no_bit(
    query: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """OpenMP's threads turn idly after each call: a loop of small batches would keep all cores busy for nothing."""
    algorithm, used = ALGORITHMS[query], list[int]()

    def parallel(threads: int, *arguments: object) -> None:
        used.append(threads)
        algorithm.parallel(threads, *arguments)

    monkeypatch.setitem(ALGORITHMS, query, dataclasses.replace(algorithm, parallel=parallel))
    monkeypatch.setenv("TWOLINK_THREADS", "2")
    robot = tl.load_robot("two_link")
    q, v = robot.random_state(5_000)
    many, few = (getattr(robot, query)(q[:n], v[:n], v[:n], engine="pinocchio") for n in (5_000, 4_999))
    assert used == [2, 1]
    assert np.array_equal(many[:-1], few)


@pytest.mark.parametrize("name", ["ur5", "bouncing_ball", "double_pendulum_continuous"])
def test_every_entry_of_a_state_is_looked_at(name: str) -> None:
    """Also where the answer does not depend on it, as a torque does not on the speed of a slider."""
    robot = tl.load_robot(name)
    q, v = (x[0] for x in robot.random_state(1, seed=0))
    for query, given in ((robot.forward_dynamics, (q, v, v)), (robot.inverse_dynamics, (q, v, v)),
                         (robot.mass_matrix, (q,)), (robot.bias, (q, v)), (robot.gravity_torque, (q,))):  # fmt: skip
        for place, value in itertools.product(range(len(given)), (np.nan, np.inf, -np.inf)):
            for i in range(len(given[place])):
                state = [x.copy() for x in given]
                state[place][i] = value
                with pytest.raises(QueryError):
                    query(*state)


@pytest.mark.parametrize(("name", "root", "places"), [("solo12", "free", [0, 1, 2]), ("crank_spring", "fixed", [1])])
@pytest.mark.parametrize("engine", ["pinocchio", "compiled"])
def test_equations_of_motion_do_not_depend_on_where_bases_are(
    name: str, root: Literal["fixed", "free"], places: list[int], engine: Literal["pinocchio", "compiled"]
) -> None:
    """In the world's axes the derivatives of solo12 would be off by 1e-3 at 100 km, and its batches by 4e-5."""
    robot = tl.load_robot(name, root=root)
    q, v = robot.random_state(70, seed=5)
    far, x = q.copy(), np.random.default_rng(0).normal(size=v.shape)
    far[:, places] += 1e5
    for query in (robot.forward_dynamics, robot.inverse_dynamics):
        np.testing.assert_array_equal(query(far, v, x, engine=engine), query(q, v, x, engine=engine))
        close(query(far[0], v[0], x[0]), query(q[0], v[0], x[0]))
    for derivatives in (robot.forward_dynamics_derivatives, robot.inverse_dynamics_derivatives):
        for some in (slice(None), 0):
            there, here = (derivatives(at[some], v[some], x[some], engine=engine) for at in (far, q))
            np.testing.assert_array_equal(there, here)
    for some in (slice(None), 0):
        np.testing.assert_array_equal(robot.coriolis(far[some], v[some]), robot.coriolis(q[some], v[some]))


@pytest.mark.parametrize("engine", ["auto", "pinocchio", "compiled"])
def test_a_robot_without_joints_has_no_motion_and_no_energy(engine: Literal["auto", "pinocchio", "compiled"]) -> None:
    robot, none = tl.load_robot("box", root="fixed"), np.zeros((2, 0))
    assert robot.forward_dynamics(none, none, none, engine=engine).shape == (2, 0)
    np.testing.assert_array_equal(robot.energy(none, none, engine=engine), np.zeros((2, 2)))
