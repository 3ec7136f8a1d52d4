"""Runs between their samples: states, accelerations and torques; tables; pickling."""

import pickle
import sys

import numpy as np
import pinocchio as pin
import pytest

import twolink as tl
from tests.effects.bodies import slider
from twolink.errors import AccuracyError, MissingExtraError, QueryError, SceneError

BALL_G, BALL_HEIGHT = 9.81, 1.0


def finely(scene: tl.Scene, end: float) -> tl.Trajectory:
    """A more accurate run with many samples, to compare with."""
    return tl.simulate(scene, end, accuracy=1e-11, samples_per_second=1000)


@pytest.mark.parametrize("method", ["dop853", "rk45", "taylor", "esdirk43", "rk4", "scipy-dop853"])
def test_states_between_samples_are_as_exact_as_at_samples(method: str) -> None:
    scene = tl.load_scene("arm-swing")
    run, truth = tl.simulate(scene, 1.0, accuracy=1e-6, method=method, samples_per_second=7), finely(scene, 1.0)
    times = truth.t[[3, 501, 999, 250, 1]]
    q, v = run.at(times)
    assert q.shape == (5, 2)
    assert np.abs(q - truth.q[[3, 501, 999, 250, 1]]).max() <= run.error[-1]
    assert np.abs(v - truth.v[[3, 501, 999, 250, 1]]).max() <= 100 * run.error[-1]


def test_a_lsoda_run_adds_no_error_between_its_samples() -> None:
    """LSODA begins at order 1 with a guessed step: between samples it would err 1.7 times as much as at them."""
    scene = tl.Scene(tl.load_scene("arm-swing").robot, v=[1.0, -2.0])
    run = tl.simulate(scene, 4.0, accuracy=1e-3, method="scipy-lsoda", samples_per_second=4)
    truth = tl.simulate(scene, 4.0, accuracy=1e-11, samples_per_second=32)
    error = np.abs(run.at(truth.t)[0] - truth.q).max(axis=1)
    assert error.max() < 1.2 * error[::8].max()


def test_shapes_follow_the_times_and_samples_come_back_exactly() -> None:
    run = tl.simulate(tl.load_scene("spinning-top"), 0.5, samples_per_second=20)
    q, v = run.at(0.2)
    assert q.shape == (run.robot.nq,)
    assert v.shape == (run.robot.nv,)
    q, v = run.at([[0.1, 0.2], [0.3, 0.5]])
    assert q.shape == (2, 2, run.robot.nq)
    np.testing.assert_array_equal(run.at(run.t)[0], run.q)
    np.testing.assert_array_equal(run.at(run.t)[1], run.v)
    np.testing.assert_allclose(np.linalg.norm(q[..., run.robot.joints[0].normalized], axis=-1), 1, atol=1e-14)


@pytest.mark.parametrize("method", ["dop853", "rk4", "esdirk43", "taylor", "scipy-rk45"])
def test_times_a_rounding_after_samples_have_their_states(method: str) -> None:
    run = tl.simulate(tl.load_scene("arm-swing"), 0.5, accuracy=1e-4, method=method, samples_per_second=20)
    later = np.nextafter(run.t[:-1], np.inf)
    np.testing.assert_allclose(run.at(later)[0], run.q[:-1], rtol=0, atol=1e-14)
    assert np.isfinite(run.at(np.linspace(0, 0.5, 301))[0]).all()


@pytest.mark.parametrize("t", [-1e-9, 0.5 + 1e-9, np.nan])
def test_times_outside_the_run_are_refused(t: float) -> None:
    run = tl.simulate(tl.load_scene("arm-swing"), 0.5, samples_per_second=10)
    with pytest.raises(SceneError, match="is not within 0 and") as caught:
        run.at([0.1, t])
    assert (caught.value.code, caught.value.argument) == ("outside-run", "t")
    with pytest.raises(QueryError, match="t: expected real numbers"):
        run.at("noon")
    assert caught.value.data == {"start": 0, "end": 0.5}


def test_a_time_between_samples_and_after_an_event_uses_the_piece_after_it() -> None:
    """The ball of the bundled scene, sampled so rarely that impacts lie between samples: against a dense run."""
    scene = tl.load_scene("bouncing-ball")
    sparse, dense = (
        tl.simulate(scene, 1.0, accuracy=1e-9, samples_per_second=2),
        tl.simulate(scene, 1.0, accuracy=1e-9, samples_per_second=1000),
    )
    impacts = [event.t for event in sparse.events if event.kind == "impact"]
    assert impacts
    q, v = sparse.at(dense.t)
    np.testing.assert_allclose(q, dense.q, atol=1e-7)
    np.testing.assert_allclose(v, dense.v, atol=1e-6)
    before, after = sparse.at(impacts[0] - 1e-9)[1], sparse.at(impacts[0])[1]
    assert np.abs(after - before).max() > 0.5  # at the instant the state after it


E = tl.effects
FRICTION = E.DryFriction({"shoulder": 2.0, "elbow": 1.0}, {"elbow": 3.0})
TABLE = E.Torque({"elbow": E.Sampled((0.0, 0.5, 2.0), (1.0, -2.0, 3.0))})


@pytest.mark.parametrize("effects", [[], [E.JointDamping({"elbow": 0.3}), E.DryFriction({"shoulder": 2.0})], [FRICTION],
                                     [FRICTION, TABLE]])  # fmt: skip
def test_torques_and_accelerations_are_those_of_inverse_dynamics(effects: list) -> None:
    scene = tl.Scene(tl.load_robot("two_link"), [0.5, 0.3], effects=[E.Gravity(), *effects])
    run = tl.simulate(scene, 2.0, method="dop853", samples_per_second=50)
    model, data = run.robot.model, run.robot.model.createData()
    for q, v, a, tau in zip(run.q, run.v, run.acceleration, run.tau, strict=True):
        np.testing.assert_allclose(pin.rnea(model, data, q, v, a), tau, atol=1e-10)
    assert run.tau.shape == run.acceleration.shape == (101, 2)
    if len(effects) == 2 and TABLE not in effects:
        np.testing.assert_allclose(run.tau[:, 1], -0.3 * run.v[:, 1], atol=1e-12)


def test_friction_that_holds_gives_the_torque_against_the_load() -> None:
    run = tl.simulate(tl.Scene(slider(), effects=[E.DryFriction({"x": 3.0}), E.Torque({"x": 2.0})]), 1.0)
    assert not run.acceleration.any()
    assert np.abs(run.tau).max() < 1e-12


def test_tables_of_other_libraries() -> None:
    run = tl.simulate(tl.load_scene("arm-swing"), 0.1)
    data, frame = run.to_xarray(), run.to_pandas()
    assert dict(data.sizes) == {"time": 21, "q_name": 2, "v_name": 2}
    np.testing.assert_array_equal(data.q.sel(q_name="elbow"), run.q[:, 1])
    assert (data.q.attrs["units"], data.time.attrs["units"], data.energy.attrs["units"]) == ("rad or m", "s", "J")
    assert data.attrs["robot"] == "two_link"
    assert [frame.index.name, *frame.columns] == list(run.columns())
    np.testing.assert_array_equal(frame["v.elbow"], run.v[:, 1])


def test_a_missing_library_is_named_with_its_installation(monkeypatch: pytest.MonkeyPatch) -> None:
    run = tl.simulate(tl.load_scene("arm-swing"), 0.1)
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(MissingExtraError, match="pip install"):
        run.to_xarray()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["arm-swing", "bouncing-ball", "four-bar", "pitch"])
def test_runs_survive_pickling(name: str) -> None:
    run = tl.simulate(tl.load_scene(name), 0.3, accuracy=1e-5)
    again = pickle.loads(pickle.dumps(run))
    np.testing.assert_array_equal(again.q, run.q)
    assert again.events == run.events
    assert again.cost == run.cost
    times = 0.5 * (run.t[1:4] + run.t[:3])
    np.testing.assert_array_equal(again.at(times)[0], run.at(times)[0])


def test_an_accuracy_limit_has_a_code_and_its_run_and_survives_pickling() -> None:
    scene = tl.Scene(tl.load_scene("arm-swing").robot, [2.0, 1.0], effects=[tl.effects.Gravity()])
    with pytest.raises(AccuracyError) as caught:
        tl.simulate(scene, 60.0, accuracy=1e-9, samples_per_second=5, precision="double")
    error = pickle.loads(pickle.dumps(caught.value))
    assert error.code == "accuracy-limit"
    assert error.data["precision"] == "quad"
    assert 0 < error.data["trusted_until"] == error.run.trusted_until < 60
    assert str(error) == str(caught.value)
    assert "less accuracy" not in error.remedy  # its bar is thousands of rad at the end
    with pytest.raises(AccuracyError, match=r"or less accuracy, such as [0-9]e-[0-9]+, or"):
        tl.simulate(scene, 2.0, accuracy=1e-14, samples_per_second=5, precision="double")


def test_what_notebooks_show_is_short() -> None:
    run = tl.simulate(tl.load_scene("arm-swing"), 0.5)
    assert "error <= " in repr(run)
    assert "tolerance" in repr(run.cost)
    shown = run.cost._repr_html_()
    assert shown.startswith("<pre>")
    assert shown.count("\n") <= 5


def test_beside_a_singular_instant_the_motion_is_that_of_its_samples() -> None:
    """From a sample just before it short parts of steps meet it with a stage; the run's own steps get across."""
    scene = tl.load_scene("four-bar")
    times = np.linspace(3.165, 3.18, 61)
    coarse = tl.simulate(scene, 4.0, samples_per_second=200)
    fine = tl.simulate(scene, 4.0, t_eval=times)
    assert coarse.at(times)[0] == pytest.approx(fine.q, abs=1e-6)
