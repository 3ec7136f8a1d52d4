"""Live playing: at true speed, in a real browser, and the server always ends."""

import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

import twolink as tl
from tests.command import TOP
from tests.show.browser import Browser
from tests.show.pieces import URDF
from twolink.errors import ShowError
from twolink.show.playback import play_live
from twolink.show.viewer_data import resample


def motion(seconds: float) -> tuple[np.ndarray, np.ndarray]:
    t = np.linspace(0.0, seconds, 101)
    return t, np.column_stack([-1.5 * t / seconds, 0.8 * t / seconds])


def answers(url: str) -> bool:
    """Whether a server answers at the address."""
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    try:
        with opener.open(url, timeout=5.0) as answer:
            return bool(answer.read())
    except (urllib.error.URLError, ConnectionError):
        return False


@contextmanager
def player(*arguments: Any, **options: Any) -> Iterator[tuple[str, threading.Thread]]:
    """The address at which a thread waits to play; the thread must end without a failure."""
    announced, urls, failures = threading.Event(), [], []

    def announce(url: str) -> None:
        urls.append(url)
        announced.set()

    def play() -> None:
        try:
            play_live(*arguments, open_browser=False, on_url=announce, **options)
        except BaseException as failure:
            failures.append(failure)

    thread = threading.Thread(target=play)
    thread.start()
    try:
        assert announced.wait(60.0), failures
        yield urls[0], thread
    finally:
        thread.join(90.0)
    assert not thread.is_alive()
    assert failures == []


def test_without_a_browser_playing_ends_in_an_error(arm: tuple[Any, Any], capfd: pytest.CaptureFixture[str]) -> None:
    urls: list[str] = []
    begin = time.monotonic()
    with pytest.raises(ShowError, match="no browser opened http://127") as failure:
        play_live(*arm, *motion(1.0), open_browser=False, wait=0.5, on_url=urls.append)
    assert failure.value.code == "no-browser"
    assert urls[0] in str(failure.value)
    assert time.monotonic() - begin < 30.0
    assert not answers(urls[0])
    assert capfd.readouterr() == ("", "")


def test_the_server_ends_when_the_caller_is_interrupted(arm: tuple[Any, Any]) -> None:
    urls: list[str] = []

    def interrupt(url: str) -> None:
        urls.append(url)
        assert answers(url)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        play_live(*arm, *motion(1.0), open_browser=False, on_url=interrupt)
    assert not answers(urls[0])


@pytest.mark.parametrize("started", [False, True])
def test_ctrl_c_counts_whichever_thread_the_system_gives_it_to(arm: tuple[Any, Any], started: bool) -> None:
    """A signal to another thread does not wake the one that waits."""

    def interrupt(url: str) -> None:
        def soon() -> None:
            if started:
                answers(url + "started")
            time.sleep(0.5)
            signal.pthread_kill(threading.get_ident(), signal.SIGINT)

        threading.Thread(target=soon).start()

    begin = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        play_live(*arm, *motion(30.0), open_browser=False, wait=30.0, on_url=interrupt)
    assert time.monotonic() - begin < 20.0


def test_the_server_ends_when_the_caller_is_killed() -> None:
    script = f"""
        import pinocchio as pin
        from twolink.show.playback import play_live
        model = pin.buildModelFromUrdf({str(URDF)!r})
        visuals = pin.buildGeomFromUrdf(model, {str(URDF)!r}, pin.GeometryType.VISUAL)
        play_live(model, visuals, [0, 1], [[0, 0], [1, 1]], open_browser=False,
                  on_url=lambda url: print(url, flush=True))
    """
    environment = {**os.environ, "PYTHONPATH": str(TOP)}
    command = [sys.executable, "-c", textwrap.dedent(script)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
        assert process.stdout is not None
        url = process.stdout.readline().strip()
        assert answers(url)
        process.kill()
    assert not answers(url)


def test_only_the_page_is_served(arm: tuple[Any, Any]) -> None:
    with player(*arm, *motion(0.1)) as (url, _):
        assert answers(url)
        assert not answers(url + "etc/passwd")
        assert not answers(url + "started")  # an empty answer, which starts the time


@pytest.mark.parametrize("now", [-1.0, 0.0, 0.005, 0.61, 1.0, 2.0])
def test_a_configuration_between_samples_is_interpolated(arm: tuple[Any, Any], now: float) -> None:
    t, q = motion(1.0)
    expected = [np.interp(now, t, q[:, i]) for i in range(2)]
    np.testing.assert_allclose(resample(arm[0], t, q, np.array([now]))[0], expected, atol=1e-12)


def test_velocities_make_cubics_between_samples_but_across_jumps() -> None:
    robot = tl.load_robot("go1", root="free")
    q, v = robot.random_state(1, seed=3)
    run = tl.simulate(tl.Scene(robot, q[0], v[0], [tl.effects.Gravity()]), 0.4, samples_per_second=20)
    at = np.linspace(0.0, 0.4, 31)
    lines, cubics = (resample(robot.model, run.t, run.q, at, given) for given in (None, run.v))
    apart = [np.abs(robot.difference(run.at(at)[0], x)).max() for x in (lines, cubics)]
    assert apart[0] > 1e-3
    assert apart[1] < 1e-6
    ball = tl.simulate(tl.load_scene("bouncing-ball"), samples_per_second=10)
    at = np.linspace(0.0, ball.t[-1], 300)
    bounced = resample(ball.robot.model, ball.t, ball.q, at, ball.v, [event.t for event in ball.events])
    exact, hops = ball.at(at)[0], np.searchsorted([event.t for event in ball.events], ball.t)
    free = (hops[1:] == hops[:-1])[np.clip(np.searchsorted(ball.t, at, side="right") - 1, 0, len(ball.t) - 2)]
    np.testing.assert_allclose(bounced[free], exact[free], atol=1e-9)  # parabolas
    assert np.abs(bounced - exact).max() < 0.2


@pytest.mark.slow
@pytest.mark.browser
def test_a_browser_shows_the_motion_once(arm: tuple[Any, Any], browser: Browser) -> None:
    with player(*arm, *motion(6.0)) as (url, _):
        browser.open(url)
        browser.wait_for("window.viewer?.motion")
        browser.evaluate("window.seen = []; viewer.onTime = t => seen.push(t)")
    browser.wait_for("!viewer.timeline.playing")  # the page stays, with the last pose
    seen = browser.evaluate("seen")
    assert seen == sorted(set(seen))
    assert len(seen) >= 2
    forearm = browser.evaluate("viewer.robot.links.get('elbow').group.position.toArray()")
    np.testing.assert_allclose(forearm, [np.cos(-1.5), 0.0, np.sin(-1.5)], atol=1e-6)
    assert len(np.unique(browser.screenshot().reshape(-1, 3), axis=0)) > 50
    assert browser.evaluate("document.getElementById('clock').textContent") == "6.00 s"
    asked = {request for request in browser.requests if not request.startswith(("data:", "blob:"))}
    assert {request.rpartition("/")[0] + "/" for request in asked} == {url}
    assert browser.errors == []


@pytest.mark.slow
@pytest.mark.browser
def test_speed_two_plays_four_seconds_in_two(arm: tuple[Any, Any], browser: Browser) -> None:
    rate = """new Promise(done => {
        const begin = performance.now();
        viewer.timeline.seek(0);
        viewer.timeline.play();
        setTimeout(() => done(1000 * viewer.timeline.t / (viewer.timeline.last - begin)), 1500);
    })"""
    begin = time.monotonic()
    with player(*arm, *motion(4.0), speed=2.0) as (url, _):
        browser.open(url)
        browser.wait_for("window.viewer?.motion && viewer.timeline.t > 0")
    assert time.monotonic() - begin > 2.0
    assert browser.evaluate(rate) == pytest.approx(2.0, abs=0.6)  # simulated s per s, played again
