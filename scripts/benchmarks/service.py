"""The service measured against a bare ASGI application on the same uvicorn, in the same run, on this machine.

    python -m scripts.benchmarks.service [--seconds 3] [--rounds 3] [--requests 100000]

Single states: POST forward-dynamics of the two-link arm by JSON, at 1, 16 and 64 connections, bare and service in turn;
the servers on one core, the load on another, requests/s and latencies of the median round. The bare application reads
the body and answers a constant. Batches: forward dynamics of 100,000 Panda states by npz through tl.connect, 1,000 by
JSON, end to end: packing, sending, computing, sending back, unpacking. Memory: the resident set of the service after a
tenth of the requests and after all of them.
"""

import asyncio
import contextlib
import http.client
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import msgspec
import numpy as np
import uvloop

import twolink as tl
from scripts.runner import TOP, Table, options, print_bars, seconds_of

BODY = b'{"q": [0.1, 0.2], "v": [0.3, 0.4], "tau": [1.0, 0.0]}'
PATH = "/v1/robots/two_link/forward-dynamics"
CONNECTIONS = (1, 16, 64)
MIN_RATIO, MAX_P99, MIN_STATES, MAX_GROWTH = 0.35, 5.0, 1e6, 0.02  # p99 in ms
BARE = ["-c", "from scripts.benchmarks.service import serve_bare; serve_bare()"]
SERVE = ["-m", "twolink", "serve", "--port", "0", "--log", "off", "--data"]


async def bare(scope: Any, receive: Any, send: Any) -> None:
    """An ASGI application that does nothing: the cost of uvicorn alone."""
    message = await receive()
    while scope["type"] == "lifespan":
        await send({"type": f"{message['type']}.complete"})
        if message["type"] == "lifespan.shutdown":
            return
        message = await receive()
    headers = [(b"content-type", b"application/json"), (b"content-length", b"15")]
    await send({"type": "http.response.start", "status": 200, "headers": headers})
    await send({"type": "http.response.body", "body": b'{"a":[1.0,2.0]}'})


def serve_bare() -> None:
    """Serve the bare application with the service's own options."""
    import uvicorn

    from twolink.parts.service.http.server import uvicorn_options
    from twolink.parts.service.settings import Settings

    config = uvicorn.Config(bare, port=0, **uvicorn_options(Settings(data="unused")))
    socket = config.bind_socket()
    print(f"serves http://127.0.0.1:{socket.getsockname()[1]}/", flush=True)
    uvicorn.Server(config).run(sockets=[socket])


@contextlib.contextmanager
def server(command: list[str], core: int | None = None) -> Iterator[tuple[int, int]]:
    """A server process while it is needed, on one of the cores if `core` is its number: its port and process id."""
    pinned = [] if core is None else ["taskset", "-c", str(core)]
    command = [*pinned, sys.executable, *command]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=TOP) as process:
        try:
            line = process.stdout.readline() if process.stdout else ""
            address = re.search(r"http://[\d.]+:(\d+)/", line)
            if address is None:
                raise SystemExit(f"the server did not start: {line!r}")
            yield int(address.group(1)), process.pid
        finally:
            process.terminate()


async def _requests(port: int, connections: int, seconds: float, requests: int) -> list[float]:
    """Send requests over some connections until the time or their number is used up; the seconds of each."""
    head = f"POST {PATH} HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
    request = f"{head}Content-Length: {len(BODY)}\r\n\r\n".encode() + BODY
    taken: list[float] = []
    end = time.perf_counter() + seconds

    async def connection() -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        while time.perf_counter() < end and len(taken) < requests:
            start = time.perf_counter()
            writer.write(request)
            answer = await reader.readuntil(b"\r\n\r\n")
            length = re.search(rb"content-length: (\d+)", answer)
            if b" 200 " not in answer[:16] or length is None:
                raise SystemExit(f"not answered: {answer!r}")
            await reader.readexactly(int(length.group(1)))
            taken.append(time.perf_counter() - start)
        writer.close()

    await asyncio.gather(*(connection() for _ in range(connections)))
    return taken


def load(served: tuple[int, int], connections: int, seconds: float, requests: int = 10**9) -> tuple[float, ...]:
    """What requests take: requests/s, p50 and p99 [ms], and the server's CPU time a request [us]."""
    port, pid = served
    before, start = _cpu_seconds(pid), time.perf_counter()
    taken = np.array(uvloop.run(_requests(port, connections, seconds, requests)))
    rate = len(taken) / (time.perf_counter() - start)
    return rate, *(1e3 * np.quantile(taken, (0.5, 0.99))), 1e6 * (_cpu_seconds(pid) - before) / len(taken)


def _cpu_seconds(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def single_states(seconds: float, rounds: int, data: str) -> Table:
    """A row for each number of connections, with the medians of bare and service, measured in turn."""
    print("single states by JSON: requests/s, p50 and p99 in ms, the server's CPU time a request in us")
    each = "{0}, 1/s >8.0f | p50 {0} >7.2f | p99 {0} >7.2f | CPU {0} >7.0f"
    table = Table(f"connections >11 | {each.format('bare')} | {each.format('service')} | ratio >6.2f")
    cores = sorted(os.sched_getaffinity(0))
    os.sched_setaffinity(0, cores[-1:])  # the load is not where the servers are
    with server(BARE, cores[0]) as bare_server, server([*SERVE, data], cores[0]) as service:
        load(service, 16, 3.0)  # loads the robot; worker processes start meanwhile
        for connections in CONNECTIONS:
            pairs = [[load(one, connections, seconds) for one in (bare_server, service)] for _ in range(rounds)]
            cells = [median(column) for measured in zip(*pairs, strict=True) for column in zip(*measured, strict=True)]
            table.add(connections, *cells, median(ours[0] / alone[0] for alone, ours in pairs))
    os.sched_setaffinity(0, cores)
    return table


def batches(rounds: int, port: int) -> tuple[float, float]:
    """States/s end to end, by npz and by JSON."""
    rng = np.random.default_rng(1)
    robot = tl.connect(f"http://127.0.0.1:{port}").robot("panda")
    connection = http.client.HTTPConnection("127.0.0.1", port)

    def by_json(**arrays: np.ndarray) -> np.ndarray:
        body = msgspec.json.encode(arrays, enc_hook=np.ndarray.tolist)
        connection.request("POST", "/v1/robots/panda/forward-dynamics", body, {"Content-Type": "application/json"})
        return np.array(msgspec.json.decode(connection.getresponse().read())["a"])

    rates = []
    for ask, count in ((robot.forward_dynamics, 100_000), (by_json, 1000)):
        arrays = {key: rng.uniform(-1, 1, (count, 9)) for key in ("q", "v", "tau")}
        if ask(**arrays).shape != (count, 9):
            raise SystemExit("an answer of another shape")
        rates.append(count / seconds_of(partial(ask, **arrays), rounds=max(9, rounds), warm_up=0)[0])
    return rates[0], rates[1]


def memory(requests: int, served: tuple[int, int]) -> list[float]:
    """The service's resident set [MB] after a tenth of the requests, and after all of them."""
    sizes = []
    for count in (requests // 10, requests):
        load(served, 16, 1e6, count)
        found = re.search(r"VmRSS:\s+(\d+) kB", Path(f"/proc/{served[1]}/status").read_text())
        sizes.append(int(found.group(1)) / 1024 if found else float("nan"))
    return sizes


def main() -> int:
    given = options(__doc__, seconds=3.0, rounds=3, requests=100_000)
    with tempfile.TemporaryDirectory() as data:
        rows = single_states(given.seconds, given.rounds, data).rows
        with server([*SERVE, data]) as served:
            npz, json = batches(given.rounds, served[0])
            sizes = memory(given.requests, served)
    print(f"batches of Panda states: {npz:,.0f} states/s by npz, {json:,.0f} by JSON")
    growth = sizes[1] / sizes[0] - 1
    print(f"memory: {sizes[0]:.1f} MB, {sizes[1]:.1f} MB after {given.requests:,} requests ({growth:+.1%})")
    p99 = next(row[7] for row in rows if row[0] == 16)
    met = print_bars([
        (min(row[-1] for row in rows) >= MIN_RATIO, f"ratio at least {MIN_RATIO}"),
        (p99 < MAX_P99, f"p99 below {MAX_P99:g} ms at 16"),
        (npz >= MIN_STATES, f"at least {MIN_STATES:,.0f} states/s by npz"),
        (growth < MAX_GROWTH, "no growth"),
    ])  # fmt: skip
    return 0 if met else 1


if __name__ == "__main__":
    raise SystemExit(main())
