"""The times of samples, the same in every call; and the arguments of the last release."""

import numpy as np
import pytest

import twolink as tl
from tests.effects.bodies import planar
from tests.near import assert_near
from twolink.errors import TwolinkError

SWING = tl.load_scene("arm-swing")
TIMES = [0.15, 0.5, 0.8]


def test_a_run_has_the_times_that_are_asked_for_and_goes_on_to_its_end() -> None:
    whole, some = (tl.simulate(SWING, 1.0, accuracy=1e-8, t_eval=times) for times in (None, TIMES))
    np.testing.assert_array_equal(some.t, TIMES)
    at = np.searchsorted(whole.t, TIMES)
    assert np.abs(some.q - whole.q[at]).max() <= some.error.max() + whole.error.max() <= 2e-8
    assert some.energy.shape == some.tau.shape[:1] == (3,)
    assert_near(some.at(1.0)[0], whole.q[-1], 2e-8)
    assert tl.simulate(SWING, 1.0, t_eval=1.0).t == [1.0]
    ends = tl.simulate(SWING, 1.0, t_eval=np.arange(0.0, 1.05, 0.1))  # whose last is 1 but for rounding
    assert ends.t[-1] == 1.0


def test_a_run_that_an_event_ends_has_that_time_too() -> None:
    ball = tl.load_scene("bouncing-ball")
    stop = tl.effects.Watch("low", when=tl.effects.JointReaches("height", 0.8), stop=True)
    run = tl.simulate(ball.with_effects([*ball.effects, stop]), t_eval=[0.1, 0.5])
    assert_near(run.t, [0.1, (0.4 / 9.81) ** 0.5], 1e-9)


@pytest.mark.slow
def test_released_payloads_and_stepped_contacts_have_them_too() -> None:
    pitch = tl.load_scene("pitch")
    whole, some = tl.simulate(pitch, t_eval=None), tl.simulate(pitch, t_eval=[0.0, pitch.duration])
    np.testing.assert_allclose(some.energy, whole.energy[[0, -1]], rtol=1e-5)
    contact = tl.effects.Contact(("ground",), shapes={"body": (tl.effects.Sphere(0.1),)})
    fall = tl.Scene(planar(), [0.0, 1.0, 0.0], effects=[tl.effects.Gravity(), contact])
    stepped = tl.simulate(fall, 0.4, contact="stepped", step=0.01, t_eval=[0.1, 0.3])
    np.testing.assert_array_equal(stepped.t, [0.1, 0.3])


@pytest.mark.parts
def test_derivatives_studies_and_explanations_take_them() -> None:
    found = tl.sensitivities(SWING, 1.0, wrt=["q"], t_eval=TIMES)
    np.testing.assert_array_equal(found.run.t, TIMES)
    assert found.q["q"].shape == (3, 2, 2)
    assert found.error["q"].shape == (3,)
    slope = tl.gradient(SWING, 1.0, objective="max-q:elbow", wrt=["q.elbow"], t_eval=TIMES)
    np.testing.assert_array_equal(slope.run.t, [0.0, *TIMES, 1.0])
    study = tl.accuracy_study(SWING, 0.5, methods=["dop853"], tolerances=[1e-6], repeats=1, t_eval=[0.2, 0.4])
    assert study.samples == 4
    assert tl.explain(SWING, 1.0, t_eval=TIMES).duration == 1.0
    best = tl.optimize(SWING, 0.5, objective="z:forearm", wrt={"v.elbow": (-1.0, 1.0)}, t_eval=[0.2], starts=1,
                       evaluations=2, curvature=False)  # fmt: skip
    np.testing.assert_array_equal(best.run.t, [0.0, 0.2, 0.5])


@pytest.mark.parametrize("call", [tl.simulate, tl.explain, tl.simulate_many, tl.sensitivities, tl.accuracy_study])
@pytest.mark.parametrize("times", [[0.5, 0.2], [0.2, 0.2], [-0.1], [0.5, 1.1], [], [np.nan], [[0.5]], "x"])
def test_times_that_do_not_fit_are_refused(call, times) -> None:
    with pytest.raises(TwolinkError, match="t_eval: "):
        call(SWING, 1.0, t_eval=times)


@pytest.mark.parametrize("call", [tl.simulate, tl.explain, tl.accuracy_study, tl.sensitivities])
def test_only_the_scene_and_the_duration_go_by_place(call) -> None:
    with pytest.raises(TypeError, match="positional"):
        call(SWING, 1.0, 1e-8)


def test_progress_has_one_signature() -> None:
    for call in (tl.simulate, tl.sensitivities, tl.simulate_many):
        seen: list[tuple[float, float, str]] = []
        call(SWING, 0.5, progress=lambda *told, seen=seen: seen.append(told))
        assert seen[-1][:2] == (0.5, 0.5)
        assert seen[-1][2] == "t = 0.5 s"
        with pytest.raises(TwolinkError, match="progress: expected a function of what is done, the total and a label"):
            call(SWING, 0.5, progress=lambda _: None)
