"""Optimization: closed forms of best values, derivatives against runs, and what a search keeps and says."""

import json
from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.parts.design.test_gradient import slope
from tests.refusals import refusal
from tests.urdf_text import joint, link
from tests.urdf_text import robot_of as robot_text
from twolink.errors import SceneError
from twolink.parts.design.evaluation import ObjectiveEvaluator, variables_of
from twolink.parts.design.objectives import Extreme, FramePosition, FrameSpeed, Integral, StateDistance, final_energy

PLANE = robot_text(link("side", 2.0), link("ball", 2.0), joint("x", "prismatic", "ground", "side", "1 0 0"),
                   joint("z", "prismatic", "side", "ball", "0 0 1"))  # fmt: skip
G, SPEED, HEIGHT = 9.81, 5.0, 1.5


def thrown(*more: tl.effects.Effect) -> tl.Scene:
    """A ball in a plane that falls to the ground, where the run ends."""
    effects = tl.effects
    landed = effects.Watch("landed", when=effects.FrameReaches("ball", 0.0), stop=True)
    return tl.Scene(tl.load_robot(PLANE), [0.0, HEIGHT], [2.0, 2.0], [effects.Gravity(), *more, landed], 5.0)


@pytest.mark.slow
def test_the_farthest_throw_with_a_limited_speed_is_the_textbook_one() -> None:
    """From a height h: range V sqrt(V^2 + 2 g h) / g, at tan of the elevation V / sqrt(V^2 + 2 g h)."""
    limit = {"speed": lambda run: SPEED**2 - float(run.v[0] @ run.v[0])}
    wrt = {"v.x": (0.5, 8.0), "v.z": (0.5, 8.0)}
    options = {"maximize": True, "constraints": limit, "starts": 2, "accuracy": 1e-9}
    found = tl.optimize(thrown(), wrt=wrt, objective="x:ball", **options)
    scene, run, history = found
    root = np.sqrt(SPEED**2 + 2 * G * HEIGHT)
    assert found.objective == pytest.approx(SPEED * root / G, abs=1e-8)
    assert abs(found.objective - SPEED * root / G) <= found.error + 1e-8
    assert scene.v[1] / scene.v[0] == pytest.approx(SPEED / root, abs=1e-4)
    assert run.error is not None
    assert abs(run.q[-1, 1]) < 1e-9  # it has landed
    assert found.constraints["speed"] == pytest.approx(0.0, abs=1e-6)
    assert set(history.select("derivatives").rows) == {("sensitivities",)}
    assert found.simulations <= len(history) + 6


def test_the_least_effort_from_rest_to_rest_is_the_textbook_one() -> None:
    """m x'' = u over 1 s and 1 m: u = m (6 - 12 t), of which the squared integral is 12 m^2."""
    push = tl.effects.Torque({"x": tl.effects.Polynomial((1.0, 0.0))})
    scene = tl.Scene(tl.load_robot(PLANE), effects=[push], duration=1.0)
    mass = scene.robot.mass
    wrt = {f"effects.0.inputs.x.coefficients.{k}": (-100.0, 100.0) for k in (0, 1)}
    limits = {"there": lambda run: run.q[-1, 0] - 1.0, "slow": lambda run: -run.v[-1, 0],
              "forward": lambda run: run.v[-1, 0]}  # fmt: skip
    options = {"constraints": limits, "starts": 1, "accuracy": 1e-9, "curvature": False}
    found = tl.optimize(scene, wrt=wrt, objective="effort", **options)
    assert found.objective == pytest.approx(12 * mass**2, rel=1e-6)
    assert list(found.values.values()) == pytest.approx([6 * mass, -12 * mass], rel=1e-5)
    assert Integral("jerk")(found.run) == pytest.approx(12**2, rel=1e-4)
    assert np.isnan(found.hessian).all()


WALL = tl.effects.Watch("landed", when=tl.effects.JointReaches("x", 50.0), stop=True)  # named as the other end is
CASES = {
    "landing": (thrown, {"v.x": (0, 8), "q.z": (0.1, 3)}, FramePosition("ball", "x")),
    "landing, or at a wall": (lambda: thrown(WALL), {"v.x": (0, 8), "q.z": (0.1, 3)}, FramePosition("ball", "x")),
    "landing speed": (thrown, {"v.z": (0, 8), "gravity.z": (-12, -5)}, FrameSpeed("ball")),
    "place of the ground": (thrown, {"effects.1.when.value": (-1, 1)}, FramePosition("ball", "x")),
    "arm": (lambda: arm(), {"q.elbow": (-1, 1), "forearm.mass": (0.1, 9)}, FramePosition("forearm")),
    "energy": (lambda: arm(), {"v.elbow": (-1, 1), "forearm.mass": (0.1, 9)}, final_energy),
    "effort": (lambda: held(), {"effects.1.kp.elbow": (1, 9), "q.elbow": (-1, 1)}, Integral("effort")),
    "peak": (lambda: held(), {"effects.1.kp.elbow": (1, 9), "v.elbow": (-1, 1)}, Extreme("min", "a", "elbow")),
    "path": (lambda: led(), {f"effects.1.path.elbow.points.{k}": (-1, 1) for k in (1, 2)}, Integral("jerk")),
    "rest": (lambda: held(), {"effects.1.kd.elbow": (0, 2), "v.elbow": (-1, 1)}, StateDistance((("elbow", 0.3),))),
}  # fmt: skip


def arm() -> tl.Scene:
    scene = tl.load_scene("arm-swing")
    return tl.Scene(scene.base, [0.2, 0.4], [0.3, -1.0], scene.effects)


def led() -> tl.Scene:
    path = {"shoulder": tl.effects.Bezier((0.2, 0.3), 0.7), "elbow": tl.effects.Bezier((0.4, 0.5, 0.2, 0.8), 0.7)}
    track = tl.effects.ComputedTorque(path, 100.0, 20.0)
    return tl.Scene(tl.load_robot("two_link"), [0.2, 0.4], effects=[tl.effects.Gravity(), track])


def held() -> tl.Scene:
    control = tl.effects.JointPD({"elbow": 0.5}, {"elbow": 4.0}, {"elbow": 0.5})
    return tl.Scene(tl.load_robot("two_link"), [0.2, 0.4], effects=[tl.effects.Gravity(), control])


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_derivatives_along_a_run_agree_with_differences_of_runs(case: str) -> None:
    make, wrt, objective = CASES[case]
    scene, length = make(), 5.0 if "landing" in case or "ground" in case else 0.7
    variables = variables_of(scene, wrt)
    times = np.linspace(0.0, length, round(100 * length) + 1)
    evaluate = ObjectiveEvaluator(variables, {"objective": objective}, times, 1e-9)
    found = evaluate(variables.own)
    assert found.by == "sensitivities"
    assert found.simulations == 1

    def value_at(x: np.ndarray) -> float:
        return evaluate.values_of(evaluate.run(variables.scene_at(x)))[0]

    for k, (step, unit) in enumerate(zip(5e-4 * variables.width, np.eye(len(wrt)), strict=True)):
        truth = slope(lambda x, unit=unit: value_at(variables.own + x * unit), step)
        assert abs(truth) > 1e-3
        assert found.gradients[0, k] == pytest.approx(truth, rel=1e-6, abs=1e-6)


def test_what_sensitivities_do_not_follow_is_a_difference_of_runs_and_said() -> None:
    """A table's values, and an objective that asks for states between samples."""
    table = tl.effects.Sampled((0.0, 0.5, 1.0), (0.5, 0.5, 0.5), interpolation="linear")
    scene = tl.Scene(tl.load_robot(PLANE), effects=[tl.effects.Torque({"x": table})], duration=1.0)
    wrt = {f"effects.0.inputs.x.values.{k}": (-4.0, 4.0) for k in (0, 1)}
    found = tl.optimize(scene, wrt=wrt, objective=lambda run: run.at(0.77)[0][0], maximize=True, starts=1)
    assert list(found.values.values()) == [4.0, 4.0]
    assert found.on_bound == dict.fromkeys(wrt, "high")
    assert all(record["derivatives"].startswith("differences of runs: ") for record in found.history)
    assert "derivatives: differences of runs" in str(found)


def test_a_function_of_what_a_variable_moves_unseen_is_found_out() -> None:
    """The time of an event, which is not in the samples: differences of runs stand in from the first evaluation on."""
    scene = thrown()
    watch = tl.effects.Watch("high", when=tl.effects.FrameReaches("ball", HEIGHT + 0.1))
    scene = scene.with_effects([*scene.effects, watch])

    def late(run: tl.Trajectory) -> float:
        return (run.events[0].t - 0.03) ** 2

    found = tl.optimize(scene, wrt={"v.z": (1.9, 6.0)}, objective=late, starts=1, accuracy=1e-9)
    assert found.history.to_records()[-1]["derivatives"].startswith("differences of runs: ")
    vz = found.values["v.z"]
    assert (vz - np.sqrt(vz**2 - 2 * G * 0.1)) / G == pytest.approx(0.03, abs=1e-4)


def test_a_file_of_another_function_of_the_same_name_is_refused(tmp_path: Path) -> None:
    asked = {"duration": 0.3, "wrt": {"v.elbow": (-1.0, 1.0)}, "starts": 1, "curvature": False}
    first, out = tl.optimize(arm(), objective=lambda run: run.q[-1, 0], **asked), tmp_path / "search.json"
    for _ in range(2):  # written, and gone on from
        assert tl.optimize(arm(), objective=lambda run: run.q[-1, 0], out=out, **asked).values == first.values
    with refusal(SceneError, code="another-search", match="its functions give"):
        tl.optimize(arm(), objective=lambda run: run.q[-1, 1] ** 2 + 3.0, out=out, **asked)


@pytest.mark.slow
def test_a_search_goes_on_from_its_file_with_the_same_result(tmp_path: Path) -> None:
    scene, wrt, out = thrown(), {"v.x": (0.5, 3.0), "v.z": (0.5, 3.0)}, tmp_path / "search.json"

    def objective(run: tl.Trajectory) -> float:
        return (run.q[-1, 0] - 1.0) ** 2 + 0.1 * float(run.v[0] @ run.v[0])

    asked = {"wrt": wrt, "objective": objective, "starts": 1}
    whole = tl.optimize(scene, **asked)
    seen: list[int] = []

    def press(done: int, _most: int, _label: str) -> None:
        seen.append(done)
        if done == 3 and len(seen) < 6:
            raise KeyboardInterrupt

    part = tl.optimize(scene, **asked, out=out, progress=press)
    assert part.interrupted
    assert len(part.history) == 3
    assert part.objective == min(record["objective"] for record in part.history)
    assert "interrupted" in str(part)
    first = len(seen)
    rest = tl.optimize(scene, **asked, out=out, progress=lambda done, *_: seen.append(done))
    assert seen[first] == 3  # the first three are not computed again
    assert rest.values == whole.values
    assert [r["objective"] for r in rest.history] == [r["objective"] for r in whole.history]
    with refusal(SceneError, code="another-search", match="its maximize is False, not True"):
        tl.optimize(scene, **asked, out=out, maximize=True)
    out.write_text("{}")
    with refusal(SceneError, code="not-a-search"):
        tl.optimize(scene, wrt=wrt, objective=objective, out=out)
    assert json.loads(json.dumps(rest.to_dict(), allow_nan=False))["simulations"] >= len(rest.history)


@pytest.mark.parametrize(("wrt", "objective", "code", "part"), [
    ({"effects.0.field": (0, 1)}, "energy", "unknown-parameter", "effects.0.field."),
    ({}, "energy", "no-variables", "expected bounds by name"),
    ({"v.elbo": (0, 1)}, "energy", "unknown-parameter", "did you mean 'v.elbow'"),
    ({"v.elbow": (1, 0)}, "energy", "bounds", "(1, 0)"),
    ({"v.elbow": (0, float("inf"))}, "energy", "bounds", "v.elbow"),
    ({"v.elbow": (None, 1.0)}, "energy", "bounds", "(None, 1.0)"),
    ({"forearm.mass": (-1, 1)}, "energy", "scene", "forearm.mass"),
    ({"forearm.inertia.yy": (-0.1, 9.0)}, "energy", "impossible-body", "forearm.inertia: no body has"),
    ({"v.elbow": (0, 1)}, "energie", "unknown-objective", "energy"),
    ({"v.elbow": (0, 1)}, "max-v:elbw", "scene", "there is no joint 'elbw' with one coordinate"),
    ({"v.elbow": (0, 1)}, "rest:elbw=0", "scene", "there is no joint 'elbw' with one coordinate"),
    ({"v.elbow": (0, 1)}, "x:hand", "scene", "there is no frame 'hand'"),
    ({"v.elbow": (0, 1)}, lambda run: run.q, "objective", "expected a finite number"),
    ({"v.elbow": (0, 1)}, lambda run: 0.0 * run.t[0] + float("nan"), "objective", "nan"),
    ({"v.elbow": (0, 1)}, 3.0, "objective", "expected a function of a run, got 3.0"),
])  # fmt: skip
def test_errors_name_parameter_value_and_expectation(wrt, objective, code: str, part: str) -> None:
    with pytest.raises(tl.errors.TwolinkError) as caught:
        tl.optimize(tl.load_scene("arm-swing"), wrt=wrt, objective=objective, duration=0.1)
    assert part in str(caught.value)
    assert not code or caught.value.code == code


def test_constraints_have_names() -> None:
    with pytest.raises(SceneError, match="by name") as caught:
        tl.optimize(tl.load_scene("arm-swing"), wrt={"v.elbow": (0, 1)}, objective="energy", duration=0.1,
                    constraints=[lambda run: run.q[-1, 0]])  # fmt: skip
    assert caught.value.argument == "constraints"
