"""scripts/benchmarks/peers.py: its peers simulate the same robots, its reference is one, its tables say what is met."""

import functools

import mujoco
import numpy as np
import pytest

from scripts.benchmarks.peers import (
    INTERVALS,
    Entry,
    compared_scenes,
    error_of,
    largest_difference,
    largest_growth,
    print_scene,
)
from twolink.hard.peers import mujoco_peer, scipy_peer
from twolink.hard.peers.task import PeerTask, Setting, task_of
from twolink.hard.truths import extended_reference


@functools.cache
def task(name: str) -> PeerTask:
    """What the peers are asked to do in a scene."""
    scene, end = compared_scenes()[name]
    return task_of(scene, np.linspace(0, end, INTERVALS + 1))


@pytest.mark.parametrize("name", compared_scenes())
def test_mujocos_models_accelerate_as_pinocchio_says(name: str) -> None:
    aba, forward = scipy_peer.accelerations(task(name)), mujoco_peer.accelerations(task(name))
    assert largest_difference(task(name), forward, aba) < 1e-12


def test_effects_that_the_scene_lacks_are_off_in_mujoco() -> None:
    model = mujoco_peer.build(task("panda"))
    assert not model.dof_damping.any()
    assert not model.dof_armature.any()
    assert not model.jnt_limited.any()
    for name in ("CONTACT", "LIMIT", "CONSTRAINT", "SPRING", "DAMPER"):
        if flag := getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}", 0):
            assert model.opt.disableflags & flag, name


def test_the_reference_is_close_to_every_peer() -> None:
    scene, _ = compared_scenes()["arm-swing"]
    swing = task("arm-swing")
    reference, doubt = extended_reference(scene, swing.times)
    assert reference.shape == (INTERVALS + 1, 2)
    assert np.array_equal(reference[0], scene.q)
    assert doubt[-1] < 1e-15
    assert largest_growth(scene, swing.times, reference) < 100
    settings = [Setting(method, "tol 1e-8", 1e-8) for method in scipy_peer.METHODS if method != "Radau"]
    errors = {s.method: error_of(scipy_peer.prepare(swing, s)().track.q, reference) for s in settings}
    runge_kutta = [s for s in mujoco_peer.all_settings(swing, coarse=True) if s.method == "RK4"][6]
    errors["MuJoCo RK4"] = error_of(mujoco_peer.prepare(swing, runge_kutta)().track.q, reference)
    assert max(errors.values()) < 1e-5, errors


def test_settings_go_from_rough_to_fine() -> None:
    for module in (scipy_peer, mujoco_peer):
        coarse, fine = (module.all_settings(task("ur5"), coarse) for coarse in (True, False))
        assert len(fine) > 1.8 * len(coarse)
        for method in {s.method for s in fine}:
            values = [s.tolerance or s.step for s in fine if s.method == method]
            assert values == sorted(values, reverse=True)


def test_the_summary_says_what_is_met(capsys: pytest.CaptureFixture[str]) -> None:
    def entry(who: str, error: float, seconds: float) -> Entry:
        return Entry("arm-swing", who, "accuracy 1e-03", error, seconds, None, 3)

    peers = [entry("SciPy RK45", 1e-4, 0.5), entry("Drake radau3", 1e-7, 1.0)]
    print_scene([*peers, entry("twolink", 1e-7, 0.02), entry("twolink, verified", 1e-7, 0.05)], doubt=1e-17)
    lines = capsys.readouterr().out.splitlines()
    verdicts = {line.split()[0]: line for line in lines if line.strip().startswith("1e-")}
    assert verdicts["1e-03"].endswith("25.0 20x met")
    assert verdicts["1e-06"].endswith("50.0 40x met")
    assert verdicts["1e-09"].endswith("50x missed")
    assert lines[-1].endswith("1e-03 2.50; bar 3x met")
