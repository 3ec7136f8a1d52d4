"""Attacks on a service with default quotas, all at once, while its /health is asked and its memory measured.

The attacks are those of `attacks`, the hostile corpus among them. Each comes from an address of its own and from
processes of lower priority, because those who attack bring their own processors. /health is asked every 20 ms on one
connection. Memory is the proportional share (PSS) of the service and its worker processes. Bars: /health p99 under
100 ms and always answered, memory under 2 GB, no answer 500, and all well afterwards.
"""

import contextlib
import http.client
import multiprocessing
import os
import tempfile
import threading
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from scripts.runner import Bars
from tests.parts.service.attacks import ATTACKS, Target, prepare, rounds
from tests.parts.service.serving import Served, serving

MAX_P99, MAX_MEMORY = 0.1, 2000.0  # s, MB
STALL = 1.0  # s: the attacks stalled an unprotected service for 5 to 80 s
_HEALTH_EVERY, _MEMORY_EVERY = 0.02, 0.5  # seconds
_NICE = 19
_fork = multiprocessing.get_context("fork")


@dataclass
class Figures:
    """health: seconds of each answer. failures: answers of /health other than 200.

    memory: the most, of the service and its workers [MB].

    outcomes: of the rounds, by attack. healthy: whether the service works afterwards.
    """

    health: list[float] = field(default_factory=list)
    failures: int = 0
    memory: float = 0.0
    outcomes: dict[str, Counter[str]] = field(default_factory=dict)
    healthy: bool = False

    def summary(self) -> str:
        """Latency and memory in a few lines."""
        p50, p99, most = (1e3 * float(np.quantile(self.health, share)) for share in (0.5, 0.99, 1.0))
        return (f"/health: {len(self.health)} answers, p50 {p50:.1f} ms, p99 {p99:.1f} ms, max {most:.1f} ms, "
                f"{self.failures} failed\nmemory: at most {self.memory:.0f} MB")  # fmt: skip

    def bars(self, *, busy: bool = False) -> Bars:
        """Each bar and whether it is met. busy: other programs use the machine; then a stall counts, not a delay."""
        limit = STALL if busy else MAX_P99
        return [
            (_p99(self.health) < limit, f"/health p99 < {1e3 * limit:g} ms"),
            (self.failures == 0, "every /health is answered"),
            (0 < self.memory < MAX_MEMORY, f"memory < {MAX_MEMORY:g} MB"),
            (not any(outcome.get("500") for outcome in self.outcomes.values()), "no attack gets a 500"),
            (self.healthy, "works as before afterwards"),
        ]


def attack(seconds: float) -> Figures:
    """Start a service, attack it, and measure."""
    figures = Figures()
    prepare()
    with tempfile.TemporaryDirectory() as folder, serving(Path(folder) / "data") as served:
        port = int(served.url.rpartition(":")[2])
        _ask(port, "/v1/robots/panda/bias", b'{"q": [0,0,0,0,0,0,0,0,0]}')  # both robots are loaded
        _ask(port, "/v1/robots/two_link/bias", b'{"q": [0,0]}')
        queue = _fork.SimpleQueue()
        end = time.monotonic() + seconds
        attackers = [_fork.Process(target=_attacker, args=(name, Target(port, f"127.0.1.{i}", end), queue), daemon=True)
                     for i, name in enumerate(ATTACKS, start=1)]  # fmt: skip
        watches = [threading.Thread(target=_watch_memory, args=(figures, served, end)),
                   threading.Thread(target=_watch_latency, args=(figures, port, end))]  # fmt: skip
        for one in [*attackers, *watches]:
            one.start()
        for _ in attackers:
            name, counts = queue.get()
            figures.outcomes[name] = Counter(counts)
        for one in [*attackers, *watches]:
            one.join()
        figures.healthy = _works(served, port)
    return figures


def _attacker(name: str, target: Target, queue: "multiprocessing.SimpleQueue[tuple[str, dict[str, int]]]") -> None:
    os.setsid()  # Linux shares processors between sessions first
    os.nice(_NICE)
    with contextlib.suppress(OSError):
        Path("/proc/self/autogroup").write_text(str(_NICE))
    counts: dict[str, int] = {}
    clients = [threading.Thread(target=rounds, args=(name, target, k, counts), daemon=True)
               for k in range(ATTACKS[name][1])]  # fmt: skip
    for client in clients:
        client.start()
    for client in clients:
        client.join(max(0.0, target.end + 5 - time.monotonic()))
    queue.put((name, dict(counts)))


def _ask(port: int, path: str, body: bytes | None = None) -> int:
    connection = http.client.HTTPConnection("127.0.0.1", port, 60)
    with contextlib.closing(connection):
        connection.request("GET" if body is None else "POST", path, body)
        return connection.getresponse().status


def _works(served: Served, port: int) -> bool:
    """Whether the service answers as before, and has reported nothing unexpected."""
    try:
        answers = [_ask(port, "/health"), _ask(port, "/v1/robots/two_link/bias", b'{"q": [0,0]}')]
    except OSError:
        return False
    return served.process.poll() is None and answers == [200, 200] and "unexpected" not in served.log


def _watch_latency(figures: Figures, port: int, end: float) -> None:
    """Ask the service again and again until the end."""
    connection = http.client.HTTPConnection("127.0.0.1", port, 10)
    while time.monotonic() < end:
        start, failed = time.monotonic(), False
        try:
            connection.request("GET", "/health")
            answer = connection.getresponse()
            answer.read()
            failed = answer.status != 200
        except OSError:
            failed = True
            connection.close()
        figures.failures += failed
        figures.health.append(time.monotonic() - start)
        time.sleep(_HEALTH_EVERY)
    connection.close()


def _p99(seconds: list[float]) -> float:
    return float(np.quantile(seconds, 0.99)) if seconds else float("inf")


def _watch_memory(figures: Figures, served: Served, end: float) -> None:
    """Measure the memory again and again until the end."""
    while time.monotonic() < end:
        figures.memory = max(figures.memory, sum(map(_pss, (served.process.pid, *served.workers()))))
        time.sleep(_MEMORY_EVERY)


def _pss(pid: int) -> float:
    """A process' proportional share of memory [MB]: pages that several share count in parts."""
    with contextlib.suppress(OSError):
        for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines():
            if line.startswith("Pss:"):
                return int(line.split()[1]) / 1024
    return 0.0
