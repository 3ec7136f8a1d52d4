"""Live playing of a motion in the browser, by meshcat's server, which ends when playing ends."""

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

import numpy as np
import pinocchio as pin
import umsgpack
import zmq
from numpy.typing import ArrayLike

from twolink.errors import ShowError
from twolink.show.meshcat_scene import Node, poses, require_nodes, set_pose
from twolink.show.meshcat_shapes import Floats, Json
from twolink.show.meshcat_view import SAMPLES, look_at, opening_commands
from twolink.show.motion_samples import check_motion, resample

_FRAME = 1 / 60  # s, the shortest time between two pictures
_START_LIMIT = 30.0  # s, for the server to start (it imports IPython)
_FIRST_PICTURE = 0.7  # s, for a browser that has just come to draw its first picture
_REPLY_LIMIT = 10.0  # s, for the server to take a command
_FILE_INSTEAD = "try again, or write a playback file, which needs no server"

# meshcat's server with three changes. It ends when its standard input ends, so it cannot outlive this process,
# even when this process is killed. It listens on this machine only. It prints a line when a browser connects: its
# own answer to that question makes its ZeroMQ socket deaf to the next command.
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
    model: pin.Model,
    visuals: pin.GeometryModel,
    t: ArrayLike,
    q: ArrayLike,
    *,
    speed: float = 1.0,
    open_browser: bool = True,
    wait: float = 60.0,
    on_url: Callable[[str], None] | None = None,
    on_skipped: Callable[[list[str]], None] | None = None,
) -> None:
    """Play the motion q(t) once in a browser.

    A slow machine shows fewer pictures, but never a slower motion. The server has ended when this returns or raises.

    Parameters
    ----------
    model : pin.Model
        The robot.
    visuals : pin.GeometryModel
        Its visual geometry.
    t : array_like (n,)
        Times in s, increasing.
    q : array_like (n, nq)
        Configurations.
    speed : float
        Simulated seconds per second of playing.
    open_browser : bool
        Whether to open the page in the user's browser.
    wait : float
        Seconds to wait for a browser to open the page.
    on_url : callable, optional
        Called with the page's address.
    on_skipped : callable, optional
        Called with the names of the pieces that cannot be drawn, if any.

    Raises
    ------
    ShowError
        For a motion that cannot be shown, when no browser comes, and when the server fails.
    """
    times, configurations = check_motion(model, t, q, speed)
    nodes, _ = require_nodes(visuals, on_skipped)
    few = configurations[:: max(1, len(configurations) // SAMPLES)]
    placed = poses(model, visuals, few, nodes)
    opening = opening_commands(nodes, placed, look_at(nodes, placed))
    start_failed = f"meshcat's server did not start within {_START_LIMIT:g} s"
    with _server() as lines, _connection(_wait_for(lines, "zmq_url", _START_LIMIT, start_failed)) as socket:
        url = _wait_for(lines, "web_url", _START_LIMIT, start_failed)
        for command in opening:
            _send(socket, command)
        if on_url is not None:
            on_url(url)
        if open_browser:  # in a thread, because a browser in the terminal returns only when it is closed
            threading.Thread(target=webbrowser.open, args=(url,), daemon=True).start()
        _wait_for(lines, "browser", wait, f"no browser opened {url} within {wait:g} s")
        time.sleep(_FIRST_PICTURE)
        _play(socket, model, visuals, nodes, times, configurations, speed)


def _play(
    socket: zmq.Socket[bytes],
    model: pin.Model,
    visuals: pin.GeometryModel,
    nodes: Sequence[Node],
    t: Floats,
    q: Floats,
    speed: float,
) -> None:
    """Send the poses of the wall clock's time until the last pose is shown."""
    begin = time.monotonic()
    sent: dict[str, Json] = {}
    now = t[0]
    while now < t[-1]:
        frame_begin = time.monotonic()
        now = min(t[0] + (frame_begin - begin) * speed, t[-1])
        placed = poses(model, visuals, resample(model, t, q, np.array([now])), nodes)[0]
        for node, pose in zip(nodes, placed, strict=True):
            command = set_pose(node.path, pose)
            if sent.get(node.path) != command:  # the pose of a body at rest is sent once
                _send(socket, command)
                sent[node.path] = command
        time.sleep(max(0.0, frame_begin + _FRAME - time.monotonic()))


@contextlib.contextmanager
def _server() -> Iterator[queue.SimpleQueue[str]]:
    """Run meshcat's server and yield the lines it prints; an empty line says that it has ended."""
    # meshcat's own way of starting it waits without limit, never reads the error output it collects (the server
    # stops when that pipe is full), and leaves the server running when this process is killed.
    lines: queue.SimpleQueue[str] = queue.SimpleQueue()
    with subprocess.Popen(
        [sys.executable, "-P", "-u", "-c", _SERVER],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        start_new_session=True,  # Ctrl-C reaches this process, which ends the server
    ) as process:
        reader = threading.Thread(target=_read_lines, args=(process.stdout, lines), daemon=True)
        try:
            reader.start()
            yield lines
        finally:
            process.kill()
            reader.join(timeout=10.0)


def _read_lines(stream: Any, lines: queue.SimpleQueue[str]) -> None:
    for line in stream:
        lines.put(line.strip())
    lines.put("")


def _wait_for(lines: queue.SimpleQueue[str], name: str, limit: float, otherwise: str) -> str:
    """The value in the server's next line "name=value". Raises ShowError `otherwise` after `limit` s without a line."""
    try:
        line = lines.get(timeout=max(0.0, limit))
    except queue.Empty:
        raise ShowError(otherwise, where="live playback", remedy=_FILE_INSTEAD, code="server-silent") from None
    if not line.startswith(f"{name}="):
        raise ShowError("meshcat's server ended by itself", where="live playback", remedy=_FILE_INSTEAD)
    return line.removeprefix(f"{name}=")


@contextlib.contextmanager
def _connection(url: str) -> Iterator[zmq.Socket[bytes]]:
    """A ZeroMQ socket to the server on which every call has a time limit."""
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
        raise ShowError(what, where="live playback", remedy=_FILE_INSTEAD) from failure
