"""Attacks on a running service: clients that take what they can and give nothing back, each again and again."""

import contextlib
import functools
import http.client
import io
import itertools
import json
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tests.parts.service.hostile import JSON, NPZ, XML, ZIP, cases
from tests.parts.service.serving import pendulum, zipped
from tests.robots.test_bad_urdf import chain

MB = 2**20
HEAD = "{} {} HTTP/1.1\r\nHost: localhost\r\nContent-Type: {}\r\n"
BIAS = "/v1/robots/two_link/bias"
_TIMEOUT = 20.0  # seconds a client waits for an answer


@dataclass(frozen=True)
class Target:
    """The service, the address that the attack comes from, and when it ends (time.monotonic)."""

    port: int
    source: str
    end: float

    @property
    def over(self) -> bool:
        return time.monotonic() > self.end

    def connect(self) -> socket.socket:
        timeout = max(0.1, min(_TIMEOUT, self.end - time.monotonic()))
        return socket.create_connection(("127.0.0.1", self.port), timeout, (self.source, 0))

    def ask(self, path: str, body: bytes | None = None, media: str = JSON, method: str = "POST") -> tuple[str, bytes]:
        """Status and body of an answer; "cut off" or "no answer" as status where there is none."""
        timeout = max(0.1, min(_TIMEOUT, self.end - time.monotonic()))
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout, (self.source, 0))
        try:
            connection.request(method, path, body, {"Content-Type": media} if body is not None else {})
            answer = connection.getresponse()
            return str(answer.status), answer.read()
        except TimeoutError:
            return "no answer", b""
        except (OSError, http.client.HTTPException):
            return "cut off", b""
        finally:
            connection.close()

    def hold(self, count: int, begin: bytes, seconds: float = _TIMEOUT, drip: bytes = b"") -> str:
        """Open so many connections, send each the same, perhaps a byte a second, and read nothing."""
        with contextlib.ExitStack() as stack:
            held = []
            with contextlib.suppress(OSError):
                for _ in range(count):
                    held.append(stack.enter_context(self.connect()))
                    held[-1].setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
                    held[-1].sendall(begin)
            end = min(self.end, time.monotonic() + seconds)
            while time.monotonic() < end:
                time.sleep(1.0)
                for connection in held:
                    with contextlib.suppress(OSError):
                        connection.sendall(drip)
        return "held"

    def flood(self, begin: bytes, piece: bytes, most: int = 400 * MB) -> str:
        """Send pieces without end; the status of the answer, or "cut off"."""
        with self.connect() as connection:
            connection.sendall(begin)
            try:
                for _ in range(0, most, len(piece)):
                    connection.sendall(piece)
                    if self.over:
                        return "taken"
            except TimeoutError:
                return "not read"
            except OSError:
                return "cut off"
        return "taken"


Outcome = str
Round = Callable[[Target, int], Outcome]  # one round of an attack, with the number of the round


def _head(path: str, media: str = JSON, method: str = "POST", length: int | None = None) -> bytes:
    text = HEAD.format(method, path, media)
    return (text if length is None else f"{text}Content-Length: {length}\r\n\r\n").encode()


@functools.cache
def packed(count: int, columns: int, compressed: bool = False) -> bytes:
    out = io.BytesIO()
    (np.savez_compressed if compressed else np.savez)(out, q=np.zeros((count, columns)))
    return out.getvalue()


@functools.cache
def numbers(count: int, columns: int) -> bytes:
    row = json.dumps([0.123456789] * columns)
    return ('{"q": [' + ", ".join([row] * count) + "]}").encode()


@functools.cache
def scene(megabytes: float) -> bytes:
    """A scene with a table of so many MB, or filled up with spaces where no service reads so much."""
    count = int(min(megabytes, 15) * MB / 16)
    table = {"kind": "sampled", "times": [i / 100 for i in range(count)], "values": [0.5] * count}
    effects = [{"type": "torque", "torque": {"shoulder": table}}]
    text = json.dumps({"scene": {"robot": "two_link", "effects": effects}, "duration": 1.0})
    return text.ljust(int(megabytes * MB)).encode()


def _slow_readers(target: Target, _: int) -> Outcome:
    body = packed(50_000, 9)
    return target.hold(12, _head("/v1/robots/panda/mass-matrix", NPZ, length=len(body)) + body)


def _query_json(target: Target, number: int) -> Outcome:
    return target.ask("/v1/robots/panda/bias", numbers(100_000 if number % 4 else 10_000, 9))[0]


def _scene_json(target: Target, number: int) -> Outcome:
    path = ("/v1/scenes/validate", "/v1/simulations", "/v1/scenes/explain")[number % 3]
    return target.ask(path, scene(_SCENES[number % 4]))[0]


def _titles(target: Target, number: int) -> Outcome:
    title = json.dumps({"scene": {"robot": "x", "title": f"{number}" + "t" * 8 * MB}}).encode()
    return target.ask("/v1/simulations", title)[0]


def _uploaded(target: Target, text: str) -> tuple[str, str]:
    """The status of an upload, and the robot's id; "" where there is none."""
    status, answer = target.ask("/v1/robots", text.encode(), XML)
    return status, json.loads(answer)["id"] if status.startswith("20") else ""


def _own_chain(target: Target, number: int, links: int) -> str:
    """A robot that nobody has sent before."""
    return chain(links).replace("<robot", f"<!-- {target.source} {number} -->\n<robot", 1)


def _states(target: Target, number: int) -> Outcome:
    status, robot = _uploaded(target, chain(100))
    body = packed(_STATES[number % 3], 100, compressed=True)
    return target.ask(f"/v1/robots/{robot}/forward-dynamics", body, NPZ)[0] if robot else status


def _robots(target: Target, number: int) -> Outcome:
    status, robot = _uploaded(target, _own_chain(target, number, 100))
    return target.ask(f"/v1/robots/{robot}/bias", numbers(10, 100))[0] if robot else status


def _zips(target: Target, number: int) -> Outcome:
    text = ("\n" * 700_000, "map_Kd" + " " * 700_000, "<init_from>" * 60_000)[number % 3]
    name = "a.dae" if number % 3 == 2 else "a.mtl"
    return target.ask("/v1/robots", zipped({"a.urdf": pendulum(name=f"r{number}"), name: text}), ZIP)[0]


def _taylor(target: Target, number: int) -> Outcome:
    status, robot = _uploaded(target, _own_chain(target, number, 30))
    motion = {"scene": {"robot": robot}, "duration": 0.01, "method": "taylor", "wait": 10}
    return target.ask("/v1/simulations", json.dumps(motion).encode())[0] if robot else status


def _results(target: Target, number: int) -> Outcome:
    motion = json.dumps({"scene": "arm-swing", "duration": 1.0, "wait": 10}).encode()
    status, answer = target.ask("/v1/simulations", motion)
    if status != "200":
        return status
    job, what = json.loads(answer)["id"], ("playback", "figure", "result?format=csv", f"motion?frames={2 + number}")
    return target.ask(f"/v1/simulations/{job}/{what[number % 4]}", method="GET")[0]


def _sweeps(target: Target, number: int) -> Outcome:
    vary = {"q.elbow": {"range": [-0.3, 0.3, (10, 1e5, 1e18)[number % 3]]}, "q.shoulder": [number / 1e6]}
    asked = json.dumps({"scene": "arm-swing", "duration": 1.0, "vary": vary, "wait": 5}).encode()
    status, answer = target.ask("/v1/sweeps", asked)
    if not status.startswith("20"):
        return status
    form = ("json", "csv", "zip")[number // 3 % 3]
    return target.ask(f"/v1/sweeps/{json.loads(answer)['id']}/result?format={form}", method="GET")[0]


def _watchers(target: Target, number: int) -> Outcome:
    motion = json.dumps({"scene": "pendulum-100000s", "duration": 2000.0 + number, "wait": 0}).encode()
    _, answer = target.ask("/v1/simulations", motion)
    with contextlib.suppress(ValueError, KeyError):
        job = json.loads(answer)["id"]
        return target.hold(50, _head(f"/v1/simulations/{job}/events", method="GET") + b"\r\n", 5.0)
    return "no job"


def _lists_of_all(target: Target, number: int) -> Outcome:
    path = ("/v1/robots", "/v1/simulations", f"/v1/robots/x{number}", "/metrics")[number % 4]
    return target.ask(path, method="GET")[0]


def _churn(target: Target, _: int) -> Outcome:
    with target.connect():
        return "open"


corpus = functools.cache(cases)
_SCENES = (1, 4, 15, 100)  # MB
_STATES = (300_000, 60_000, 10_000)


def prepare() -> None:
    """Make the large bodies, which takes seconds, before the attacks begin."""
    corpus()
    for megabytes in _SCENES:
        scene(megabytes)
    for count in (10_000, 100_000):
        numbers(count, 9)
    for count in _STATES:
        packed(count, 100, compressed=True)


def _corpus(target: Target, number: int) -> Outcome:
    case = corpus()[number % len(corpus())]
    return target.ask(case.path, case.body, case.media)[0]


_CHUNKED = b"Transfer-Encoding: chunked\r\n\r\n1\r\n{\r\n0\r\n"
_METRICS = b"GET /metrics HTTP/1.1\r\nHost: localhost\r\n\r\n"

# The attacks by name: a round, and how many clients do it at once.
ATTACKS: dict[str, tuple[Round, int]] = {
    "header flood": (lambda target, _: target.flood(_head(BIAS) + b"X: ", b"x" * 65536), 2),
    "many headers": (lambda target, _: target.flood(_head(BIAS), b"X: y\r\n" * 10_000), 2),
    "URL flood": (lambda target, _: target.flood(b"GET /", b"x" * 65536), 2),
    "trailer flood": (lambda target, _: target.flood(_head(BIAS) + _CHUNKED, b"X: y\r\n" * 10_000), 1),
    "pipelined requests": (lambda target, _: target.flood(b"", _METRICS * 1000, 20 * MB), 1),
    "idle connections": (lambda target, _: target.hold(500, b""), 2),
    "slow requests": (lambda target, _: target.hold(200, _head(BIAS, length=1000) + b"{", drip=b" "), 1),
    "unfinished bodies": (
        lambda target, _: target.hold(30, _head(BIAS, NPZ, length=120 * MB) + b"P" * (4 * MB)), 1),
    "slow readers": (_slow_readers, 1),
    "giant JSON queries": (_query_json, 3),
    "JSON of empty lists": (lambda target, _: target.ask(BIAS, b'{"q": [' + b"[]," * 5_000_000 + b"[]]}")[0], 1),
    "giant JSON scenes": (_scene_json, 3),
    "giant titles": (_titles, 1),
    "npz of many states": (_states, 3),
    "many robots": (_robots, 2),
    "slow zips": (_zips, 4),
    "new Taylor robots": (_taylor, 2),
    "results in all forms": (_results, 2),
    "watchers of jobs": (_watchers, 1),
    "sweeps": (_sweeps, 1),
    "lists": (_lists_of_all, 1),
    "connection churn": (_churn, 1),
    "hostile corpus": (_corpus, 2),
}  # fmt: skip


def rounds(name: str, target: Target, client: int, counts: dict[Outcome, int]) -> None:
    """Do an attack again and again until its end, counting how the rounds end."""
    attack = ATTACKS[name][0]
    for number in itertools.count(client * 1_000_003):
        if target.over:
            return
        try:
            outcome = attack(target, number)
        except TimeoutError:
            outcome = "no answer"
        except OSError:
            outcome = "cut off"
        counts[outcome] = counts.get(outcome, 0) + 1
        if outcome in ("503", "429"):  # what a client that is told to wait does at best; it also spares this machine
            time.sleep(0.2)
