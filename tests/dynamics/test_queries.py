"""Queries: identities of the equations of motion, batches, wrenches, threads, errors."""

import dataclasses
import itertools
import multiprocessing
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Literal

import numpy as np
import pytest

import twolink as tl
from tests.dynamics.states import close, states
from tests.refusals import refusal
from twolink.dynamics.queries import ALGORITHMS
from twolink.errors import QueryError

ROBOTS = {"two_link": "fixed", "panda": "fixed", "kinova": "fixed", "anymal": "free", "talos": "free"}


@pytest.fixture(scope="module", params=[name if name not in ("panda", "anymal") else
                                        pytest.param(name, marks=pytest.mark.slow) for name in ROBOTS])  # fmt: skip
def robot(request: pytest.FixtureRequest) -> tl.Robot:
    return tl.load_robot(request.param, root=ROBOTS[request.param])


def of_frames_and_bodies(robot: tl.Robot) -> list[tuple[Callable[..., Any], int]]:
    """Queries, and how many of q, v and a third vector each of them takes."""
    frame = robot.frame_names[-1]
    return [
        (robot.forward_dynamics, 3), (lambda *x: robot.forward_dynamics(*x, method="crba"), 3),
        (robot.inverse_dynamics, 3), (robot.bias, 2), (robot.coriolis, 2), (robot.mass_matrix, 1),
        (robot.gravity_torque, 1), (robot.energy, 2), (lambda q: robot.frame_pose(q, frame), 1),
        (lambda q: robot.frame_jacobian(q, frame), 1), (lambda q, v: robot.frame_velocity(q, v, frame), 2),
        (robot.centre_of_mass, 1), (robot.momentum, 2), (robot.forward_dynamics_derivatives, 3),
        (robot.inverse_dynamics_derivatives, 3),
    ]  # fmt: skip


def parts(answer: Any) -> list[np.ndarray]:
    """The arrays of an answer."""
    return [np.array(part) for part in (answer if isinstance(answer, tuple) else (answer,))]


def test_batches_broadcast_and_equal_single_states(robot: tl.Robot) -> None:
    state = states(robot, 6)
    for query, count in of_frames_and_bodies(robot):
        given = state[:count]
        shaped = [x.reshape(2, 3, -1) for x in given]
        single = [parts(query(*(x[i] for x in given))) for i in range(6)]
        from_lists = parts(query(*(x[0].tolist() for x in given)))
        wide = parts(query(shaped[0][:, :1], *shaped[1:]))  # one configuration, many velocities
        for k, batch in enumerate(parts(query(*shaped))):
            expected = np.array([each[k] for each in single])  # programs answer batches: the same to rounding
            tolerance = 1e-12 * np.abs(expected).max()
            np.testing.assert_allclose(batch.reshape(expected.shape), expected, rtol=0, atol=tolerance)
            assert np.array_equal(from_lists[k], expected[0])
            assert batch.shape[:2] == (2, 3)
            if count > 1:
                assert wide[k].shape[:2] == (2, 3)
                np.testing.assert_allclose(wide[k][0, 0], batch[0, 0], rtol=1e-14, atol=1e-13)


@pytest.mark.parametrize("name", ["two_link", "panda"])
def test_answers_are_the_callers_own(name: str) -> None:
    """Pinocchio returns views of its data; the next call must not change an earlier answer."""
    robot = tl.load_robot(name)
    state = states(robot, 2)
    for query, count in of_frames_and_bodies(robot):
        first = query(*(x[0] for x in state[:count]))
        copies = parts(first)
        query(*(x[1] for x in state[:count]))
        assert all(np.array_equal(x, copy) for x, copy in zip(parts(first), copies, strict=True))


def test_a_batch_of_wrenches_on_one_state() -> None:
    robot = tl.load_robot("two_link")
    wrenches = np.zeros((3, 6))
    wrenches[:, 2] = [0.0, 1.0, 2.0]
    tau = robot.inverse_dynamics([0.0, 0.0], [0.0, 0.0], [0.0, 0.0], {"tip": tl.Wrench(wrenches, axes="world")})
    # a force F upwards at the tip, 2 m and 1 m from the joints, takes 2 F and F off the holding torques
    np.testing.assert_allclose(tau[0] - tau, np.outer([0, 1, 2], [2.0, 1.0]), atol=1e-13)
    moved = robot.inverse_dynamics([0.0, 0.0], [0.0, 0.0], np.zeros((5, 1, 2)), {"tip": wrenches})
    assert moved.shape == (5, 3, 2)


def test_forward_dynamics_with_mimic_joints_is_answered_for_every_number_of_states() -> None:
    """By CRBA, or by a program; "aba" is refused for all alike."""
    follow, rng = tl.load_robot("panda", mimic=True), np.random.default_rng(2)
    q, v, tau = rng.uniform(-1, 1, (3, 8))
    for f_ext in (None, {"panda_hand": [1.0, 2.0, 3.0, 0.1, 0.2, 0.3]}):
        expected = follow.forward_dynamics(q, v, tau, f_ext, method="crba")
        for batch in ((), (1,), (7,), (600,)):
            given = {k: np.broadcast_to(x, (*batch, 8)) for k, x in (("q", q), ("v", v), ("tau", tau))}
            for engine in ("auto", "pinocchio"):
                found = follow.forward_dynamics(**given, f_ext=f_ext, engine=engine)
                close(found, np.broadcast_to(expected, (*batch, 8)), 1e-10)
            with pytest.raises(QueryError, match='cannot follow mimic joints; leave it out, or use method="crba"'):
                follow.forward_dynamics(**given, f_ext=f_ext, method="aba")


def test_many_threads_at_once(robot: tl.Robot) -> None:
    q, v, tau = states(robot, 200)
    expected = [robot.forward_dynamics(*state) for state in zip(q, v, tau, strict=True)]
    together, compiled = robot.forward_dynamics(q, v, tau), robot.compiled().inverse_dynamics(q, v, tau)

    def work(offset: int) -> None:
        for i in range(offset, 200, 8):
            assert np.array_equal(robot.forward_dynamics(q[i], v[i], tau[i]), expected[i])
        assert np.array_equal(robot.forward_dynamics(q, v, tau), together)
        for n in (1, 7, 64, 100, 199, 200):
            assert np.array_equal(robot.compiled().inverse_dynamics(q[:n], v[:n], tau[:n]), compiled[:n])

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(work, range(8)))


def test_strided_integer_and_list_arguments_are_read_rightly() -> None:
    robot = tl.load_robot("panda")
    table = np.arange(27.0).reshape(9, 3) / 10
    expected = robot.forward_dynamics(table[:, 0].copy(), table[:, 1].copy(), table[:, 2].copy())
    assert np.array_equal(robot.forward_dynamics(table[:, 0], table[:, 1], table[:, 2]), expected)
    assert np.array_equal(robot.forward_dynamics(*table.T.tolist()), expected)
    assert np.array_equal(robot.mass_matrix(np.ones(9, int)), robot.mass_matrix(np.ones(9)))
    reversed_rows = np.ascontiguousarray(table[::-1, 0])[::-1]
    assert np.array_equal(robot.forward_dynamics(reversed_rows, table[:, 1], table[:, 2]), expected)


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
    "mask of a batch": (lambda r: r.mass_matrix(np.ma.masked_array([Z2, [0.0, 1.0]], [Z2, [0, 1]])), ["q", "mask"]),
    "names": (lambda r: r.mass_matrix({"shoulder": 0.1}), ["q: expected real numbers", 'robot.by_joint("q", {...})']),
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
    "axes": (lambda r: r.frame_jacobian(Z2, "tip", axes="alined"), ["did you mean 'aligned'"]),
    "of bodies": (lambda r: r.centre_of_mass([0.0, 0.0, 0.0]), ["q: expected shape (..., 2)"]),
    "of momentum": (lambda r: r.momentum(Z2, [np.nan, 0.0]), ["v: expected finite numbers"]),
    "overflow of derivatives": (lambda r: r.inverse_dynamics_derivatives(Z2, [1e200] * 2, Z2), ["not finite"]),
    "overflow": (lambda r: r.forward_dynamics(Z2, [1e200, 0.0], Z2), ["not finite", "'two_link'"]),
    "overflow in a batch": (lambda r: r.bias(np.zeros((3, 2)), [[0, 0], [1e300, 0], [0, 0]]), ["state 1 of the batch"]),
}  # fmt: skip


@pytest.mark.parametrize("case", ERRORS)
def test_errors_name_the_argument_expected_and_got(case: str) -> None:
    call, parts = ERRORS[case]
    with refusal(QueryError, *parts):
        call(tl.load_robot("two_link"))


@pytest.mark.parametrize("batch", [(), (70,)])
@pytest.mark.parametrize(("name", "entry", "words"), [
    ("anymal", slice(3, 7), "quaternion (x, y, z, w) of joint 'root_joint', entries 3:7"),
    ("kinova", slice(0, 2), "(cos, sin) of joint 'j2s6s200_joint_1', entries 0:2"),
])  # fmt: skip
def test_units_are_required_and_normalize_gives_them(name: str, entry: slice, words: str, batch: tuple) -> None:
    robot = tl.load_robot(name, root="free" if name == "anymal" else "fixed")
    q = np.tile(robot.neutral, (*batch, 1))
    v = np.zeros((*batch, robot.nv))
    q[..., entry] *= 1 + 1e-7
    for query in (robot.bias, lambda *x: robot.forward_dynamics(*x, v), lambda x, _: robot.mass_matrix(x)):  # type: ignore[call-arg]
        with refusal(QueryError, words, "1.0000001"):
            query(q, v)
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
@pytest.mark.parametrize("engine", ["auto", "compiled"])
def test_every_entry_of_a_state_is_looked_at(name: str, engine: str) -> None:
    """Also where the answer does not depend on it, as a torque does not on the speed of a slider."""
    robot = tl.load_robot(name)
    q, v = (x[0] for x in robot.random_state(1, seed=0))
    for query, given in ((robot.forward_dynamics, (q, v, v)), (robot.inverse_dynamics, (q, v, v)),
                         (robot.mass_matrix, (q,)), (robot.bias, (q, v)), (robot.gravity_torque, (q,))):  # fmt: skip
        for place, value in itertools.product(range(len(given)), (np.nan, np.inf, -np.inf)):
            for i in range(len(given[place])):
                state = [x.copy() for x in given]
                state[place][i] = value
                with pytest.raises(QueryError, match="expected"):
                    query(*state, engine=engine)


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
    assert robot.forward_dynamics(np.zeros((5, 0)), [], [], engine=engine).shape == (5, 0)
    assert robot.mass_matrix([], engine=engine).shape == (0, 0)
    assert robot.bias(np.zeros((0, 0)), [], engine=engine).shape == (0, 0)
    np.testing.assert_array_equal(robot.energy(none, none, engine=engine), np.zeros((2, 2)))
