"""What an adversarial review found once, kept from coming back."""

import numpy as np
import pytest

import twolink as tl
from twolink.errors import AccuracyError, SceneError, TwolinkError

GRAVITY = tl.effects.Gravity()


def arm(*effects: object, q: object = None, duration: float = 1.0) -> tl.Scene:
    return tl.Scene(tl.load_robot("two_link"), q, None, [GRAVITY, *effects], duration)  # type: ignore[list-item]


def test_all_methods_see_a_loop_that_comes_without_forces() -> None:
    scene = arm(tl.effects.Coupling("elbow", "shoulder", 1.0))
    truth = tl.simulate(scene, accuracy=1e-10).q[-1]
    for method in ("scipy-dop853", "scipy-radau", "rk4", "esdirk43", "taylor"):
        run = tl.simulate(scene, accuracy=1e-6, method=method)
        np.testing.assert_allclose(run.q[-1], truth, rtol=0, atol=1e-6, err_msg=method)


def test_worlds_start_on_their_loops_and_a_moved_start_is_said() -> None:
    scene = arm(tl.effects.Coupling("elbow", "shoulder", 1.0, offset=2.0))
    run, worlds = tl.simulate(scene, accuracy=1e-9), tl.simulate_many(scene, accuracy=1e-9)
    np.testing.assert_allclose(worlds.q[0], run.q[-1], rtol=0, atol=1e-8)
    assert "moved" in str(run.events[0])


@pytest.mark.parametrize("options", [{"method": "rk4", "step": 10.0}, {"method": "dop853", "tolerance": 1e12}])
def test_settings_beyond_the_run_are_refused(options: dict) -> None:
    with pytest.raises(AccuracyError):
        tl.simulate(arm(), 1.0, **options)


def test_an_unstable_equilibrium_is_not_trusted() -> None:
    """At rest upright the exact answer is to stay; what rounding does to it in 8 s no double can tell."""
    scene = arm(q=[np.pi / 2, 0.0])
    with pytest.raises(AccuracyError):
        tl.simulate(scene, 20.0, accuracy=1e-3, samples=1)
    worlds = tl.simulate_many(scene, duration=20.0, accuracy=0.1)
    assert worlds.kept is not None
    assert not worlds.kept.any()


def test_bars_of_worlds_hold() -> None:
    rng = np.random.default_rng(2)
    q, v = rng.uniform(-3, 3, (40, 2)), rng.uniform(-3, 3, (40, 2))
    rough = tl.simulate_many(arm(), q=q, v=v, duration=2.0, accuracy=1e-3)
    fine = tl.simulate_many(arm(), q=q, v=v, duration=2.0, accuracy=1e-9)
    true = np.abs(rough.q - fine.q).max(axis=1)
    assert rough.error is not None
    assert (true <= rough.error).all()


@pytest.mark.parametrize(
    "call",
    [
        lambda: tl.simulate_many(arm(), parameters={"upper_arm.mass": -0.2}),
        lambda: tl.simulate_many(arm(), parameters={"forearm.mass": "x"}),
        lambda: tl.simulate_many(arm(), parameters=[1.0]),  # type: ignore[arg-type]
        lambda: tl.simulate_many(arm(), samples=-1),
        lambda: tl.simulate_many(arm(), samples=10**9),
        lambda: tl.simulate_many(arm(), q=np.zeros((0, 2))),
        lambda: tl.simulate_many(arm(), accuracy=1e-16),
        lambda: tl.simulate(arm(), accuracy=10**400),
        lambda: tl.explain(arm(), accuracy=float("nan")),
        lambda: tl.simulate(arm(), 1.0, method="rk4", step=1e-12),
        lambda: arm(tl.effects.Coupling("elbow", "elbow", 1.0)),
        lambda: setattr(arm(), "q", [1.0, 1.0]),
    ],
)
def test_odd_input_is_refused_in_words(call: object) -> None:
    with pytest.raises(TwolinkError):
        call()  # type: ignore[operator]


def test_worlds_bits_do_not_depend_on_their_number() -> None:
    q = np.random.default_rng(4).uniform(-1, 1, (100, 2))
    whole = tl.simulate_many(arm(), q=q, duration=1.0, verify=False)
    for count in (1, 8, 17, 40, 64):
        part = tl.simulate_many(arm(), q=q[:count], duration=1.0, verify=False)
        assert np.array_equal(part.q, whole.q[:count])


def test_saving_does_not_overwrite_another_urdf(tmp_path) -> None:  # type: ignore[no-untyped-def]
    from twolink.lagrange.pinocchio_arm import arm_urdf

    (tmp_path / "mine.urdf").write_text("something else")
    with pytest.raises(SceneError, match="another file"):
        tl.Scene(tl.load_robot(arm_urdf(1, 2, 3, 4))).save(tmp_path / "mine.toml")
