"""A server that answers as it is told, for tests of the client: well, badly, slowly, in part, or not at all."""

import contextlib
import json
import socket
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from twolink.parts.service.client import Client

JSON, PROBLEM = "application/json", "application/problem+json"
Answer = bytes | Callable[["Request", socket.socket], bytes]


@dataclass
class Request:
    method: str
    path: str
    headers: dict[str, str]
    body: bytes


@dataclass
class Fake:
    """url: where it is. requests: those that came. connections: how many were opened."""

    url: str = ""
    requests: list[Request] = field(default_factory=list)
    connections: int = 0

    def client(self, timeout: float = 20) -> Client:
        return Client(self.url, timeout=timeout)


def http(status: int, content: bytes | object, media: str = JSON, *headers: str) -> bytes:
    """An HTTP answer; content that is not bytes becomes JSON."""
    body = content if isinstance(content, bytes) else json.dumps(content).encode()
    lines = [f"HTTP/1.1 {status} X", f"Content-Type: {media}", f"Content-Length: {len(body)}", *headers]
    return "\r\n".join([*lines, "", ""]).encode() + body


def problem(status: int, code: str, **more: object) -> dict[str, object]:
    return {"type": f"urn:twolink:{code}", "title": "X", "status": status, "detail": "so it is", "code": code, **more}


def _read(stream: socket.SocketIO) -> Request | None:
    head = stream.readline().decode().split()
    if len(head) != 3:
        return None
    headers = {}
    while (line := stream.readline().decode().strip()) != "":
        name, _, value = line.partition(": ")
        headers[name.lower()] = value
    return Request(head[0], head[1], headers, stream.read(int(headers.get("content-length", 0))))


@contextlib.contextmanager
def fake(*answers: Answer, family: int = socket.AF_INET) -> Iterator[Fake]:
    """A server that gives these answers in order, and the last one again. An empty answer closes the connection."""
    host = "::1" if family == socket.AF_INET6 else "127.0.0.1"
    server = socket.create_server((host, 0), family=family)
    shown = f"[{host}]" if family == socket.AF_INET6 else host
    state = Fake(f"http://{shown}:{server.getsockname()[1]}")
    opened: list[socket.socket] = []

    def serve(connection: socket.socket) -> None:
        with contextlib.suppress(OSError, ValueError), connection, connection.makefile("rb") as stream:
            while (request := _read(stream)) is not None:
                state.requests.append(request)
                answer = answers[min(len(state.requests), len(answers)) - 1]
                content = answer if isinstance(answer, bytes) else answer(request, connection)
                connection.sendall(content)
                if not content or b"Content-Length" not in content:
                    connection.shutdown(socket.SHUT_RDWR)
                    return

    def accept() -> None:
        while True:
            try:
                connection, _ = server.accept()
            except OSError:
                return
            state.connections += 1
            opened.append(connection)
            threading.Thread(target=serve, args=(connection,), daemon=True).start()

    thread = threading.Thread(target=accept, daemon=True)
    thread.start()
    try:
        yield state
    finally:
        server.shutdown(socket.SHUT_RDWR)
        server.close()
        for connection in opened:
            with contextlib.suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)
        thread.join(10)
