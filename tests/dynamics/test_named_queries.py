"""Queries by name, frames by theirs, and the number of threads that answers queries."""

import numpy as np
import pytest
from numpy.typing import ArrayLike

import twolink as tl
from tests.dynamics.states import close
from tests.refusals import refusal
from twolink.dynamics.queries import QUERIES, answer_query, query
from twolink.dynamics.threads import thread_count
from twolink.errors import QueryError


@pytest.fixture(scope="module")
def robot() -> tl.Robot:
    return tl.load_robot("two_link")


def test_a_method_that_does_not_apply_is_refused(robot: tl.Robot) -> None:
    with pytest.raises(QueryError, match="method: mass-matrix takes no method"):
        answer_query(robot, "mass-matrix", {"q": [0, 0]}, method="aba")
    found = answer_query(robot, "forward-dynamics", {"q": [0, 0]}, method="crba")
    assert np.array_equal(found["a"], robot.forward_dynamics([0, 0], [0, 0], [0, 0], method="crba"))


@pytest.mark.parametrize("text", ["\u00b2", "\u0663", "0", "-1", "1.5", "1025", "9" * 5000, "many"])
def test_malformed_thread_counts_are_refused(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TWOLINK_THREADS", text)
    with pytest.raises(QueryError, match="is not a number of threads; set it to 1 or more, up to 1024"):
        thread_count()


def test_thread_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    for text, count in (("1", 1), (" 7 ", 7), ("1024", 1024)):
        monkeypatch.setenv("TWOLINK_THREADS", text)
        assert thread_count() == count
    monkeypatch.setenv("TWOLINK_THREADS", "")
    assert thread_count() >= 1


def test_a_query_by_name_is_the_method_with_zeros_for_what_is_left_out(robot: tl.Robot) -> None:
    for what, asked in QUERIES.items():
        options = {x: given for x, given in (("frame", "tip"), ("axes", "local")) if x in asked.options}
        answers = answer_query(robot, what, {"q": [0.1, 0.2]}, **options)
        assert tuple(answers) == tuple(asked.results)
        direct = getattr(robot, asked.method)([0.1, 0.2], *[np.zeros(2)] * (len(asked.arguments) - 1), **options)
        for part, value in zip(direct if len(answers) > 1 else [direct], answers.values(), strict=True):
            assert np.array_equal(part, value), what
        for name, (shape, _) in asked.results.items():
            assert np.shape(answers[name]) == tuple(robot.nv if n == "nv" else n for n in shape), what
        assert asked.numbers(robot.nv) == sum(np.size(value) for value in answers.values()), what


def test_a_query_with_a_parameter_that_nobody_knows_is_refused_where_it_is_declared() -> None:
    def tinted(self: tl.Robot, q: ArrayLike, colour: str) -> ArrayLike:
        return q if colour else self.neutral

    with pytest.raises(TypeError, match="'colour' is not one of ARGUMENTS and OPTIONS"):
        query({"tinted": (("nv",), "rad")})(tinted)
    assert "tinted" not in QUERIES


def test_a_frame_query_wants_a_frame(robot: tl.Robot) -> None:
    with pytest.raises(QueryError, match=r"frame: it is not given; one of .*tip"):
        answer_query(robot, "frame-pose", {"q": [0, 0]})
    with pytest.raises(QueryError, match="axes: frame-pose takes no axes"):
        answer_query(robot, "frame-pose", {"q": [0, 0]}, frame="tip", axes="local")


def test_the_jacobian_of_one_joint_has_one_column() -> None:
    """Pinocchio returns a matrix of one column without its second axis."""
    robot = tl.load_robot("friction_pendulum")
    link = robot.frame_names[-1]
    q, v = robot.random_state(3)
    jacobian = robot.frame_jacobian(q, link)
    assert jacobian.shape == (3, 6, 1)
    assert robot.frame_jacobian(q[0], link, axes="local").shape == (6, 1)
    close((jacobian @ v[..., None])[..., 0], robot.frame_velocity(q, v, link))


@pytest.mark.parametrize("call", [
    lambda r: r.frame_pose(r.neutral, "tpi"), lambda r: r.frame_jacobian(r.neutral, "tpi"),
    lambda r: r.frame_velocity(r.neutral, np.zeros(2), "tpi"), lambda r: r.frame_pose(r.neutral, "tpi", "compiled"),
])  # fmt: skip
def test_an_unknown_frame_is_refused_with_the_nearest_name(call) -> None:
    with refusal(QueryError, "did you mean 'tip'", code="unknown-frame", argument="frame"):
        call(tl.load_robot("two_link"))


def test_frame_names_are_the_links() -> None:
    robot = tl.load_robot("panda")
    assert "panda_hand_tcp" in robot.frame_names
    assert len(set(robot.frame_names)) == len(robot.frame_names)
