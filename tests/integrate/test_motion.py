"""Motion: what a solution passes, and a tick that is interrupted."""

from typing import Any

import numpy as np
import pytest

import twolink as tl
from tests.integrate.problems import GRAVITY, arm
from twolink.integrate.core import smooth, track
from twolink.integrate.core.smooth import solve_smooth
from twolink.integrate.motion.scene_equations import equations_of
from twolink.integrate.steps.methods import METHODS
from twolink.integrate.steps.step_map import StepMap
from twolink.integrate.steps.stepping import Block
from twolink.loop import calls

TIMES = np.linspace(0, 2, 401)


def test_samples_are_the_same_where_too_many_steps_to_keep_are_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    equations = equations_of(arm())
    whole = solve_smooth(equations, METHODS["rk4"], TIMES, 0.002)
    monkeypatch.setattr(track, "MAX_KEPT", 500)
    part = solve_smooth(equations, METHODS["rk4"], TIMES, 0.002)
    np.testing.assert_array_equal(part.x, whole.x)
    assert part.segments[0].taken is None
    assert whole.segments[0].taken is not None


def test_a_tick_that_ctrl_c_ends_is_due_again(monkeypatch: pytest.MonkeyPatch) -> None:
    control = tl.effects.Controller(lambda _, y, state: (-5.0 * y.q - y.v, state), period=0.1)
    scene = tl.load_scene("arm-swing")
    scene = scene.with_effects([*scene.effects, control])
    sim, other = tl.Simulation(scene), tl.Simulation(scene)
    asked = calls.answer

    def interrupted(place: int, joints: Any, own: Any, t: float, y: Any) -> Any:
        if t >= 0.3:
            raise KeyboardInterrupt
        return asked(place, joints, own, t, y)

    monkeypatch.setattr(calls, "answer", interrupted)
    with pytest.raises(KeyboardInterrupt):
        sim.step(1.0)
    monkeypatch.undo()
    assert sim.t == pytest.approx(0.3)
    sim.step(1.0 - sim.t)
    other.step(1.0)
    np.testing.assert_allclose(sim.state.q, other.state.q, rtol=0, atol=1e-12)


def test_a_sample_of_a_solution_beside_a_run_is_taken_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of an unstable loop, in which some need more steps to a tick than others: a later look changes no sample."""
    taken = smooth.take_samples

    def once(by: StepMap, block: Block, times: np.ndarray, out: np.ndarray) -> None:
        before = out.copy()
        taken(by, block, times, out)
        assert (np.isnan(before) | (before == out)).all()

    monkeypatch.setattr(smooth, "take_samples", once)
    law = tl.effects.Controller(lambda _, y, s: (100.0 * (0.1 - y.q) - 20.0 * y.v, s), 1e-3, traced=False)
    scene = tl.Scene(tl.load_robot("panda"), effects=[*GRAVITY, law])
    run = tl.simulate(scene, 0.6, method="rk45", tolerance=1e-8)
    assert [event.kind for event in run.events] == ["unstable-loop"]
