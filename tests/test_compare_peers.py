"""scripts/compare_peers.py: its peers simulate the same robots, and its reference is one."""

import mujoco
import numpy as np
import pytest

import twolink as tl
from scripts.peers import mujoco_peer, scipy_peer
from scripts.peers.problem import INTERVALS, Reference, axes, largest_difference, problems
from scripts.peers.report import Entry, print_scene

PROBLEMS = problems()


@pytest.mark.parametrize("name", PROBLEMS)
def test_the_models_for_mujoco_accelerate_as_pinocchio_says(name: str) -> None:
    assert largest_difference(PROBLEMS[name], mujoco_peer.accelerations(PROBLEMS[name])) < 1e-12


def test_what_a_robot_is_compared_without_is_off_in_mujoco() -> None:
    model = mujoco_peer.build(PROBLEMS["panda"].model)
    assert not model.dof_damping.any()
    assert not model.dof_armature.any()
    assert not model.jnt_limited.any()
    assert model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT


def test_robots_that_the_peers_would_not_share_are_refused() -> None:
    with pytest.raises(ValueError, match="only revolute joints"):
        axes(tl.load_robot("anymal", root="free").model)


def test_the_reference_is_close_to_every_contestant() -> None:
    pytest.importorskip("heyoka")
    problem = PROBLEMS["arm-swing"]
    reference = Reference(problem)
    assert reference.q.shape == (INTERVALS + 1, 2)
    assert np.array_equal(reference.q[0], problem.scene.q)
    assert reference.doubt < 1e-15
    assert reference.growth < 100
    assert largest_difference(problem, reference.accelerations) < 1e-12
    errors = {}
    for contestant in scipy_peer.contestants(problem, [1e-8]):
        if contestant.name != "SciPy Radau":
            errors[contestant.name] = reference.error(contestant.rungs[0].run().q)
    runge_kutta = next(c for c in mujoco_peer.contestants(problem, 2.0) if c.name == "MuJoCo RK4")
    errors["MuJoCo RK4"] = reference.error(runge_kutta.rungs[6].run().q)
    assert max(errors.values()) < 1e-5, errors


def test_the_summary_tells_what_is_met(capsys: pytest.CaptureFixture[str]) -> None:
    def entry(who: str, error: float, seconds: float) -> Entry:
        return Entry("arm-swing", who, "accuracy 1e-03", error, seconds, None, 3)

    peers = [entry("SciPy RK45", 1e-4, 0.5), entry("Drake radau3", 1e-7, 1.0)]
    print_scene([*peers, entry("twolink", 1e-7, 0.04), entry("twolink, verified", 1e-7, 0.1)], doubt=1e-17)
    lines = capsys.readouterr().out.splitlines()
    verdicts = {line.split()[0]: line for line in lines if line.strip().startswith("1e-")}
    assert verdicts["1e-03"].endswith("12.5x  10x met")
    assert verdicts["1e-06"].endswith("25.0x  20x met")
    assert verdicts["1e-09"].endswith("20x missed")
    assert lines[-1].endswith("1e-03 2.50; bar 3x met")
