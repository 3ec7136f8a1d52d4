"""The engine rule: the same call gives the same bits, whatever was asked before, in every process."""

import hashlib
from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.command import printed_by
from tests.dynamics.states import close, states
from twolink.dynamics.engine import compiled_from

QUERIES = ("forward_dynamics", "inverse_dynamics", "mass_matrix", "bias", "gravity_torque", "energy")


def arguments(robot: tl.Robot, query: str, n: int) -> list[np.ndarray]:
    q, v, w = (np.resize(x, (n, x.shape[1])) for x in states(robot, 50))
    return [q, v, w][: {"mass_matrix": 1, "gravity_torque": 1, "bias": 2, "energy": 2}.get(query, 3)]


@pytest.mark.parametrize("query", QUERIES)
def test_the_engine_changes_at_the_size_of_the_rule(query: str) -> None:
    robot = tl.load_robot("two_link")
    size = compiled_from(query, robot.nv)
    states_ = arguments(robot, query, size)
    ask = getattr(robot, query)
    small = [x[: size - 1] for x in states_]
    assert np.array_equal(ask(*small), ask(*small, engine="pinocchio"))
    assert np.array_equal(ask(*states_), ask(*states_, engine="compiled"))
    close(np.array(ask(*states_)), np.array(ask(*states_, engine="pinocchio")), 1e-11)


def test_programs_answer_all_batches_where_tracing_is_quick() -> None:
    """And from larger batches where it takes long, the larger the robot."""
    assert [compiled_from("forward_dynamics", nv) for nv in (0, 2, 7, 30)] == [1, 1, 1, 1]
    assert all(np.diff([compiled_from("forward_dynamics_derivatives", nv) for nv in (12, 32, 64)]) > 0)
    assert compiled_from("frame_pose:tip", 0) == 1


def test_earlier_calls_do_not_change_the_bits() -> None:
    robot = tl.load_robot("two_link")
    q, v, w = arguments(robot, "forward_dynamics", 500)
    first = robot.forward_dynamics(q, v, w)
    size = compiled_from("forward_dynamics", robot.nv)
    for _ in range(3):
        robot.forward_dynamics(*arguments(robot, "forward_dynamics", size))
        assert np.array_equal(robot.forward_dynamics(q, v, w), first)


SCRIPT = """
import hashlib, sys
import numpy as np
import twolink as tl
robot = tl.load_robot("two_link")
q, v = robot.random_state(int(sys.argv[1]))
digest = hashlib.sha256()
for n in map(int, sys.argv[2:]):
    digest.update(np.ascontiguousarray(robot.forward_dynamics(q[:n], v[:n], v[:n])).tobytes())
print(digest.hexdigest())
"""


def test_two_processes_give_the_same_bits(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """One with a kernel on disk and two threads, one with an empty cache and one thread, and this one."""
    robot = tl.load_robot("two_link")
    size = compiled_from("forward_dynamics", robot.nv)
    sizes = (1, 5, 63, 64, 1_000, size - 1, size, size + 3)
    q, v = robot.random_state(max(sizes))
    digest = hashlib.sha256()
    for n in sizes:
        digest.update(np.ascontiguousarray(robot.forward_dynamics(q[:n], v[:n], v[:n])).tobytes())
    for threads, cache in (("2", None), ("1", tmp_path)):
        monkeypatch.setenv("TWOLINK_THREADS", threads)
        if cache:
            monkeypatch.setenv("TWOLINK_CACHE", str(cache))
        assert printed_by(SCRIPT, *map(str, (max(sizes), *sizes))).strip() == digest.hexdigest()
