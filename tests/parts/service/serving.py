"""A service in a process of its own, as a user starts it; and good URDFs and archives that are sent to it."""

import contextlib
import io
import os
import re
import signal
import socket
import struct
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np

from tests.robots.test_bad_urdf import INERTIAL, JOINT

TOP = Path(__file__).parents[3]
URDFS = TOP / "urdf"


def wait_until(condition: Callable[[], object], seconds: float = 240.0) -> None:
    """Wait until the condition holds. Raises TimeoutError when it does not in time."""
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError
        time.sleep(0.02)


class Served(httpx.Client):
    """A service, and a client of it. url: where it is. process: to end it. log: what it wrote to stderr so far."""

    def __init__(self, url: str, process: subprocess.Popen[str], log_file: Path, **more: Any) -> None:
        super().__init__(base_url=url, timeout=120, **more)
        self.url, self.process, self.log_file = url, process, log_file

    @property
    def log(self) -> str:
        return self.log_file.read_text()

    def client(self, **more: object) -> "Served":
        """Another client of it."""
        return Served(self.url, self.process, self.log_file, **more)

    def ask(self, path: str, body: object = None, status: int | None = None, **more: Any) -> Any:
        """The JSON that is answered, or an answer that is none. body: to POST, as JSON unless it is text or bytes.

        status: of the answer; else any of success.
        """
        sent = {"content" if isinstance(body, str | bytes) else "json": body}
        answer = self.request("GET" if body is None else "POST", path, **sent, **more)
        assert answer.is_success if status is None else answer.status_code == status, answer.text
        return answer.json() if "json" in answer.headers.get("content-type", "") else answer

    def begin(self, body: object, path: str = "/v1/simulations") -> str:
        """The path of a job that is asked for."""
        return self.post(path, json=body).headers["location"]

    def connect(self, source: str = "127.0.0.1") -> socket.socket:
        """A connection from an address of this machine."""
        return socket.create_connection(("127.0.0.1", int(self.url.rpartition(":")[2])), 60, (source, 0))

    def kill(self) -> None:
        self.process.kill()
        self.process.wait(120)

    def workers(self) -> list[int]:
        """Process ids of its worker processes."""
        processes = []
        for path in Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError, IndexError):
                parent = int((path / "stat").read_text().rpartition(")")[2].split()[1])
                command = (path / "cmdline").read_bytes()
                if parent == self.process.pid and b"twolink.parts.service.work.worker" in command:
                    processes.append(int(path.name))
        return processes


@contextlib.contextmanager
def serving(folder: Path, *options: str, environment: dict[str, str] | None = None) -> Iterator[Served]:
    """Start a service on a free port, and end it as Ctrl-C does."""
    log_file = folder.parent / f"{folder.name}.log"
    command = [sys.executable, "-m", "twolink", "serve", "--port", "0", "--data", str(folder), *options]
    with log_file.open("w") as log:
        process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=log, text=True, cwd=TOP,
            env={**os.environ, **(environment or {})},
        )  # fmt: skip
    with process:
        if process.stdout is None:
            raise RuntimeError("no stdout")
        address = re.search(r"http://\S+:\d+", process.stdout.readline())
        if address is None:
            process.kill()
            raise RuntimeError(log_file.read_text())
        try:
            with Served(address.group(), process, log_file) as served:
                yield served
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
            try:
                process.wait(120)
            except subprocess.TimeoutExpired:
                process.kill()
                raise


def pendulum(visual: str = "", name: str = "r") -> str:
    return f'<robot name="{name}">\n<link name="base"/>\n<link name="arm">{INERTIAL}{visual}</link>\n{JOINT}</robot>'


def mesh(filename: str) -> str:
    return f'<visual><geometry><mesh filename="{filename}"/></geometry></visual>'


def stl() -> bytes:
    """One triangle."""
    return bytes(80) + struct.pack("<I12fH", 1, *(0, 0, 1), *(0, 0, 0), *(1, 0, 0), *(0, 1, 0), 0)


def zipped(files: dict[str, bytes | str], compression: int = zipfile.ZIP_DEFLATED) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", compression) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return out.getvalue()


def packed(**arrays: Any) -> bytes:
    """The arrays as .npz."""
    out = io.BytesIO()
    np.savez(out, **arrays)
    return out.getvalue()
