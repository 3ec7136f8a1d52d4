"""What every result has: texts, plain data, files, figures; a run its scene; events their direction."""

import json
from pathlib import Path

import pytest

import twolink as tl

SWING = tl.load_scene("arm-swing")
WRT = ["q.elbow", "v"]
RESULTS = {
    "Trajectory": lambda: tl.simulate(SWING, 0.5),
    "Worlds": lambda: tl.simulate_many(SWING, 0.5, q=[[0.0, 0.0], [0.1, 0.2]]),
    "Explanation": lambda: tl.explain(SWING, 0.5),
    "Sensitivities": lambda: tl.sensitivities(SWING, 0.5, wrt=WRT),
    "Gradient": lambda: tl.gradient(SWING, 0.5, objective="z:forearm", wrt=WRT),
    "Optimum": lambda: tl.optimize(SWING, 0.5, objective="z:forearm", wrt={"v.elbow": (-1.0, 1.0)}, starts=1,
                                   evaluations=3, curvature=False),
    "EnergyBalance": lambda: tl.energy_book(SWING),
    "Study": lambda: tl.accuracy_study(SWING, 0.5, methods=["dop853"], tolerances=[1e-6], repeats=1),
    "Linearization": lambda: tl.linearize(SWING),
    "Equilibria": lambda: tl.equilibria(SWING, starts=4),
}  # fmt: skip


@pytest.mark.some(5)
@pytest.mark.parametrize("name", RESULTS)
def test_a_result_has_texts_data_a_file_and_a_figure(name: str, tmp_path: Path) -> None:
    result = RESULTS[name]()
    assert type(result) is getattr(tl, name)
    assert result.summary
    assert "\n" not in result.summary
    assert result.summary in result.text()
    assert result._repr_html_().startswith("<")
    data = json.dumps(result.to_dict(), allow_nan=False)
    if name in ("Trajectory", "Worlds"):  # their file is a table
        assert result.save(tmp_path / "a.npz").stat().st_size > 0
    else:
        assert json.loads(result.save(tmp_path / "a.json").read_text()) == json.loads(data)
    assert result.plot(tmp_path / "a.png").stat().st_size > 10_000


def test_a_run_knows_its_scene_but_for_a_loaded_one(tmp_path: Path) -> None:
    run = tl.simulate(SWING, 0.5)
    assert run.scene is SWING
    assert tl.Trajectory.load(run.save(tmp_path / "a.npz")).scene is None


@pytest.mark.parametrize(("direction", "seen"), [(0, [-1, 1, -1]), (1, [1]), (-1, [-1, -1])])
def test_a_watch_may_have_a_direction_and_its_events_have_one(direction: int, seen: list[int]) -> None:
    ball, height = tl.load_scene("bouncing-ball"), tl.effects.JointReaches("height", 0.3)
    watch = tl.effects.Watch("low", when=height, direction=direction)
    run = tl.simulate(ball.with_effects([*ball.effects, watch]), 1.2, accuracy=1e-8)
    watched = [event for event in run.events if event.kind == "watch"]
    assert [event.direction for event in watched] == seen
    for event in watched:
        q, v = run.at(event.t)
        assert q[0] == pytest.approx(0.3, abs=1e-8)
        assert v[0] * event.direction > 0.0


def test_a_direction_of_a_time_is_refused() -> None:
    with pytest.raises(tl.errors.SceneError, match="direction: expected 1, -1 or 0"):
        SWING.with_effects([*SWING.effects, tl.effects.Watch("noon", at=0.1, direction=1)])
