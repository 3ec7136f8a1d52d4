"""Admission control: no client takes all of the connections, the memory or the turns, nor keeps what it cannot use."""

import asyncio
import contextlib
import functools
import json
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import uvicorn
from uvicorn.server import ServerState

from tests.parts.service.serving import Served, packed, serving, wait_until
from tests.parts.service.test_store import jobs_of, opened
from twolink.errors import TwolinkError
from twolink.parts.service.http.messages import send_answer
from twolink.parts.service.http.server import uvicorn_options
from twolink.parts.service.problems import Refusal
from twolink.parts.service.settings import Quotas, Settings, read_quotas
from twolink.parts.service.work.requests import prepare
from twolink.parts.service.work.sharing import REQUEST, SMALL, RequestMemory, Shares, Turns, client_of, this_request

pytestmark = pytest.mark.anyio
BIAS = "/v1/robots/two_link/bias"
HEAD = f"POST {BIAS} HTTP/1.1\r\nHost: localhost\r\n".encode()


# The parts


def test_a_client_may_hold_as_much_as_stays_free() -> None:
    shares = Shares(12)
    assert [shares.take("a") for _ in range(7)] == [True] * 6 + [False]
    assert [shares.take("b") for _ in range(4)] == [True] * 3 + [False]
    assert shares.take("c", 1)
    shares.give("a", 6)
    assert shares.taken == 4
    assert shares.take("b")
    assert not shares.take("c", 4)


@pytest.mark.parametrize("limit", [1, 2, 3, 4])
def test_as_many_clients_as_there_are_units_have_one_each(limit: int) -> None:
    shares = Shares(limit)
    assert [shares.take(f"client {k}") for k in range(limit + 1)] == [True] * limit + [False]
    shares.give("client 0")
    assert shares.take("another")


def test_networks_of_64_bits_are_one_client() -> None:
    assert client_of("2001:db8::1") == client_of("2001:db8::ffff:2%eth0") != client_of("2001:db8:0:1::1")
    assert client_of("10.0.0.1") != client_of("10.0.0.2")


def test_a_hold_says_whether_to_come_again() -> None:
    shares = Shares(10 * SMALL)
    first, second = RequestMemory(shares, "a"), RequestMemory(shares, "a")
    first.add(SMALL)  # not counted
    first.add(4 * SMALL)
    with pytest.raises(Refusal) as busy:
        second.add(2 * SMALL)
    with pytest.raises(Refusal) as never:
        second.add(6 * SMALL)
    assert (busy.value.status, never.value.status) == (503, 413)
    assert busy.value.retry_after
    first.keep(0)
    second.add(5 * SMALL)
    second.keep(0)
    assert shares.taken == 0


async def test_clients_have_turns_round_robin() -> None:
    done: list[str] = []

    async def task(turns: Turns, name: str) -> None:
        REQUEST.set(RequestMemory(Shares(1), name[0]))
        async with turns.turn():
            done.append(name)
            await asyncio.sleep(0)

    turns = Turns(1, 20)
    tasks = [asyncio.create_task(task(turns, name)) for name in ("a1", "a2", "a3", "a4", "b1", "b2", "c1")]
    await asyncio.sleep(0)
    tasks[2].cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    many = [asyncio.create_task(task(turns, "d")) for _ in range(13)]
    ends = await asyncio.gather(*many, return_exceptions=True)
    assert [isinstance(end, Refusal) for end in ends] == [False] * 11 + [True] * 2  # one at work, ten that wait
    assert turns._waiting.taken == 0
    await asyncio.wait_for(task(turns, "e"), 1)
    assert done[:6] == ["a1", "a2", "b1", "c1", "a4", "b2"]


async def test_jobs_are_run_by_client_in_turn_and_each_has_its_queue(tmp_path: Path) -> None:
    done, go = list[str](), asyncio.Event()

    async def run(*_: object, **__: object) -> dict[str, object]:
        await go.wait()
        done.append(this_request().client)
        return {}

    with opened(tmp_path) as store:
        jobs = jobs_of(store, run, jobs=1, queue=3)

        async def submit(client: str, number: int) -> None:
            REQUEST.set(RequestMemory(Shares(1), client))
            body = b'{"scene": "arm-swing", "wait": 0, "samples_per_second": %d}' % (1000 * ord(client) + number)
            await jobs.submit("simulation", prepare(kind="simulation", body=body))

        for number in range(4):
            await asyncio.create_task(submit("a", number))
        with pytest.raises(Refusal) as refused:
            await asyncio.create_task(submit("a", 4))
        assert refused.value.status == 429
        await asyncio.create_task(submit("b", 0))
        go.set()
        while len(done) < 5:
            await asyncio.sleep(0.01)
        assert done == ["a", "b", "a", "a", "a"]  # the first has run: time is shared, not turns
        while jobs.count("queued") + jobs.count("running"):
            await asyncio.sleep(0.01)
        await asyncio.create_task(submit("a", 5))
        await jobs.close()


def test_limits_that_no_request_could_meet_are_refused() -> None:
    for wrong in ("body_mb=200", "answer_mb=200", "memory_in_flight_mb=100"):
        with pytest.raises(TwolinkError, match="memory_in_flight_mb"):
            read_quotas([wrong])
    assert read_quotas(["body_mb=200", "memory_in_flight_mb=800"]).body_mb == 200


# A service with small limits

QUOTAS = {"connections": 60, "memory_in_flight_mb": 64, "body_mb": 16, "answer_mb": 16, "json_mb": 1, "rate_kb": 128}


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    options = [text for name, value in QUOTAS.items() for text in ("--quota", f"{name}={value}")]
    with serving(tmp_path_factory.mktemp("small"), *options) as running:
        yield running


def answer(connection: socket.socket) -> tuple[int, dict[str, object]]:
    """Status and problem of an answer that ends with the connection; 0 when there is none."""
    text = b""
    with contextlib.suppress(ConnectionError):
        while part := connection.recv(2**16):
            text += part
    head, _, body = text.partition(b"\r\n\r\n")
    return int(head.split()[1]) if head else 0, json.loads(body) if body else {}


@pytest.mark.parametrize(("request_", "status", "where"), [
    (HEAD + b"X: " + b"x" * 40_000, 431, "headers"),  # not even complete
    (HEAD + b"X: " + b"x" * 40_000 + b"\r\n\r\n", 431, "headers"),
    (HEAD + b"X: y\r\n" * 10_000 + b"\r\n", 431, "headers"),
    (HEAD + b"X: y\r\n" * 150 + b"\r\n", 431, "headers"),  # few bytes, but each takes as long as many
    (b"GET /" + b"x" * 10_000 + b" HTTP/1.1\r\nHost: localhost\r\n\r\n", 414, "URL"),
    (b"GET /" + b"x" * 40_000, 431, "headers"), (b"no HTTP\r\n\r\n", 400, "request"),
])  # fmt: skip
def test_headers_have_a_limit(small: Served, request_: bytes, status: int, where: str) -> None:
    with small.connect() as connection:
        connection.sendall(request_)
        got, problem = answer(connection)
    assert (got, problem["status"], problem["where"]) == (status, status, where)
    line = f" 127.0.0.1 - - - {status} "  # in the access log, though there is no request
    wait_until(lambda: any(line in text and problem["request_id"] in text for text in small.log.splitlines()))


def test_trailers_and_extensions_of_chunks_have_a_limit(small: Served) -> None:
    begin = HEAD + b'Transfer-Encoding: chunked\r\n\r\na\r\n{"q":[0,0]\r\n'
    with small.connect() as connection:
        connection.sendall(begin + b"1\r\n}\r\n0\r\nX: y\r\n\r\n")
        assert connection.recv(1000).startswith(b"HTTP/1.1 200")
    for last, endless in ((b"1\r\n}\r\n0\r\n", b"X: y\r\n" * 10_000), (b"1;", b"x" * 60_000)):
        with small.connect() as connection:
            connection.sendall(begin + last)
            with pytest.raises(ConnectionError):
                connection.sendall(1000 * endless)


def test_a_client_has_half_of_the_connections(small: Served) -> None:
    with contextlib.ExitStack() as stack:
        held = [stack.enter_context(small.connect()) for _ in range(40)]
        get = b"GET /health HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"
        with small.connect("127.0.0.2") as other:
            other.sendall(get)
            assert answer(other)[0] == 200
        refused = [answer(connection) for connection in held[30:]]
    assert {status for status, _ in refused} == {503}
    assert refused[0][1]["code"] == "busy"
    with small.connect() as later:  # they were given back
        later.sendall(get)
        assert answer(later)[0] == 200


async def connected(
    application: Any, folder: Path
) -> tuple[asyncio.StreamReader, asyncio.StreamWriter, asyncio.Server]:
    """A connection to an application on the service's protocol, which ends it where it is idle for 0.3 s."""
    options = uvicorn_options(Settings(str(folder), quotas=Quotas(body_seconds=0.1)))
    config = uvicorn.Config(application, **{**options, "timeout_keep_alive": 0.3, "lifespan": "off"})
    config.load()
    make = functools.partial(config.http_protocol_class, config=config, server_state=ServerState(), app_state={})  # type: ignore[call-arg]
    server = await asyncio.get_running_loop().create_server(make, "127.0.0.1", 0)
    return *await asyncio.open_connection(*server.sockets[0].getsockname()), server


async def test_a_connection_without_requests_is_closed(tmp_path: Path) -> None:
    async def application(_scope: Any, _receive: Any, send: Any) -> None:
        await send_answer(send, 204, (), b"")

    reader, writer, server = await connected(application, tmp_path)
    for _ in range(3):
        writer.write(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")
        assert (await reader.readuntil(b"\r\n\r\n")).startswith(b"HTTP/1.1 204")
        await asyncio.sleep(0.2)
    assert await asyncio.wait_for(reader.read(), 10) == b""
    writer.close()
    server.close()


async def test_a_request_behind_one_that_is_answered_at_once_is_not_idle(tmp_path: Path) -> None:
    class Application:
        def answer_now(self, *_: Any) -> tuple[bytes, bytes]:
            return b"", b""

        async def __call__(self, _scope: Any, _receive: Any, send: Any) -> None:
            await asyncio.sleep(0.6)
            await send_answer(send, 204, (), b"")

    reader, writer, server = await connected(Application(), tmp_path)
    request = b"%s / HTTP/1.1\r\nHost: localhost\r\n%s\r\n"
    writer.write(request % (b"POST", b"Content-Length: 2\r\n") + b"{}" + request % (b"GET", b""))
    for status in (b"HTTP/1.1 200", b"HTTP/1.1 204"):
        assert (await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), 10)).startswith(status)
    writer.close()
    server.close()


def test_many_pipelined_requests_end_the_connection(small: Served) -> None:
    with small.connect() as connection, contextlib.suppress(ConnectionError):
        connection.sendall(b"GET /metrics HTTP/1.1\r\nHost: localhost\r\n\r\n" * 3000)
        while connection.recv(2**16):
            pass
    small.ask("/health")
    assert "Traceback" not in small.log


@pytest.mark.slow
def test_bodies_that_do_not_arrive_are_limited_and_cut_off(small: Served) -> None:
    """Of a client at most half of the memory is kept for announced bodies, and not for long."""
    unfinished = HEAD + b"Content-Type: application/x-npz\r\nContent-Length: 7000000\r\n\r\nPK"
    with contextlib.ExitStack() as stack:
        held = [stack.enter_context(small.connect()) for _ in range(2)]
        for connection in held:
            connection.sendall(unfinished)
        body = packed(q=np.zeros((200_000, 2)))
        media = {"Content-Type": "application/x-npz"}
        wait_until(lambda: small.post(BIAS, content=body, headers=media).status_code == 503)
        busy = small.ask(BIAS, body, 503, headers=media)
        assert (busy["code"], busy["retry_after"] >= 1) == ("busy", True)
        small.ask(BIAS, {"q": [0, 0]})
        assert [answer(connection)[0] for connection in held] == [0, 0]  # before body_seconds are over
        small.ask(BIAS, body, headers=media)


@pytest.mark.slow
def test_an_answer_that_is_not_read_is_given_up(small: Served) -> None:
    path, body = "/v1/robots/panda/mass-matrix", packed(q=np.zeros((18_000, 9)))
    head = f"POST {path} HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/x-npz\r\n".encode()

    def asked() -> None:
        small.ask(path, body, headers={"Content-Type": "application/x-npz"})

    def in_flight() -> float:
        """The bytes of bodies and answers that the service has."""
        lines = small.get("/metrics").text.splitlines()
        return next(float(line.split()[1]) for line in lines if line.startswith("twolink_bytes_in_flight "))

    asked()
    with small.connect() as deaf:
        deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        deaf.sendall(head + b"Content-Length: %d\r\n\r\n" % len(body) + body)
        wait_until(lambda: in_flight() > 10e6)
        wait_until(lambda: in_flight() == 0, 20)
    asked()


@pytest.mark.slow
def test_json_has_a_limit_of_its_own(small: Served) -> None:
    assert small.ask(BIAS, b'{"q": [' + b"[0,0]," * 300_000 + b"[0,0]]}", 413)["where"] == "body"
    small.ask("/v1/scenes/validate", b" " * 1_500_000, 413)
