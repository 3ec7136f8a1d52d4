"""The first steps, compiled in parts: the same motion as by whole compiled steps, which take over when they pay."""

import numpy as np
import pytest

import twolink as tl
from tests.integrate.problems import arm, box
from twolink.integrate.motion.scene_equations import equations_of
from twolink.integrate.steps import compile_time
from twolink.integrate.steps import step_map as step_map_module
from twolink.integrate.steps.compile_time import UNOPTIMIZED
from twolink.integrate.steps.methods import METHODS
from twolink.integrate.steps.step_building import compiled_rate
from twolink.integrate.steps.step_map import step_map
from twolink.integrate.steps.stepping import integrate

TIMES = np.linspace(0.0, 1.0, 11)


@pytest.fixture(autouse=True)
def fresh(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is compiled yet, whole steps always take too long, and others cost nothing."""
    monkeypatch.setenv("TWOLINK_CACHE", "off")
    monkeypatch.setattr("twolink.integrate.steps.compiled_functions._kept", {})
    monkeypatch.setattr(compile_time, "QUICK", 0.0)
    monkeypatch.setattr(compile_time, "SHARE", 10.0)
    monkeypatch.setattr(compile_time, "EVALUATION", 0.0)
    monkeypatch.setattr(compile_time, "WORLD", 0.0)
    monkeypatch.setattr(compile_time, "_spent", {})


@pytest.mark.parametrize(("scene", "name"), [(arm(), "dop853"), (arm(), "rk4"), (box(), "rk45")])
def test_the_motion_is_that_of_whole_steps(scene: tl.Scene, name: str) -> None:
    equations = equations_of(scene)
    steps, whole = step_map(equations, METHODS[name]), step_map(equations, METHODS[name], whole=True)
    assert (steps.compiled, whole.compiled) == ("parts", "steps")
    setting = 1e-10 if METHODS[name].adaptive else 1e-3
    found, expected = integrate(steps, TIMES, setting), integrate(whole, TIMES, setting)
    assert found.steps == expected.steps
    np.testing.assert_allclose(found.x, expected.x, rtol=0, atol=1e-12)
    assert found.compiled == "parts"


def test_whole_steps_take_over_when_they_pay() -> None:
    equations, method = equations_of(arm()), METHODS["rk4"]
    steps = step_map(equations, method)
    assert integrate(steps, TIMES, 1e-3).compiled == "parts"
    compile_time.count(equations.key("step", "rk4"), 1e3)
    found, expected = integrate(steps, TIMES, 1e-3), integrate(step_map(equations, method, whole=True), TIMES, 1e-3)
    assert found.compiled == "steps"  # the last blocks are
    assert found.compile_seconds > 0.0
    np.testing.assert_allclose(found.x, expected.x, rtol=0, atol=1e-12)


def test_what_was_compiled_once_is_used() -> None:
    equations = equations_of(arm())
    step_map(equations, METHODS["rk4"], whole=True)
    assert step_map(equations, METHODS["rk4"]).compiled == "steps"


def test_a_first_answer_says_how_it_came() -> None:
    run = tl.simulate(arm(), 0.5, method="dop853")
    assert run.cost is not None
    assert run.cost.compiled == "parts"
    assert "compiled in parts" in str(run.cost)


def test_optimized_parts_take_over_where_whole_steps_compile_too_long(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("solvers.method_choice", "steps.step_map", "steps.compile_time"):
        monkeypatch.setattr(f"twolink.integrate.{module}.in_parts", lambda *_: True)
    monkeypatch.setattr(compile_time, "QUICK", -1.0)
    scene, built = arm(), []
    monkeypatch.setattr(step_map_module, "compiled_rate", lambda *a, **k: (built.append(k), compiled_rate(*a, **k))[1])
    runs = [tl.simulate(scene, 0.5)]
    compile_time.count(equations_of(scene).key("rate", "whole"), 1e3)
    runs += [tl.simulate(scene, 0.5), tl.simulate(arm(), 0.5)]
    assert built == [UNOPTIMIZED, {}]
    costs = [(run.cost.method, run.cost.compiled) for run in runs if run.cost is not None]
    assert costs == [("dop853", "parts")] * 3
    np.testing.assert_allclose(runs[1].q, runs[0].q, rtol=0, atol=1e-9)
