"""The service measured against a bare ASGI application on the same uvicorn, in the same run, on this machine.

    python scripts/bench_service.py [--seconds 3] [--rounds 3] [--requests 100000] [--json]

Single states: POST forward-dynamics of the two-link arm by JSON, at 1, 16 and 64 connections, bare and ours in turn;
the servers on one core, the load on another, requests/s and latencies of the median round. The bare application reads
the body and answers a constant. Batches: forward dynamics of 100,000 Panda states by npz through tl.connect, 1,000 by
JSON, end to end: packing, sending, computing, sending back, unpacking. Memory: the resident set of the service after a
tenth of the requests and after all of them.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import http.client
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from typing import Any

import msgspec
import numpy as np

import twolink as tl

BODY = b'{"q": [0.1, 0.2], "v": [0.3, 0.4], "tau": [1.0, 0.0]}'
PATH = "/v1/robots/two_link/forward-dynamics"
CONNECTIONS = (1, 16, 64)
WANTED = {"ratio": 0.35, "p99": 5e-3, "states": 1e6, "growth": 0.02}


async def bare(scope: Any, receive: Any, send: Any) -> None:
    """An ASGI application that does nothing: what uvicorn alone takes."""
    if scope["type"] == "lifespan":
        while (message := await receive())["type"] != "lifespan.shutdown":
            await send({"type": f"{message['type']}.complete"})
        await send({"type": "lifespan.shutdown.complete"})
        return
    await receive()
    body = b'{"a":[1.0,2.0]}'
    headers = [(b"content-type", b"application/json"), (b"content-length", b"15")]
    await send({"type": "http.response.start", "status": 200, "headers": headers})
    await send({"type": "http.response.body", "body": body})


def serve_bare() -> None:
    """Serve the bare application with the service's own options."""
    import uvicorn

    from twolink.service.server import uvicorn_options
    from twolink.service.settings import Settings

    config = uvicorn.Config(bare, **{**uvicorn_options(Settings(data="")), "port": 0})
    socket = config.bind_socket()
    print(f"serves http://127.0.0.1:{socket.getsockname()[1]}/", flush=True)
    uvicorn.Server(config).run(sockets=[socket])


@contextlib.contextmanager
def server(command: list[str], cpu: int | None) -> Iterator[tuple[int, int]]:
    """A server process while it is needed: its port and its process id."""
    pin = ["taskset", "-c", str(cpu)] if cpu is not None else []
    process = subprocess.Popen([*pin, sys.executable, *command], stdout=subprocess.PIPE, text=True)
    try:
        line = process.stdout.readline() if process.stdout else ""
        found = re.search(r"http://[\d.]+:(\d+)/", line)
        if found is None:
            raise SystemExit(f"the server did not start: {line!r}")
        yield int(found.group(1)), process.pid
    finally:
        process.terminate()
        process.wait(20)


async def _connection(port: int, request: bytes, until: float, most: list[int], taken: list[float]) -> None:
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    while time.perf_counter() < until and most[0] > 0:
        most[0] -= 1
        start = time.perf_counter()
        writer.write(request)
        head = await reader.readuntil(b"\r\n\r\n")
        length = re.search(rb"content-length: (\d+)", head)
        if b" 200 " not in head[:16] or length is None:
            raise SystemExit(f"not answered: {head!r}")
        await reader.readexactly(int(length.group(1)))
        taken.append(time.perf_counter() - start)
    writer.close()


async def _load(port: int, connections: int, seconds: float, requests: int) -> list[float]:
    head = f"POST {PATH} HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
    request = f"{head}Content-Length: {len(BODY)}\r\n\r\n".encode() + BODY
    taken: list[float] = []
    until, most = time.perf_counter() + seconds, [requests]
    await asyncio.gather(*(_connection(port, request, until, most, taken) for _ in range(connections)))
    return taken


def load(port: int, connections: int, seconds: float, cpu: int | None, requests: int = 10**9) -> dict[str, float]:
    """Requests for so many seconds from a process of its own: requests/s, p50 and p99 [s]."""
    pin = ["taskset", "-c", str(cpu)] if cpu is not None else []
    arguments = ["--load", str(port), str(connections), str(seconds), str(requests)]
    done = subprocess.run([*pin, sys.executable, __file__, *arguments], capture_output=True, text=True, check=True)
    found: dict[str, float] = json.loads(done.stdout)
    return found


def _print_load(port: int, connections: int, seconds: float, requests: int) -> None:
    import uvloop

    start = time.perf_counter()
    taken = np.array(uvloop.run(_load(port, connections, seconds, requests)))
    rate = len(taken) / (time.perf_counter() - start)
    print(json.dumps({"rate": rate, "p50": np.quantile(taken, 0.5), "p99": np.quantile(taken, 0.99)}))


def single_states(seconds: float, rounds: int, data: str) -> list[dict[str, float]]:
    """A row for each number of connections: bare and ours in turn."""
    cpus = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []
    ours_on, load_on = (cpus[0], cpus[-1]) if len(cpus) > 1 else (None, None)
    rows = []
    with (
        server([__file__, "--bare"], ours_on) as bare_one,
        server(["-m", "twolink", "serve", "--port", "0", "--data", data], ours_on) as our_one,
    ):
        load(our_one[0], 16, 3.0, load_on)  # loads the robot; worker processes start meanwhile
        for connections in CONNECTIONS:
            found = [
                [_measured(one, connections, seconds, load_on) for one in (bare_one, our_one)] for _ in range(rounds)
            ]
            row: dict[str, float] = {"connections": connections}
            for k, name in enumerate(("bare", "ours")):
                for what in ("rate", "p50", "p99", "cpu"):
                    row[f"{name}_{what}"] = median(pair[k][what] for pair in found)
            row["ratio"] = median(ours["rate"] / alone["rate"] for alone, ours in found)
            rows.append(row)
    return rows


def _measured(served: tuple[int, int], connections: int, seconds: float, cpu: int | None) -> dict[str, float]:
    """A load, and the server's own CPU seconds a request, which other work on the machine hardly changes."""
    port, pid = served
    before = _cpu_seconds(pid)
    found = load(port, connections, seconds, cpu)
    return {**found, "cpu": (_cpu_seconds(pid) - before) / (found["rate"] * seconds)}


def _cpu_seconds(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def batches(rounds: int, port: int) -> dict[str, float]:
    """States/s end to end, by npz and by JSON."""
    rng = np.random.default_rng(1)
    robot = tl.connect(f"http://127.0.0.1:{port}").robot("panda")
    connection = http.client.HTTPConnection("127.0.0.1", port)

    def by_npz(arrays: dict[str, np.ndarray]) -> Any:
        return robot.forward_dynamics(**arrays)

    def by_json(arrays: dict[str, np.ndarray]) -> Any:
        body = msgspec.json.encode({name: value.tolist() for name, value in arrays.items()})
        connection.request("POST", "/v1/robots/panda/forward-dynamics", body, {"Content-Type": "application/json"})
        return np.array(msgspec.json.decode(connection.getresponse().read())["a"])

    rates = {}
    for name, ask, count in (("npz", by_npz, 100_000), ("json", by_json, 1000)):
        arrays = {key: rng.uniform(-1, 1, (count, 9)) for key in ("q", "v", "tau")}
        ask(arrays)  # compiles, once
        taken = []
        for _ in range(max(9, rounds)):
            start = time.perf_counter()
            a = ask(arrays)
            taken.append(time.perf_counter() - start)
        if a.shape != (count, 9):
            raise SystemExit(f"{name}: {a.shape}")
        rates[name] = count / median(taken)
    return rates


def _resident(pid: int) -> float:
    """The resident set of a process, MB."""
    found = re.search(r"VmRSS:\s+(\d+) kB", Path(f"/proc/{pid}/status").read_text())
    return int(found.group(1)) / 1024 if found else float("nan")


def memory(requests: int, port: int, pid: int) -> dict[str, float]:
    """The service's memory [MB] after a tenth of the requests, and after all of them."""
    load(port, 16, 1e6, None, requests // 10)
    before = _resident(pid)
    load(port, 16, 1e6, None, requests)
    return {"requests": requests, "before": before, "after": _resident(pid)}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--requests", type=int, default=100_000)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--bare", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--load", nargs=4, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.bare:
        serve_bare()
    elif given.load:
        port, connections, seconds, requests = given.load
        _print_load(int(port), int(connections), float(seconds), int(requests))
    else:
        _report(given)


def _report(given: argparse.Namespace) -> None:
    with tempfile.TemporaryDirectory() as data:
        rows = single_states(given.seconds, given.rounds, data)
        with server(["-m", "twolink", "serve", "--port", "0", "--data", data], None) as (port, pid):
            rates = batches(given.rounds, port)
            kept = memory(given.requests, port, pid)
    if given.json:
        print(json.dumps({"single": rows, "batches": rates, "memory": kept}))
        return
    print("single states by JSON: requests/s, p50 and p99 in ms, the server's CPU time a request in us")
    columns = f"{'p50':>7}{'p99':>7}{'CPU':>6}"
    print(f"{'connections':>11}{'bare':>9}{columns}{'ours':>9}{columns}{'ours/bare':>11}")
    for row in rows:
        parts = [f"{row[f'{n}_rate']:>9.0f}{1e3 * row[f'{n}_p50']:>7.2f}{1e3 * row[f'{n}_p99']:>7.2f}"
                 f"{1e6 * row[f'{n}_cpu']:>6.0f}" for n in ("bare", "ours")]  # fmt: skip
        print(f"{row['connections']:>11}{''.join(parts)}{row['ratio']:>11.2f}")
    print(f"batches of Panda states: {rates['npz']:,.0f} states/s by npz, {rates['json']:,.0f} by JSON")
    growth = kept["after"] / kept["before"] - 1
    print(f"memory: {kept['before']:.1f} MB, {kept['after']:.1f} MB after {given.requests:,} requests ({growth:+.1%})")
    at_16 = next(row for row in rows if row["connections"] == 16)
    print(f"wanted: ours/bare >= {WANTED['ratio']}: {_yes(min(r['ratio'] for r in rows) >= WANTED['ratio'])}; "
          f"p99 < 5 ms at 16: {_yes(at_16['ours_p99'] < WANTED['p99'])}; "
          f">= 1,000,000 states/s by npz: {_yes(rates['npz'] >= WANTED['states'])}; "
          f"no growth: {_yes(growth < WANTED['growth'])}")  # fmt: skip


def _yes(held: bool) -> str:
    return "yes" if held else "NO"


if __name__ == "__main__":
    main()
