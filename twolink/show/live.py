"""Live playing of a motion in the browser: a playback page, served to this machine while it plays."""

import threading
import time
import webbrowser
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from twolink.errors import ShowError
from twolink.show.playback import playback_page

_LIMITS: dict[str, Any] = {"max_frames": 36_000, "max_bytes": 500_000_000}  # higher than a file's: the page is not kept

_BLOCK = 0.2  # seconds


class _Server(ThreadingHTTPServer):
    """Serves one page, on this machine only."""

    def __init__(self, page: bytes) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.page = page
        self.started = threading.Event()  # a browser has the page and plays it

    def handle_error(self, *_: Any) -> None:
        """Ignore a browser that goes away."""


class _Handler(BaseHTTPRequestHandler):
    server: _Server

    def do_GET(self) -> None:
        """Answer / with the page, and /started with nothing."""
        if self.path == "/started":
            self.server.started.set()
        body = self.server.page if self.path == "/" else b""
        self.send_response(200 if self.path in ("/", "/started") else 404)
        self.send_header("Content-Type", "text/html; charset=utf-8")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: Any) -> None:
        """Print nothing."""


def _wait(event: threading.Event, seconds: float) -> bool:
    """Whether the event comes within so many seconds.

    Python sees a Ctrl-C only between two of its instructions. One that comes just before the thread blocks, or that the
    system gives to another thread, does not end the block: so no block is long.
    """
    end = time.monotonic() + seconds
    while not event.wait(max(0.0, min(_BLOCK, end - time.monotonic()))):
        if time.monotonic() >= end:
            return False
    return True


def play_live(
    model: pin.Model,
    visuals: pin.GeometryModel,
    t: ArrayLike,
    q: ArrayLike,
    *,
    speed: float = 1.0,
    open_browser: bool = True,
    wait: float = 60.0,
    on_url: Callable[[str], None] | None = None,
    **options: Any,
) -> None:
    """Play the motion q(t) once in a browser; return when it has ended.

    A slow machine shows fewer pictures, but never a slower motion. The server has ended when this returns or raises;
    the page goes on without it.

    Parameters
    ----------
    model, visuals, t, q, speed
        As in `playback_page`.
    open_browser : bool
        Whether to open the page in the user's browser.
    wait : float
        Seconds to wait for a browser to play the page.
    on_url : callable, optional
        Called with the page's address.
    options
        The other arguments of `playback_page`.

    Raises
    ------
    ShowError
        For a motion that cannot be shown, and when no browser comes (code "no-browser").
    """
    page = playback_page(model, visuals, t, q, speed=speed, live=True, **_LIMITS, **options)
    with _Server(page) as server:
        threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
        url = f"http://127.0.0.1:{server.server_port}/"
        try:
            if on_url is not None:
                on_url(url)
            if open_browser:  # in a thread, because a browser in the terminal returns only when it is closed
                threading.Thread(target=webbrowser.open, args=(url,), daemon=True).start()
            if not _wait(server.started, wait):
                what, remedy = f"no browser opened {url} within {wait:g} s", "try again, or write a playback file"
                raise ShowError(what, where="live playback", remedy=remedy, code="no-browser")
            _wait(threading.Event(), float(np.ptp(np.asarray(t, float))) / speed)
        finally:
            server.shutdown()
