"""Pages of a headless Chromium for the tests, driven over its DevTools protocol. Every wait has a limit."""

import base64
import contextlib
import io
import json
import os
import shutil
import signal
import socket
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from websockets.sync.client import connect

_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
_FLAGS = [
    "--headless", "--no-sandbox", "--no-first-run", "--hide-scrollbars", "--remote-debugging-port=0",
    "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--webgl-antialiasing-mode=none",
    "--disable-gpu-compositing",  # without a graphics card, drawing the page by one takes most of the time
    "--disable-background-networking", "--disable-component-update", "--disable-sync", "--disable-quic",
]  # fmt: skip


def find_chromium() -> str | None:
    """The browser's path: $CHROMIUM, or the first of the usual names on the path."""
    return os.environ.get("CHROMIUM") or next(filter(None, map(shutil.which, _NAMES)), None)


class Chromium:
    """A headless Chromium. Its pages share nothing but its process."""

    def __init__(self, executable: str) -> None:
        self._number = 0
        self._profile = tempfile.mkdtemp(prefix="twolink-browser-")
        self._opened = contextlib.ExitStack()
        command = [executable, *_FLAGS, f"--user-data-dir={self._profile}", "about:blank"]
        silent = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.DEVNULL)
        self._process = subprocess.Popen(command, start_new_session=True, **silent)
        try:
            self._connect()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> "Chromium":
        return self

    def __exit__(self, *failure: object) -> None:
        self.close()

    def _connect(self, limit: float = 60.0) -> None:
        end, note = time.monotonic() + limit, Path(self._profile, "DevToolsActivePort")
        while not (note.exists() and note.read_text().count("\n")):
            if time.monotonic() > end or self._process.poll() is not None:
                raise RuntimeError(f"Chromium did not start (exit code {self._process.poll()})")
            time.sleep(0.05)
        port, path = note.read_text().split()
        here = socket.create_connection(("127.0.0.1", port))
        socket_to_it = connect(f"ws://127.0.0.1:{port}{path}", sock=here, max_size=None, max_queue=None)
        self._socket: Any = self._opened.enter_context(socket_to_it)

    def call(self, message: dict[str, Any], note: Callable[[dict[str, Any]], None], limit: float) -> dict[str, Any]:
        """Send one DevTools command and return its result. note: is given each other message that comes before it."""
        self._number += 1
        self._socket.send(json.dumps({"id": self._number, **message}))
        end = time.monotonic() + limit
        while True:
            answer: dict[str, Any] = json.loads(self._socket.recv(end - time.monotonic()))
            if answer.get("id") == self._number:
                break
            note(answer)
        if "error" in answer:
            raise RuntimeError(f"{message['method']}: {answer['error']}")
        result: dict[str, Any] = answer["result"]
        return result

    def close(self) -> None:
        """End the browser and everything it started, and remove its profile."""
        self._opened.close()
        if self._process.poll() is None:
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait(timeout=10)
        shutil.rmtree(self._profile, ignore_errors=True)


class Browser:
    """A page that shares nothing with others. `requests`: the URLs it asked for. `waiting`: those without an end
    yet, by their ids. `errors`: its JavaScript errors."""

    def __init__(self, chromium: Chromium, *, width: int = 1280, height: int = 800) -> None:
        self.requests: list[str] = []
        self.waiting: dict[str, str] = {}
        self.errors: list[str] = []
        self._chromium = chromium
        self._session: dict[str, str] = {}  # until it has one, calls are to the whole browser
        self._context = self.call("Target.createBrowserContext")
        target = self.call("Target.createTarget", url="about:blank", **self._context)
        self._session = self.call("Target.attachToTarget", flatten=True, **target)
        for domain in ("Page", "Network", "Runtime", "Log"):
            self.call(f"{domain}.enable")
        self.resize(width, height)

    def __enter__(self) -> "Browser":
        return self

    def __exit__(self, *failure: object) -> None:
        self._session = {}
        self.call("Target.disposeBrowserContext", **self._context)

    def call(self, method: str, limit: float = 60.0, **parameters: object) -> dict[str, Any]:
        """Send one DevTools command and return its result."""
        return self._chromium.call({"method": method, "params": parameters, **self._session}, self._note, limit)

    def _note(self, message: dict[str, Any]) -> None:
        if message.get("sessionId") != self._session.get("sessionId"):
            return  # of an earlier page
        method, details = message.get("method"), message.get("params", {})
        if method == "Network.requestWillBeSent":
            self.requests.append(details["request"]["url"])
            self.waiting[details["requestId"]] = f"{details['request']['method']} {details['request']['url']}"
        elif method in ("Network.loadingFinished", "Network.loadingFailed"):
            self.waiting.pop(details["requestId"], None)
        elif method == "Network.webSocketCreated":
            self.requests.append(details["url"])
        elif method == "Runtime.exceptionThrown":
            self.errors.append(json.dumps(details["exceptionDetails"])[:2000])
        elif method == "Runtime.consoleAPICalled" and details["type"] in ("error", "assert"):
            self.errors.append(json.dumps(details["args"])[:2000])
        elif method == "Log.entryAdded" and details["entry"]["level"] == "error":
            self.errors.append(json.dumps(details["entry"])[:2000])

    def resize(self, width: int, height: int, *, mobile: bool = False) -> None:
        """Make the page width x height CSS pixels."""
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": mobile}
        self.call("Emulation.setDeviceMetricsOverride", **size)

    def open(self, url: str) -> None:
        """Go to a URL and wait until the page is loaded."""
        self.call("Page.navigate", url=url)
        self.wait_for(f"location.href === {json.dumps(url)} && document.readyState === 'complete'")

    def evaluate(self, expression: str, limit: float = 60.0) -> Any:
        """The value of a JavaScript expression (promises are waited for)."""
        answer = self.call("Runtime.evaluate", limit, expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            raise RuntimeError(f"{expression}: {json.dumps(answer['exceptionDetails'])[:1000]}")
        return answer["result"].get("value")

    def wait_for(self, condition: str, limit: float = 120.0) -> None:
        """Wait until a JavaScript expression is true."""
        end = time.monotonic() + limit
        while not self.evaluate(f"!!({condition})"):
            if time.monotonic() > end:
                raise TimeoutError(f"not true within {limit:g} s: {condition}; errors: {self.errors}; "
                                   f"waiting for: {[*self.waiting.values()]}")  # fmt: skip
            time.sleep(0.05)

    def screenshot(self, path: Path | None = None) -> np.ndarray:
        """The page as (height, width, 3) bytes, also written to `path` as PNG."""
        data = base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])
        if path is not None:
            path.write_bytes(data)
        with Image.open(io.BytesIO(data)) as image:
            return np.asarray(image.convert("RGB"))


@pytest.fixture(scope="session")
def chromium() -> Iterator[Chromium]:
    """A headless Chromium. Without one the test is skipped, but in continuous integration it fails."""
    executable = find_chromium()
    if executable is None:
        reason = "NO CHROMIUM FOUND: the browser tests DID NOT RUN; install it or set CHROMIUM=/path/to/it"
        if os.environ.get("CI", "").lower() in ("1", "true"):
            pytest.fail(reason)
        pytest.skip(reason)
    with Chromium(executable) as started:
        yield started


@pytest.fixture
def browser(chromium: Chromium) -> Iterator[Browser]:
    """A fresh page in it."""
    with Browser(chromium) as opened:
        yield opened
