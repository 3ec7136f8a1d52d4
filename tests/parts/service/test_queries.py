"""The service's answers are tl.Robot's, one state or many, by JSON and by npz."""

import io
import socket
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import twolink as tl
from tests.parts.service.serving import Served, packed
from tests.robots.test_bad_urdf import chain
from twolink.dynamics.queries import QUERIES
from twolink.parts.service.work.query_requests import STATES_IN_LOOP, answer_query

NPZ = {"Content-Type": "application/x-npz"}
DYNAMICS = "/v1/robots/two_link/forward-dynamics"
ROBOTS = ["two_link", "ur5", "kinova"]  # kinova has continuous joints
RNG = np.random.default_rng(5)


def states(robot: tl.Robot, *batch: int) -> dict[str, np.ndarray]:
    steps = RNG.uniform(-1, 1, (*batch, robot.nv)).reshape(-1, robot.nv)
    q = np.array([pin.integrate(robot.model, robot.neutral, step) for step in steps]).reshape(*batch, robot.nq)
    return {"q": robot.normalize(q), **{name: RNG.uniform(-1, 1, (*batch, robot.nv)) for name in ("v", "tau", "a")}}


@pytest.mark.parametrize("what", QUERIES)
@pytest.mark.parametrize("name", [name if name != "ur5" else pytest.param(name, marks=pytest.mark.slow)
                                  for name in ROBOTS])  # fmt: skip
def test_answers_are_those_of_the_robot(http: Served, name: str, what: str) -> None:
    robot = tl.load_robot(name)
    for batch in ((), (3,), (2, 40)):
        taken = {key: value for key, value in states(robot, *batch).items() if key in QUERIES[what].arguments}
        options = {"frame": robot.frame_names[-1]} if "frame" in QUERIES[what].options else {}
        expected = QUERIES[what].answer(robot, taken, "pinocchio", **options)
        path = f"/v1/robots/{name}/{what}"
        if len(batch) < 2:
            answer = http.ask(path, {key: value.tolist() for key, value in taken.items()} | options)
            got = {key: np.array(value) for key, value in answer.items()}
            assert set(got) == set(expected)
            for key, value in expected.items():
                assert np.array_equal(got[key], value), key  # to the last digit
        if options:  # an .npz archive holds numbers only
            continue
        answer = http.post(path, content=packed(**taken), headers=NPZ)
        assert answer.headers["content-type"] == "application/x-npz"
        loaded = np.load(io.BytesIO(answer.content))
        for key, value in expected.items():
            assert np.array_equal(loaded[key], value), key


def test_arguments_left_out_are_zero_and_leading_axes_broadcast(http: Served) -> None:
    robot = tl.load_robot("two_link")
    answer = http.ask("/v1/robots/two_link/forward-dynamics", {"q": [[0, 0], [1, 1]], "tau": [1, 0]})
    expected = robot.forward_dynamics([[0, 0], [1, 1]], [0, 0], [1, 0])
    np.testing.assert_allclose(answer["a"], expected, rtol=1e-12)


def test_wrenches_and_methods(http: Served) -> None:
    robot = tl.load_robot("two_link")
    q, v, tau, push = [0.1, 0.2], [0.3, 0.4], [1.0, 2.0], [1.0, 2.0, 3.0, 0.1, 0.2, 0.3]
    path = "/v1/robots/two_link/forward-dynamics"
    for method in ("aba", "crba"):
        body = {"q": q, "v": v, "tau": tau, "f_ext": {"tip": push}, "method": method}
        expected = robot.forward_dynamics(q, v, tau, {"tip": push}, method)
        np.testing.assert_allclose(http.ask(path, body)["a"], expected, rtol=1e-12)
    answer = http.post(path, content=packed(q=q, v=v, tau=tau, **{"f_ext.tip": push}), headers=NPZ)
    np.testing.assert_allclose(np.load(io.BytesIO(answer.content))["a"], expected)


def test_npz_is_answered_by_json_when_accepted(http: Served) -> None:
    headers = {**NPZ, "Accept": "application/json"}
    answer = http.ask("/v1/robots/two_link/bias", packed(q=np.zeros((2, 2))), headers=headers)
    assert np.shape(answer["h"]) == (2, 2)


def test_kinematics_places_links_as_pinocchio_does(http: Served) -> None:
    robot = tl.load_robot("kinova")
    q = states(robot, 4)["q"]
    answer = http.ask("/v1/robots/kinova/kinematics", {"q": q.tolist()})
    assert np.shape(answer["poses"]) == (4, len(answer["frames"]), 7)
    data = robot.model.createData()
    for row, poses in zip(q, answer["poses"], strict=True):
        pin.framesForwardKinematics(robot.model, data, row)
        for name, pose in zip(answer["frames"], poses, strict=True):
            at = data.oMf[robot.model.getFrameId(name, pin.FrameType.BODY)]
            assert pin.XYZQUATToSE3(np.array(pose)).isApprox(at, 1e-9)
    one = http.ask("/v1/robots/two_link/kinematics", {"q": [0, 0], "frames": ["tip"]})
    np.testing.assert_allclose(one["poses"], [[2, 0, 0, 0, 0, 0, 1]], atol=1e-12)
    none = http.ask("/v1/robots/two_link/kinematics", {"q": [0, 0], "frames": []})
    assert none == {"frames": [], "poses": []}


@pytest.mark.parametrize("third", ["tau", "a"])
def test_derivatives_are_those_of_the_robot(http: Served, third: str) -> None:
    robot = tl.load_robot("ur5")
    taken = {key: value for key, value in states(robot).items() if key in ("q", "v", third)}
    body = {key: value.tolist() for key, value in taken.items()}
    answer = http.ask("/v1/robots/ur5/derivatives", body)
    of, query = (("a", robot.forward_dynamics_derivatives) if third == "tau" else
                 ("tau", robot.inverse_dynamics_derivatives))  # fmt: skip
    for name, expected in zip(taken, query(*taken.values()), strict=True):
        assert np.array_equal(answer[f"d{of}_d{name}"], expected), name  # to the last digit


@pytest.mark.parametrize(("what", "body", "status", "where"), [
    ("forward-dynamics", b"{", 400, "body"),
    ("forward-dynamics", b'{"q": [0, "x"]}', 400, "q[1]"),
    ("forward-dynamics", b'{"q": [0, 0, 0]}', 422, "q"),
    ("forward-dynamics", b'{"q": [[0, 0], [0]]}', 422, "q"),
    ("forward-dynamics", b'{"q": [0, 0], "w": [0]}', 400, "body"),
    ("forward-dynamics", b'{"v": [0, 0]}', 400, "body"),
    ("forward-dynamics", b'{"q": [0, 0], "method": "magic"}', 422, "method"),
    ("forward-dynamics", b'{"q": [0, 0], "f_ext": {"nose": [0, 0, 0, 0, 0, 0]}}', 422, "f_ext"),
    ("forward-dynamics", b'{"q": [1e308, 1e308], "v": [1e308, 1e308]}', 422, "robot 'two_link'"),
    ("kinematics", b'{"q": [0, 0], "frames": ["nose"]}', 422, "frames"),
    ("derivatives", b'{"q": [0, 0], "tau": [0, 0], "a": [0, 0]}', 422, "a"),
    ("mass-matrix", b'{"q": [0, 0], "v": [0, 0]}', 400, "body"),
])  # fmt: skip
def test_problems_name_the_place(http: Served, what: str, body: bytes, status: int, where: str) -> None:
    problem = http.ask(f"/v1/robots/two_link/{what}", body, status)
    assert problem["status"] == status
    assert problem["where"].startswith(where)
    assert problem["detail"]
    assert problem["remedy"]
    assert "Traceback" not in str(problem)


def test_batches_too_large_are_refused_before_they_are_computed(http: Served) -> None:
    rows, columns = np.zeros((2000, 1, 2)), np.zeros((1, 2000, 2))
    problem = http.ask("/v1/robots/two_link/bias", packed(q=rows, v=columns), 413, headers=NPZ)
    assert "4000000 states" in problem["detail"]
    many = {"q": [[0, 0]] * 1000, "frames": ["tip"] * 10_000}
    http.ask("/v1/robots/two_link/kinematics", many, 413)
    limit = int(problem["remedy"].removeprefix("send up to ").removesuffix(" at once"))
    for count, status in ((limit, 200), (limit + 1, 413)):
        http.ask("/v1/robots/two_link/bias", packed(q=np.zeros((count, 2)), v=np.zeros(2)), status, headers=NPZ)


@pytest.mark.parametrize(("count", "engine"), [(100, "pinocchio"), (50_000, "compiled")])
def test_the_same_batch_has_the_same_bits_every_time(http: Served, count: int, engine: Any) -> None:
    robot = tl.load_robot("two_link")
    taken = {key: value for key, value in states(robot, count).items() if key != "a"}
    answers = set()
    for _ in range(4):  # before the function is compiled, and after; in different worker processes
        with ThreadPoolExecutor(2) as threads:
            sent = [threads.submit(http.post, DYNAMICS, content=packed(**taken), headers=NPZ) for _ in range(2)]
        answers |= {answer.result().content for answer in sent}
    (answer,) = answers
    a = np.load(io.BytesIO(answer))["a"]
    assert np.array_equal(a, robot.forward_dynamics(**taken, engine=engine))
    if count == 100:
        by_json = http.ask(DYNAMICS, {key: value.tolist() for key, value in taken.items()})
        assert np.array_equal(by_json["a"], a)


def test_nothing_is_traced_for_batches_that_the_event_loop_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise AssertionError("a program is traced")

    monkeypatch.setattr("twolink.dynamics.compiled.build", refuse)
    monkeypatch.setenv("TWOLINK_CACHE", "off")
    robot = tl.load_robot("two_link")
    for query in QUERIES.values():
        arguments = {name: np.zeros((STATES_IN_LOOP, 2)) for name in query.arguments}
        options = {"frame": "tip"} if "frame" in query.options else {}
        answer_query(robot, query, arguments | options, STATES_IN_LOOP)


def test_the_service_answers_while_it_computes_and_its_own_process_never_compiles(http: Served) -> None:
    http.post(DYNAMICS, content=packed(q=np.zeros((50_000, 2))), headers=NPZ)
    robot = http.ask("/v1/robots", chain(100, "revolute"))
    body = io.BytesIO()
    np.savez_compressed(body, q=np.zeros((20_000, 100)))  # 20 kB
    path = f"/v1/robots/{robot['id']}/forward-dynamics"
    with http.client() as other, ThreadPoolExecutor(1) as thread:
        batch = thread.submit(other.post, path, content=body.getvalue(), headers=NPZ)
        answered = 0
        while not batch.done():
            http.ask("/health")
            http.ask(DYNAMICS, {"q": [0, 0]})
            answered += 1
    assert batch.result().status_code == 200, batch.result().text
    assert answered >= 20  # a second or more, in which an event loop that waits answers once or twice
    libraries = Path(f"/proc/{http.process.pid}/maps").read_text()
    assert "pinocchio" in libraries


@pytest.mark.parametrize(("body", "status"), [
    (b'{"q": [0.1, 0.2], "v": [1, 2]}', b"200"),
    (b'{"q": [0.1, 0.2], "w": [1, 2]}', b"400"),
    (b'{"q": [0.1]}', b"422"),
])  # fmt: skip
def test_a_small_query_has_the_same_answer_however_it_arrives(http: Served, body: bytes, status: bytes) -> None:
    def head(more: bytes) -> bytes:
        return f"POST {DYNAMICS} HTTP/1.1\r\nHost: localhost\r\nX-Request-ID: mine\r\n".encode() + more + b"\r\n\r\n"

    length = b"Content-Length: %d" % len(body)
    whole = head(length) + body
    ways = {
        "whole": [whole],
        "in pieces": [head(length), body[:9], body[9:]],
        "announced": [head(length + b"\r\nExpect: 100-continue"), body],
        "in chunks": [head(b"Transfer-Encoding: chunked") + b"%x\r\n%b\r\n0\r\n\r\n" % (len(body), body)],
        "behind others": [b"GET /health HTTP/1.1\r\nHost: localhost\r\n\r\n" + 2 * whole],
        "last": [head(length + b"\r\nConnection: close") + body],
    }
    http.get("/v1/robots/two_link")  # it is loaded
    answers = {}
    for way, pieces in ways.items():
        with socket.create_connection(("127.0.0.1", http.base_url.port or 0), 20) as connection:
            for piece in pieces:
                connection.sendall(piece)
                time.sleep(0.05)
            connection.shutdown(socket.SHUT_WR)
            text = b"".join(iter(lambda: connection.recv(2**16), b""))
        lines = text[text.rindex(b"HTTP/1.1 ") :].splitlines()
        dropped = (b"date:", b"connection: close")
        answers[way] = sorted(line for line in lines if not line.startswith(dropped))
        assert lines[0].split()[1] == status, way
        assert b"x-request-id: mine" in lines
    for way, answer in answers.items():
        assert answer == answers["in chunks"], way
