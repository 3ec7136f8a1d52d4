"""Live playing: at true speed, in a real browser, and the server always ends."""

from __future__ import annotations

import itertools
import os
import signal
import socket
import subprocess
import sys
import textwrap
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

# `browser` is a fixture: imported, so that pytest finds it here.
from tests.show.browser import Browser, browser  # noqa: F401
from twolink.errors import ShowError
from twolink.show.live import play_live
from twolink.show.motion_samples import resample

URDF = Path(__file__).parents[2] / "urdf" / "two_link.urdf"


def servers() -> set[int]:
    """The process ids of all meshcat servers on this machine."""
    pids = set()
    for process in Path("/proc").glob("[0-9]*"):
        try:
            command = (process / "cmdline").read_bytes()
        except OSError:
            continue
        if b"meshcat.servers.zmqserver" in command and b"python" in command:
            pids.add(int(process.name))
    return pids


@pytest.fixture
def arm() -> tuple[Any, Any]:
    model = pin.buildModelFromUrdf(str(URDF))
    return model, pin.buildGeomFromUrdf(model, str(URDF), pin.GeometryType.VISUAL)


@pytest.fixture(autouse=True)
def _no_server_stays() -> Any:
    before = servers()
    yield
    end = time.monotonic() + 5.0  # a killed process takes a moment to leave /proc
    while (left := servers() - before) and time.monotonic() < end:
        time.sleep(0.05)
    assert not left


def motion(seconds: float) -> tuple[np.ndarray, np.ndarray]:
    t = np.linspace(0.0, seconds, 101)
    return t, np.column_stack([-1.5 * t / seconds, 0.8 * t / seconds])


def test_without_a_browser_playing_ends_in_an_error(arm: tuple[Any, Any]) -> None:
    urls: list[str] = []
    begun = time.monotonic()
    with pytest.raises(ShowError, match="no browser opened http://127") as failure:
        play_live(*arm, *motion(1.0), open_browser=False, wait=0.5, on_url=urls.append)
    assert urls[0] in str(failure.value)
    assert time.monotonic() - begun < 30.0


def test_nothing_is_printed(arm: tuple[Any, Any], capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ShowError):
        play_live(*arm, *motion(1.0), open_browser=False, wait=0.2)
    assert capfd.readouterr() == ("", "")


def test_the_server_ends_when_the_caller_is_interrupted(arm: tuple[Any, Any]) -> None:
    def interrupt(_: str) -> None:
        assert servers()
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        play_live(*arm, *motion(1.0), open_browser=False, on_url=interrupt)


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no SIGKILL here")
def test_the_server_ends_when_the_caller_is_killed() -> None:
    script = f"""
        import pinocchio as pin
        from twolink.show.live import play_live
        model = pin.buildModelFromUrdf({str(URDF)!r})
        visuals = pin.buildGeomFromUrdf(model, {str(URDF)!r}, pin.GeometryType.VISUAL)
        play_live(model, visuals, [0, 1], [[0, 0], [1, 1]], open_browser=False,
                  on_url=lambda url: print(url, flush=True))
    """
    environment = {**os.environ, "PYTHONPATH": str(URDF.parents[1])}
    command = [sys.executable, "-c", textwrap.dedent(script)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
        assert process.stdout is not None
        assert process.stdout.readline().startswith("http://")
        assert servers()
        process.kill()  # the autouse fixture looks that nothing is left


def test_the_motion_is_checked_first(arm: tuple[Any, Any]) -> None:
    with pytest.raises(ShowError, match="q is not finite at sample 1"):
        play_live(*arm, [0.0, 1.0], [[0.0, 0.0], [np.nan, 0.0]], open_browser=False)
    with pytest.raises(ShowError, match="speed is 0"):
        play_live(*arm, [0.0, 1.0], [[0.0, 0.0], [1.0, 0.0]], speed=0.0, open_browser=False)


@pytest.mark.parametrize("now", [-1.0, 0.0, 0.005, 0.61, 1.0, 2.0])
def test_a_configuration_between_samples_is_interpolated(arm: tuple[Any, Any], now: float) -> None:
    t, q = motion(1.0)
    expected = [np.interp(now, t, q[:, i]) for i in range(2)]
    np.testing.assert_allclose(resample(arm[0], t, q, np.array([now]))[0], expected, atol=1e-12)


@pytest.mark.browser
def test_a_browser_shows_the_motion_with_the_usual_ports_taken(
    arm: tuple[Any, Any],
    browser: Browser,  # noqa: F811
) -> None:
    t, q = motion(6.0)
    busy = []
    for port in (6000, 7000):  # the server's usual ports: taken, by us or by someone else
        taken = socket.socket()
        taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            taken.bind(("127.0.0.1", port))
            taken.listen()
        except OSError:
            taken.close()
            continue
        busy.append(taken)
    address: list[str] = []
    announced, failures = threading.Event(), []

    def announce(url: str) -> None:
        address.append(url)
        announced.set()

    def play() -> None:
        try:
            play_live(*arm, t, q, open_browser=False, on_url=announce)
        except BaseException as failure:
            failures.append(failure)

    player = threading.Thread(target=play)
    player.start()
    try:
        assert announced.wait(60.0), failures
        assert not address[0].endswith(":7000/static/")
        browser.open(address[0])
        pictures = []
        while player.is_alive() and len(pictures) < 50:
            pictures.append(browser.screenshot())
        player.join(30.0)
        assert not player.is_alive()
        assert not failures
    finally:
        player.join(60.0)
        for taken in busy:
            taken.close()
    moved = [(a != b).any(axis=-1).sum() for a, b in itertools.pairwise(pictures)]
    assert sum(pixels > 500 for pixels in moved) >= 2, moved
    assert [error for error in browser.errors if "favicon.ico" not in error] == []  # meshcat has none


@pytest.mark.browser
def test_two_seconds_take_two_seconds(
    arm: tuple[Any, Any],
    browser: Browser,  # noqa: F811
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    import twolink.show.live as live

    seconds: list[float] = []
    play = live._play

    def timed(*arguments: Any) -> None:
        begun = time.monotonic()
        play(*arguments)
        seconds.append(time.monotonic() - begun)

    monkeypatch.setattr(live, "_play", timed)
    urls: list[str] = []
    options = {"speed": 2.0, "open_browser": False, "on_url": urls.append}
    player = threading.Thread(target=play_live, args=(*arm, *motion(4.0)), kwargs=options)
    player.start()
    while not urls and player.is_alive():
        time.sleep(0.05)
    browser.open(urls[0])
    player.join(60.0)
    assert seconds[0] == pytest.approx(2.0, rel=0.25)
