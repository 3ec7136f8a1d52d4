"""Size of playback files, and the time from opening one in headless Chromium to its first picture.

    scripts/bench_viewer.py [ROBOT ...] [--seconds 10]

Each page is opened by a browser that has drawn nothing yet: one that still draws another robot is later. Chromium draws
with the processor here; with a graphics card the picture comes sooner.
"""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

import twolink as tl
from tests.show.browser import Browser, Chromium, find_chromium

ROBOTS = ("two_link", "panda", "talos", "anymal")
READY = "window.viewer && viewer.motion && viewer.stage.viewer.renderer.info.render.triangles > 0"


def motion(name: str, seconds: float) -> tl.Trajectory:
    """A robot whose joints swing."""
    robot, t = tl.load_robot(name), np.linspace(0.0, seconds, 601)
    swing = 0.3 * np.sin(t[:, None] * np.linspace(0.5, 1.5, robot.nv) + np.arange(robot.nv))
    q = np.array([robot.integrate(robot.neutral, row) for row in swing])
    return tl.Trajectory(robot, t, q, np.zeros((len(t), robot.nv)), None, None)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robots", nargs="*", default=ROBOTS)
    parser.add_argument("--seconds", type=float, default=10.0)
    options = parser.parse_args()
    executable = find_chromium()
    if executable is None:
        parser.error("no Chromium found; install it or set CHROMIUM=/path/to/it")
    print(f"{'robot':12} {'MB':>6} {'write, CPU s':>13} {'first picture, s':>17}")
    with tempfile.TemporaryDirectory() as folder:
        for name in options.robots:
            run, start = motion(name, options.seconds), time.process_time()
            page = run.playback(Path(folder, f"{name}.html"))
            made = time.process_time() - start
            with Chromium(executable) as chromium, Browser(chromium) as browser:
                start = time.perf_counter()
                browser.call("Page.navigate", url=page.as_uri())
                browser.wait_for(READY)
                shown = time.perf_counter() - start
            print(f"{name:12} {page.stat().st_size / 1e6:6.2f} {made:13.2f} {shown:17.2f}")


if __name__ == "__main__":
    main()
