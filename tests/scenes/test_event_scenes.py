"""The bundled scenes of bounces and dry friction against their exact laws."""

import numpy as np
import pytest

import twolink as tl
from twolink.scenes import bundled_scenes

G = 9.81


@pytest.mark.some(2)
@pytest.mark.parametrize("name", ["bouncing-ball", "pendulum-friction", "pitch", "bowl"])
def test_they_run_as_they_are(name: str) -> None:
    assert name in bundled_scenes()
    scene = tl.load_scene(name)
    assert scene.title
    run = tl.simulate(scene)
    assert run.error.max() <= 1e-6
    assert run.events
    assert scene.robot.visual_model().ngeoms > 1


def test_friction_takes_its_moment_times_the_way() -> None:
    """m g l (cos b - cos a) = c (a + b) in each half swing; it ends where |m g l sin| <= s, and not before."""
    scene = tl.load_scene("pendulum-friction")
    run = tl.simulate(scene, accuracy=1e-9, samples_per_second=1000)
    moment, c, s = 1.0 * G * 0.5, 0.4, 0.7
    (stuck,) = (event.t for event in run.events if event.kind == "stick")
    ends = [1.2]
    while abs(moment * np.sin(ends[-1])) > s:
        a, (low, high) = abs(ends[-1]), (0.0, abs(ends[-1]))
        for _ in range(60):
            b = 0.5 * (low + high)
            low, high = (b, high) if moment * (np.cos(b) - np.cos(a)) > c * (a + b) else (low, b)
        ends.append(-np.sign(ends[-1]) * low)
    assert len(ends) == 7
    assert run.q[-1, 0] == pytest.approx(ends[-1], abs=2e-9)
    turns = [run.t[0], *(event.t for event in run.events)]
    for t, angle in zip(turns, ends, strict=True):
        near = int(np.argmin(np.abs(run.t - t)))  # within 0.5 ms of the turn: 1/2 a t^2 off it
        assert run.q[near, 0] == pytest.approx(angle, abs=3e-6)
    after = run.t > stuck
    assert after.any()
    assert np.ptp(run.q[after]) == 0.0
    assert not run.v[after].any()
    way = 2 * sum(abs(angle) for angle in ends) - abs(ends[0]) - abs(ends[-1])
    assert run.energy[0] - run.energy[-1] == pytest.approx(c * way, abs=1e-8)
