"""Parameters of a scene: one resolver of names, with one error, for all that takes them."""

from collections.abc import Callable

import numpy as np
import pytest

import twolink as tl
from twolink.algorithms.mechanism import with_nominal
from twolink.errors import SceneError
from twolink.scenes.parameters import named_parameters, parameters_of, scene_with

E = tl.effects
ARM = tl.load_scene("arm-human")
TIMES = np.linspace(0.0, 1.0, 20)
MEASURED = {"t": TIMES, "q": np.cos(TIMES)[:, None] * [1.0, 0.5]}
TAKES_NAMES: dict[str, Callable[[str], object]] = {
    "sensitivities": lambda name: tl.sensitivities(ARM, wrt=[name], duration=0.1),
    "gradient": lambda name: tl.gradient(ARM, objective="energy", wrt=[name], duration=0.1),
    "simulate_many": lambda name: tl.simulate_many(ARM, parameters={name: 1.0}, duration=0.1),
    "optimize": lambda name: tl.optimize(ARM, wrt={name: (0.5, 1.0)}, objective="energy", duration=0.1),
    "sweep": lambda name: tl.sweep(ARM, vary={name: [1.0]}, out="never.zarr"),
    "fit": lambda name: tl.fit(ARM, MEASURED, [name]),
    "scene_with": lambda name: scene_with(ARM, {name: 1.0}),
}


@pytest.mark.parametrize("who", TAKES_NAMES)
def test_a_typo_has_one_error_everywhere(who: str) -> None:
    with pytest.raises(SceneError, match=r"no parameter 'effects\.1\.damping\.elbw'; did you mean") as caught:
        TAKES_NAMES[who]("effects.1.damping.elbw")
    assert caught.value.code == "unknown-parameter"
    assert "'effects.1.damping.elbow'" in caught.value.remedy


def test_parameters_have_value_unit_and_bound() -> None:
    robot = tl.load_robot("spinning_box", root="free")
    scene = tl.Scene(robot, effects=[E.Gravity(), E.Payload(robot.frame_names[-1], 1.5)])
    found = parameters_of(scene)
    mass = next(one for one in found.values() if one.name.endswith(".mass") and one.kind == "constant")
    assert (mass.unit, mass.lowest, mass.nominal) == ("kg", 0.0, pytest.approx(scene.robot.mass))
    assert (found["effects.1.mass"].nominal, found["effects.1.mass"].kind) == (1.5, "effect")
    assert sum(one.kind == "q" for one in found.values()) == 3  # a quaternion's entries are not free
    assert sum(one.kind == "v" for one in found.values()) == 6


def test_values_of_tables_can_be_changed_and_have_no_derivatives() -> None:
    drive = E.Torque({"shoulder": E.Sampled(times=(0.0, 1.0), values=(0.5, 1.0))})
    scene, name = ARM.with_effects([E.Gravity(), drive]), "effects.1.inputs.shoulder.values.1"
    assert named_parameters(scene_with(scene, {name: 3.0}), [name], "wrt")[0].nominal == 3.0
    worlds = tl.simulate_many(scene, parameters={name: [1.0, 3.0]}, duration=0.2)
    assert np.abs(worlds.q[0] - tl.simulate(scene, 0.2).q[-1]).max() < 2e-6 < np.ptp(worlds.q, axis=0).max()
    for call in (lambda: tl.sensitivities(scene, wrt=[name], duration=0.1), lambda: tl.fit(scene, MEASURED, [name])):
        with pytest.raises(SceneError, match="value of a table") as caught:
            call()
        assert caught.value.code == "sensitivity-undefined"


def test_worlds_start_at_coordinates_by_name() -> None:
    worlds = tl.simulate_many(ARM, parameters={"q.elbow": [0.1, 0.3], "v.shoulder": -1.0}, duration=0.2)
    for i, elbow in enumerate((0.1, 0.3)):
        start = scene_with(ARM, {"q.elbow": elbow, "v.shoulder": -1.0})
        assert np.abs(worlds.q[i] - tl.simulate(start, 0.2).q[-1]).max() < 2e-6
    assert not worlds.parameters


RELEASE = (E.Gravity(), E.Release(E.Payload("forearm", 2.0, (0.0, 0.0, 0.3)), at=0.2))


def forearm_of(mass: float) -> tl.Scene:
    """A robot whose own forearm has this mass, and a payload that it releases."""
    robot = tl.load_robot("two_link").changed(lambda model: with_nominal(model, "forearm.mass", mass))
    return tl.Scene(robot, [0.2, 0.4], [0.3, -1.0], RELEASE, 1.0)


@pytest.mark.slow
def test_a_payload_that_is_released_is_kept_beside_other_constants() -> None:
    scene = forearm_of(1.0)
    worlds = tl.simulate_many(scene, parameters={"forearm.mass": [1.0, 1.5]}, accuracy=1e-8)
    for i, mass in enumerate((1.0, 1.5)):
        assert np.abs(worlds.q[i] - tl.simulate(forearm_of(mass), accuracy=1e-8).q[-1]).max() < 2e-8


@pytest.mark.slow
def test_derivatives_are_by_the_links_own_mass_where_a_payload_is_released() -> None:
    s, step = tl.sensitivities(forearm_of(1.0), wrt=["forearm.mass"], accuracy=1e-7), 1e-3
    weights = {1: 2 / 3, -1: -2 / 3, 2: -1 / 12, -2: 1 / 12}
    ends = [weight * tl.simulate(forearm_of(1.0 + k * step), accuracy=1e-11).q[-1] for k, weight in weights.items()]
    assert np.abs(s.q["forearm.mass"][-1, :, 0] - sum(ends) / step).max() <= s.error["forearm.mass"][-1] + 1e-7


@pytest.mark.slow
@pytest.mark.parametrize("name", ["forearm.first_moment.z", "forearm.origin_inertia.yy"])
def test_moments_of_a_link_are_parameters(name: str) -> None:
    """Names that `tl.fit` takes: worlds that have others, and derivatives; the other nine parameters stay."""
    value, step = named_parameters(ARM, [name], "wrt")[0].nominal, 1e-4
    body = ARM.robot.model.inertias[2].toDynamicParameters()
    other = scene_with(ARM, {name: value + step}).robot.model.inertias[2].toDynamicParameters()
    assert np.sort(np.abs(other - body))[-2:] == pytest.approx([0.0, step], abs=1e-12)
    shifts = np.array([1, -1, 2, -2]) * step
    worlds = tl.simulate_many(ARM, parameters={name: value + shifts}, duration=0.5, accuracy=1e-11)
    truth = np.array([2 / 3, -2 / 3, -1 / 12, 1 / 12]) @ worlds.q / step
    s = tl.sensitivities(ARM, wrt=[name], duration=0.5, accuracy=1e-8)
    assert np.abs(truth).max() > 0.01
    assert np.abs(s.q[name][-1, :, 0] - truth).max() <= s.error[name][-1] + 1e-6 * np.abs(truth).max()


def test_a_moment_is_set_after_the_mass_whatever_their_order() -> None:
    values = {"forearm.first_moment.z": -0.3, "forearm.mass": 1.7}
    for some in (values, dict(reversed(values.items()))):
        body = scene_with(ARM, some).robot.model.inertias[2].toDynamicParameters()
        assert body[[0, 3]] == pytest.approx([1.7, -0.3])
