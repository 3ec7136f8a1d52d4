"""A motion, played live in the browser by meshcat's server, which is always ended again."""

from __future__ import annotations

import contextlib
import queue
import subprocess
import sys
import threading
import time
import webbrowser
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import umsgpack
import zmq
from numpy.typing import ArrayLike

from twolink.errors import ShowError
from twolink.show.meshcat_scene import Node, poses, scene_nodes, set_object, set_pose
from twolink.show.meshcat_shapes import Floats, Json
from twolink.show.meshcat_view import Side, check_motion, look_at, resample, stage

_ASPECT = 1.6  # of the browser window, which we are not told
_FRAME = 1 / 60  # s, the shortest time between two pictures
_VIEW_FRAMES = 300  # configurations looked at to choose the view
_START_LIMIT = 30.0  # s, for the server to start (it imports IPython)
_SETTLE = 0.7  # s between a browser's coming and the start, for it to draw its first picture
_REPLY_LIMIT = 10.0  # s, for the server to take a command

# meshcat's server with three changes. It ends when its standard input does, so it cannot outlive us, even
# when we are killed. It listens on this machine only. And it says when a browser has come: its own answer
# to that question leaves its ZeroMQ socket deaf to the next command.
_SERVER = """
import os, sys, threading
threading.Thread(target=lambda: (sys.stdin.buffer.read(), os._exit(0)), daemon=True).start()
import meshcat.servers.zmqserver as server
listen, opened = server.tornado.web.Application.listen, server.WebSocketHandler.open
server.tornado.web.Application.listen = lambda app, port, **more: listen(app, port, "127.0.0.1", **more)
server.WebSocketHandler.open = lambda handler: (opened(handler), print("browser=", flush=True))[0]
server.main()
"""


def play_live(
    model: Any,
    visuals: Any,
    t: ArrayLike,
    q: ArrayLike,
    *,
    speed: float = 1.0,
    open_browser: bool = True,
    wait: float = 60.0,
    on_url: Callable[[str], None] | None = None,
    view: Side = "auto",
    on_skipped: Callable[[list[str]], None] | None = None,
) -> None:
    """Play the motion q(t) once in a browser, at `speed` simulated seconds a second.

    model is a pin.Model, visuals its pin.GeometryModel of visual geometry, t (n,) s increasing, q (n, nq).
    The page's address goes to `on_url`, and to the user's browser unless `open_browser` is false; playing
    starts when a browser has the page, or ends in a ShowError after `wait` s without one. Late pictures are
    dropped: a slow machine shows fewer, but never a slower motion. `on_skipped` is called with the names of
    the pieces that cannot be drawn, if any. When this returns, however it does, the server is gone.
    """
    times, configurations = check_motion(model, t, q, speed)
    nodes, skipped = scene_nodes(visuals)
    if skipped and on_skipped is not None:
        on_skipped(skipped)
    if not nodes:
        raise ShowError("the robot has nothing to draw", remedy="give its links <visual> elements")
    few = configurations[:: max(1, len(configurations) // _VIEW_FRAMES)]
    placed = poses(model, visuals, few, nodes)
    still = [set_object(node.path, node.object) for node in nodes]
    still += stage(look_at(nodes, placed, view), _ASPECT)
    still += [set_pose(node.path, placed[0, k]) for k, node in enumerate(nodes)]
    with _server() as lines, _connection(_started(lines, "zmq_url")) as socket:
        web_url = _started(lines, "web_url")
        for command in still:
            _send(socket, command)
        if on_url is not None:
            on_url(web_url)
        if open_browser:  # in a thread, because a browser in the terminal returns only when it is closed
            threading.Thread(target=webbrowser.open, args=(web_url,), daemon=True).start()
        if _line(lines, "browser", wait) is None:
            what = f"no browser opened {web_url} within {wait:g} s"
            remedy = "open that address while it waits, or write a playback file instead"
            raise ShowError(what, where="live playback", remedy=remedy)
        time.sleep(_SETTLE)
        _play(socket, model, visuals, nodes, times, configurations, speed)


def _play(
    socket: zmq.Socket[bytes],
    model: Any,
    visuals: Any,
    nodes: Sequence[Node],
    t: Floats,
    q: Floats,
    speed: float,
) -> None:
    """Send the poses that the wall clock asks for until the last one is shown."""
    begun = time.monotonic()
    last: dict[str, Json] = {}
    while True:
        shown = time.monotonic()
        now = min(t[0] + (shown - begun) * speed, t[-1])
        placed = poses(model, visuals, resample_at(model, t, q, now), nodes)[0]
        for node, pose in zip(nodes, placed, strict=True):
            command = set_pose(node.path, pose)
            if last.get(node.path) != command:  # what stands still is sent once
                _send(socket, command)
                last[node.path] = command
        if now >= t[-1]:
            return
        time.sleep(max(0.0, shown + _FRAME - time.monotonic()))


def resample_at(model: Any, t: Floats, q: Floats, now: float) -> Floats:
    """The configuration at one time: (1, nq). Looks only at the two samples round it."""
    right = min(max(int(t.searchsorted(now, side="right")), 1), max(len(t) - 1, 1))
    around = slice(right - 1, right + 1)
    return resample(model, t[around], q[around], t[:1] * 0.0 + now)


@contextlib.contextmanager
def _server() -> Iterator[queue.SimpleQueue[str]]:
    """Run meshcat's server, and give the lines it prints. It is ended at the end."""
    # Not by meshcat's own way of starting it: that waits without a limit, never reads the error output it
    # collects (the server stops when that is full), and leaves the server running when we are killed.
    process = subprocess.Popen(
        [sys.executable, "-P", "-u", "-c", _SERVER],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        start_new_session=True,  # Ctrl-C is for us; we end the server
    )
    lines: queue.SimpleQueue[str] = queue.SimpleQueue()
    reader = threading.Thread(target=_drain, args=(process.stdout, lines), daemon=True)
    try:
        reader.start()
        yield lines
    finally:
        process.kill()
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(timeout=10.0)
        reader.join(timeout=10.0)
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                pipe.close()


def _drain(stream: Any, lines: queue.SimpleQueue[str]) -> None:
    for line in stream:
        lines.put(line.strip())
    lines.put("")  # the server has ended


def _line(lines: queue.SimpleQueue[str], name: str, limit: float) -> str | None:
    """What the server says of `name` in its next line "name=...", or None after `limit` s of silence."""
    try:
        line = lines.get(timeout=max(0.0, limit))
    except queue.Empty:
        return None
    if not line.startswith(f"{name}="):
        remedy = "write a playback file instead, which needs no server"
        raise ShowError("meshcat's server ended by itself", where="live playback", remedy=remedy)
    return line.removeprefix(f"{name}=")


def _started(lines: queue.SimpleQueue[str], name: str) -> str:
    """An address of the server that has just been started."""
    address = _line(lines, name, _START_LIMIT)
    if address is None:
        what = f"meshcat's server did not start within {_START_LIMIT:g} s"
        raise ShowError(what, where="live playback", remedy="try again")
    return address


@contextlib.contextmanager
def _connection(url: str) -> Iterator[zmq.Socket[bytes]]:
    """A ZeroMQ socket to the server on which no call can block for ever."""
    with zmq.Context() as context, context.socket(zmq.REQ) as socket:
        socket.setsockopt(zmq.LINGER, 0)
        socket.setsockopt(zmq.SNDTIMEO, int(1000 * _REPLY_LIMIT))
        socket.setsockopt(zmq.RCVTIMEO, int(1000 * _REPLY_LIMIT))
        socket.connect(url)
        yield socket


def _send(socket: zmq.Socket[bytes], command: Json) -> None:
    """Send one command and wait for the server's answer."""
    try:
        socket.send_multipart([command["type"].encode(), command["path"].encode(), umsgpack.packb(command)])
        socket.recv()
    except zmq.Again as failure:
        what = f"meshcat's server did not answer within {_REPLY_LIMIT:g} s"
        remedy = "play again, or write a playback file"
        raise ShowError(what, where="live playback", remedy=remedy) from failure
