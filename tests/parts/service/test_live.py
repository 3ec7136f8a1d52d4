"""Live simulations over a WebSocket: the motion, its pace, what pulls it, and what is refused."""

import base64
import contextlib
import json
import socket
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import numpy as np
import pinocchio as pin
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

import twolink as tl
from tests.parts.service.page_driver import Page
from tests.parts.service.serving import Served, serving
from twolink.parts.service.work.requests import Drag, LiveWords
from twolink.parts.service.work.task_table import torques

PATH = "/v1/live"


def address(served: Served) -> str:
    return served.url.replace("http", "ws", 1) + PATH


def frame(socket: ClientConnection) -> dict:
    return json.loads(socket.recv(timeout=60))


def problem(socket: ClientConnection) -> dict:
    """The next problem."""
    return next(one for one in iter(lambda: frame(socket), None) if "problem" in one)["problem"]


@contextlib.contextmanager
def live(served: Served, **request: object) -> Iterator[ClientConnection]:
    with connect(address(served)) as socket:
        with contextlib.suppress(ConnectionClosed):  # it may be refused before
            socket.send(json.dumps({"scene": "arm-swing"} | request))
        yield socket


def test_frames_are_the_motion_in_real_time(served: Served) -> None:
    sim, tau = tl.Simulation(tl.load_scene("arm-swing"), accuracy=1e-9), [3.0, -1.0]
    with live(served, frames_per_second=50, accuracy=1e-8) as socket:
        first = frame(socket)
        assert first["links"] == list(sim.scene.robot.frame_names)
        began = time.monotonic()
        frames = [frame(socket) for _ in range(50)]
        assert time.monotonic() - began > 0.9
        socket.send(json.dumps({"tau": tau}))
        frames += [frame(socket) for _ in range(50)]
    assert [one["t"] for one in frames] == pytest.approx(np.arange(1, 101) / 50)
    for one in frames[:50]:
        assert one["q"] == pytest.approx(sim.step(0.02).q, abs=1e-6)
    free = tl.Simulation(tl.load_scene("arm-swing"), accuracy=1e-9)
    free.set_state(frames[90]["q"], frames[90]["v"], frames[90]["t"])
    assert frames[91]["q"] == pytest.approx(free.step(0.02, tau).q, abs=1e-7)
    tip = sim.scene.robot.frame_pose(frames[99]["q"], "tip")[1]
    assert frames[99]["poses"][first["links"].index("tip")][:3] == pytest.approx(tip, abs=1e-12)


@pytest.mark.slow
def test_a_link_follows_what_drags_it(served: Served) -> None:
    """Without gravity a point comes to rest where it is drawn to; let go, the arm stays."""
    scene = {"robot": {"source": "two_link"}, "duration": 1.0, "q": {"elbow": 0.5}, "effects": []}
    to = [1.2, 0.0, 0.9]
    with live(served, scene=scene) as socket:
        links = frame(socket)["links"]
        drag = {"link": "forearm", "point": [1.0, 0.0, 0.0], "to": to}
        socket.send(json.dumps({"drag": drag}))
        last = [frame(socket) for _ in range(60)][-1]
        assert last["poses"][links.index("tip")][:3] == pytest.approx(to, abs=0.01)
        socket.send("{}")
        assert [frame(socket) for _ in range(30)][-1]["q"] == pytest.approx(last["q"], abs=0.05)


def test_a_point_beside_its_axis_is_turned_towards_what_is_far_away() -> None:
    """By torques that are held between frames; without gravity it comes to rest in line with where it is drawn to."""
    sim = tl.Simulation(tl.Scene(tl.load_robot("two_link"), [0.3, 0.5], effects=[]), accuracy=1e-4)
    words = LiveWords(drag=Drag("upper_arm", (0.02, 0.0, 0.0), (-2.0, 0.0, 1.0)))
    for _ in range(150):
        sim.step(1.0 / 30.0, torques(sim.scene.robot, sim.state, words))
    rotation, _ = sim.scene.robot.frame_pose(sim.state.q, "upper_arm")
    assert rotation[:, 0] == pytest.approx(np.array([-2.0, 0.0, 1.0]) / np.sqrt(5.0), abs=0.02)
    assert abs(sim.state.v[0]) < 0.1


@pytest.mark.parametrize(("message", "detail"), [
    ('{"tau": [NaN, 0]}', "malformed"), ('{"tau": [1e999, 0]}', "out of range"), ('{"tau": [1]}', "shape"),
    ('{"drag": {"link": "tip", "point": [0, 0, 0], "to": [1e9, 0, 0]}}', "<= 10000"),
    ('{"drag": {"link": "tipp", "point": [0, 0, 0], "to": [1, 0, 0]}}', "'tipp'"),
    ('{"tau": null, "tau": [1, 0]}', "twice"), ('{"torque": [1, 0]}', "torque"),
    ("[" * 17_000, "characters"),
])  # fmt: skip
def test_a_message_that_does_not_fit_is_told_and_the_motion_goes_on(served: Served, message: str, detail: str) -> None:
    with live(served) as socket:
        before = frame(socket)["t"]
        socket.send(message)
        assert detail in problem(socket)["detail"]
        later = frame(socket)
        assert "problem" not in later
        assert later["t"] > before


@pytest.mark.parametrize(("request_", "detail"), [
    ({"scene": "swing-up"}, "step by step"), ({"scene": "no-scene"}, "no-scene"),
    ({"scene": "../etc/passwd"}, "paths"), ({"frames_per_second": 1e6}, "<= 120"), ({"accuracy": -1.0}, "> 0"),
    ({"more": 1}, "more"),
])  # fmt: skip
def test_what_cannot_be_simulated_is_refused_and_ends(served: Served, request_: dict, detail: str) -> None:
    with live(served, **request_) as socket:
        assert detail in str(problem(socket))
        with pytest.raises(ConnectionClosed):
            frame(socket)


def test_huge_messages_and_floods_end_the_connection(served: Served) -> None:
    with live(served) as socket:
        frame(socket)
        with contextlib.suppress(ConnectionClosed):
            socket.send("x" * 2**21)
        with pytest.raises(ConnectionClosed) as closed:
            [*iter(lambda: frame(socket), None)]
        if closed.value.rcvd is not None:  # a reset of a connection that still sends overtakes the close frame
            assert closed.value.rcvd.code == 1009
    with live(served) as socket, contextlib.suppress(ConnectionClosed):
        frame(socket)
        for _ in range(5000):
            socket.send("{}")
        assert "messages a second" in problem(socket)["detail"]
        while True:
            frame(socket)


@pytest.mark.slow
def test_those_that_go_make_room(served: Served) -> None:
    """A client has at most half of four; a connection that breaks gives its place back."""
    for _ in range(6):
        with begun(served) as socket:
            socket.socket.close()
    with begun(served), begun(served), live(served) as third:
        assert problem(third)["code"] == "busy"


@contextlib.contextmanager
def begun(served: Served) -> Iterator[ClientConnection]:
    """A simulation that runs, as soon as there is room."""
    end = time.monotonic() + 60
    while True:
        with live(served) as socket:
            first = frame(socket)
            if "problem" not in first:
                yield socket
                return
            assert first["problem"]["code"] == "busy"
        assert time.monotonic() < end
        time.sleep(0.1)


@pytest.mark.slow
def test_who_finds_no_place_and_says_nothing_is_gone_in_seconds(served: Served) -> None:
    """They stayed for 12 s, uncounted: a client need not answer the close of a WebSocket."""
    place = httpx.URL(served.url)
    hello = (
        f"GET {PATH} HTTP/1.1\r\nHost: {place.host}:{place.port}\r\nOrigin: {served.url}\r\nUpgrade: websocket\r\n"
        "Connection: Upgrade\r\nSec-WebSocket-Key: dHdvbGluay10d29saW5rIQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
    )

    def silent() -> tuple[float, bytes]:
        with socket.create_connection((place.host, place.port), timeout=30) as connection:
            connection.sendall(hello.encode())
            began, told = time.monotonic(), b""
            while more := connection.recv(4096):
                told += more
            return time.monotonic() - began, told

    with ThreadPoolExecutor(40) as threads:
        ends = list(threads.map(lambda _: silent(), range(40)))
    refused = [seconds for seconds, told in ends if b"live already" in told]
    assert len(refused) >= 38
    assert max(refused) < 6.0
    assert min(refused) < 3.5  # of those for whom there is no place to wait


def test_other_sites_other_paths_and_strangers_are_refused(tmp_path: Path) -> None:
    with serving(tmp_path, "--token", "se/cret=") as served:
        token = base64.urlsafe_b64encode(b"se/cret=").decode().rstrip("=")
        for headers, protocols, path, status in (
            ({}, None, PATH, 401),
            ({}, ["bearer", "AAAA"], PATH, 401),
            ({}, ["bearer", "A"], PATH, 401),
            ({"Origin": "https://evil.example"}, ["bearer", token], PATH, 403),
            ({}, ["bearer", token], "/v1/other", 404),
        ):
            origin = headers.get("Origin")
            with pytest.raises((InvalidStatus, ValueError)) as refused:
                connect(served.url.replace("http", "ws", 1) + path, origin=origin, subprotocols=protocols)
            if isinstance(refused.value, InvalidStatus):
                assert refused.value.response.status_code == status
                assert json.loads(refused.value.response.body)["status"] == status
        for allowed in (
            {"subprotocols": ["bearer", token]},
            {"additional_headers": {"Authorization": "Bearer se/cret="}},
        ):
            with connect(address(served), **allowed) as socket:
                socket.send('{"scene": "arm-swing"}')
                assert frame(socket)["t"] == 0.0


LISTEN = """(() => { const send = WebSocket.prototype.send; window.sent = [];
    WebSocket.prototype.send = function (text) {
      if (!window.sent.length) this.addEventListener("message", e => { window.seen = JSON.parse(e.data);
        window.links ??= window.seen.links; });
      window.sent.push(text); return send.call(this, text); }; return true; })()"""


@pytest.mark.slow
@pytest.mark.browser
def test_a_link_is_dragged_with_the_mouse(page: Page) -> None:
    """The point that was taken hold of comes as near to the mouse as its link can, but for its sag, some g / w^2."""
    page.open("#scene=arm-swing")
    page.evaluate(LISTEN)
    page.click("#live-button")
    page.wait_for("document.getElementById('live-status').innerText.includes('Drag')")
    left, top, width, height = page.box("#pane")
    grabbed = "sent.some(text => text.includes('drag'))"
    places = [(x, y) for y in np.linspace(0.2, 0.8, 13) for x in np.linspace(0.2, 0.8, 13)]
    for x, y in places:
        page.mouse("mousePressed", left + x * width, top + y * height)
        if page.evaluate(grabbed):
            break
        page.mouse("mouseReleased", left + x * width, top + y * height)
    assert page.evaluate(grabbed)
    page.browser.call("Input.dispatchMouseEvent", type="mouseMoved", x=left + 0.45 * width, y=top + 0.4 * height,
                      button="left", buttons=1)  # fmt: skip
    page.wait_for("sent.filter(text => text.includes('drag')).length > 1")
    began = page.evaluate("seen.t")
    page.wait_for(f"seen.t > {began + 2.0}")
    frame, links = json.loads(page.evaluate("JSON.stringify(seen)")), page.evaluate("links")
    drag = json.loads(page.evaluate("sent.at(-1)"))["drag"]
    place = pin.XYZQUATToSE3(np.array(frame["poses"][links.index(drag["link"])]))
    robot = tl.load_robot("two_link")
    moved, turning = np.split(robot.frame_jacobian(frame["q"], drag["link"]), 2)
    moved = moved - pin.skew(place.rotation @ np.array(drag["point"])) @ turning
    left_over = np.array(drag["to"]) - place.act(np.array(drag["point"]))
    assert np.linalg.norm(moved @ np.linalg.pinv(moved) @ left_over) < 0.15
    page.mouse("mouseReleased", left + 0.45 * width, top + 0.4 * height)
    page.wait_for("sent.at(-1) === '{}'")
    page.click("#live-button")
    page.wait_for("document.getElementById('live-button').innerText === 'Live'")
    assert page.text("#live-problem") == ""
