"""The client against servers that are busy, slow, broken, or of somebody else."""

import io
import json
import socket
import threading
from collections.abc import Callable
from email.utils import formatdate
from typing import Any

import numpy as np
import pytest

import twolink as tl
from tests.parts.service.fake_server import JSON, PROBLEM, Request, fake, http, problem
from twolink.dynamics.queries import QUERIES
from twolink.dynamics.robot_record import robot_record
from twolink.errors import QueryError, TwolinkError
from twolink.parts.service.client import Client
from twolink.parts.service.remote_robot import RemoteRobot
from twolink.parts.service.store.archives import NPZ, write_npz
from twolink.parts.service.transport import Transport

ROBOT = tl.load_robot("two_link")
ABOUT = {"id": "two_link", **robot_record(ROBOT)}
LISTED = http(200, [ABOUT])
Q, V = np.array([0.1, 0.2]), np.array([0.3, 0.4])


@pytest.mark.parametrize("url", [
    None, 7, "",
    "http://", "ftp://x", "http://h:99999", "http://h:x", "http://h:-1", "http://[::1", "http://[::1]x", "::1",
    "http://user:word@h", "http://a b", "http://h/?q=1", "http://h/#x", "http://" + "a" * 70, "http://a..b",
])  # fmt: skip
def test_an_address_that_is_none_is_refused(url: Any) -> None:
    with pytest.raises(TwolinkError, match="is not an address") as caught:
        tl.connect(url)
    assert caught.value.argument == "url"


@pytest.mark.parametrize(("url", "host", "port"), [
    ("h", "h", 80), ("[::1]", "::1", 80), ("https://h/twolink/", "h", 443), ("[fe80::1]:7", "fe80::1", 7),
])  # fmt: skip
def test_an_address_has_its_port(url: str, host: str, port: int) -> None:
    transport = Transport(url, None, 1.0)
    assert (transport._parts.hostname, transport._port) == (host, port)


@pytest.mark.parametrize(("argument", "value"), [
    *(("token", text) for text in ("a b", "a\nb", "ü", "\0", 7)),
    *(("timeout", seconds) for seconds in (0, -1, float("nan"), float("inf"), "x", None)),
])  # fmt: skip
def test_a_token_that_cannot_be_sent_and_a_timeout_that_is_none_are_refused(argument: str, value: Any) -> None:
    with pytest.raises(TwolinkError) as caught:
        tl.connect("h", **{argument: value})
    assert caught.value.argument == argument
    assert argument != "token" or str(value) not in str(caught.value)  # it is a secret


def test_tokens_paths_and_versions_of_ip() -> None:
    token = "a%/=+~:\"'{}"
    for family in (socket.AF_INET, socket.AF_INET6):
        with fake(LISTED, family=family) as server:
            assert tl.connect(f"{server.url}/below/it/", token=token).robots()[0]["nv"] == 2
            assert server.requests[0].path == "/below/it/v1/robots"
            assert server.requests[0].headers["authorization"] == f"Bearer {token}"
    for arguments in (("GET", "/a b\r\nx: y"), ("GET", "/ü"), ("G\nET", "/"), ("GET", "/", None, "a/b\r\nx: y")):
        with pytest.raises(TwolinkError, match="cannot be sent"):
            tl.connect("h").request(*arguments)


CALLS: dict[str, Callable[[Client], object]] = {
    "robots": lambda client: client.robots(),
    "robot": lambda client: client.robot("two_link"),
    "upload": lambda client: client.upload("<robot/>"),
    "simulate": lambda client: client.simulate("arm-swing"),
    "single": lambda client: RemoteRobot(client._transport, ABOUT).bias(Q, V),
    "batch": lambda client: RemoteRobot(client._transport, ABOUT).bias([Q], [V]),
    "frame": lambda client: RemoteRobot(client._transport, ABOUT).frame_pose([Q], "tip"),
}
FOREIGN = {
    "page": http(200, b"<html>", "text/html"),
    "page called JSON": http(200, b"<html>"),
    "number": http(200, 7),
    "null": http(200, None),
    "other object": http(200, {"ok": True}),
    "list of numbers": http(200, [1, 2]),
    "texts": http(200, {"h": "x", "id": 3, "state": []}),
    "other media": http(200, [ABOUT], "text/plain"),
    "no arrays": http(200, b"PK\5\6" + bytes(18), NPZ),
    "cut arrays": http(200, write_npz({"h": np.zeros((1, 2))})[:-30], NPZ),
    "pickle": http(200, b"\x80\x04N.", NPZ),
    "elsewhere": http(301, b"", "text/html", "Location: https://elsewhere/"),
    "proxy": http(502, b"<html>bad gateway", "text/html"),
    "other problem": http(404, {"message": "no"}),
    "problem without a code": http(404, {**problem(404, "x"), "code": ""}, PROBLEM),
    "odd status": http(999, problem(999, "strange"), PROBLEM),
    "problem with arguments": http(
        422, problem(422, "robot-error", data={"what": 1, "where": 2, "run": 3, "status": 4, "self": 5}), PROBLEM
    ),
    "cut": lambda _, connection: (connection.sendall(LISTED[:-20]), b"")[1],
    "cut headers": b"HTTP/1.1 200 X\r\nContent-Type: appl",
    "another protocol": b"SSH-2.0-OpenSSH_9.6\r\n",
    "bad status line": b"HTTP/1.1 abc\r\n\r\n",
    "bad chunks": b"HTTP/1.1 200 X\r\nTransfer-Encoding: chunked\r\n\r\nxyz\r\n",
    "long header": b"HTTP/1.1 200 X\r\nA: " + b"a" * 70_000 + b"\r\n\r\n",
    "many headers": b"HTTP/1.1 200 X\r\n" + b"a: b\r\n" * 200 + b"\r\n",
    "nothing": b"",
    "too few numbers": http(200, {"h": [[1, 2]] * 3, "R": 1, "p": 1}),
}


@pytest.mark.parametrize("name", FOREIGN)
def test_whatever_answers_it_is_an_error_of_twolink(name: str) -> None:
    with fake(FOREIGN[name]) as server:
        client = server.client()
        for call in CALLS.values():
            with pytest.raises(TwolinkError) as caught:
                call(client)
            assert caught.value.remedy or name in ("odd status", "problem with arguments")
        client.close()


@pytest.mark.parametrize("size", [0, 1, 2**14, 2**14 + 1, 10**6])
def test_bodies_arrive_whole(size: int) -> None:
    with fake(LISTED) as server:
        client = server.client()
        for body in (bytes(size), b"again" * size):
            client.request("POST", "/v1/robots", body)
            assert server.requests[-1].body == body


def test_where_nobody_answers() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    for url in (f"http://127.0.0.1:{port}", "http://no.such.name.invalid", f"https://127.0.0.1:{port}"):
        with pytest.raises(TwolinkError, match="twolink serve") as caught:
            tl.connect(url, timeout=10).robots()
        assert caught.value.code == "no-answer"
    with fake(LISTED) as plain, pytest.raises(TwolinkError, match="no answer"):
        tl.connect(plain.url.replace("http:", "https:"), timeout=10).robots()


def dripping(content: bytes, gate: threading.Event) -> Callable[[Request, socket.socket], bytes]:
    """An answer byte by byte: each comes well within the timeout, all of them do not."""

    def answer(_: Request, connection: socket.socket) -> bytes:
        for k in range(len(content)):
            connection.sendall(content[k : k + 1])
            if gate.wait(0.02):
                break
        return b""

    return answer


@pytest.mark.parametrize("start", [0, LISTED.index(b"\r\n\r\n") + 4])
def test_a_timeout_is_one_of_the_whole_request(start: int) -> None:
    """The server takes some 20 s in all, and never longer than 0.02 s between two bytes."""
    gate = threading.Event()
    slow = http(200, [ABOUT], JSON, "X-Filling: " + "x" * 1000)

    def answer(request: Request, connection: socket.socket) -> bytes:
        connection.sendall(slow[:start])
        return dripping(slow[start:], gate)(request, connection)

    with fake(answer) as server:
        with pytest.raises(TwolinkError, match=r"no answer within 0\.3 s") as caught:
            server.client(0.3).robots()
        gate.set()
    assert caught.value.code == "no-answer"
    assert len(server.requests) == 1


def test_a_timeout_is_not_tried_again_on_other_connections() -> None:
    gate = threading.Event()

    def silent(_: Request, __: socket.socket) -> bytes:
        gate.wait(20)
        return b""

    barrier = threading.Barrier(4)

    def together(_: Request, __: socket.socket) -> bytes:
        barrier.wait(20)
        return LISTED

    with fake(*[together] * 4, silent) as server:
        client = server.client()
        threads = [threading.Thread(target=client.robots) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        client._transport.timeout = 0.3
        assert len(client._transport._idle) == 4
        with pytest.raises(TwolinkError, match="no answer within"):
            client.robots()
        gate.set()
        assert len(server.requests) == 5


@pytest.mark.parametrize("after", ["0", "0.01", formatdate(0, usegmt=True)])
@pytest.mark.parametrize("status", [429, 503])
def test_a_busy_service_is_asked_again_when_it_says_so(status: int, after: str) -> None:
    busy = http(status, problem(status, "busy"), PROBLEM, f"Retry-After: {after}")
    with fake(busy, busy, http(200, {"h": [1, 2]})) as server:
        answer = RemoteRobot(server.client()._transport, ABOUT).bias(Q, V)
        np.testing.assert_array_equal(answer, [1, 2])
        assert len(server.requests) == 3
        assert server.connections == 1


@pytest.mark.parametrize("after", ["", "Retry-After: 3600", "Retry-After: nan", "Retry-After: soon"])
def test_a_busy_service_that_names_no_time_in_reach_is_not_asked_again(after: str) -> None:
    refusal = problem(503, "busy", retry_after=3600)
    with fake(http(503, refusal, PROBLEM, *([after] if after else []))) as server:
        with pytest.raises(TwolinkError, match="so it is") as caught:
            server.client(5).robots()
        assert (caught.value.code, caught.value.retry_after) == ("busy", 3600)
        assert len(server.requests) == 1


def test_only_what_is_safe_is_sent_twice() -> None:
    """The service reads a request on a kept connection, and closes it without an answer."""
    with fake(LISTED, b"", LISTED) as server:
        client = server.client()
        client.robots()
        assert client.robots()[0]["id"] == "two_link"
        assert len(server.requests) == 3
    with fake(LISTED, b"", LISTED) as server:
        client = server.client()
        client.robots()
        with pytest.raises(TwolinkError, match="no answer"):
            client.request("POST", "/v1/robots", b"{}")
        assert len(server.requests) == 2
    with fake(b"", LISTED) as server:  # a new connection is no reason to try again
        with pytest.raises(TwolinkError, match="no answer"):
            server.client().robots()
        assert len(server.requests) == 1


def test_a_connection_that_was_closed_meanwhile_is_not_used() -> None:
    """What was never sent may be sent on another connection, whatever it is."""
    with fake(LISTED) as server:
        client = server.client()
        client.robots()
        client._transport._idle[-1].sock.shutdown(socket.SHUT_RDWR)
        client.request("POST", "/v1/robots", b"{}")
        assert (len(server.requests), server.connections) == (2, 2)


def limited(most: int, counts: list[int]) -> Callable[[Request, socket.socket], bytes]:
    """Answers bias, frame-pose and inverse-dynamics of at most so many states at once, by a local robot."""

    def answer(request: Request, _: socket.socket) -> bytes:
        what, sent = request.path.rpartition("/")[2], request.headers["content-type"]
        arrays = dict(np.load(io.BytesIO(request.body))) if sent == NPZ else json.loads(request.body)
        frame = arrays.pop("frame", None)
        wrench = {name.removeprefix("f_ext."): arrays.pop(name) for name in list(arrays) if "." in name}
        values = [np.asarray(value) for value in arrays.values()]
        shape = np.broadcast_shapes(*(value.shape[:-1] for value in (*values, *wrench.values())))
        if np.prod(shape) > most:
            return http(413, problem(413, "content-too-large"), PROBLEM)
        counts.append(int(np.prod(shape)))
        if what == "frame-pose":
            pose = ROBOT.frame_pose(values[0], frame)
            return http(200, {"R": pose[0].tolist(), "p": pose[1].tolist()})
        name = what.replace("-", "_")
        result = getattr(ROBOT, name)(*values, **({"f_ext": wrench} if wrench else {}))
        return http(200, write_npz({next(iter(QUERIES[what].results)): result}), NPZ)

    return answer


def test_batches_go_in_parts_that_the_service_takes() -> None:
    rng = np.random.default_rng(4)
    q, v, a = rng.uniform(-1, 1, (7, 1, 2)), rng.uniform(-1, 1, (1, 6, 2)), rng.uniform(-1, 1, 2)
    wrench = {ROBOT.frame_names[-1]: rng.uniform(-1, 1, (6, 6))}
    counts: list[int] = []
    with fake(limited(10, counts)) as server:
        there = RemoteRobot(server.client()._transport, ABOUT)
        np.testing.assert_allclose(there.bias(q, v), ROBOT.bias(q, v), rtol=1e-13)
        assert sum(counts) == 42
        assert max(counts) - min(counts) <= 1
        refused = len(server.requests) - len(counts)
        counts.clear()
        np.testing.assert_allclose(there.bias(q, v), ROBOT.bias(q, v), rtol=1e-13)
        assert len(server.requests) - refused == 2 * len(counts)  # it remembers how many there may be
        expected = ROBOT.inverse_dynamics(q, v, a, wrench)
        np.testing.assert_allclose(there.inverse_dynamics(q, v, a, wrench), expected, rtol=1e-13)
        for one, other in zip(there.frame_pose(q, "forearm"), ROBOT.frame_pose(q, "forearm"), strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-13)
            assert one.shape == other.shape
        assert there.bias(np.empty((0, 2)), np.empty((0, 2))).shape == (0, 2)
    with fake(limited(0, counts)) as server, pytest.raises(TwolinkError, match="so it is"):
        RemoteRobot(server.client()._transport, ABOUT).bias(q, v)  # not even one state: no endless loop


def test_large_batches_are_split_before_they_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("twolink.parts.service.remote_robot._PART", 32 * 50)
    counts: list[int] = []
    q = np.random.default_rng(5).uniform(-1, 1, (120, 2))
    with fake(limited(10**6, counts)) as server:
        there = RemoteRobot(server.client()._transport, ABOUT)
        np.testing.assert_allclose(there.bias(q, q), ROBOT.bias(q, q), rtol=1e-13)
    assert counts == [40, 40, 40]


def test_arguments_are_checked_as_those_of_a_local_robot() -> None:
    there = RemoteRobot(Transport("h", None, 1.0), ABOUT)
    for arguments in (
        ([0, 0, 0], V), (["a", "b"], V), ([np.nan, 0], V), ([[np.inf, 0]], V), (0.0, V), ([[0], [0, 1]], V), (None, V),
    ):  # fmt: skip
        with pytest.raises(QueryError) as here:
            ROBOT.bias(*arguments)
        with pytest.raises(QueryError) as remote:
            there.bias(*arguments)
        assert str(remote.value) == str(here.value)
    with pytest.raises(QueryError, match="f_ext"):
        there.inverse_dynamics(Q, V, V, np.zeros(6))
    for wrong in (float("nan"), np.float64("inf"), object()):
        with pytest.raises(QueryError, match="cannot be sent"):
            tl.connect("h").simulate("arm-swing", accuracy=wrong)
