"""Pitch and bowl: the scenes against point masses and the laws of slip and roll, and the search for the best throw."""

import contextlib
import functools
import re
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

import twolink as tl
from tests.command import answer, call, one_line
from twolink.parts.design.throw import AIMS, Throw, ball_state, throw

G, RADIUS, MASS = 9.81, 0.0366, 0.145
BALL = 0.108  # the bowling ball's radius
PITCHED, BOWLED = {"ball": 0.095595, "elbow": 0.045762}, {"ball": 0.279466}


@functools.cache
def pitched(accuracy: float = 1e-9) -> Throw:
    return throw(tl.load_scene("pitch"), AIMS["pitch"], PITCHED, accuracy, verify=True)


@functools.cache
def bowled() -> Throw:
    return throw(tl.load_scene("bowl"), AIMS["bowl"], BOWLED, 1e-9, verify=True)


def landing(place: np.ndarray, velocity: np.ndarray, drag: float) -> float:
    """Where a point mass comes down to the ball's radius: x'' = -drag |x'| x' / m - g."""

    def rate(_: float, y: np.ndarray) -> np.ndarray:
        speed = np.linalg.norm(y[2:])
        return np.concatenate([y[2:], -drag / MASS * speed * y[2:] - [0.0, G]])

    def height(_: float, y: np.ndarray) -> float:
        return y[1] - RADIUS

    height.terminal, height.direction = True, -1.0
    start = [place[0], place[2], velocity[0], velocity[2]]
    solution = solve_ivp(rate, (0.0, 10.0), start, method="DOP853", rtol=1e-13, atol=1e-13, events=height)
    return float(solution.y_events[0][0, 0])


@pytest.mark.slow
def test_a_pitched_ball_flies_as_a_point_mass_in_air() -> None:
    """Drag of rho c A / 2; an independent integration from the place and velocity at the release."""
    one = pitched()
    area = np.pi * RADIUS**2
    assert one.end == pytest.approx(landing(one.joints[2], one.velocity, 0.5 * 1.2 * 0.35 * area), abs=1e-9)
    assert one.errors["end"] < 1e-9


@pytest.mark.slow
def test_nothing_jumps_at_the_release() -> None:
    """The ball leaves with the hand's velocity and spin, and in a microsecond the energy changes by the power's."""
    one, scene = pitched(), tl.load_scene("pitch")
    states = [tl.simulate(scene, t, accuracy=1e-9) for t in (PITCHED["ball"], PITCHED["ball"] + 1e-6)]
    before, after = ((run.q[-1], run.v[-1]) for run in states)
    np.testing.assert_allclose(ball_state(one.run.robot, *before)[1], one.velocity, rtol=0, atol=1e-9)
    model, data = scene.robot.model, scene.robot.model.createData()
    pin.forwardKinematics(model, data, *before)
    hand, held = (pin.getFrameVelocity(model, data, model.getFrameId(name), pin.LOCAL_WORLD_ALIGNED)
                  for name in ("hand", "ball"))  # fmt: skip
    np.testing.assert_allclose(held.vector, hand.vector, rtol=0, atol=1e-9)
    assert np.abs(after[1] - before[1]).max() < 1e-2  # accelerations of up to 10^4 rad/s^2
    energies = [sum(scene.robot.energy(*state)) for state in (before, after)]
    assert abs(energies[1] - energies[0]) < 5e-3
    kinetic = 0.5 * MASS * one.speed**2
    assert kinetic > 13.0


@pytest.mark.slow
def test_a_bowled_ball_slides_and_rolls_by_the_laws() -> None:
    """Rolling at (5 v + 2 R w) / 7 of the release, whatever the bounces and the sliding between."""
    one = bowled()
    run, release = one.run, BOWLED["ball"]
    first = int(np.argmax(run.t > release))
    spin = run.v[first, 4]  # about y; forward is positive
    assert spin < -5.0  # an underarm swing gives backspin
    assert one.end == pytest.approx((5 * one.velocity[0] + 2 * BALL * spin) / 7, abs=1e-9)
    kinds = [event.kind for event in run.events if event.what != "released"]
    assert kinds[:2] == ["release", "impact"]
    assert kinds[-2:] == ["roll", "watch"]
    assert kinds.index("impact") < kinds.index("slide") < kinds.index("roll")
    rolling = run.t > next(event.t for event in run.events if event.kind == "roll")
    np.testing.assert_allclose(run.v[rolling, 4] * BALL, one.end, rtol=0, atol=1e-8)


NEAR = [("pitch", PITCHED, "ball"), ("pitch", PITCHED, "elbow"), ("bowl", BOWLED, "ball")]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "times", "what"), NEAR)
def test_no_throw_beside_the_best_is_as_good(name: str, times: dict[str, float], what: str) -> None:
    scene = tl.load_scene(name)
    end = (pitched() if name == "pitch" else bowled()).end
    compiling = []
    for shift in (-1e-3, 1e-3):
        other = throw(scene, AIMS[name], {**times, what: times[what] + shift}, 1e-6)
        assert 1e-5 < end - other.end < 0.1
        assert other.run.cost is not None
        compiling.append(other.run.cost.compile_seconds)
    assert min(compiling) == 0.0  # the times are not compiled in; optimized code may follow once


@pytest.mark.slow
def test_pitch_as_json_with_a_figure(tmp_path: Path) -> None:
    """The search finds the scene's times again, from the middle of their windows, and says what a millisecond costs."""
    figure = tmp_path / "pitch.png"
    record = answer("throw", "pitch", "--out", str(figure))
    assert figure.stat().st_size > 10_000
    assert record["written"] == str(figure)
    for what, at in PITCHED.items():
        assert record["times"][what] == pytest.approx(at, abs=1e-5)
        assert 0 < record["times_error"][what] < 1e-5
    assert record["best"]["end"]["value"] == pytest.approx(pitched().end, abs=1e-6)
    assert 0 < record["best"]["end"]["error"] < 1e-6
    assert record["error"] <= 1e-6
    assert {one["derivatives"] for one in record["history"]} == {"sensitivities"}
    assert record["simulations"] < 25
    assert max(one["objective"] for one in record["history"]) <= record["best"]["end"]["value"] + 1e-6
    scene, step = tl.load_scene("pitch"), 1e-3
    for what, by in record["by_time"].items():  # by throws beside the best one
        early, late = (throw(scene, AIMS["pitch"], {**record["times"], what: record["times"][what] + shift}, 1e-9).end
                       for shift in (-step, step))  # fmt: skip
        assert 0.5 * by["curvature"] * step**2 == pytest.approx(0.5 * (early + late) - pitched().end, rel=0.05)
        assert abs(by["slope"]) < 0.01 * abs(by["curvature"]) * step  # m/s, beside what it is a millisecond off
        assert 0 < by["error"] < 1e-3


@pytest.mark.slow
def test_ctrl_c_keeps_the_best_so_far(monkeypatch: pytest.MonkeyPatch) -> None:
    def press(done: int, _total: int, _label: str) -> None:
        if done == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr("twolink.parts.design.commands.progress_bar", lambda: contextlib.nullcontext(press))
    done = call("throw", "pitch")
    assert (done.returncode, done.stderr) == (130, "twolink: interrupted; what was done is kept\n")
    assert "after 2 throws" in done.stdout
    assert re.search(r"ball let go +\d+\.\d+ \(error not known\) ms", done.stdout)


@pytest.mark.parametrize(("arguments", "part"), [
    (["juggle"], "what: there is no throw 'juggle'"),
    (["bowl", "--out", "x.html"], "'.html' is not a format we know"),
    (["bowl", "--accuracy", "0"], "accuracy: expected a number above 0"),
])  # fmt: skip
def test_misuse(arguments: list[str], part: str) -> None:
    one_line(call("throw", *arguments), 2, part)
