"""Compiled dynamics: the same answers as Pinocchio, certified before they are used, refused where they differ."""

import inspect
import threading
from typing import Any

import numpy as np
import pytest

import twolink as tl
from tests.command import printed_by
from tests.dynamics.states import close, states
from tests.refusals import refusal
from twolink.algorithms import functions
from twolink.dynamics import compiled, kernels
from twolink.dynamics.certificates import certify
from twolink.dynamics.compiled import Compiled
from twolink.dynamics.queries import ALGORITHMS
from twolink.dynamics.threads import do_all
from twolink.errors import CertificationError, QueryError
from twolink.lagrange.check import arm_urdf
from twolink.native import machine

ROBOTS = {"two_link": "fixed", "ur5": "fixed", "panda": "fixed", "kinova": "fixed", "anymal": "free"}


@pytest.fixture(scope="module", params=ROBOTS)
def robot(request: pytest.FixtureRequest) -> tl.Robot:
    return tl.load_robot(request.param, root=ROBOTS[request.param])


def test_signatures_are_those_of_the_robot() -> None:
    for name, method in vars(Compiled).items():
        if name in ALGORITHMS or f"{name}_local" in ALGORITHMS:
            own, robots = inspect.signature(method).parameters, inspect.signature(getattr(tl.Robot, name)).parameters
            expected = [name for name in robots if name not in ("engine", "method")]
            assert list(own) == [*expected, "parameters"], name
            assert all(own[key].default == robots[key].default for key in expected), name


def test_shapes_broadcast_and_layouts_are_kept(robot: tl.Robot) -> None:
    q, v, w = states(robot, 6)
    fast = robot.compiled()
    rows = fast.forward_dynamics(q, v, w)
    assert rows.flags.c_contiguous
    columns = fast.forward_dynamics(*(np.ascontiguousarray(x.T).T for x in (q, v, w)))
    assert columns.T.flags.c_contiguous
    assert np.array_equal(rows, columns)
    assert np.array_equal(fast.forward_dynamics(q[2], v[2], w[2]), rows[2])
    assert np.array_equal(fast.forward_dynamics(q[2].tolist(), v[2].tolist(), w[2].tolist()), rows[2])
    shaped = fast.forward_dynamics(q.reshape(2, 3, -1), v.reshape(2, 3, -1), w.reshape(2, 3, -1))
    assert np.array_equal(shaped.reshape(6, -1), rows)
    close(fast.bias(q[0], v), robot.bias(np.tile(q[0], (6, 1)), v, engine="pinocchio"))
    assert fast.mass_matrix(np.tile(q[:, None], (1, 2, 1))).shape == (6, 2, robot.nv, robot.nv)
    assert fast.energy(q[0], v[0])[0].shape == ()
    assert fast.forward_dynamics(q[:0], v[:0], w[:0]).shape == (0, robot.nv)


def test_one_array_may_stand_for_several_arguments() -> None:
    robot = tl.load_robot("two_link")
    columns = np.random.default_rng(3).uniform(-1, 1, (2, 50)).T
    assert np.array_equal(robot.compiled().bias(columns, columns), robot.compiled().bias(columns, columns.copy()))


def test_fields_of_packed_records_are_read_rightly() -> None:
    """Rows 20 bytes apart, of numbers whose misread bytes are numbers too."""
    robot = tl.load_robot("two_link")
    q = states(robot, 500)[0].astype(np.float32).astype(float)
    records = np.zeros(500, [("id", np.int32), ("q", float, 2)])
    records["q"] = q
    close(robot.mass_matrix(records["q"]), robot.mass_matrix(q, engine="pinocchio"))


def test_batches_of_every_size_give_the_same_bits() -> None:
    """Chunks, remainders of the vector width and threads do not change an answer."""
    robot = tl.load_robot("ur5")
    q, v, w = (np.tile(x, (3_000, 1)) for x in states(robot, 7))
    whole = robot.compiled().forward_dynamics(q, v, w)
    assert np.array_equal(whole, np.tile(whole[:7], (3_000, 1)))
    for n in (1, 2, 3, 5, 8, 257, 1_000, 4_099):
        assert np.array_equal(robot.compiled().forward_dynamics(q[:n], v[:n], w[:n]), whole[:n])


@pytest.mark.parametrize("axes", ["frame", "world"])
def test_wrenches(axes: str) -> None:
    robot = tl.load_robot("panda")
    q, v, w = states(robot, 5)
    rng = np.random.default_rng(3)
    wrenches = {name: tl.Wrench(rng.uniform(-5, 5, (5, 6)), axes) for name in ("panda_link3", "panda_hand_tcp")}
    for query in ("forward_dynamics", "inverse_dynamics"):
        ours = getattr(robot.compiled(), query)(q, v, w, wrenches)
        close(ours, getattr(robot, query)(q, v, w, wrenches, engine="pinocchio"), 1e-10)
    one = {"panda_hand_tcp": tl.Wrench(np.ones(6), axes)}
    assert robot.forward_dynamics(q[0], v[0], w[0], one, engine="compiled").shape == (9,)


def test_parameters_are_the_robots_with_these_values() -> None:
    """Every state of the batch is its own arm; the truth is each arm's own URDF."""
    rng = np.random.default_rng(4)
    n = 30
    length, m1, m2, g = rng.uniform(0.5, 2, (4, n))
    names = ["elbow.origin.x", "upper_arm.mass", "upper_arm.com.x", "upper_arm.inertia.yy", "forearm.mass",
             "forearm.inertia.yy", "gravity.z"]  # fmt: skip
    many = tl.load_robot(arm_urdf(1, 1, 1, 1)).compiled(parameters=names)
    values = {"elbow.origin.x": length, "upper_arm.com.x": length / 2, "upper_arm.mass": m1,
              "upper_arm.inertia.yy": m1 * length**2 / 12, "forearm.mass": m2, "forearm.inertia.yy": m2 / 12,
              "gravity.z": -g}  # fmt: skip
    q, v, w = rng.uniform(-2, 2, (3, n, 2))
    accelerations = many.forward_dynamics(q, v, w, parameters=values)
    inertias = many.mass_matrix(q, parameters=values)
    for i in range(n):
        one = tl.load_robot(arm_urdf(length[i], 1, m1[i], m2[i]), gravity=(0, 0, -g[i]))
        close(accelerations[i], one.forward_dynamics(q[i], v[i], w[i]), 1e-11)
        close(inertias[i], one.mass_matrix(q[i]))
    nominal = many.forward_dynamics(q, v, w)
    close(nominal, tl.load_robot(arm_urdf(1, 1, 1, 1)).forward_dynamics(q, v, w), 1e-11)
    moon = many.forward_dynamics(q[0], v[0], w[0], parameters={"gravity.z": -1.62})
    close(moon, tl.load_robot(arm_urdf(1, 1, 1, 1), gravity=(0, 0, -1.62)).forward_dynamics(q[0], v[0], w[0]), 1e-11)


def test_unknown_parameters_are_refused() -> None:
    robot = tl.load_robot("two_link")
    with pytest.raises(QueryError, match=r"did you mean 'forearm\.mass'"):
        robot.compiled(parameters=["forarm.mass"])
    with pytest.raises(QueryError, match="not kept as a parameter"):
        robot.compiled().gravity_torque([0, 0], parameters={"forearm.mass": 2})
    kept = robot.compiled(parameters=["forearm.mass"])
    with pytest.raises(QueryError, match="finite"):
        kept.gravity_torque([0.0, 0.0], parameters={"forearm.mass": np.nan})
    for wrong in (np.ones(3), [1.0, 2.0], 5):
        with pytest.raises(QueryError, match="parameters: expected a mapping of name to value"):
            kept.gravity_torque([0.0, 0.0], parameters=wrong)
    with pytest.raises(QueryError, match="rows of different lengths"):
        kept.gravity_torque([0.0, 0.0], parameters={"forearm.mass": [1.0, [2.0, 3.0]]})
    with pytest.raises(QueryError, match="cannot be compiled"):
        functions.function(robot.model, "forward_dynamic")


BAD = {
    "NaN in q": ([[np.nan, 0.0]] * 20, np.zeros((20, 2)), "q: expected finite numbers, got nan at [0, 0]"),
    "inf in v": (np.zeros((20, 2)), [[0.0, np.inf]] * 20, "v: expected finite numbers, got inf at [0, 1]"),
    "shape": (np.zeros((20, 3)), np.zeros((20, 2)), "q: expected shape (..., 2), got (20, 3)"),
    "batches": (np.zeros((20, 2)), np.zeros((19, 2)), "do not broadcast"),
}


@pytest.mark.parametrize("layout", ["rows", "columns"])
@pytest.mark.parametrize("case", BAD)
def test_compiled_functions_refuse_bad_arguments(case: str, layout: str) -> None:
    q, v, message = BAD[case]
    arrays = [np.array(q, dtype=float), np.array(v, dtype=float)]
    if layout == "columns":
        arrays = [np.ascontiguousarray(a.T).T for a in arrays]
    with refusal(QueryError, message):
        tl.load_robot("two_link").bias(*arrays, engine="compiled")


def test_angles_of_many_turns_are_answered() -> None:
    """Sines of single angles are as exact at any of them; the sum of two is rounded, in both engines alike."""
    robot = tl.load_robot("two_link")
    q = np.array([[0.1, 0.2], [3e6, 1.0], [1e9, 0.0], [-1e12, 0.0]])
    close(robot.gravity_torque(q, engine="compiled"), robot.gravity_torque(q, engine="pinocchio"), 1e-14)
    near = np.array([[9.9e5, 1.0], [-9.9e5, 2.0]])
    close(robot.gravity_torque(near, engine="compiled"), robot.gravity_torque(near, engine="pinocchio"), 1e-14)


def test_a_wrong_function_is_not_certified() -> None:
    """A kernel of a robot that weighs 1e-9 more must not pass for this one's."""
    right, wrong = tl.load_robot(arm_urdf(1, 1, 3, 1)), tl.load_robot(arm_urdf(1, 1, 3 + 3e-9, 1))
    for name in ("forward_dynamics", "inverse_dynamics", "mass_matrix", "gravity_torque", "energy"):
        made = functions.function(right.model, name)
        certify(right, made, kernels.build(right.model, made))
        with pytest.raises(CertificationError, match="the compiled function differs from the reference"):
            certify(right, made, kernels.build(wrong.model, made))


def test_certificates_state_the_comparison() -> None:
    certificate = tl.load_robot("ur5").compiled().certificate("forward_dynamics")
    assert certificate.states >= 96
    assert 0 < certificate.worst < certificate.bound
    for part in ("forward_dynamics", "96 states against the reference", "native library", "operations"):
        assert part in str(certificate)


# Engines, refusals, threads.


@pytest.mark.slow
def test_a_failed_certificate_leaves_the_query_on_pinocchio(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise CertificationError("it differs", where="here")

    monkeypatch.setattr(compiled, "certify", refuse)
    robot = tl.load_robot("two_link")
    q = np.zeros((900_000, 2))
    with pytest.warns(RuntimeWarning, match="it differs"):
        a = robot.bias(q, q)
    assert np.array_equal(a[0], robot.bias(q[0], q[0]))
    with pytest.raises(CertificationError):
        robot.bias(q[:9], q[:9], engine="compiled")


def test_engines() -> None:
    robot = tl.load_robot("two_link")
    with pytest.raises(QueryError, match="did you mean 'compiled'"):
        robot.bias([0, 0], [0, 0], engine="compile")
    zero = np.zeros(2)
    for query in (lambda e: robot.forward_dynamics(zero, zero, zero, engine=e), lambda e: robot.mass_matrix(zero, e)):
        with pytest.raises(QueryError, match="did you mean 'pinocchio'"):
            query("pinochio")
    single = robot.forward_dynamics(np.zeros(2), np.zeros(2), np.zeros(2), engine="compiled")
    close(single, robot.forward_dynamics(np.zeros(2), np.zeros(2), np.zeros(2)))


def test_without_the_native_library_queries_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    """By Pinocchio, and by NumPy where programs are asked for; the same to rounding. Also derivatives and frames."""
    robot = tl.load_robot("two_link")
    q, v = robot.random_state(50)
    expected = robot.bias(q, v, engine="compiled")
    for module in ("dynamics.robot", "native.machine", "dynamics.certificates"):
        monkeypatch.setattr(f"twolink.{module}.library", lambda: None)
    monkeypatch.setenv("TWOLINK_CACHE", "off")
    without = tl.load_robot("two_link")
    assert np.array_equal(without.bias(q, v), robot.bias(q, v, engine="pinocchio"))
    close(without.bias(q, v, engine="compiled"), expected, 1e-14)
    q, v = without.random_state(2_000)
    assert without.forward_dynamics_derivatives(q, v, v)[0].shape == (2_000, 2, 2)
    assert without.frame_jacobian(q, "tip").shape == (2_000, 6, 2)


def test_the_environment_does_without_compiled_code() -> None:
    """Every scene and query works without the native library."""
    code = ("import twolink as tl\n"
            "run = tl.simulate(tl.load_scene('bouncing-ball'), 0.6, accuracy=1e-4)\n"
            "print(bool(run.cost.compiled), run.bound)")  # fmt: skip
    assert printed_by(code, TWOLINK_NATIVE="0").split() == ["False", "verified"]


def test_the_threads_setting_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = tl.load_robot("two_link")
    rows, used = np.zeros((400_000, 2)), set[int]()

    def run(*arguments: Any) -> None:
        used.add(threading.get_ident())
        answer(*arguments)

    answer = machine.Program.run
    monkeypatch.setattr(machine.Program, "run", run)
    for threads in (1, 2):
        monkeypatch.setenv("TWOLINK_THREADS", str(threads))
        used.clear()
        robot.bias(rows, rows, engine="compiled")
        assert 1 <= len(used) <= threads


def test_tasks_are_shared_by_so_many_threads() -> None:
    """Each task waits until all three have begun."""
    barrier = threading.Barrier(3)
    do_all(range(3), lambda _: barrier.wait(20), 3)
    assert not barrier.broken
    with pytest.raises(ZeroDivisionError):
        do_all(range(2), lambda n: 1 / n, 2)
