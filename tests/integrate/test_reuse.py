"""Code for other numbers: a changed mass, stiffness or initial state compiles nothing anew before the first answer."""

from collections.abc import Callable

import numpy as np
import pytest

import twolink as tl
from twolink.dynamics.kernels import heyoka
from twolink.integrate.motion import scene_equations
from twolink.integrate.solvers import taylor_code
from twolink.integrate.steps import compile_time
from twolink.lagrange.check import arm_urdf
from twolink.scenes.parameters import scene_with

STIFFNESS, MASS = 3.0, 1.0


def arm(mass: float = MASS, stiffness: float = STIFFNESS, elbow: float = 0.2, length: float = 1.0) -> tl.Scene:
    """Two rods under gravity with a spring at the elbow."""
    spring = tl.effects.JointSpring({"elbow": stiffness})
    return tl.Scene(tl.load_robot(arm_urdf(length, 1, 1, mass)), (0.1, elbow), effects=[tl.effects.Gravity(), spring])


@pytest.fixture
def compilations(monkeypatch: pytest.MonkeyPatch) -> Callable[[], int]:
    """How many functions heyoka has compiled since the last call; nothing is compiled yet, and parts pay at once."""
    counted = [0]
    module = heyoka()
    monkeypatch.setenv("TWOLINK_CACHE", "off")
    monkeypatch.setattr("twolink.integrate.steps.compiled_functions._kept", {})
    monkeypatch.setattr(compile_time, "QUICK", 0.0)
    monkeypatch.setattr(compile_time, "SHARE", 10.0)
    for owner, names in (
        (compile_time, ["_spent"]),
        (taylor_code, ["_pool"]),
        (scene_equations, ["_structures"]),
    ):
        for name in names:
            monkeypatch.setattr(owner, name, {})
    for name in ("cfunc", "taylor_adaptive"):
        monkeypatch.setattr(module, name, counting(getattr(module, name), counted))

    def since() -> int:
        number, counted[0] = counted[0], 0
        return number

    return since


def counting(function: Callable[..., object], counted: list[int]) -> Callable[..., object]:
    """The function, whose calls are counted."""

    def call(*args: object, **options: object) -> object:
        counted[0] += 1
        return function(*args, **options)

    return call


def test_sensitivities_at_other_values_compile_nothing_anew(compilations: Callable[[], int]) -> None:
    """Neither the variational equations by a number nor the steps, where each scene is solved a few times only."""
    names = ["effects.1.stiffness.elbow", "forearm.mass"]
    with compile_time.solved_rarely():
        tl.sensitivities(arm(), wrt=names, duration=0.5)
        assert compilations() > 0
        for values in ({names[1]: 2.5}, {names[0]: 8.0}):
            found = tl.sensitivities(scene_with(arm(), values), wrt=names, duration=0.5)
            assert compilations() == 0
    exact = tl.sensitivities(arm(stiffness=8.0), wrt=names, duration=0.5)
    for name in names:
        assert np.abs(found.q[name] - exact.q[name]).max() <= found.error[name][-1] + exact.error[name][-1]


@pytest.mark.parametrize("interpolation", ["hold", "linear", "cubic"])
def test_other_samples_of_a_table_compile_nothing_anew(interpolation: str, compilations: Callable[[], int]) -> None:
    def pushed(value: float) -> tl.Scene:
        table = tl.effects.Sampled((0.0, 0.2, 0.4, 0.6), (0.0, value, 1.0, 0.0), interpolation=interpolation)
        return tl.Scene(arm().base, effects=[tl.effects.Torque({"elbow": table})])

    tl.simulate(pushed(1.0), 0.5, method="dop853", tolerance=1e-9, verify=False)
    assert compilations() > 0
    run = tl.simulate(pushed(-4.0), 0.5, method="dop853", tolerance=1e-9, verify=False)
    assert compilations() == 0
    other = tl.simulate(pushed(-4.0), 0.5, method="scipy-dop853", tolerance=1e-9, verify=False)
    np.testing.assert_allclose(run.q, other.q, rtol=0, atol=1e-8)


@pytest.mark.parametrize("method", ["taylor", "dop853"])
def test_changed_numbers_compile_nothing_anew(method: str, compilations: Callable[[], int]) -> None:
    """And the motion is that of the changed numbers, as SciPy solves it on Pinocchio's rates."""
    tl.simulate(arm(), 1.0, method=method, tolerance=1e-9, verify=False)
    assert compilations() > 0
    for scene in (arm(mass=2.5), arm(stiffness=8.0), arm(mass=0.4, stiffness=0.5, elbow=-0.7)):
        found = tl.simulate(scene, 1.0, method=method, tolerance=1e-9, verify=False)
        assert compilations() == 0
        expected = tl.simulate(scene, 1.0, method="scipy-dop853", tolerance=1e-11, verify=False)
        np.testing.assert_allclose(found.q, expected.q, rtol=0, atol=1e-7)


@pytest.mark.parametrize("method", ["taylor", "dop853"])
def test_what_is_no_number_compiles_anew(method: str, compilations: Callable[[], int]) -> None:
    """A length, and an effect that is absent, have code of their own."""
    tl.simulate(arm(), 1.0, method=method, tolerance=1e-9, verify=False)
    for scene in (arm(length=1.3), arm().without(1)):
        compilations()
        found = tl.simulate(scene, 1.0, method=method, tolerance=1e-9, verify=False)
        assert compilations() > 0
        expected = tl.simulate(scene, 1.0, method="scipy-dop853", tolerance=1e-11, verify=False)
        np.testing.assert_allclose(found.q, expected.q, rtol=0, atol=1e-7)
